"""OrbFit's residual files (.rwo, version 2): observations with the weights and star-catalogue biases that OrbFit gave.

One line an observation in fixed columns, a second one for observers without a fixed place; radar follows the optical
records. The sigmas are taken as weights that are not touched again, and the biases stand in for a table of them;
OrbFit's residuals and what it selected are not used.

The columns are those found in files that OrbFit 5 wrote for (410777) and (1862); neither holds a roving observer, whose
second line is taken to be like that of a spacecraft, with longitude, latitude and altitude.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from nebosvod.observation.contracts import Array
from nebosvod.observation.earth import obscodes
from nebosvod.observation.earth.universal_time import FIRST_YEAR, LAST_YEAR, iso, month_days, tdb_times
from nebosvod.observation.formats import mpc80_codes
from nebosvod.observation.formats.designations import NO_SATELLITES, OWN_NAME, Designation, from_text, is_satellite
from nebosvod.observation.formats.mpc80_places import roving_km, spacecraft_km
from nebosvod.observation.formats.object_names import exercises, names_of, other_names, readings
from nebosvod.observation.formats.records import Astrometry, told, without_repeats
from nebosvod.observation.formats.source_file import SourceFile, printable, read_source
from nebosvod.units import ARCSEC

VERSION = re.compile(rb"version\s*=\s*(\d+)\s")
END_OF_HEADER = "END_OF_HEADER"
WIDTH, SHORTEST = 197, 183
# columns (from 0, end excluded) of an optical record
COLUMNS = {
    "name": (1, 10), "kind": (11, 12), "note": (13, 14), "date": (17, 38), "date accuracy": (40, 49),
    "right ascension": (50, 62), "RA accuracy": (64, 73), "RA RMS": (73, 82), "RA bias": (84, 93),
    "declination": (103, 115), "Dec accuracy": (117, 126), "Dec RMS": (126, 135), "Dec bias": (137, 146),
    "magnitude": (156, 161), "band": (161, 162), "catalogue": (178, 179), "observatory": (180, 183),
    "selection": (194, 195),
}  # fmt: skip
NUMBERS = {
    "date accuracy": (0.0, 1e4), "RA accuracy": (0.0, 1e6), "Dec accuracy": (0.0, 1e6), "RA RMS": (0.0, 1e5),
    "Dec RMS": (0.0, 1e5), "RA bias": (-1e3, 1e3), "Dec bias": (-1e3, 1e3),
}  # fmt: skip
POSITIVE = ("RA RMS", "Dec RMS")
DATE = re.compile(r"(\d{4}) (\d{2}) (\d{2})(\.\d{1,12})?", re.ASCII)
ANGLE = re.compile(r"([+-]?)(\d{2}) (\d{2}) (\d{2}(?:\.\d{0,6})?)", re.ASCII)
RADAR = ("R", "V")


@dataclass(slots=True)
class _Rows:
    """Optical records read so far: texts by column, numbers by column, line, and place of the observer."""

    line: list[int] = field(default_factory=list)
    text: list[dict[str, str]] = field(default_factory=list)
    number: list[dict[str, float]] = field(default_factory=list)
    place: list[Array] = field(default_factory=list)
    radar: int = 0
    deleted: int = 0


def is_rwo(data: bytes) -> bool:
    """Whether the contents of a file begin as OrbFit's do."""
    start = data[:4096].lstrip()
    return bool(VERSION.match(start)) and (b"errmod" in start or END_OF_HEADER.encode() in start)


def read(path: str | Path) -> Astrometry:
    """Read a .rwo file; raises InputError with file and line, DataError if it cannot be opened."""
    return parse(read_source(path))


