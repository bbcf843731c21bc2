"""The text of a mission with one value changed, and nothing else: comments, order and layout stay as they were.

A form changes one place at a time. The place is found by the parser's own marks and its letters are replaced; what
comes out is read again and must say exactly what was meant, or the text is left alone.
"""

import json
import re
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import yaml

from nebosvod.errors import InputError
from nebosvod.mission.editing import Step
from nebosvod.mission.yaml.yamlfile import Tree, dotted, parse_yaml, scalar

_ESCAPED = '"\\'
LONGEST_ROW = 100  # letters of a block that is written on one line, {a: b}
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")  # the line breaks of the parser


class Written(str):
    """A scalar by the very letters somebody typed: 0.10 stays 0.10."""


@dataclass(slots=True, eq=False)
class _Node:
    """A node of the text: from where to where, letters counted from 0.

    Attributes
    ----------
    flow : in brackets, or a scalar on one line.
    rows : of a collection, (where the key or dash of each begins, key or None, node).
    indent : column of its keys or dashes.
    """

    start: int
    end: int
    flow: bool
    kind: str  # "map", "list", "scalar"
    rows: list[tuple[int, str | None, "_Node"]] = field(default_factory=list)
    indent: int = 0

    def below(self, step: Step) -> "_Node | None":
        """The node of a key, or of a place in a list."""
        if self.kind == "map":
            return next((node for _, key, node in self.rows if key == step), None)
        if self.kind == "list" and isinstance(step, int) and 0 <= step < len(self.rows):
            return self.rows[step][2]
        return None


def rewritten(text: str, path: Sequence[Step], value: Tree | Written, name: str = "mission") -> str:
    """The text with a value at a place.

    Parameters
    ----------
    path : keys and places in lists (from 0); the end of a list makes it longer by one, keys that are missing are made.
    value : what it shall say; None takes the key, or the row of a list, away.

    Raises
    ------
    InputError
        If the text is no YAML, or the place cannot be changed without touching another.
    """
    before = parse_yaml(text, name)
    if before.problems:
        problem = before.problems[0]
        raise InputError(f"{name}:{problem.mark.line}:{problem.mark.column}: {problem.text}")
    steps = tuple(path)
    if not steps:
        raise InputError("a place in a text is named by its keys")
    wanted = _with(before.tree, steps, scalar(value) if isinstance(value, Written) else value)
    made = _edited(text, steps, value)
    try:
        said = parse_yaml(made, name)
    except InputError:
        said = None
    if said is None or said.problems or not _same(said.tree, wanted):
        raise InputError(
            f"{dotted(steps)}: cannot be changed here without touching what stands beside it; edit the text"
        )
    return made


