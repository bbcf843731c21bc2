"""Who is to blame: the share of each source in a number, and what would be gained if its error vanished or halved.

Both answers are given: with the gain as it is (only the error shrinks; nothing is estimated anew) and with the gain
re-optimised (the estimator knows and weighs anew: a new solve; never worse for an estimator that leaves nothing out,
while one that ignores or considers a source may come to trust the wrong one). Shares of variance add up to one; the
gains of several remedies do not.

A prior is a source of error too, and its error vanishes where the orbit, or the parameter, is known exactly. What there
would be without the prior, nothing being known beforehand, is the opposite and stands beside it: `if_unknown`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import SOLVERS, Fit
from nebosvod.engine.quantity import M_PER_KM, Quantity, known_partials
from nebosvod.estimation import Block, Estimate, Markov, Prediction, White
from nebosvod.estimation.accuracy import budget
from nebosvod.estimation.solvers import batch
from nebosvod.scene.prior import STATE_NAMES
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


def kind_of_problem(fit: Fit) -> tuple[tuple[str, str], ...]:
    """What decides the accuracy of a fit: its gain, and the treatment of everything; one of these, one budget."""
    groups: tuple[Block | White | Markov, ...] = (*fit.problem.blocks, *fit.problem.white, *fit.problem.markov)
    gain = fit.estimator.method if fit.own_gain else "least squares"
    return (("gain", gain), *((group.name, group.treatment) for group in groups))


def telescopes_of(scene: Scene) -> dict[str, tuple[str, ...]]:
    """The telescopes behind each source of the budget; sources of the object and the prior have none."""
    noise = {f"measurement noise {telescope.name}": (telescope.name,) for telescope in scene.telescopes}
    return noise | {name: source.telescopes for name, source in scene.sources.items()}


def state_rows(scene: Scene, fit: Fit, worlds: Worlds) -> list[dict[str, Any]]:
    """The `budget` of one estimator: each source's part of the state, largest share of position first."""
    whole = worlds.now.predict(np.eye(6), STATE_NAMES)
    others = [name for name in worlds.now.names if name not in STATE_NAMES]
    own = _parts(worlds.now.predict(np.eye(len(others)), others)) if others else None
    own_total = np.sum(list(own.values()), axis=0) if own else np.zeros(0)
    total = _state_sigmas(_variances(whole))
    behind = telescopes_of(scene)
    parts = _parts(whole)
    stack = np.array(list(parts.values()))
    rows = []
    for number, (source, alone) in enumerate(parts.items()):
        part = _state_sigmas(alone)
        row: dict[str, Any] = {
            "estimator": fit.estimator.name,
            "source": source,
            "telescopes": list(behind.get(source, ())),
            **part,
            "share_position": _share(part["sigma_position_km"], total["sigma_position_km"]),
            "share_velocity": _share(part["sigma_velocity_m_s"], total["sigma_velocity_m_s"]),
            "share_parameters": {} if own is None else _component_shares(own[source], own_total, others),
        }
        for remedy, size in REMEDIES.items():
            row[remedy] = _both(
                _state_sigmas(_same_gain(stack, number, size)),
                _new_gain(worlds, remedy, source, np.eye(6), STATE_NAMES, _state_sigmas),
            )
        row[UNKNOWN] = _unknown(worlds, source, np.eye(6), STATE_NAMES, _state_sigmas, tuple(part))
        rows.append(row)
    return sorted(rows, key=lambda row: -row["share_position"])


def prediction_rows(scene: Scene, worlds: Worlds, asked: Quantity) -> list[dict[str, Any]]:
    """The `budget` of a predicted quantity, largest share of the summed variance first."""
    W, names = known_partials(asked, worlds.now)
    whole = worlds.now.predict(W, names)
    variance = _variances(whole)
    behind, unit = telescopes_of(scene), asked.unit

    def sigmas(variances: Array) -> dict[str, Any]:
        return {
            f"sigma_{unit}": np.sqrt(variances).tolist(),
            f"sigma_total_{unit}": float(np.sqrt(variances.sum())),
        }

    parts = _parts(whole)
    stack = np.array(list(parts.values()))
    rows = []
    for number, (source, part) in enumerate(parts.items()):
        row: dict[str, Any] = {
            "source": source,
            "telescopes": list(behind.get(source, ())),
            "share": [float(one / all_) if all_ > 0.0 else 0.0 for one, all_ in zip(part, variance)],
            "share_total": float(part.sum() / variance.sum()) if variance.sum() > 0.0 else 0.0,
            **sigmas(part),
        }
        for remedy, size in REMEDIES.items():
            same = sigmas(_same_gain(stack, number, size))
            row[remedy] = _both(same, _new_gain(worlds, remedy, source, W, names, sigmas))
        row[UNKNOWN] = _unknown(worlds, source, W, names, sigmas, tuple(sigmas(part)))
        rows.append(row)
    return sorted(rows, key=lambda row: -row["share_total"])


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


def _new_gain(
    worlds: Worlds, remedy: str, source: str, W: Array, names: Sequence[str], sigmas: Any
) -> dict[str, Any] | None:
    """The sigmas in the world of a remedy; None where that world could not be solved."""
    estimate = worlds.then.get((remedy, source))
    return None if estimate is None else dict(sigmas(_variances(estimate.predict(W, names))))


def _unknown(
    worlds: Worlds, source: str, W: Array, names: Sequence[str], sigmas: Any, keys: Sequence[str]
) -> dict[str, Any] | None:
    """The sigmas without a prior, null where they are not observable or not solved; None for any other source."""
    if source not in worlds.priors:
        return None
    new = _new_gain(worlds, UNKNOWN, source, W, names, sigmas)
    return {f"{key}_new_gain": None if new is None else new[key] for key in keys}


def _both(same: Mapping[str, Any], new: Mapping[str, Any] | None) -> dict[str, Any]:
    """The two answers side by side, the key saying which."""
    return {f"{key}_same_gain": value for key, value in same.items()} | {
        f"{key}_new_gain": None if new is None else new[key] for key in same
    }


def _state_sigmas(variances: Array) -> dict[str, float]:
    """Root traces of position and velocity."""
    return {
        "sigma_position_km": float(np.sqrt(variances[:3].sum())),
        "sigma_velocity_m_s": float(M_PER_KM * np.sqrt(variances[3:].sum())),
    }


def _share(part: float, whole: float) -> float:
    """Share of variance."""
    return (part / whole) ** 2 if whole > 0.0 else 0.0


def _component_shares(part: Array, total: Array, names: Sequence[str]) -> dict[str, float]:
    """Share of a source in the variance of each parameter beside the state."""
    return {name: float(one / all_) if all_ > 0.0 else 0.0 for name, one, all_ in zip(names, part, total)}
