"""The JSON Schema of the mission file, for editors."""

import copy
from typing import Any

from nebosvod.mission.fit import FitMission
from nebosvod.mission.model import Mission

_SUFFIX = "Like"


def mission_schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a mission file, as editors use it.

    A telescope with `like` need not say anything else, so it has a schema of its own without required keys.
    """
    schema = Mission.model_json_schema(by_alias=True)
    definitions = schema["$defs"]
    for name in _reachable("Telescope", definitions):
        definitions[name + _SUFFIX] = _relaxed(definitions[name])
    definitions["Telescope" + _SUFFIX]["required"] = ["name", "like"]
    own, inherited = ({"$ref": f"#/$defs/Telescope{end}"} for end in ("", _SUFFIX))
    schema["properties"]["telescopes"]["items"] = {
        "if": {"required": ["like"]}, "then": inherited, "else": own
    }  # fmt: skip
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "nebosvod mission",
        **{key: value for key, value in schema.items() if key not in ("title", "$defs")},
        "$defs": dict(sorted(definitions.items())),
    }


def fit_schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a file for `nebosvod fit`."""
    schema = FitMission.model_json_schema(by_alias=True)
    used = {name for value in schema["properties"].values() for ref in _references(value) for name in [ref]}
    definitions = schema["$defs"]
    kept = {
        name: definitions[name]
        for start in sorted(used)
        for name in _reachable(start.removeprefix("#/$defs/"), definitions)
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "nebosvod fit",
        **{key: value for key, value in schema.items() if key not in ("title", "$defs")},
        "$defs": dict(sorted(kept.items())),
    }


def _reachable(start: str, definitions: dict[str, Any]) -> list[str]:
    """Names of the definitions that one uses, itself included."""
    found, todo = [], [start]
    while todo:
        name = todo.pop()
        if name not in found:
            found.append(name)
            todo += [ref.removeprefix("#/$defs/") for ref in _references(definitions[name])]
    return found


def _references(node: Any) -> list[str]:
    if isinstance(node, dict):
        own = [node["$ref"]] if isinstance(node.get("$ref"), str) else []
        return own + [ref for value in node.values() for ref in _references(value)]
    return [ref for item in node for ref in _references(item)] if isinstance(node, list) else []


def _relaxed(node: Any) -> Any:
    """A copy without required keys, whose references are to such copies too, and where any value may be null."""
    if isinstance(node, list):
        return [_relaxed(item) for item in node]
    if not isinstance(node, dict):
        return copy.copy(node)
    relaxed = {key: _relaxed(value) for key, value in node.items() if key not in ("required", "discriminator")}
    if isinstance(relaxed.get("$ref"), str):
        relaxed["$ref"] += _SUFFIX
    if "oneOf" in relaxed:
        relaxed["anyOf"] = relaxed.pop("oneOf")
    if isinstance(relaxed.get("properties"), dict):
        properties = relaxed["properties"].items()
        relaxed["properties"] = {key: {"anyOf": [value, {"type": "null"}]} for key, value in properties}
    return relaxed
