"""Spacecraft from SPK files: types 2 and 3 through jplephem, 1, 8, 9, 12, 13 and 21 by readers of our own."""

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jplephem.daf import DAF
from jplephem.spk import SPK

from nebosvod.borders.quantities import bordered
from nebosvod.dynamics.spkfile import read_summaries
from nebosvod.errors import CoverageError, DataError, InputError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.spacecraft.difference_lines import LARGEST_TABLE, DifferenceLines
from nebosvod.observation.spacecraft.tabulated import (
    BARYCENTRE,
    Segment,
    TablePiece,
    TabulatedOrbit,
    central_body,
    require_plausible,
    usable,
)
from nebosvod.timescale import Epoch

J2000 = Epoch.from_jd(2451545.0)
FRAME_J2000 = 1
OF_JPLEPHEM = {2, 3}
# what reading a file leads to whose numbers are damaged
DAMAGED = (OSError, ValueError, LookupError, ArithmeticError, TypeError, struct.error, EOFError)
CENTRES = {
    0: BARYCENTRE,
    3: "emb",
    10: "sun",
    399: "earth",
    301: "moon",
    199: "mercury",
    1: "mercury",
    2: "venus",
    299: "venus",
    4: "mars",
    5: "jupiter",
    6: "saturn",
    7: "uranus",
    8: "neptune",
    9: "pluto",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChebyshevOrbit:
    """A spacecraft in an SPK file of type 2 or 3, evaluated by jplephem."""

    source: str
    origin: str
    path: Path
    target: int

    @property
    def centre(self) -> str:
        return central_body(self.origin)

    @bordered()
    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6).

        Raises
        ------
        CoverageError
            If a time lies in no segment.
        """
        states = np.full((t_s.size, 6), np.nan)
        day = (epoch.fraction * 86400.0 + t_s) / 86400.0
        try:
            with SPK.open(self.path) as kernel, np.errstate(all="ignore"):
                for segment in kernel.segments:
                    if segment.target == self.target:
                        _fill(states, segment, epoch.day, day)
        except DAMAGED as error:
            raise DataError(f"{self.path}: damaged SPK file ({error})") from None
        require_plausible(str(self.path), states[~np.isnan(states[:, 0])])
        if np.any(np.isnan(states)):
            lost = epoch + float(t_s[np.argmax(np.isnan(states[:, 0]))])
            raise CoverageError(f"{self.source}: no state at {lost.iso(digits=0)}")
        if self.origin == BARYCENTRE:
            return states
        return states + ephemeris.state_km_km_s(self.origin, epoch, t_s)


def _fill(states: Array, segment: Any, whole: float, day: Array) -> None:
    """Write the states of a segment at the days that lie in it."""
    inside = (day >= segment.start_jd - whole) & (day <= segment.end_jd - whole)
    if np.any(inside):
        place, per_day = segment.compute_and_differentiate(whole, day[inside])
        states[inside, :3] = place[:3].T
        # a type 3 segment carries its own velocity in the last three components, km/s
        states[inside, 3:] = place[3:].T if place.shape[0] == 6 else per_day.T / 86400.0
        if np.isnan(states[inside]).any():
            raise ValueError("a state inside of a segment is not a number")


def _require_series(path: Path, daf: DAF, values: tuple[float, ...]) -> None:
    """Types 2 and 3: a directory that fits the segment, as jplephem takes it for granted."""
    first, last = int(values[6]), int(values[7])
    start, length, width, count = np.array(daf.read_array(max(last - 3, 1), last), dtype=np.float64)
    per_component = 3 if int(values[5]) == 2 else 6
    sound = math.isfinite(start) and 0.0 < length < math.inf and width >= 2 + per_component and count >= 1
    if not sound or (width - 2) % per_component or width * count + 4 != last - first + 1:
        raise DataError(f"{path}: target {int(values[2])}: damaged directory ({start}, {length}, {width}, {count})")


def read_spk(path: str | Path, target: int | None = None) -> ChebyshevOrbit | TabulatedOrbit:
    """The orbit of `target` (NAIF number; None = the only one in the file).

    Raises
    ------
    DataError
        If the file cannot be read, has no such target, or stores it in a type, frame or about a centre that is not
        supported; names the file and what was found.
    """
    path = Path(path)
    try:
        summaries = read_summaries(path).values
        with path.open("rb") as stream, np.errstate(all="ignore"):
            return _read(path, DAF(stream), summaries, target)
    except InputError as error:  # numbers that no orbit has
        raise DataError(f"{path}: {error}") from None
    except DAMAGED as error:
        raise DataError(f"{path}: cannot be read as an SPK file ({error})") from None


def _read(
    path: Path, daf: DAF, summaries: Sequence[tuple[float, ...]], target: int | None
) -> ChebyshevOrbit | TabulatedOrbit:
    """Pick the summaries of the target and build its orbit."""
    targets = sorted({int(values[2]) for values in summaries})
    if target is None:
        if len(targets) != 1:
            raise DataError(f"{path}: holds {len(targets)} targets, say which (there are {targets[:10]})")
        target = targets[0]
    mine = [values for values in summaries if int(values[2]) == target]
    if not mine:
        raise DataError(f"{path}: no target {target} (there are {targets[:10]})")
    centres, frames, kinds = ({int(values[k]) for values in mine} for k in (3, 4, 5))
    if frames != {FRAME_J2000}:
        raise DataError(f"{path}: target {target} is in frame {sorted(frames)}, only J2000 (1) is read")
    if len(centres) != 1 or not centres <= CENTRES.keys():
        raise DataError(f"{path}: target {target} is about {sorted(centres)}, one of {sorted(CENTRES)} is read")
    origin = CENTRES[centres.pop()]
    if kinds <= OF_JPLEPHEM:
        for values in mine:
            _require_series(path, daf, values)
        return ChebyshevOrbit(source=path.name, origin=origin, path=path, target=target)
    if not kinds <= READERS.keys():
        known = "1, 2, 3, 8, 9, 12, 13 and 21"
        together = " together" if kinds & OF_JPLEPHEM and kinds - OF_JPLEPHEM <= READERS.keys() else ""
        raise DataError(f"{path}: target {target} is of SPK type {sorted(kinds)}{together}; types {known} are read")
    try:
        segments = tuple(READERS[int(values[5])](daf, values) for values in mine)
    except InputError as error:
        raise DataError(f"{path}: target {target}: {error}") from None
    return TabulatedOrbit(source=path.name, epoch=J2000, origin=origin, segments=segments)


def _words(daf: DAF, values: tuple[float, ...], least: int) -> Array:
    """All numbers of a segment."""
    first, last = int(values[6]), int(values[7])
    if not 1 <= first <= last - least + 1:
        raise InputError(f"a segment from word {first} to {last} has no room for its numbers")
    return np.array(daf.read_array(first, last), dtype=np.float64)


def _count(words: Array, number: float, per_record: int) -> int:
    """How many records a segment says it has, if they fit into its numbers."""
    if not (1 <= number <= words.size / per_record and number == int(number)):
        raise InputError(f"a segment of {words.size} numbers says it has {number:g} records")
    return int(number)


def _states(daf: DAF, values: tuple[float, ...]) -> Segment:
    """Types 8, 9, 12, 13: N states; then N epochs and their directory, or first epoch and step; window less one, N."""
    words, kind = _words(daf, values, 4), int(values[5])
    equal_steps = kind in (8, 12)
    count, window = _count(words[: -4 if equal_steps else -2], words[-1], 6 if equal_steps else 7), words[-2] + 1.0
    if not 2.0 <= window <= 100.0:
        raise InputError(f"a segment says it interpolates through {window:g} points")
    times = words[-4] + words[-3] * np.arange(count) if equal_steps else words[6 * count : 7 * count]
    return Segment(
        t_s=times,
        states=words[: 6 * count].reshape(count, 6),
        **usable(values[0], values[1], times),
        method="hermite" if kind in (12, 13) else "lagrange",
        window=int(window),
    )


def _differences(daf: DAF, values: tuple[float, ...]) -> DifferenceLines:
    """Types 1 and 21: N records, the epochs at which they end and a directory; type 21 the size of a table; N."""
    words = _words(daf, values, 73)
    size = 15.0 if int(values[5]) == 1 else words[-2]
    if not (2.0 <= size <= LARGEST_TABLE and size == int(size)):
        raise InputError(f"difference tables of {size:g} rows (allowed 2 to {LARGEST_TABLE})")
    width = 4 * int(size) + 11
    count = _count(words[:-1], words[-1], width + 1)
    ends = words[count * width : count * (width + 1)]
    return DifferenceLines(
        records=words[: count * width].reshape(count, width),
        end_of_record_s=ends,
        start_s=values[0],
        end_s=min(values[1], float(ends[-1])),
    )


# SPK Required Reading (NAIF): what the numbers of a segment are, by its data type
READERS: Mapping[int, Callable[[DAF, tuple[float, ...]], TablePiece]] = {
    1: _differences,
    8: _states,
    9: _states,
    12: _states,
    13: _states,
    21: _differences,
}
