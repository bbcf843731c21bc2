"""A validation campaign: many runs in chunks, each chunk one file; what is on disk is never computed again.

The chunk is the unit of work and of safety: its runs, its size and its arithmetic do not depend on who computes it,
so an interrupted campaign continues to the same bytes, with any number of workers.
"""

import json
import math
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.borders.wholefile import FRESH, reason, refuse_link, require_place, write_whole
from nebosvod.engine.assembly import computed_psi
from nebosvod.engine.trial import Estimating, Setting, generator, iterated, measured_truth, possible
from nebosvod.errors import InputError, OutputError, listed
from nebosvod.estimation.accuracy.repeated import Innovations
from nebosvod.mission import Mission, load_mission
from nebosvod.observation import Observation
from nebosvod.results.lock import Lock
from nebosvod.results.ownership import MARK, files_in, is_regular, marked, sha256_of
from nebosvod.results.recognise import is_validation, read_json
from nebosvod.studies.chunk import CHUNKS, KEPT, chunk_path, read_chunk, write_chunk
from nebosvod.version import __version__

Array = npt.NDArray[np.float64]
RECORD, RESULT = "campaign.json", "validation.json"
OURS = re.compile(r"campaign\.json|validation\.(json|html)|chunks/\d{6,}\.npz")
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
        return self.fixed() == _fixed(other)

    def fixed(self) -> dict[str, Any]:
        """What fixes the runs, as JSON keeps it."""
        found: dict[str, Any] = json.loads(json.dumps(_fixed(asdict(self))))
        return found


