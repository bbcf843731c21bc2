"""Read a YAML 1.2 file into plain values, knowing the line and column of everything, within hard limits.

A flat pass over the parser's events builds the tree, so that no recursion and no object construction
happens: libyaml's composer dies by a signal on 100,000 nested brackets, YAML 1.1 rules read 12:30:00
as 45000, `no` as False and 1e-9 as text, and duplicate keys pass silently. What a mission never needs
(anchors, aliases, tags, several documents, keys that are not text) is refused.
"""

import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from nebosvod.errors import DataError, InputError, printable

MAX_BYTES = 1_000_000
MAX_DEPTH = 32
MAX_NODES = 50_000

KeyPath = tuple[str | int, ...]
Tree = dict[str, "Tree"] | list["Tree"] | str | int | float | bool | None

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_INTEGER = re.compile(r"[-+]?[0-9]+")
_BASED = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_SPECIAL = re.compile(r"([-+]?)\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_WORDS: dict[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_LONGEST_INTEGER = 300


@dataclass(frozen=True, slots=True, order=True)
class Mark:
    """A place in a file, both counted from 1."""

    line: int
    column: int


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """One thing that is wrong at one place: the text after `file:line:col:`."""

    mark: Mark
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class YamlFile:
    """The plain tree of a file and where everything in it stands.

    `keys` and `values` map the path of a node, such as ("telescopes", 0, "name"), to the place of its key
    (or list item) and of its value; `texts` maps a scalar to what was written. `problems` are duplicate keys.
    """

    name: str
    text: str
    tree: Tree
    keys: dict[KeyPath, Mark] = field(default_factory=dict)
    values: dict[KeyPath, Mark] = field(default_factory=dict)
    texts: dict[KeyPath, str] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()


def read_text(path: Path) -> str:
    """Read a small UTF-8 file, refusing at once whatever is not one (directory, pipe, device, 2 GB).

    Raises
    ------
    InputError
        If the path is no regular file, too large, or not UTF-8; gives line, column and byte value.
    DataError
        If the system refuses to read it.
    """
    name = shown(str(path))
    try:
        _require_regular(name, os.stat(path))
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with open(descriptor, "rb") as stream:
            _require_regular(name, os.fstat(descriptor))
            data = stream.read(MAX_BYTES + 1)
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{name}: no such file") from None
    except PermissionError as error:
        raise DataError(f"{name}: cannot be read ({error.strerror})") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{name}: is not a usable file name ({error})") from None
    if len(data) > MAX_BYTES:
        raise InputError(f"{name}: is larger than {MAX_BYTES} bytes; a mission is a few kilobytes")
    return _decode(name, data)


def shown(text: str, limit: int = 200) -> str:
    """Text made safe for a terminal: control characters and stray bytes escaped, long text cut."""
    return printable(text if len(text) <= limit else text[:limit] + "...")


def fail(name: str, mark: Mark, text: str) -> InputError:
    """The exception of one problem: `file:line:col: text`."""
    return InputError(f"{name}:{mark.line}:{mark.column}: {text}")


def parse_yaml(text: str, name: str) -> YamlFile:
    """Turn YAML text into a plain tree with the place of every node.

    Parameters
    ----------
    text : the document.
    name : what to call it in messages (the path as the user gave it).

    Raises
    ------
    InputError
        For a syntax error or a refused construct, as `file:line:col: what; hint`.
    """
    bad = _UNPRINTABLE.search(text)
    if bad:
        code = ord(bad[0])
        raise fail(name, _place(text, bad.start()), f"character U+{code:04X} is not allowed in YAML; delete it")
    builder = _Builder(name)
    try:
        for event in _events(text):
            builder.take(event)
    except yaml.MarkedYAMLError as error:
        _refuse_what_came_before(error, text, name)
        raise fail(name, _error_mark(error), _explain(error, text)) from None
    except yaml.YAMLError as error:
        raise fail(name, Mark(1, 1), f"not YAML: {shown(str(error))}") from None
    if not builder.began:
        raise fail(name, Mark(1, 1), 'the file is empty; "nebosvod init NAME.yaml" writes a mission to start from')
    return YamlFile(name, text, builder.root, builder.keys, builder.values, builder.texts, tuple(builder.problems))


def scalar(text: str, plain: bool = True) -> str | int | float | bool | None:
    """The value of a scalar by the YAML 1.2 core rules; a quoted one (`plain` False) is text."""
    if not plain:
        return text
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        return int(text) if len(text) <= _LONGEST_INTEGER else float(text)
    if _BASED.fullmatch(text):
        return int(text[2:], 8 if text[1] == "o" else 16) if len(text) <= _LONGEST_INTEGER else float("inf")
    if _FLOAT.fullmatch(text):
        return float(text)
    special = _SPECIAL.fullmatch(text)
    if special:
        return float("nan") if special[3] else float(f"{special[1]}inf")
    return text


class _Builder:
    """The tree under construction: one frame per open collection."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.root: Tree = None
        self.began = False
        self.keys: dict[KeyPath, Mark] = {}
        self.values: dict[KeyPath, Mark] = {}
        self.texts: dict[KeyPath, str] = {}
        self.problems: list[Problem] = []
        self.open: list[tuple[dict[str, Any] | list[Any], KeyPath]] = []
        self.key: list[str | None] = []
        self.documents = 0

    def take(self, event: yaml.Event) -> None:
        """Add one event of the parser."""
        mark = _mark(event.start_mark)
        if isinstance(event, yaml.DocumentStartEvent):
            self.documents += 1
            if self.documents > 1:
                raise fail(self.name, mark, 'a second document begins here ("---"); one file is one mission')
        elif isinstance(event, yaml.NodeEvent):
            self._node(event, mark)
        elif isinstance(event, yaml.CollectionEndEvent):
            self.open.pop()
            self.key.pop()

    def _node(self, event: yaml.NodeEvent, mark: Mark) -> None:
        """A scalar or the start of a collection."""
        if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
            raise fail(self.name, mark, "aliases and anchors (* and &) are not allowed; write the value out")
        tag = getattr(event, "tag", None)
        if tag is not None:
            raise fail(self.name, mark, f"tags are not allowed (got {shown(str(tag), 60)}); write the plain value")
        if len(self.values) >= MAX_NODES:
            raise fail(self.name, mark, f"more than {MAX_NODES} values in one file")
        if isinstance(event, yaml.ScalarEvent):
            if self._expects_key():
                self._take_key(event.value, mark)
                return
            path = self._place_value(scalar(event.value, event.implicit[0]), mark)
            self.texts[path] = event.value
            return
        if self._expects_key():
            raise fail(self.name, mark, "a key must be plain text, not a list or block")
        if len(self.open) >= MAX_DEPTH:
            raise fail(self.name, mark, f"nested deeper than {MAX_DEPTH}")
        new: dict[str, Any] | list[Any] = {} if isinstance(event, yaml.MappingStartEvent) else []
        path = self._place_value(new, mark)
        self.open.append((new, path))
        self.key.append(None)

    def _expects_key(self) -> bool:
        return bool(self.open) and isinstance(self.open[-1][0], dict) and self.key[-1] is None

    def _take_key(self, key: str, mark: Mark) -> None:
        """Remember a key; a second one of the same name is a problem that names both lines."""
        block, path = self.open[-1]
        here = (*path, key)
        if isinstance(block, dict) and key in block:
            first = self.keys[here]
            self.problems.append(
                Problem(mark, f"{dotted(here)}: this key is already on line {first.line}; keep one of the two")
            )
        else:
            self.keys[here] = mark
        self.key[-1] = key

    def _place_value(self, value: Tree, mark: Mark) -> KeyPath:
        """Put a value where it belongs and return its path; the first of duplicate keys stays."""
        if not self.open:
            self.root, self.began = value, value is not None
            self.values[()] = self.keys[()] = mark
            return ()
        block, path = self.open[-1]
        if isinstance(block, list):
            here: KeyPath = (*path, len(block))
            block.append(value)
            self.keys[here] = mark
        else:
            key = self.key[-1] or ""
            self.key[-1] = None
            here = (*path, key)
            if key in block:
                return (*path, key, "\0duplicate")
            block[key] = value
        self.values[here] = mark
        return here


def dotted(path: KeyPath) -> str:
    """A path as people write it: `telescopes[0].noise.sigma`."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else ("." if text else "") + shown(part, 60)
    return text


def _require_regular(name: str, status: os.stat_result) -> None:
    """Refuse what is not a regular file of modest size."""
    mode = status.st_mode
    if stat.S_ISDIR(mode):
        raise InputError(f"{name}: is a directory; give the file inside it")
    if not stat.S_ISREG(mode):
        raise InputError(f"{name}: is a pipe or a device, not a file")
    if status.st_size > MAX_BYTES:
        raise InputError(f"{name}: {status.st_size} bytes, larger than {MAX_BYTES}; a mission is a few kilobytes")


def _decode(name: str, data: bytes) -> str:
    """UTF-8 bytes -> text, with the place and value of the first byte that is not."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise fail(name, Mark(1, 1), f"UTF-16 byte order mark (byte 0x{data[0]:02X}); save the file as UTF-8")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        before = data[: error.start].decode("utf-8")
        byte = data[error.start]
        raise fail(name, _place(before, len(before)), f"byte 0x{byte:02X} is not UTF-8; save as UTF-8") from None
    return text.removeprefix("\ufeff")


def _place(text: str, offset: int) -> Mark:
    """Line and column of a character offset."""
    return Mark(text.count("\n", 0, offset) + 1, offset - (text.rfind("\n", 0, offset) + 1) + 1)


def _refuse_what_came_before(error: yaml.MarkedYAMLError, text: str, name: str) -> None:
    """Let our own limits speak first: the parser reads ahead and may stop, by a limit of its own, beyond ours."""
    mark = _error_mark(error)
    before = text.split("\n")[: mark.line]
    before[-1] = before[-1][: mark.column - 1]
    builder = _Builder(name)
    try:
        for event in _events("\n".join(before)):
            builder.take(event)
    except yaml.YAMLError:
        return  # cut in the middle, of course


def _events(text: str) -> Iterator[yaml.Event]:
    """The parser's events, pulled one by one so that limits stop it early."""
    yield from yaml.parse(text, Loader=_LOADER)


def _mark(mark: Any) -> Mark:
    """The parser's mark (counted from 0, or none) as ours."""
    return Mark(mark.line + 1, mark.column + 1) if mark is not None else Mark(1, 1)


def _error_mark(error: yaml.MarkedYAMLError) -> Mark:
    return _mark(error.problem_mark or error.context_mark)


def _explain(error: yaml.MarkedYAMLError, text: str) -> str:
    """The parser's words, and a hint for the mistakes people make."""
    what = f"not YAML: {shown(str(error.problem or error.context or error))}"
    if error.context and error.problem:
        began = f" that began on line {error.context_mark.line + 1}" if error.context_mark is not None else ""
        what += f" ({shown(str(error.context))}{began})"
    lines = text.split("\n")
    row = _error_mark(error).line - 1
    if row < len(lines) and "\t" in lines[row][: len(lines[row]) - len(lines[row].lstrip())]:
        return what + "; indent by spaces, not tabs"
    return what + "; look for a bracket or quote left open, or an indentation that does not fit"