def parse(source: SourceFile) -> Astrometry:
    """The observations in the contents of a .rwo file; raises as `read`."""
    version = VERSION.match(source.data.lstrip())
    if version is None or version[1] != b"2":
        raise source.error(1, "only version 2 of OrbFit's .rwo files is read (version = 2)")
    rows = _rows(source)
    source.refuse_problems()
    if not rows.line:
        raise source.error(1, f"no observations in this file ({rows.radar} radar left out)")
    designation, called, notices = _names(source, rows)
    numbers = {name: np.array([row[name] for row in rows.number]) for name in NUMBERS}
    calendar = _dates(source, rows)
    psi = _directions(source, rows)
    source.refuse_problems()
    epoch, t_s, _ = tdb_times(*calendar)
    n, code = len(rows.line), np.array([row["observatory"] for row in rows.text])
    flat = np.column_stack([np.cos(psi[:, 1]), np.ones(n)])
    left_out = {reason: count for reason, count in (("radar", rows.radar), ("deleted", rows.deleted)) if count}
    catalogue = np.array([mpc80_codes.CATALOGUES.get(row["catalogue"], "") for row in rows.text])
    roving = np.array([row["note"] == "V" for row in rows.text])
    unused = sum(row["selection"] == "0" for row in rows.text)
    file = source.name
    written = _pair(numbers, "accuracy") * flat * ARCSEC
    table = Astrometry(
        epoch=epoch,
        path=np.full(n, file),
        line=np.array(rows.line, dtype=np.int64),
        designation=designation,
        station=code,
        t_s=t_s,
        utc=iso(*calendar[:3], np.rint(calendar[3] * 1e4).astype(np.int64)),
        psi=psi,
        sigma_rad=_pair(numbers, "RMS") * ARCSEC,
        weighed=np.ones(n, dtype=np.bool_),
        bias_rad=_pair(numbers, "bias") * ARCSEC,
        correlation=np.zeros(n),
        timing_sigma_s=np.zeros(n),  # OrbFit's weights have no clocks beside them
        catalogue=catalogue,
        mode=np.where(np.isin(code, list(obscodes.OCCULTATION)), "OCC", [_mode(row["note"]) for row in rows.text]),
        centre=np.where([np.isfinite(place).all() for place in rows.place], "earth", ""),
        position_km=np.array(rows.place),
        position_covariance_km2=np.full((n, 3, 3), np.nan),
        roving=roving,
        precision_rad=written,
        written_rad=written,
        written_s=86400.0 * numbers["date accuracy"],
        magnitude=np.array([_magnitude(row["magnitude"]) for row in rows.text]),
        band=np.array([row["band"] for row in rows.text]),
        discovery=np.zeros(n, dtype=np.bool_),
        left_out=MappingProxyType(left_out),
        notices=(
            f"{file}: weights and star-catalogue biases are those of OrbFit",
            *([f"{file}: {unused} of its records were not used by OrbFit; here they are judged anew"] * (unused > 0)),
            *notices,
            *(told(reason, count) for reason, count in left_out.items()),
        ),
        other_names=MappingProxyType(called),
    )
    return without_repeats(table)


def _pair(numbers: dict[str, Array], what: str) -> Array:
    return np.stack([numbers[f"RA {what}"], numbers[f"Dec {what}"]], axis=1)


def _mode(note: str) -> str:
    return mpc80_codes.MODES.get(note or " ", "")


def _magnitude(text: str) -> float:
    return float(text) if re.fullmatch(r"\d{1,2}(?:\.\d*)?", text) else float("nan")


def _rows(source: SourceFile) -> _Rows:
    """Sort the lines: optical records with their second lines, radar, withdrawn ones."""
    rows, lines = _Rows(), _body(source)
    for number, line in lines:
        kind, note = line[11:12], line[13:14]
        if kind in RADAR and len(line) < 150:
            rows.radar += 1
        elif note in ("s", "v"):
            source.problem(number, f'line "{note}" stands alone: it must follow its line "{note.upper()}"')
        elif kind not in ("O", "S"):
            source.problem(number, f'column 12 "{printable(kind)}": allowed O, S, R, V')
        elif len(line) < SHORTEST:
            source.problem(number, f"the record has {len(line)} columns, not {WIDTH}; was the line cut?")
        else:
            place = np.full(3, np.nan)
            if note in ("S", "V"):
                place = _second(source, number, line, next(lines, (number + 1, "")))
            if note in ("X", "x"):
                rows.deleted += 1
                continue
            _take(source, rows, number, line, place)
    return rows


def _body(source: SourceFile) -> Iterator[tuple[int, str]]:
    """Numbered lines after the header, without comments."""
    begun = False
    for number, line in enumerate(source.text.split("\n"), start=1):
        if begun and line.strip() and not line.startswith("!"):
            yield number, line.rstrip()
        begun = begun or line.strip() == END_OF_HEADER


def _take(source: SourceFile, rows: _Rows, number: int, line: str, place: Array) -> None:
    """Cut one record into its columns."""
    text = {name: line[start:end].strip() for name, (start, end) in COLUMNS.items()}
    values = {name: _number(source, number, name, text[name]) for name in NUMBERS}
    if not obscodes.known(text["observatory"]):
        told = obscodes.NO_CODE if source.full else obscodes.unknown(text["observatory"])
        source.problem(number, f'columns 181-183 "{text["observatory"]}": {told}')
    elif obscodes.needs_position(text["observatory"]) and np.isnan(place).any() and not source.problems:
        name = obscodes.described(text["observatory"])
        source.problem(number, f'observatory {name} has no fixed place: a line "s" or "v" must tell it')
    rows.line.append(number)
    rows.text.append(text)
    rows.number.append(values)
    rows.place.append(place)


