"""Least squares of all measurements at once, three ways that agree: QR, block elimination, matrix identity.

QR of the whitened rows is the default: it never forms normal equations, so it keeps what they lose to the square
of the condition number, and it takes singular covariances and missing priors as they come. The other two are the
formulas of Guo and Ivashkin (2018): `blocks` eliminates the nuisances from the full normal matrix (way 1, needs
every covariance invertible), `identity` updates the inverse noise by low-rank terms (way 2).
"""

from collections.abc import Callable
from typing import Literal

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.problem.estimate import Estimate
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.sources import Solved, estimate_of, not_observable
from nebosvod.estimation.problem.square_root import Conditioning, append_rows, conditioning, solve_upper
from nebosvod.estimation.problem.whitening import Whitener, whitened_rows
from nebosvod.estimation.solvers.normal_equations import solve_blocks, solve_identity

Array = npt.NDArray[np.float64]
Way = Literal["qr", "blocks", "identity"]


def solve(problem: LinearProblem, way: Way = "qr") -> Estimate:
    """Estimate the parameters of a linear problem from all its measurements.

    Parameters
    ----------
    problem : the measurements, what is uncertain and how it is treated.
    way : "qr" (default), "blocks" or "identity".

    Returns
    -------
    Estimate
        With status `not_observable`, rank and weak direction, when the condition number of the column-scaled
        whitened rows passes 1e13.

    Raises
    ------
    InputError
        If the way is unknown, or cannot do the problem (blocks: a singular covariance).

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, sections 2.1-2.6; Tapley, Schutz, Born 2004, chapters 4 and 6.
    """
    if way not in _WAYS:
        raise InputError(f"way must be one of {', '.join(_WAYS)}, got {way!r}")
    partition = Partition.of(problem)
    whitener = Whitener.of(problem)
    rows = whitened_rows(problem, partition, whitener)
    solved, condition, reason = _WAYS[way](problem, partition, rows)
    if solved is None:
        return not_observable(problem, partition, condition, reason)
    return estimate_of(problem, partition, whitener, rows, solved, condition)


def prior_rows(partition: Partition, width: int) -> Array:
    """The rows y = 0 +- 1 of the unknowns with a prior, padded to `width` columns."""
    size = partition.n_unknowns
    return np.eye(size, width)[partition.n_free :]


def solved_triangle(triangle: Array, size: int) -> tuple[Solved | None, Conditioning, str]:
    """Solve the reduced rows [R | d | C]: y = iR d, M = iR C, cost = square of what is left in column d."""
    R = triangle[:size, :size]
    if R.shape[0] < size:
        R = np.vstack([R, np.zeros((size - R.shape[0], size))])
    condition = conditioning(R)
    if not condition.observable:
        return None, condition, ""
    right = solve_upper(R, np.hstack([triangle[:size, size:], np.eye(size)]))
    left_out = triangle.shape[1] - size - 1
    chi2 = float(triangle[size, size] ** 2) if triangle.shape[0] > size else 0.0
    solved = Solved(y=right[:, 0], M=right[:, 1 : 1 + left_out], S=right[:, 1 + left_out :], chi2=chi2)
    return solved, condition, ""


def _solve_qr(problem: LinearProblem, partition: Partition, rows: Array) -> tuple[Solved | None, Conditioning, str]:
    """Way 3: Householder QR of [prior rows; whitened rows]; the prior first, for its rows may be the heaviest."""
    width = rows.shape[2]
    triangle = append_rows(prior_rows(partition, width), rows.reshape(-1, width))
    return solved_triangle(triangle, partition.n_unknowns)


_WAYS: dict[str, Callable[[LinearProblem, Partition, Array], tuple[Solved | None, Conditioning, str]]] = {
    "qr": _solve_qr,
    "blocks": solve_blocks,
    "identity": solve_identity,
}
