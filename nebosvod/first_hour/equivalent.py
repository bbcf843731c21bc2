"""The posterior as one linear measurement of the state, which next night's filter takes and goes on.

The moments of the drawn orbits stand for the block: mean and covariance of the six coordinates, in which the posterior
is nearly normal where the range is known; the state follows by the partials of the coordinates.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.estimation.filters.kalman import Belief
from nebosvod.first_hour.conditional import Conditional
from nebosvod.first_hour.grid import HEADLINE, Grid

Array = npt.NDArray[np.float64]
STEP = 1e-6


def block(grid: Grid, prior: str = HEADLINE) -> Belief:
    """Mean and covariance of the six coordinates, by moments: the spread of the nodes and what is normal in each.

    In the notation of Stepanov: x = (ln range, range rate), and the attributable the linear rest.
    """
    w, nodes = grid.weight(prior), grid.nodes
    mean = w @ nodes.coordinates
    spread = np.sqrt(w)[:, None] * (nodes.coordinates - mean)
    used = np.flatnonzero(w > 1e-12)
    p = nodes.factor.shape[1]
    inverse = np.linalg.solve(nodes.factor[used], np.broadcast_to(np.eye(p), (len(used), p, p)))
    within = np.einsum("m,mij,mkj->ik", w[used], inverse[:, -4:], inverse[:, -4:])
    inner = np.zeros((6, 6))
    inner[2:, 2:] = within
    return Belief.of(mean, spread.T @ spread + inner)


def wide(posterior: Belief, times: float = 1e4) -> Belief:
    """A prior that says next to nothing beside the posterior: the same mean, sigmas so many times as large."""
    return Belief.of(posterior.mean, times**2 * np.diag(np.sum(posterior.factor**2, axis=1)))


def state_partials(conditional: Conditional, coordinates: Array) -> tuple[Array, Array]:
    """State (6,) of coordinates (6,), km and km/s, and its partials (6, 6), by central differences."""
    steps = np.array([STEP, max(1e-3, abs(coordinates[1]) * STEP), STEP, STEP, *([STEP / conditional.span_s] * 2)])
    moved = coordinates + np.vstack([np.diag(steps), -np.diag(steps)])
    states = conditional.states(moved)
    J = ((states[:6] - states[6:]) / (2.0 * steps[:, None])).T
    return conditional.states(coordinates[None])[0], J
