"""Write the dataclasses of summaries, `nebosvod/notebook/summaries/*.py`, from their JSON Schemas (`make schema`)."""

import builtins
import json
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

from nebosvod.borders.shape import schema_file
from nebosvod.notebook.summaries import shape
from nebosvod.notebook.summaries.shape import Node, Plan

ROOT = Path(__file__).resolve().parent.parent
PLACE = ROOT / "nebosvod" / "notebook" / "summaries"
SCHEMAS = (  # one that has a block of an earlier one takes the class from there
    "results/approaches",
    "results/ephemeris",
    "results/risk",
    "results/alert",
    "planning/plan",
    "planning/decision",
    "studies/study",
    "studies/validation",
    "results/comparison",
    "results/orbit_comparison",
)
HEAD = '''"""{title}, as dataclasses.

Made from nebosvod/{schema} by tools/summaries.py: change that, then `make schema`.
"""
'''
SCALARS = {"string": "str", "integer": "int", "number": "float", "boolean": "bool"}
TYPES = {"str": "text", "int": "a whole number", "float": "a number", "bool": "true or false", "Array": "an array"}
WIDTH = 116


class Writer:
    """Classes of one module after the other."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[str, str]] = {}  # block -> module, class

    def modules(self) -> Iterator[tuple[str, str]]:
        """Name and text of each module."""
        for file in SCHEMAS:
            schema = f"{file}.schema.json"
            module = _Module(file.rpartition("/")[2], schema_file(ROOT / "nebosvod" / schema), self._known)
            yield module.name, module.text(schema)


class _Module:
    """The classes of one schema."""

    def __init__(self, name: str, root: Node, known: dict[str, tuple[str, str]]) -> None:
        self.name, self.root, self.known = name, root, known
        self.classes: list[str] = []
        self.names = {"Quantity", "Time", "Mapping", "Array", *vars(builtins)}
        self.inside: list[str] = []
        self.imports: dict[str, set[str]] = {}
        self.measured = set(_measured(root, root))

    def text(self, schema: str) -> str:
        self._class(self.root, "".join(word.capitalize() for word in [*self.name.split("_"), "summary"]), schema)
        body = "\n\n\n".join(self.classes)
        lines = ["from collections.abc import Mapping"] if "Mapping[" in body else []
        lines += ["from dataclasses import dataclass"]
        typing = [word for word in ("Any", "ClassVar", "Literal") if re.search(rf"\b{word}\b", body)]
        lines += [f"from typing import {', '.join(typing)}"] if typing else []
        third = ["import numpy as np", "import numpy.typing as npt"] if "Array" in body else []
        third += ["from astropy.time import Time"] if re.search(r"\bTime\b", body) else []
        third += ["from astropy.units import Quantity"] if "Quantity" in body else []
        own = [
            f"from nebosvod.notebook.summaries.{module} import {', '.join(sorted(names))}"
            for module, names in self.imports.items()
        ]
        own += ["from nebosvod.notebook.summaries.typed import Typed"]
        parts = [*lines, "", *third, *([""] if third else []), *sorted(own), ""]
        parts += ["Array = npt.NDArray[np.float64]", ""] if "Array" in body else []
        title = str(self.root["title"])
        return "\n".join([HEAD.format(title=title, schema=schema), *parts, "", body, ""])

    def _class(self, block: Node, wanted: str, schema: str = "") -> str:
        """The name of the class of a block, written unless there is one already."""
        print_of = json.dumps(self._whole(block), sort_keys=True)
        if print_of in self.known:
            module, name = self.known[print_of]
            if module != self.name:
                self.imports.setdefault(module, set()).add(name)
            return name
        name = wanted
        for outer in reversed(self.inside):
            name = f"{outer}{name}" if name in self.names else name
        self.names.add(name)
        self.known[print_of] = (self.name, name)
        self.inside.append(name)
        inherited = "?" if print_of in self.measured else ""
        plans = list(shape.plans(block, self.root, inherited))
        types = [(one, self._type(one)) for one in plans]
        self.inside.pop()
        lines = ["@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)", f"class {name}(Typed):"]
        lines += [f"    {line}".rstrip() for line in self._doc(block, name, types)]
        lines += ["", *([f'    SCHEMA: ClassVar[str] = "{schema}"'] if schema else [])]
        lines += [f"    {one.name}: {kind}" for one, kind in types]
        self.classes.append("\n".join(lines))
        return name

    def _whole(self, node: object) -> object:
        """A block with what its references lead to, without its words."""
        return _whole(node, self.root)

    def _doc(self, block: Node, name: str, types: list[tuple[Plan, str]]) -> list[str]:
        title = block.get("$words") or block.get("description" if "$words" not in block else "title") or _words(name)
        lines = textwrap.wrap(f'"""{_python(str(title))}.', WIDTH - 4)
        said = {one.name: self._said(one) for one, _ in types}
        rows = [(field, words) for field, words in said.items() if words]
        plain: dict[str, list[str]] = {}
        for field, kind in types:
            if not said[field.name]:
                plain.setdefault(_of_type(kind), []).append(field.name)
        for kind, names in plain.items():  # what stands before a colon is one line
            rows += [(line.rstrip(","), kind) for line in textwrap.wrap(", ".join(names), WIDTH - 40)]
        lines += ["", "Parameters", "----------"]
        for field, text in rows:
            lines += textwrap.wrap(f"{field} : {text}.", WIDTH - 4, subsequent_indent="    ")
        return [*lines, '"""']

    def _said(self, plan: Plan) -> str:
        """What a field is: the schema's words, its size and unit."""
        words = _python(str(plan.node.get("description", "")))
        words = (
            words[:1].lower() + words[1:]
            if (words[1:2].islower() and not words.startswith("None ")) or words[1:2] == " "
            else words
        )
        levels = shape.depth(plan.node, self.root)
        size = _size(plan.node, self.root) if levels and plan.unit != "time" and self._numeric(plan) else ""
        unit = {"time": plan.scale.removeprefix("jd_").upper(), "?": "the unit of the key that holds it"}
        told = ", ".join(one for one in (size, unit.get(plan.unit, plan.unit)) if one)
        return "; ".join(one for one in (words, told if words else f"in {told}" if told else "") if one)

    def _numeric(self, plan: Plan) -> bool:
        return shape.holds_numbers(plan.node, self.root)

    def _type(self, plan: Plan) -> str:
        kind = "Time" if plan.unit == "time" else self._kind(plan.node, plan.unit, plan.keys[0])
        return f"{kind} | None" if plan.optional and not kind.endswith("None") else kind

    def _kind(self, node: Node, unit: str, key: str) -> str:
        """The type of a value that is not null."""
        node = shape.resolved(node, self.root)
        found = [self._one(each, unit, key) for each in shape.branches(node, self.root)]
        return " | ".join(dict.fromkeys(found)) or "None"

    def _one(self, node: Node, unit: str, key: str) -> str:
        if "enum" in node or "const" in node:
            words = node.get("enum", [node.get("const")])
            if all(isinstance(word, str) for word in words):
                return f"Literal[{', '.join(json.dumps(word) for word in words)}]"
        names = sorted(shape.kinds(node) - {"null"}, key=[*SCALARS, "array", "object"].index)
        return " | ".join(self._simple(node, name, unit, key) for name in names) or _of_const(node)

    def _simple(self, node: Node, name: str, unit: str, key: str) -> str:
        measure = {"": "", "?": "Quantity | float"}.get(unit, "Quantity")
        if name == "object":
            return self._of_object(node, unit, key)
        if name != "array":
            return measure if measure and name in ("number", "integer") else SCALARS[name]
        items = shape.resolved(node.get("items", {}), self.root)
        if shape.holds_numbers(node, self.root) and shape.bottom(node, self.root) == {"number"}:
            levels = shape.depth(node, self.root)
            flat = measure or "Array"
            return flat if levels <= 2 else f"{'tuple[' * (levels - 2)}{flat}{', ...]' * (levels - 2)}"
        inner = self._kind(items, unit, _single(key))
        return f"tuple[{inner}{' | None' if shape.may_be_null(items, self.root) else ''}, ...]"

    def _of_object(self, node: Node, unit: str, key: str) -> str:
        if shape.is_class(node):
            return self._class(node, _camel(str(node.get("title") or node.get("$name") or key)))
        values = [*node.get("properties", {}).values()]
        other = node.get("additionalProperties")
        values += [other] if isinstance(other, dict) else []
        found = dict.fromkeys(self._kind(value, unit, key) for value in values)
        null = any(shape.may_be_null(shape.resolved(value, self.root), self.root) for value in values)
        return f"Mapping[str, {' | '.join([*found, *(['None'] if null else [])]) or 'Any'}]"


