"""Variance components: how large each kind of noise really is, by restricted likelihood.

A covariance is often known up to a factor only: of each instrument's noise, of a nuisance. The residuals tell the
factors, but the fit has taken part of them away; the restricted likelihood, that of what no parameter can take away,
counts this and is not biased by it. For independent equal noise it gives chi2 / dof.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.problem.estimate import Status
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.square_root import solve_rows
from nebosvod.estimation.problem.whitening import Whitener, projected, whitened_rows
from nebosvod.estimation.solvers.batch import solve

Array = npt.NDArray[np.float64]
CLOSE = 1e-7
SMALLEST = 1e-8  # factor on a variance below which the data do not see it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Components:
    """Factors on covariances.

    Attributes
    ----------
    names : of the noise sources, then of the estimated white nuisances.
    factors : shape (k,), on the assumed covariance of each; 0 where the data want none of it.
    sigma : shape (k,), of the factors (by the information of the restricted likelihood).
    problem : with the covariances times the factors.
    iterations : taken. converged : whether they stood still.
    """

    names: tuple[str, ...]
    factors: Array
    sigma: Array
    problem: LinearProblem
    iterations: int
    converged: bool


def estimate_components(problem: LinearProblem, limit: int = 500) -> Components:
    """Estimate a factor on the noise of each source and on each white nuisance that is estimated.

    Raises
    ------
    GeometryError
        If the measurements do not determine the parameters, or a source has no more measurements than it takes to.
    InputError
        If a nuisance is correlated in time.

    Notes
    -----
    With V = sum f_g V_g, P = V^-1 - V^-1 H (H^T V^-1 H + prior)^-1 H^T V^-1, the restricted likelihood is largest where
    v^T P V_g P v = tr P V_g for each g. Iterated as f_g <- f_g v^T P V_g P v / tr P V_g, which is Helmert's estimate
    of weights in the form of Foerstner and keeps factors positive; O(n) each.

    References
    ----------
    Patterson, Thompson 1971, Biometrika 58, 545; Foerstner 1979; Koch 1999, section 3.6.
    """
    if any(markov.treatment != "fixed" for markov in problem.markov):
        raise InputError("variance components: a time-correlated nuisance has more than a factor; give it as white")
    whites = [white.name for white in problem.white if white.treatment == "estimated"]
    names = (*problem.noise_names, *whites)
    factors = np.ones(len(names))
    iterations, change = 0, np.inf
    while change > CLOSE and iterations < limit:
        iterations += 1
        statistics = _Statistics.of(scaled(problem, names, factors))
        used = statistics.trace > 0.0
        ratio = np.where(used, statistics.square, 1.0) / np.where(used, statistics.trace, 1.0)
        factors = np.maximum(factors * ratio, SMALLEST)
        change = float(np.abs(np.log(ratio[factors > SMALLEST])).max(initial=0.0))
    at_end = _Statistics.of(scaled(problem, names, factors), information=True)
    with np.errstate(divide="ignore"):
        spread = factors * np.sqrt(np.diag(np.linalg.pinv(at_end.information, hermitian=True)))
    return Components(
        names=names,
        factors=np.where(factors > SMALLEST, factors, 0.0),
        sigma=spread,
        problem=scaled(problem, names, factors),
        iterations=iterations,
        converged=change <= CLOSE,
    )


def scaled(problem: LinearProblem, names: tuple[str, ...], factors: Array) -> LinearProblem:
    """The problem with the covariances of named sources and nuisances times factors."""
    of = dict(zip(names, factors))
    rows = np.array([of.get(name, 1.0) for name in problem.noise_names])[problem.noise_label]
    white = tuple(replace(one, Q=one.Q * of[one.name]) if one.name in of else one for one in problem.white)
    return replace(problem, R=problem.R * rows[:, None, None], white=white)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Statistics:
    """v^T P V_g P v (k,), tr P V_g (k,) and the information of the logarithms of the factors (k, k)."""

    square: Array
    trace: Array
    information: Array

    @classmethod
    def of(cls, problem: LinearProblem, information: bool = False) -> "_Statistics":
        partition, whitener = Partition.of(problem), Whitener.of(problem)
        found = solve(problem)
        if found.solution is None or found.status is Status.NOT_OBSERVABLE:
            raise GeometryError(f"variance components: {found.message}", weak_direction=found.weak_direction)
        rows = whitened_rows(problem, partition, whitener)
        size, n, p = partition.n_unknowns, problem.n, problem.p
        flat = np.vstack([rows.reshape(n * p, -1), np.eye(size, rows.shape[2])[partition.n_free :]])
        unit = np.linalg.norm(flat[:, :size], axis=0)
        base = np.linalg.qr(flat[:, :size] / np.where(unit > 0.0, unit, 1.0))[0]
        basis = base[: n * p].reshape(n, p, size)  # whitened partials times a factor of the covariance
        left = rows[:, :, size] - basis @ (base.T @ flat[:, size])
        shapes = _shapes(problem, whitener)
        square = np.array([np.einsum("np,npq,nq->", left, M, left) for M in shapes])
        own = np.array([np.einsum("npp->", M) for M in shapes])
        grams = [np.einsum("nps,npq,nqt->st", basis, M, basis) for M in shapes]
        trace = own - np.array([np.trace(gram) for gram in grams])
        k = len(shapes)
        inside = np.zeros((k, k))
        if information:
            for i in range(k):
                for j in range(k):
                    product = shapes[i] @ shapes[j]
                    through = np.einsum("nps,npq,nqs->", basis, product, basis)
                    inside[i, j] = np.einsum("npp->", product) - 2.0 * through + np.sum(grams[i] * grams[j])
        return cls(square=square, trace=trace, information=0.5 * inside)


def _shapes(problem: LinearProblem, whitener: Whitener) -> list[Array]:
    """L^-1 V_g L^-T (n, p, p) of each component of the noise."""
    n, p = problem.n, problem.p
    L = np.broadcast_to(whitener.L, (n, p, p))
    noise = np.broadcast_to(problem.R, (n, p, p))
    label = np.zeros(n, dtype=np.int64) if problem.noise_label is None else problem.noise_label
    parts = [np.where((label == k)[:, None, None], noise, 0.0) for k in range(len(problem.noise_names))]
    for white in problem.white:
        if white.treatment == "estimated":
            part = np.zeros((n, p, p))
            part[white.rows] = projected(white.H, white.Q)
            parts.append(part)
    found = []
    for part in parts:
        half = np.array(part)
        solve_rows(np.ascontiguousarray(L), half)
        whole = np.ascontiguousarray(half.transpose(0, 2, 1))
        solve_rows(np.ascontiguousarray(L), whole)
        found.append(whole)
    return found
