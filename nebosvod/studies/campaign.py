"""A validation campaign: many runs in chunks, each chunk one file; what is on disk is never computed again.

Runs, size and arithmetic of a chunk do not depend on who computes it (`studies/chunked`).
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.engine.assembly import computed_psi
from nebosvod.engine.trial import Estimating, Setting, generator, iterated, measured_truth, possible
from nebosvod.errors import InputError, OutputError
from nebosvod.estimation.accuracy.repeated import Innovations
from nebosvod.mission import Mission, load_mission
from nebosvod.observation import Observation
from nebosvod.results.ownership import sha256_of
from nebosvod.results.recognise import is_validation, read_json
from nebosvod.studies.chunked import ChunkedFolder, Kind
from nebosvod.version import __version__

Array = npt.NDArray[np.float64]
RECORD, RESULT = "campaign.json", "validation.json"
CHUNK_RUNS = {"linear": 50, "full": 10}
CHUNK_NUMBERS = 4_000_000  # residuals held at a time
NIS_ROWS = 20_000  # a pass over more measurements than these costs minutes and gigabytes: no NIS then


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """What fixes every run of a campaign; runs with one of these have one result."""

    mission: str
    mission_sha256: str
    inputs_sha256: tuple[str, ...]
    version: str
    seed: int
    mode: str
    chunk_runs: int

    @classmethod
    def of(cls, mission: Mission, seed: int, full: bool, rows: int) -> "Campaign":
        """The campaign of a mission with so many measurements."""
        mode = "full" if full else "linear"
        return cls(
            mission=str(mission.path.resolve()) if mission.path is not None else mission.name,
            mission_sha256=mission.sha256,
            inputs_sha256=tuple(sha256_of(path) for path in mission.input_files),
            version=__version__,
            seed=seed,
            mode=mode,
            chunk_runs=max(1, min(CHUNK_RUNS[mode], CHUNK_NUMBERS // max(2 * rows, 1))),
        )

    def same_runs(self, other: Mapping[str, Any]) -> bool:
        """Whether a stored campaign has the same runs; the mission may have moved to another path."""
        return bool(KIND.fixed(json.loads(json.dumps(asdict(self)))) == KIND.fixed(other))


KIND = Kind(
    noun="validation", campaign="campaign", record=RECORD, result=RESULT, ours=r"validation\.(json|html)",
    keys=tuple(Campaign.__slots__), labels=("mission",), unit="runs",
)  # fmt: skip


class CampaignFolder(ChunkedFolder):
    """Owner of a validation folder while it is filled.

    Raises
    ------
    OutputError
        When another process holds the folder, it holds another campaign, or the place cannot be written.
    """

    def __init__(self, folder: Path, campaign: Campaign, *, overwrite: bool = False) -> None:
        super().__init__(folder, KIND, asdict(campaign), campaign.chunk_runs, overwrite=overwrite)

    def refuse_smaller(self, runs: int) -> None:
        """Keep the result of more runs of this campaign from being replaced by that of fewer.

        Raises
        ------
        OutputError
            If the result that is there has more runs, and nobody said to overwrite it.
        """
        there = read_json(self.folder / RESULT).get("n_runs")
        if isinstance(there, int) and there > runs and not self.overwrite:
            raise OutputError(
                f"{self.folder}: holds this campaign with {there:,} runs, and {runs:,} would replace its result by a "
                f"smaller one; say --runs {there} or more, -o for another folder, or --overwrite to judge the first "
                f"{runs:,} alone (no run is thrown away)"
            )

    def recognised(self, path: Path) -> bool:
        """Whether a file that no record lists is a verdict or its page."""
        return is_validation(path)


def passes(setting: Setting) -> list[Innovations | None]:
    """The sequential pass of each estimator, where there is one; estimators that treat all alike share one.

    An estimator with a gain of its own has other innovations than these: none are judged for it.
    """
    made: dict[tuple[str, ...], Innovations | None] = {}
    found: list[Innovations | None] = []
    for one in setting.estimating:
        if one.repeated is None or one.base.n > NIS_ROWS:
            found.append(None)
            continue
        if one.treatments not in made:
            made[one.treatments] = Innovations.of(one.base)
        found.append(made[one.treatments])
    return found


def open_campaign(argument: Mapping[str, Any]) -> Callable[[int], dict[str, npt.NDArray[Any]]]:
    """Prepare a worker; the returned function computes one chunk."""
    campaign = Campaign(**argument["campaign"])
    mission = load_mission(campaign.mission)
    if mission.sha256 != campaign.mission_sha256:
        raise InputError(f"{campaign.mission}: the mission file changed while it was validated; start again")
    setting = Setting.of(mission)
    through = passes(setting)

    def work(number: int) -> dict[str, npt.NDArray[Any]]:
        first = number * campaign.chunk_runs
        return compute_chunk(setting, through, campaign, range(first, first + campaign.chunk_runs))

    return work


def compute_chunk(
    setting: Setting, through: Sequence[Innovations | None], campaign: Campaign, runs: range
) -> dict[str, npt.NDArray[Any]]:
    """Arrays of one chunk; for estimator k, rows by run.

    errors_k (N, s + s_j) estimate minus truth, and assumed minus true value of the parameters left out;
    nis_k (N, telescopes, 2) mean normalised square of the innovations, as believed and in truth;
    linear mode: check_k (N,) in the first run of a chunk, largest difference, in sigmas, to solving from the
    measurements on; full mode: mean_k, factor_true_k, factor_formal_k of each run's own estimate. Rows that failed are
    nan.

    Parameters
    ----------
    through : of `passes`.
    """
    make = _iterated if campaign.mode == "full" else _linear
    return make(setting, through, [generator(campaign.seed, i) for i in runs])


def _linear(
    setting: Setting, through: Sequence[Innovations | None], rngs: Sequence[np.random.Generator]
) -> dict[str, npt.NDArray[Any]]:
    """One linear step for each truth, with the factorisation and the innovations of the reference."""
    computed, observation = computed_psi(setting.nominal), setting.nominal.observation
    residuals = np.empty((len(rngs), *computed.shape))
    deviations: list[Mapping[str, float]] = []
    for row, rng in enumerate(rngs):
        residuals[row], deviation = measured_truth(setting, computed, rng)
        deviations.append(deviation)
    chunk: dict[str, npt.NDArray[Any]] = {}
    for k, (one, innovations) in enumerate(zip(setting.estimating, through)):
        if one.reference.solution is None:
            continue
        chunk[f"nis_{k}"] = _nis(observation, innovations, residuals, one.mean_residual())
        chunk |= {f"{name}_{k}": array for name, array in _estimated(one, residuals, deviations).items()}
    return chunk


def _estimated(one: Estimating, residuals: Array, truth: list[Mapping[str, float]]) -> dict[str, Array]:
    """Errors of linear estimates, and the check of the first by the estimator's own method."""
    reference = one.reference
    names = reference.names + reference.left_out
    means = one.means(residuals)
    found = np.array([reference.value(name) for name in reference.left_out])
    assumed = np.broadcast_to(found, (len(means), len(reference.left_out)))
    true = np.array([[row[name] for name in names] for row in truth])
    check = np.full(len(means), np.nan)
    sigma = np.linalg.norm(reference.S_formal, axis=1)
    # as large as the noise: what a prior of 1e12 km brings leaves too few digits to compare
    probe = residuals[0] * min(1.0, float(np.sqrt(np.mean(one.base.R) / np.mean(residuals[0] ** 2))))
    difference = np.abs(one.solved_anew(probe) - one.means(probe[None])[0])
    check[0] = np.max(difference / np.where(sigma > 0.0, sigma, 1.0))
    return {"errors": np.hstack([means, assumed]) - true, "check": check}


