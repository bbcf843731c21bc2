"""Answers that are no folder of one orbit: studies, validations, plans, comparisons."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from astropy.table import QTable

from nebosvod.borders.stored import read_object
from nebosvod.borders.wholefile import write_new_text
from nebosvod.errors import InputError, OutputError
from nebosvod.notebook.answer import Answer, Item, Page, plain
from nebosvod.notebook.summaries.comparison import ComparisonSummary
from nebosvod.notebook.summaries.decision import DecisionSummary
from nebosvod.notebook.summaries.orbit_comparison import OrbitComparisonSummary
from nebosvod.notebook.summaries.plan import PlanSummary
from nebosvod.notebook.summaries.reading import read
from nebosvod.notebook.summaries.study import StudySummary
from nebosvod.notebook.summaries.validation import ValidationSummary
from nebosvod.planning.advice import advice
from nebosvod.report.comparison_page import make_comparison_page, sentence
from nebosvod.report.decision_page import make_decision_page
from nebosvod.report.orbit_comparison_page import make_orbit_comparison_page
from nebosvod.report.plan_page import make_plan_page
from nebosvod.report.study_page import make_study_page
from nebosvod.report.validation_page import make_validation_report
from nebosvod.studies.stored import load_table


class Kept(Answer):
    """An answer that is kept in a folder while it is made, so that it can be continued.

    Attributes
    ----------
    folder : where it stands.
    """

    file: ClassVar[str]

    def __init__(self, summary: Item, folder: Path) -> None:
        super().__init__(summary)
        self.folder = folder

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Read one back.

        Raises
        ------
        InputError
            If the folder holds none.
        """
        place = Path(folder) / cls.file
        if not place.is_file():
            raise InputError(f"{folder}: holds no {cls.file}; it is not the folder of a {cls.kind}")
        return cls(read_object(place), Path(folder))

    def save(self, folder: str | Path | None = None) -> Path:
        """The folder, where everything stands already; or a copy of it.

        Parameters
        ----------
        folder : of the copy, which must not be there yet.

        Raises
        ------
        OutputError
            If something is in the way, or the place cannot be written.
        """
        if folder is None:
            return self.folder
        place = Path(folder)
        try:
            shutil.copytree(self.folder, place)
        except OSError as error:
            raise OutputError(f"{place}: {error.strerror or 'not every file could be copied'}") from None
        return place


class Study(Kept):
    """What a study found: a mission varied over many points.

    Attributes
    ----------
    table : one row for each point (and draw), an astropy table with units.
    """

    kind, file = "study", "study.json"

    @property
    def typed(self) -> StudySummary:
        """The summary with types: quantities with units, moments as Time."""
        return read(self.summary, StudySummary)

    @property
    def table(self) -> QTable:
        """One row for each point, with units."""
        return QTable(load_table(self.folder))

    @property
    def tables(self) -> Mapping[str, QTable]:
        """The one table, as `results`."""
        return {"results": self.table}

    def _page_text(self) -> str:
        table = load_table(self.folder)
        return make_study_page(self.summary, {name: np.asarray(table[name]) for name in table.colnames})


class Validation(Kept):
    """Whether the sigmas of a mission can be believed; `passed` is the verdict."""

    kind, file = "validation", "validation.json"

    @property
    def typed(self) -> ValidationSummary:
        """The summary with types: quantities with units, moments as Time."""
        return read(self.summary, ValidationSummary)

    @property
    def passed(self) -> bool:
        """Whether every estimator is right about its own accuracy."""
        return bool(self.summary["passed"])

    @property
    def headline(self) -> str:
        """The verdict."""
        return f"{'passed' if self.passed else 'FAILED'}: {self.summary['verdict']}"

    def _page_text(self) -> str:
        return make_validation_report(self.summary)


class Noted(Answer):
    """An answer that is one file of JSON."""

    def save(self, path: str | Path) -> Path:
        """Write it to a new .json file; returns its path.

        Raises
        ------
        OutputError
            If the file is there, or cannot be written.
        """
        write_new_text(Path(path), self.summary_text())
        return Path(path)


class Plan(Noted):
    """What to measure next for a prediction."""

    kind = "plan"

    @property
    def typed(self) -> PlanSummary:
        """The summary with types: quantities with units, moments as Time."""
        return read(self.summary, PlanSummary)

    @property
    def headline(self) -> str:
        """The advice in a sentence."""
        return advice(self.summary)

    def _page_text(self) -> str:
        return make_plan_page(self.summary)


class Decision(Noted):
    """What the probability of an impact may be after each candidate visit."""

    kind = "decision"

    @property
    def typed(self) -> DecisionSummary:
        """The summary with types: quantities with units, moments as Time."""
        return read(self.summary, DecisionSummary)

    def _page_text(self) -> str:
        return make_decision_page(self.summary)


class Comparison(Noted):
    """Several answers side by side."""

    kind = "comparison"

    @property
    def typed(self) -> ComparisonSummary | OrbitComparisonSummary:
        """The summary with types: quantities with units, moments as Time.

        Raises
        ------
        InputError
            For studies, whose comparison is `summary` alone.
        """
        if "runs" not in self.summary:
            raise InputError("compared studies have no typed summary; `summary` has what there is")
        if "kind" in self.summary:
            return read(self.summary, OrbitComparisonSummary)
        return read(self.summary, ComparisonSummary)

    @property
    def title(self) -> str:
        """What is compared."""
        return " · ".join(str(run["label"]) for run in self._runs)

    @property
    def _runs(self) -> Sequence[Item]:
        found: Sequence[Item] = self.summary.get("runs") or self.summary["studies"]
        return found

    @property
    def headline(self) -> str:
        """How the first prediction that compares differs, else the first warning."""
        labels = [str(run["label"]) for run in self._runs]
        told = [plain(sentence(row, labels)) for row in self.summary.get("predictions") or () if row["comparable"]]
        return next(iter([*told, *self.summary.get("warnings", ())]), "")

    def report(self, path: str | Path | None = None, *, overwrite: bool = False) -> Page:
        """Its page; with a path it is written there too.

        Raises
        ------
        InputError
            For studies, which have no page of their comparison.
        """
        if "ellipses" not in self.summary and "rows" not in self.summary:
            raise InputError("there is no page of compared studies; each folder has its own study.html")
        return super().report(path, overwrite=overwrite)

    def _page_text(self) -> str:
        if "ellipses" in self.summary:
            return make_comparison_page(self.summary)
        return make_orbit_comparison_page(self.summary) if "kind" in self.summary else ""
