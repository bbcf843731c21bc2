"""`nebosvod validate`: the whole chain on simulated truths, and whether its covariances can be believed.

linear mode: the orbit of each truth is linear about the reference orbit (Phi, zeta), measured through the full
geometry, and estimated in one step with the partials of the reference orbit; judged by the covariance there.
full mode: each truth is propagated with its own parameters, estimated by Gauss-Newton from the reference orbit to
convergence, and judged by the covariance its own estimate reports. A covariance that is right must pass both; the
first serves where the second-order terms are small (`nebosvod.engine.trial.second_order`), and is not used where they
are not.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.borders.wholefile import refuse_link
from nebosvod.engine.trial import LINEAR_SIGMA, Estimating, Setting, second_order
from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation import Block, Markov, White
from nebosvod.estimation.accuracy.repeated import first_determined
from nebosvod.findings.foretold import predicted
from nebosvod.mission import Mission
from nebosvod.mission.reading.cost import MAX_RUNS
from nebosvod.mission.reading.reader import require_mission
from nebosvod.mission.request import OWN_GAIN
from nebosvod.mission.vocabulary import PLANES
from nebosvod.results.result import json_text
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.studies.campaign import NIS_ROWS, RESULT, Campaign, CampaignFolder
from nebosvod.studies.outcomes import Direction
from nebosvod.studies.trust import Claim, Judgement, judge
from nebosvod.studies.verdict_rows import judgement
from nebosvod.tasks.engine import Workers, run_tasks
from nebosvod.version import __version__

Array = npt.NDArray[np.float64]
SCHEMA_VERSION = 1
FAMILY_LEVEL = 0.01
ALLOWED_FAILURES = 0.01  # of runs without convergence, before the campaign itself fails
AGREEMENT_SIGMA = 1e-6  # between one factorisation for all runs and the estimator's own method
MIN_RUNS = 20
FEWEST = 2  # estimates that can be judged: a scatter needs two
AXES = ("radially", "along the track", "normal to the orbit plane")
MODES = {
    "linear": "truths linear about the reference orbit, measured through the full geometry, estimated with one "
    "factorisation of the problem at the reference orbit and judged by the covariance there",
    "full": "truths propagated with their own parameters, estimated by Gauss-Newton to convergence, each judged by the "
    "covariance and the innovations of its own estimate",
}


def validate(
    mission: Mission,
    folder: Path,
    *,
    runs: int,
    seed: int = 0,
    workers: int | Workers = 1,
    full: bool = False,
    overwrite: bool = False,
    progress: Callable[[int, int], None] = lambda done, runs: None,
    say: Callable[[str], None] = lambda message: None,
) -> dict[str, Any]:
    """Run or continue a validation campaign in `folder`; returns what validation.json holds.

    Parameters
    ----------
    runs : simulated truths; every estimator of the mission sees the same ones.
    full : iterate every estimate even where the linear step would do.
    workers : processes, or who computes; the result does not depend on them.
    progress : called with the runs that are done and all runs.
    say : called with a sentence for each stored file that was changed since it was written.

    Raises
    ------
    InputError
        If there are too few or too many runs.
    GeometryError
        If no estimator of the mission can observe the state.
    OutputError
        If the folder holds another campaign, or this one with more runs, and it is not to be overwritten.
    """
    require_mission(mission, "validate")
    if not MIN_RUNS <= runs <= MAX_RUNS:
        raise InputError(
            f"--runs: {runs:,} is out of range (allowed {MIN_RUNS} to {MAX_RUNS:,}); 2000 see a sigma wrong by 6 %"
        )
    if folder.is_symlink():
        refuse_link(folder, folder.lstat().st_mode)
    setting = Setting.of(mission)
    _require_observable(setting)
    left_out = second_order(setting, seed)
    full = full or left_out > LINEAR_SIGMA
    campaign = Campaign.of(mission, seed, full, setting.nominal.observation.t_s.size)
    with CampaignFolder(folder, campaign, overwrite=overwrite) as held:
        held.refuse_smaller(runs)
        missing = held.missing(runs)
        for sentence in held.changed(missing):
            say(sentence)
        finished = held.chunks(runs) - len(missing)
        progress(min(runs, finished * campaign.chunk_runs), runs)

        def keep(task: int, arrays: Any) -> None:
            nonlocal finished
            held.keep(task, arrays)
            finished += 1
            progress(min(runs, finished * campaign.chunk_runs), runs)

        who = workers if isinstance(workers, Workers) else Workers(count=workers)
        run_tasks("nebosvod.studies.campaign:open_campaign", {"campaign": asdict(campaign)}, missing, who, keep)
        found = summary(setting, campaign, runs, held.collected(runs), left_out)
        held.publish({RESULT: json_text(found).encode("utf-8")})
    return found


def _require_observable(setting: Setting) -> None:
    """Something must be there to judge."""
    if all(one.reference.solution is None for one in setting.estimating):
        first = setting.estimating[0].reference
        raise GeometryError(
            f"{setting.scene.mission.name}: nothing to validate: {first.message}",
            rank=first.rank,
            weak_direction=first.weak_direction,
        )


def summary(
    setting: Setting, campaign: Campaign, runs: int, arrays: dict[str, npt.NDArray[Any]], left_out: float
) -> dict[str, Any]:
    """What validation.json holds: no time, no path, no count of workers in it.

    Parameters
    ----------
    left_out : what the linear step leaves out, in sigmas.
    """
    mission = setting.scene.mission
    level = FAMILY_LEVEL / len(setting.estimating)
    found = [_estimator(setting, k, arrays, campaign.mode, level) for k in range(len(setting.estimating))]
    passed = all(one.passed for one in found)
    return {
        "schema_version": SCHEMA_VERSION,
        "mission": mission.name,
        "title": mission.title or mission.name,
        "object": mission.object.name,
        "reference_epoch_tdb": setting.scene.epoch.iso(),
        "n_observations": int(setting.nominal.observation.t_s.size),
        "telescopes": [telescope.name for telescope in setting.nominal.observation.telescopes],
        "versions": {"nebosvod": __version__, "numpy": np.__version__},
        "mission_sha256": campaign.mission_sha256,
        "seed": campaign.seed,
        "n_runs": runs,
        "mode": campaign.mode,
        "method": MODES[campaign.mode],
        "second_order_sigma": left_out if np.isfinite(left_out) else None,
        "family_level": FAMILY_LEVEL,
        "passed": passed,
        "verdict": _overall(found, passed),
        "estimators": [_row(one) for one in found],
    }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EstimatorVerdict:
    """One estimator judged.

    Attributes
    ----------
    left_out : sources it considers or ignores. claims_formal : whether K_formal is its own claim all the same.
    n_failed : runs that gave no estimate.
    check_sigma : largest difference between one factorisation for all runs and its own method; None where not made.
    judged : by the covariance on trial, "true" and "formal"; empty where nothing could be judged.
    reason : why it did not pass; empty if it did.
    """

    name: str
    method: str
    status: str
    left_out: tuple[str, ...]
    claims_formal: bool
    n_failed: int = 0
    check_sigma: float | None = None
    judged: Mapping[str, Judgement] = field(default_factory=dict)
    reason: str = ""

    @property
    def passed(self) -> bool:
        """Whether its claims hold."""
        return not self.reason

    def claims(self, covariance: str) -> bool:
        """Whether a covariance, "true" or "formal", is one that it vouches for."""
        return covariance == "true" or self.claims_formal


def _row(found: EstimatorVerdict) -> dict[str, Any]:
    """One entry of `estimators`."""
    return {
        "name": found.name,
        "method": found.method,
        "status": found.status,
        "left_out": list(found.left_out),
        "claims_formal": found.claims_formal,
        "n_failed": found.n_failed,
        "check_sigma": found.check_sigma,
        "judged": {name: {"claimed": found.claims(name), **judgement(one)} for name, one in found.judged.items()},
        "passed": found.passed,
        "reason": found.reason,
    }


def _estimator(
    setting: Setting, k: int, arrays: dict[str, npt.NDArray[Any]], mode: str, level: float
) -> EstimatorVerdict:
    """One estimator judged with K_true and with K_formal."""
    one = setting.estimating[k]
    left_out = sources_left_out(one)
    found = EstimatorVerdict(
        name=one.estimator.name,
        method=one.estimator.method,
        status=str(one.reference.status),
        left_out=tuple(left_out),
        # the K_formal of an estimator with a gain of its own is its whole claim, whatever is left out
        claims_formal=not left_out or one.estimator.method in OWN_GAIN,
    )
    if one.reference.solution is None:
        return replace(found, reason=one.reference.message)
    errors = arrays[f"errors_{k}"]
    good = np.isfinite(errors).all(axis=1)
    check = arrays[f"check_{k}"] if mode == "linear" else np.zeros(0)
    own = {name: value[good] for name, value in _own(arrays, k).items()}
    found = replace(
        found,
        n_failed=int((~good).sum()),
        check_sigma=float(np.nanmax(check)) if np.isfinite(check).any() else None,
        judged=_judged(setting, one, own, level) if np.count_nonzero(good) >= FEWEST else {},
    )
    return replace(found, reason=_reason(found, len(errors)))


def _own(arrays: dict[str, npt.NDArray[Any]], k: int) -> dict[str, npt.NDArray[Any]]:
    """The arrays of one estimator, without its number."""
    return {name.rsplit("_", 1)[0]: array for name, array in arrays.items() if name.rsplit("_", 1)[1] == str(k)}


def _reason(found: EstimatorVerdict, runs: int) -> str:
    """Why an estimator did not pass; empty if it did."""
    if found.n_failed > ALLOWED_FAILURES * runs:
        return f"{found.n_failed} of {runs} runs gave no estimate"
    if found.check_sigma is not None and found.check_sigma > AGREEMENT_SIGMA:
        return f"its own method and one factorisation for all runs differ by {found.check_sigma:.2g} sigma"
    for name, judged in found.judged.items():
        if found.claims(name) and not judged.consistent:
            return f"by its {name} covariance, {judged.verdict}"
    return ""


def sources_left_out(one: Estimating) -> list[str]:
    """Names of the sources of error the estimator considers or ignores, or that are not what it assumes."""
    problem = one.base
    groups: tuple[Block | White | Markov, ...] = (*problem.blocks, *problem.white, *problem.markov)
    found = [group.name for group in groups if group.treatment in ("considered", "ignored")]
    found += [white.name for white in problem.white if white.true_Q is not None]
    found += [markov.name for markov in problem.markov if markov.differs]
    found += [prior.name for prior in problem.priors if prior.true_covariance is not None]
    found += problem.noise_names if problem.true_R is not None else ()
    found += one.mean_errors.fresh
    found += [prior.name for prior in problem.priors if set(prior.names) & set(one.mean_errors.common)]
    return list(dict.fromkeys(found))


def _judged(setting: Setting, one: Estimating, own: dict[str, npt.NDArray[Any]], level: float) -> dict[str, Judgement]:
    """Verdicts by the covariance on trial: true, formal."""
    reference, telescopes = one.reference, setting.nominal.observation.telescopes
    names, left_out = reference.names + reference.left_out, sources_left_out(one)
    formal = np.vstack([reference.S_formal, np.zeros((len(reference.left_out), reference.S_formal.shape[1]))])
    factors = {"true": own.get("factor_true", reference.factor(names)), "formal": own.get("factor_formal", formal)}
    components = _innovation_components(setting, one)
    rows = directions(setting, names)
    state = np.array([row.weights for row in rows[: len(STATE_NAMES)]])
    mean = own.get("mean", one.mean(names))
    spread = {"true": own["errors"] - mean, "formal": own["errors"]}  # K_formal knows of no mean error
    judged = {}
    for column, name in ((1, "true"), (0, "formal")):
        claim = Claim(
            factor=factors[name],
            nis=own["nis"][:, :, column],
            nis_components=components,
            independent=name == "formal" or not left_out,
        )
        judged[name] = judge(spread[name], claim, rows, state, [t.name for t in telescopes], level)
    return judged


def _innovation_components(setting: Setting, one: Estimating) -> Array:
    """How many components the innovations of each telescope have."""
    index = setting.nominal.observation.telescope_index
    count = len(setting.nominal.observation.telescopes)
    first = first_determined(one.base) if index.size <= NIS_ROWS else None
    used = index[index.size if first is None else first :]
    return one.base.p * np.bincount(used, minlength=count).astype(np.float64)


def directions(setting: Setting, names: tuple[str, ...]) -> list[Direction]:
    """Every direction a reader has a word for: radial, transverse, normal; parameters; predictions.

    A mass that a density and an uncertain radius make is none: it goes with the cube of the radius, and a sigma of the
    first order does not describe what is drawn of it.
    """
    place = {name: index for index, name in enumerate(names)}
    unit = np.eye(len(names))
    x = setting.scene.state
    radial = x[:3] / np.linalg.norm(x[:3])
    normal = np.cross(x[:3], x[3:])
    normal /= np.linalg.norm(normal)
    axes = (radial, np.cross(normal, radial), normal)
    found = []
    for group, which, size in (("position", STATE_NAMES[:3], "km"), ("velocity", STATE_NAMES[3:], "km/s")):
        basis = unit[[place[name] for name in which]]
        found += [Direction(group=group, name=name, unit=size, weights=axis @ basis) for name, axis in zip(AXES, axes)]
    found += [
        Direction(group="parameter", name=name, unit="", weights=unit[place[name]])
        for name in names
        if name not in STATE_NAMES and not (name == "mass_kg" and setting.priors.by_density)
    ]
    return found + _predicted(setting, names)


def _predicted(setting: Setting, names: tuple[str, ...]) -> list[Direction]:
    """The components of every prediction of the mission."""
    found = []
    for asked in predicted(setting.scene, setting.scene.trajectory, setting.scene.mission.predictions).found:
        request = asked.request
        labels = PLANES[request.plane].components
        for k, row in enumerate(asked.partials_by(names)):
            label = labels[k] if k < len(labels) else f"component {k + 1}"
            found.append(Direction(group=request.name, name=label, unit=asked.unit, weights=row))
    return found


def _overall(found: Sequence[EstimatorVerdict], passed: bool) -> str:
    """The whole campaign in one sentence."""
    if not passed:
        return "; ".join(f"{one.name} fails: {one.reason}" for one in found if not one.passed)
    caught = [one.name for one in found if not one.claims_formal and not one.judged["formal"].consistent]
    said = "every estimator that claims honesty keeps its word"
    return said + (f"; the formal sigmas of {', '.join(caught)} are wrong, as they must be" if caught else "")
