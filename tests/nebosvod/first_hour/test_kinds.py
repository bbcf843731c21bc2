"""What `alert` says of what cannot hit: no false alarm, no place where it would fall, a range told both ways."""

import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris, ForceModel
from nebosvod.dynamics.each import fates_of_each
from nebosvod.first_hour.circling import lowest_perigee
from nebosvod.first_hour.region import Region
from nebosvod.first_hour.tracklet import Columns, Tracklet
from nebosvod.observation import Telescope
from nebosvod.observation.measurement.exposures import Exposures

sys.path.insert(0, str(Path(__file__).resolve().parent))
from kinds import EPOCH, HIGH, KINDS, SITE, made  # type: ignore[import-not-found]


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("comet, e = 1", 0.005),
        ("main belt", 0.005),
        ("flyby at 1 LD, 24 h before", 0.005),
        ("flyby at 1 LD, 5 d before", 0.01),
    ],
)
def test_what_cannot_hit_is_below_a_bound_and_falls_nowhere(
    name: str, most: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of few drawn orbits that hit and weigh 1e-6, a date and a place were told; the bound was that of all draws.

    Three of the effective draws of what comes near the Earth, times its share of the weight, bound the far ones; that
    was 0.02 by 150 draws of which all came near.
    """
    truth = made(KINDS[name], Ephemeris.load())
    (tmp_path / "kind.psv").write_text(truth.text, "utf-8")
    assert main(["alert", str(tmp_path / "kind.psv"), "--json", "--hours", "1"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert found["bound"]
    assert found["probability"] is None
    assert 1e-6 <= found["high"] < most
    assert found["impact"] is None
    region = found["regions"]["95"]
    assert region["range_au"][0] < truth.range_au < region["range_au"][1]
    assert region["rate_km_s"][0] < truth.rate_km_s < region["rate_km_s"][1]
    told = re.search(r"within a factor of ([\d.]+)", found["message"])
    assert told is not None
    ends = found["quantities"]["range_au"]
    factor = float(told[1]) * 1.06  # two digits
    assert ends["median"] / factor < ends["q16"]
    assert ends["q84"] < ends["median"] * factor


def test_what_circles_low_is_not_flown_a_hundred_times_round_the_earth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A thousand orbits like a geostationary one took four seconds, and left 0.009 open."""
    truth = made(KINDS["satellite, 42,164 km"], Ephemeris.load())
    (tmp_path / "kind.psv").write_text(truth.text, "utf-8")
    assert main(["alert", str(tmp_path / "kind.psv"), "--json", "--hours", "1"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert found["bound"]
    assert found["high"] < 1e-5
    assert found["draws"]["flown"] == 0
    assert found["scores"]["earth_satellite"] == pytest.approx(1.0)


def test_what_is_seen_beside_the_sun_may_be_near() -> None:
    """H, G makes a metre at 178 deg of phase fainter by 46 mag: everything nearer than the Sun had to be a planet."""
    ephemeris = Ephemeris.load()
    site = Telescope(name="C51", spacecraft=HIGH, sigma_rad=1e-6)
    exposures = Exposures.of(EPOCH, [(site, np.array([0.0, 60.0]))], ephemeris)
    line = (exposures.sun - exposures.observer)[0, :3]
    for away in (0.04, 0.3):  # rad from the Sun
        psi = np.array([np.arctan2(line[1], line[0]) + away, np.arctan2(line[2], np.hypot(line[0], line[1]))])
        tracklet = Tracklet.of(
            "made up", exposures, np.tile(psi, (2, 1)), ForceModel(ephemeris=ephemeris), Columns.none(2), 20.0
        )
        assert Region().ranges(tracklet)[0] < np.log(1e-3)


def test_the_least_perigee_of_what_circles_is_just_below_that_of_flown_orbits() -> None:
    """A hundred days with every force, from the ground to half way to the Moon; some are brought down by it.

    A bound without a flight kept those that dive from 90,000 km to 1000 km above the ground among what may fall, and
    each of them took ten milliseconds to say that it does not.
    """
    ephemeris, rng, n = Ephemeris.load(), np.random.default_rng(3), 90
    forces = ForceModel(ephemeris=ephemeris)
    site = Telescope(name="F51", spacecraft=SITE, sigma_rad=1e-6)
    exposures = Exposures.of(EPOCH, [(site, np.array([0.0, 60.0]))], ephemeris)
    tracklet = Tracklet.of("made up", exposures, np.zeros((2, 2)), forces, Columns.none(2), None)
    gm, now = ephemeris.gm_km3_s2["earth"], np.zeros(1)
    perigee, highest, axes = rng.uniform(6600.0, 2e4, n), rng.uniform(2e4, 2.1e5, n), rng.standard_normal((n, 2, 3))
    apogee = np.maximum(perigee, highest)
    x = axes[:, 0] / np.linalg.norm(axes[:, 0], axis=1)[:, None]
    y = np.cross(np.cross(x, axes[:, 1]), x)
    y = y / np.linalg.norm(y, axis=1)[:, None]
    slow = np.sqrt(2.0 * gm / (apogee + perigee) * perigee / apogee)[:, None]
    earth, sun = (ephemeris.state_km_km_s(body, tracklet.epoch, now)[0] for body in ("earth", "sun"))
    states = np.hstack([apogee[:, None] * x, slow * y]) + earth - sun
    least = lowest_perigee(tracklet, states, 100.0)
    stays = np.isfinite(least)
    fates = fates_of_each(states, tracklet.epoch, 100.0 * 86400.0, forces, "earth", 1e9, 1e-8)
    assert fates.impact.sum() > 1
    assert not (fates.impact & stays).any()
    assert np.all(fates.distance_km[stays] > least[stays])
    known = apogee < 1.2e5
    assert stays[known & ~fates.impact].mean() > 0.9
    assert np.median((fates.distance_km - least)[stays & known]) < 800.0


def test_no_orbit_of_an_answer_about_bound_ones_is_unbound(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At 40 au noise of the motion alone unbinds half of the orbits drawn about bound ones: a was -4 au."""
    truth = made(KINDS["opposition, 40 au"], Ephemeris.load())
    (tmp_path / "kind.psv").write_text(truth.text, "utf-8")
    assert main(["alert", str(tmp_path / "kind.psv"), "--json", "--hours", "1"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert found["bound_to_the_sun"]
    assert found["scores"]["hyperbolic"] == 0.0
    assert all(found["quantities"]["a_au"][name] > 0.0 for name in ("q025", "q16", "median", "q84", "q975"))
    assert found["quantities"]["e"]["q975"] < 1.0
    assert found["regions"]["95"]["range_au"][0] < truth.range_au < found["regions"]["95"]["range_au"][1]
