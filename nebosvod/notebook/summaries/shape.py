"""How a JSON Schema becomes dataclasses: which fields a block of a summary has, from which keys, of which type.

A key ends with its unit, a field does not: it is a quantity of astropy, or a moment as `Time`. Keys that say one thing
in two units (`distance_km`, `distance_au`) are one field. `tools/summaries.py` writes the classes, `reading` fills
them; both ask here, so that names stand in the schemas alone.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from keyword import iskeyword
from typing import Any

from nebosvod.borders.quantities import ENDINGS

Node = Mapping[str, Any]
UNITS: Mapping[str, str] = {**{key: unit for key, unit in ENDINGS.items() if key != "1"}, "h": "h", "d": "d"}
MOMENTS = ("jd_tdb", "tdb", "utc", "jd_utc")  # the first that there is is the field
MIXED = "km_km_s"  # several units: the key stays, its numbers are an array


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A field of a class.

    Parameters
    ----------
    keys : that say it, the one to read first.
    unit : in astropy's words, "time" for a moment, "" for neither; `scale` of a moment is the ending of its key.
    node : schema of the first key, without references; `optional` where there may be none.
    """

    name: str
    keys: tuple[str, ...]
    unit: str
    scale: str
    node: Node
    optional: bool


def plans(block: Node, root: Node, inherited: str = "") -> Iterator[Plan]:
    """The fields of an object, in the order of its schema.

    Parameters
    ----------
    block : schema of the object; root : the whole schema, where references lead.
    inherited : unit of numbers that name none, where the key of the object does.
    """
    found: dict[tuple[str, str], list[tuple[str, str, Node]]] = {}
    for key, given in block.get("properties", {}).items():
        node = resolved(given, root)
        name, ending = divided(key, node, root)
        found.setdefault((name, _dimension(ending)), []).append((key, ending, node))
    moments = {name for name, dimension in found if dimension == "time"}
    for (name, dimension), said in found.items():
        if dimension == "time":
            said.sort(key=lambda one: MOMENTS.index(one[1]))
        key, ending, node = said[0]
        free = key if dimension != "time" and name in moments else name
        required = any(one in block.get("required", ()) for one, _, _ in said)
        bare = inherited if holds_numbers(node, root) else ""
        yield Plan(
            name=f"{free}_" if iskeyword(free) else free, keys=tuple(one for one, _, _ in said),
            unit="time" if dimension == "time" else UNITS.get(ending, bare), scale=ending,
            node=node, optional=not required or may_be_null(node, root),
        )  # fmt: skip


def divided(key: str, node: Node, root: Node) -> tuple[str, str]:
    """A key without its unit, and the ending that says it; an empty ending where there is none."""
    text, number = holds_text(node, root), holds_numbers(node, root)
    for ending in MOMENTS:
        if (key == ending or key.endswith(f"_{ending}")) and (text or ending.startswith("jd")):
            return key.removesuffix(ending).removesuffix("_") or key, ending
    if number and not key.endswith(MIXED):
        for ending in sorted(UNITS, key=len, reverse=True):
            if key.endswith(f"_{ending}"):
                return key.removesuffix(f"_{ending}"), ending
    return key, ""


def resolved(node: Node, root: Node) -> Node:
    """A schema with what its reference leads to, whose own name and words are kept as `$name` and `$words`."""
    while "$ref" in node:
        target: Any = root
        name = str(node["$ref"]).removeprefix("#/").split("/")
        for part in name:
            target = target[part]
        said = {"$name": name[-1], "$words": target.get("description", "")}
        node = {**target, **said, **{key: value for key, value in node.items() if key != "$ref"}}
    return node


def branches(node: Node, root: Node) -> list[Node]:
    """What a value may be, but null."""
    choices = [resolved(one, root) for word in ("oneOf", "anyOf") for one in node.get(word, ())]
    return [one for one in choices or [node] if kinds(one) != {"null"}]


def kinds(node: Node) -> set[str]:
    """The types that a schema names."""
    named = node.get("type", ())
    return {named} if isinstance(named, str) else set(named)


def may_be_null(node: Node, root: Node) -> bool:
    """Whether a value may be null."""
    choices = [resolved(one, root) for word in ("oneOf", "anyOf") for one in node.get(word, ())] or [node]
    return any("null" in kinds(one) or (one.get("enum") and None in one["enum"]) for one in choices)


def holds_numbers(node: Node, root: Node) -> bool:
    """Whether it is a number, or lists or objects of numbers without units of their own."""
    (one, *others) = branches(node, root) or [{}]
    if others:
        return False
    if "array" in kinds(one):
        return holds_numbers(resolved(one.get("items", {}), root), root)
    if "object" in kinds(one):
        inside = [*one.get("properties", {}).values(), one.get("additionalProperties")]
        held = [resolved(each, root) for each in inside if isinstance(each, Mapping)]
        return bool(held) and all(holds_numbers(each, root) for each in held)
    return "number" in kinds(one) and "string" not in kinds(one)


def holds_text(node: Node, root: Node) -> bool:
    """Whether it is text, or lists of texts."""
    (one, *others) = branches(node, root) or [{}]
    if not others and "array" in kinds(one):
        return holds_text(resolved(one.get("items", {}), root), root)
    return not others and kinds(one) - {"null"} == {"string"}


def is_class(node: Node) -> bool:
    """Whether an object has names that can be those of fields; others become a mapping."""
    names = node.get("properties", {})
    return "object" in kinds(node) and bool(names) and all(name.isidentifier() for name in names)


def depth(node: Node, root: Node) -> int:
    """How many lists stand one in the other."""
    (one, *_) = branches(node, root) or [{}]
    return 1 + depth(resolved(one.get("items", {}), root), root) if "array" in kinds(one) else 0


def _dimension(ending: str) -> str:
    """One word for endings that may say the same thing."""
    return "time" if ending in MOMENTS else "length" if ending in ("km", "au", "m") else ending


def bottom(node: Node, root: Node) -> set[str]:
    """The types of what stands in the innermost list, but null."""
    (one, *_) = branches(node, root) or [{}]
    return bottom(resolved(one.get("items", {}), root), root) if "array" in kinds(one) else kinds(one) - {"null"}