def _of_type(kind: str) -> str:
    """The type of a field that the schema has no words for, in words."""
    inner = kind.removesuffix(" | None")
    if inner.startswith(("tuple[", "Mapping[str, ")):
        held = inner.partition("[")[2].removeprefix("str, ").removesuffix("]").removesuffix(", ...")
        words = (
            f"by name, {TYPES.get(held, held)}"
            if inner.startswith("Mapping")
            else f"several, each {TYPES.get(held, held)}"
        )
    else:
        words = TYPES.get(inner, inner)
    return f"{words}, or None" if inner != kind else words


def _python(words: str) -> str:
    """Words of a schema without their full stop, in those of Python."""
    return re.sub(r"\bnull\b", "None", words, flags=re.IGNORECASE).rstrip(".")


def _of_const(node: Node) -> str:
    return type(node["const"]).__name__ if "const" in node and node["const"] is not None else "Any"


def _whole(node: object, root: Node) -> object:
    if isinstance(node, dict):
        full = shape.resolved(node, root)
        return {
            key: _whole(value, root)
            for key, value in full.items()
            if key not in ("description", "title", "$defs", "$name", "$words") or isinstance(value, dict)
        }
    return [_whole(one, root) for one in node] if isinstance(node, list) else node


def _measured(node: Node, root: Node) -> Iterator[str]:
    """Blocks of bare numbers whose unit is that of the key that holds them."""
    for key, given in node.get("properties", {}).items():
        full = shape.resolved(given, root)
        for one in shape.branches(full, root):
            if shape.is_class(one) and shape.divided(key, full, root)[1]:
                yield json.dumps(_whole(one, root), sort_keys=True)
            yield from _measured(one, root)
    for below in ("items", "additionalProperties"):
        if isinstance(node.get(below), dict):
            for one in shape.branches(shape.resolved(node[below], root), root):
                yield from _measured(one, root)


