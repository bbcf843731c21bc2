"""The line of variations of a fit, where its observations are at hand: constrained differential corrections.

From the estimate the orbit is moved in small steps along a weak direction, and each time corrected to the observations
in the hyperplane across it, whose place is held by a row of prior knowledge much sharper than they are. So chi squared
is the least there, its gradient is parallel to the direction, and the line is as curved as they want it.

References
----------
Milani 1999, Icarus 137, 269; Milani, Sansaturio, Tommei, Arratia, Chesley 2005, Astronomy & Astrophysics 431, 729.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import CoverageError, EventError, InputError
from nebosvod.estimation import Status
from nebosvod.fits.correction import Correction, Knowledge, correct
from nebosvod.fits.engine import OrbitFit, knowledge
from nebosvod.impacts.string import String
from nebosvod.orbits.uncertain import UncertainOrbit

Array = npt.NDArray[np.float64]
STEP, REACH = 0.25, 9.0  # sigmas along the direction
HELD = 1e-4  # sigmas, of the place of the hyperplane
TOLERANCE = 1e-5  # of a sigma
SAME = 0.02  # sigmas and parts of them, between the covariance of the orbit and that of its observations


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Variations:
    """What the observations of an orbit say aside of it.

    Parameters
    ----------
    fit : of the observations. orbit : the same, whose covariance tells what a sigma is.

    Raises
    ------
    InputError
        If the covariance of the orbit is not that of the weighed observations: chi squared does not tell its sigmas.
    """

    fit: OrbitFit
    orbit: UncertainOrbit

    def __post_init__(self) -> None:
        lean, factor = self.fit.lean.correction, self.orbit.factor
        if lean.S is None or lean.status is not Status.CONVERGED:
            raise InputError("the correction to the observations has not converged")
        if lean.trajectory.parameter_names != self.orbit.parameter_names:
            raise InputError("parameters of the forces are uncertain that are not corrected")
        apart = np.linalg.solve(factor, lean.state - self.orbit.state)
        size = np.linalg.svd(np.linalg.solve(factor, lean.S), compute_uv=False)
        if self.fit.epoch != self.orbit.epoch or np.abs(apart).max() > SAME or np.abs(size - 1.0).max() > SAME:
            raise InputError("the covariance holds errors that are not in the weights of the observations")

    def along(self, direction: Array) -> String:
        """The line along a unit vector (n,) of whitened deviations.

        It ends 9 sigmas from the estimate, or where no orbit is found that fits best, or chi squared rises no more.
        """
        least = self._corrected(self.fit.lean.correction, np.zeros(len(direction)), None)
        origin = self._white(least)
        sides = [self._side(least, origin, sign * direction) for sign in (-1.0, 1.0)]
        sigmas = np.concatenate([-sides[0][0][::-1], [0.0], sides[1][0]])
        points = np.concatenate([sides[0][1][::-1], [origin], sides[1][1]])
        if len(sides[0][0]) < 2 or len(sides[1][0]) < 2:
            raise InputError("constrained corrections do not lead away from the estimate")
        return String(direction=direction, sigmas=sigmas, points=points)

    def _side(self, least: Correction, origin: Array, direction: Array) -> tuple[Array, Array]:
        """Sigmas (k,) and whitened deviations (k, n) of one side, outwards."""
        sigmas, points, here = [0.0], [origin], least
        for s in np.arange(STEP, REACH + 0.5 * STEP, STEP) + direction @ origin:
            before = points[-2] if len(points) > 1 else points[-1] - STEP * direction
            across = np.asarray(np.linalg.solve(self.orbit.factor.T, direction)[None] / HELD, dtype=np.float64)
            row = Knowledge(
                U=across,
                mean=least.x + self.orbit.factor @ (s * direction - origin),
            )
            try:
                here = self._corrected(here, 2.0 * points[-1] - before - self._white(here), row)
            except (CoverageError, EventError, InputError):
                break
            held = float((row.U @ (here.x - row.mean))[0]) ** 2
            sigma = float(np.sqrt(max(here.cost - held - least.cost, 0.0)))
            if here.status is not Status.CONVERGED or sigma <= sigmas[-1]:
                break
            sigmas.append(sigma)
            points.append(self._white(here))
        return np.array(sigmas[1:]), np.array(points[1:]).reshape(-1, len(direction))

    def _corrected(self, near: Correction, step: Array, row: Knowledge | None) -> Correction:
        """Corrected to the observations from a whitened step (n,) beside an orbit, held by a row where there is one."""
        prior = knowledge(self.fit.priors, self.orbit.parameter_names)
        if row is not None:
            prior = row if prior is None else row.beside(prior)
        lean, sky = self.fit.lean, self.fit.found.sky
        return correct(
            sky, near.x + self.orbit.factor @ step, self.fit.general.scene.forces, selected=lean.selected, prior=prior,
            near=near, tolerance=TOLERANCE,
        )  # fmt: skip

    def _white(self, one: Correction) -> Array:
        """Whitened deviation (n,) from the orbit."""
        values = [self.orbit.parameters[name] for name in self.orbit.parameter_names]
        found: Array = np.linalg.solve(self.orbit.factor, one.x - np.concatenate([self.orbit.state, values]))
        return found
