"""Who looks: an observatory code, a telescope of a mission, or a spacecraft in an OEM or SPK file."""

from pathlib import Path

import numpy as np

from nebosvod.errors import DataError, InputError
from nebosvod.mission import load_mission
from nebosvod.mission.reading.builtin import builtin_names
from nebosvod.mission.yaml.yamlfile import shown
from nebosvod.observation import GroundSite, Spacecraft, Telescope, read_oem, read_spk
from nebosvod.observation.earth import obscodes
from nebosvod.scene.instruments import telescopes
from nebosvod.units import DEG

GEOCENTRE = "500"
FORMS = "an observatory code (F51), a telescope of a mission (MISSION.yaml:NAME), an OEM (.oem) or an SPK file (.bsp)"
MISSIONS, OEMS, SPKS = (".yaml", ".yml"), (".oem",), (".bsp", ".spk")


def observer(text: str) -> Telescope:
    """The observer that `text` names.

    Parameters
    ----------
    text : a code of the MPC with a fixed place; MISSION:NAME, a telescope of a mission file or a built-in mission (of a
        mission with one telescope MISSION alone); a file of a spacecraft, FILE.bsp:TARGET where it holds several.

    Raises
    ------
    InputError
        If it is none of these, or the file cannot be used.
    """
    place, _, name = text.rpartition(":")
    place, name = (place, name) if place else (text, "")
    suffix = Path(place).suffix.lower()
    try:
        if suffix in OEMS:
            return _seen_from(text, read_oem(place).orbit)
        if suffix in SPKS:
            return _seen_from(text, read_spk(place, _target(text, name)))
    except DataError as error:
        raise InputError(str(error)) from None
    if suffix in MISSIONS or place in builtin_names():
        return _of_mission(place, name)
    if obscodes.known(text):
        return _site(text)
    said = f" ({text} {obscodes.unknown(text)})" if len(text) == 3 else f" (got {shown(text, 60)})"
    raise InputError(f"an observer is {FORMS}{said}")


def _seen_from(name: str, spacecraft: Spacecraft) -> Telescope:
    """An observer without limits."""
    return Telescope(name=name, spacecraft=spacecraft, sigma_rad=np.ones(2))


def _target(text: str, name: str) -> int | None:
    if name and not name.lstrip("-").isdigit():
        raise InputError(f"{shown(text, 80)}: the target of an SPK file is a NAIF number (got {shown(name, 40)})")
    return int(name) if name else None


def _of_mission(place: str, name: str) -> Telescope:
    """A telescope of a mission, with its limits."""
    mission = load_mission(place)
    found = telescopes(mission)
    names = ", ".join(one.name for one in found)
    if not name and len(found) > 1:
        raise InputError(f"{shown(place)}: has {len(found)} telescopes ({names}); say which: {shown(place)}:NAME")
    chosen = next((one for one in found if not name or one.name == name), None)
    if chosen is None:
        raise InputError(f"{shown(place)}: has no telescope {shown(name, 40)} (there are {names})")
    return chosen


def _site(code: str) -> Telescope:
    """An observatory with a fixed place; after the tables of the Earth's rotation the last values are held."""
    if obscodes.needs_position(code):
        raise InputError(f"{obscodes.described(code)} has no fixed place; give its trajectory as an OEM or SPK file")
    longitude = float(obscodes.codes()[code]["Longitude"]) * DEG
    site = GroundSite.from_parallax(longitude, *obscodes.parallax(code), extrapolate=True)
    return _seen_from(obscodes.described(code), site)
