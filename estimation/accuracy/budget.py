"""Reading the error budget: shares, what a source costs, and noise against nuisance at each measurement.

"If this source vanished" has two answers and both are given: with the gain as it is, and with the gain
re-optimised for a world without the source.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.problem.estimate import Estimate, Prediction
from nebosvod.estimation.problem.problem import LinearProblem, Markov, Prior, White
from nebosvod.estimation.problem.square_root import cholesky_rows, solve_rows
from nebosvod.estimation.problem.whitening import projected
from nebosvod.estimation.solvers.batch import solve as solve_batch

Array = npt.NDArray[np.float64]
PERFECT = 1e-4  # of the noise that was: what stands for a measurement without noise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Share:
    """One source's part of a group of components: sigma = root of its trace, share = its trace over the whole."""

    source: str
    sigma: float
    share: float


def shares(estimate: Estimate, names: Sequence[str]) -> tuple[Share, ...]:
    """Budget of a group of parameters, largest share first; the shares sum to 1.

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, sections 2.3.3-2.6.
    """
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
            _chain_times(chain, square) if chain.name == source else chain
            for chain in problem.markov
            if chain.name != source or factor > 0.0
        ),
    )


def unknown(problem: LinearProblem, source: str) -> LinearProblem | None:
    """Return the problem in a world where nothing is known beforehand of what a prior is about, `without` reversed.

    Only what is estimated can do without: parameters left out keep their part of the prior. Of a prior that joins the
    first block (the state) with other parameters it is the state of which nothing is known; the others keep their
    marginal covariance, as where they are given apart. None where the source is no prior of an estimated parameter.
    """
    prior = next((prior for prior in problem.priors if prior.name == source), None)
    estimated = set(problem.names("estimated"))
    if prior is None or not estimated & set(prior.names):
        return None
    first = estimated & set(problem.blocks[0].names) & set(prior.names)
    kept = [index for index, name in enumerate(prior.names) if name not in (first or estimated)]
    rest = tuple(one for one in problem.priors if one is not prior)
    if kept:
        at = np.ix_(kept, kept)
        true = None if prior.true_covariance is None else prior.true_covariance[at]
        mean = None if prior.mean is None else prior.mean[kept]
        names = tuple(prior.names[index] for index in kept)
        rest += (Prior(name=source, names=names, covariance=prior.covariance[at], mean=mean, true_covariance=true),)
    return replace(problem, priors=rest)


def _with_noise(problem: LinearProblem, label: int, square: float) -> LinearProblem:
    """The problem with the noise covariance of one noise source times `square`."""
    labels = np.zeros(problem.n, dtype=np.int64) if problem.noise_label is None else problem.noise_label
    weight = np.where(labels == label, square, 1.0)[:, None, None]
    return replace(problem, R=weight * problem.R, true_R=None if problem.true_R is None else weight * problem.true_R)


def _chain_times(chain: Markov, square: float) -> Markov:
    return replace(
        chain,
        Q=square * chain.Q,
        P0=square * chain.P0,
        true_Q=_times(chain.true_Q, square),
        true_P0=_times(chain.true_P0, square),
    )


def _times(covariance: Array | None, square: float) -> Array | None:
    return None if covariance is None else square * covariance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoiseToNuisance:
    """Measurement noise against nuisance at each of n measurements of p components; large is good.

    Attributes
    ----------
    p : components of a measurement.
    noise : shape (n,), tr R.
    nuisance : shape (n,), trace of the covariance that the nuisances give the measurement.
    counted : shape (n,), the same with each common nuisance counted with the number of measurements it touches.
    whitened : shape (n,), tr iR N with N that covariance: free of units.
    strength : shape (n,), squared norm of H_z over the white and time-correlated nuisances.
    """

    p: int
    noise: Array
    nuisance: Array
    counted: Array
    whitened: Array
    strength: Array

    @property
    def eta_db(self) -> Array:
        """10 lg tr R / tr N of each measurement, dB; inf where no nuisance acts."""
        return _decibel(self.noise, self.nuisance)

    @property
    def eta_effective_db(self) -> Array:
        """The same with common nuisances counted: a single one of N measurements gives eta - 10 lg N."""
        return _decibel(self.noise, self.counted)

    @property
    def eta_whitened_db(self) -> Array:
        """10 lg p / tr iR N."""
        return _decibel(np.full(len(self.noise), float(self.p)), self.whitened)

    @property
    def sigma_critical(self) -> Array:
        """Sigma (n,) of an isotropic fresh nuisance as strong as the noise, sqrt(tr R) / |H_z|; inf where none acts."""
        with np.errstate(divide="ignore"):
            critical: Array = np.sqrt(self.noise) / np.sqrt(self.strength)
        return critical

    @property
    def sigma_nuisance(self) -> Array:
        """All nuisances as an error of the measurement (n,), root mean square of a component."""
        alone: Array = np.sqrt(self.nuisance / self.p)
        return alone

    @property
    def sigma_equivalent(self) -> Array:
        """Noise and nuisances together as one error of the measurement (n,), root mean square of a component."""
        together: Array = np.sqrt((self.noise + self.nuisance) / self.p)
        return together

    @property
    def eta_db_mean(self) -> float:
        """Mean over all measurements: a ratio of sums, (3.18); inf when no nuisance acts anywhere."""
        return self.mean_db("eta")

    def mean_db(self, which: Literal["eta", "effective", "whitened"], rows: npt.ArrayLike | None = None) -> float:
        """Mean ratio of some measurements, dB: the sum of the noise over the sum of the nuisance."""
        noise, nuisance = {
            "eta": (self.noise, self.nuisance),
            "effective": (self.noise, self.counted),
            "whitened": (np.full(len(self.noise), float(self.p)), self.whitened),
        }[which]
        chosen = slice(None) if rows is None else np.asarray(rows)
        return float(_decibel(noise[chosen].sum(), nuisance[chosen].sum()))

    def sigma_limit(self, eta_min_db: float) -> Array:
        """Sigma (n,) of the per-measurement nuisance that keeps eta at or above `eta_min_db`."""
        limit: Array = self.sigma_critical * 10.0 ** (-eta_min_db / 20.0)
        return limit


