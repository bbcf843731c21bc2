"""Who could observe next: telescopes of a mission with their errors, stations of a fit with theirs, or any observer."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from nebosvod.ephemerides.observers import MISSIONS, observer
from nebosvod.errors import InputError
from nebosvod.mission import FitMission, Mission, load_mission
from nebosvod.mission.reading.again import made_from
from nebosvod.mission.reading.builtin import builtin_names
from nebosvod.mission.yaml.yamlfile import shown
from nebosvod.orbits.folders import is_folder_of_ours
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.planning.coming import Watch
from nebosvod.scene.instruments import telescopes

HOW = "give --telescope MISSION.yaml, MISSION.yaml:NAME, or an observatory code with --sigma"


def watches(path: str, orbit: UncertainOrbit, named: Sequence[str], sigma_rad: float | None) -> list[Watch]:
    """The telescopes named, or those that come with the orbit.

    Parameters
    ----------
    path : where the orbit came from: the telescopes of a mission or a run are candidates without being named.
    named : an observatory code, MISSION.yaml, MISSION.yaml:NAME, or a spacecraft's file.
    sigma_rad : of one exposure of those that no mission describes.

    Raises
    ------
    InputError
        If there is none, one cannot be used, or two have one name.
    """
    own = _own(path)
    if not named and not isinstance(own, Mission):
        raise InputError(f"{shown(path)}: no telescope comes with this orbit; {HOW}")
    if not named and isinstance(own, Mission):
        found = [Watch(telescope=one, question=own) for one in telescopes(own)]
    else:
        found = [watch for text in named for watch in _of(text, own, orbit, sigma_rad)]
    names = [one.telescope.name for one in found]
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if twice is not None:
        raise InputError(f"--telescope: {shown(twice, 60)} is given twice; name each once")
    return found


def _own(path: str) -> Mission | FitMission | None:
    """The mission or the fit that an orbit comes from."""
    if is_folder_of_ours(Path(path)):
        return made_from(Path(path))
    return load_mission(path) if _is_mission(path) else None


def _of(
    text: str, own: Mission | FitMission | None, orbit: UncertainOrbit, sigma_rad: float | None
) -> list[Watch]:  # fmt: skip
    """What one --telescope names."""
    if _is_mission(text):
        mission = load_mission(text)
        return [Watch(telescope=one, question=mission) for one in telescopes(mission)]
    place = text.rpartition(":")[0]
    if place and _is_mission(place):
        return [Watch(telescope=observer(text), question=load_mission(place))]
    if isinstance(own, Mission) and text in [one.name for one in own.telescopes]:
        return [Watch(telescope=one, question=own) for one in telescopes(own) if one.name == text]
    try:
        who = observer(text)
    except InputError as error:
        raise InputError(f"--telescope: {error}") from None
    if sigma_rad is None:
        raise InputError(f'--telescope {shown(text, 60)}: give --sigma of one exposure, as "0.2 arcsec"')
    who = replace(who, name=text, sigma_rad=sigma_rad)
    if not isinstance(own, FitMission):
        return [Watch(telescope=who, question=None)]
    return [Watch(telescope=who, question=own.of(orbit.name, (text,), orbit.epoch, orbit.state))]


def _is_mission(text: str) -> bool:
    return Path(text).suffix.lower() in MISSIONS or text in builtin_names()
