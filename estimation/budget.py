"""Reading the error budget: shares, what a source costs, and noise against nuisance at each measurement.

"If this source vanished" has two answers and both are given: with the gain as it is, and with the gain
re-optimised for a world without the source.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.batch import solve as solve_batch
from nebosvod.estimation.estimate import Estimate, Prediction
from nebosvod.estimation.problem import LinearProblem, Markov, Prior, White
from nebosvod.estimation.square_root import cholesky_rows, solve_rows
from nebosvod.estimation.whitening import projected

Array = npt.NDArray[np.float64]
PERFECT = 1e-4  # of the noise that was: what stands for a measurement without noise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Share:
    """One source's part of a group of components: sigma = root of its trace, share = its trace over the whole."""

    source: str
    sigma: float
    share: float


def shares(estimate: Estimate, names: Sequence[str]) -> tuple[Share, ...]:
    """Budget of a group of parameters, largest share first; the shares sum to 1."""
    matrix = np.eye(len(names))
    return prediction_shares(estimate.predict(matrix, names))


def prediction_shares(prediction: Prediction) -> tuple[Share, ...]:
    """Budget of a predicted quantity, largest share first; give one with components of one unit."""
    traces = {name: float(np.sum(G**2)) for name, G in prediction.factors.items()}
    total = sum(traces.values())
    found = [
        Share(source=name, sigma=float(np.sqrt(trace)), share=trace / total if total > 0.0 else 0.0)
        for name, trace in traces.items()
    ]
    return tuple(sorted(found, key=lambda share: -share.share))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Vanished:
    """Sigma (root trace) of a group now, without a source at the present gain, and with the gain re-optimised."""

    source: str
    sigma: float
    sigma_same_gain: float
    sigma_new_gain: float


def if_vanished(
    problem: LinearProblem,
    source: str,
    names: Sequence[str],
    solve: Callable[[LinearProblem], Estimate] = solve_batch,
) -> Vanished:
    """Answer "what if this source had no error" for a group of parameters, both ways."""
    now = solve(problem)
    factors = now.predict(np.eye(len(names)), names).factors
    if source not in factors:
        raise InputError(f"if_vanished: no source {source!r}; there are {', '.join(factors)}")
    traces = {name: float(np.sum(G**2)) for name, G in factors.items()}
    total = sum(traces.values())
    then = solve(without(problem, source))
    return Vanished(
        source=source,
        sigma=float(np.sqrt(total)),
        sigma_same_gain=float(np.sqrt(max(total - traces[source], 0.0))),
        sigma_new_gain=float(np.linalg.norm(then.factor(names))),
    )


def without(problem: LinearProblem, source: str) -> LinearProblem:
    """Return the problem in a world where a prior, white or time-correlated source has no error.

    Raises
    ------
    InputError
        If the source is measurement noise (a perfect measurement has no weight to give) or unknown.
    """
    if source in problem.noise_names:
        raise InputError(f"without: {source!r} is measurement noise, which can not be taken away; use scaled")
    return scaled(problem, source, 0.0)


def scaled(problem: LinearProblem, source: str, factor: float) -> LinearProblem:
    """Return the problem in a world where a source errs `factor` times as much, and the estimator knows it.

    Raises
    ------
    InputError
        If the source is unknown, or the factor is negative.

    Notes
    -----
    A perfect measurement has no weight to give: noise is never scaled below PERFECT of its size, where it is below
    any other source that matters.
    """
    if factor < 0.0:
        raise InputError(f"scaled: needs factor >= 0, got {factor}")
    square = factor * factor
    if source in problem.noise_names:
        return _with_noise(problem, problem.noise_names.index(source), max(square, PERFECT**2))
    groups: tuple[Prior | White | Markov, ...] = (*problem.priors, *problem.white, *problem.markov)
    known = [group.name for group in groups]
    if source not in known:
        allowed = ", ".join(sorted((*known, *problem.noise_names)))
        raise InputError(f"scaled: {source!r} is not a source that can be taken away; allowed: {allowed}")
    return replace(
        problem,
        priors=tuple(
            replace(prior, covariance=square * prior.covariance, true_covariance=_times(prior.true_covariance, square))
            if prior.name == source
            else prior
            for prior in problem.priors
        ),
        white=tuple(
            replace(white, Q=square * white.Q, true_Q=_times(white.true_Q, square)) if white.name == source else white
            for white in problem.white
            if white.name != source or factor > 0.0
        ),
        markov=tuple(
            replace(chain, Q=square * chain.Q, P0=square * chain.P0) if chain.name == source else chain
            for chain in problem.markov
            if chain.name != source or factor > 0.0
        ),
    )


def _with_noise(problem: LinearProblem, label: int, square: float) -> LinearProblem:
    """The problem with the noise covariance of one noise source times `square`."""
    labels = np.zeros(problem.n, dtype=np.int64) if problem.noise_label is None else problem.noise_label
    weight = np.where(labels == label, square, 1.0)[:, None, None]
    return replace(problem, R=weight * problem.R, true_R=None if problem.true_R is None else weight * problem.true_R)


