"""Fits of orbits inside bodies, round the Sun thousands of times, or asked about centuries ahead."""

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris, impact
from nebosvod.dynamics.impact import MOST_STEPS
from nebosvod.timescale import Epoch

AU_KM, GM = 149597870.7, 1.32712440041e11
MADE = Path(__file__).parents[1] / "everything" / "made.obs80"
HEADER = "permID|mode|stn|obsTime|ra|dec|astCat|rmsRA|rmsDec"


def records(path: Path, years: tuple[int, ...]) -> None:
    """A few records of nowhere, three nights of each year."""
    rows = [f"3666|CCD|G96|{year}-03-{day:02}T06:00:00Z|19.0|5.0|Gaia2|0.1|0.1" for year in years for day in (1, 8, 15)]
    path.write_text("\n".join(["# version=2022", HEADER, *rows, ""]), "utf-8")


def orbit(a_au: float, epoch: str = "2023-03-01 TDB") -> dict[str, Any]:
    """A circle about the Sun."""
    angles = {"i": "8 deg", "node": "0 deg", "peri": "0 deg", "M": "0 deg"}
    return {"kind": "keplerian", "frame": "ecliptic_j2000", "epoch": epoch, "a": f"{a_au} au", "e": 0, **angles}


def inside(body: str) -> dict[str, Any]:
    """A state 1000 km from the centre of a body."""
    ephemeris, epoch = Ephemeris.load(), Epoch.parse("2023-03-01T00:00:00 TDB")
    state = np.subtract(*(ephemeris.state_km_km_s(name, epoch, np.zeros(1))[0] for name in (body, "sun")))
    state[0] += 1000.0
    return {
        "kind": "state", "frame": "icrf", "epoch": "2023-03-01 TDB", "position": [f"{x:.9f} km" for x in state[:3]],
        "velocity": [f"{x:.9f} km/s" for x in state[3:]],
    }  # fmt: skip


def settings(path: Path, text: dict[str, Any]) -> str:
    """Write a settings file about f.psv beside it."""
    fit = {"observations": ["f.psv"], **text.pop("fit", {})}
    path.write_text(yaml.safe_dump({"schema_version": 1, "name": "f", **text, "fit": fit}, sort_keys=False), "utf-8")
    return str(path)


@pytest.mark.parametrize("command", ["check", "fit"])
@pytest.mark.parametrize("place", ["object.orbit", "fit.reference.orbit"])
def test_an_orbit_given_to_a_fit_that_starts_inside_a_planet_is_refused_at_its_place(
    place: str, command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    records(tmp_path / "f.psv", (2023,))
    said = {"object": {"orbit": inside("venus")}} if place == "object.orbit" else {}
    said |= {} if said else {"fit": {"reference": {"orbit": inside("venus")}}}
    path = settings(tmp_path / "f.yaml", said)
    assert main([command, path]) == 2
    assert (
        f"{place}: starts inside Venus (got 1000 km from its centre; allowed from 6052 km)" in capsys.readouterr().err
    )


def test_an_orbit_given_outside_the_ephemeris_is_refused_at_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    records(tmp_path / "f.psv", (2023,))
    path = settings(tmp_path / "f.yaml", {"fit": {"reference": {"orbit": orbit(1.0, "1400-01-01 TDB")}}})
    for command in ("check", "fit"):
        assert main([command, path]) == 2
        assert "fit.reference.orbit.epoch: epoch is outside the ephemeris" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("years", "epoch", "between", "flown_y"),
    [
        ((2023,), "1995-01-01 TDB", "its epoch and the observations", 28.18),
        ((1995, 2023), "2009-03-01 TDB", "the first and the last observation", 28.04),
    ],
)
def test_a_fit_of_an_orbit_that_goes_round_the_sun_too_often_is_refused_at_once(
    years: tuple[int, ...], epoch: str, between: str, flown_y: float, tmp_path: Path
) -> None:
    """0.006 au: 4.07 h a revolution by Kepler's third law. It was flown, for a minute and gigabytes."""
    records(tmp_path / "f.psv", years)
    settings(tmp_path / "f.yaml", {"object": {"orbit": orbit(0.006, epoch)}})
    period_y = 2.0 * math.pi * math.sqrt((0.006 * AU_KM) ** 3 / GM) / (365.25 * 86400.0)
    environment = {"OPENBLAS_NUM_THREADS": "1", "PATH": "/usr/bin:/bin"}
    for command in ("check", "fit"):
        call = [sys.executable, "-m", "nebosvod", command, "f.yaml"]
        done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, timeout=60, env=environment)
        assert done.returncode == 2
        assert "f.yaml:4:3: object.orbit: goes round the Sun " in done.stderr
        assert f" between {between}, some " in done.stderr
        assert f"(allowed {MOST_STEPS:,})" in done.stderr
        times = float(done.stderr.split("goes round the Sun ")[1].split(" times")[0].replace(",", ""))
        assert times == pytest.approx(flown_y / period_y, rel=2e-3)


