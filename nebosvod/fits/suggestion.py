"""The settings that would mend what the score tests of a fit found: `uncertainty`, and a force to estimate."""

import itertools
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from nebosvod.borders.wholefile import require_place, whole_file
from nebosvod.errors import InputError, OutputError
from nebosvod.fits.leading import Led
from nebosvod.fits.missing_force import foremost
from nebosvod.fits.shared_errors import SharedError
from nebosvod.mission import FitMission
from nebosvod.mission.slugs import slug
from nebosvod.mission.yaml.yamlfile import parse_yaml
from nebosvod.timescale import SECONDS_PER_DAY, Epoch
from nebosvod.units import ARCSEC

WIDER = 2.0  # prior sigma against the size that was found: it must not lead
SHORTEST_S = 0.5 * SECONDS_PER_DAY
PARTS = 20.0  # of the span: correlation time of a wander
PATHS = ("weights", "debias", "file", "ephemeris")  # keys that name files
MARK = "# Settings that nebosvod fit --suggest has written; --overwrite replaces them while this line stands first."


def entry(one: SharedError, epoch: Epoch) -> dict[str, Any]:
    """The entry of `fit.uncertainty` for one shared error.

    Parameters
    ----------
    epoch : from which `span_s` counts.
    """
    size = WIDER * float(np.max(one.size_rad)) / ARCSEC
    sigma = f"{max(size, 0.01):.2g} arcsec"
    error: dict[str, Any] = {"sigma": sigma}
    group = "bias"
    if one.kind == "clock":
        group, error = "timing", {"sigma": f"{WIDER * abs(one.estimate[0]):.2g} s"}
    elif one.kind == "drift" and one.whole:
        middle = epoch + (one.span_s[0] + one.span_s[1]) / 2.0
        rate = WIDER * max(abs(value) for value in one.estimate)
        error |= {"correlation": "drift", "drift": f"{rate:.2g} arcsec/d", "epoch": f"{middle.iso(digits=0)}"}
    elif one.kind in ("drift", "wander"):
        length = (one.span_s[1] - one.span_s[0]) / (1.0 if one.kind == "drift" else PARTS)
        error |= {"correlation": "gauss_markov", "time": f"{max(length, SHORTEST_S) / SECONDS_PER_DAY:.2g} d"}
    elif one.kind == "scatter":
        error |= {"correlation": "per_arc", "gap": "0.5 d"}
    elif not one.whole:
        night = one.span_s[1] - one.span_s[0] < SECONDS_PER_DAY
        error |= {"correlation": "per_arc", "gap": "0.5 d" if night else "30 d"}
    return {"stations": [one.station], group: error | {"treatment": "estimated"}}


def flow(block: Mapping[str, Any]) -> str:
    """A block as YAML on one line."""
    return yaml.dump(dict(block), Dumper=_Dumper, default_flow_style=True, sort_keys=False, width=10_000).strip()


class _Dumper(yaml.SafeDumper):
    """What the program reads back as it was: PyYAML's own leaves 084 bare, which is a number to YAML 1.2."""


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    """A text, in quotes where it begins like a number and has no blank."""
    bare = " " in text or not text[:1].isdigit()
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if bare else "'")


_Dumper.add_representer(str, _text)


def suggested(mission: FitMission, found: Led, epoch: Epoch, folder: Path, copied: list[Path]) -> dict[str, Any]:
    """The settings of a fit with what its tests would mend added.

    Parameters
    ----------
    epoch : from which the spans of shared errors count.
    folder : where the settings will stand; files are named as they are seen from there, and those outside are copied
        into it, for settings name only files below their folder.
    copied : is told of them.

    Raises
    ------
    OutputError
        If a file cannot be copied, or what is named is a folder outside.
    """
    read = parse_yaml(mission._text, mission.name).tree if mission._text else {}
    given: dict[str, Any] = _seen(read, mission, folder, copied) if isinstance(read, dict) else {}
    said: dict[str, Any] = given | {"schema_version": 1, "name": f"{slug(mission.name, 'name')}-mended"}
    plan = dict(said.get("fit") or {}) | _plan(mission)
    plan["observations"] = [_from(folder, mission, name, copied) for name in mission.fit.observations]
    entries = plan.get("uncertainty") or []
    entries = [entries] if isinstance(entries, dict) else list(entries)
    taken: set[tuple[str, str]] = set()
    for one in found.errors:
        block = entry(one, epoch)
        key = (one.station, next(name for name in block if name != "stations"))
        if key not in taken:
            taken.add(key)
            entries.append(block)
    if entries:
        plan["uncertainty"] = entries
    force = foremost(found.forces)
    if force is not None:
        body = dict(said.get("object") or {})
        sigma = f"{WIDER * abs(force.estimate):.2g} au/d^2"
        value = {"value": "0 au/d^2", "sigma": sigma, "treatment": "estimated"}
        body["nongrav"] = dict(body.get("nongrav") or {}) | {force.label: value}
        said["object"] = body
    said["fit"] = plan
    return said


