"""Everything a run says about accuracy beyond the estimate: who is to blame, what is required, curves, five accuracies.

fits + predicted quantities (+ Monte Carlo samples) -> findings, rows ready for summary.json.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.engine.montecarlo import Sample
from nebosvod.engine.quantity import Quantity, known_partials, prediction_row
from nebosvod.estimation import LinearProblem
from nebosvod.findings import blame
from nebosvod.findings.blame import Worlds, kind_of_problem, prediction_rows, state_rows
from nebosvod.findings.comparison import comparison
from nebosvod.findings.curves import curves
from nebosvod.findings.foretold import Foretold, in_order, unanswered_row
from nebosvod.findings.nonlinearity import clones, impact_share, nonlinearity, spread_of
from nebosvod.findings.ratio import ratio
from nebosvod.findings.required import required
from nebosvod.mission.reading.cost import CLONES_MOST
from nebosvod.mission.slugs import array_name
from nebosvod.scene.point import View
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Findings:
    """Blocks of summary.json, and the arrays behind them."""

    budget: list[dict[str, Any]]
    predictions: list[dict[str, Any]]
    noise_to_nuisance: dict[str, Any]
    curves: list[dict[str, Any]]
    accuracy_comparison: dict[str, Any]
    arrays: dict[str, Array]


def assess(
    scene: Scene,
    fits: Sequence[Fit],
    foretold: Mapping[str, Foretold],
    samples: Mapping[str, Sample],
    seed: int = 0,
    nominal: tuple[LinearProblem, View] | None = None,
) -> Findings:
    """Take the accuracy of every estimator apart.

    Parameters
    ----------
    foretold : predictions by estimator, those that exist for its orbit and those that do not.
    samples : Monte Carlo samples by estimator, empty without Monte Carlo.
    seed : of the orbits drawn about the first estimate, as many as its sample has runs (at most CLONES_MOST).
    nominal : problem and view at the nominal point, for the ratio of noise to nuisance; of the first fit if absent.

    Notes
    -----
    Estimators with the same treatment of everything have one accuracy: worlds without a source are solved once for
    them, and the comparison has rows for the first of them. Curves and requirements are those of the first estimator
    that weighs by least squares.
    """
    found = [fit for fit in fits if fit.estimate.solution is not None]
    predicted = {fit.estimator.name: foretold[fit.estimator.name].found for fit in found}
    worlds: dict[Any, Worlds] = {}
    for fit in found:
        if kind_of_problem(fit) not in worlds:
            worlds[kind_of_problem(fit)] = Worlds.of(fit)
    own = {fit.estimator.name: replace(worlds[kind_of_problem(fit)], now=fit.estimate) for fit in found}
    different = [next(fit for fit in found if kind_of_problem(fit) == kind) for kind in worlds]
    against, ratio_arrays = ratio(scene, *(nominal or (fits[0].problem, fits[0].seen)))
    leading = next((fit for fit in found if fit.problem.n <= blame.LARGE and not fit.own_gain), None)
    against["required_position"] = []
    told = predicted[leading.estimator.name] if leading is not None else []
    if leading is not None and told:
        against["required_position"] = required(scene, leading, told)
    rows = _prediction_rows(scene, fits, foretold, own)
    drawn = _drawn(scene, found[0], predicted[found[0].estimator.name], rows, seed) if found and samples else {}
    return Findings(
        budget=[row for fit in found for row in state_rows(scene, fit, own[fit.estimator.name])],
        predictions=rows,
        noise_to_nuisance=against,
        curves=curves(leading, told) if leading is not None and told else [],
        accuracy_comparison=comparison(scene, different, predicted, samples),
        arrays=ratio_arrays | drawn,
    )


def _drawn(
    scene: Scene, fit: Fit, asked: Sequence[Quantity], rows: list[dict[str, Any]], seed: int
) -> dict[str, Array]:
    """Orbits drawn from the error of one estimate, propagated in full: points as arrays, facts into the rows."""
    plan = scene.mission.monte_carlo
    points, fates = clones(scene, fit, asked, min(plan.runs if plan else 0, CLONES_MOST), seed)
    mine = {row["name"]: row for row in rows if row["estimator"] == fit.estimator.name}
    for one, found, fate in zip(asked, points, fates):
        row, (W, names) = mine[one.request.name], known_partials(one, fit.estimate)
        row["monte_carlo"] = spread_of(one, found, fit.estimate.predict(W, names).factor, fit.mean_error(W, names))
        if "impact_probability_linear" in row:
            row["impact_probability_monte_carlo"] = impact_share(fate)
    return {f"clones_{array_name(one.request.name)}_{one.unit}": found for one, found in zip(asked, points)}


def _prediction_rows(
    scene: Scene, fits: Sequence[Fit], foretold: Mapping[str, Foretold], own: Mapping[str, Worlds]
) -> list[dict[str, Any]]:
    """The predictions of every estimator, those that do not exist among them; curvature once for each accuracy."""
    rows: list[dict[str, Any]] = []
    bent: dict[Any, list[dict[str, Any]]] = {}
    for fit in fits:
        name = fit.estimator.name
        found, missing = foretold[name]
        solved = fit.estimate.solution is not None
        mine = [unanswered_row(one, fit.estimate if solved else None, name, fit.mean_errors) for one in missing]
        if found:
            alike = (kind_of_problem(fit), tuple(asked.request.name for asked in found))
            if alike not in bent:
                bent[alike] = nonlinearity(scene, fit, found)
            mine += [
                prediction_row(
                    asked, fit.estimate, name, prediction_rows(scene, own[name], asked), curved, fit.mean_errors
                )
                for asked, curved in zip(found, bent[alike])
            ]
        rows += in_order(mine, scene.mission.predictions)
    return rows
