"""CCSDS Orbit Ephemeris Messages in keyword = value notation (CCSDS 502.0-B)."""

import math
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nebosvod.borders.text_lines import text_lines
from nebosvod.errors import DataError, InputError
from nebosvod.observation.contracts import Array
from nebosvod.observation.spacecraft.ccsds_time import SYSTEMS, read_time
from nebosvod.observation.spacecraft.tabulated import BARYCENTRE, Method, Segment, TabulatedOrbit, usable
from nebosvod.timescale import Epoch

CENTRES = {
    "EARTH": "earth",
    "SUN": "sun",
    "MOON": "moon",
    "EARTH BARYCENTER": "emb",
    "SOLAR SYSTEM BARYCENTER": BARYCENTRE,
    "MARS BARYCENTER": "mars",
}
FRAMES = ("EME2000", "ICRF", "GCRF")
MOST_DEGREES = 99
MOST_COVARIANCES = 20_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OemCovariance:
    """A 6 x 6 covariance of the state, km and km/s, at an epoch, in the frame the message names."""

    epoch: Epoch
    frame: str
    covariance: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Oem:
    """An orbit with the covariances that came with it."""

    object_name: str
    orbit: TabulatedOrbit
    covariances: tuple[OemCovariance, ...]


def read_oem(path: str | Path) -> Oem:
    """Read an OEM file in keyword notation.

    Raises
    ------
    DataError
        If the file cannot be opened; with file and line, for whatever in it cannot be used.
    """
    path = Path(path)
    with text_lines(path) as lines:
        return _Reader(path.name, lines).read()


