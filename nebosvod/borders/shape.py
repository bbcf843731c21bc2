"""Whether a value has the shape a JSON Schema asks for: the part of Draft 2020-12 that the schemas of this program use.

The package jsonschema does it all, and brings four packages and 60 ms; the tests hold this against it.
"""

import json
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from nebosvod.errors import InputError

Schema = Mapping[str, Any]
TYPES: Mapping[str, tuple[type, ...]] = {
    "object": (dict,), "array": (list,), "string": (str,), "number": (int, float), "integer": (int,),
    "boolean": (bool,), "null": (type(None),),
}  # fmt: skip


@cache
def schema_file(path: Path) -> Schema:
    """A schema, read once."""
    found: Schema = json.loads(path.read_text("utf-8"))
    return found


def require_shape(name: object, value: Any, schema: Schema) -> None:
    """Raise InputError with `name` and the key unless the value has the shape; unknown keys may be there."""
    for key, said in _wrong(value, schema, schema, ""):
        raise InputError(f"{name}: {key or 'the whole'}: {said}; make the run again")


def _wrong(value: Any, schema: Any, root: Schema, key: str) -> Iterator[tuple[str, str]]:
    """Key and sentence of everything that is wrong."""
    if not isinstance(schema, Mapping):
        return
    if reference := schema.get("$ref"):
        yield from _wrong(value, _target(root, reference), root, key)
    kinds = schema.get("type")
    if kinds is not None and not any(_is(value, kind) for kind in ([kinds] if isinstance(kinds, str) else kinds)):
        yield key, f"needs {kinds if isinstance(kinds, str) else ' or '.join(kinds)} (got {_shown(value)})"
        return
    if "const" in schema and not _same(value, schema["const"]):
        yield key, f"needs {schema['const']!r} (got {_shown(value)})"
    if "enum" in schema and not any(_same(value, one) for one in schema["enum"]):
        yield key, f"needs one of {', '.join(map(str, schema['enum']))} (got {_shown(value)})"
    for word in ("oneOf", "anyOf"):
        if word in schema:
            found = [list(_wrong(value, one, root, key)) for one in schema[word]]
            if all(found):  # of the one whose kind it has
                yield min(found, key=lambda wrong: (wrong[0][0] == key, len(wrong)))[0]
    if "if" in schema and not any(_wrong(value, schema["if"], root, key)):
        yield from _wrong(value, schema.get("then"), root, key)
    if isinstance(value, dict):
        yield from _wrong_object(value, schema, root, key)
    elif isinstance(value, list):
        yield from _wrong_array(value, schema, root, key)
    else:
        yield from _wrong_scalar(value, schema, key)


def _wrong_object(value: dict[str, Any], schema: Schema, root: Schema, key: str) -> Iterator[tuple[str, str]]:
    inside = f"{key}." if key else ""
    for name in schema.get("required", ()):
        if name not in value:
            yield f"{inside}{name}", "the file lacks it"
    known = schema.get("properties", {})
    patterns = schema.get("patternProperties", {})
    for name, item in value.items():
        own = [known[name]] if name in known else []
        own += [one for pattern, one in patterns.items() if re.search(pattern, name)]
        for one in own or [schema.get("additionalProperties")]:
            yield from _wrong(item, one, root, f"{inside}{name}")


def _wrong_array(value: list[Any], schema: Schema, root: Schema, key: str) -> Iterator[tuple[str, str]]:
    least, most = schema.get("minItems", 0), schema.get("maxItems", len(value))
    if not least <= len(value) <= most:
        wanted = str(least) if least == most else f"{least} to {most}" if "maxItems" in schema else f"{least} or more"
        yield key, f"needs {wanted} items (got {len(value)})"
    if schema.get("uniqueItems") and len({json.dumps(item, sort_keys=True) for item in value}) < len(value):
        yield key, "has an item twice"
    for place, item in enumerate(value):
        yield from _wrong(item, schema.get("items"), root, f"{key}[{place}]")


def _wrong_scalar(value: Any, schema: Schema, key: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, str):
        if "pattern" in schema and not re.search(schema["pattern"], value):
            yield key, f"needs text like {schema['pattern']} (got {_shown(value)})"
    elif isinstance(value, int | float) and not isinstance(value, bool):
        if value < schema.get("minimum", value):
            yield key, f"needs at least {schema['minimum']} (got {value})"
        if value > schema.get("maximum", value):
            yield key, f"needs at most {schema['maximum']} (got {value})"
        if "exclusiveMinimum" in schema and value <= schema["exclusiveMinimum"]:
            yield key, f"needs more than {schema['exclusiveMinimum']} (got {value})"


def _is(value: Any, kind: str) -> bool:
    """JSON's own idea: truth values are no numbers, and 1.0 is an integer."""
    if isinstance(value, bool):
        return kind == "boolean"
    if kind == "integer" and isinstance(value, float):
        return value.is_integer()
    return isinstance(value, TYPES[kind])


def _same(value: Any, wanted: Any) -> bool:
    return isinstance(value, bool) == isinstance(wanted, bool) and bool(value == wanted)


def _target(root: Schema, reference: str) -> Any:
    found: Any = root
    for part in reference.removeprefix("#/").split("/"):
        found = found[part]
    return found


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=True)
    return text if len(text) <= 40 else f"{text[:37]}..."
