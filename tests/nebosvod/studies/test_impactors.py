"""Impactors and their companions: laws of what is drawn, against closed forms and scipy."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp

from nebosvod.dynamics import Ephemeris
from nebosvod.errors import InputError
from nebosvod.studies.catalogue import read_catalogue
from nebosvod.studies.impactors import (
    Draw,
    DrawnObjects,
    capture_radius_km,
    encounter_probability,
    hyperbola_state,
)
from nebosvod.studies.near_earth import orbits_of, published_orbits
from nebosvod.studies.reading import load_study_text
from nebosvod.studies.study import evaluate_row
from nebosvod.timescale import Epoch

GM = 398600.4415
NEOS = """\
full_name,epoch,e,a,i,om,w,ma
one,2461850.5,0.4,1.6,6,0,180,0
two,2461850.5,0.25,1.1,12,40,180,100
three,2461850.5,0.55,2.1,4,10,175,2
never,2461850.5,0.1,2.5,4,10,175,2
"""
WATCH = """\
schema_version: 1
name: watch
reference_epoch: 2030-04-01T00:00:00 TDB
object:
  name: nominal
  orbit: {kind: impact, at: 2030-05-01T00:00:00 TDB, longitude: 0 deg, latitude: 0 deg, elevation: 45 deg,
    azimuth: 90 deg, speed: 20 km/s}
  magnitude: {H: 24, G: 0.15}
telescopes:
  - name: L1
    orbit: {kind: libration, point: L1}
    noise: {sigma: 0.5 arcsec}
    exclusion: {sun: 30 deg}
    limiting_magnitude: 25
  - {name: geo, like: L1, orbit: {kind: geostationary, longitude: 0 deg}}
schedule:
  - {start: 2030-04-01T00:00:00 TDB, end: 2030-04-30T00:00:00 TDB, cadence: 12 h}
predictions:
  - {name: plane, plane: b_plane, body: earth, near: 2030-05-01T00:00:00 TDB}
"""
STUDY = """\
schema_version: 1
study: warned
mission: watch.yaml
objects: {impactors: {orbits: neos.csv, n: 3, misses: 2, start: 2030-01-01T00:00:00 TDB, span: 5 yr, smallest: 100 m}}
answer:
  - {name: warning, of: warning_time_d}
  - {name: chance, of: predictions.plane.impact_probability_linear}
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("impactors")
    (folder / "neos.csv").write_text(NEOS, "utf-8")
    (folder / "watch.yaml").write_text(WATCH, "utf-8")
    return folder


def drawn(place: Path, impacts: int, misses: int, seed: int = 1) -> list[dict[str, Any]]:
    asked = Draw(
        impacts=impacts, misses=misses, within_km=1e5, start=Epoch.parse("2030-01-01T00:00:00 TDB"), days=1826.25,
        smallest_m=20.0, largest_m=300.0, seed=seed,
    )  # fmt: skip
    return list(DrawnObjects(orbits_of(read_catalogue(place / "neos.csv")), asked, Ephemeris.load()))


def test_probabilities_are_those_of_kesslers_spatial_density() -> None:
    """Kessler 1981, Icarus 48, 39, eq. 17: density at 1 au in the ecliptic, times speed, times the focused disc."""
    a, e, i = np.array([1.6, 1.1, 2.1, 2.5]), np.array([0.4, 0.25, 0.55, 0.1]), np.radians([6.0, 12.0, 4.0, 4.0])
    chance, U = encounter_probability(a, e, i)
    q, Q = a * (1 - e), a * (1 + e)
    assert chance[3] == 0.0
    a, e, i, q, Q = (one[:3] for one in (a, e, i, q, Q))
    speed = np.sqrt(3.0 - 1.0 / a - 2.0 * np.sqrt(a * (1.0 - e**2)) * np.cos(i))  # Opik's U
    assert np.linalg.norm(U, axis=1)[:3] == pytest.approx(speed, rel=1e-12)
    density = 1.0 / (2.0 * np.pi**3 * a * np.sin(i) * np.sqrt((1.0 - q) * (Q - 1.0)))
    disc = np.pi * (capture_radius_km(speed * 29.784691831) / 149597870.7) ** 2
    assert chance[:3] == pytest.approx(density * disc * 2.0 * np.pi * speed, rel=1e-9)