def test_an_orbit_found_on_the_way_never_takes_more_than_those_steps(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An eccentric orbit takes several times the steps of a circle: what the count lets pass, the integration ends."""
    records(tmp_path / "f.psv", (2015, 2023))
    eccentric = orbit(0.05) | {"e": 0.9}
    path = settings(tmp_path / "f.yaml", {"object": {"orbit": eccentric}})
    assert main(["fit", path, "-o", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().err
    assert "f.yaml:4:3: object.orbit: the integration gives up at " in said
    assert f"after the {MOST_STEPS} steps it may take" in said


@pytest.fixture
def asked(tmp_path: Path) -> Path:
    """Settings about records made in 2028, for the dates of a test."""
    path = tmp_path / "f.yaml"
    (tmp_path / "made.obs80").write_bytes(MADE.read_bytes())
    return path


def fitted(path: Path, predictions: dict[str, str], epochs: tuple[str, ...] = ()) -> dict[str, Any]:
    """The summary of a fit that is asked for positions at dates, and for states at epochs."""
    rows = [{"name": name, "plane": "position", "at": at} for name, at in predictions.items()]
    text = {"schema_version": 1, "name": "f", "fit": {"observations": ["made.obs80"], "epochs": list(epochs)}}
    path.write_text(yaml.safe_dump(text | {"predictions": rows}), "utf-8")
    assert main(["fit", str(path), "-o", str(path.parent / "out")]) == 1
    summary: dict[str, Any] = json.loads((path.parent / "out" / "summary.json").read_text("utf-8"))
    return summary


def test_nothing_is_flown_to_what_is_asked_outside_the_ephemeris(asked: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has no answer however far one flies; the others do, with no more steps than they need."""
    monkeypatch.setattr(impact, "MOST_STEPS", 400)
    summary = fitted(asked, {"x": "2028-06-01 TDB", "out": "9999-03-01 TDB", "far": "5000000 JD TDB"})
    said = {row["name"]: row["status"] for row in summary["predictions"]}
    assert said == {"x": "answered", "out": "not_covered", "far": "not_covered"}


def test_what_is_asked_beyond_the_steps_of_a_flight_costs_its_own_row_and_not_the_fit(
    asked: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(impact, "MOST_STEPS", 400)
    summary = fitted(asked, {"x": "2028-06-01 TDB", "late": "2055-03-01 TDB"}, ("2029-01-01 TDB", "2055-01-01 TDB"))
    assert [row["status"] for row in summary["predictions"]] == ["answered", "not_reached"]
    assert "steps of a flight end; ask for an earlier time" in summary["predictions"][1]["reason"]
    near, late = summary["further"]
    assert near["epoch_tdb"].startswith("2029-01-01")
    assert late["status"] == "not_reached"
    assert summary["orbit"] is not None
