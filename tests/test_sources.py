"""docs/sources.md says which equation is where: every name on it exists."""

import ast
import importlib
import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from nebosvod.cli import VERBS
from nebosvod.mission import list_missions, mission_schema
from nebosvod.mission.reading.schema import fit_schema

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "sources.md"
TICKED = re.compile(r"`([^`]+)`")
MISSION, FIT = mission_schema(), fit_schema()
SCHEMA = {**MISSION, "$defs": {**FIT["$defs"], **MISSION["$defs"]}}
SUMMARY = json.loads((ROOT / "nebosvod" / "results" / "summary.schema.json").read_text())
Row = dict[str, str]


def rows() -> Iterator[Row]:
    """Every row of every table by the headings of its columns, and the section it stands in."""
    heading, section = [""], ""
    for line in PAGE.read_text("utf-8").splitlines():
        if line.startswith("## "):
            section = line.removeprefix("## ")
        if not line.startswith("|"):
            heading = [""]
            continue
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if heading == [""]:
            heading = cells
        elif not set(line) <= set("|-"):
            assert len(cells) == len(heading), line
            yield {"section": section, **dict(zip(heading, cells))}


ROWS = list(rows())


def ticked(column: str) -> list[str]:
    return sorted({name for row in ROWS if column in row for name in TICKED.findall(row[column])})


@cache
def functions_of(file: str) -> frozenset[str]:
    """Names of the functions of a file of tests."""
    tree = ast.parse((ROOT / file).read_text("utf-8"))
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def nodes(schema: Any) -> Iterator[dict[str, Any]]:
    """Every mapping inside a schema."""
    if isinstance(schema, dict):
        yield schema
        for part in schema.values():
            yield from nodes(part)
    elif isinstance(schema, list):
        for part in schema:
            yield from nodes(part)


def properties(key: str) -> list[dict[str, Any]]:
    """Schemas of the properties of a name, wherever they stand."""
    return [node["properties"][key] for node in nodes(SCHEMA) if key in (node.get("properties") or {})]


def resolved(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """A schema with all that it refers to."""
    for node in nodes(schema):
        yield node
        if "$ref" in node:
            yield from resolved(SCHEMA["$defs"][node["$ref"].rpartition("/")[2]])


def test_all_four_documents_have_a_table_and_stand_in_the_method() -> None:
    sections = {row["section"].partition(" ")[0] for row in ROWS}
    assert {"[G]", "[V]", "[P]", "[S]", "Errata"} <= sections
    method = (ROOT / "docs" / "method.md").read_text("utf-8")
    references = method[method.index("## References") :]
    for letter in "GVPS":
        assert f"- [{letter}] " in references, letter


def test_every_row_says_where_it_is_in_python_and_in_a_test() -> None:
    for row in ROWS:
        assert TICKED.search(row["test"]), row
        if row["section"] != "Errata":
            assert TICKED.search(row["Python"]), row
            for column in ("mission", "shown"):
                assert TICKED.search(row[column]) or row[column] == "-", row


@pytest.mark.parametrize("name", ticked("Python"))
def test_a_name_of_python_is_there(name: str) -> None:
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: Any = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            found = getattr(found, part)
        return
    pytest.fail(f"no module of {name}")


@pytest.mark.parametrize("name", ticked("test"))
def test_a_test_is_there(name: str) -> None:
    file, _, function = name.partition("::")
    assert function in functions_of(file)


@pytest.mark.parametrize("said", ticked("mission"))
def test_a_key_of_a_mission_is_in_its_schema(said: str) -> None:
    """Or a built-in mission, or a command."""
    if said in dict(list_missions()):
        return
    if said.startswith("nebosvod "):
        assert said.split()[1] in VERBS
        return
    path, _, value = said.partition(": ")
    parents: list[dict[str, Any]] | None = None
    for key in path.split("."):
        if parents is None:
            parents = properties(key)
        else:
            inside = [node for parent in parents for node in resolved(parent)]
            parents = [node["properties"][key] for node in inside if key in (node.get("properties") or {})]
        assert parents, key
    if value and path == "treatment":  # of an estimator: by group
        parents = properties("treatment")
    if value:
        inside = [node for parent in parents or [] for node in resolved(parent)]
        assert any(value == node.get("const") or value in node.get("enum", ()) for node in inside), value


@pytest.mark.parametrize("row", [row for row in ROWS if row.get("shown", "-") != "-"], ids=lambda row: row["shown"])
def test_a_place_of_a_report_is_there(row: Row) -> None:
    shown = TICKED.findall(row["shown"])[0]
    if shown.startswith("examples/"):
        assert (ROOT / shown).is_file()
        return
    kind, _, rest = row["shown"].partition(" ")
    commands = [name.split()[1] for name in TICKED.findall(row["shown"]) if name.startswith("nebosvod ")]
    if commands:  # in what a command prints or writes
        assert set(commands) <= set(VERBS)
        return
    (name,) = TICKED.findall(rest)
    if kind == "summary":
        assert name in SUMMARY["properties"]
    elif kind == "page":
        assert f'"{name}"' in (ROOT / "nebosvod" / "report" / "report.html").read_text("utf-8")
    else:
        assert kind == "array"
        code = "".join(path.read_text("utf-8") for path in (ROOT / "nebosvod" / "findings").glob("*.py"))
        assert f'"{name.removesuffix("NAME")}' in code
