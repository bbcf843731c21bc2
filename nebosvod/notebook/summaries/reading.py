"""A summary, JSON as a command writes it, as the dataclasses made from its schema."""

import warnings
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np
from astropy import units as u
from astropy.time import Time

from nebosvod.borders.shape import schema_file
from nebosvod.notebook.summaries import shape
from nebosvod.notebook.summaries.shape import Node, Plan
from nebosvod.notebook.summaries.typed import Typed

NEBOSVOD = Path(__file__).resolve().parents[2]
S = TypeVar("S", bound=Typed)


def read(summary: Mapping[str, Any], kind: type[S]) -> S:
    """A summary as an object of the class that was made from its schema; keys that the schema lacks are left out."""
    root = schema_file(NEBOSVOD / kind.SCHEMA)
    return _object(summary, root, root, kind, "")


def _object(row: Mapping[str, Any], block: Node, root: Node, kind: type[S], unit: str) -> S:
    """One object of a class."""
    made = {}
    for plan in shape.plans(block, root, unit):
        key = next((one for one in plan.keys if row.get(one) is not None), None)
        node = plan.node if key in (None, plan.keys[0]) else shape.resolved(block["properties"][key], root)
        made[plan.name] = None if key is None else _value(row[key], node, root, plan, _class_of(kind, plan.name), key)
    return kind(**made)


def _value(value: Any, node: Node, root: Node, plan: Plan, kind: type[Typed] | None, key: str) -> Any:
    """A value that is not null."""
    if plan.unit == "time":
        return _moment(value, shape.divided(key, node, root)[1])
    unit = plan.unit if key == plan.keys[0] else shape.UNITS[shape.divided(key, node, root)[1]]
    return _plain(value, node, root, unit, kind)


def _plain(value: Any, node: Node, root: Node, unit: str, kind: type[Typed] | None) -> Any:
    """Numbers in their unit, objects in their class, lists of both."""
    if value is None:
        return None
    node = shape.resolved(node, root)
    for one in shape.branches(node, root):
        if isinstance(value, Mapping) and "object" in shape.kinds(one):
            if kind is not None and shape.is_class(one):
                return _object(value, one, root, kind, unit)
            known, other = one.get("properties", {}), one.get("additionalProperties")
            other = other if isinstance(other, Mapping) else {}
            return {name: _plain(each, known.get(name, other), root, unit, kind) for name, each in value.items()}
        if isinstance(value, list) and "array" in shape.kinds(one):
            items, levels = one.get("items", {}), shape.depth(one, root)
            if shape.holds_numbers(one, root) and levels <= 2 and shape.bottom(one, root) == {"number"}:
                array = np.array(value, dtype=np.float64)
                return u.Quantity(array, unit) if unit else array
            return tuple(_plain(each, items, root, unit, kind) for each in value)
    if unit and isinstance(value, int | float):
        return u.Quantity(value, unit)
    return float(value) if "number" in shape.kinds(node) and type(value) is int else value


def _moment(value: Any, ending: str) -> Time:
    """A moment, or several: text, or Julian dates."""
    scale = ending.removeprefix("jd_")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # erfa calls every UTC date to come dubious
        if ending.startswith("jd"):
            day, part = value if isinstance(value, list) else (value, 0.0)
            return Time(day, part, format="jd", scale=scale)
        texts = np.char.partition(np.array(value, dtype=str), " ")[..., 0]
        return Time(texts if texts.ndim else str(texts), format="isot", scale=scale)


@cache
def _classes(module: str, kind: str) -> Mapping[str, type[Typed] | None]:
    """The class that stands in the type of each field of a class."""
    names = vars(import_module(module))
    return {name: next(_within(hint), None) for name, hint in get_type_hints(names[kind], names).items()}


def _within(hint: Any) -> Iterator[type[Typed]]:
    if isinstance(hint, type) and issubclass(hint, Typed):
        yield hint
    for one in get_args(hint):
        yield from _within(one)


def _class_of(kind: type[Typed], name: str) -> type[Typed] | None:
    return _classes(kind.__module__, kind.__name__)[name]
