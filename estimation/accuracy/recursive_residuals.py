"""Residuals that are independent of each other: what each measurement says beyond those before it, in its own sigmas.

Residuals after a fit are correlated by the fit, the more the fewer there are. Recursive residuals, the innovations of
the filter that equals the fit, are independent normal numbers of unit variance where the model is right, so that tests
of their pattern hold their level however few they are.

References
----------
Brown, Durbin, Evans 1975, J. Royal Statistical Society B 37, 149.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from nebosvod.borders.compiled import plain_loop
from nebosvod.borders.treatment import Treatment
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.whitening import Whitener, whitened_rows
from nebosvod.estimation.solvers.batch import prior_rows
from nebosvod.estimation.solvers.recursive import rotate_in

Array = npt.NDArray[np.float64]


def recursive_residuals(problem: LinearProblem) -> Array:
    """Innovations (n, p) of the components of the measurements, one after another, in sigmas.

    Parameters
    ----------
    problem : rows in time order. Correlated components of one measurement are taken apart in their order.

    Returns
    -------
    nan for those that only begin to determine a parameter without a prior. The sum of the squares of the others is
    chi2, and they are independent N(0, 1) where the problem is right about everything: see `nothing_left_out`.
    """
    partition = Partition.of(problem)
    rows = whitened_rows(problem, partition, Whitener.of(problem))
    size = partition.n_unknowns
    triangle = np.zeros((size, size + 1))
    triangle[partition.n_free :] = prior_rows(partition, size + 1)
    out = np.empty(rows.shape[:2])
    _take_in(np.ascontiguousarray(rows[:, :, : size + 1]), triangle, out)
    return out


def nothing_left_out(problem: LinearProblem) -> LinearProblem:
    """The problem of an estimator that has all its sources in its model, those too that are considered or ignored.

    They are what they are assumed to be: where something else is true, the residuals may show it.
    """

    def known(treatment: Treatment) -> Treatment:
        return "estimated" if treatment in ("considered", "ignored") else treatment

    return replace(
        problem,
        true_R=None,
        blocks=tuple(replace(one, treatment=known(one.treatment)) for one in problem.blocks),
        white=tuple(replace(one, true_Q=None, treatment=known(one.treatment)) for one in problem.white),
        markov=tuple(
            replace(one, true_F=None, true_Q=None, true_P0=None, treatment=known(one.treatment))
            for one in problem.markov
        ),
        priors=tuple(replace(one, true_covariance=None) for one in problem.priors),
    )


@plain_loop
def _take_in(rows, triangle, out):  # type: ignore[no-untyped-def]
    """Rotate rows (n, p, s + 1) into a triangle (s, s + 1); fill what is left of the residual of each."""
    n, p, width = rows.shape
    row = np.empty(width)
    for k in range(n):
        for i in range(p):
            row[:] = rows[k, i]
            begins = False
            for j in range(width - 1):
                if triangle[j, j] == 0.0 and row[j] != 0.0:
                    begins = True
            rotate_in(row, triangle)
            out[k, i] = np.nan if begins else row[width - 1]
