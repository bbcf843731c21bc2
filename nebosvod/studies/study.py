"""A study run: its points in chunks by any workers, then the table, what was found in it, and the folder of both."""

import hashlib
import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.borders.wholefile import refuse_link
from nebosvod.errors import GeometryError, InputError, NebosvodError, OutputError, UnseenError
from nebosvod.mission.yaml.yamlfile import Tree
from nebosvod.results.ownership import sha256_of
from nebosvod.results.result import json_text
from nebosvod.studies.averaging import averaging
from nebosvod.studies.chunked import ChunkedFolder, Kind
from nebosvod.studies.point import Point, Seed, evaluate
from nebosvod.studies.question import Study
from nebosvod.studies.reading import load_study_text
from nebosvod.studies.requirement import required
from nebosvod.studies.results import StudyTable, summary_of
from nebosvod.studies.stored import PAGE, PARQUET_ROWS, RECORD, RESULT, require_parquet
from nebosvod.tasks.engine import Workers, run_tasks
from nebosvod.version import __version__

MOST_ROWS = 10_000_000
MOST_IN_CHUNK, FEWEST_CHUNKS = 100, 64
LONGEST_MESSAGE = 400
OK, NO_ANSWER, UNSEEN, UNDETERMINED, FAILED = "ok", "no_answer", "not_seen", "not_determined", "failed"
KEYS = (
    "study", "study_sha256", "study_path", "mission_sha256", "inputs_sha256", "version", "rows", "chunk_rows",
)  # fmt: skip
KIND = Kind(
    noun="study", campaign="study", record=RECORD, result=RESULT,
    ours=r"study\.(json|html|yaml)|mission\.yaml|results\.(ecsv|parquet)", keys=KEYS, labels=("study_path",),
    unit="points",
)  # fmt: skip
Arrays = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What a study will cost, from points that were computed.

    Attributes
    ----------
    point_s : CPU seconds a point; time_s : of all, shared out to so many workers; disk_bytes : of chunks and table.
    """

    rows: int
    point_s: float
    time_s: float
    disk_bytes: float

    def words(self) -> str:
        """In a sentence."""
        rows = "1 row" if self.rows == 1 else f"{self.rows:,} rows"
        return (
            f"{rows} at {1e3 * self.point_s:.3g} ms each: about {duration_words(self.time_s)}, "
            f"{size_words(self.disk_bytes)} on disk"
        )


def duration_words(seconds: float) -> str:
    """A duration in a unit that suits it."""
    for unit, size in (("years", 3.15576e7), ("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:,.3g} {unit}"
    return f"{seconds:.2g} s"


def size_words(size: float) -> str:
    """Bytes in a unit that suits them."""
    for unit, factor in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= factor:
            return f"{size / factor:,.3g} {unit}"
    return f"{size:.0f} bytes"


def plan(study: Study, workers: int, trials: int = 3) -> Plan:
    """Compute a few points and say what all of them will cost.

    Raises
    ------
    NebosvodError
        If all of these points fail; as the first one did.
    """
    numbers = sorted({0, study.rows // 2, study.rows - 1})[:trials]
    errors, spent = [], []
    evaluate_row(study, 0)  # opens tables and compiled loops
    for number in numbers:
        started = time.process_time()
        try:
            row(study, number)
            spent.append(time.process_time() - started)
        except NebosvodError as error:
            errors.append(error)
    if not spent:
        raise errors[0]
    each = float(np.mean(spent))
    width = 24.0 * (len(study.axes) + 2 * len(study.answers)) + 60.0
    time_s = each * math.ceil(study.rows / workers)
    return Plan(rows=study.rows, point_s=each, time_s=time_s, disk_bytes=study.rows * width)


def require_possible(study: Study, workers: int) -> None:
    """Refuse a study that nobody will see the end of, with what it would cost.

    Raises
    ------
    InputError
        If it has more than MOST_ROWS rows, or needs Parquet and pyarrow is not there.
    """
    if study.rows > MOST_ROWS:
        raise InputError(
            f"{study.name}: {plan(study, workers).words()}; allowed are {MOST_ROWS:,} rows: fewer values, or a sample "
            "(sample: {sobol: {n: 4096}})"
        )
    if study.rows >= PARQUET_ROWS:
        require_parquet(study.rows)


def run_study(
    study: Study,
    folder: Path,
    *,
    workers: Workers,
    resume: bool = False,
    overwrite: bool = False,
    parquet: bool = False,
    page: Callable[[Mapping[str, Any], StudyTable], str] | None = None,
    progress: Callable[[int, int], None] = lambda done, rows: None,
    say: Callable[[str], None] = lambda sentence: None,
) -> dict[str, Any]:
    """Run a study, or go on with it; returns what study.json holds.

    Parameters
    ----------
    workers : who computes; the result does not depend on it.
    resume : there must be something to go on with.
    page : makes study.html; None for no page.
    progress : called with the rows that are done and all rows.
    say : called with a sentence for each stored file that was changed since it was written.

    Raises
    ------
    InputError
        If there are too many points, or it cannot be resumed.
    OutputError
        If the folder holds something else, and it is not to be overwritten.
    """
    require_possible(study, workers.count)
    if folder.is_symlink():
        refuse_link(folder, folder.lstat().st_mode)
    if resume and not (folder / RECORD).is_file():
        raise OutputError(f"{folder}: holds no study that could be resumed; leave --resume out to begin one")
    record = record_of(study)
    with ChunkedFolder(folder, KIND, record, int(record["chunk_rows"]), overwrite=overwrite) as held:
        missing = held.missing(study.rows)
        for sentence in held.changed(missing):
            say(sentence)
        finished = held.chunks(study.rows) - len(missing)
        progress(min(study.rows, finished * held.size), study.rows)

        def keep(number: int, arrays: Any) -> None:
            nonlocal finished
            held.keep(number, arrays)
            finished += 1
            progress(min(study.rows, finished * held.size), study.rows)

        run_tasks("nebosvod.studies.study:open_study", argument_of(study, held.size), missing, workers, keep)
        table = StudyTable.of(study, held.collected(study.rows))
        found = summary_of(study, table, requirement_of(study))
        name, data = table.written(parquet or study.rows >= PARQUET_ROWS)
        files = {
            name: data,
            "study.yaml": study.text.encode("utf-8"),
            "mission.yaml": study.mission.text.encode("utf-8"),
            RESULT: json_text(found).encode("utf-8"),
        }
        if page is not None:
            files[PAGE] = page(found, table).encode("utf-8")
        held.publish(files)
    return found


def requirement_of(study: Study) -> dict[str, Any] | None:
    """What is required of each thing; None where nothing is asked."""
    wanted = study.requirement
    if wanted is None:
        return None
    asked = next(one for one in study.answers if one.name == wanted.answer)

    def number(changes: Mapping[str, Any]) -> float:
        value = asked.take(evaluate(study.editable.edited(changes), study.wanted, None, study.shared))
        return float(value) if isinstance(value, float | int) else float("inf")

    found = required(wanted, number)
    return found | {"averaging": averaging(wanted, found, number, evaluate(study.mission, study.wanted))}


def record_of(study: Study) -> dict[str, Any]:
    """What fixes every value of a study, and the size of its chunks."""
    return {
        "study": study.name,
        "study_sha256": hashlib.sha256(study.text.encode("utf-8")).hexdigest(),
        "study_path": str(study.path.resolve()) if study.path is not None else None,
        "mission_sha256": study.mission.sha256,
        "inputs_sha256": [sha256_of(path) for path in study.input_files],
        "version": __version__,
        "rows": study.rows,
        "chunk_rows": max(1, min(MOST_IN_CHUNK, study.rows // FEWEST_CHUNKS)),
    }


def argument_of(study: Study, size: int) -> dict[str, Any]:
    """What a worker opens."""
    path = str(study.path.resolve()) if study.path is not None else None
    return {
        "text": study.text, "name": study.name, "path": path, "size": size, "rows": study.rows,
        "mission_sha256": study.mission.sha256,
    }  # fmt: skip


def open_study(argument: Mapping[str, Any]) -> Callable[[int], Arrays]:
    """Prepare a worker; the returned function computes one chunk."""
    path = Path(argument["path"]) if argument["path"] is not None else None
    study = load_study_text(argument["text"], argument["name"], path)
    if study.mission.sha256 != argument["mission_sha256"]:
        raise InputError(f"{study.mission.name}: the mission file changed while it was studied; start again")
    size, rows = int(argument["size"]), int(argument["rows"])
    return lambda number: chunk(study, range(number * size, min((number + 1) * size, rows)))


def chunk(study: Study, rows: range) -> Arrays:
    """The arrays of some rows: `numbers` (n, answers), `shares_k` as JSON, `status`, `message`."""
    numbers = np.full((len(rows), len(study.answers)), np.nan)
    shares: dict[int, list[str]] = {k: [] for k, one in enumerate(study.answers) if one.shares}
    status, messages = [], []
    for place, number in enumerate(rows):
        word, message, found = evaluate_row(study, number)
        status.append(word)
        messages.append(message[:LONGEST_MESSAGE])
        for k, one in enumerate(found):
            if isinstance(one, dict):
                shares[k].append(json.dumps(one))
            elif k in shares:
                shares[k].append("{}")
            elif one is not None:
                numbers[place, k] = one
    found_arrays: Arrays = {"numbers": numbers, "status": np.array(status), "message": np.array(messages)}
    return found_arrays | {f"shares_{k}": np.array(texts) for k, texts in shares.items()}


def evaluate_row(study: Study, number: int) -> tuple[str, str, list[Any]]:
    """Status, message and answers of a row; whatever goes wrong with its point is told in it."""
    try:
        point = row(study, number)
        found = [one.take(point) for one in study.answers]
    except UnseenError as error:
        return UNSEEN if study.objects is not None else FAILED, str(error), [None] * len(study.answers)
    except GeometryError as error:
        return UNDETERMINED if study.objects is not None else FAILED, str(error), [None] * len(study.answers)
    except NebosvodError as error:
        return FAILED, str(error), [None] * len(study.answers)
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        return FAILED, f"internal error: {type(error).__name__}: {error}", [None] * len(study.answers)
    without = [one for one, value in zip(study.answers, found) if value is None and not one.before_s]
    if without:
        return NO_ANSWER, _why(study, point, without[0].of, without[0].name), found
    return OK, "", found


def _why(study: Study, point: Point, of: str, name: str) -> str:
    """Why a point has no such answer."""
    for request in study.mission.predictions:
        if of.startswith(f"predictions.{request.name}.") and (said := point.why_not(request.name)):
            return f"{name}: {said}"
    return f"{name}: there is no {of} at this point"


def row(study: Study, number: int) -> Point:
    """The point of a row, evaluated."""
    index, draw = divmod(number, max(1, study.drawn))
    changes: dict[str, Tree] = {}
    for axis, (value, _) in zip(study.axes, study.points[index]):
        changes |= axis.changes(value)
    seed = Seed(own=(study.seed, index, draw), outer=(study.seed, draw) if study.outer else None)
    return evaluate(study.editable.edited(changes), study.wanted, seed if study.drawn else None, study.shared)