class _Reader:
    """Walks through the lines once; knows where it is, for messages."""

    def __init__(self, name: str, lines: Iterator[tuple[int, str]]) -> None:
        self.name, self.number = name, 0
        self.lines = self._meaningful(lines)
        self.epoch: Epoch | None = None
        self.object_name = ""
        self.origins: list[str] = []
        self.segments: list[Segment] = []
        self.covariances: list[OemCovariance] = []

    def _meaningful(self, lines: Iterator[tuple[int, str]]) -> Iterator[str]:
        for self.number, line in lines:
            text = line.strip()
            if text and not text.startswith("COMMENT"):
                yield text

    def wrong(self, what: str) -> DataError:
        return DataError(f"{self.name}:{self.number}: {what}")

    def read(self) -> Oem:
        head = next(self.lines, "")
        if not head.replace(" ", "").startswith("CCSDS_OEM_VERS="):
            raise self.wrong(f'not an OEM in keyword notation: begins with "{head[:40]}"')
        meta: dict[str, str] = {}
        rows = array("d")  # seconds and state: a list of arrays takes ten times the memory
        for line in self.lines:
            if line == "META_START":
                self._close(meta, rows)
                meta, rows = self._meta(), array("d")
            elif line == "COVARIANCE_START":
                if not meta:
                    raise self.wrong("COVARIANCE_START stands before any META_START")
                self._covariance(meta)
            elif meta:
                rows.extend(self._state(line, meta))
        self._close(meta, rows)
        if self.epoch is None or not self.segments:
            raise self.wrong("no states found")
        orbit = TabulatedOrbit(
            source=self.name,
            epoch=self.epoch,
            origin=self.origins[0],
            segments=tuple(self.segments),
            origins=tuple(self.origins) if len(set(self.origins)) > 1 else (),
        )
        return Oem(object_name=self.object_name, orbit=orbit, covariances=tuple(self.covariances))

    def _meta(self) -> dict[str, str]:
        """Keywords up to META_STOP, checked for what we rely on."""
        meta: dict[str, str] = {}
        for line in self.lines:
            if line == "META_STOP":
                break
            key, equals, value = line.partition("=")
            if not equals:
                raise self.wrong(f'expected KEYWORD = value or META_STOP, got "{line[:40]}"')
            meta[key.strip()] = value.strip()
        else:
            raise self.wrong("META_STOP is missing")
        for key in ("OBJECT_NAME", "CENTER_NAME", "REF_FRAME", "TIME_SYSTEM", "START_TIME", "STOP_TIME"):
            if key not in meta:
                raise self.wrong(f"the metadata lack {key}")
        centre = CENTRES.get(meta["CENTER_NAME"].upper())
        if centre is None:
            raise self.wrong(f"CENTER_NAME {meta['CENTER_NAME']}: one of {', '.join(CENTRES)} is read")
        if meta["REF_FRAME"].upper() not in FRAMES:
            raise self.wrong(f"REF_FRAME {meta['REF_FRAME']}: one of {', '.join(FRAMES)} is read")
        if meta["TIME_SYSTEM"].upper() not in SYSTEMS:
            raise self.wrong(f"TIME_SYSTEM {meta['TIME_SYSTEM']}: one of {', '.join(SYSTEMS)} is read")
        if self.object_name and meta["OBJECT_NAME"] != self.object_name:
            raise self.wrong(f"OBJECT_NAME {meta['OBJECT_NAME']}: another object than {self.object_name}")
        self.object_name = meta["OBJECT_NAME"]
        return meta

    def _time(self, text: str, meta: dict[str, str]) -> Epoch:
        try:
            return read_time(text, meta["TIME_SYSTEM"].upper())
        except InputError as error:
            raise self.wrong(str(error)) from None

    def _seconds(self, text: str, meta: dict[str, str]) -> float:
        """Seconds after the first epoch of the file."""
        moment = self._time(text, meta)
        if self.epoch is None:
            self.epoch = moment
        return moment - self.epoch

    def _numbers(self, words: list[str], allowed: tuple[int, ...]) -> list[float]:
        try:
            values = [float(word) for word in words]
        except ValueError:
            raise self.wrong(f'expected numbers, got "{" ".join(words)[:60]}"') from None
        if len(values) not in allowed or not all(map(math.isfinite, values)):
            expected = f"expected {' or '.join(map(str, allowed))} finite numbers, got {len(values)}"
            raise self.wrong(f"{expected}; the file may be cut short: get it again")
        return values

    def _state(self, line: str, meta: dict[str, str]) -> Iterable[float]:
        words = line.split()
        return (self._seconds(words[0], meta), *self._numbers(words[1:], (6, 9))[:6])

    def _covariance(self, meta: dict[str, str]) -> None:
        """Blocks of an EPOCH, an optional frame and the lower triangle, up to COVARIANCE_STOP."""
        epoch, frame, rows = "", meta.get("REF_FRAME", ""), 0
        matrix = np.zeros((6, 6))
        for line in self.lines:
            key, _, value = (part.strip() for part in line.partition("="))
            if rows and (key in ("EPOCH", "COV_REF_FRAME") or line == "COVARIANCE_STOP"):
                raise self.wrong(f"{line[:40]}: the covariance before it has {rows} rows, not 6")
            if line == "COVARIANCE_STOP":
                return
            if key == "EPOCH":
                # each matrix starts afresh: its axes are those of the states unless it says otherwise
                epoch, frame = value, meta.get("REF_FRAME", "")
            elif key == "COV_REF_FRAME":
                frame = value
            else:
                if not epoch:
                    raise self.wrong("a covariance needs its own EPOCH")
                matrix[rows, : rows + 1] = self._numbers(line.split(), (rows + 1,))
                rows += 1
            if rows == 6 and len(self.covariances) == MOST_COVARIANCES:
                raise self.wrong(f"more than {MOST_COVARIANCES:,} covariances; thin them out")
            if rows == 6:
                full = matrix + np.tril(matrix, -1).T
                self.covariances.append(OemCovariance(epoch=self._time(epoch, meta), frame=frame, covariance=full))
                epoch, rows, matrix = "", 0, np.zeros((6, 6))
        raise self.wrong("COVARIANCE_STOP is missing")

    def _close(self, meta: dict[str, str], numbers: "array[float]") -> None:
        """Turn the rows read so far into a segment."""
        if not meta:
            return
        rows = np.array(numbers).reshape(-1, 7)
        if len(rows) < 2:
            raise self.wrong(f"a segment needs at least two states (got {len(rows)})")
        said = meta.get("INTERPOLATION", "HERMITE").upper()
        method: Method = "hermite" if said == "HERMITE" else "lagrange"
        degree = int(self._numbers([meta.get("INTERPOLATION_DEGREE", "1" if said == "LINEAR" else "7")], (1,))[0])
        if not 1 <= degree <= MOST_DEGREES:
            raise self.wrong(f"INTERPOLATION_DEGREE {degree}: allowed 1 to {MOST_DEGREES}")
        start = meta.get("USEABLE_START_TIME", meta["START_TIME"])
        stop = meta.get("USEABLE_STOP_TIME", meta["STOP_TIME"])
        times = np.ascontiguousarray(rows[:, 0])
        try:
            segment = Segment(
                t_s=times,
                states=np.ascontiguousarray(rows[:, 1:]),
                **usable(self._seconds(start, meta), self._seconds(stop, meta), times),
                method=method,
                window=(degree + 1) // 2 if method == "hermite" else degree + 1,
            )
        except InputError as error:
            raise self.wrong(str(error)) from None
        self.segments.append(segment)
        self.origins.append(CENTRES[meta["CENTER_NAME"].upper()])
