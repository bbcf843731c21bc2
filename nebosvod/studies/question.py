"""The file of a study: what is varied, how points are chosen, what is asked, and what is to be found.

It is read like a mission: strictly, and with everything that is wrong at its line, before anything is computed.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from nebosvod.borders.expression import Expression, as_word, read_expression
from nebosvod.errors import InputError
from nebosvod.mission import Mission, load_mission
from nebosvod.mission.fields import Block, KeyPath, Parsed, Several, Text
from nebosvod.mission.reading.explain import Explainer
from nebosvod.mission.reading.reader import Editable
from nebosvod.mission.yaml.yamlfile import Problem, YamlFile, parse_yaml, read_text, shown
from nebosvod.scene.sharing import Shared
from nebosvod.studies.answers import Asked, read_answer
from nebosvod.studies.axes import MOST_VALUES, Axis, in_unit, read_axis
from nebosvod.studies.sampling import Points, Sample, read_sample

SCHEMA_VERSION = 1
MOST_AXES, MOST_ANSWERS = 20, 50
MOST_LINES = 50
PROBED = 200  # values of a list that are tried on the mission before anything runs
RESERVED = ("point", "draw", "status", "message", "cost")
_CONDITION = re.compile(r"\s*(<=|>=|<|>)\s*(.+?)\s*")

SampleField = Annotated[
    Sample,
    Parsed(
        read_sample,
        {
            "description": "How points are chosen",
            "oneOf": [
                {"const": "grid"},
                {"type": "object", "required": ["kind"], "properties": {"kind": {"enum": ["grid", "sobol", "latin"]}}},
                {"type": "object", "required": ["sobol"], "properties": {"sobol": {"type": "object"}}},
                {"type": "object", "required": ["latin"], "properties": {"latin": {"type": "object"}}},
            ],
            "examples": ["grid", {"sobol": {"n": 1024}}, {"latin": {"n": 1000, "seed": 1}}],
        },
    ),
]


def _steps(value: Any) -> int | bool:
    if isinstance(value, bool) or (isinstance(value, int) and 2 <= value <= MOST_VALUES):
        return value
    raise InputError(f"needs how many values the range has, 2 to {MOST_VALUES:,} (got {shown(str(value), 40)})")


Steps = Annotated[
    int | bool,
    Parsed(_steps, {"oneOf": [{"type": "integer", "minimum": 2, "maximum": MOST_VALUES}, {"type": "boolean"}]}),
]


def _paths(value: Any) -> tuple[str, ...]:
    found = [value] if isinstance(value, str) else value
    if not isinstance(found, list) or not found or not all(isinstance(one, str) and one.strip() for one in found):
        raise InputError("needs a path of the mission, such as telescopes.*.noise.sigma, or a list of paths")
    return tuple(found)


Paths = Annotated[
    tuple[str, ...],
    Parsed(
        _paths,
        {
            "description": "Place in the mission, keys joined by points; in a list a name, an index, or * for all",
            "oneOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}],
            "examples": ["telescopes.*.noise.sigma"],
        },
    ),
]


class AxisBlock(Block):
    """One thing that is varied."""

    set: Paths
    values: Any = Field(
        description="A range with units, or a list",
        json_schema_extra={"oneOf": [{"type": "string"}, {"type": "array", "minItems": 1}]},
        examples=["0.02 arcsec .. 1 arcsec", ["1 h", "6 h", "1 d"]],
    )
    log: Steps | None = Field(
        default=None, description="Steps of a range, even in the logarithm; true where it is sampled"
    )
    linear: Steps | None = Field(default=None, description="Steps of a range, even; true where it is sampled")


class AnswerBlock(Block):
    """One number of a point."""

    name: Text
    of: Text = Field(description="Its path, as in summary.json", examples=["predictions.encounter.semi_axes_km.0"])


class RepeatBlock(Block):
    """How often a point is repeated with a truth and noise that are drawn."""

    draws: Annotated[int, Field(ge=0, le=100_000)] = 0
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 0
    seeds: Annotated[int, Field(ge=1)] = 1

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """More than one seed has a meaning only where something is drawn."""
        if self.seeds > 1 and not self.draws:
            return [(("seeds",), f"nothing is drawn, so {self.seeds} seeds give one answer; say draws: {self.seeds}")]
        return []


class FindBlock(Block):
    """Which point is looked for."""

    minimise: Text | None = None
    maximise: Text | None = None
    where: dict[str, Text] = Field(default_factory=dict, description='Conditions, such as {sigma: "< 1 km"}')
    cost: str | int | float | None = Field(default=None, description="A formula of what is varied and of the answers")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """One objective, not two."""
        if (self.minimise is None) == (self.maximise is None):
            return [((), "needs minimise or maximise, one of them: a name of an answer, of what is varied, or cost")]
        return []


class StudyFile(Block):
    """A study."""

    schema_version: Annotated[int, Field(ge=1, le=SCHEMA_VERSION)]
    study: Text = Field(description="Its name")
    title: Text | None = None
    mission: Text = Field(description="A mission file, beside this one, or a built-in mission")
    vary: dict[str, AxisBlock] = Field(min_length=1, max_length=MOST_AXES)
    sample: SampleField = Sample()
    repeat: RepeatBlock = RepeatBlock()
    answer: Annotated[Several[AnswerBlock], Field(min_length=1, max_length=MOST_ANSWERS)]
    find: FindBlock | None = None


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
class Study:
    """A study that was read: what its file says, on the mission that it names.

    Attributes
    ----------
    text, path : of the file; path is None for text.
    drawn : how often each point is drawn; 0 for the covariance at the reference orbit.
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
    answers: tuple[Asked, ...]
    search: Search | None
    editable: Editable = field(repr=False)
    points: Points
    shared: Shared = field(default_factory=Shared, repr=False)

    @staticmethod
    def load(folder: str | Path) -> Any:
        """The table of a study that was run, as an astropy Table with units; raises InputError where there is none."""
        from nebosvod.studies.stored import load_table

        return load_table(folder)

    @property
    def wanted(self) -> frozenset[str]:
        """Names of the predictions that the answers are about."""
        begins = [f"predictions.{one.name}." for one in self.mission.predictions]
        asked = {start for start in begins for one in self.answers if one.of.startswith(start)}
        return frozenset(one.name for one, start in zip(self.mission.predictions, begins) if start in asked)

    @property
    def rows(self) -> int:
        """Rows of the table: points, each as often as it is drawn."""
        return self.points.count * max(1, self.drawn)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column of numbers."""
        answers = {one.name: one.unit for one in self.answers if not one.shares}
        return {axis.name: axis.unit for axis in self.axes if axis.numbers is not None or axis.is_range} | answers


def load_study(path: str | Path) -> Study:
    """Load the file of a study.

    Raises
    ------
    InputError
        With one line for each thing that is wrong, `file:line:col: field: what; hint`, in the order of the file.
    """
    file = Path(path)
    return load_study_text(read_text(file), shown(str(path)), file)


def load_study_text(text: str, name: str = "study", path: Path | None = None) -> Study:
    """Load a study from text; a mission file is looked for beside `path`."""
    file = parse_yaml(text, name)
    tree = file.tree if isinstance(file.tree, dict) else {}
    explainer = Explainer(file, tree, {}, StudyFile)
    problems = list(file.problems)
    try:
        block = StudyFile.model_validate(file.tree)
    except ValidationError as error:
        raise _refusal(file, problems + explainer.explain(error)) from None
    reading = _Reading(block, explainer)
    made = reading.study(text, path)
    if problems or reading.problems or made is None:
        raise _refusal(file, problems + reading.problems)
    return made


class _Reading:
    """A file that has the right shape, on its way to a study; problems are gathered."""

    def __init__(self, block: StudyFile, explainer: Explainer) -> None:
        self.block = block
        self.problems: list[Problem] = []
        self._explainer = explainer

    def study(self, text: str, path: Path | None) -> Study | None:
        """The study, or None where the mission or something else is wrong."""
        mission = self._mission(path)
        if mission is None:
            return None
        editable = Editable(mission)
        axes = [axis for name, one in self.block.vary.items() if (axis := self._axis(name, one, mission, editable))]
        answers = tuple(self._answers(mission))
        search = self._search(axes, answers)
        if self.problems:
            return None
        return Study(
            name=self.block.study,
            title=self.block.title or self.block.study,
            text=text,
            path=path,
            mission=mission,
            axes=tuple(axes),
            sample=self.block.sample,
            drawn=self.block.repeat.draws,
            seed=self.block.repeat.seed,
            answers=answers,
            search=search,
            editable=editable,
            points=Points(axes, self.block.sample),
        )

    def _say(self, path: KeyPath, text: str, *, key: bool = False) -> None:
        self.problems.append(self._explainer.problem(path, text, key))

    def _mission(self, path: Path | None) -> Mission | None:
        name = self.block.mission
        beside = path.parent / name if path is not None else Path(name)
        try:
            return load_mission(beside if beside.is_file() else name)
        except InputError as error:
            for line in str(error).split("\n")[:5]:
                self._say(("mission",), line)
            return None

    def _axis(self, name: str, block: AxisBlock, mission: Mission, editable: Editable) -> Axis | None:
        if not re.fullmatch(r"[^\W\d][\w -]*", name) or as_word(name) in RESERVED:
            self._say(("vary", name), "is no name for a column: letters, digits, blanks, - and _, and not one of "
                      f"{', '.join(RESERVED)}", key=True)  # fmt: skip
            return None
        try:
            axis = read_axis(name, block.set, block.values, block.log, block.linear)
        except InputError as error:
            self._say(("vary", name, "values"), str(error))
            return None
        if axis.is_range and not axis.steps and self.block.sample.method == "grid":
            self._say(("vary", name, "values"), "says no number of steps for a grid; add log: 7 or linear: 7")
            return None
        self._probe(axis, editable)
        return axis

    def _probe(self, axis: Axis, editable: Editable) -> None:
        """Try the ends of a range, or the values of a list, on the mission."""
        trials = [axis.at_fraction(0.0), axis.at_fraction(1.0 - 1e-16)] if axis.is_range else []
        trials += [] if axis.is_range else [axis.at_step(step) for step in range(min(axis.count, PROBED))]
        said: set[str] = set()
        for number, (value, _) in enumerate(trials):
            try:
                editable.edited(dict.fromkeys(axis.paths, value))
            except InputError as error:
                for line in str(error).split("\n"):
                    plain = re.sub(r"\[\d+\]", "[*]", line)
                    place: KeyPath = ("vary", axis.name, "values", *(() if axis.is_range else (number,)))
                    if "unknown key" in line or "is no element there" in line or "is no path" in line:
                        place = ("vary", axis.name, "set")
                    if plain not in said:
                        self._say(place, line)
                    said.add(plain)

    def _answers(self, mission: Mission) -> Iterator[Asked]:
        taken: set[str] = {*self.block.vary, *RESERVED}
        for number, one in enumerate(self.block.answer):
            if one.name in taken:
                self._say(("answer", number, "name"), f'"{one.name}" is the name of another column; give each its own')
                continue
            taken.add(one.name)
            try:
                yield read_answer(one.name, one.of, mission)
            except InputError as error:
                self._say(("answer", number, "of"), str(error))

    def _search(self, axes: list[Axis], answers: tuple[Asked, ...]) -> Search | None:
        find = self.block.find
        known = {*self.block.vary, *(one.name for one in self.block.answer)}  # what is wrong with one is said there
        if find is None:
            return None
        shares = {one.name for one in answers if one.shares}
        words = {axis.name for axis in axes if axis.numbers is None and not axis.is_range}
        numbers = sorted(known - shares - words)
        cost = None
        if find.cost is not None:
            try:
                cost = read_expression(find.cost, numbers)
            except InputError as error:
                self._say(("find", "cost"), str(error))
                numbers.append("cost")
        allowed = [*numbers, *(["cost"] if cost is not None else [])]
        which = "minimise" if find.minimise is not None else "maximise"
        objective = find.minimise or find.maximise or ""
        if objective not in allowed:
            self._say(("find", which), _no_number(objective, allowed))
        units = {axis.name: axis.unit for axis in axes} | {one.name: one.unit for one in answers} | {"cost": ""}
        conditions = tuple(self._conditions(find.where, allowed, units))
        return Search(objective=objective, least=find.minimise is not None, conditions=conditions, cost=cost)

    def _conditions(
        self, where: Mapping[str, str], allowed: list[str], units: Mapping[str, str]
    ) -> Iterator[Condition]:
        for name, text in where.items():
            path: KeyPath = ("find", "where", name)
            match = _CONDITION.fullmatch(text)
            if name not in allowed:
                self._say(path, _no_number(name, allowed), key=True)
            elif match is None:
                self._say(path, f'is no condition (got "{shown(text, 40)}"; allowed such as "< 1 km" or ">= 3")')
            else:
                try:
                    limit = in_unit(match[2], units[name]) if name in units else 0.0
                    yield Condition(name=name, sign=match[1], limit=limit, text=text)
                except InputError as error:
                    self._say(path, str(error))


def _no_number(name: str, allowed: list[str]) -> str:
    near = get_close_matches(name, allowed, 1)
    hint = f'; did you mean "{near[0]}"?' if near else ""
    return f'"{shown(name, 60)}" is no number of a point (allowed: {", ".join(allowed[:25])}){hint}'


def _refusal(file: YamlFile, problems: list[Problem]) -> InputError:
    """The exception with all problems, in the order of the file."""
    ordered = sorted(problems, key=lambda problem: problem.mark)
    lines = list(dict.fromkeys(f"{file.name}:{p.mark.line}:{p.mark.column}: {p.text}" for p in ordered))
    if len(lines) > MOST_LINES:
        lines[MOST_LINES:] = [f"{file.name}: and more; correct these first"]
    return InputError("\n".join(lines))


def study_schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of the file of a study."""
    schema = StudyFile.model_json_schema(by_alias=True)
    definitions = schema.pop("$defs")
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "nebosvod study",
        **{key: value for key, value in schema.items() if key != "title"},
        "$defs": dict(sorted(definitions.items())),
    }
