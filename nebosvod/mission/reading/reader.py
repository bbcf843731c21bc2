"""From a mission file to a `Mission`: read, inherit, validate, and say everything that is wrong at once."""

import os
import re
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path

from pydantic import ValidationError

from nebosvod.errors import InputError
from nebosvod.mission.editing import edited
from nebosvod.mission.fields import KeyPath
from nebosvod.mission.fit import FitMission
from nebosvod.mission.model import Mission
from nebosvod.mission.question import SCHEMA_VERSION
from nebosvod.mission.reading import cost, flight, rules
from nebosvod.mission.reading.builtin import builtin_names, builtin_path
from nebosvod.mission.reading.explain import Explainer
from nebosvod.mission.reading.inputs import resolve_files
from nebosvod.mission.yaml.inherit import resolve_like
from nebosvod.mission.yaml.yamlfile import Mark, Problem, Tree, YamlFile, parse_yaml, read_text, shown
from nebosvod.version import __version__

PLANNED = frozenset(Mission.model_fields) - frozenset(FitMission.model_fields)  # keys of a simulated mission alone


def load_mission(path: str | Path) -> Mission:
    """Load a mission file, or a built-in mission by its name; as `load_any`, but refuse a file for `nebosvod fit`."""
    mission = load_any(path)
    if isinstance(mission, FitMission):
        name = shown(str(path))
        raise InputError(
            f"{name}: has a fit block, so there is nothing to simulate; it is for: nebosvod fit {name}, whose folder "
            "holds the orbit"
        )
    return mission


def load_any(path: str | Path) -> Mission | FitMission:
    """Load a mission file, a built-in mission by its name, or a file for `nebosvod fit`.

    Parameters
    ----------
    path : a file, or one of the names of `list_missions()`; a file of that name comes first.

    Raises
    ------
    InputError
        With one line for each thing that is wrong, `file:line:col: field: what; hint`, in the order of the file.
    """
    file = mission_file(path)
    return _load(parse_yaml(read_text(file), shown(str(path))), file)


def mission_file(path: str | Path) -> Path:
    """The file that a path, or the name of a built-in mission, means.

    Raises
    ------
    InputError
        If it is a directory, or no name that is known.
    """
    if not isinstance(path, str | Path):
        kind = type(path).__name__
        raise InputError(f"a mission is loaded by a path or a built-in name, text or pathlib.Path (got {kind})")
    file = Path(path)
    if _exists(file) and file.is_dir():
        raise InputError(f"{shown(str(path))}: {_folder(file)}")
    if isinstance(path, str) and path in builtin_names() and not os.path.lexists(path):
        file = builtin_path(path)
    elif isinstance(path, str) and not _exists(file) and not file.suffix and os.sep not in path:
        raise InputError(rules.unknown(path, builtin_names(), "mission, and no file of that name"))
    return file


def load_fit(path: str | Path) -> FitMission:
    """Load a file for `nebosvod fit`.

    Raises
    ------
    InputError
        As `load_any` does, and if the file is a mission to be simulated.
    """
    mission = load_any(path)
    if not isinstance(mission, FitMission):
        raise InputError(f"{shown(str(path))}: has no fit block; it is a mission for: nebosvod run {shown(str(path))}")
    return mission


def load_mission_text(text: str, name: str = "mission") -> Mission:
    """Load a mission from text; `name` stands for the file in messages. It may not refer to other files."""
    mission = _load(parse_yaml(text, name), None)
    if isinstance(mission, FitMission):
        raise InputError(f"{shown(name)}: has a fit block, so there is nothing to simulate; it is for: nebosvod fit")
    return mission


def load_text_beside(text: str, name: str, folder: Path) -> Mission | FitMission:
    """Load a mission or a fit from text that names files below a folder; `name` stands for the file in messages."""
    return _load(parse_yaml(text, name), folder / "mission.yaml")


