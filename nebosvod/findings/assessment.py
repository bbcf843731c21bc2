"""Everything a run says about accuracy beyond the estimate: who is to blame, what is required, curves, five accuracies.

fits + predicted quantities (+ Monte Carlo samples) -> findings; `results/rows` makes rows of summary.json of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.engine.montecarlo import Sample
from nebosvod.engine.quantity import Quantity
from nebosvod.estimation import LinearProblem, Status
from nebosvod.findings import blame
from nebosvod.findings.blame import Kind, StateShare, Worlds, kind_of_problem, state_shares
from nebosvod.findings.comparison import Accuracies, comparison
from nebosvod.findings.curves import Curve, curves
from nebosvod.findings.doctor import Diagnosis, diagnose, most_complete
from nebosvod.findings.drawn import clones, impact_share, spread_of
from nebosvod.findings.foretold import Foretold
from nebosvod.findings.inside import Inside, inside
from nebosvod.findings.nonlinearity import Nonlinearity, nonlinearity
from nebosvod.findings.prediction import Answered, Prediction, of_fit
from nebosvod.findings.ratio import NoiseRatio, ratio
from nebosvod.findings.required import RequiredPosition, required
from nebosvod.findings.shifts import Shift, shifts
from nebosvod.findings.what_if import WhatIf, what_if
from nebosvod.mission.reading.cost import CLONES_MOST
from nebosvod.mission.slugs import array_name
from nebosvod.scene.point import View
from nebosvod.scene.scene import PlannedScene, Scene

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Findings:
    """What the estimates of a run are worth, and the arrays behind it.

    Attributes
    ----------
    budget : of the state, estimator by estimator.
    predictions : of every estimator, those that do not exist among them.
    required : how well positions of telescopes must be known; curves : of the leading estimator.
    accuracies : five of each component of each prediction.
    shifts : of the estimate and the predictions, by every source whose mean is not as assumed.
    inside : of the leading estimate, what the mission asks to see; None where that is nothing.
    diagnosis : what the residuals say to the estimator of least squares that leaves out least; None without one.
    what_if : the problem behind the predictions of the estimator that the report speaks of; None without predictions.
    """

    budget: tuple[StateShare, ...]
    predictions: tuple[Prediction, ...]
    noise_to_nuisance: NoiseRatio
    required: tuple[RequiredPosition, ...]
    curves: tuple[Curve, ...]
    accuracies: tuple[Accuracies, ...]
    shifts: tuple[Shift, ...]
    inside: Inside | None
    arrays: Mapping[str, Array]
    diagnosis: Diagnosis | None = None
    what_if: WhatIf | None = None


def assess(
    scene: PlannedScene,
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
    them, and the comparison has rows for the first of them. Curves, requirements and tests of the residuals are those
    of the first estimator that weighs by least squares all that was measured.
    """
    found = [fit for fit in fits if fit.estimate.solution is not None]
    predicted = {fit.estimator.name: foretold[fit.estimator.name].found for fit in found}
    worlds: dict[Kind, Worlds] = {}
    for fit in found:
        if kind_of_problem(fit) not in worlds:
            worlds[kind_of_problem(fit)] = Worlds.of(fit)
    own = {fit.estimator.name: replace(worlds[kind_of_problem(fit)], now=fit.estimate) for fit in found}
    different = [next(fit for fit in found if kind_of_problem(fit) == kind) for kind in worlds]
    against, ratio_arrays = ratio(scene, *(nominal or (fits[0].problem, fits[0].seen)))
    whole = [fit for fit in found if not fit.own_gain and not fit.limited]
    leading = next((fit for fit in whole if fit.problem.n <= blame.LARGE), None)
    told = predicted[leading.estimator.name] if leading is not None else []
    show = scene.mission.report.show
    shown = inside(scene, leading, told, show) if leading is not None and show else None
    rows, points = _predictions(scene, fits, foretold, own), dict[str, Array]()
    if found and samples:
        rows, points = _with_drawn(scene, found[0], predicted[found[0].estimator.name], rows, seed)
    five = tuple(comparison(scene, different, predicted, samples))
    asked = most_complete(whole)
    diagnosis = None if asked is None else diagnose(scene, asked, five)
    main = next((fit for fit in found if fit.status is Status.CONVERGED), None)
    kept = what_if(main, predicted[main.estimator.name]) if main and predicted[main.estimator.name] else None
    return Findings(
        budget=tuple(row for fit in found for row in state_shares(scene, fit, own[fit.estimator.name])),
        predictions=tuple(rows),
        noise_to_nuisance=against,
        required=tuple(required(scene, leading, told)) if leading is not None and told else (),
        curves=tuple(curves(leading, told)) if leading is not None and told else (),
        accuracies=five,
        shifts=tuple(row for fit in found for row in shifts(fit, predicted[fit.estimator.name])),
        inside=shown,
        arrays=ratio_arrays | points | _arrays(shown, diagnosis) | (dict(kept.arrays) if kept else {}),
        diagnosis=diagnosis,
        what_if=kept,
    )


def _arrays(shown: Inside | None, diagnosis: Diagnosis | None) -> dict[str, Array]:
    """Arrays of what is there only for some missions."""
    inner = {} if shown is None else dict(shown.arrays)
    return inner | ({} if diagnosis is None else dict(diagnosis.biases.arrays))


def _with_drawn(
    scene: PlannedScene, fit: Fit, asked: Sequence[Quantity], rows: Sequence[Prediction], seed: int
) -> tuple[list[Prediction], dict[str, Array]]:
    """The predictions with what orbits drawn from the error of one estimate do, propagated in full; and the points."""
    plan = scene.mission.monte_carlo
    points, fates = clones(scene, fit, asked, min(plan.runs if plan else 0, CLONES_MOST), seed)
    of_name = {one.request.name: (one, found, fate) for one, found, fate in zip(asked, points, fates)}
    told: list[Prediction] = []
    for row in rows:
        if row.estimator != fit.estimator.name or not isinstance(row, Answered):
            told.append(row)
            continue
        one, found, fate = of_name[row.request.name]
        spread = spread_of(one, found, row.factor, row.mean_error)
        hits = None if row.impact_probability is None else impact_share(fate)
        told.append(replace(row, drawn=spread, drawn_impacts=hits))
    arrays = {f"clones_{array_name(one.request.name)}_{one.unit}": found for one, found in zip(asked, points)}
    known = (row.request.name for row in told if isinstance(row, Answered) and row.drawn_impacts is not None)
    return told, arrays | {f"hits_{array_name(name)}": of_name[name][2] for name in known}


def _predictions(
    scene: Scene, fits: Sequence[Fit], foretold: Mapping[str, Foretold], own: Mapping[str, Worlds]
) -> list[Prediction]:
    """The predictions of every estimator, those that do not exist among them; curvature once for each accuracy."""
    rows: list[Prediction] = []
    bent: dict[tuple[Kind, tuple[str, ...]], list[Nonlinearity]] = {}
    for fit in fits:
        found, missing = foretold[fit.estimator.name]
        alike = (kind_of_problem(fit), tuple(asked.request.name for asked in found))
        if found and alike not in bent:
            bent[alike] = nonlinearity(scene, fit, found)
        rows += of_fit(scene, fit, own.get(fit.estimator.name), found, missing, bent.get(alike, []))
    return rows
