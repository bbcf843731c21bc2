"""Spacecraft whose states come from a table: interpolation inside segments, errors outside of them."""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from nebosvod.borders.quantities import STATE, bordered
from nebosvod.errors import CoverageError, DataError, InputError
from nebosvod.observation.contracts import Array, Ephemeris, Rows
from nebosvod.observation.spacecraft.interpolation import hermite, lagrange
from nebosvod.timescale import Epoch

Method = Literal["hermite", "lagrange"]
BARYCENTRE = "barycentre"
LATEST_S = 3e11  # ten thousand years
LARGEST = 1e13  # km, a light year; no speed in km/s is so large either
FARTHEST_KM, FASTEST_KM_S = 6.4e9, 3e5  # of a telescope: an object is followed for the light time of 43 au


class TablePiece(Protocol):
    """One span of a table: what it covers, and states (n, 6) at times (n,) inside of it."""

    @property
    def start_s(self) -> float: ...

    @property
    def end_s(self) -> float: ...

    def evaluate(self, t_s: Array) -> Array: ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segment:
    """States over one span, free of manoeuvres.

    Parameters
    ----------
    t_s : shape (k,), ascending, seconds after the table's epoch; states : shape (k, 6), km and km/s, ICRF axes,
        relative to the table's origin.
    start_s, end_s : the usable span; defaults to that of `t_s`.
    method : "hermite" (positions and velocities together) or "lagrange" (each component by itself).
    window : how many points each interpolation uses.

    Raises
    ------
    InputError
        If shapes differ, numbers are not finite, times do not ascend, or the window is below two.
    """

    t_s: Array
    states: Array
    start_s: float
    end_s: float
    method: Method
    window: int

    def __post_init__(self) -> None:
        if self.t_s.ndim != 1 or self.states.shape != (self.t_s.size, 6) or self.t_s.size < 2:
            shapes = f"{self.states.shape} at {self.t_s.shape} times"
            raise InputError(f"table: needs at least two states (k, 6) (got {shapes})")
        if not (np.all(np.isfinite(self.t_s)) and np.all(np.isfinite(self.states))):
            raise InputError("table: a time or a state is not finite")
        check_sizes(self.t_s, self.states, (self.start_s, self.end_s))
        if not np.all(np.diff(self.t_s) > 0.0):
            raise InputError("table: times must ascend strictly")
        if self.window < 2:
            raise InputError(f"table: interpolation needs at least two points (got a window of {self.window})")

    def evaluate(self, t_s: Array) -> Array:
        """States (n, 6) at times inside the span."""
        window = min(self.window, self.t_s.size)
        first = np.searchsorted(self.t_s, t_s, side="right") - (window + 1) // 2
        if window % 2:  # an odd window is centred on the nearest point
            left = np.clip(np.searchsorted(self.t_s, t_s, side="right") - 1, 0, self.t_s.size - 2)
            nearer = t_s - self.t_s[left] > self.t_s[left + 1] - t_s
            first = left + nearer - window // 2
        first = np.clip(first, 0, self.t_s.size - window)
        interpolate = hermite if self.method == "hermite" else lagrange
        found = np.empty((t_s.size, 6))
        # one layout of arrays, one compiled version
        nodes, states, times = (np.require(array, requirements=("C", "W")) for array in (self.t_s, self.states, t_s))
        interpolate(nodes, states, first, window, times, found)
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TabulatedOrbit:
    """A spacecraft known by a table of states.

    Parameters
    ----------
    source : where the table is from, for messages.
    epoch : t = 0 of the segments.
    origin : the body the states are relative to ("earth", "sun", "emb" ...), or "barycentre".
    segments : later ones take precedence where they overlap.
    origins : of each segment by itself, where they differ.
    """

    source: str
    epoch: Epoch
    origin: str
    segments: tuple[TablePiece, ...]
    origins: tuple[str, ...] = ()

    @property
    def centre(self) -> str:
        return central_body(self.origin)

    @bordered()
    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6).

        Raises
        ------
        CoverageError, DataError
            If a time lies in no segment; if a state is none of a spacecraft, as in a damaged file.
        """
        local = t_s + (epoch - self.epoch)
        which = self._choose(local)
        states = np.empty((local.size, 6))
        for number in np.unique(which):
            mine = which == number
            with np.errstate(over="ignore", invalid="ignore"):
                states[mine] = self.segments[number].evaluate(local[mine])
            require_plausible(self.source, states[mine])
            origin = self.origins[number] if self.origins else self.origin
            if origin != BARYCENTRE:
                states[mine] += ephemeris.state_km_km_s(origin, epoch, t_s[mine])
        return states

    def _choose(self, local: Array) -> Rows:
        """Number of the segment for each time; times may stick out by 1 us, the grain of decades in seconds."""
        which = np.full(local.size, -1)
        for number, segment in enumerate(self.segments):
            which[(local >= segment.start_s - 1e-6) & (local <= segment.end_s + 1e-6)] = number
        if np.any(which < 0):
            lost = self.epoch + float(local[np.argmax(which < 0)])
            spans = "; ".join(
                f"{(self.epoch + s.start_s).iso(digits=0)} to {(self.epoch + s.end_s).iso(digits=0)}"
                for s in self.segments[:5]
            )
            raise CoverageError(f"{self.source}: no state at {lost.iso(digits=0)} (covers {spans})")
        return which


def require_plausible(source: str, states: Array) -> None:
    """Raise DataError, with the file, if a state (n, 6) about the table's origin is none that a telescope can have."""
    with np.errstate(over="ignore", invalid="ignore"):
        distance, speed = (np.linalg.norm(states[:, part], axis=1) for part in (slice(3), slice(3, 6)))
    wrong = ~((distance < FARTHEST_KM) & (speed < FASTEST_KM_S))
    if np.any(wrong):
        k = int(np.argmax(wrong))
        text = f"a state of {distance[k]:.3g} km and {speed[k]:.3g} km/s"
        raise DataError(
            f"{source}: {text}, which no telescope has (allowed up to {FARTHEST_KM:g} km, {FASTEST_KM_S:g} km/s); "
            "the file is damaged, copy it again"
        )


