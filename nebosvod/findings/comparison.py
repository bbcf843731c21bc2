"""Five accuracies of one prediction side by side, and what it means when they disagree."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.engine.assembly import left_aside
from nebosvod.engine.fitting import Fit
from nebosvod.engine.montecarlo import Sample
from nebosvod.engine.quantity import Quantity, known_partials, spread
from nebosvod.errors import GeometryError
from nebosvod.estimation import LinearProblem, White
from nebosvod.estimation.accuracy import extended, guaranteed
from nebosvod.estimation.accuracy.budget import marginals
from nebosvod.estimation.problem.subset import subset
from nebosvod.findings import blame
from nebosvod.findings.blame import kind_of_problem, telescopes_of
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]
LEVEL = 3.0
MOST_MEASUREMENTS = 300  # in a linear programme; leaving measurements out can only widen a guaranteed bound
OPTIMISTIC = 1.1  # extended over formal from which the estimator is called optimistic
TOLD_MEAN = 0.1  # of the extended sigma, from which a mean error is told
CONFIDENCE = 0.99
MEANINGS: Mapping[str, str] = {
    "formal": "1 sigma the estimator believes, from its own weights.",
    "extended": "1 sigma of estimate minus truth under the full error model, with the gain the estimator uses.",
    "worst_correlation": "1 sigma if the measurement noise, of the stated size, were correlated in time in the worst "
    "exponential-cosine way (Akim); all other sources as in the extended accuracy.",
    "mean_error": "Mean of predicted minus true value, where an error left out has a mean of its own; the extended "
    "sigma is about it.",
    "guaranteed": f"Largest possible error if no error exceeds {LEVEL:g} of its sigmas (beyond its mean, where that is "
    "not corrected for); a bound, not a sigma.",
    "monte_carlo": "Standard deviation of the errors of repeated estimation of drawn truths.",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Accuracies:
    """Five accuracies of one component of a prediction, in its unit.

    Attributes
    ----------
    component : number of it, from 0.
    formal, extended : 1 sigma as the estimator believes, and in truth.
    mean_error : mean of predicted minus true value.
    worst_correlation, worst_any_correlation : 1 sigma with the worst correlation of the noise, and the bound for any;
        None where the search is left out. worst_period_s : of that correlation.
    guaranteed : bound, with so many measurements; None with a reason where there is none.
    monte_carlo, monte_carlo_interval_99 : standard deviation of drawn errors; None with a reason where none were drawn.
    statement : how they agree, in words.
    """

    estimator: str
    prediction: str
    component: int
    unit: str
    formal: float
    extended: float
    mean_error: float
    worst_correlation: float | None
    worst_any_correlation: float | None
    guaranteed: float | None
    guaranteed_measurements: int
    guaranteed_reason: str | None
    monte_carlo: float | None
    monte_carlo_interval_99: tuple[float, float] | None
    monte_carlo_reason: str | None
    statement: str = ""
    worst_period_s: float | None = None


def comparison(
    scene: Scene, fits: Sequence[Fit], predicted: Mapping[str, Sequence[Quantity]], samples: Mapping[str, Sample]
) -> list[Accuracies]:
    """The accuracies of each component of each prediction of each of the given fits.

    Parameters
    ----------
    samples : Monte Carlo samples by estimator; empty when none was asked for.
    """
    return [
        row for fit in fits for row in _rows(scene, fit, predicted[fit.estimator.name], samples.get(fit.estimator.name))
    ]


def _rows(scene: Scene, fit: Fit, asked: Sequence[Quantity], sample: Sample | None) -> list[Accuracies]:
    """Rows of one estimator."""
    rows = []
    whole = reaching(fit)
    if fit.limited:  # of measurements without weight nothing is required
        whole = subset(whole, ~left_aside(fit.estimator, fit.observation))
    few = thinned(boxed(whole), MOST_MEASUREMENTS)
    for quantity in asked:
        W, names = known_partials(quantity, fit.estimate)
        found, off = fit.estimate.predict(W, names), fit.mean_error(W, names)
        worst = bound = period = np.full(len(W), np.nan)
        if fit.problem.n <= blame.LARGE and not fit.own_gain:  # the search knows the gain of least squares
            worst, bound, period = worst_sigmas(fit, W, names)
        sure, reason = _guaranteed(few, W, names)
        drawn, interval, missing = _monte_carlo(fit, W, names, sample)
        for k in range(len(W)):
            row = Accuracies(
                estimator=fit.estimator.name,
                prediction=quantity.request.name,
                component=k,
                unit=quantity.unit,
                formal=float(found.sigma_formal[k]),
                extended=float(found.sigma[k]),
                mean_error=float(off[k]),
                worst_correlation=_finite(worst[k]),
                worst_any_correlation=_finite(bound[k]),
                guaranteed=None if sure is None else float(sure[k]),
                guaranteed_measurements=few.n,
                guaranteed_reason=reason,
                monte_carlo=None if drawn is None else float(drawn[k]),
                monte_carlo_interval_99=None if interval is None else (float(interval[k, 0]), float(interval[k, 1])),
                monte_carlo_reason=missing,
                worst_period_s=_finite(period[k]),
            )
            left_out = {name: float(np.sum(G[k] ** 2)) for name, G in found.factors.items()}
            rows.append(replace(row, statement=statement(row, _unmodelled(scene, fit, left_out))))
    return rows


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def worst_sigmas(fit: Fit, W: Array, names: Sequence[str]) -> tuple[Array, Array, Array]:
    """Sigmas (d,) with the worst exponential-cosine correlation of the noise, the bound for any, and its period, s."""
    estimate, problem = fit.estimate, fit.problem
    found = extended.worst_prediction(problem, spread(W, names, estimate.names), fit.observation.t_s)
    factors = estimate.predict(W, names).factors
    rest = sum(
        (np.sum(G**2, axis=1) for name, G in factors.items() if name not in problem.noise_names), np.zeros(len(W))
    )
    noise = np.array([[one.sigma, one.bound] for one in found])
    worst, bound = np.sqrt(rest[:, None] + noise**2).T
    return worst, bound, np.array([2.0 * np.pi / one.frequency_rad_per_s for one in found])


def reaching(fit: Fit) -> LinearProblem:
    """The problem with sigmas of which LEVEL hold what an error with a mean may be: |mean| + LEVEL sigma."""
    off = fit.mean_errors
    priors = []
    for prior in fit.problem.priors:
        mean = np.abs([off.common.get(name, 0.0) for name in prior.names])
        true = prior.truth
        if mean.any():  # each by itself
            true = np.diag((np.sqrt(np.diag(true)) + mean / LEVEL) ** 2)
        priors.append(prior if true is prior.covariance else replace(prior, covariance=true, true_covariance=None))
    white = tuple(
        replace(one, true_Q=_widened(one.truth, off.fresh[one.name])) if one.name in off.fresh else one
        for one in fit.problem.white
    )
    true_R = fit.problem.true_R
    labels = fit.problem.noise_label
    for number, name in enumerate(fit.problem.noise_names):
        if name in off.fresh and labels is not None:
            whole = np.array(np.broadcast_to(fit.problem.truth if true_R is None else true_R, (fit.problem.n, 2, 2)))
            whole[labels == number] = _widened(whole[labels == number], off.fresh[name])
            true_R = whole
    return replace(fit.problem, priors=tuple(priors), white=white, true_R=true_R)


def _widened(covariances: Array, mean: Array) -> Array:
    """Covariances (n, k, k) of which LEVEL sigmas hold a mean (k,) too, each component by itself."""
    sigma = np.sqrt(np.einsum("nkk->nk", covariances)) + np.abs(mean) / LEVEL
    wide: Array = sigma[:, :, None] ** 2 * np.eye(sigma.shape[1])
    return wide


def boxed(problem: LinearProblem) -> LinearProblem:
    """The problem with each time-correlated nuisance as one free draw a measurement: every history inside the box."""
    white = []
    for chain in problem.markov:
        if chain.treatment == "fixed":
            continue
        Q = marginals(chain.truth)
        white.append(White(name=chain.name, H=chain.H, Q=Q, rows=chain.rows, treatment=chain.treatment))
    return replace(problem, white=(*problem.white, *white), markov=())


def thinned(problem: LinearProblem, most: int) -> LinearProblem:
    """Every m-th measurement of each telescope, the last among them, so that at most about so many are left."""
    every = -(-problem.n // most)
    labels = np.zeros(problem.n, dtype=np.int64) if problem.noise_label is None else problem.noise_label
    keep = np.zeros(problem.n, dtype=bool)
    for label in np.unique(labels):
        keep[np.flatnonzero(labels == label)[::-1][::every]] = True
    return problem if every == 1 else subset(problem, keep)


def _guaranteed(problem: LinearProblem, W: Array, names: tuple[str, ...]) -> tuple[Array | None, str | None]:
    try:
        return guaranteed.largest_error(problem, W, names, LEVEL), None
    except GeometryError as error:
        return None, str(error)


def _monte_carlo(
    fit: Fit, W: Array, names: Sequence[str], sample: Sample | None
) -> tuple[Array | None, Array | None, str | None]:
    """Standard deviations (d,), their 99 % intervals (d, 2), or why there are none."""
    if sample is None:
        return None, None, "the mission asks for no monte_carlo"
    if len(sample.errors) < 2:
        return None, None, "a single run has no spread"
    from scipy.special import chdtri

    kept = [index for index, name in enumerate(names) if name in sample.names]
    known = [names[index] for index in kept]
    # about the mean that sources left out promise: any other mean is an error
    square = sample.scatter(W[:, kept], known, np.linalg.norm(W[:, kept] @ fit.estimate.factor(known), axis=1))
    runs, tail = len(sample.errors), 0.5 * (1.0 - CONFIDENCE)
    ends = [np.sqrt(square / float(chdtri(runs, p))) for p in (tail, 1.0 - tail)]
    return np.sqrt(square / runs), np.stack(ends, axis=1), None


def _unmodelled(scene: Scene, fit: Fit, variances: Mapping[str, float]) -> str | None:
    """The largest source that the estimator leaves out of its weights."""
    problem = fit.problem
    odd = {name for name, treatment in kind_of_problem(fit) if treatment in ("ignored", "considered")}
    outside = set(fit.estimate.left_out)
    odd |= {prior.name for prior in problem.priors if outside & set(prior.names)}
    odd &= set(variances)
    if not odd:
        return None
    name = max(odd, key=lambda source: variances[source])
    behind = telescopes_of(scene).get(name, ())
    return name if not behind or any(one in name for one in behind) else f"{name} ({', '.join(behind)})"


def statement(row: Accuracies, unmodelled: str | None) -> str:
    """One or two sentences on how the five agree."""
    formal, true, worst = row.formal, row.extended, row.worst_correlation
    said = []
    if true > OPTIMISTIC * formal:
        because = f", which leaves {unmodelled} out of its weights" if unmodelled else ""
        said.append(f"The estimator's own sigma is {true / formal:.3g} times too small{because}.")
    elif formal > OPTIMISTIC * true:
        said.append(f"The estimator's own sigma is {formal / true:.3g} times too large.")
    else:
        said.append("Formal and extended accuracy agree.")
    if true > 0.0 and abs(row.mean_error) > TOLD_MEAN * true:
        said.append(f"On average it is off by {row.mean_error / true:.3g} sigmas, for an error left out has a mean.")
    if worst is not None and true > 0.0 and worst > OPTIMISTIC * true:
        said.append(f"Noise correlated in time could make it {worst / true:.3g} times worse.")
    if row.guaranteed is not None and true > 0.0:
        said.append(f"The guaranteed bound is {row.guaranteed / true:.3g} sigmas.")
    if row.monte_carlo_interval_99 is not None:
        low, high = row.monte_carlo_interval_99
        inside = low <= true <= high
        said.append(f"Monte Carlo {'confirms' if inside else 'contradicts'} the extended sigma.")
    return " ".join(said)
