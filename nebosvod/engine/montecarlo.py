"""Monte Carlo of a run: truths really drawn, measured, estimated again; the errors that K_true must describe.

Run i draws from its own seed, so the result does not depend on how many there are; every estimator sees the same
truths. Where the linear step would not do (`nebosvod.engine.trial.second_order`), each estimate is iterated from the
prior to convergence on a propagated truth and judged by the covariance of its own linearisation.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.engine.assembly import computed_psi
from nebosvod.engine.trial import LINEAR_SIGMA, Setting, generator, iterated, measured_truth, possible, second_order
from nebosvod.estimation import Estimate
from nebosvod.estimation.problem.square_root import lower_factor, solve_square
from nebosvod.mission import Estimator
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES, PriorTable
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]
LEVELS = (0.5, 0.9, 0.99)
TOLD_S = 1.0  # between two lines of progress


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sample:
    """Errors of repeated estimation.

    Attributes
    ----------
    names : s parameters, the estimated ones first, then those left out.
    errors : (runs, s), estimate minus truth, of those left out assumed minus true value.
    mean : (s,) or (runs, s), mean of the errors that the estimator's left-out sources promise; K_true is the covariance
        about it.
    reference : the estimate at the reference, whose K_true is on trial.
    factors : (runs, s, s), factors of K_true of each run's own estimate; None where all share that of the reference.
    lost : runs that gave no estimate.
    second_order : what the linear step would leave out, in sigmas.
    """

    names: tuple[str, ...]
    errors: Array
    mean: Array
    reference: Estimate
    factors: Array | None = None
    lost: int = 0
    second_order: float = 0.0

    @property
    def spread(self) -> Array:
        """Errors (runs, s) about their promised mean."""
        return self.errors - self.mean

    @property
    def nees(self) -> Array:
        """Normalised squared error (runs,) of the state, through the factor of K_true."""
        place = [self.names.index(name) for name in STATE_NAMES]
        errors = self.spread[:, place]
        if self.factors is None:
            whitened = np.linalg.solve(self.reference.factor(STATE_NAMES), errors.T).T
        else:
            whitened = np.array([solve_square(lower_factor(G[place]), one) for G, one in zip(self.factors, errors)])
        total: Array = np.sum(whitened.reshape(errors.shape) ** 2, axis=1)
        return total

    def scatter(self, W: Array, names: Sequence[str], sigma: Array) -> Array:
        """Mean square (d,) of the errors of w = W x about their promised mean.

        Parameters
        ----------
        names : the columns of W (d, k).
        sigma : (d,), what is claimed: where runs have covariances of their own, an error counts in sigmas of its run,
            times this.
        """
        place = [self.names.index(name) for name in names]
        errors = self.spread[:, place] @ W.T
        if self.factors is not None:
            own = np.linalg.norm(W @ self.factors[:, place], axis=2)
            errors = errors / np.where(own > 0.0, own, 1.0) * sigma
        square: Array = np.sum(errors**2, axis=0)
        return square


def repeat(
    scene: Scene,
    estimator: Estimator,
    nominal: View,
    priors: PriorTable,
    runs: int,
    seed: int,
    progress: Callable[[str], None] = lambda message: None,
) -> Sample:
    """Estimate `runs` drawn truths with one estimator (see `repeat_all`)."""
    return repeat_all(scene, [estimator], nominal, priors, runs, seed, progress)[0]


def repeat_all(
    scene: Scene,
    estimators: Sequence[Estimator],
    nominal: View,
    priors: PriorTable,
    runs: int,
    seed: int,
    progress: Callable[[str], None] = lambda message: None,
) -> list[Sample]:
    """Estimate `runs` drawn truths with each estimator, by one linear step each or iterated where that would not do.

    Parameters
    ----------
    estimators : such as can observe the state.
    nominal : the nominal point, seen.
    seed : run i draws from SeedSequence(seed, spawn_key=(i,)).
    """
    setting = Setting.at(scene, nominal, priors, estimators)
    left_out = second_order(setting, seed)
    make = _linear if left_out <= LINEAR_SIGMA else _iterated
    return [replace(one, second_order=left_out) for one in make(setting, runs, seed, _Telling(progress, runs))]


class _Telling:
    """Says how many runs are done, at most once in `TOLD_S`."""

    def __init__(self, progress: Callable[[str], None], runs: int) -> None:
        self._progress, self._runs, self._last = progress, runs, -np.inf

    def __call__(self, done: int) -> None:
        now = time.monotonic()
        if now - self._last >= TOLD_S:
            self._last = now
            self._progress(f"Monte Carlo: {done} of {self._runs} runs")


def _linear(setting: Setting, runs: int, seed: int, tell: Callable[[int], None]) -> list[Sample]:
    """Truths linear about the reference, one factorisation for all."""
    computed, estimating = computed_psi(setting.nominal), setting.estimating
    names = [one.reference.names + one.reference.left_out for one in estimating]
    assumed = [np.array([one.reference.value(name) for name in one.reference.left_out]) for one in estimating]
    errors = [np.empty((runs, len(known))) for known in names]
    for i in range(runs):
        tell(i)
        v, truth = measured_truth(setting, computed, generator(seed, i))
        for one, known, fixed, rows in zip(estimating, names, assumed, errors):
            rows[i] = np.append(one.means(v[None])[0], fixed) - np.array([truth[name] for name in known])
    return [
        Sample(
            names=known,
            errors=rows,
            mean=one.mean(known),
            reference=one.reference,
        )
        for one, known, rows in zip(estimating, names, errors)
    ]


def _iterated(setting: Setting, runs: int, seed: int, tell: Callable[[int], None]) -> list[Sample]:
    """Truths propagated, every estimate iterated to convergence."""
    estimating = setting.estimating
    names = [one.reference.names + one.reference.left_out for one in estimating]
    size = [len(known) for known in names]
    rows: list[list[tuple[Array, Array, Array]]] = [[] for _ in estimating]
    for i in range(runs):
        tell(i)
        truth = possible(setting, generator(seed, i))
        for one, mine in zip(estimating, rows):
            trial = None if truth is None else iterated(setting, one, truth)
            if trial is not None:
                mine.append((trial.errors, trial.mean, trial.factor_true))
    return [
        Sample(
            names=known,
            errors=np.array([row[0] for row in mine]).reshape(-1, s),
            mean=np.array([row[1] for row in mine]).reshape(-1, s),
            reference=one.reference,
            factors=np.array([row[2] for row in mine]).reshape(-1, s, s),
            lost=runs - len(mine),
        )
        for one, known, s, mine in zip(estimating, names, size, rows)
    ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateNees:
    """How the errors of repeated estimation agree with K_true.

    Attributes
    ----------
    runs, lost : estimates, and runs that gave none.
    iterated : whether each was iterated to convergence.
    second_order_sigma : what the linear step would leave out; infinite where that is not an orbit.
    nees_mean, nees_interval_99 : mean NEES over its components, and where it lies with 99 % if K_true is right.
    coverage : by share expected inside, the share of the errors inside.
    """

    runs: int
    lost: int
    iterated: bool
    second_order_sigma: float
    nees_mean: float
    nees_interval_99: tuple[float, float]
    coverage: Mapping[float, float]


def state_nees(sample: Sample) -> StateNees:
    """Mean NEES with its 99 % interval, and coverage of the state.

    Notes
    -----
    The sum of the NEES over the runs is chi-square with 6 N degrees of freedom when K_true is right.

    References
    ----------
    Bar-Shalom, Li, Kirubarajan 2001, Estimation with Applications to Tracking and Navigation.
    """
    from scipy.special import chdtri, gammainc

    nees, size = sample.nees, len(STATE_NAMES)
    runs = len(nees)
    low, high = (float(chdtri(size * runs, tail)) / (size * runs) for tail in (0.995, 0.005))
    inside = gammainc(size / 2.0, nees / 2.0)
    return StateNees(
        runs=runs,
        lost=sample.lost,
        iterated=sample.factors is not None,
        second_order_sigma=sample.second_order,
        nees_mean=float(nees.mean() / size),
        nees_interval_99=(low, high),
        coverage={level: float(np.mean(inside <= level)) for level in LEVELS},
    )