def _times(covariance: Array | None, square: float) -> Array | None:
    return None if covariance is None else square * covariance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoiseToNuisance:
    """Measurement noise against nuisance at each measurement, in decibel; large is good.

    Attributes
    ----------
    eta_db : shape (n,), 10 lg tr R / tr(nuisance covariance); inf where no nuisance acts.
    eta_effective_db : shape (n,), common nuisances counted with the number N of measurements they touch: a single
        common nuisance gives eta - 10 lg N.
    eta_whitened_db : shape (n,), 10 lg p / tr(iR nuisance covariance), free of units.
    sigma_critical : shape (n,), sigma of an isotropic per-measurement nuisance at eta = 0 dB, sqrt(tr R) / |H_z|;
        inf where no white or time-correlated nuisance acts.
    """

    eta_db: Array
    eta_effective_db: Array
    eta_whitened_db: Array
    sigma_critical: Array

    @property
    def eta_db_mean(self) -> float:
        """Mean of the finite eta; inf when no nuisance acts anywhere."""
        finite = self.eta_db[np.isfinite(self.eta_db)]
        return float(finite.mean()) if finite.size else float("inf")

    def sigma_limit(self, eta_min_db: float) -> Array:
        """Sigma (n,) of the per-measurement nuisance that keeps eta at or above `eta_min_db`."""
        limit: Array = self.sigma_critical * 10.0 ** (-eta_min_db / 20.0)
        return limit


def noise_to_nuisance(problem: LinearProblem, sources: Sequence[str] | None = None) -> NoiseToNuisance:
    """Compare measurement noise with nuisance errors at each measurement (true covariances).

    Parameters
    ----------
    problem : the problem.
    sources : names of priors, white and time-correlated sources that count as nuisance; by default all but the
        priors that touch the first block (the state).

    References
    ----------
    Guo, Ivashkin 2018, (3.17)-(3.31).
    """
    wanted = _nuisance_names(problem) if sources is None else set(sources)
    n, p = problem.n, problem.p
    fresh, common, counted = np.zeros((n, p, p)), np.zeros((n, p, p)), np.zeros((n, p, p))
    strength = np.zeros(n)
    for white in problem.white:
        if white.name in wanted:
            fresh[white.rows] += projected(white.H, white.truth)
            strength[white.rows] += np.einsum("npq,npq->n", white.H, white.H)
    for markov in problem.markov:
        if markov.name in wanted:
            covariance = _markov_covariances(markov.F, markov.Q, markov.P0)
            fresh[markov.rows] += projected(markov.H, covariance)
            strength[markov.rows] += np.einsum("npq,npq->n", markov.H, markov.H)
    columns = {name: block.H[:, :, k] for block in problem.blocks for k, name in enumerate(block.names)}
    for prior in problem.priors:
        if prior.name in wanted:
            H = np.stack([columns[name] for name in prior.names], axis=2)
            part = projected(H, prior.truth[None])
            common += part
            counted += part * int(H.any(axis=(1, 2)).sum())
    R = np.broadcast_to(problem.truth, (n, p, p))
    noise = np.einsum("npp->n", R)
    with np.errstate(divide="ignore"):
        return NoiseToNuisance(
            eta_db=_decibel(noise, np.einsum("npp->n", fresh + common)),
            eta_effective_db=_decibel(noise, np.einsum("npp->n", fresh + counted)),
            eta_whitened_db=_decibel(np.full(n, float(p)), _whitened_trace(R, fresh + common)),
            sigma_critical=np.sqrt(noise) / np.sqrt(strength),
        )


def critical_sigma(R: Array, H: Array) -> Array:
    """Sigma (n,) of an isotropic nuisance whose effect equals the noise: sqrt(tr R) / |H|_F."""
    critical: Array = np.sqrt(np.einsum("npp->n", R)) / np.sqrt(np.einsum("npq,npq->n", H, H))
    return critical


def _nuisance_names(problem: LinearProblem) -> set[str]:
    state = set(problem.blocks[0].names)
    names = {prior.name for prior in problem.priors if not state & set(prior.names)}
    return names | {white.name for white in problem.white} | {markov.name for markov in problem.markov}


def _markov_covariances(F: Array, Q: Array, P0: Array) -> Array:
    """Covariance of z at each touched row."""
    out = np.empty(F.shape)
    out[0] = P0
    for k in range(1, len(F)):
        out[k] = F[k] @ out[k - 1] @ F[k].T + Q[k]
    return out


def _decibel(noise: Array, nuisance: Array) -> Array:
    out: Array = 10.0 * np.log10(noise / nuisance)
    return out


def _whitened_trace(R: Array, covariance: Array) -> Array:
    """Trace of iR covariance, for stacks (n, p, p)."""
    L = cholesky_rows(R, "R")
    half = np.array(covariance)
    solve_rows(L, half)
    other = np.ascontiguousarray(half.transpose(0, 2, 1))
    solve_rows(L, other)
    trace: Array = np.einsum("npp->n", other)
    return trace


def group_shares(estimate: Estimate, groups: Mapping[str, Sequence[str]]) -> dict[str, tuple[Share, ...]]:
    """Budgets of several groups of parameters, e.g. position and velocity, by the groups' names."""
    return {group: shares(estimate, names) for group, names in groups.items()}
