"""Least moduli: the estimate that makes the sum of absolute residuals smallest, by linear programming.

A measurement far off pulls it no harder than one just off, as a median. Beside least squares it shows what a few bad
measurements do; beside the guaranteed bounds (`accuracy.guaranteed`), which a single one can empty, it still answers.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.square_root import append_rows, conditioning, solve_upper
from nebosvod.estimation.problem.whitening import Whitener, whitened_rows
from nebosvod.estimation.solvers.batch import prior_rows

Array = npt.NDArray[np.float64]
EXACT = 1e-7  # of a sigma: a residual that the programme made zero
NORMAL = float(np.sqrt(np.pi / 2.0))  # sigma of a median over that of a mean, normal noise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LeastModuli:
    """Estimate by least moduli.

    Attributes
    ----------
    names : of the estimated parameters. mean : shape (s,), deviations from the linearisation point.
    factor : shape (s, s), of its covariance if the noise is normal: pi / 2 times that of least squares, for many
        measurements.
    cost : sum of the moduli of whitened residuals and priors. gap : relative difference of primal and dual.
    residual : shape (n, p), whitened, after the fit.
    exact : shape (n, p), which residuals are zero; at least as many as unknowns, priors counted.
    """

    names: tuple[str, ...]
    mean: Array
    factor: Array
    cost: float
    gap: float
    residual: Array
    exact: npt.NDArray[np.bool_]

    def value(self, name: str) -> float:
        """The estimate of one parameter."""
        return float(self.mean[self.names.index(name)])


def solve(problem: LinearProblem) -> LeastModuli:
    """Estimate the parameters of a linear problem by least moduli.

    Raises
    ------
    GeometryError
        If the measurements do not determine them.
    InputError
        If a nuisance is correlated in time: its whitened residuals belong to no single measurement.

    Notes
    -----
    min sum |v_i - a_i y| is solved as its dual, max v^T l over A^T l = 0, |l_i| <= 1, which has one equation for each
    unknown; y are the multipliers of the equations. Residuals are whitened by the Cholesky factor of each
    measurement's noise, white nuisances included; a prior is a measurement of its parameters.

    References
    ----------
    Bloomfield, Steiger 1983, Least Absolute Deviations; Platonov, Ivanov 2013, part V.
    """
    from scipy.optimize import linprog  # 0.7 s of import, for this estimate alone

    if any(markov.treatment == "estimated" for markov in problem.markov):
        raise InputError("least_moduli: time-correlated nuisances cannot be estimated so; give them as white")
    partition = Partition.of(problem)
    rows = whitened_rows(problem, partition, Whitener.of(problem))
    size, width = partition.n_unknowns, rows.shape[2]
    both = np.vstack([rows.reshape(-1, width), prior_rows(partition, width)])
    A, v = both[:, :size], both[:, size]
    triangle = append_rows(np.zeros((0, size)), A)
    if len(triangle) < size or not conditioning(triangle).observable:
        raise GeometryError("least_moduli: the measurements do not determine all parameters")
    unit = np.linalg.norm(A, axis=0)
    largest = float(np.abs(v).max(initial=0.0)) or 1.0
    found = linprog(-v / largest, A_eq=(A / unit).T, b_eq=np.zeros(size), bounds=(-1.0, 1.0), method="highs-ds")
    if found.status != 0:
        raise GeometryError(f"least_moduli: the linear programme failed: {found.message}")
    y = -largest * np.asarray(found.eqlin.marginals, dtype=np.float64) / unit
    residual = v - A @ y
    cost = float(np.abs(residual).sum())
    of_measurements = residual[: rows.shape[0] * rows.shape[1]].reshape(rows.shape[:2])
    return LeastModuli(
        names=partition.estimated,
        mean=partition.mean + partition.T @ y,
        factor=NORMAL * partition.T @ solve_upper(triangle[:size], np.eye(size)),
        cost=cost,
        gap=abs(cost + largest * float(found.fun)) / max(cost, 1e-12 * largest),
        residual=of_measurements,
        exact=np.abs(of_measurements) <= EXACT * max(1.0, largest),
    )
