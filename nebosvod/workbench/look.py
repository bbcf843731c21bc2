"""A text -> what is wrong with it, else what it means: the work of one process, from keystroke to keystroke.

The answer is that of a point of a study: the covariance at the reference orbit, from products that texts before have
left. What is found comes as messages, the quick ones first.
"""

import re
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from nebosvod.errors import InputError, NebosvodError
from nebosvod.mission import FitMission, Mission, estimate_cost
from nebosvod.mission.reading.reader import load_text_beside
from nebosvod.mission.rewriting import Written, rewritten
from nebosvod.mission.yaml.yamlfile import MAX_BYTES, Tree, parse_yaml

MOST_ROWS = 100_000  # measurements that are followed as one types: seconds, and some hundred megabytes
Message = dict[str, Any]
Serve = Callable[[Mapping[str, Any]], Iterator[Message]]


def opened() -> Serve:
    """What answers requests: `look` at a text, or `edit` it at one place."""
    from nebosvod.scene.sharing import Shared

    shared = Shared()

    def serve(request: Mapping[str, Any]) -> Iterator[Message]:
        if request["verb"] == "edit":
            yield _edited(request)
        elif request["verb"] == "look":
            yield from _looked(str(request["text"]), str(request["name"]), Path(request["folder"]), shared)
        else:
            _warm(shared)

    return serve


def _warm(shared: Any) -> None:
    """Load what the first look needs, and compute the smallest mission once."""
    from nebosvod.mission import load_mission
    from nebosvod.workbench.answer import fragments

    list(fragments(load_mission("minimal"), shared))


def _edited(request: Mapping[str, Any]) -> Message:
    """The text with one place changed, or why not."""
    value: Any = request["value"]
    path = [int(step) if isinstance(step, int) else str(step) for step in request["path"]]
    if request.get("written") and isinstance(value, str):
        value = Written(value)
    try:
        return {"step": "edited", "text": rewritten(str(request["text"]), path, value, str(request["name"]))}
    except InputError as error:
        return {"step": "refused", "problems": problems(error, str(request["name"]))}


def _looked(text: str, name: str, folder: Path, shared: Any) -> Iterator[Message]:
    """Problems or the resolved mission, then what it would give."""
    started = time.perf_counter()
    mission: Mission | FitMission | None = None
    checked: Message = {"step": "checked", "tree": None, "problems": [], "notices": [], "fit": False, "slug": ""}
    try:
        if len(text.encode("utf-8", "replace")) > MAX_BYTES:
            raise InputError(f"{name}: is larger than {MAX_BYTES} bytes; a mission is a few kilobytes")
        checked["tree"] = _tree(text, name)
        checked["fit"] = isinstance(checked["tree"], dict) and "fit" in checked["tree"]
        mission = load_text_beside(text, name, folder)
        checked |= {"notices": list(mission.notices), "slug": mission.slug}
        if isinstance(mission, Mission):
            checked["cost"] = str(estimate_cost(mission))
    except NebosvodError as error:
        checked["problems"] = problems(error, name)
    yield checked | {"seconds": time.perf_counter() - started}
    if mission is not None:
        yield from _answered(mission, name, shared)


def _answered(mission: Mission | FitMission, name: str, shared: Any) -> Iterator[Message]:
    """What a mission would give; of a fit, what it would read."""
    from nebosvod.workbench import answer

    started = time.perf_counter()
    try:
        if isinstance(mission, FitMission):
            found = answer.records(mission)
        elif (rows := estimate_cost(mission).n_observations) > MOST_ROWS:
            found = iter([("answer", answer.too_many(rows, MOST_ROWS))])
        else:
            found = answer.fragments(mission, shared)
        for part, html in found:
            yield {"step": "found", "part": part, "html": str(html), "seconds": time.perf_counter() - started}
        yield {"step": "done", "seconds": time.perf_counter() - started}
    except NebosvodError as error:
        yield {"step": "failed", "problems": problems(error, name)}
    except (MemoryError, OSError) as error:
        yield {"step": "failed", "problems": [{"line": None, "column": None, "text": f"the system refused: {error}"}]}


def _tree(text: str, name: str) -> Tree:
    """What the text says, as a form shows it; numbers beyond JSON as text."""
    return _shown(parse_yaml(text, name).tree)


def _shown(node: Tree) -> Tree:
    if isinstance(node, dict):
        return {key: _shown(one) for key, one in node.items()}
    if isinstance(node, list):
        return [_shown(one) for one in node]
    if isinstance(node, float) and not abs(node) < float("inf"):
        return str(node)
    return str(node) if isinstance(node, int) and not isinstance(node, bool) and abs(node) > 2**53 else node


def problems(error: NebosvodError, name: str) -> list[Message]:
    """Lines of a message, each with its place in the text."""
    found: list[Message] = []
    where = re.compile(rf"(?:{re.escape(name)}|\S*mission\.yaml):(\d+):(\d+): (.*)", re.DOTALL)
    for line in str(error).split("\n"):
        placed = where.fullmatch(line)
        if placed:
            found.append({"line": int(placed[1]), "column": int(placed[2]), "text": placed[3]})
        else:
            found.append({"line": None, "column": None, "text": line.removeprefix(f"{name}: ")})
    return found
