"""The target at emission: states for the light time, and then the partials that belong to the last of them."""

import numpy as np

from nebosvod.dynamics.trajectory import Trajectory as Integrated
from nebosvod.observation.contracts import Array, Trajectory
from nebosvod.observation.measurement import rows


class Emission:
    """Answers with states, and afterwards with the partials at the times it was asked for last.

    An integrated trajectory gives both in one pass over its dense output, so that the evaluation that confirms the
    light time is the one that gives the partials; any other trajectory is asked twice.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        self._integrated: Integrated | None = None
        self._chain = np.empty((0, 0))
        if isinstance(trajectory, Integrated) and trajectory.sensitivities:
            self._integrated, self._chain = trajectory, trajectory.chain
        self._times, self._variations = np.empty(0), np.empty((0, 6, 6))

    def state_at(self, t_s: Array) -> Array:
        """Heliocentric states (n, 6) at emission times.

        Raises
        ------
        CoverageError
            If a time lies outside the trajectory (raised by it).
        """
        self._times = t_s
        if self._integrated is None:
            return self.trajectory.state_at(t_s)
        state, self._variations = self._integrated.variations_at(t_s)
        return state

    def partials(self, Phi: Array, zeta: Array) -> None:
        """Fill Phi (n, 3, 6) and zeta (n, 3, m): position by the state at the epoch and the dynamic parameters.

        Raises
        ------
        InputError
            If the trajectory has no partials (raised by it).
        """
        if self._integrated is None:
            moved = self.trajectory.at(self._times)
            Phi[...], zeta[...] = moved.Phi[:, :3], moved.zeta[:, :3]
        else:
            rows.emission_partials(self._variations, self._chain, Phi, zeta)