def _same(one: Tree, other: Tree) -> bool:
    """Whether two trees say the same; 1 and true, 1 and 1.0 do not."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    return type(one) is type(other) and (one == other or one != one)


def _with(tree: Tree, steps: Sequence[Step], value: Tree) -> Tree:
    """The tree as it should be read afterwards."""
    if not steps:
        return value
    step, rest = steps[0], steps[1:]
    if isinstance(step, int):
        rows = list(tree) if isinstance(tree, list) else []
        if not 0 <= step <= len(rows) or (step == len(rows) and value is None):
            raise InputError(f"there is no row {step} in a list of {len(rows)}")
        if not rest and value is None:
            return rows[:step] + rows[step + 1 :]
        rows[step : step + 1] = [_with(rows[step] if step < len(rows) else None, rest, value)]
        return rows
    block = dict(tree) if isinstance(tree, dict) else {}
    if not rest and value is None:
        if step not in block:
            raise InputError(f'there is no key "{step}" to take away')
        del block[step]
    else:
        block[step] = _with(block.get(step), rest, value)
    return block


def _edited(text: str, steps: tuple[Step, ...], value: Tree | Written) -> str:
    """The text with the letters of one place replaced, put in or cut out."""
    starts = [0, *(match.end() for match in _BREAK.finditer(text))]
    node, depth = _nodes(text, starts), 0
    parents: list[_Node] = []
    while depth < len(steps) and (found := node.below(steps[depth])) is not None:
        parents.append(node)
        node, depth = found, depth + 1
    if depth == len(steps):
        if value is None:
            return _cut(text, starts, parents[-1], steps[-1])
        return _put(text, parents[-1] if parents else None, node, value)
    for step in reversed(steps[depth + 1 :]):
        value = [value] if isinstance(step, int) else {str(step): value}
    if node.kind == ("list" if isinstance(steps[depth], int) else "map") and node.rows:
        return _added(text, starts, node, steps[depth], value)
    whole: Tree = [value] if isinstance(steps[depth], int) else {str(steps[depth]): value}
    return _put(text, parents[-1] if parents else None, node, whole)


def _nodes(text: str, starts: Sequence[int]) -> _Node:
    """The nodes of a text that was read without complaint, with their places."""

    def at(mark: Any) -> int:
        return min(starts[mark.line] + mark.column, len(text)) if mark.line < len(starts) else len(text)

    top = _Node(0, 0, False, "list")
    stack: list[_Node] = [top]
    keys: list[tuple[int, str | None]] = [(0, None)]  # of each open block, the key that waits for its value
    for event in yaml.parse(text, Loader=_LOADER):
        if isinstance(event, yaml.CollectionEndEvent):
            done = stack.pop()
            keys.pop()
            done.end = at(event.end_mark) if done.flow else max([done.start, *(node.end for _, _, node in done.rows)])
        elif isinstance(event, yaml.NodeEvent):
            parent, (began, key) = stack[-1], keys[-1]
            start, end = at(event.start_mark), at(event.end_mark)
            if parent.kind == "map" and key is None:
                keys[-1] = (start, str(getattr(event, "value", "")))
                continue
            keys[-1] = (0, None)
            if isinstance(event, yaml.ScalarEvent):
                node = _Node(start, end, event.style not in ("|", ">"), "scalar")
            else:
                kind = "map" if isinstance(event, yaml.MappingStartEvent) else "list"
                column = start - starts[bisect_right(starts, start) - 1]
                node = _Node(start, end, bool(getattr(event, "flow_style", False)), kind, indent=column)
                stack.append(node)
                keys.append((0, None))
            parent.rows.append((began if parent.kind == "map" else start, key, node))
    return top.rows[0][2] if top.rows else _Node(0, 0, True, "scalar")


def _flat(value: Tree | Written) -> str:
    """A value on one line, as it may stand between brackets and after a key."""
    if isinstance(value, Written):
        return str(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_flat(str(key))}: {_flat(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flat, value)) + "]"
    if isinstance(value, str):
        return value if _plain(value) else _quoted(value)
    return json.dumps(value)


def _plain(text: str) -> bool:
    """Whether letters without quotes are read as this text, also between brackets."""
    try:
        return parse_yaml(f"{{k: {text}, l: 0}}", "").tree == {"k": text, "l": 0}
    except InputError:
        return False


def _quoted(text: str) -> str:
    """A text in double quotes; what cannot be printed is escaped."""
    return f'"{"".join(one if one.isprintable() and one not in _ESCAPED else _escape(one) for one in text)}"'


def _escape(letter: str) -> str:
    return f"\\{letter}" if letter in _ESCAPED else f"\\U{ord(letter):08x}"


def _below(value: Tree | Written, indent: int) -> str:
    """A value as it may stand below a key or behind a dash: the first line without its indentation."""
    row = _flat(value)
    if not isinstance(value, dict | list) or not value or len(row) + indent <= LONGEST_ROW:
        return row
    pairs = value.items() if isinstance(value, dict) else [(None, one) for one in value]
    lines = [
        f"- {_below(one, indent + 2)}" if key is None else f"{_flat(str(key))}:{_after(one, indent)}"
        for key, one in pairs
    ]
    return f"\n{' ' * indent}".join(lines)


def _after(value: Tree | Written, indent: int) -> str:
    """What follows `key:` where the key begins at a column."""
    low = _below(value, indent + 2)
    return f"\n{' ' * (indent + 2)}{low}" if "\n" in low else f" {low}"


def _put(text: str, parent: _Node | None, node: _Node, value: Tree | Written) -> str:
    """Another value in place of a node."""
    head, tail = text[: node.start], text[node.end :]
    if parent is None:
        return f"{head}{_below(value, 0)}\n{tail.lstrip()}"
    if not node.flow and node.kind == "scalar":  # a block of lines takes its line break with it
        tail = "\n" + tail
    if parent.flow:
        new = _flat(value)
    elif parent.kind == "list":
        new = _below(value, parent.indent + 2)
    else:
        new = _after(value, parent.indent)
        key = head.rstrip()
        if key.endswith(":"):
            return key + new + tail
        new = new.removeprefix(" ")  # a comment stands between the key and its block, which begins on a line of its own
    return head + (" " if head.endswith((":", "-")) else "") + new + tail


def _added(text: str, starts: Sequence[int], block: _Node, step: Step, value: Tree | Written) -> str:
    """A new key, or row, at the end of a block that has some."""
    last = block.rows[-1][2]
    lead = "" if isinstance(step, int) else f"{_flat(step)}:"
    if block.flow:
        return f"{text[: last.end]}, {lead}{' ' if lead else ''}{_flat(value)}{text[last.end :]}"
    row = f"{lead}{_after(value, block.indent)}" if lead else f"- {_below(value, block.indent + 2)}"
    end = _line_after(text, starts, last)
    gap = "" if end == 0 or end in starts else "\n"
    return f"{text[:end]}{gap}{' ' * block.indent}{row}\n{text[end:]}"


def _line_after(text: str, starts: Sequence[int], node: _Node) -> int:
    """Where the line after a node begins; the end of a text whose last line has no end."""
    if node.end in starts and node.end > node.start:
        return node.end
    later = bisect_right(starts, node.end)
    return starts[later] if later < len(starts) else len(text)


def _cut(text: str, starts: Sequence[int], block: _Node, step: Step) -> str:
    """A block without one of its keys, or rows."""
    number = next(i for i, (_, key, _node) in enumerate(block.rows) if step in (key, i))
    begins, _, node = block.rows[number]
    following = block.rows[number + 1][0] if number + 1 < len(block.rows) else None
    if len(block.rows) == 1:
        line_break = "\n" if not block.flow and text[: block.end].endswith("\n") else ""
        return text[: block.start] + ("{}" if block.kind == "map" else "[]") + line_break + text[block.end :]
    if block.flow:
        if following is not None:
            return text[:begins] + text[following:]
        return text[: block.rows[number - 1][2].end] + text[node.end :]
    if block.kind == "list":  # the place of a row is that of its value: its dash stands before
        begins = text.rindex("-", 0, begins)
        following = None if following is None else text.rindex("-", 0, following)
    line = starts[bisect_right(starts, begins) - 1]
    if not text[line:begins].strip():
        return text[:line] + text[_line_after(text, starts, node) :]
    return text[:begins] + text[following:]  # the first key behind a dash: the next takes its place
