"""The error of a spacecraft's own orbit: one wrong state, the same orbit error in all its exposures."""

from dataclasses import dataclass

import numpy as np

from nebosvod.borders.quantities import bordered_fields
from nebosvod.borders.treatment import Treatment
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris, Rows
from nebosvod.observation.measurement.astrometry import Observation
from nebosvod.observation.spacecraft.kinds import Spacecraft, rtn_axes
from nebosvod.observation.uncertainty.nuisance import AXES, Frame, check_frame, piecewise
from nebosvod.observation.uncertainty.orbit_transition import transitions
from nebosvod.observation.uncertainty.term import Common, Markov, check_treatment, root


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrbitError:
    """The spacecraft's state is wrong at one time, and the error flies on with the orbit.

    Parameters
    ----------
    telescopes : one, or several that ride on the same spacecraft.
    covariance : shape (6, 6) of the state error, km and km/s, in `frame` at `at_s` (for RTN: the axes at that time,
        held fixed in space).
    at_s : when, TDB seconds after the epoch.
    renewal_s : the orbit is determined anew at `at_s` + every multiple of this interval, independently and with the
        same covariance; None = one draw for the whole arc.

    Notes
    -----
    With T = [I 0] Phi(t, start) R: one draw is common parameters, H = H_z T. With renewal the state at the start of
    the interval is a chain that is constant (F = I, Q = 0) until the next interval begins (F = 0, Q = covariance), so
    the cost stays linear in the number of epochs however many intervals there are.
    """

    name: str
    telescopes: tuple[str, ...]
    covariance: Array
    frame: Frame = "rtn"
    at_s: float = 0.0
    renewal_s: float | None = None
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        check_treatment(self.name, self.treatment)
        check_frame(self.name, self.frame)
        covariance = np.array(self.covariance, dtype=np.float64)
        if covariance.shape != (6, 6) or not np.all(np.isfinite(covariance)):
            raise InputError(f"{self.name}: the covariance must be a finite 6 x 6 matrix (got {covariance.shape})")
        if not np.allclose(covariance, covariance.T, rtol=1e-9, atol=0.0):
            raise InputError(f"{self.name}: the covariance is not symmetric")
        root(covariance)
        if self.renewal_s is not None and not self.renewal_s > 0.0:
            raise InputError(f"{self.name}: renewal must be positive (got {self.renewal_s} s)")
        covariance.flags.writeable = False
        object.__setattr__(self, "covariance", covariance)

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Common | Markov:
        """Six common parameters, or a piecewise constant chain of six with renewal."""
        rows = observation.rows(self.telescopes)
        spacecraft = self._spacecraft(observation)
        t_s = observation.t_s[rows]
        interval = np.zeros(rows.size) if self.renewal_s is None else np.floor((t_s - self.at_s) / self.renewal_s)
        start_s = self.at_s + interval * (self.renewal_s or 0.0)
        T = transitions(spacecraft, ephemeris, observation.epoch, start_s, t_s)[:, :3]
        T = T @ self._axes(spacecraft, observation, ephemeris, start_s)
        axes = AXES[self.frame]
        names = tuple(f"{self.name} {part}" for part in (*axes, *(f"{axis} rate" for axis in axes)))
        if self.renewal_s is None:
            displacement = np.zeros((observation.t_s.size, 3, 6))
            displacement[rows] = T
            return Common(
                name=self.name,
                names=names,
                H=observation.H_z @ displacement,
                displacement=displacement,
                covariance=self.covariance,
                mean=np.zeros(6),
                treatment=self.treatment,
            )
        return self._chain(names, rows, observation.H_z[rows] @ T, T, interval.astype(np.int64))

    def _chain(self, names: tuple[str, ...], rows: Rows, H: Array, T: Array, interval: Rows) -> Markov:
        """The state at the start of the interval, constant until the next one."""
        same = piecewise(interval)[:, None, None]
        return Markov(
            name=self.name,
            names=names,
            rows=rows,
            H=H,
            displacement=T,
            F=same * np.eye(6),
            Q=(1.0 - same) * self.covariance,
            P0=self.covariance,
            treatment=self.treatment,
        )

    def _spacecraft(self, observation: Observation) -> Spacecraft:
        """The one spacecraft that carries all the telescopes."""
        carriers = [t.spacecraft for t in observation.telescopes if t.name in self.telescopes]
        if any(carrier is not carriers[0] for carrier in carriers):
            raise InputError(f"{self.name}: {', '.join(self.telescopes)} ride on different spacecraft")
        return carriers[0]

    def _axes(self, spacecraft: Spacecraft, observation: Observation, ephemeris: Ephemeris, start_s: Array) -> Array:
        """R (r, 6, 6) from the frame of the covariance to ICRF, positions and velocities alike."""
        R = np.zeros((start_s.size, 6, 6))
        block = np.broadcast_to(np.eye(3), (start_s.size, 3, 3))
        if self.frame == "rtn":
            starts, back = np.unique(start_s, return_inverse=True)
            state = spacecraft.state_km_km_s(ephemeris, observation.epoch, starts)
            centre = ephemeris.state_km_km_s(spacecraft.centre, observation.epoch, starts)
            block = rtn_axes(state - centre)[back]
        R[:, :3, :3] = block
        R[:, 3:, 3:] = block
        return R
