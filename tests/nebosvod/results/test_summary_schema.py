"""summary.json of real runs of different kinds obeys its published schema."""

import json
from pathlib import Path

import jsonschema
import pytest

from nebosvod.mission import load_mission
from nebosvod.pipeline import run

SCHEMA = Path(__file__).resolve().parents[3] / "nebosvod" / "results" / "summary.schema.json"


@pytest.mark.parametrize("mission", ["apophis-2029", "soda-like"])
def test_summaries_of_built_in_missions_obey_the_schema(mission: str) -> None:
    summary = json.loads(run(load_mission(mission)).summary_text())
    jsonschema.validate(summary, json.loads(SCHEMA.read_text("utf-8")))