def _number(source: SourceFile, number: int, name: str, text: str) -> float:
    """One number of a record, noting what is wrong with it."""
    low, high = NUMBERS[name]
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not low <= value <= high or (name in POSITIVE and value == 0.0):
        source.problem(number, f'{name} "{printable(text, 20)}": allowed a number from {low:g} to {high:g}')
        return float("nan")
    return value


def _second(source: SourceFile, number: int, line: str, following: tuple[int, str]) -> Array:
    """Where the observer was, km, from the line after a record: `1  x y z code` (km; 2: au), or longitude, latitude."""
    nowhere = np.full(3, np.nan)
    small, words = line[13].lower(), following[1][34:].split()
    if (
        following[1][13:14] != small
        or following[1][:34].rstrip()[17:34] != line[:34].rstrip()[17:34]
        or len(words) != 5
    ):
        source.problem(number, f'line "{line[13]}" is not followed by its line "{small}" of the same time')
        return nowhere
    # as the columns of the Minor Planet Center's second lines
    signed = [word if word[0] in "+-" else f"+{word}" for word in words[1:4]]
    if small == "s":
        found = spacecraft_km(f"{'':32}{words[0]} {signed[0]:<11} {signed[1]:<11} {signed[2]:<11}", words[4])
    else:
        found = roving_km(f"{'':32}{words[0]} {signed[0]:<10} {signed[1]:<10} {signed[2]:<5}")
    if isinstance(found, str):
        source.problem(following[0], found)
        return nowhere
    return found


def _names(source: SourceFile, rows: _Rows) -> tuple[Any, dict[str, tuple[str, ...]], list[str]]:
    """Names of the objects (n,), their other names, and notices; OrbFit writes designations without their blank."""
    found: dict[str, Designation] = {}
    for number, text in zip(rows.line, (row["name"] for row in rows.text)):
        if text in found:
            continue
        known = (one for one in map(from_text, readings(text)) if one is not None)
        found[text] = next(known, Designation(own=text))
        if is_satellite(text):
            source.problem(number, f'"{text}" {NO_SATELLITES}')
        elif not OWN_NAME.fullmatch(text):
            source.problem(number, f'columns 2-10 "{printable(text, 20)}": is no designation')
    several = [found[row["name"]] for row in rows.text]
    return np.array(names_of(several)), other_names(found.values()), exercises(source.name, found.values())


def _dates(source: SourceFile, rows: _Rows) -> tuple[Any, Any, Any, Array]:
    """Year, month, day (n,) and seconds of the day (n,)."""
    parts, second = np.tile(np.array([2000, 1, 1]), (len(rows.line), 1)), np.zeros(len(rows.line))
    for k, row in enumerate(rows.text):
        match = DATE.fullmatch(row["date"])
        if match is None:
            source.problem(rows.line[k], f'date "{printable(row["date"], 30)}": allowed YYYY MM DD.dddddd')
            continue
        parts[k], second[k] = [int(match[i]) for i in (1, 2, 3)], 86400.0 * float(match[4] or 0.0)
    year, month, day = parts.T
    wrong = (day < 1) | (day > month_days(year, month)) | (year < FIRST_YEAR) | (year > LAST_YEAR)
    for k in np.flatnonzero(wrong).tolist():
        source.problem(rows.line[k], f'date "{rows.text[k]["date"]}": there is no such day from {FIRST_YEAR} on')
    return year, month, day, second


def _directions(source: SourceFile, rows: _Rows) -> Array:
    """RA and Dec (n, 2), rad, as measured."""
    psi = np.zeros((len(rows.line), 2))
    for k, row in enumerate(rows.text):
        for axis, name, most, unit in ((0, "right ascension", 24, 15.0), (1, "declination", 90, 1.0)):
            match = ANGLE.fullmatch(row[name])
            value = 0.0 if match is None else int(match[2]) + int(match[3]) / 60.0 + float(match[4]) / 3600.0
            signed = match is not None and (bool(match[1]) == (axis == 1))
            if not signed or not value <= most or (axis == 0 and value == most):
                source.problem(rows.line[k], f'{name} "{printable(row[name], 20)}": allowed such as 12 52 49.370')
                continue
            psi[k, axis] = np.radians(unit * (-value if match is not None and match[1] == "-" else value))
    return psi
