"""Directions, rates, ellipses and brightness: against Horizons, against a mission's predictions, and by command."""

import csv
import json
from pathlib import Path

import erfa
import numpy as np
import numpy.typing as npt
import pytest
from astropy.table import Table

from nebosvod import UncertainOrbit, load_mission, read_orbit
from nebosvod.borders.shape import require_shape, schema_file
from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris
from nebosvod.ephemerides.observers import observer
from nebosvod.ephemerides.sky import Sky, sky, times
from nebosvod.errors import EventError, InputError
from nebosvod.results.ephemeris_folder import twilight_of
from nebosvod.results.folder import SCHEMAS
from nebosvod.timescale import Epoch
from nebosvod.units import ARCSEC, AU_KM, DAY_S

Array = npt.NDArray[np.float64]
SHARED = Path(__file__).resolve().parents[3].parent / "shared"
DYNAMICS, ORBITS = SHARED / "data" / "dynamics", SHARED / "data" / "orbits"
needs_data = pytest.mark.skipif(not DYNAMICS.is_dir(), reason="the folder of reference data is not here")
# objects of which Horizons had one solution when states and table were taken; of the others it moved in between
STEADY = ("433 Eros", "54509 YORP", "5335 Damocles", "15760 Albion", "15788 ", "15789 ")
# (99942) Apophis by JPL's solution 220, rounded; sigmas of the size of a short arc
APOPHIS = {"epoch": Epoch.parse("2459215.5 JD TDB"), "state": [-1.0788e8, 4.6283e7, 1.9432e7, -15.55, -24.78, -9.2]}


@pytest.fixture(scope="module")
def bodies() -> Ephemeris:
    return Ephemeris.load()


def some_orbit(scale: float = 1.0) -> UncertainOrbit:
    """An orbit with a full lower factor."""
    rng = np.random.default_rng(3)
    units = np.array([300.0, 300.0, 300.0, 3e-5, 3e-5, 3e-5])
    lower = np.tril(rng.normal(size=(6, 6)))
    np.fill_diagonal(lower, 0.3 + np.abs(np.diag(lower)))
    state = np.array(APOPHIS["state"])
    return UncertainOrbit(
        name="made up", epoch=APOPHIS["epoch"], state=state, factor=scale * units[:, None] * lower,  # type: ignore[arg-type]
        magnitude=(19.1, 0.24),
    )  # fmt: skip


def horizons() -> list[tuple[str, str]]:
    """Object and observatory of every table."""
    if not DYNAMICS.is_dir():
        return []
    with (DYNAMICS / "elements_sun_eq.csv").open() as file:
        names = [row["targetname"] for row in csv.DictReader(file)]
    return [(name, code) for name in names if name.startswith(STEADY) for code in ("X05", "W84")]


def table_of(name: str, code: str) -> tuple[UncertainOrbit, Array, dict[str, Array]]:
    """The orbit by Horizons' state, and its observer table: times after the epoch, and columns."""
    with (DYNAMICS / "elements_sun_eq.csv").open() as file:
        state = next(row for row in csv.DictReader(file) if row["targetname"] == name)
    with (DYNAMICS / "ephemeris.csv").open() as file:
        rows = [r for r in csv.DictReader(file) if r["targetname"] == name and r["observatory_code"] == code]
    x = np.array([float(state[key]) for key in ("x", "y", "z", "vx", "vy", "vz")])
    epoch = Epoch.parse(f"{state['mjd_tdb']} MJD TDB")
    orbit = UncertainOrbit(
        name=name, epoch=epoch, state=x * np.repeat([AU_KM, AU_KM / DAY_S], 3),
        factor=np.diag([1.0] * 3 + [1e-6] * 3), settings={"relativity": "eih"},
        magnitude=(float(rows[0]["H"]), float(rows[0]["G"])),
    )  # fmt: skip
    t = np.array([Epoch.parse(f"{row['mjd_utc']} MJD UTC") - epoch for row in rows])
    keys = ("RA", "DEC", "RA_rate", "DEC_rate", "V", "elong", "alpha", "delta", "r", "EL")
    return orbit, t, {key: np.array([float(row[key]) for row in rows]) for key in keys}


