"""One place of a mission's text changed: the tree says what was meant, and every other letter stays."""

import random
from pathlib import Path
from typing import Any

import pytest

from nebosvod.errors import InputError
from nebosvod.mission.reading.builtin import builtin_names, builtin_path
from nebosvod.mission.rewriting import Written, rewritten
from nebosvod.mission.yaml.yamlfile import parse_yaml

TEXT = """\
# a mission
name: x  # its name
radius: {value: 185 m, sigma: 10 m}  # both
telescopes:  # two
  - name: A
    noise: {sigma: 0.1 arcsec}   # camera

  # the second
  - {name: B, noise: {sigma: 0.2 arcsec}}
note: |
  two
  lines
title:
last: [1 km, 2 km]
"""


@pytest.mark.parametrize(
    ("path", "value", "old", "new"),
    [
        (("name",), "y", "name: x  #", "name: y  #"),
        (("name",), "yes: [a] # b", "name: x  #", 'name: "yes: [a] # b"  #'),
        (("name",), "12", "name: x  #", 'name: "12"  #'),
        (("radius", "sigma"), Written("0.10"), "sigma: 10 m}", "sigma: 0.10}"),
        (("radius", "treatment"), "considered", "10 m}", "10 m, treatment: considered}"),
        (("radius", "value"), None, "{value: 185 m, sigma", "{sigma"),
        (("radius",), "170 m", "{value: 185 m, sigma: 10 m}  #", "170 m  #"),
        (("telescopes", 0, "noise", "sigma"), "0.3 arcsec", "0.1 arcsec}   # camera", "0.3 arcsec}   # camera"),
        (("telescopes", 0, "bias"), {"sigma": "1 mas"}, "# camera\n", "# camera\n    bias: {sigma: 1 mas}\n"),
        (("telescopes", 0, "name"), None, "- name: A\n    noise", "- noise"),
        (("telescopes", 0), None, "  - name: A\n    noise: {sigma: 0.1 arcsec}   # camera\n", ""),
        (("telescopes", 2), {"name": "C"}, "0.2 arcsec}}\n", "0.2 arcsec}}\n  - {name: C}\n"),
        (("telescopes", 1, "noise", "sigma"), None, "noise: {sigma: 0.2 arcsec}", "noise: {}"),
        (("title",), "T", "title:\n", "title: T\n"),
        (("note",), "one", "note: |\n  two\n  lines\n", "note: one\n"),
        (("note",), None, "note: |\n  two\n  lines\n", ""),
        (("last", 2), "3 km", "2 km]", "2 km, 3 km]"),
        (("new", "deep"), True, "2 km]\n", "2 km]\nnew: {deep: true}\n"),
    ],
)
def test_the_letters_of_one_place_change_and_no_others(path: Any, value: Any, old: str, new: str) -> None:
    assert TEXT.count(old) == 1
    assert rewritten(TEXT, path, value) == TEXT.replace(old, new)


def test_line_breaks_of_others_and_a_last_line_without_one_are_kept() -> None:
    assert rewritten("a: 1\r\nb: 2  # c\r\n", ("a",), 3) == "a: 3\r\nb: 2  # c\r\n"
    assert rewritten("a: 1", ("b",), 2) == "a: 1\nb: 2\n"
    assert rewritten("# ä\u2028# b\na: {é: ü}", ("a", "é"), "ö") == "# ä\u2028# b\na: {é: ö}"


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("a: [", ("a",), 1),
        ("a: 1\na: 2\n", ("a",), 3),
        ("a: 1\n", ("b",), None),
        ("a: [1]\n", ("a", 3), 1),
        ("a: 1\n", ("a",), Written("}")),
        ("a: 1\n", ("a",), float("nan")),
    ],
)
def test_what_cannot_be_done_is_refused(text: str, path: Any, value: Any) -> None:
    with pytest.raises(InputError):
        rewritten(text, path, value)


def places(node: Any, path: tuple[Any, ...] = ()) -> Any:
    """Every place of a tree."""
    pairs = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, one in pairs:
        yield (*path, key)
        yield from places(one, (*path, key))


VALUES: tuple[Any, ...] = (
    None, 2.5, True, "", "# x", "12:30", Written("1e-9"), ["1 km", {"x": 1}],
    {"kind": "x", "b": ["1 km"], "c": {"d": 1}},
    {"long" * 8: "word " * 12, "more": {"x": "y " * 40, "z": [1, {"q": "w " * 50}]}},
)  # fmt: skip
EVERYTHING = Path(__file__).parents[1] / "everything"


@pytest.mark.parametrize(
    "file", [*map(builtin_path, builtin_names()), *EVERYTHING.glob("*.yaml")], ids=lambda f: f.stem
)
def test_any_value_at_any_place_of_any_mission_reads_as_meant_and_keeps_comments(file: Path) -> None:
    """`rewritten` reads what it made: it would refuse. Comments outside the place are counted here."""
    text, draw = file.read_text("utf-8"), random.Random(file.stem)
    every = list(places(parse_yaml(text, "x").tree))
    lines = [line.partition("#")[2] for line in text.split("\n")]
    for path in draw.sample(every, min(len(every), 10)):
        for value in draw.sample(VALUES, 2):
            made = rewritten(text, path, value)
            kept = [line.partition("#")[2] for line in made.split("\n")]
            lost = sum(1 for line in lines if line and line not in kept)
            assert lost <= 1 + 8 * isinstance(parse_tree(text, path), dict | list), (path, value)


def parse_tree(text: str, path: tuple[Any, ...]) -> Any:
    node: Any = parse_yaml(text, "x").tree
    for step in path:
        node = node[step]
    return node