def writable(path: Path, overwrite: bool) -> None:
    """Refuse a place for suggested settings before anything is computed.

    Raises
    ------
    InputError
        If it is no settings file by its name.
    OutputError
        If it cannot be written, or a file is there that must not be replaced: of those only what was suggested before.
    """
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"--suggest: {path} is no settings file by its name; give it .yaml")
    try:
        require_place(path)
        if not path.exists():
            return
        if not overwrite:
            raise OutputError(f"{path}: exists already; choose another name, or give --overwrite")
        with path.open("rb") as file:
            if file.read(len(MARK)) != MARK.encode():
                text = "was not suggested by this program, and only what was is replaced; choose another name"
                raise OutputError(f"{path}: {text}")
    except OutputError as error:
        raise OutputError(f"--suggest: {error}") from None


def write_suggestion(path: Path, mission: FitMission, found: Led, epoch: Epoch, overwrite: bool) -> tuple[Path, ...]:
    """Write those settings; returns them and what was copied beside them; nothing where there is nothing to mend.

    Raises
    ------
    OutputError
        If they cannot be written, or must not.
    """
    if not found.errors and foremost(found.forces) is None:
        return ()
    writable(path, overwrite)
    copied: list[Path] = []
    settings = suggested(mission, found, epoch, path.parent, copied)
    text = f"{MARK}\n{yaml.dump(settings, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)}"
    with whole_file(path, new=not overwrite) as file:
        file.write(text.encode("utf-8"))
    return path, *copied


def _plan(mission: FitMission) -> dict[str, Any]:
    """What a command line has said beside the files."""
    plan: dict[str, Any] = {}
    if mission.fit.designation:
        plan["designation"] = list(mission.fit.designation)
    for key, when in (("from", mission.fit.since), ("to", mission.fit.until)):
        if when is not None:
            plan[key] = f"{when.iso('utc', 0)}"
    return plan


def _seen(tree: Any, mission: FitMission, folder: Path, copied: list[Path]) -> Any:
    """A tree of settings with every file in it named as it is seen from another folder."""
    if isinstance(tree, list):
        return [_seen(value, mission, folder, copied) for value in tree]
    if not isinstance(tree, dict):
        return tree
    return {
        key: _from(folder, mission, value, copied)
        if key in PATHS and isinstance(value, str)
        else _seen(value, mission, folder, copied)
        for key, value in tree.items()
    }


def _from(folder: Path, mission: FitMission, name: str, copied: list[Path]) -> str:
    """A file named beside the settings, or on the command line, as seen from another folder; a copy of one outside."""
    full, home = (mission.beside(name) if mission.path is not None else Path(name)).resolve(), folder.resolve()
    if full.is_relative_to(home):
        return os.path.relpath(full, home)
    if not full.is_file():
        raise OutputError(f"--suggest: {full} is a folder outside {home}; write the settings where they can name it")
    try:
        data = full.read_bytes()
        for number in itertools.count(1):
            stem, dot, rest = full.name.partition(".")
            place = home / (full.name if number == 1 else f"{stem}-{number}{dot}{rest}")
            if not place.exists():
                with whole_file(place, new=True) as file:
                    file.write(data)
                copied.append(place)
            if place.is_file() and place.read_bytes() == data:
                return place.name
    except OSError as error:
        raise OutputError(f"--suggest: {full} cannot be copied to {home}: {error.strerror}") from None
    raise AssertionError("numbers do not end")