@needs_data
@pytest.mark.parametrize(("name", "code"), horizons())
def test_it_is_horizons_to_the_digits_printed(name: str, code: str, bodies: Ephemeris) -> None:
    orbit, t, said = table_of(name, code)
    found = sky(orbit, observer(code), orbit.epoch, t, bodies)
    ra = (np.degrees(found.psi[:, 0]) - said["RA"] + 180.0) % 360.0 - 180.0
    assert np.abs(ra * np.cos(found.psi[:, 1])).max() * 3600.0 < 1e-4
    assert np.abs(np.degrees(found.psi[:, 1]) - said["DEC"]).max() * 3600.0 < 1e-4
    assert np.abs(found.distance_km / AU_KM - said["delta"]).max() < 1e-10
    assert np.abs(found.r_sun_km / AU_KM - said["r"]).max() < 1e-10
    assert np.abs(np.degrees(found.elongation) - said["elong"]).max() < 1.0e-4
    assert np.abs(np.degrees(found.phase) - said["alpha"]).max() < 1.0e-4
    printed = np.abs(found.magnitude - said["V"])
    assert printed[np.degrees(found.phase) > 2.5].max(initial=0.0) < 6e-4
    assert printed.max() < 2.5e-3  # below 2.5 deg Horizons blends another form of the law in
    assert np.abs(np.degrees(found.altitude) - said["EL"]).max() < 0.006  # apparent there: aberration of 20 arcsec


@needs_data
@pytest.mark.parametrize(("name", "code"), horizons())
def test_rates_are_those_of_horizons_on_the_axes_of_date(name: str, code: str, bodies: Ephemeris) -> None:
    """Horizons leaves the change of the light time out, 25 x 25 km/s over c and the distance, and turns it to date."""
    orbit, t, said = table_of(name, code)
    found = sky(orbit, observer(code), orbit.epoch, t, bodies)
    rate = turned_to_date(found, orbit.epoch) / ARCSEC * 3600.0
    allowed = 2e-3 + 0.01 / said["delta"] + 1e-4 * np.linalg.norm(rate, axis=1)  # arcsec/h; rates are up to 250
    assert (np.abs(rate[:, 0] - said["RA_rate"]) < allowed).all()
    assert (np.abs(rate[:, 1] - said["DEC_rate"]) < allowed).all()


def test_rates_are_the_differences_of_places(bodies: Ephemeris) -> None:
    orbit, who, at = some_orbit(), observer("F51"), Epoch.parse("2021-06-01 UTC")
    t = np.linspace(0.0, 5.0 * DAY_S, 30)
    before, now, after = (sky(orbit, who, at, t + shift, bodies) for shift in (-10.0, 0.0, 10.0))
    motion = (after.psi - before.psi + np.pi) % (2.0 * np.pi) - np.pi
    motion[:, 0] *= np.cos(now.psi[:, 1])
    np.testing.assert_allclose(now.rate, motion / 20.0, rtol=1e-6, atol=1e-4 * ARCSEC / 3600.0)


def turned_to_date(found: Sky, epoch: Epoch) -> Array:
    """Rates (n, 2) on the true equator and equinox of date, whose own motion is left out."""
    matrix = erfa.pnm06a(epoch.day, epoch.fraction + found.t_s / DAY_S)
    ra, dec = found.psi.T
    east = np.stack([-np.sin(ra), np.cos(ra), 0.0 * ra], axis=1)
    north = np.stack([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)], axis=1)
    moving = found.rate[:, :1] * east + found.rate[:, 1:] * north
    ra, dec = erfa.c2s(np.einsum("nij,nj->ni", matrix, erfa.s2c(ra, dec)))
    moving = np.einsum("nij,nj->ni", matrix, moving)
    vectors = [
        np.stack([-np.sin(ra), np.cos(ra), 0.0 * ra], axis=1),
        np.stack([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)], axis=1),
    ]
    return np.stack([np.sum(moving * axis, axis=1) for axis in vectors], axis=1)


def test_ellipses_are_those_of_the_sky_predictions_of_a_mission(tmp_path: Path, bodies: Ephemeris) -> None:
    from nebosvod.mission.reading.builtin import builtin_path

    name = load_mission("minimal").telescopes[0].name
    text = builtin_path("minimal").read_text()
    head, _, _ = text.partition("predictions:")
    when = ("2028-04-25T00:00:00 UTC", "2028-07-01T12:00:00 UTC")
    rows = [f"  - {{name: p{k}, plane: sky, from: {name}, at: {at}}}" for k, at in enumerate(when)]
    path = tmp_path / "minimal.yaml"
    path.write_text(head + "predictions:\n" + "\n".join(rows) + "\n")
    assert main(["run", str(path), "-o", str(tmp_path / "there"), "--seed", "4"]) == 0
    said = json.loads((tmp_path / "there" / "summary.json").read_text())["predictions"]
    orbit, who = read_orbit(tmp_path / "there"), observer(f"{path}:{name}")
    for row, at in zip([row for row in said if row["estimator"] == said[0]["estimator"]], when, strict=True):
        found = sky(orbit, who, Epoch.parse(at), np.zeros(1), bodies)
        np.testing.assert_allclose(found.semi_axes[0] / ARCSEC, row["semi_axes_arcsec"], rtol=2e-6)
        turned = 90.0 - np.degrees(found.position_angle[0])
        assert (turned - row["angle_deg"] + 90.0) % 180.0 - 90.0 == pytest.approx(0.0, abs=1e-4)
        assert np.degrees(found.psi[0]) == pytest.approx([row["ra_deg"], row["dec_deg"]], abs=1e-9)
        assert found.distance_km[0] == pytest.approx(row["distance_km"], rel=1e-12)


