"""The file of a study: what is varied, how points are chosen, what is asked, and what is to be found.

It is read like a mission: strictly, and with everything that is wrong at its line, before anything is computed.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path

from pydantic import ValidationError

from nebosvod.borders.expression import as_word, read_expression
from nebosvod.errors import InputError
from nebosvod.mission import Mission, load_mission
from nebosvod.mission.fields import KeyPath
from nebosvod.mission.reading.explain import Explainer
from nebosvod.mission.reading.reader import Editable
from nebosvod.mission.yaml.yamlfile import Problem, Tree, YamlFile, parse_yaml, read_text, shown
from nebosvod.studies.answers import Asked, read_answer
from nebosvod.studies.axes import Axis, in_unit, read_axis
from nebosvod.studies.builtin import mission_path, study_path
from nebosvod.studies.file import AxisBlock, ObjectsBlock, StudyFile
from nebosvod.studies.near_earth import PUBLISHED
from nebosvod.studies.objects import Objects, file_of, read_objects
from nebosvod.studies.question import Alarm, Condition, Search, Study
from nebosvod.studies.requirement import Needed, Requirement
from nebosvod.studies.sampling import Points

MOST_LINES = 50
PROBED = 200  # values of a list that are tried on the mission before anything runs
RESERVED = ("point", "draw", "object", "status", "message", "cost")
_CONDITION = re.compile(r"\s*(<=|>=|<|>)\s*(.+?)\s*")


def load_study(path: str | Path) -> Study:
    """Load the file of a study, or a built-in study by its name.

    Raises
    ------
    InputError
        With one line for each thing that is wrong, `file:line:col: field: what; hint`, in the order of the file.
    """
    file = study_path(path)
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
        self._first: dict[str, Tree] = {}  # what the first object of a catalogue changes

    def study(self, text: str, path: Path | None) -> Study | None:
        """The study, or None where the mission or something else is wrong."""
        mission = self._mission(path)
        if mission is None:
            return None
        editable = Editable(mission)
        block = self.block.objects
        catalogue = file_of(block, path) if block is not None else None
        objects = self._objects(block, catalogue, mission, editable) if block is not None else None
        axes = [axis for name, one in self.block.vary.items() if (axis := self._axis(name, one, mission, editable))]
        answers = tuple(self._answers(mission))
        search = self._search(axes, answers)
        requirement = self._requirement(mission, editable, answers)
        if objects is not None:
            axes.insert(0, objects.axis)
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
            outer=self.block.repeat.shared,
            answers=answers,
            search=search,
            requirement=requirement,
            catalogue=catalogue,
            objects=objects,
            warning=self._warning(answers),
            editable=editable,
            points=Points(axes, self.block.sample),
        )

    def _say(self, path: KeyPath, text: str, *, key: bool = False) -> None:
        self.problems.append(self._explainer.problem(path, text, key))

    def _mission(self, path: Path | None) -> Mission | None:
        name = self.block.mission
        beside = path.parent / name if path is not None else Path(name)
        try:
            return load_mission(beside if beside.is_file() else mission_path(name) or name)
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
                editable.edited({**self._first, **axis.changes(value)})
            except InputError as error:
                for line in str(error).split("\n"):
                    plain = re.sub(r"\[\d+\]", "[*]", line)
                    place: KeyPath = ("vary", axis.name, "values", *(() if axis.is_range else (number,)))
                    if "unknown key" in line or "is no element there" in line or "is no path" in line:
                        place = ("vary", axis.name, "set")
                    if plain not in said:
                        self._say(place, line)
                    said.add(plain)

    def _objects(self, block: ObjectsBlock, file: Path | None, mission: Mission, editable: Editable) -> Objects | None:
        """Objects as an axis, the first one tried on the mission."""
        place: KeyPath = ("objects", "from") if block.impactors is None else ("objects", "impactors", "orbits")
        try:
            found = read_objects(block, file, mission)
        except InputError as error:
            self._say(place, str(error))
            return None
        end = max(arc.end for arc in mission.schedule)
        if found.drawn is not None and block.move is not False and end > mission.object.orbit.epoch:
            self._say(
                ("mission",),
                f"its schedule ends {end}, after the epoch of its orbit ({mission.object.orbit.epoch}), which moves to "
                "each fall with it; give it an orbit of kind impact, at a time after the schedule",
            )
            return None
        if not found.axis.values:
            self._say(place, f"{file}: holds no objects")
            return None
        self._first = found.axis.changes(found.axis.values[0])
        try:
            editable.edited(self._first)
        except InputError as error:
            self._say(place, f"{file or PUBLISHED}: its first object: {error}")
        return found

    def _requirement(self, mission: Mission, editable: Editable, answers: tuple[Asked, ...]) -> Requirement | None:
        block = self.block.require
        if block is None:
            return None
        asked = next((one for one in answers if one.name == block.of and not one.shares), None)
        names = [*(one.name for one in answers), *(one.name for one in self.block.answer)]
        if block.of not in names or (asked is None and any(one.name == block.of for one in answers)):
            self._say(("require", "of"), _no_number(block.of, [one.name for one in answers if not one.shares]))
        limit = math.nan
        try:
            limit = in_unit(block.at_most, asked.unit) if asked is not None else 1.0
            if limit <= 0.0:
                self._say(("require", "at_most"), f'is not more than 0 (got "{shown(block.at_most, 40)}")')
        except InputError as error:
            self._say(("require", "at_most"), str(error))
        each = [one for name, paths in block.each.items() if (one := self._needed(name, paths, editable))]
        cost = None
        if block.cost is not None:
            try:
                cost = read_expression(block.cost, list(block.each))
            except InputError as error:
                self._say(("require", "cost"), str(error))
        return Requirement(answer=block.of, limit=limit, text=f"at most {block.at_most}", each=tuple(each), cost=cost)

    def _needed(self, name: str, paths: tuple[str, ...], editable: Editable) -> Needed | None:
        """A thing with the value that the mission says for it."""
        place: KeyPath = ("require", "each", name)
        try:
            said = [self._said_at(path, editable) for path in paths]
            editable.edited({**self._first, **{path: text for path, (_, _, text) in zip(paths, said)}})
        except InputError as error:
            self._say(place, str(error))
            return None
        own = tuple((number, unit) for number, unit, _ in said)
        now, unit = own[0]
        return Needed(name=name, paths=paths, unit=unit, now=now, said=own if len(set(own)) > 1 else ())

    def _said_at(self, path: str, editable: Editable) -> tuple[float, str, Tree]:
        """Number, unit and text that the mission says at a path."""
        said = editable.said(path)
        if said is None:
            raise InputError(f"{path}: the mission says nothing there; give it a value first")
        axis = read_axis("said", (path,), [said], None, None)
        if axis.numbers is None or axis.numbers[0] <= 0.0:
            raise InputError(f'{path}: is no number above 0 (the mission says "{shown(str(said), 40)}")')
        return axis.numbers[0], axis.unit, said

    def _answers(self, mission: Mission) -> Iterator[Asked]:
        taken: set[str] = {*self.block.vary, *RESERVED}
        for number, one in enumerate(self.block.answer):
            if one.name in taken:
                self._say(("answer", number, "name"), f'"{one.name}" is the name of another column; give each its own')
                continue
            taken.add(one.name)
            try:
                asked = read_answer(one.name, one.of, mission)
            except InputError as error:
                self._say(("answer", number, "of"), str(error))
                continue
            if one.before is None:
                yield asked
                continue
            self._require_known(number, one.before, mission)
            yield from (asked.before(duration_s, text) for duration_s, text in one.before)

    def _require_known(self, number: int, times: Sequence[tuple[float, str]], mission: Mission) -> None:
        """Refuse a time before the schedule begins: the columns would be empty."""
        epoch, start = mission.object.orbit.epoch, min(arc.start for arc in mission.schedule)
        early = [text for duration_s, text in times if epoch - start < duration_s]
        if early:
            self._say(
                ("answer", number, "before"),
                f"nothing is measured until {early[0]} before the epoch of the orbit ({epoch}): the schedule begins at "
                f"{start}; say the time before a fall, with an orbit of kind impact",
            )

    def _warning(self, answers: tuple[Asked, ...]) -> Alarm | None:
        block = self.block.warning
        if block is None:
            return None
        columns = [one for one in answers if one.title == block.of and not one.shares]
        if not columns:
            self._say(("warning", "of"), _no_number(block.of, list({one.title for one in answers if not one.shares})))
            return None
        try:
            at_least = in_unit(
                block.at_least if isinstance(block.at_least, str) else repr(block.at_least), columns[0].unit
            )
        except InputError as error:
            self._say(("warning", "at_least"), str(error))
            return None
        return Alarm(answer=block.of, columns=tuple(one.name for one in columns), at_least=at_least)

    def _search(self, axes: list[Axis], answers: tuple[Asked, ...]) -> Search | None:
        find = self.block.find
        known = {*self.block.vary, *(one.name for one in answers)}
        known |= {one.name for one in self.block.answer if one.before is None}  # what is wrong with one is said there
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
