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
    summary = run(load_mission(str(mission))).summary
    print_answer(summary, tmp_path, Console(file=out, width=120))
    assert said in out.getvalue()
    first = summary["predictions"][0]
    total = sum(sigma**2 for sigma in first["sigma_km"]) ** 0.5
    title = f"What is to blame for ten days later (position) by batch: total sigma {total:.3g} km"
    assert title in " ".join(out.getvalue().split())
    leading = max(first["budget"], key=lambda row: float(row["share_total"]))
    line = next(line for line in out.getvalue().splitlines() if line.strip().startswith(leading["source"]))
    left = leading["if_vanished"]["sigma_total_km_new_gain"]
    assert line.split()[-3:] == ["%", f"{leading['sigma_total_km']:#.3g}".rstrip("."), f"{left:#.3g}".rstrip(".")]
    alone = io.StringIO()
    print_answer({**summary, "predictions": []}, tmp_path, Console(file=alone, width=120))
    title = "What is to blame for the position sigma of batch at the reference epoch"
    assert title in " ".join(alone.getvalue().split())