def test_the_ellipse_is_the_scatter_of_drawn_orbits(bodies: Ephemeris) -> None:
    """400 orbits drawn by the covariance and flown one by one; 5 % is three sigmas of such a scatter."""
    orbit, who = some_orbit(), observer("500")
    at, when = Epoch.parse("2021-06-01 UTC"), np.array([0.0])
    found = sky(orbit, who, at, when, bodies)
    rng, drawn = np.random.default_rng(1), []
    for _ in range(400):
        moved = UncertainOrbit(
            name="x", epoch=orbit.epoch, state=orbit.state + orbit.factor @ rng.standard_normal(6), factor=orbit.factor
        )
        drawn.append(sky(moved, who, at, when, bodies).psi[0])
    scatter = (np.array(drawn) - found.psi[0]) * [np.cos(found.psi[0, 1]), 1.0]
    whitened = np.linalg.solve(found.factor[0], scatter.T)
    np.testing.assert_allclose(np.cov(whitened), np.eye(2), atol=0.22)
    axes = np.linalg.svd(found.factor[0], compute_uv=False)
    np.testing.assert_allclose(found.semi_axes[0], axes, rtol=1e-12)
    along = np.array([np.sin(found.position_angle[0]), np.cos(found.position_angle[0])])
    assert np.linalg.norm(found.factor[0].T @ along) == pytest.approx(axes[0], rel=1e-12)


def test_sigma_of_distance_scales_and_is_linear_in_the_factor(bodies: Ephemeris) -> None:
    who, at, t = observer("500"), Epoch.parse("2021-06-01 UTC"), np.array([0.0, 86400.0])
    one, three = (sky(some_orbit(scale), who, at, t, bodies) for scale in (1.0, 3.0))
    np.testing.assert_allclose(three.sigma_distance_km, 3.0 * one.sigma_distance_km, rtol=1e-12)
    orbit, sum_of_squares = some_orbit(), 0.0
    for column in orbit.factor.T:
        ends = []
        for sign in (0.5, -0.5):
            moved = UncertainOrbit(name="x", epoch=orbit.epoch, state=orbit.state + sign * column, factor=orbit.factor)
            ends.append(sky(moved, who, at, t, bodies).distance_km[0])
        sum_of_squares += (ends[0] - ends[1]) ** 2
    assert one.sigma_distance_km[0] == pytest.approx(np.sqrt(sum_of_squares), rel=1e-4)


def test_an_ellipse_longer_than_a_region_can_be_is_told(bodies: Ephemeris) -> None:
    where, epoch = observer("500"), APOPHIS["epoch"]
    t_s = np.arange(0.0, 400.0, 100.0) * DAY_S
    known, vague = (sky(some_orbit(scale), where, epoch, t_s, bodies) for scale in (1.0, 3000.0))  # type: ignore[arg-type]
    assert not [one for one in known.notices if "linear ellipse" in one]
    long = int(np.sum(vague.semi_axes[:, 0] > np.radians(3.0)))
    (told,) = (one for one in vague.notices if "linear ellipse" in one)
    assert 0 < long < 4
    assert told.startswith(f"{long} of 4 ellipses are longer than 3 deg at 1 sigma, the first at 20")


def test_twilight_by_the_altitude_of_the_sun() -> None:
    assert [twilight_of(h) for h in (10.0, -3.0, -9.0, -15.0, -30.0)] == [
        "day", "civil", "nautical", "astronomical", "night",
    ]  # fmt: skip
    assert twilight_of(float("nan")) is None


@pytest.fixture
def known(tmp_path: Path) -> Path:
    """A mission with a prior: an orbit with a covariance."""
    from nebosvod.mission.reading.builtin import builtin_path

    path = tmp_path / "known.yaml"
    path.write_text(builtin_path("minimal").read_text() + "\nprior: {sigma: {position: 20 km, velocity: 3 mm/s}}\n")
    return path