@pytest.mark.parametrize("b", [2000.0, 9000.0, 60000.0])
def test_a_hyperbola_comes_from_where_it_was_said_to(b: float) -> None:
    """Two bodies integrated back to 50 million km by scipy: velocity and offset of the asymptote."""
    far, offset = np.array([3.0, -8.0, 5.0]), np.cross([3.0, -8.0, 5.0], [0.3, 0.2, 0.9])
    offset *= b / np.linalg.norm(offset)
    r, v = hyperbola_state(far, offset, GM, 6478.0 if b < 1e4 else None)
    if b < 1e4:
        assert np.linalg.norm(r) == pytest.approx(6478.0, rel=1e-12)
        assert r @ v < 0.0
    else:
        assert r @ v == pytest.approx(0.0, abs=1e-6)
    back = solve_ivp(
        lambda t, x: np.concatenate([x[3:], -GM * x[:3] / np.linalg.norm(x[:3]) ** 3]), (0.0, -5e6),
        np.concatenate([r, v]), method="DOP853", rtol=1e-12, atol=1e-9,
    ).y[:, -1]  # fmt: skip
    assert back[3:] == pytest.approx(far, abs=2e-3)
    moment = np.cross(back[:3], back[3:])
    assert moment == pytest.approx(np.cross(offset, far), rel=1e-6)


def test_elevations_sizes_and_offsets_follow_their_laws(place: Path) -> None:
    """P(elevation < e) = sin^2 e (Shoemaker 1962) but for the flattening; N(> D) goes with D^-2.7; times are even."""
    objects = drawn(place, 400, 0)
    elevation = np.array([float(one["orbit"]["elevation"].split()[0]) for one in objects])
    assert stats.kstest(np.sin(np.radians(elevation)) ** 2, "uniform").pvalue > 0.01
    diameter = 1.329e6 / np.sqrt(0.14) * 10.0 ** (-0.2 * np.array([one["magnitude"]["H"] for one in objects]))
    assert 19.9 < diameter.min() < diameter.max() < 300.5
    share = (diameter**-2.7 - 20.0**-2.7) / (300.0**-2.7 - 20.0**-2.7)
    assert stats.kstest(share, "uniform").pvalue > 0.01
    start = Epoch.parse("2030-01-01T00:00:00 TDB")
    days = np.array([(Epoch.parse(one["orbit"]["at"]) - start) / 86400.0 for one in objects])
    assert stats.kstest(days / 1826.25, "uniform").pvalue > 0.01
    speed = np.array([float(one["orbit"]["speed"].split()[0]) for one in objects])
    assert 11.2 < speed.min() < speed.max() < 40.0


def test_misses_pass_outside_and_inside_the_distance(place: Path) -> None:
    ephemeris = Ephemeris.load()
    for one in drawn(place, 0, 40):
        orbit, at = one["orbit"], np.zeros(1)
        epoch = Epoch.parse(orbit["epoch"])
        earth = ephemeris.state_km_km_s("earth", epoch, at)[0] - ephemeris.state_km_km_s("sun", epoch, at)[0]
        numbers = [float(text.split()[0]) for text in (*orbit["position"], *orbit["velocity"])]
        r, v = np.split(np.array(numbers) - earth, 2)
        assert 6478.0 < np.linalg.norm(r) < 100_000.1
        assert abs(r @ v) < 1e-5 * np.linalg.norm(r) * np.linalg.norm(v)


def test_published_orbits_come_down_as_fast_as_fireballs_do() -> None:
    """Brown et al. 2002, Nature 420, 294: bodies hit the Earth at 20.3 km/s on average; and as Opik's weights say."""
    a, e, i = published_orbits()
    assert ((a * (1.0 - e) < 1.3) & (a < 4.2) & (e < 1.0) & (i < np.pi)).all()
    chance, U = encounter_probability(a, e, i)
    entry = np.sqrt((np.linalg.norm(U, axis=1) * 29.784691831) ** 2 + 2.0 * GM / 6478.0)
    assert np.average(entry, weights=chance) == pytest.approx(20.3, abs=0.7)
    asked = Draw(
        impacts=400, misses=0, within_km=1e5, start=Epoch.parse("2030-01-01T00:00:00 TDB"), days=3652.5,
        smallest_m=20.0, largest_m=300.0, seed=1,
    )  # fmt: skip
    objects = DrawnObjects((a, e, i), asked, Ephemeris.load())
    speed = np.array([float(one["orbit"]["speed"].split()[0]) for one in objects])
    order = np.argsort(entry)
    share = np.interp(speed, entry[order], np.cumsum(chance[order]) / chance.sum())
    assert stats.kstest(share, "uniform").pvalue > 0.01  # rotation of the ground and eccentricity of the Earth move it
    day = np.array([one["drawn"].sun_angle_deg for one in objects]) < 90.0
    assert stats.binomtest(int(day.sum()), 400, 0.5).pvalue > 0.01  # Opik: in and out alike