def _size(node: Node, root: Node) -> str:
    """`(6,)` of a list whose length the schema holds; `(n, n)` of any."""
    sizes = []
    for one in shape.branches(node, root):
        while "array" in shape.kinds(one):
            fixed = one.get("maxItems") if one.get("maxItems") == one.get("minItems") else None
            sizes.append("n" if fixed is None else str(fixed))
            one = shape.resolved(one.get("items", {}), root)
    return f"({', '.join(sizes)}{',' if len(sizes) == 1 else ''})"


def _camel(key: str) -> str:
    words = re.split(r"[_\W]+", re.sub(r"_(deg|km|s)$", "", key))
    return "".join(word[:1].upper() + word[1:] for word in words)


def _single(key: str) -> str:
    """The name of one of several."""
    for plural, single in (("ices", "ex"), ("ches", "ch"), ("ies", "y"), ("ss", "ss"), ("nis", "nis"), ("s", "")):
        if key.endswith(plural):
            return key.removesuffix(plural) + single
    return key


def _words(name: str) -> str:
    text = re.sub(r"(?<!^)([A-Z])", lambda found: f" {found[1].lower()}", name)
    return f"{text[:1].upper()}{text[1:]}"


def main() -> None:
    """Write every module."""
    for name, text in Writer().modules():
        (PLACE / f"{name}.py").write_text(text, "utf-8")


if __name__ == "__main__":
    main()
