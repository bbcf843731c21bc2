"""Spacecraft from SPK files: types 2 and 3 through jplephem, 9 and 13 by a reader of our own."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jplephem.daf import DAF
from jplephem.spk import SPK

from nebosvod.errors import CoverageError, DataError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.tabulated import BARYCENTRE, Segment, TabulatedOrbit, central_body
from nebosvod.timescale import Epoch

J2000 = Epoch.from_jd(2451545.0)
FRAME_J2000 = 1
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

    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6).

        Raises
        ------
        CoverageError
            If a time lies in no segment.
        """
        states = np.full((t_s.size, 6), np.nan)
        day = (epoch.fraction * 86400.0 + t_s) / 86400.0
        with SPK.open(self.path) as kernel:
            for segment in kernel.segments:
                if segment.target != self.target:
                    continue
                inside = (day >= segment.start_jd - epoch.day) & (day <= segment.end_jd - epoch.day)
                if np.any(inside):
                    place, per_day = segment.compute_and_differentiate(epoch.day, day[inside])
                    states[inside, :3] = place[:3].T
                    # a type 3 segment carries its own velocity in the last three components, km/s
                    states[inside, 3:] = place[3:].T if place.shape[0] == 6 else per_day.T / 86400.0
        if np.any(np.isnan(states)):
            lost = epoch + float(t_s[np.argmax(np.isnan(states[:, 0]))])
            raise CoverageError(f"{self.source}: no state at {lost.iso(digits=0)}")
        if self.origin == BARYCENTRE:
            return states
        return states + ephemeris.state_km_km_s(self.origin, epoch, t_s)


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
        with path.open("rb") as stream:
            daf = DAF(stream)
            return _read(path, daf, target)
    except (OSError, ValueError, IndexError) as error:
        raise DataError(f"{path}: cannot be read as an SPK file ({error})") from None


def _read(path: Path, daf: DAF, target: int | None) -> ChebyshevOrbit | TabulatedOrbit:
    """Pick the summaries of the target and build its orbit."""
    summaries = [values for _, values in daf.summaries()]
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
    if kinds <= {2, 3}:
        return ChebyshevOrbit(source=path.name, origin=origin, path=path, target=target)
    if len(kinds) != 1 or not kinds <= {9, 13}:
        raise DataError(f"{path}: target {target} is of SPK type {sorted(kinds)}; types 2, 3, 9 and 13 are read")
    segments = tuple(_segment(daf, values, kinds) for values in mine)
    return TabulatedOrbit(source=path.name, epoch=J2000, origin=origin, segments=segments)


def _segment(daf: DAF, values: tuple[float, ...], kinds: set[int]) -> Segment:
    """Types 9 and 13: N states, N epochs, a directory, window size less one, N (NAIF SPK Required Reading)."""
    first, last = int(values[6]), int(values[7])
    window, count = (int(number) for number in daf.read_array(last - 1, last))
    states = daf.read_array(first, first + 6 * count - 1).reshape(count, 6)
    times = daf.read_array(first + 6 * count, first + 7 * count - 1)
    return Segment(
        t_s=np.array(times, dtype=np.float64),
        states=np.array(states, dtype=np.float64),
        start_s=float(values[0]),
        end_s=float(values[1]),
        method="hermite" if 13 in kinds else "lagrange",
        window=window + 1,
    )
