"""What a study asks: what is varied, how points are chosen, what is answered, and what is to be found."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nebosvod.borders.expression import Expression
from nebosvod.mission import Mission
from nebosvod.mission.reading.reader import Editable
from nebosvod.scene.sharing import Shared
from nebosvod.studies.answers import Asked
from nebosvod.studies.axes import Axis
from nebosvod.studies.objects import Objects
from nebosvod.studies.requirement import Requirement
from nebosvod.studies.sampling import Points, Sample
from nebosvod.timescale import SECONDS_PER_DAY


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Condition:
    """A number of a point, and how large it may be, in the unit of its column."""

    name: str
    sign: str
    limit: float
    text: str

    def holds(self, value: Any) -> Any:
        """Whether values keep it; nan does not."""
        if self.sign == "<":
            return value < self.limit
        if self.sign == "<=":
            return value <= self.limit
        return value > self.limit if self.sign == ">" else value >= self.limit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Search:
    """What is to be found: the objective, its direction, conditions, and the formula of the cost."""

    objective: str
    least: bool
    conditions: tuple[Condition, ...]
    cost: Expression | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alarm:
    """From what number on an object is warned of.

    Attributes
    ----------
    answer : its name in the file; columns : of the table; at_least : in their unit.
    """

    answer: str
    columns: tuple[str, ...]
    at_least: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Study:
    """A study that was read: what its file says, on the mission that it names.

    Attributes
    ----------
    text, path : of the file; path is None for text.
    drawn : how often each point is drawn; 0 for the covariance at the reference orbit.
    outer : whether the constant errors of telescopes are drawn once for all points of a draw.
    catalogue : the file of the objects that take the place of the mission's, or of the orbits they are drawn of.
    objects : those objects; None where there are none.
    warning : from what number on an object is warned of; None where the study does not say.
    editable : makes the mission of a point; points : what is varied there.
    shared : what its points have in common.
    """

    name: str
    title: str
    text: str
    path: Path | None
    mission: Mission
    axes: tuple[Axis, ...]
    sample: Sample
    drawn: int
    seed: int
    outer: bool
    answers: tuple[Asked, ...]
    search: Search | None
    requirement: Requirement | None
    catalogue: Path | None
    objects: Objects | None
    warning: Alarm | None
    editable: Editable = field(repr=False)
    points: Points
    shared: Shared = field(default_factory=Shared, repr=False)

    @staticmethod
    def load(folder: str | Path) -> Any:
        """The table of a study that was run, as an astropy Table with units; raises InputError where there is none."""
        from nebosvod.studies.stored import load_table

        return load_table(folder)

    @property
    def titles(self) -> dict[str, tuple[str, float]]:
        """Of each answer at a stated time: the name it has in the file, and how long before, days."""
        return {one.name: (one.title, one.before_s / SECONDS_PER_DAY) for one in self.answers if one.before_s}

    @property
    def wanted(self) -> frozenset[str]:
        """Names of the predictions that the answers are about."""
        begins = [f"predictions.{one.name}." for one in self.mission.predictions]
        asked = {start for start in begins for one in self.answers if one.of.startswith(start)}
        return frozenset(one.name for one, start in zip(self.mission.predictions, begins) if start in asked)

    @property
    def input_files(self) -> tuple[Path, ...]:
        """Files beside the study and its mission that it reads."""
        return (*self.mission.input_files, *([self.catalogue] if self.catalogue is not None else []))

    @property
    def rows(self) -> int:
        """Rows of the table: points, each as often as it is drawn."""
        return self.points.count * max(1, self.drawn)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column of numbers."""
        answers = {one.name: one.unit for one in self.answers if not one.shares}
        return {axis.name: axis.unit for axis in self.axes if axis.numbers is not None or axis.is_range} | answers
