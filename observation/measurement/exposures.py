"""Exposures: when, by which telescope, from where, and how well. One table, whoever made the schedule or the records.

Observers do not move while an orbit is fitted, so their states are computed once, and one pass of the compiled loops
serves the exposures of all telescopes together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import CoverageError, InputError
from nebosvod.observation.contracts import Array, Ephemeris, Flags, Rows
from nebosvod.observation.measurement.direction import residual
from nebosvod.observation.measurement.telescope import Telescope
from nebosvod.timescale import Epoch

BACK_S = 60.0  # over which the Sun's acceleration is a difference of its velocities


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exposures:
    """A table of n exposures.

    Attributes
    ----------
    epoch : from which times count.
    telescopes, telescope_index : the telescopes, and for each exposure (n,) which one of them makes it.
    t_s : (n,) reception times, TDB seconds after `epoch`.
    observer : (n, 6) barycentric ICRF state of the telescope at reception, km and km/s.
    sun, sun_pull : (n, 6) and (n, 3) the Sun's barycentric state at reception, and its acceleration, km/s^2.
    gm_sun_km3_s2 : its gravitational parameter.
    sigma_rad : (n, 2) of RA cos Dec and Dec; correlation : (n,) of the two.
    timing_sigma_s : (n,) of the time of each exposure by itself.
    image : (n, 2, 2) what the image adds to the covariance of the noise, rad^2; None where that is nothing.
    """

    epoch: Epoch
    telescopes: tuple[Telescope, ...]
    telescope_index: Rows
    t_s: Array
    observer: Array
    sun: Array
    sun_pull: Array
    gm_sun_km3_s2: float
    sigma_rad: Array
    correlation: Array
    timing_sigma_s: Array
    image: Array | None = None

    @classmethod
    def at(
        cls,
        epoch: Epoch,
        t_s: npt.ArrayLike,
        observer: Array,
        ephemeris: Ephemeris,
        *,
        telescopes: tuple[Telescope, ...] = (),
        telescope_index: Rows | None = None,
        sigma_rad: Array | float = 1.0,
        correlation: Array | float = 0.0,
        timing_sigma_s: Array | float = 0.0,
    ) -> "Exposures":
        """Exposures at places that are known.

        Parameters
        ----------
        t_s : shape (n,), TDB seconds after `epoch`, in any order.
        observer : shape (n, 6), barycentric ICRF, km and km/s.

        Raises
        ------
        InputError
            If the times are no vector of finite numbers.
        CoverageError
            If the ephemeris does not cover a time.
        """
        times = reception_times(t_s)
        sun = own(ephemeris.state_km_km_s("sun", epoch, times))
        n = times.size
        return cls(
            epoch=epoch,
            telescopes=telescopes,
            telescope_index=np.zeros(n, dtype=np.int64) if telescope_index is None else telescope_index,
            t_s=times,
            observer=own(observer),
            sun=sun,
            sun_pull=_sun_pull(sun, times, epoch, ephemeris),
            gm_sun_km3_s2=ephemeris.gm_km3_s2["sun"],
            sigma_rad=np.broadcast_to(np.asarray(sigma_rad, dtype=np.float64), (n, 2)),
            correlation=np.broadcast_to(np.asarray(correlation, dtype=np.float64), (n,)),
            timing_sigma_s=np.broadcast_to(np.asarray(timing_sigma_s, dtype=np.float64), (n,)),
        )

    @classmethod
    def of(cls, epoch: Epoch, planned: Sequence[tuple[Telescope, Array]], ephemeris: Ephemeris) -> "Exposures":
        """The exposures of some telescopes at times (k,) of each, in the order of time and then of telescope.

        Raises
        ------
        InputError, CoverageError
            As `at`; also if there is no telescope, or two have one name.
        """
        telescopes = tuple(telescope for telescope, _ in planned)
        require_distinct(telescopes)
        times = [reception_times(t_s) for _, t_s in planned]
        index = np.repeat(np.arange(len(times)), [own_times.size for own_times in times])
        t_s = np.concatenate(times)
        order = row_order(t_s, index)
        observer = np.empty((t_s.size, 6))
        place = np.empty_like(order)
        place[order] = np.arange(order.size)
        for telescope, own_times, rows in zip(telescopes, times, np.split(place, np.cumsum([t.size for t in times]))):
            observer[rows] = telescope.spacecraft.state_km_km_s(ephemeris, epoch, own_times)
        index = index[order]
        return cls.at(
            epoch,
            t_s[order],
            observer,
            ephemeris,
            telescopes=telescopes,
            telescope_index=index,
            sigma_rad=np.array([telescope.sigma_rad for telescope in telescopes])[index],
            timing_sigma_s=np.array([telescope.timing_sigma_s for telescope in telescopes])[index],
        )

    def __len__(self) -> int:
        """Number of exposures."""
        return len(self.t_s)

    def by(self, telescopes: Sequence[Telescope]) -> "Exposures":
        """The same times and places by telescopes that differ in how well they measure alone."""
        index = self.telescope_index
        return replace(
            self,
            telescopes=tuple(telescopes),
            sigma_rad=np.array([telescope.sigma_rad for telescope in telescopes])[index],
            timing_sigma_s=np.array([telescope.timing_sigma_s for telescope in telescopes], dtype=np.float64)[index],
        )

    def rows(self, telescopes: Sequence[str]) -> Rows:
        """Row numbers, in order, of the exposures by the named telescopes; InputError if one makes none."""
        return rows_of(telescopes, self.telescopes, self.telescope_index)

    def select(self, chosen: Rows | Flags | slice) -> "Exposures":
        """These exposures alone; telescopes keep their numbers."""
        rows = {name: getattr(self, name)[chosen] for name in ROW_FIELDS}
        return replace(self, **rows, image=None if self.image is None else self.image[chosen])

    def seeing(self) -> "Exposures":
        """The same with those telescopes alone that make any."""
        used = np.unique(self.telescope_index)
        if used.size == len(self.telescopes):
            return self
        telescopes = tuple(self.telescopes[number] for number in used)
        return replace(self, telescopes=telescopes, telescope_index=np.searchsorted(used, self.telescope_index))

    def counted_from(self, epoch: Epoch) -> "Exposures":
        """The same with times counted from another epoch."""
        return replace(self, epoch=epoch, t_s=self.t_s + (self.epoch - epoch))

    def noise(self, rate_rad_s: Array | None = None) -> Array:
        """Covariance R (n, 2, 2), rad^2, of the measurement noise at apparent rates (n, 2), RA cos Dec and Dec.

        R = sigma and correlation + what the image adds + sigma_t^2 rate rate^T: a clock error moves along the track.
        """
        return self._noise(self.sigma_rad, self.timing_sigma_s, rate_rad_s)

    def true_noise(self, rate_rad_s: Array | None = None) -> Array | None:
        """What that covariance (n, 2, 2) really is; None where it is as assumed."""
        truths = [telescope.truth for telescope in self.telescopes]
        if not any(truths):
            return None
        sigma, timing = np.array(self.sigma_rad), np.array(self.timing_sigma_s)
        for number, truth in enumerate(truths):
            if truth is not None:
                mine = self.telescope_index == number
                sigma[mine], timing[mine] = truth.sigma_rad, truth.timing_sigma_s
        return self._noise(sigma, timing, rate_rad_s)

    @property
    def noise_mean(self) -> Array | None:
        """What the noise really is on average (n, 2), rad; None where it is 0."""
        means = np.array([np.zeros(2) if t.truth is None else t.truth.mean_rad for t in self.telescopes])
        return means[self.telescope_index] if means.any() else None

    def _noise(self, sigma_rad: Array, timing_sigma_s: Array, rate_rad_s: Array | None) -> Array:
        R = np.empty((len(self), 2, 2))
        R[:, 0, 0], R[:, 1, 1] = sigma_rad[:, 0] ** 2, sigma_rad[:, 1] ** 2
        R[:, 0, 1] = R[:, 1, 0] = self.correlation * sigma_rad[:, 0] * sigma_rad[:, 1]
        if self.image is not None:
            R += self.image
        if rate_rad_s is not None and timing_sigma_s.any():
            R += timing_sigma_s[:, None, None] ** 2 * rate_rad_s[:, :, None] * rate_rad_s[:, None, :]
        return R


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sky:
    """Exposures and the directions measured in them, with their weights.

    Attributes
    ----------
    exposures : in any order.
    observed : (n, 2) RA and Dec, rad, star-catalogue errors already removed.
    R : (n, 2, 2) covariance of RA cos Dec and Dec by which a direction is weighed, rad^2.
    whitener : (n, 2, 2) lower triangular W with W R W^T = I.
    """

    exposures: Exposures
    observed: Array
    R: Array
    whitener: Array

    @classmethod
    def of(cls, epoch: Epoch, t_s: Array, observed: Array, R: Array, observer: Array, ephemeris: Ephemeris) -> "Sky":
        """Directions observed (n, 2) with weights R (n, 2, 2) at times (n,) from places (n, 6), by nobody.

        Raises
        ------
        InputError
            If a noise covariance is not positive definite.
        """
        return cls.measured(Exposures.at(epoch, t_s, observer, ephemeris), observed, R)

    @classmethod
    def measured(cls, exposures: Exposures, observed: Array, R: Array) -> "Sky":
        """The directions measured in some exposures; raises as `of`."""
        return cls(exposures=exposures, observed=observed, R=R, whitener=whiteners(R))

    @property
    def epoch(self) -> Epoch:
        """From which times count, and at which a fitted state is meant."""
        return self.exposures.epoch

    @property
    def t_s(self) -> Array:
        """Reception times (n,), TDB seconds after `epoch`."""
        return self.exposures.t_s

    def __len__(self) -> int:
        """Number of observations."""
        return len(self.exposures)

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last reception."""
        return float(self.t_s.min()), float(self.t_s.max())

    def residual(self, computed: Array) -> Array:
        """Observed minus computed directions psi (n, 2) as (wrapped dRA cos Dec, dDec), rad."""
        return residual(self.observed, computed)

    def select(self, chosen: Rows | Flags) -> "Sky":
        """The sky of these observations alone."""
        return Sky(
            exposures=self.exposures.select(chosen),
            observed=self.observed[chosen],
            R=self.R[chosen],
            whitener=self.whitener[chosen],
        )

    def weighed(self, R: Array) -> "Sky":
        """The same with other weights (n, 2, 2)."""
        return replace(self, R=R, whitener=whiteners(R))