def noise_to_nuisance(problem: LinearProblem, sources: Sequence[str] | None = None) -> NoiseToNuisance:
    """Compare measurement noise with nuisance errors at each measurement (true covariances).

    Parameters
    ----------
    problem : the problem.
    sources : names of priors, white and time-correlated sources that count as nuisance; by default all of them.

    Notes
    -----
    The first block (the state) is no nuisance. Of a prior that it shares with other parameters, theirs enter with their
    marginal covariance, the sub-block: the same whether the prior is given jointly or apart, and at whatever epoch.
    What is fixed has no error.

    References
    ----------
    Guo, Ivashkin 2018, (3.17)-(3.31).
    """
    fresh, strength = _fresh_nuisance(problem, sources)
    common, counted = _common_nuisance(problem, sources)
    R = np.broadcast_to(problem.truth, (problem.n, problem.p, problem.p))
    return NoiseToNuisance(
        p=problem.p,
        noise=np.einsum("npp->n", R),
        nuisance=np.einsum("npp->n", fresh + common),
        counted=np.einsum("npp->n", fresh + counted),
        whitened=_whitened_trace(R, fresh + common),
        strength=strength,
    )


def _fresh_nuisance(problem: LinearProblem, sources: Sequence[str] | None) -> tuple[Array, Array]:
    """Covariances (n, p, p) by white and time-correlated nuisances, and the squared norms (n,) of their partials."""
    total, strength = np.zeros((problem.n, problem.p, problem.p)), np.zeros(problem.n)
    groups: tuple[White | Markov, ...] = (*problem.white, *problem.markov)
    for group in groups:
        if group.treatment != "fixed" and (sources is None or group.name in sources):
            covariance = group.truth if isinstance(group, White) else marginals(group.truth)
            total[group.rows] += projected(group.H, covariance)
            strength[group.rows] += np.einsum("npq,npq->n", group.H, group.H)
    return total, strength


def _common_nuisance(problem: LinearProblem, sources: Sequence[str] | None) -> tuple[Array, Array]:
    """Covariances (n, p, p) by common parameters beside the first block; and each counted with all that it touches."""
    total = np.zeros((problem.n, problem.p, problem.p))
    counted = np.zeros_like(total)
    columns = {
        name: block.H[:, :, k]
        for block in problem.blocks[1:]
        if block.treatment != "fixed"
        for k, name in enumerate(block.names)
    }
    for prior in problem.priors:
        kept = [index for index, name in enumerate(prior.names) if name in columns]
        if kept and (sources is None or prior.name in sources):
            H = np.stack([columns[prior.names[index]] for index in kept], axis=2)
            part = projected(H, prior.truth[np.ix_(kept, kept)][None])
            total += part
            counted += part * int(H.any(axis=(1, 2)).sum())
    return total, counted


def critical_sigma(R: Array, H: Array) -> Array:
    """Sigma (n,) of an isotropic nuisance whose effect equals the noise: sqrt(tr R) / |H|_F.

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, (3.17)-(3.31).
    """
    critical: Array = np.sqrt(np.einsum("npp->n", R)) / np.sqrt(np.einsum("npq,npq->n", H, H))
    return critical


def marginals(chain: Markov) -> Array:
    """Covariance (n_r, q, q) of z at each touched row, as assumed."""
    out = np.empty(chain.F.shape)
    out[0] = chain.P0
    for k in range(1, len(out)):
        step = chain.F[k] @ out[k - 1] @ chain.F[k].T + chain.Q[k]
        out[k] = 0.5 * (step + step.T)
    return out


def _decibel(noise: Array, nuisance: Array) -> Array:
    with np.errstate(divide="ignore"):
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