class CampaignFolder:
    """Owner of a validation folder while it is filled: lock, campaign.json, chunks, the result.

    Raises
    ------
    OutputError
        When another process holds the folder, it holds another campaign, or the place cannot be written.
    """

    def __init__(self, folder: Path, campaign: Campaign, *, overwrite: bool = False) -> None:
        self.folder, self.campaign, self._overwrite = folder, campaign, overwrite
        self._absolute = Path(os.path.abspath(folder))
        self._lock = Lock(self._absolute, folder, "another validation")

    def __enter__(self) -> "CampaignFolder":
        try:
            if self._absolute.is_symlink():
                refuse_link(self.folder, self._absolute.lstat().st_mode)
            self._absolute.parent.mkdir(parents=True, exist_ok=True)
            with ExitStack() as held:
                held.enter_context(self._lock)
                self._open()
                held.pop_all()
        except OSError as error:
            raise OutputError(f"{self.folder}: cannot write here: {reason(error)}; choose another with -o") from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.__exit__(kind, error, trace)

    def missing(self, runs: int) -> list[int]:
        """Numbers of the chunks of `runs` runs that are not on disk whole."""
        fixed = self.campaign.fixed()
        return [i for i in range(self.chunks(runs)) if read_chunk(self.folder, i, fixed) is None]

    def changed(self, missing: Iterable[int]) -> list[str]:
        """A sentence for each file that is there, and not as this campaign wrote it."""
        said = [
            f"{path}: is damaged, was changed, or belongs to another campaign: its runs are computed again"
            for path in (chunk_path(self.folder, number) for number in missing)
            if os.path.lexists(path)
        ]
        result = self.folder / RESULT
        written = hashes_listed(read_json(self.folder / RECORD)).get(RESULT)
        if written is not None and result.exists() and sha256_of(result) != written:
            said.append(f"{result}: changed since the program wrote it (another sha256); it is made again")
        return said

    def refuse_smaller(self, runs: int) -> None:
        """Keep the result of more runs of this campaign from being replaced by that of fewer.

        Raises
        ------
        OutputError
            If the result that is there has more runs, and nobody said to overwrite it.
        """
        there = read_json(self.folder / RESULT).get("n_runs")
        if isinstance(there, int) and there > runs and not self._overwrite:
            raise OutputError(
                f"{self.folder}: holds this campaign with {there:,} runs, and {runs:,} would replace its result by a "
                f"smaller one; say --runs {there} or more, -o for another folder, or --overwrite to judge the first "
                f"{runs:,} alone (no run is thrown away)"
            )

    def chunks(self, runs: int) -> int:
        """How many chunks hold so many runs; the last one may have more than are asked for."""
        return math.ceil(runs / self.campaign.chunk_runs)

    def collected(self, runs: int) -> dict[str, npt.NDArray[Any]]:
        """The arrays of the first `runs` runs, joined along the first axis."""
        fixed = self.campaign.fixed()
        parts = [read_chunk(self.folder, i, fixed) for i in range(self.chunks(runs))]
        whole = [part for part in parts if part is not None]
        return {name: np.concatenate([part[name] for part in whole])[:runs] for name in whole[0]}

    def keep(self, number: int, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Write a chunk that was computed."""
        write_chunk(self.folder, number, self.campaign.fixed(), arrays)

    def publish(self, text: str) -> Path:
        """Write validation.json in one step, and what this campaign has written with its hashes; returns its path."""
        path = write_whole(self.folder / RESULT, text.encode("utf-8"), KEPT)
        self._record()
        return path

    def _record(self) -> None:
        """Write campaign.json: what fixes the runs, and the list of the files that are there."""
        files = {name: sha256_of(path) for name, path in files_in(self.folder) if _ours(name)}
        record = marked({**asdict(self.campaign), "outputs_sha256": files})
        write_whole(self.folder / RECORD, (json.dumps(record, indent=1) + "\n").encode("utf-8"), KEPT)

    def _open(self) -> None:
        record: dict[str, Any] = {}
        if self.folder.exists() and any(self.folder.iterdir()):
            record = read_json(self.folder / RECORD)
            if not _is_campaign(record):
                raise OutputError(f"{self.folder}: exists and is not a validation folder; choose another with -o")
            self._refuse_strangers()
            if not self.campaign.same_runs(record):
                self._begin_anew(record)
        (self.folder / CHUNKS).mkdir(parents=True, exist_ok=True)
        for left in (self.folder / CHUNKS).iterdir():
            if FRESH.fullmatch(left.name) and is_regular(left):
                left.unlink()
        if not self.campaign.same_runs(record):
            self._record()

    def _refuse_strangers(self) -> None:
        """Nothing with the name of a file of ours may be a link, a folder or a device."""
        chunks = self.folder / CHUNKS
        if chunks.is_symlink() or (chunks.exists() and not chunks.is_dir()):
            raise OutputError(f"{chunks}: is no folder of its own; take it away, or choose another folder with -o")
        for name, path in files_in(self.folder):
            if OURS.fullmatch(name):
                require_place(path)

    def _begin_anew(self, record: Mapping[str, Any]) -> None:
        """Remove another campaign, if it is to be replaced: whole chunks and what is listed, nothing else."""
        if not self._overwrite:
            raise OutputError(
                f"{self.folder}: holds runs of another mission, seed, mode or program version; "
                "use --overwrite to begin anew, or -o for another folder"
            )
        ours = [name for name, _ in files_in(self.folder) if _ours(name)]
        said = [name for name in ours if not self._wrote(name, record)]
        if said:
            raise OutputError(
                f"{self.folder}: {listed(said)}: not as this program wrote it; nothing was changed; move it away, or "
                "choose another folder with -o"
            )
        for name in ours:
            (self.folder / name).unlink()

    def _wrote(self, name: str, record: Mapping[str, Any]) -> bool:
        """Whether a file is one of this program: by its hash, or where it is not listed (yet), by what is in it."""
        path, hashes = self.folder / name, hashes_listed(record)
        if name in hashes:
            return sha256_of(path) == hashes[name]
        if path.suffix == ".npz":
            return read_chunk(self.folder, int(path.stem), _fixed(record)) is not None
        return is_validation(path)


def _ours(name: str) -> bool:
    """Whether a campaign writes files of this name, beside its record."""
    return OURS.fullmatch(name) is not None and name != RECORD


def _fixed(record: Mapping[str, Any]) -> dict[str, Any]:
    """What fixes the runs of a stored campaign; the mission may have moved to another path."""
    return {name: record.get(name) for name in Campaign.__slots__ if name != "mission"}


def _is_campaign(record: Mapping[str, Any]) -> bool:
    """Whether campaign.json is one of ours; version 0.1.0 wrote no mark."""
    return {*Campaign.__slots__} <= record.keys() and record.keys() <= {*Campaign.__slots__, MARK, "outputs_sha256"}


def hashes_listed(record: Mapping[str, Any]) -> dict[str, str]:
    """The list of campaign.json; empty where a campaign has not come to its end."""
    found = record.get("outputs_sha256")
    return {str(name): str(value) for name, value in found.items()} if isinstance(found, dict) else {}


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