ROW_FIELDS = (
    "telescope_index", "t_s", "observer", "sun", "sun_pull", "sigma_rad", "correlation", "timing_sigma_s",
)  # fmt: skip


def row_order(t_s: Array, telescope_index: Rows) -> Rows:
    """The one order of rows (n,): by time, then by telescope."""
    return np.lexsort((telescope_index, t_s))


def rows_of(named: Sequence[str], telescopes: Sequence[Telescope], telescope_index: Rows) -> Rows:
    """Row numbers, in order, of the named telescopes, from the number of the telescope of each row (n,).

    Raises
    ------
    InputError
        If a name is not among the telescopes.
    """
    known = [telescope.name for telescope in telescopes]
    for name in named:
        if name not in known:
            raise InputError(f'telescope "{name}" made no measurement here (there are: {", ".join(known)})')
    return np.flatnonzero(np.isin(telescope_index, [known.index(name) for name in named]))


def require_distinct(telescopes: Sequence[Telescope]) -> None:
    """Refuse no telescope at all, and two of one name."""
    if not telescopes:
        raise InputError("no telescope, so nothing to observe")
    names = [telescope.name for telescope in telescopes]
    if len(set(names)) < len(names):
        raise InputError(f"two telescopes have one name ({', '.join(sorted(names))})")


