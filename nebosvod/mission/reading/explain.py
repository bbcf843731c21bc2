"""Validation errors in the user's words and at the user's lines."""

import re
from collections.abc import Mapping
from difflib import get_close_matches
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from nebosvod.mission.fields import Complaints, KeyPath
from nebosvod.mission.found import FOUND
from nebosvod.mission.model import Mission
from nebosvod.mission.reading import forms
from nebosvod.mission.yaml.inherit import Aliases, original
from nebosvod.mission.yaml.yamlfile import Mark, Problem, Tree, YamlFile, dotted, shown

MOST_EXPLAINED = 1000  # of one file; fifty are shown, in the order of the file
_KINDS = {
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "tuple_type": "a list (lines that begin with a dash, or [a, b])",
    "dict_type": "a block of keys",
    "model_type": "a block of keys",
    "model_attributes_type": "a block of keys",
    "int_from_float": "a whole number",
}
_BOUNDS = {
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "less than {lt:g}",
    "less_than_equal": "{le:g} or less",
}
_QUOTED = re.compile(r"'([^']*)'")


class Explainer:
    """Knows where everything of one file stands, and turns pydantic's errors into problems."""

    def __init__(self, file: YamlFile, tree: Tree, aliases: Aliases, root: type[BaseModel] = Mission) -> None:
        self.root = root
        self.file = file
        self.tree = tree
        self.aliases = aliases

    def mark(self, path: KeyPath, key: bool = False) -> Mark:
        """Where a path stands; a block stands at its key; what does not exist, at the block it should be in."""
        path = original(path, self.aliases)
        for length in range(len(path), -1, -1):
            here = path[:length]
            if here in self.file.values:
                whole_block = length < len(path) or here not in self.file.texts
                if here in self.file.keys and (key or whole_block):
                    return self.file.keys[here]
                return self.file.values[here]
        return Mark(1, 1)

    def problem(self, path: KeyPath, text: str, key: bool = False) -> Problem:
        """A problem at a path."""
        field = dotted(path)
        return Problem(self.mark(path, key), f"{field}: {text}" if field else text)

    def explain(self, error: ValidationError) -> list[Problem]:
        """All problems of a failed validation."""
        problems = []
        details = error.errors(include_url=False, include_input=False)[:MOST_EXPLAINED]
        misspelt = {
            (detail["loc"][:-1], near)
            for detail in details
            if detail["type"] == "extra_forbidden" and (near := _near_key(self.root, detail["loc"]))
        }
        for detail in details:
            if detail["type"] == "missing" and (detail["loc"][:-1], detail["loc"][-1]) in misspelt:
                continue  # one typing error is one problem, told at the key that stands there
            path, rest = self._path(detail["loc"])
            problems += self._explain_one(detail, path, rest)
        return problems

    def _explain_one(self, detail: ErrorDetails, path: KeyPath, rest: KeyPath) -> list[Problem]:
        kind, context = detail["type"], detail.get("ctx", {})
        if kind in ("too_short", "too_long") and self._length_is_right(path, context):
            return []  # pydantic counts the valid rows only, and the others have been reported
        if kind == "missing":
            return [self.problem((*path, *rest[-1:]), "is missing; every block of this kind needs it")]
        if kind == "extra_forbidden":
            near, known = _near_key(self.root, detail["loc"]), ", ".join(_keys_at(self.root, detail["loc"][:-1]))
            hint = f'; did you mean "{near}"?' if near else ""
            return [self.problem(path, f"unknown key (allowed here: {known}){hint}", key=True)]
        if kind == "union_tag_not_found":
            tag = context["discriminator"].strip("'")
            if not isinstance(self._value(path), dict):
                text = f"needs a block of keys{self._got(path)}{forms.block_hint(path, self._value(path))}"
                return [self.problem(path, text)]
            return [self.problem((*path, tag), "is missing; it says which form the block has")]
        if kind == "union_tag_invalid":
            tag = context["discriminator"].strip("'")
            said = str(context["tag"])
            hint = forms.kind_hint(path, said) if tag == "kind" else ""
            return [self.problem((*path, tag), _choice(said, context["expected_tags"], hint))]
        if kind == "value_error" and isinstance(context["error"], Complaints):
            return [self.problem((*path, *at), text) for at, text in context["error"].items]
        return [self.problem(path, self._sentence(kind, context, path, detail["msg"]))]

    def _length_is_right(self, path: KeyPath, context: Mapping[str, Any]) -> bool:
        value = self._value(path)
        least, most = context.get("min_length", 0), context.get("max_length")
        return isinstance(value, list) and len(value) >= least and (most is None or len(value) <= most)

    def _sentence(self, kind: str, context: Mapping[str, Any], path: KeyPath, message: str) -> str:
        if kind == "value_error":
            spread = forms.spread_hint(path, self._value(path))
            return (
                f"needs one number with a unit, or a block{self._got(path)}{spread}"
                if spread
                else str(context["error"])
            )
        if kind == "literal_error":
            value = self._value(path)
            return (
                _choice(str(value), context["expected"], forms.prior_hint(path, value))
                if isinstance(value, str)
                else (f"is not one of the choices{self._got(path, context['expected'])}")
            )
        if kind in _KINDS:
            hint = forms.block_hint(path, self._value(path)) if "block" in _KINDS[kind] else ""
            if kind == "tuple_type" and isinstance(self._value(path), dict):
                hint = f"; put a dash before its first key, or write {path[-1]}: [{{...}}]"
            return f"needs {_KINDS[kind]}{self._got(path)}{hint or forms.spread_hint(path, self._value(path))}"
        if kind in _BOUNDS:
            return f"is out of range{self._got(path, _BOUNDS[kind].format(**context))}"
        if kind == "finite_number":
            return f"needs a finite number{self._got(path)}"
        if kind in ("too_short", "too_long"):
            bound = context.get("min_length", context.get("max_length"))
            word = "at least" if kind == "too_short" else "at most"
            return f"has the wrong length (got {context['actual_length']}; allowed {word} {bound})"
        return shown(message[:1].lower() + message[1:])

    def _got(self, path: KeyPath, allowed: str = "") -> str:
        """` (got X; allowed Y)`, X as it stands in the file."""
        tail = f"; allowed {allowed}" if allowed else ""
        value = self._value(path)
        if isinstance(value, str):
            return f' (got "{shown(value, 60)}"{tail})'
        text = self.file.texts.get(original(path, self.aliases))
        if text is not None:
            return f" (got {shown(text, 60) or 'nothing'}{tail})"
        names: dict[type, str] = {dict: "a block", list: "a list", type(None): "nothing"}
        return f" (got {names.get(type(value)) or shown(str(value), 60)}{tail})"

    def _value(self, path: KeyPath) -> Any:
        value: Any = self.tree
        for part in path:
            value = value[part]
        return value

    def _path(self, location: tuple[int | str, ...]) -> tuple[KeyPath, KeyPath]:
        """Split a location into the path that exists in the file, union tags left out, and the part that does not."""
        value: Any = self.tree
        path: list[int | str] = []
        rest: list[int | str] = []
        tagged = False  # whether the union tag of this block has been passed: it comes first, and may be a key's name
        for part in location:
            if not tagged and isinstance(value, dict) and part in (value.get("kind"), value.get("plane")):
                tagged = True
                continue
            inside_block = isinstance(value, dict) and isinstance(part, str) and part in value
            inside_list = isinstance(value, list) and isinstance(part, int) and part < len(value)
            if not rest and (inside_block or inside_list):
                value, tagged = value[part], False
                path.append(part)
            elif not (isinstance(value, dict) and part in ("block", "word")):
                rest.append(part)
        return tuple(path), tuple(rest)


