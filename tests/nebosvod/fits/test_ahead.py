"""What a fit says of the days after its last observation: passages, impacts in reach, H, period, MOID."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris, ForceModel, propagate
from nebosvod.fits.photometry import TO_V
from nebosvod.results.ahead_words import ahead_sentences
from nebosvod.timescale import Epoch
from nebosvod.units import AU_KM, DAY_S

SHARED = Path(__file__).resolve().parents[3].parent / "shared"
pytestmark = pytest.mark.skipif(not SHARED.is_dir(), reason="the folder of reference observations is not here")


def jpl_approach() -> tuple[float, float]:
    """Time (s after 2024-06-29 TDB) and distance (km) of 2024 MK's approach, from JPL's state of that day."""
    with (SHARED / "data" / "orbits" / "jpl_truth_states.csv").open() as file:
        rows = [r for r in csv.DictReader(file) if r["object"] == "2024 MK" and r["epoch_tdb"] == "2024-06-29T00:00"]
    (row,) = (r for r in rows if r["center"] == "SUN")
    keys = ("x_au", "y_au", "z_au", "vx_aud", "vy_aud", "vz_aud")
    state = np.array([float(row[key]) for key in keys]) * np.repeat([AU_KM, AU_KM / DAY_S], 3)
    bodies, epoch = Ephemeris.load(), Epoch.parse("2024-06-29 TDB")
    forces = ForceModel(ephemeris=bodies, relativity="eih")
    trajectory = propagate(state, epoch, [DAY_S], forces, sensitivities=False)

    def distance(t: float) -> float:
        now = np.array([t])
        earth = bodies.position_km("earth", epoch, now) - bodies.position_km("sun", epoch, now)
        return float(np.linalg.norm(trajectory.state_at(now)[:, :3] - earth))

    best = minimize_scalar(distance, bounds=(0.0, DAY_S), method="bounded", options={"xatol": 1e-3})
    return float(best.x), float(best.fun)


def test_a_week_before_it_2024_mk_is_said_to_pass_where_jpl_has_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = SHARED / "data" / "observations" / "2024MK.obs80"
    assert main(["fit", str(data), "--to", "2024-06-22", "-o", str(tmp_path / "mk")]) in (0, 1)
    text = capsys.readouterr().out
    ahead = json.loads((tmp_path / "mk" / "summary.json").read_text())["ahead"]
    row = next(row for row in ahead["approaches"] if row["body"] == "earth")
    t, distance = jpl_approach()
    assert row["distance_km"] == pytest.approx(distance, abs=5.0 * row["sigma_distance_km"])
    at = Epoch.parse(row["epoch_tdb"]) - Epoch.parse("2024-06-29 TDB")
    assert at == pytest.approx(t, abs=5.0 * row["sigma_time_s"] + 1.0)
    assert "passes the Earth on 2024-06-29 13:4" in text
    assert ahead["in_reach"] == []
    assert ahead["moid_earth_au"] < 0.002
    assert "What comes" in (tmp_path / "mk" / "report.html").read_text()


def test_an_hour_of_2024_bx1_tells_its_fall(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It fell at 2024-01-21 00:32:40 UTC; H of ESA's orbit is 32.68."""
    lines = (SHARED / "data" / "observations" / "2024BX1.obs80").read_text("ascii").splitlines(keepends=True)
    (tmp_path / "bx.obs80").write_text("".join(lines[:12]))
    main(["fit", str(tmp_path / "bx.obs80"), "-o", str(tmp_path / "bx")])
    assert "the orbit hits the Earth on 2024-01-21 00:32 UTC" in capsys.readouterr().out
    ahead = json.loads((tmp_path / "bx" / "summary.json").read_text())["ahead"]
    assert [(row["body"], row["sigmas"]) for row in ahead["in_reach"]] == [("earth", 0.0)]
    assert ahead["magnitude"]["H"] == pytest.approx(32.68, abs=0.4)


def test_an_orbit_nobody_knows_promises_nothing(tmp_path: Path) -> None:
    data = SHARED / "data" / "observations" / "2008EK68.obs80"
    assert main(["fit", str(data), "-o", str(tmp_path / "ek")]) == 0  # a probability is an answer
    ahead = json.loads((tmp_path / "ek" / "summary.json").read_text())["ahead"]
    assert ahead["approaches"] == []
    assert "not known well enough" in ahead["reason"]
    assert not any("no approach" in text for text in ahead_sentences(ahead))


def test_bands_of_the_minor_planet_center() -> None:
    assert (TO_V["V"], TO_V["R"], TO_V["B"], TO_V["o"]) == (0.0, 0.4, -0.8, 0.33)
