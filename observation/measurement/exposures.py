"""The observed sky as arrays, and what an orbit says of it: computed directions with their partials.

The observers do not move while an orbit is fitted, so their states are computed once, and one pass of the compiled
loops serves the observations of all stations together.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, Trajectory
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Flags, Rows
from nebosvod.observation.measurement import rows
from nebosvod.observation.measurement.direction import residual
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
# A light time this close is corrected to first order: even a fall of 10 m/s^2 close to the Earth then adds 5 cm.
NEAR_S = 0.1
SETTLED_S = 1e-9
ROUNDS = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sky:
    """Observations of one object by any number of stations, in any order.

    Attributes
    ----------
    epoch : from which times count, and at which the fitted state is meant.
    t_s : (n,) reception times, TDB seconds after `epoch`.
    observed : (n, 2) RA and Dec, rad, star-catalogue errors already removed.
    R : (n, 2, 2) noise covariance of RA cos Dec and Dec, rad^2.
    whitener : (n, 2, 2) lower triangular W with W R W^T = I.
    observer : (n, 6) barycentric ICRF state of the observer at reception.
    sun : (n, 6) barycentric ICRF state of the Sun at reception.
    """

    epoch: Epoch
    t_s: Array
    observed: Array
    R: Array
    whitener: Array
    observer: Array
    sun: Array

    @classmethod
    def of(cls, epoch: Epoch, t_s: Array, observed: Array, R: Array, observer: Array, ephemeris: Ephemeris) -> "Sky":
        """The sky of these observations.

        Raises
        ------
        InputError
            If a noise covariance is not positive definite.
        """
        return cls(
            epoch=epoch,
            t_s=np.ascontiguousarray(t_s, dtype=np.float64),
            observed=observed,
            R=R,
            whitener=_whitener(R),
            observer=np.require(observer, dtype=np.float64, requirements=("C", "W")),
            sun=np.require(ephemeris.state_km_km_s("sun", epoch, t_s), dtype=np.float64, requirements=("C", "W")),
        )

    def __len__(self) -> int:
        """Number of observations."""
        return len(self.t_s)

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last reception."""
        return float(self.t_s.min()), float(self.t_s.max())

    def select(self, chosen: Rows | Flags) -> "Sky":
        """The sky of these observations alone."""

        def part(values: Array) -> Array:
            return np.ascontiguousarray(values[chosen])

        return replace(
            self,
            t_s=part(self.t_s),
            observed=part(self.observed),
            R=part(self.R),
            whitener=part(self.whitener),
            observer=part(self.observer),
            sun=part(self.sun),
        )

    def counted_from(self, epoch: Epoch) -> "Sky":
        """The same with times counted from another epoch."""
        return replace(self, epoch=epoch, t_s=self.t_s + (self.epoch - epoch))

    def weighed(self, R: Array) -> "Sky":
        """The same with another noise covariance (n, 2, 2)."""
        return replace(self, R=R, whitener=_whitener(R))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Look:
    """What an orbit says of a sky; arrays have the observation on the first axis.

    Attributes
    ----------
    tau : (n,) light times, s.
    psi : (n, 2) computed RA in [0, 2 pi) and Dec, astrometric ICRF, rad.
    residual : (n, 2) observed minus computed, (wrapped dRA cos Dec, dDec), rad.
    H : (n, 2, 6 + m) partials by the state at the epoch (km, km/s) and the dynamic parameters.
    lines : what else was computed on the way: barycentric target (n, 6) at emission, u (n, 3), distance (n,), DL, H_x,
        H_z, Phi and zeta of the position at emission, as in `observation.astrometry.Observation`.
    """

    tau: Array
    psi: Array
    residual: Array
    H: Array
    lines: Mapping[str, Array]

    @property
    def rate(self) -> Array:
        """Apparent motion (n, 2) in RA cos Dec and Dec, rad/s."""
        motion = np.empty_like(self.psi)
        rows.apparent_rates(self.lines["DL"], self.lines["target"], self.lines["observer"], motion)
        return motion

    @property
    def distance_km(self) -> Array:
        """From the observer to the object (n,)."""
        return self.lines["distance"]