def reception_times(t_s: npt.ArrayLike) -> Array:
    """A copy of the times as a contiguous vector (n,).

    Raises
    ------
    InputError
        If they are no vector, empty, or not finite.
    """
    times = np.array(t_s, dtype=np.float64)
    if times.ndim != 1 or times.size == 0 or not np.all(np.isfinite(times)):
        raise InputError(f"sight: reception times must be a non-empty vector of finite numbers (shape {times.shape})")
    return times


def own(values: Array) -> Array:
    """Values as the compiled loops want them, C-contiguous and writable: copied only if they are not."""
    return np.require(values, dtype=np.float64, requirements=("C", "W"))


def _sun_pull(sun: Array, t_s: Array, epoch: Epoch, ephemeris: Ephemeris) -> Array:
    """The Sun's barycentric acceleration (n, 3), km/s^2: with it, it is carried over a light time to a micrometre."""
    try:
        before, back = ephemeris.state_km_km_s("sun", epoch, t_s - BACK_S), BACK_S
    except CoverageError:  # the first minute of the ephemeris
        before, back = ephemeris.state_km_km_s("sun", epoch, t_s + BACK_S), -BACK_S
    return own((sun[:, 3:] - before[:, 3:]) / back)


def whiteners(R: Array) -> Array:
    """Inverse Cholesky factors (n, 2, 2) of covariances (n, 2, 2); InputError if one is not positive definite."""
    a = np.sqrt(R[:, 0, 0])
    b = R[:, 1, 0] / a
    rest = R[:, 1, 1] - b * b
    if not (np.isfinite(a).all() and (rest > 0.0).all()):
        worst = int(np.flatnonzero(~(np.isfinite(a) & (rest > 0.0)))[0])
        raise InputError(f"weights: the noise covariance of observation {worst} is not positive definite")
    c = np.sqrt(rest)
    W = np.zeros_like(R)
    W[:, 0, 0], W[:, 1, 1], W[:, 1, 0] = 1.0 / a, 1.0 / c, -b / (a * c)
    return W