def _near_key(root: type[BaseModel], location: tuple[int | str, ...]) -> str:
    """What may have been meant by the unknown key at the end of a location; empty if nothing is near."""
    by_lower = {key.lower(): key for key in _keys_at(root, location[:-1])}
    near = get_close_matches(str(location[-1])[:40].lower(), by_lower, 1, 0.6)
    return by_lower[near[0]] if near else ""


def _choice(got: str, expected: str, form: str = "") -> str:
    """A word that is not one of the choices; `form` is told where it is not a choice misspelt."""
    words = _QUOTED.findall(expected)
    meant = forms.other_word(got[:40], words)
    near = [meant] if meant else get_close_matches(got[:40], words, 1, 0.8 if form else 0.5)
    hint = f'; did you mean "{near[0]}"?' if near else form
    return f'is not one of the choices (got "{shown(got, 60)}"; allowed {", ".join(words)}){hint}'


def _keys_at(root: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """The keys that the block at a location below the root may have."""
    models: list[type[BaseModel]] = [root]
    for part in location:
        if not isinstance(part, str):
            continue
        fields = [_field(model, part) for model in models]
        found = [model for annotation in fields if annotation is not None for model in _models(annotation)]
        models = found or [model for model in models if part in _tags(model)] or models
    return [
        key
        for key in dict.fromkeys(field.alias or name for model in models for name, field in model.model_fields.items())
        if key != FOUND
    ]


def _field(model: type[BaseModel], key: str) -> Any:
    """The annotation of a key of a model."""
    return next((f.annotation for name, f in model.model_fields.items() if (f.alias or name) == key), None)


def _models(annotation: Any) -> list[type[BaseModel]]:
    """The blocks inside an annotation: of a union, a tuple, a mapping, or the block itself."""
    origin = get_origin(annotation)
    if origin in (Union, UnionType, Annotated, tuple, dict):
        return [model for part in get_args(annotation) for model in _models(part)]
    return [annotation] if isinstance(annotation, type) and issubclass(annotation, BaseModel) else []


def _tags(model: type[BaseModel]) -> tuple[str, ...]:
    """The words that select a model in a union."""
    for name in ("kind", "plane"):
        field = model.model_fields.get(name)
        if field is not None and get_origin(field.annotation) is Literal:
            return get_args(field.annotation)
    return ()