def look(trajectory: Trajectory, sky: Sky, tau: Array | None = None) -> Look:
    """Compute the directions of all observations from one trajectory, with their partials.

    Parameters
    ----------
    trajectory : with sensitivities, `trajectory.epoch` that of the sky.
    tau : light times (n,) of a near orbit, such as those of the last iteration.

    Raises
    ------
    InputError
        If the light time does not settle in ten rounds.
    CoverageError
        If an emission time lies outside the trajectory.

    Notes
    -----
    The formulas are those of `observation.astrometry.observe`, in the same compiled loops. The Sun is carried from
    reception to emission along its velocity: its acceleration moves it by less than a millimetre a light time of 500 s.
    """
    lines = _lines(trajectory, sky, tau)
    n = len(sky)
    DL, H_x, H_z = np.empty((n, 2, 3)), np.empty((n, 2, 6)), np.empty((n, 2, 3))
    m = len(trajectory.parameter_names)
    Phi, zeta, H_x0, H_c = np.empty((n, 3, 6)), np.empty((n, 3, m)), np.empty((n, 2, 6)), np.empty((n, 2, m))
    rows.sky_partials(lines["target"], lines["u"], lines["distance"], DL)
    rows.emission_partials(lines.pop("variations"), np.array(trajectory._chain), Phi, zeta)
    rows.measurement_partials(
        trajectory.forces.ephemeris.gm_km3_s2["sun"], DL, lines["heliocentric"], lines["tau"],
        Phi, zeta, H_x, H_x0, H_z, H_c,
    )  # fmt: skip
    return Look(
        tau=lines["tau"],
        psi=lines["psi"],
        residual=residual(sky.observed, lines["psi"]),
        H=np.concatenate([H_x0, H_c], axis=2) if m else H_x0,
        lines=lines | {"observer": sky.observer, "DL": DL, "H_x": H_x, "H_z": H_z, "Phi": Phi, "zeta": zeta},
    )


def _lines(trajectory: Trajectory, sky: Sky, tau: Array | None) -> dict[str, Array]:
    """Solve the light time: lines of sight and the variations at emission, by name."""
    n, table = len(sky), trajectory._table
    sun = sky.sun.copy()
    step, distance, light_time = np.empty((3, n))
    target, u, psi = np.empty((n, 6)), np.empty((n, 3)), np.empty((n, 2))
    if tau is None:
        tau = np.empty(n)
        gm_sun = trajectory.forces.ephemeris.gm_km3_s2["sun"]
        rows.first_light_times(gm_sun, trajectory.state_at(sky.t_s), sun, sky.observer, tau)
    for _ in range(ROUNDS):
        emission = sky.t_s - tau
        _require(trajectory, emission)
        heliocentric, variations = table.evaluate(emission, variations=True)
        largest = NEAR_S
        while largest >= SETTLED_S:
            sun[:, :3] = sky.sun[:, :3] - sky.sun[:, 3:] * tau[:, None]
            largest = rows.lines_of_sight(
                tau, heliocentric, sun, sky.observer, step, target, u, distance, light_time, psi
            )
            if not largest < NEAR_S:
                break
            heliocentric[:, :3] -= heliocentric[:, 3:] * step[:, None]
            tau = tau + step
        if largest < SETTLED_S:
            return {
                "tau": light_time, "heliocentric": heliocentric, "variations": variations, "target": target, "u": u,
                "distance": distance, "psi": psi,
            }  # fmt: skip
        tau = tau + step
    raise InputError(f"light time did not settle in {ROUNDS} rounds (last step {np.max(np.abs(step)):.3g} s)")


def _require(trajectory: Trajectory, emission: Array) -> None:
    """Raise CoverageError (by the trajectory) unless it holds all emission times."""
    first, last = trajectory.span_s
    if not (first <= emission.min() and emission.max() <= last):
        trajectory.state_at(emission)


def _whitener(R: Array) -> Array:
    """Inverse Cholesky factors (n, 2, 2) of covariances (n, 2, 2)."""
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
