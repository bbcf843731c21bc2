"""What came of a study: its table with units, and what can be read off it."""

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.results.result import Table, ecsv_text
from nebosvod.studies.finding import completeness, found_point, pareto, sensitivities, slopes
from nebosvod.studies.paired import paired
from nebosvod.studies.population import DRAWN_UNITS, drawn_columns, population
from nebosvod.studies.question import Study
from nebosvod.studies.stored import require_parquet
from nebosvod.version import __version__

Array = npt.NDArray[np.float64]
MOST_FAILURES = 20  # told one by one
SCHEMA_VERSION = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StudyTable:
    """The rows of a study.

    Attributes
    ----------
    columns : by name, in order; units : of those that have one.
    leading : of each answer that is shares, the column that names the largest, and the columns of its sources.
    """

    columns: Mapping[str, npt.NDArray[Any]]
    units: Mapping[str, str]
    leading: Mapping[str, tuple[str, tuple[str, ...]]]
    text: str

    @classmethod
    def of(cls, study: Study, arrays: Mapping[str, npt.NDArray[Any]]) -> "StudyTable":
        """The table from what the chunks hold."""
        rows, repeat = study.rows, max(1, study.drawn)
        columns: dict[str, npt.NDArray[Any]] = {"point": np.arange(rows) // repeat}
        if study.drawn:
            columns["draw"] = np.arange(rows) % repeat
        points = study.points
        values = [points.shown(number) for number in range(points.count)]
        for k, axis in enumerate(study.axes):
            columns[axis.name] = np.repeat(np.array([one[k] for one in values]), repeat)
        if "object" in columns:
            columns |= drawn_columns(study, columns["object"])
        leading = {}
        for k, asked in enumerate(study.answers):
            if asked.shares:
                own, word = _shares(asked.name, arrays[f"shares_{k}"])
                columns |= own
                leading[asked.name] = word, tuple(name for name in own if name != word)
            else:
                columns[asked.name] = arrays["numbers"][:, k]
        if study.search is not None and study.search.cost is not None:
            values_of = {name: columns[name] for name in study.search.cost.names}
            columns["cost"] = np.broadcast_to(np.asarray(study.search.cost(values_of), dtype=float), (rows,)).copy()
        columns |= {"status": arrays["status"], "message": arrays["message"]}
        units = {name: unit for name, unit in (study.units | DRAWN_UNITS).items() if name in columns}
        return cls(columns=columns, units=units, leading=leading, text=study.text)

    def written(self, parquet: bool) -> tuple[str, bytes]:
        """Name and bytes of the file: ECSV, or Parquet with units and text in its metadata."""
        if parquet:
            return "results.parquet", _parquet(self)
        units = {name: self.units.get(name, "") for name in self.columns}
        table = Table(columns=self.columns, units=units, description=self.text)
        return "results.ecsv", ecsv_text(table).encode("utf-8")


def _shares(name: str, texts: npt.NDArray[Any]) -> tuple[dict[str, npt.NDArray[Any]], str]:
    """Columns of the shares of every source that some point has, and of the largest one."""
    rows = [json.loads(text) for text in texts.tolist()]
    sources = list(dict.fromkeys(source for one in rows for source in one))
    absent = [0.0 if one else np.nan for one in rows]
    columns: dict[str, npt.NDArray[Any]] = {
        f"{name}: {source}": np.array([one.get(source, none) for one, none in zip(rows, absent)]) for source in sources
    }
    word = f"{name}: leading"
    columns[word] = np.array([max(one, key=lambda source: one[source]) if one else "" for one in rows])
    return columns, word


def _parquet(table: StudyTable) -> bytes:
    require_parquet(len(table.columns["point"]))
    import pyarrow
    from pyarrow import parquet

    made = pyarrow.table({name: pyarrow.array(column) for name, column in table.columns.items()})
    said = {"units": json.dumps(dict(table.units)), "description": table.text, "nebosvod": __version__}
    buffer = io.BytesIO()
    parquet.write_table(made.replace_schema_metadata(said), buffer)
    return buffer.getvalue()


def summary_of(study: Study, table: StudyTable, required: dict[str, Any] | None = None) -> dict[str, Any]:
    """What study.json holds: no time, no path, no count of workers in it."""
    columns, status = table.columns, table.columns["status"]
    failed = np.flatnonzero(status == "failed")
    without = np.flatnonzero(status == "no_answer")
    told = sorted([*failed.tolist(), *without.tolist()])[:MOST_FAILURES]
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "study",
        "study": study.name,
        "title": study.title,
        "mission": {"name": study.mission.name, "sha256": study.mission.sha256},
        "versions": {"nebosvod": __version__, "numpy": np.__version__},
        "method": "one drawn truth for each row, estimated to convergence; covariance at the estimate"
        if study.drawn
        else "covariance at the reference orbit, first estimator, nothing drawn",
        "sample": {"method": study.sample.method, "n": study.sample.n, "seed": study.sample.seed},
        "draws": study.drawn,
        "seed": study.seed,
        "shared_errors": study.outer,
        "vary": [_axis(axis, columns[axis.name]) for axis in study.axes],
        "answers": [_answer(one, columns, table) for one in study.answers],
        "n_points": study.points.count,
        "n_rows": study.rows,
        "n_failed": len(failed),
        "n_without_answer": len(without),
        "failures": [
            {"row": number, "status": str(status[number]), "message": str(columns["message"][number])}
            for number in told
        ],
        "seen": completeness(study, columns),
        "n_not_determined": int(np.sum(status == "not_determined")),
        "population": population(study, columns),
        "paired": paired(study, columns),
        "find": found_point(study, columns),
        "pareto": pareto(study, columns),
        "slopes": slopes(study, columns),
        "sensitivity": sensitivities(study, columns),
        "require": required,
    }


def _axis(axis: Any, column: npt.NDArray[Any]) -> dict[str, Any]:
    distinct: Sequence[Any] = list(dict.fromkeys(column.tolist()))
    numeric = column.dtype.kind == "f"
    return {
        "name": axis.name,
        "set": list(axis.paths),
        "unit": axis.unit,
        "numeric": numeric,
        "log": axis.log or (numeric and not axis.is_range and _even_in_log(distinct)),
        "n_values": len(distinct),
        "least": min(distinct) if numeric else None,
        "largest": max(distinct) if numeric else None,
        "values": distinct if len(distinct) <= 200 else None,
    }


def _even_in_log(values: Sequence[float]) -> bool:
    """Whether a list spans so much that its logarithm is to be shown."""
    return min(values) > 0.0 and max(values) / min(values) > 20.0


def _answer(asked: Any, columns: Mapping[str, npt.NDArray[Any]], table: StudyTable) -> dict[str, Any]:
    row = {
        "name": asked.name, "of": asked.of, "unit": asked.unit, "shares": asked.shares, "title": asked.title,
        "before_d": asked.before_s / 86400.0 if asked.before_s else None,
    }  # fmt: skip
    if asked.shares:
        word, sources = table.leading[asked.name]
        counts = {source: int(np.sum(columns[word] == source.removeprefix(f"{asked.name}: "))) for source in sources}
        return row | {"leading": {s.removeprefix(f"{asked.name}: "): n for s, n in counts.items() if n}}
    values = columns[asked.name]
    good = values[np.isfinite(values)]
    if not good.size:
        return row | {"n": 0, "least": None, "median": None, "largest": None}
    return row | {
        "n": int(good.size),
        "least": float(good.min()),
        "median": float(np.median(good)),
        "largest": float(good.max()),
    }