def require_mission(value: object, function: str) -> None:
    """Refuse what is no mission where a function of this package is given one.

    Raises
    ------
    InputError
        If it is none, or a file for `nebosvod fit`; says how to get one.
    """
    if isinstance(value, FitMission):
        raise InputError(f"{function}: the mission has a fit block, so there is nothing to simulate; see nebosvod fit")
    if not isinstance(value, Mission):
        got = f"load_mission({value!r})" if isinstance(value, str | Path) and len(str(value)) < 80 else "load_mission"
        raise InputError(f"{function}: needs a mission, as {got} gives it (got {type(value).__name__})")


def _folder(path: Path) -> str:
    """What to do with a folder in place of a mission file."""
    said = shown(str(path))
    if all((path / name).is_file() for name in ("manifest.json", "summary.json")):
        return f"is the folder of a run, not a mission; make its page again with: nebosvod report {said}"
    files = sorted(one.name for one in islice(path.glob("*.yaml"), 1000))
    return "is a directory" + (
        f"; give a mission file in it, as {shown(str(path / files[0]))}"
        if files
        else ", and holds no .yaml; give a mission file, or a name that nebosvod missions lists"
    )


def _exists(path: Path) -> bool:
    try:
        return os.path.lexists(path)
    except ValueError:
        return True  # a name no file can have; reading it says so


def _load(file: YamlFile, path: Path | None) -> Mission | FitMission:
    """Validate what was read."""
    tree, aliases, problems = resolve_like(file)
    if not isinstance(tree, dict):
        raise _refusal(file, [Problem(Mark(1, 1), "a mission is a block of keys, such as schema_version: 1")])
    _refuse_newer(file, tree)
    if "study" in tree and not {"object", "telescopes", "fit"} & tree.keys():
        text = f"study: this file is a study, not a mission; it is for: nebosvod study {file.name}"
        raise _refusal(file, [Problem(file.keys[("study",)], text)])
    tree, found = resolve_files(tree, path.parent if path is not None else None)
    model: type[Mission] | type[FitMission] = FitMission if "fit" in tree else Mission
    explainer = Explainer(file, tree, aliases, model)
    if model is FitMission:
        found = [*found, *_planned_keys(tree)]
    problems += [*file.problems, *(explainer.problem(*item) for item in (*found, *_repeated_names(tree, explainer)))]
    tree = {key: value for key, value in tree.items() if model is Mission or key not in PLANNED}
    try:
        mission = model.model_validate(tree)
    except ValidationError as error:
        raise _refusal(file, problems + explainer.explain(error)) from None
    wrong = [*rules.complaints(mission), *flight.complaints(mission)]
    if isinstance(mission, Mission):
        wrong += cost.complaints(mission)
    problems += [explainer.problem(*item) for item in wrong]
    if problems:
        raise _refusal(file, problems)
    mission._path, mission._text, mission._as_read = path, file.text, dict(mission.__dict__)
    mission._read_again = _read_again
    return mission


