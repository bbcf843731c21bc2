"""Do the errors of many runs look as a covariance says? One verdict for each estimator and each covariance it has.

Every test works on normalised errors z = S^-1 e (unit variance, independent, if the covariance is right): mean NEES,
variance of each whitened component, of each direction a reader knows (radial, along the track, normal; parameters)
and of each predicted quantity, coverage, Cramer-von Mises, NIS of each telescope. The family of all tests of one
verdict is held at one level by Holm's rule; intervals are Bonferroni's.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypedDict, TypeVar

import numpy as np
import numpy.typing as npt
from scipy import stats

from nebosvod.estimation.accuracy.consistency import binomial_interval
from nebosvod.estimation.problem.square_root import lower_factor, solve_square
from nebosvod.studies.outcomes import (
    ComponentOutcome,
    CoverageOutcome,
    CramerVonMises,
    Direction,
    DirectionOutcome,
    MeanOfRuns,
    MeanSquare,
    Outcome,
    PredictionOutcome,
    Share,
    TelescopeOutcome,
)

Array = npt.NDArray[np.float64]
LEVELS = (0.5, 0.9, 0.99)
FREE_GROUPS = ("position", "velocity", "parameter")  # of directions, that are no prediction


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Claim:
    """A covariance on trial.

    Attributes
    ----------
    factor : (s + s_j, r), or (N, s + s_j, r) where every run has its own; the parameters left out have rows of zero
        in a formal one.
    nis : (N, telescopes), mean normalised square of the innovations; nan where there is none.
    independent : whether the innovations are independent under the claim (they are what the estimator believes).
    nis_components : (telescopes,) how many components each mean is over.
    """

    factor: Array
    nis: Array
    nis_components: Array
    independent: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judgement:
    """What all tests say of one covariance.

    Attributes
    ----------
    runs, size : how many errors, of how many components of the state.
    level : family error of all tests together.
    squares : (runs,) NEES of the state.
    """

    runs: int
    size: int
    level: float
    nees: Outcome
    cramer_von_mises: Outcome
    coverage: tuple[CoverageOutcome, ...]
    whitened: tuple[ComponentOutcome, ...]
    directions: tuple[DirectionOutcome, ...]
    predictions: tuple[PredictionOutcome, ...]
    nis: tuple[TelescopeOutcome, ...]
    squares: Array

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """All tests."""
        single = (self.nees, self.cramer_von_mises)
        return (*single, *self.coverage, *self.whitened, *self.directions, *self.predictions, *self.nis)

    @property
    def n_rejected(self) -> int:
        """How many tests failed."""
        return sum(one.rejected for one in self.outcomes)

    @property
    def consistent(self) -> bool:
        """Whether none failed."""
        return self.n_rejected == 0

    @property
    def verdict(self) -> str:
        """One sentence."""
        others = failed(self)
        return verdict(self.directions, self.n_rejected, len(self.outcomes), self.runs, others, self.level)

    @property
    def resolution_percent(self) -> float:
        """A sigma wrong by so many percent lies outside its interval as often as not."""
        level = self.level / len(self.outcomes)
        return float(100.0 * (np.sqrt(stats.chi2.ppf(1.0 - 0.5 * level, self.runs) / self.runs) - 1.0))


Kind = TypeVar("Kind", bound=Outcome)


def judge(
    errors: Array, claim: Claim, directions: Sequence[Direction], state: Array, telescopes: Sequence[str], level: float
) -> Judgement:
    """Judge errors (N, s + s_j) against a claimed covariance.

    Parameters
    ----------
    state : (6, s + s_j), the state on radial, transverse, normal axes.
    level : family error of all tests together.

    References
    ----------
    Holm 1979, Scandinavian Journal of Statistics 6, 65.
    """
    white = _normalised(errors @ state.T, state @ claim.factor)
    squares = np.sum(white**2, axis=1)
    runs, size = white.shape
    found = Judgement(
        runs=runs,
        size=size,
        level=level,
        squares=squares,
        nees=Outcome(**_variance(squares / size, runs * size)),
        cramer_von_mises=_cramer_von_mises(squares, size),
        coverage=tuple(_coverage(squares, size, fraction) for fraction in LEVELS),
        whitened=tuple(ComponentOutcome(component=k + 1, **_variance(white[:, k] ** 2, runs)) for k in range(size)),
        directions=tuple(_directions(errors, claim.factor, directions)),
        predictions=tuple(_predictions(errors, claim.factor, directions)),
        nis=tuple(_innovations(claim, telescopes)),
    )
    return _held(found)


def _normalised(errors: Array, factor: Array) -> Array:
    """z = S^-1 e for errors (N, d) and a wide factor (d, r) or (N, d, r)."""
    if factor.ndim == 2:
        return solve_square(lower_factor(factor), errors.T).T
    each = [solve_square(lower_factor(one), error) for one, error in zip(factor, errors)]
    return np.array(each)


class _MeanSquareTest(TypedDict):
    value: float
    p: float
    law: MeanSquare


def _variance(squares: Array, freedom: int) -> _MeanSquareTest:
    """Two-sided chi-square test of a mean square that should be 1."""
    value, total = float(squares.mean()), float(squares.mean()) * freedom
    tail = min(float(stats.chi2.cdf(total, freedom)), float(stats.chi2.sf(total, freedom)))
    return {"value": value, "p": min(1.0, 2.0 * tail), "law": MeanSquare(freedom=freedom)}


def _directions(errors: Array, factor: Array, directions: Sequence[Direction]) -> Iterator[DirectionOutcome]:
    """Each direction by itself: the sigma claimed and the sigma seen."""
    for one in directions:
        sigma = np.linalg.norm(one.weights @ factor, axis=-1)
        if not np.all(sigma > 0.0):
            continue  # held exactly: there is no sigma to judge
        error = errors @ one.weights
        yield DirectionOutcome(
            direction=one,
            sigma_claimed=float(np.sqrt(np.mean(sigma**2))),
            sigma_sample=float(np.sqrt(np.mean(error**2))),
            mean_error=float(error.mean()),
            **_variance((error / sigma) ** 2, len(error)),
        )


def _predictions(errors: Array, factor: Array, directions: Sequence[Direction]) -> Iterator[PredictionOutcome]:
    """Predictions of several components as a whole."""
    for group in dict.fromkeys(one.group for one in directions):
        W = np.array([one.weights for one in directions if one.group == group])
        if group in FREE_GROUPS or len(W) < 2:
            continue
        white = _normalised(errors @ W.T, W @ factor)
        yield PredictionOutcome(group=group, **_variance(np.mean(white**2, axis=1), white.size))


def _coverage(squares: Array, size: int, fraction: float) -> CoverageOutcome:
    """How many runs lie inside the ellipsoid that should hold a fraction of them."""
    runs = len(squares)
    inside = int(np.count_nonzero(squares <= stats.chi2.ppf(fraction, size)))
    low, high = binomial_interval(inside, runs)
    return CoverageOutcome(
        fraction=fraction,
        value=inside / runs,
        value_interval_99=(low, high),
        p=float(stats.binomtest(inside, runs, fraction).pvalue),
        law=Share(runs=runs, fraction=fraction),
    )


def _cramer_von_mises(squares: Array, size: int) -> Outcome:
    """The whole distribution of the NEES against chi-square."""
    found = stats.cramervonmises(stats.chi2.cdf(squares, size), "uniform")
    return Outcome(value=float(found.statistic), p=float(found.pvalue), law=CramerVonMises())


def _innovations(claim: Claim, telescopes: Sequence[str]) -> Iterator[TelescopeOutcome]:
    """NIS of each telescope: chi-square if the innovations are independent, else by the scatter of the runs."""
    for number, name in enumerate(telescopes):
        mean = claim.nis[:, number]
        if not np.isfinite(mean).all():
            continue
        if claim.independent:
            yield TelescopeOutcome(telescope=name, **_variance(mean, len(mean) * int(claim.nis_components[number])))
            continue
        error = float(mean.std(ddof=1) / np.sqrt(len(mean)))
        p = 2.0 * float(stats.t.sf(abs(mean.mean() - 1.0) / error, len(mean) - 1)) if error > 0.0 else 1.0
        law = MeanOfRuns(freedom=len(mean) - 1, error=error)
        yield TelescopeOutcome(telescope=name, value=float(mean.mean()), p=p, law=law)


def _held(found: Judgement) -> Judgement:
    """The same with what Holm's rule rejects, and the interval of each test at Bonferroni's level."""
    count, limit = len(found.outcomes), -1.0
    for rank, p in enumerate(sorted(one.p for one in found.outcomes)):
        if p >= found.level / (count - rank):
            break
        limit = p

    def held(one: Kind) -> Kind:
        return replace(one, rejected=one.p <= limit, interval=one.law.interval(found.level / count))

    return replace(
        found,
        nees=held(found.nees),
        cramer_von_mises=held(found.cramer_von_mises),
        coverage=tuple(held(one) for one in found.coverage),
        whitened=tuple(held(one) for one in found.whitened),
        directions=tuple(held(one) for one in found.directions),
        predictions=tuple(held(one) for one in found.predictions),
        nis=tuple(held(one) for one in found.nis),
    )


def failed(found: Judgement) -> list[str]:
    """The tests of no single direction that were rejected, in words."""
    said = (
        ("NEES/6 (1 expected)", found.nees),
        *((f"variance of whitened component {one.component} (1 expected)", one) for one in found.whitened),
        *(("NEES of a prediction (1 expected)", one) for one in found.predictions),
        *(("share of errors inside their ellipsoid", one) for one in found.coverage),
        ("Cramer-von Mises statistic of the NEES", found.cramer_von_mises),
        *(("NIS (1 expected)", one) for one in found.nis),
    )
    return [f"{words} {one.value:.3g}" for words, one in said if one.rejected]


def verdict(
    directions: Sequence[DirectionOutcome],
    rejected: int,
    tests: int,
    runs: int,
    others: Sequence[str] = (),
    level: float = 0.01,
) -> str:
    """One sentence: consistent, or which sigma is wrong, by how much and where; worst directions first."""
    if not rejected:
        return f"no sigma is wrong: all {tests} tests of {runs} runs passed"
    wrong = sorted((row for row in directions if row.rejected), key=lambda row: -abs(np.log(row.value)))
    chance = (
        f"; one right covariance in {1.0 / level:.0f} fails so by chance, more --runs tell" if rejected == 1 else ""
    )
    if not wrong:
        listed = ", ".join(others[:4]) + (f" and {len(others) - 4} more" if len(others) > 4 else "")
        return f"{rejected} of {tests} tests failed, none of them in a single direction: {listed}{chance}"
    said = [f"{amount(row.optimism_percent)} {place(row.direction)}" for row in wrong[:3]]
    more = f", and {len(wrong) - 3} more" if len(wrong) > 3 else ""
    return "sigma is " + "; ".join(said) + more + chance


def amount(optimism_percent: float) -> str:
    """'optimistic by 12 %', or a factor where percent would be silly."""
    ratio = 1.0 + optimism_percent / 100.0
    word, factor = ("optimistic", ratio) if ratio > 1.0 else ("pessimistic", 1.0 / max(ratio, 1e-300))
    if factor >= 2.0:
        return f"{word} by a factor of {factor:.3g}"
    return f"{word} by {abs(optimism_percent):.2g} %"


def place(direction: Direction) -> str:
    """Where, in words: 'along the track (position)', 'in radius_m', 'in xi of encounter'."""
    if direction.group in ("position", "velocity"):
        return f"{direction.name} ({direction.group})"
    return f"in {direction.name}" if direction.group == "parameter" else f"in {direction.name} of {direction.group}"
