"""Write docs/mission-reference.md, every key of the mission file, from the schema that checks it (`make schema`)."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from nebosvod.mission.reading.schema import mission_schema

PAGE = Path(__file__).parent.parent / "docs" / "mission-reference.md"
HEAD = """# Every key of the mission file

Made from the schema that checks a mission (`nebosvod schema`), so it is complete; [the mission file](mission.md)
explains the same keys in context. A key that is neither required nor has a default may be left out; any other key is an
error. Quantities are shown by an example of how they are written.
"""
Schema = dict[str, Any]


def page(schema: Schema) -> str:
    """The whole page: the head of the file first, then each block where it is first named."""
    blocks = [("Head", schema)]
    blocks += [(name, schema["$defs"][name]) for name in _order(schema)]
    return HEAD + "".join(_section(name, block, schema) for name, block in blocks)


def _order(schema: Schema) -> list[str]:
    """Names of all blocks, each after the one that names it first; relaxed copies (`...Like`) are left out."""
    found: list[str] = []

    def visit(block: Schema) -> None:
        for name in _named(block):
            if name not in found and not name.endswith("Like"):
                found.append(name)
                visit(schema["$defs"][name])

    visit({"properties": schema["properties"]})
    return found


def _named(node: Any) -> Iterator[str]:
    """Blocks that a part of the schema refers to, in order."""
    if isinstance(node, dict):
        if "$ref" in node:
            yield node["$ref"].rpartition("/")[2]
        for key, value in node.items():
            if key not in ("discriminator", "$defs"):
                yield from _named(value)
    elif isinstance(node, list):
        for value in node:
            yield from _named(value)


def _section(name: str, block: Schema, schema: Schema) -> str:
    if block.get("type") != "object" and "properties" not in block:
        return f"\n## {name}\n\n{_text(block)}: {_kind(block, schema)}.\n"
    required = block.get("required", [])
    rows = [
        f"| `{key}` | {_kind(value, schema)} | {_default(key, value, required)} | {_own_text(value)} |"
        for key, value in block["properties"].items()
    ]
    intro = f"\n{_text(block)}\n" if _text(block) else ""
    return f"\n## {name}\n{intro}\n| key | value | default | meaning |\n|---|---|---|---|\n" + "\n".join(rows) + "\n"


def _kind(node: Schema, schema: Schema) -> str:
    """What may stand there, in words."""
    if "$ref" in node:
        name = node["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})" if not name.endswith("Like") else ""
    for key in ("anyOf", "oneOf"):
        if key in node:
            return " or ".join(dict.fromkeys(kind for one in node[key] if (kind := _kind(one, schema)) != "nothing"))
    if "if" in node:
        return _kind(node["else"], schema)
    if "const" in node or "enum" in node:
        return ", ".join(f"`{json.dumps(one).strip(chr(34))}`" for one in node.get("enum", [node.get("const")]))
    if node.get("type") == "array":
        return f"list of {_kind(node.get('items', {}), schema) or 'values'}"
    if node.get("type") == "null":
        return "nothing"
    if node.get("type") == "object":
        return "block"
    return _scalar(node)


def _scalar(node: Schema) -> str:
    """A number or text, with its range or an example."""
    if node.get("examples"):
        return f"`{node['examples'][0]}`"
    kind = {"integer": "whole number", "number": "number", "boolean": "true or false", "string": "text"}.get(
        str(node.get("type")), "value"
    )
    bounds = [
        f"{sign} {node[key]}"
        for key, sign in (("minimum", ">="), ("exclusiveMinimum", ">"), ("maximum", "<="), ("exclusiveMaximum", "<"))
        if key in node
    ]
    return f"{kind} {', '.join(bounds)}".strip()


def _default(key: str, node: Schema, required: list[str]) -> str:
    if key in required:
        return "required"
    value = node.get("default")
    return "" if value is None or isinstance(value, dict | list) else f"`{json.dumps(value).strip(chr(34))}`"


def _own_text(node: Schema) -> str:
    """The meaning of a key; where the key has none of its own, what its kind of value says of itself."""
    if "description" in node:
        return _text(node)
    texts = [_text(one) for key in ("anyOf", "oneOf") for one in node.get(key, []) if "description" in one]
    return texts[0] if len(texts) == 1 else ""


def _text(node: Schema) -> str:
    return " ".join(str(node.get("description", "")).split()).replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(mission_schema()), encoding="utf-8")