class Editable:
    """The tree of a mission, `like` and files resolved once, from which many missions are made by changing places.

    Parameters
    ----------
    mission : one that was read.
    """

    def __init__(self, mission: Mission) -> None:
        tree, _, _ = resolve_like(parse_yaml(mission.text, mission.name))
        rows = tree.get("telescopes") if isinstance(tree, dict) else None
        if not isinstance(tree, dict) or not isinstance(rows, list):
            raise InputError(f"{shown(mission.name)}: has no telescopes to vary")
        plain = [{k: v for k, v in row.items() if k != "like"} if isinstance(row, dict) else row for row in rows]
        self._tree: dict[str, Tree] = {**tree, "telescopes": plain}
        self._mission = mission

    def said(self, path: str) -> Tree:
        """What the mission says at a path, of several places (`*`) the first; None where it says nothing."""
        node: Tree = self._tree
        for step in path.split("."):
            if isinstance(node, list):
                names = [row.get("name") if isinstance(row, dict) else None for row in node]
                number = (
                    0 if step == "*" else names.index(step) if step in names else int(step) if step.isdigit() else -1
                )
                node = node[number] if 0 <= number < len(node) else None
            elif isinstance(node, dict):
                node = next(iter(node.values()), None) if step == "*" else node.get(step)
            elif step != "value":  # the short form of an uncertain number
                return None
        return node

    def edited(self, changes: Mapping[str, Tree]) -> Mission:
        """The mission with other values at some paths (`mission.editing.edited`), checked as a file is.

        What only flying the orbit tells (a start inside a body) is left to whoever flies it; its text is made when
        asked for.

        Raises
        ------
        InputError
            With one line for each thing that is wrong, `field: what; hint`.
        """
        tree: Tree = self._tree
        for place, value in changes.items():
            tree = edited(tree, place, value)
        path = self._mission.path
        whole, found = resolve_files(tree if isinstance(tree, dict) else {}, path.parent if path is not None else None)
        file = YamlFile(self._mission.name, "", tree)
        explainer = Explainer(file, whole, {}, Mission)
        problems = [explainer.problem(*item) for item in found]
        try:
            mission = Mission.model_validate(whole)
        except ValidationError as error:
            problems += explainer.explain(error)
        else:
            wrong = [*rules.complaints(mission), *cost.complaints(mission)]
            problems += [explainer.problem(*item) for item in wrong]
        if problems:
            raise InputError("\n".join(dict.fromkeys(one.text for one in problems)))
        mission._path = path  # and it was never read: its places are keys, not lines of a file that does not say them
        return mission


def _planned_keys(tree: dict[str, Tree]) -> Iterator[tuple[KeyPath, str]]:
    """What belongs to a simulated mission has no place in a file with fit."""
    for key in tree:
        if key in PLANNED:
            yield (key,), "belongs to a mission that is simulated; a file with fit has none"


def _read_again(text: str, name: str, path: Path | None) -> Mission | FitMission:
    """A mission edited in Python, beside the files of the one it was."""
    return _load(parse_yaml(text, name), path)


def _refuse_newer(file: YamlFile, tree: dict[str, Tree]) -> None:
    """A file of a later program is refused before anything else is said about it."""
    version = tree.get("schema_version")
    if isinstance(version, int) and not isinstance(version, bool) and version > SCHEMA_VERSION:
        text = (
            f"schema_version: is newer than this program (got {str(version)[:20]}; nebosvod {__version__} "
            f"reads up to {SCHEMA_VERSION}); install a newer nebosvod"
        )
        raise _refusal(file, [Problem(file.values[("schema_version",)], text)])


def _repeated_names(tree: dict[str, Tree], explainer: Explainer) -> Iterator[tuple[KeyPath, str]]:
    """Telescopes, shared sources, estimators and predictions are told apart by their names."""
    for part in ("telescopes", "shared", "estimators", "predictions"):
        rows = tree.get(part)
        first: dict[str, int] = {}
        for i, row in enumerate(rows if isinstance(rows, list) else []):
            name = row.get("name") if isinstance(row, dict) else None
            if not isinstance(name, str):
                continue
            if name in first:
                line = explainer.mark((part, first[name], "name")).line
                what = f'"{shown(name, 60)}" is already the name of {part}[{first[name]}] on line {line}'
                yield (part, i, "name"), f"{what}; give each its own"
            first.setdefault(name, i)


def _refusal(file: YamlFile, problems: list[Problem]) -> InputError:
    """The exception with all problems, in the order of the file."""
    ordered = sorted(problems, key=lambda problem: problem.mark)
    once = {(p.mark, re.sub(r"\[\d+\]", "", p.text)): p for p in reversed(ordered)}  # inherited values: say it once
    lines = [f"{file.name}:{p.mark.line}:{p.mark.column}: {p.text}" for p in reversed(once.values())]
    if len(lines) > rules.MAX_PROBLEMS:
        lines[rules.MAX_PROBLEMS :] = [f"{file.name}: and more; correct these first"]
    return InputError("\n".join(lines))