def _iterated(
    setting: Setting, through: Sequence[Innovations | None], rngs: Sequence[np.random.Generator]
) -> dict[str, npt.NDArray[Any]]:
    """Estimates iterated to convergence, each with its own covariances and the innovations at its own estimate.

    Estimators that treat all alike have one minimum, and so one set of innovations.
    """
    chunk: dict[str, npt.NDArray[Any]] = {}
    for k, one in enumerate(setting.estimating):
        if one.reference.solution is not None:
            chunk |= {f"{name}_{k}": array for name, array in _failed(setting, one, len(rngs)).items()}
    for row, rng in enumerate(rngs):
        truth, judged = possible(setting, rng), dict[tuple[str, ...], Array]()
        for k, (one, innovations) in enumerate(zip(setting.estimating, through)):
            trial = None if truth is None or one.reference.solution is None else iterated(setting, one, truth)
            if trial is None:
                continue
            for name in ("errors", "mean", "factor_true", "factor_formal"):
                chunk[f"{name}_{k}"][row] = getattr(trial, name)
            if innovations is not None:
                if one.treatments not in judged:
                    own = Innovations.of(trial.problem, innovations.first)
                    expected = one.mean_residual(trial.problem)
                    residuals = np.asarray(trial.problem.residual)[None]
                    judged[one.treatments] = _nis(setting.nominal.observation, own, residuals, expected)[0]
                chunk[f"nis_{k}"][row] = judged[one.treatments]
    return chunk


def _failed(setting: Setting, one: Estimating, runs: int) -> dict[str, Array]:
    """The arrays of an estimator before any run has given an estimate."""
    s, size = len(one.reference.names), len(one.reference.names + one.reference.left_out)
    shapes = {
        "errors": (size,),
        "mean": (size,),
        "factor_true": (size, size),
        "factor_formal": (size, s),
        "nis": (len(setting.nominal.observation.telescopes), 2),
    }
    return {name: np.full((runs, *shape), np.nan) for name, shape in shapes.items()}


def _nis(observation: Observation, through: Innovations | None, residuals: Array, expected: Array) -> Array:
    """Mean normalised square (N, telescopes, 2) of the innovations of each telescope over its components.

    Parameters
    ----------
    expected : (n, 2), mean that the residuals have in truth and the estimator does not know of.
    """
    out = np.full((len(residuals), len(observation.telescopes), 2), np.nan)
    if through is None:
        return out
    telescope = observation.telescope_index[through.first :]
    believed, true = through.squares(residuals)
    if expected.any():
        true = through.squares(residuals - expected)[1]
    for judge, squares in enumerate((believed, true)):
        for number in range(len(observation.telescopes)):
            mine = telescope == number
            if squares is not None and mine.any():
                out[:, number, judge] = squares[:, mine].mean(axis=1) / residuals.shape[2]
    return out