def test_command_writes_text_table_json_and_a_folder(
    known: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base = [
        "ephemeris",
        str(known),
        "--from",
        "2028-04-01",
        "--to",
        "2028-04-03",
        "--step",
        "12 h",
        "--from-site",
        "F51",
    ]
    assert main(base) == 0
    text = capsys.readouterr().out
    assert "2028-04-02 12:00:00" in text
    assert "F51 (Pan-STARRS 1, Haleakala)" in text
    assert main([*base, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    require_shape("summary", summary, schema_file(SCHEMAS["ephemeris"]))
    assert [row["epoch_utc"] for row in summary["rows"]][1] == "2028-04-01T12:00:00.000 UTC"
    assert main([*base, "--ecsv"]) == 0
    read = Table.read(capsys.readouterr().out, format="ascii.ecsv")
    assert read["ra_deg"].tolist() == [row["ra_deg"] for row in summary["rows"]]
    folder = tmp_path / "eph"
    assert main([*base, "-o", str(folder)]) == 0
    assert main([*base, "-o", str(folder)]) == 3
    assert main([*base, "-o", str(folder), "--overwrite"]) == 0
    assert json.loads((folder / "summary.json").read_text()) == summary
    page = (folder / "report.html").read_bytes()
    capsys.readouterr()
    assert main(["report", str(folder)]) == 0
    assert (folder / "report.html").read_bytes() == page
    near, long = (
        [row[key] for row in summary["rows"]] for key in ("distance_au", "semi_major_arcsec")
    )  # fmt: skip
    told = page.decode("utf-8")  # what a reader asks stands on top
    assert f"earest at {min(near):.4g} au on {summary['rows'][int(np.argmin(near))]['epoch_utc'][:10]}" in told
    assert f"known to {min(long):.3g}" in told


def test_five_observers_are_understood(known: Path, tmp_path: Path) -> None:
    name = load_mission("minimal").telescopes[0].name
    assert observer("F51").name.startswith("F51 (")
    assert observer(f"minimal:{name}").name == name
    assert observer(f"{known}:{name}").name == name


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"--from": "yesterday"}, "--from: needs a date"),
        ({"--to": "2027-01-01"}, "--to: 2027-01-01T00:00:00 UTC is before --from"),
        ({"--step": "1 au"}, "--step: "),
        ({"--step": "1 s"}, "times are asked for (allowed 200,000)"),
        ({"--step": "-1 d"}, "--step"),
        ({"--to": "2990-01-01", "--step": "100 d"}, "pip install "),
        ({"--from-site": "f51"}, "F51"),
        ({"--from-site": "C51"}, "no fixed place; give its trajectory"),
        ({"--from-site": "minimal:nobody"}, "has no telescope nobody"),
        ({"--from-site": "there.bsp"}, "there.bsp"),
        ({"--from-site": "moon"}, "an observer is an observatory code"),
    ],
)
def test_wrong_input_is_a_sentence_and_exit_2(
    changes: dict[str, str], said: str, known: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = {"--from": "2028-04-01", "--to": "2028-04-30", "--step": "1 d", "--from-site": "500"} | changes
    assert main(["ephemeris", str(known), *(word for pair in options.items() for word in pair)]) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert "Traceback" not in shown


def test_an_orbit_without_covariance_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ephemeris", "minimal", "--from", "2028-04-01", "--to", "2028-04-02"]) == 2
    assert "has no prior orbit, so its orbit has no covariance" in capsys.readouterr().err


@needs_data
def test_after_an_impact_there_are_no_places(capsys: pytest.CaptureFixture[str], bodies: Ephemeris) -> None:
    path = str(ORBITS / "neocc" / "2024BX1.ke0")
    code = main(["ephemeris", path, "--from", "2024-01-20", "--to", "2024-01-22", "--step", "6 h", "--json"])
    summary = json.loads(capsys.readouterr().out)
    assert code == 1
    assert len(summary["rows"]) == 5
    assert "hits earth on 2024-01-21T00:32:45 UTC: 4 of 9 times" in summary["ended"]
    with pytest.raises(EventError, match="2024BX1: "):
        sky(read_orbit(path), observer("500"), Epoch.parse("2024-02-01 UTC"), np.zeros(1), bodies)


def test_times_are_both_ends_included() -> None:
    first = Epoch.parse("2024-01-01 TDB")
    assert times(first, first + 10.0, 2.5).tolist() == [0.0, 2.5, 5.0, 7.5, 10.0]
    assert times(first, first, 1.0).tolist() == [0.0]
    with pytest.raises(InputError):
        times(first, first + 10.0, 0.0)


def test_days_of_utc_begin_at_midnight_over_a_leap_second_too() -> None:
    first, last = Epoch.parse("2016-12-30 UTC"), Epoch.parse("2017-06-30 UTC")
    found = times(first, last, DAY_S)
    assert {(first + t).iso("utc")[11:] for t in found} == {"00:00:00.000 UTC"}
    assert len(found) == 183
    assert found[-1] - 182 * DAY_S == pytest.approx(1.0, abs=3e-3)
