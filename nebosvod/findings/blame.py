"""Who is to blame: the share of each source in a number, and what would be gained if its error vanished or halved.

Both answers are given: with the gain as it is (only the error shrinks; nothing is estimated anew) and with the gain
re-optimised (the estimator knows and weighs anew: a new solve; never worse for an estimator that leaves nothing out,
while one that ignores or considers a source may come to trust the wrong one). Shares of variance add up to one; the
gains of several remedies do not.

A prior is a source of error too, and its error vanishes where the orbit, or the parameter, is known exactly. What there
would be without the prior, nothing being known beforehand, is the opposite and stands beside it: `if_unknown`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import SOLVERS, Fit
from nebosvod.engine.quantity import M_PER_KM, Quantity, known_partials
from nebosvod.estimation import Block, Estimate, Markov, Prediction, White
from nebosvod.estimation.accuracy import budget
from nebosvod.estimation.solvers import batch
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.scene.process_noise import process_noise_of
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]
LARGE = 20_000  # measurements; above, what needs many solves or searches is left out, and the run says so
REMEDIES: Mapping[str, float] = {"if_vanished": 0.0, "if_halved": 0.5}
UNKNOWN = "if_unknown"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Worlds:
    """An estimate, and the estimates in worlds where one source errs less, or a prior is missing, and that is known.

    Attributes
    ----------
    now : the estimate.
    then : by remedy and source.
    priors : sources that are a prior of something estimated.
    """

    now: Estimate
    then: Mapping[tuple[str, str], Estimate]
    priors: frozenset[str] = frozenset()

    @classmethod
    def of(cls, fit: Fit) -> "Worlds":
        """Solve the problem of a fit again for each source and each remedy; a LARGE one is not solved again."""
        solve = SOLVERS[fit.estimator.method] if fit.own_gain else batch.solve
        found, priors = {}, {}
        for source in fit.estimate.sources:
            priors[source] = None if fit.own_gain else budget.unknown(fit.problem, source)
            if fit.problem.n > LARGE:
                continue
            for remedy, factor in REMEDIES.items():
                found[remedy, source] = solve(budget.scaled(fit.problem, source, factor))
            if (free := priors[source]) is not None:
                found[UNKNOWN, source] = solve(free)
        then = {key: estimate for key, estimate in found.items() if estimate.solution is not None}
        return cls(now=fit.estimate, then=then, priors=frozenset(name for name, one in priors.items() if one))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateSigmas:
    """1 sigma of the state: root traces of position and of velocity."""

    position_km: float
    velocity_m_s: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuantitySigmas:
    """1 sigma of a predicted quantity, in its unit: of each component (d,), and the root of the summed variances."""

    each: Array
    total: float


Sigmas = TypeVar("Sigmas", StateSigmas, QuantitySigmas)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Remedied(Generic[Sigmas]):
    """Sigmas if a source erred less: with the gain as it is, and re-optimised (None where that has no solution)."""

    same_gain: Sigmas
    new_gain: Sigmas | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unknown(Generic[Sigmas]):
    """Sigmas without a prior; None where the problem is then not observable, or too large to be solved again."""

    new_gain: Sigmas | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Remedies(Generic[Sigmas]):
    """What the sigmas would be with each remedy for one source; `if_unknown` is None unless the source is a prior."""

    if_vanished: Remedied[Sigmas]
    if_halved: Remedied[Sigmas]
    if_unknown: Unknown[Sigmas] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateShare:
    """The part of one source in the state at the reference epoch.

    Attributes
    ----------
    telescopes : whose source it is; none for the object and the prior.
    sigma : what it contributes; squares of the sources add up.
    share_position, share_velocity : of the variance, 0 to 1; share_parameters : of each parameter beside the state.
    """

    estimator: str
    source: str
    telescopes: tuple[str, ...]
    sigma: StateSigmas
    share_position: float
    share_velocity: float
    share_parameters: Mapping[str, float]
    remedies: Remedies[StateSigmas]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuantityShare:
    """The part of one source in a predicted quantity.

    Attributes
    ----------
    telescopes : whose source it is; none for the object and the prior.
    share : (d,) of the variance of each component, 0 to 1; share_total : of the sum of the variances.
    sigma : what it contributes, in the unit of the quantity; squares of the sources add up.
    """

    source: str
    telescopes: tuple[str, ...]
    share: Array
    share_total: float
    sigma: QuantitySigmas
    remedies: Remedies[QuantitySigmas]


Kind = tuple[tuple[str, str], ...]


def kind_of_problem(fit: Fit) -> Kind:
    """What decides the accuracy of a fit: its gain, and the treatment of everything; one of these, one budget."""
    groups: tuple[Block | White | Markov, ...] = (*fit.problem.blocks, *fit.problem.white, *fit.problem.markov)
    gain = fit.estimator.method if fit.own_gain else "least squares"
    taken = "all" if fit.estimator.telescopes == "all" else ", ".join(sorted(fit.estimator.telescopes))
    return (("gain", gain), ("telescopes", taken), *((group.name, group.treatment) for group in groups))


def telescopes_of(scene: Scene) -> dict[str, tuple[str, ...]]:
    """The telescopes behind each source of the budget; sources of the object and the prior have none."""
    noise = {f"measurement noise {telescope.name}": (telescope.name,) for telescope in scene.telescopes}
    return noise | {name: source.telescopes for name, source in scene.sources.items()}


def state_shares(scene: Scene, fit: Fit, worlds: Worlds) -> list[StateShare]:
    """The `budget` of one estimator: each source's part of the state, largest share of position first.

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, sections 2.3.3-2.6.
    """
    total = _state_sigmas(_variances(worlds.now.predict(np.eye(6), STATE_NAMES)))
    noise = process_noise_of(scene.nuisances)
    accelerations = set() if noise is None else set(noise.names)  # too many, and each means nothing by itself
    others = [name for name in worlds.now.names if name not in STATE_NAMES and name not in accelerations]
    own = _parts(worlds.now.predict(np.eye(len(others)), others)) if others else {}
    own_total = np.sum(list(own.values()), axis=0) if own else np.zeros(0)
    behind = telescopes_of(scene)
    rows = []
    for source, part, remedies in _sources(worlds, np.eye(6), STATE_NAMES, _state_sigmas):
        sigma = _state_sigmas(part)
        rows.append(
            StateShare(
                estimator=fit.estimator.name,
                source=source,
                telescopes=behind.get(source, ()),
                sigma=sigma,
                share_position=_share(sigma.position_km, total.position_km),
                share_velocity=_share(sigma.velocity_m_s, total.velocity_m_s),
                share_parameters=_component_shares(own[source], own_total, others) if own else {},
                remedies=remedies,
            )
        )
    return sorted(rows, key=lambda row: -row.share_position)


def quantity_shares(scene: Scene, worlds: Worlds, asked: Quantity) -> list[QuantityShare]:
    """The `budget` of a predicted quantity, largest share of the summed variance first.

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, sections 2.3.3-2.6.
    """
    W, names = known_partials(asked, worlds.now)
    variance, behind = _variances(worlds.now.predict(W, names)), telescopes_of(scene)
    rows = [
        QuantityShare(
            source=source,
            telescopes=behind.get(source, ()),
            share=np.array([one / all_ if all_ > 0.0 else 0.0 for one, all_ in zip(part, variance)]),
            share_total=float(part.sum() / variance.sum()) if variance.sum() > 0.0 else 0.0,
            sigma=_quantity_sigmas(part),
            remedies=remedies,
        )
        for source, part, remedies in _sources(worlds, W, names, _quantity_sigmas)
    ]
    return sorted(rows, key=lambda row: -row.share_total)


def _sources(
    worlds: Worlds, W: Array, names: Sequence[str], sigmas: Callable[[Array], Sigmas]
) -> Iterator[tuple[str, Array, Remedies[Sigmas]]]:
    """Each source with its part (d,) in the variances of w = W x, and what the sigmas would be with its remedies."""
    parts = _parts(worlds.now.predict(W, names))
    stack = np.array(list(parts.values()))

    def new_gain(remedy: str, source: str) -> Sigmas | None:
        """The sigmas in the world of a remedy; None where that world could not be solved."""
        estimate = worlds.then.get((remedy, source))
        return None if estimate is None else sigmas(_variances(estimate.predict(W, names)))

    for number, (source, part) in enumerate(parts.items()):
        vanished, halved = (
            Remedied(same_gain=sigmas(_same_gain(stack, number, size)), new_gain=new_gain(remedy, source))
            for remedy, size in REMEDIES.items()
        )
        unknown = Unknown(new_gain=new_gain(UNKNOWN, source)) if source in worlds.priors else None
        yield source, part, Remedies(if_vanished=vanished, if_halved=halved, if_unknown=unknown)


def _parts(whole: Prediction) -> dict[str, Array]:
    """The part (d,) of each source in the variance of each component."""
    return {source: np.sum(factor**2, axis=1) for source, factor in whole.factors.items()}


def _variances(whole: Prediction) -> Array:
    """Variance (d,) of each component."""
    total: Array = np.array(list(_parts(whole).values())).sum(axis=0)
    return total


def _same_gain(stack: Array, number: int, size: float) -> Array:
    """Variances (d,) when one source of `stack` (k, d) errs `size` times as much and nothing else changes: a sum."""
    weight = np.ones(len(stack))
    weight[number] = size**2
    total: Array = (weight[:, None] * stack).sum(axis=0)  # no difference: it would lose the small ones
    return total


def _state_sigmas(variances: Array) -> StateSigmas:
    return StateSigmas(
        position_km=float(np.sqrt(variances[:3].sum())), velocity_m_s=float(M_PER_KM * np.sqrt(variances[3:].sum()))
    )


def _quantity_sigmas(variances: Array) -> QuantitySigmas:
    return QuantitySigmas(each=np.sqrt(variances), total=float(np.sqrt(variances.sum())))


def _share(part: float, whole: float) -> float:
    """Share of variance."""
    return (part / whole) ** 2 if whole > 0.0 else 0.0


def _component_shares(part: Array, total: Array, names: Sequence[str]) -> dict[str, float]:
    """Share of a source in the variance of each parameter beside the state."""
    return {name: float(one / all_) if all_ > 0.0 else 0.0 for name, one, all_ in zip(names, part, total)}