def test_near_misses_stand_for_as_many_as_their_ring_is_larger_than_the_disc(place: Path) -> None:
    """Passes within r of the Earth: pi r^2 (1 + v_escape(r)^2 / v^2) (Opik 1951); so does the mean of the weights."""
    ephemeris, ratios, weights, halves = Ephemeris.load(), [], [], []
    for one in drawn(place, 0, 400):
        numbers = [float(text.split()[0]) for text in (*one["orbit"]["position"], *one["orbit"]["velocity"])]
        epoch, at = Epoch.parse(one["orbit"]["epoch"]), np.zeros(1)
        earth = ephemeris.state_km_km_s("earth", epoch, at)[0] - ephemeris.state_km_km_s("sun", epoch, at)[0]
        r, v = np.split(np.array(numbers) - earth, 2)
        far2 = v @ v - 2.0 * GM / np.linalg.norm(r)
        area = [radius**2 + 2.0 * GM * radius / far2 for radius in (6478.137, np.linalg.norm(r), 1e5)]
        assert one["drawn"].weight == pytest.approx(area[1] / area[0] * np.log(area[2] / area[0]), rel=1e-4)
        ratios.append(area[2] / area[0] - 1.0)
        weights.append(one["drawn"].weight)
        halves.append(one["drawn"].weight * (area[1] < 0.5 * (area[0] + area[2])))
    off = np.std(np.array(weights) - ratios) / np.sqrt(400)
    assert np.mean(weights) == pytest.approx(np.mean(ratios), abs=3.0 * off)
    assert np.mean(halves) == pytest.approx(0.5 * np.mean(ratios), abs=3.0 * np.std(halves) / np.sqrt(400))


def test_an_object_depends_on_the_seed_and_its_number_alone(place: Path) -> None:
    few, many, other = drawn(place, 3, 0), drawn(place, 7, 0), drawn(place, 3, 0, seed=2)
    assert many[:3] == few
    assert other != few


def test_impactors_are_found_to_hit_and_companions_to_miss(place: Path) -> None:
    """Flown back a month and observed: the mission's epochs move with each fall."""
    study = load_study_text(STUDY, path=place / "s.yaml")
    rows = [evaluate_row(study, number) for number in range(study.rows)]
    assert [status for status, _, _ in rows] == ["ok"] * 5, rows
    assert [round(found[1]) for _, _, found in rows] == [1, 1, 1, 0, 0]
    assert all(0.9 < found[0] < 30.5 for _, _, found in rows)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("neos.csv", "none.csv", r"objects\.impactors\.orbits: .*no such file"),
        ("n: 3", "n: 0", r"objects\.impactors\.n: is out of range"),
        ("smallest: 100 m", "smallest: 400 m", r"objects\.impactors\.largest: is not above smallest"),
        ("2030-01-01T00:00:00 TDB, span: 5 yr", "2690-01-01T00:00:00 TDB, span: 5 yr", r"objects"),
        ("objects: {impactors", "objects: {from: x.csv, impactors", r"needs from .*or impactors, one of them"),
    ],
)
def test_what_is_wrong_is_said_at_its_line(place: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        load_study_text(STUDY.replace(old, new), path=place / "s.yaml")


def test_a_catalogue_without_orbits_that_cross_is_said(place: Path) -> None:
    lines = NEOS.splitlines()
    (place / "far.csv").write_text("\n".join([lines[0], lines[-1]]) + "\n", "utf-8")
    with pytest.raises(InputError, match="none of its orbits crosses"):
        load_study_text(STUDY.replace("neos.csv", "far.csv"), path=place / "s.yaml")