def usable(start_s: float, end_s: float, t_s: Array) -> dict[str, float]:
    """The span a file claims, without what its states do not reach: nothing is extrapolated.

    Raises
    ------
    InputError
        If nothing is left.
    """
    if not t_s.size:
        raise InputError("table: has no times")
    first, last = max(start_s, float(t_s[0])), min(end_s, float(t_s[-1]))
    if not first <= last:
        raise InputError(f"table: claims {start_s:.9g} to {end_s:.9g} s, its states {t_s[0]:.9g} to {t_s[-1]:.9g} s")
    return {"start_s": first, "end_s": last}


def check_sizes(t_s: Array, numbers: Array, span_s: tuple[float, float]) -> None:
    """Refuse times and numbers that no spacecraft has, such as those of a damaged file."""
    if not all(abs(t) < LATEST_S for t in (float(np.abs(t_s).max(initial=0.0)), *span_s)):
        raise InputError("table: a time is more than ten thousand years away")
    if not np.abs(numbers).max(initial=0.0) < LARGEST:
        raise InputError(f"table: a number is larger than {LARGEST:g} km or km/s")


@bordered(states=STATE)
def table(
    epoch: Epoch, t_s: Array, states: Array, origin: str, source: str = "table", window: int = 8
) -> TabulatedOrbit:
    """An orbit from states (k, 6), km and km/s, ICRF axes about `origin`, at `t_s` (k,) TDB seconds after `epoch`."""
    t_s, states = np.asarray(t_s, dtype=np.float64), np.asarray(states, dtype=np.float64)
    if t_s.size < 2:
        raise InputError(f"{source}: needs at least two states (got {t_s.size})")
    segment = Segment(
        t_s=t_s, states=states, start_s=float(t_s[0]), end_s=float(t_s[-1]), method="hermite", window=window
    )
    return TabulatedOrbit(source=source, epoch=epoch, origin=origin, segments=(segment,))


def central_body(origin: str) -> str:
    """The body about which a spacecraft that is tabulated from `origin` has its RTN axes."""
    return {BARYCENTRE: "sun", "emb": "earth"}.get(origin, origin)
