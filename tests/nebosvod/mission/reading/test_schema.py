"""The JSON Schema that editors use: current, valid, and in agreement with the reader."""

import json
from pathlib import Path
from typing import Any

import jsonschema  # type: ignore[import-untyped]
import pytest

from nebosvod.errors import InputError
from nebosvod.mission import load_mission_text, mission_schema
from nebosvod.mission.yaml.yamlfile import parse_yaml

SCENARIOS = Path(__file__).resolve().parents[4] / "scenarios"
FILES = sorted(SCENARIOS.glob("*.yaml"))
BASE = (SCENARIOS / "apophis-2029.yaml").read_text("utf-8")


@pytest.fixture(scope="module")
def validator() -> Any:
    """A validator of the schema as exported."""
    schema = mission_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_the_committed_schema_is_current() -> None:
    committed = json.loads((SCENARIOS / "nebosvod.schema.json").read_text("utf-8"))
    assert committed == mission_schema(), "run `make schema`"


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_built_in_missions_satisfy_the_schema(path: Path, validator: Any) -> None:
    validator.validate(parse_yaml(path.read_text("utf-8"), path.name).tree)


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_built_in_missions_tell_the_editor_their_schema(path: Path) -> None:
    assert "# yaml-language-server: $schema=nebosvod.schema.json\n" in path.read_text("utf-8")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("cadence: 12 h", "cadance: 12 h"),
        ("sigma: 0.1 arcsec", "sigma: 0.1"),
        ("sigma: 0.1 arcsec", "sigma: 0.1 km"),
        ("value: 0.159", "value: 1.159"),
        ("e: 0.19", "e: -0.19"),
        ("method: recursive", "method: recursiv"),
        ("    e: 0.1915216893501022\n", ""),
        ("like: NEB-1", "exclusion: {}"),
        ("prior: none", "prior: nine"),
        ("kind: cometary", "kind: comet"),
        ("radius: {value: 170 m, sigma: 20 m, treatment: estimated}", "radius: {value: 170 m, sigma: 20 m}"),
        ("end: 2029-04-08T00:00:00 TDB", "end: 2029-04-08"),
    ],
)
def test_what_the_reader_refuses_the_editor_marks_too(old: str, new: str, validator: Any) -> None:
    assert old in BASE
    text = BASE.replace(old, new, 1)
    with pytest.raises(InputError):
        load_mission_text(text)
    assert not validator.is_valid(parse_yaml(text, "m").tree)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("orbit: {longitude: 180 deg}", "orbit: {kind: heliocentric, lead: 5 deg}"),
        ("orbit: {longitude: 180 deg}", "exclusion: {sun: null}\n    bias:\n    noise: {timing: 3 ms}"),
        ("radius: {value: 170 m, sigma: 20 m, treatment: estimated}", "diameter: 340 m"),
        ("prior: none", "prior: {sigma: {position: 1000 km, velocity: 1 m/s}}"),
        ("telescopes: all, start", "telescopes: [NEB-1, NEB-2], start"),
        ("end: 2029-04-08T00:00:00 TDB", "end: 2462234.5 JD TT"),
    ],
)
def test_what_the_reader_accepts_the_editor_accepts_too(old: str, new: str, validator: Any) -> None:
    assert old in BASE
    text = BASE.replace(old, new, 1)
    load_mission_text(text)
    validator.validate(parse_yaml(text, "m").tree)
