"""The short answer on a terminal, of runs that the pages of the documentation do not show."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from nebosvod import load_mission, run
from nebosvod.commands.run_answer import print_answer

MINIMAL = Path(__file__).parents[3] / "scenarios" / "minimal.yaml"
PRIOR = "prior: {sigma: {position: 1000 km, velocity: 1 m/s}}\n"


@pytest.mark.parametrize(
    ("prior", "said"), [("", "62 measurements, no earlier orbit used;"), (PRIOR, "62 measurements and a prior orbit;")]
)
def test_the_first_line_says_whether_an_earlier_orbit_was_used(tmp_path: Path, prior: str, said: str) -> None:
    mission = tmp_path / "small.yaml"
    mission.write_text(MINIMAL.read_text("utf-8") + prior, "utf-8")
    out = io.StringIO()
    print_answer(run(load_mission(str(mission))).summary, tmp_path, Console(file=out, width=120))
    assert said in out.getvalue()
