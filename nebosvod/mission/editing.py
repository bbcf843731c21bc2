"""A mission as a file says it: the tree of a mission in memory, its text, and the tree with one place changed.

What is edited in Python is written down and read again, so that it is checked like a file and its text is what runs.
"""

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import numpy as np
import yaml
from pydantic import BaseModel

from nebosvod.borders.quantities import duration_s, is_moment, is_quantity, moment
from nebosvod.errors import InputError
from nebosvod.mission.fields import Parsed, epoch_text
from nebosvod.mission.yaml.yamlfile import Tree, scalar, shown
from nebosvod.timescale import Epoch

Step = str | int
NAMED = "name"


class _Dumper(yaml.SafeDumper):
    """Text that the reader of missions takes for text stands in quotes only where it must."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _text_node(dumper: yaml.SafeDumper, value: str) -> yaml.ScalarNode:
    plain = isinstance(scalar(value), str)
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style=None if plain else '"')


_Dumper.add_representer(str, _text_node)


def as_text(tree: Tree) -> str:
    """The tree as YAML, in the order of its keys; rows of plain values on one line."""
    return str(yaml.dump(tree, Dumper=_Dumper, allow_unicode=True, sort_keys=False, default_flow_style=None, width=110))


def as_tree(block: BaseModel) -> dict[str, Tree]:
    """What a file would say to give this block: the keys that were set, in units of the program."""
    found: dict[str, Tree] = {}
    for name, field in type(block).model_fields.items():
        if name in block.model_fields_set:
            found[field.alias or name] = _written(getattr(block, name), field.annotation, tuple(field.metadata))
    return found


def _written(value: Any, annotation: Any, metadata: tuple[Any, ...] = ()) -> Tree:
    """One value by the annotation of its field."""
    if isinstance(value, BaseModel):
        return as_tree(value)
    parsed = next((one for one in metadata if isinstance(one, Parsed)), None)
    if value is None or isinstance(value, bool):
        return value
    if parsed is not None and parsed.write is not None and not isinstance(value, str):
        told: Tree = parsed.write(value)
        return told
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _written(value, inner[0], inner[1:])
    if origin in (Union, UnionType):
        kinds = [one for one in inner if one is not type(None)]
        return _written(value, next((one for one in kinds if get_origin(one) is Annotated), kinds[0]))
    if isinstance(value, Mapping):
        return {str(key): _written(one, inner[1] if len(inner) == 2 else Any) for key, one in value.items()}
    if isinstance(value, tuple | list):
        return [_written(one, inner[0] if inner else Any) for one in value]
    return plain(value)


def plain(value: Any) -> Tree:
    """A value somebody hands over as a file would say it: quantities and moments with their unit and scale."""
    if isinstance(value, BaseModel):
        return as_tree(value)
    if isinstance(value, np.generic | np.ndarray) and not is_quantity(value):
        return value.tolist()  # type: ignore[no-any-return]
    if is_quantity(value):
        unit = value.unit.to_string().replace(" ", "").replace("d2", "d^2").replace("m3", "m^3").replace("cm3", "cm^3")
        numbers = np.asarray(value.value).tolist()
        return [f"{one!r} {unit}" for one in numbers] if isinstance(numbers, list) else f"{numbers!r} {unit}"
    if isinstance(value, Epoch) or is_moment(value):
        return epoch_text(moment(value))
    if (seconds := duration_s(value)) is not None:
        return f"{seconds!r} s"
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, tuple | list):
        return [plain(one) for one in value]
    if value is None or isinstance(value, str | int | float):
        return value
    raise InputError(f"a mission cannot hold a {type(value).__name__}; say it as the file would")


def edited(tree: Tree, path: str | Sequence[Step], value: Any) -> Tree:
    """The tree with the value at every place that `path` names; None leaves the key out.

    Parameters
    ----------
    path : keys joined by points, or a sequence of them; in a list an index, the name of an element, or `*` for all.

    Raises
    ------
    InputError
        If the path leads through something that is not there; says what is.
    """
    steps: tuple[Step, ...] = tuple(path.split(".")) if isinstance(path, str) else tuple(path)
    where = ".".join(str(step) for step in steps)
    if not steps or any(isinstance(step, str) and not step.strip() for step in steps):
        raise InputError(f'"{shown(where, 80)}" is no path of a mission; such as telescopes.*.noise.sigma')
    return _changed(tree, steps, plain(value), where)


def _changed(node: Tree, steps: tuple[Step, ...], value: Tree, where: str) -> Tree:
    """A copy of the node with the value below it."""
    if not steps:
        return value
    step, rest = steps[0], steps[1:]
    if isinstance(node, list):
        chosen = set(_chosen(node, step, where))
        kept = [_changed(one, rest, value, where) if k in chosen else one for k, one in enumerate(node)]
        return kept if rest or value is not None else [one for k, one in enumerate(node) if k not in chosen]
    if node is not None and not isinstance(node, dict):
        node = {"value": node}  # the short form of an uncertain number
    block = dict(node or {})
    keys = list(block) if step == "*" else [str(step)]
    for key in keys:
        if not rest and value is None:
            block.pop(key, None)
        else:
            block[key] = _changed(block.get(key), rest, value, where)
    return block


def _chosen(rows: Sequence[Tree], step: Step, where: str) -> Iterator[int]:
    """Places in a list that a step of the path means."""
    names = [row.get(NAMED) if isinstance(row, dict) else None for row in rows]
    if step == "*":
        yield from range(len(rows))
    elif step in names:
        yield names.index(str(step))
    elif str(step).lstrip("-").isdigit() and -len(rows) <= int(step) < len(rows):
        yield int(step) % len(rows)
    else:
        known = [str(name) for name in names if name is not None]
        near = get_close_matches(str(step), known, 1)
        hint = f'; did you mean "{near[0]}"?' if near else ""
        have = ", ".join(f'"{shown(name, 40)}"' for name in known[:10])
        raise InputError(
            f'{where}: "{shown(str(step), 60)}" is no element there (got {len(rows)} elements'
            f"{': ' + have if have else ''}; allowed: a name, 0 to {len(rows) - 1}, or *){hint}"
        )
