"""Every error of telescopes that a settings file can name, in fits: against dense algebra, against made-up truth, and
on an arc of (3666) Holman with its records from space.

The made-up sky: an object 0.16 au away, seen for 15 days from three sites on the ground and from a spacecraft on
a circle of 60,000 km about the Earth, whose records state where it was.
"""

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag

from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris, ForceModel, propagate
from nebosvod.errors import CoverageError, InputError
from nebosvod.fits.answer import answer
from nebosvod.fits.engine import fit_object
from nebosvod.mission import load_fit
from nebosvod.observation.formats.reading import read_astrometry
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.direction import offset
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.observation.reduction.observers import telescopes
from nebosvod.results.fit_summary import summarise
from nebosvod.results.fit_tables import all_arrays
from nebosvod.scene.material import gather
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.timescale import Epoch

ARCSEC = np.pi / 648000.0
DAY = 86400.0
EPOCH = Epoch.parse("2023-03-01T00:00:00 TDB")
STATE = np.array([-1.62e8, 5.6e7, 2.4e7, -13.0, -26.0, -9.0])
SITES, SPACE = ("F51", "W94", "568"), "C57"
TREATMENTS = ("estimated", "considered", "ignored")
BLANK = {"permID": "1", "mode": "CCD", "ra": "1", "dec": "1"}
KEEP = "  rejection: {enabled: false}\n  night_limit: 4\n"
FILE = f"  spacecraft: {{{SPACE}: {{kind: oem, file: craft.oem}}}}\n"
SIGMA = 0.2  # arcsec, of every direction
GM_EARTH, GM_MOON, GM_SUN = 398600.4418, 4902.80, 1.32712e11  # km^3/s^2
RADIUS_KM = 60_000.0
UTC_LAG_S = 69.184  # behind TDB
MOTION = np.sqrt(GM_EARTH / RADIUS_KM**3)  # a revolution in 1.7 days
COVARIANCE = np.array([[9.0, 2.0, -1.0], [2.0, 6.0, 1.5], [-1.0, 1.5, 4.0]]) * 100.0**2  # km^2
PARTS = ["posCov11", "posCov12", "posCov13", "posCov22", "posCov23", "posCov33"]
PLACES = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
COLUMNS = ("permID", "mode", "stn", "sys", "ctr", "pos1", "pos2", "pos3", *PARTS,
           "obsTime", "ra", "dec", "rmsRA", "rmsDec", "astCat")  # fmt: skip
HEAD = f"""schema_version: 1
name: made
object:
  name: made
  orbit: {{kind: state, frame: icrf, epoch: 2023-03-01 TDB,
    position: [{", ".join(f"{float(x)!r} km" for x in STATE[:3])}],
    velocity: [{", ".join(f"{float(v)!r} km/s" for v in STATE[3:])}]}}
fit:
  observations: [made.psv]
  clock: 0 s
"""
DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "observations"


def spacecraft(days):
    """Geocentric ICRF position and velocity (n, 3), km and km/s, of the made-up orbit, days after its epoch in UTC."""
    angle = MOTION * DAY * np.asarray(days)[:, None]
    a, b = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.8, 0.6])
    place = RADIUS_KM * (np.cos(angle) * a + np.sin(angle) * b)
    return place, RADIUS_KM * MOTION * (-np.sin(angle) * a + np.cos(angle) * b)


def psv(rows):
    """An ADES file."""
    return (
        "\n".join(["# version=2022", "|".join(COLUMNS), *("|".join(r.get(c, "") for c in COLUMNS) for r in rows)])
        + "\n"
    )


def utc(day):
    """Days after 2023-03-01 as a UTC time."""
    return str(np.datetime64("2023-03-01T00:00:00.000000") + np.timedelta64(round(day * DAY * 1e6), "us")) + "Z"


def oem(covariance=""):
    """The same orbit as a CCSDS file, a state an hour."""
    days = np.arange(-192, 193) / 24.0
    place, velocity = spacecraft(days)
    states = "\n".join(
        utc(day)[:-1] + " " + " ".join(f"{x:.9f}" for x in (*r, *v)) for day, r, v in zip(days, place, velocity)
    )
    return f"""CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2023-01-01T00:00:00
ORIGINATOR = TEST
META_START
OBJECT_NAME = CRAFT
OBJECT_ID = 2018-001A
CENTER_NAME = EARTH
REF_FRAME = ICRF
TIME_SYSTEM = UTC
START_TIME = {utc(days[0])[:-1]}
STOP_TIME = {utc(days[-1])[:-1]}
INTERPOLATION = HERMITE
INTERPOLATION_DEGREE = 7
META_STOP
{states}
{covariance}"""


@pytest.fixture(scope="module")
def world(ephemeris, tmp_path_factory):
    """The records with their places, and where the object really was seen from each."""
    rng = np.random.default_rng(7)
    space = np.sort(rng.uniform(-7.5, 7.5, 40))
    ground = np.sort(rng.uniform(-7.5, 7.5, 60))
    rows = [{**BLANK, "stn": SITES[k % 3], "obsTime": utc(day), "astCat": "UCAC4"} for k, day in enumerate(ground)]
    for day, place in zip(space, spacecraft(space)[0]):
        there = {f"pos{k + 1}": f"{x:.6f}" for k, x in enumerate(place)}
        where = {"stn": SPACE, "sys": "ICRF_KM", "ctr": "399", "obsTime": utc(day), "astCat": "Gaia2"}
        rows.append(BLANK | where | there)
    rows.sort(key=lambda row: row["obsTime"])
    for row in rows:
        row |= {"rmsRA": str(SIGMA), "rmsDec": str(SIGMA)}
    path = tmp_path_factory.mktemp("made") / "draft.psv"
    path.write_text(psv(rows), "utf-8")
    records = read_astrometry(path)
    observers = telescopes(records, ephemeris)
    t_s = records.t_s + (records.epoch - EPOCH)
    R = np.tile((SIGMA * ARCSEC) ** 2 * np.eye(2), (len(records), 1, 1))
    forces = ForceModel(ephemeris=ephemeris)
    trajectory = propagate(STATE, EPOCH, [t_s.min(), t_s.max()], forces)
    seen = compute(trajectory, Sky.of(EPOCH, t_s, records.psi, R, observers.state_km_km_s, ephemeris).exposures)
    noise = SIGMA * rng.standard_normal((len(rows), 2))
    return SimpleNamespace(
        rows=rows, records=records, observers=observers, t_s=t_s, psi=seen.psi, H_z=seen.H_z, noise=noise,
        space=records.station == SPACE, ephemeris=ephemeris,
    )  # fmt: skip


@pytest.fixture
def fit(world, tmp_path):
    """A function that writes records and settings and fits them: wrong by `error` (n, 2) arcsec beside the noise."""

    def run(entries="", more="", *, error=0.0, change=None):
        psi = offset(world.psi, ARCSEC * (world.noise + error))
        rows = [
            row
            | {"ra": f"{np.degrees(ra):.12f}", "dec": f"{np.degrees(dec):.12f}"}
            | (change or {}).get(row["stn"], {})
            for row, (ra, dec) in zip(world.rows, psi.tolist())
        ]
        (tmp_path / "made.psv").write_text(psv(rows), "utf-8")
        (tmp_path / "craft.oem").write_text(oem(), "utf-8")
        block = f"  uncertainty:\n    - {entries}\n" if entries else ""
        (tmp_path / "made.yaml").write_text(HEAD + block + more, "utf-8")
        mission = load_fit(tmp_path / "made.yaml")
        found = fit_object(gather(mission), mission, world.ephemeris)
        said = answer(found)
        point = found.general.fit.point
        S = found.general.fit.estimate.factor(STATE_NAMES)
        return SimpleNamespace(
            summary=summarise(said), arrays=all_arrays(said), found=found, estimate=found.general.fit.estimate,
            values=point.values, chi2=np.sum(np.linalg.solve(S, point.state - STATE) ** 2),
        )  # fmt: skip

    return run


# --- dense algebra: what each error does to all measurements at once, written from its definition --------------------


def white(arrays, mine):
    return np.where(np.eye(len(mine), dtype=bool), 1.0, 0.0), 100.0**2


def constant(arrays, mine):
    return np.ones((len(mine), len(mine))), 100.0**2


def gauss_markov(arrays, mine):
    t = arrays["epoch_s"][mine]
    return np.exp(-np.abs(t[:, None] - t) / (2.0 * DAY)), 100.0**2


def position(kernel):
    """Covariance (2n, 2n) of a position error with a correlation in time, the same on each axis."""

    def covariance(arrays, mine):
        correlation, variance = kernel(arrays, mine)
        H = np.zeros((arrays["H_z"].shape[0], 2, 3))
        H[mine] = arrays["H_z"][mine]
        whole = np.zeros((len(H), len(H)))
        whole[np.ix_(mine, mine)] = variance * correlation
        return np.einsum("iak,ij,jbk->iajb", H, whole, H).reshape(2 * len(H), -1)

    return covariance


def common(D, covariance):
    """The same for common parameters with partials D (n, 2, q)."""
    flat = D.reshape(-1, D.shape[2])
    return flat @ covariance @ flat.T


def drift(arrays, mine):
    D = np.zeros((len(arrays["psi"]), 2, 4))
    D[mine, :, :2] = np.eye(2)
    D[mine, :, 2:] = arrays["epoch_s"][mine][:, None, None] * np.eye(2)
    return common(D, np.diag(np.square([0.3, 0.3, 0.1 / DAY, 0.1 / DAY]) * ARCSEC**2))


def zones(arrays, mine):
    side = np.radians(3.0)
    ra, dec = arrays["psi"][mine].T
    band = np.floor((dec + np.pi / 2) / side)
    around = np.floor(2.0 * np.pi * np.cos((band + 0.5) * side - np.pi / 2) / side)
    zone = band * 1000 + np.floor(ra / (2.0 * np.pi) * around)
    assert len(np.unique(zone)) > 2
    whole = np.zeros((len(arrays["psi"]),) * 2)
    whole[np.ix_(mine, mine)] = zone[:, None] == zone
    return np.kron(whole, np.eye(2)) * (0.3 * ARCSEC) ** 2


def orbit_error(arrays, mine):
    """Transition along the circle in the fields of the Earth, the Moon and the Sun: tides count over 28 rad."""
    t, (moon, sun) = arrays["epoch_s"][mine], paths()

    def slope(t_s, Phi):
        A = np.zeros((6, 6))
        A[:3, 3:] = np.eye(3)
        r = spacecraft([(t_s - UTC_LAG_S) / DAY])[0][0]
        for gm, d in ((GM_EARTH, r), (GM_MOON, r - moon(t_s)), (GM_SUN, r - sun(t_s))):
            size = np.linalg.norm(d)
            A[3:, :3] += gm * (3.0 * np.outer(d, d) / size**5 - np.eye(3) / size**3)
        return (A @ Phi.reshape(6, 6)).ravel()

    D = np.zeros((len(arrays["psi"]), 2, 6))
    for sign in (-1.0, 1.0):
        there = np.flatnonzero(sign * t > 0.0)
        there = there[np.argsort(np.abs(t[there]))]
        span = (0.0, sign * 8.0 * DAY)
        run = solve_ivp(slope, span, np.eye(6).ravel(), t_eval=t[there], rtol=1e-8, atol=1e-12, method="DOP853")
        D[mine[there]] = arrays["H_z"][mine[there]] @ run.y.T.reshape(-1, 6, 6)[:, :3]
    return common(D, np.diag(np.square([100.0] * 3 + [1e-4] * 3)))


@cache
def paths():
    """Geocentric places of the Moon and the Sun, km, at TDB seconds after the epoch."""
    ephemeris, t_s = Ephemeris.load(), np.arange(-200.0, 201.0) * 3600.0
    earth = ephemeris.position_km("earth", EPOCH, t_s)
    return [CubicSpline(t_s, ephemeris.position_km(body, EPOCH, t_s) - earth) for body in ("moon", "sun")]


KINDS = {
    "white": ("position: {sigma: 100 km, correlation: white, ", position(white), 1e-6),
    "constant": ("position: {sigma: 100 km, correlation: constant, ", position(constant), 1e-6),
    "gauss_markov": ("position: {sigma: 100 km, correlation: gauss_markov, time: 2 d, ", position(gauss_markov), 1e-6),
    "orbit_error": ("position: {sigma: 100 km, velocity_sigma: 100 mm/s, correlation: orbit_error, frame: icrf, ",
                    orbit_error, 1e-3),
    "drift": ("bias: {sigma: 0.3 arcsec, correlation: drift, drift: 0.1 arcsec/d, ", drift, 1e-6),
    "per_zone": ("bias: {sigma: 0.3 arcsec, correlation: per_zone, zone: 3 deg, ", zones, 1e-6),
}  # fmt: skip


def dense(arrays, B, known):
    """True and formal covariance (6, 6) of the state, and the part of the source; `known` has B in the weights."""
    H = arrays["H"].reshape(-1, 6)
    n = len(arrays["R"])
    R = np.zeros((n, 2, n, 2))
    R[np.arange(n), :, np.arange(n), :] = arrays["R"]
    R = R.reshape(2 * n, -1)  # type: ignore[assignment]
    V = R + B if known else R
    L = np.linalg.cholesky(V)
    Q, triangle = np.linalg.qr(np.linalg.solve(L, H))
    S = np.linalg.solve(triangle, np.eye(6))
    gain = np.linalg.solve(L.T, Q @ S.T).T
    part = gain @ B @ gain.T
    return gain @ R @ gain.T + part, S @ S.T, part


def assert_as_dense(one, B, known, name, tolerance):
    """Covariances and the share of the source agree with dense algebra on the arrays of the run."""
    true, formal, part = dense(one.arrays, B, known)
    sigma = np.sqrt(np.diag(true))
    K = one.estimate.covariance(STATE_NAMES)
    np.testing.assert_allclose(K / np.outer(sigma, sigma), true / np.outer(sigma, sigma), atol=tolerance)
    np.testing.assert_allclose(np.diag(one.estimate.K_formal)[:6], np.diag(formal), rtol=tolerance)
    row = next(row for row in one.summary["budget"] if row["source"] == name)
    share = np.trace(part[:3, :3]) / np.trace(true[:3, :3])
    assert row["share_position"] == pytest.approx(share, abs=tolerance)
    assert known or share > 0.02, "the source must matter, or the test would prove nothing"
    assert sum(row["share_position"] for row in one.summary["budget"]) == pytest.approx(1.0, abs=1e-9)


@pytest.fixture(scope="module")
def plain_formal():
    """Formal covariance of a fit that names no source, found once."""
    return {}


@pytest.mark.parametrize("treatment", TREATMENTS)
@pytest.mark.parametrize("kind", KINDS)
def test_every_error_of_a_space_telescope_is_that_of_dense_algebra(fit, world, plain_formal, kind, treatment):
    words, covariance, tolerance = KINDS[kind]
    more = KEEP + (FILE if kind == "orbit_error" else "")
    one = fit(f"{{stations: [{SPACE}], {words}treatment: {treatment}}}}}", more)
    name = ("orbit error" if kind == "orbit_error" else "bias" if words[0] == "b" else "telescope position") + " C57"
    B = covariance(one.arrays, np.flatnonzero(world.space))
    assert_as_dense(one, B, treatment == "estimated", name, tolerance)
    if "formal" not in plain_formal:
        plain_formal["formal"] = np.diag(fit(more=KEEP).estimate.K_formal)[:6]
    formal, true = np.diag(one.estimate.K_formal)[:6], np.diag(one.estimate.covariance(STATE_NAMES))
    if treatment == "estimated":
        assert formal == pytest.approx(true, rel=1e-6)
        assert np.all(formal > plain_formal["formal"])
    else:
        assert formal == pytest.approx(plain_formal["formal"], rel=1e-3)
        assert true.sum() > 1.1 * formal.sum()


def test_stated_covariances_of_places_enter_the_weights(fit, world):
    stated = {part: f"{COVARIANCE[i, j]:.1f}" for part, (i, j) in zip(PARTS, PLACES)}
    one = fit(more=KEEP, change={SPACE: stated})
    n, mine = len(world.t_s), np.flatnonzero(world.space)
    B = np.zeros((n, 2, n, 2))
    H = one.arrays["H_z"][mine]
    B[mine, :, mine, :] = H @ COVARIANCE @ H.transpose(0, 2, 1)
    assert_as_dense(one, B.reshape(2 * n, -1), True, "telescope position as stated", 1e-6)


def test_a_constant_error_of_place_is_recovered(fit, world):
    """700 km at 0.16 au: 6 arcsec, thirty times the noise."""
    truth = np.array([700.0, -500.0, 400.0])
    error = np.where(world.space[:, None], world.H_z @ truth / ARCSEC, 0.0)
    entry = f"{{stations: [{SPACE}], position: {{sigma: 1000 km, correlation: constant, treatment: estimated}}}}"
    one = fit(entry, error=error)
    names = [f"telescope position {SPACE} {axis}" for axis in "xyz"]
    off = np.array([one.values[name] for name in names]) - truth
    S = one.estimate.factor(names)
    assert np.sum(np.linalg.solve(S @ S.T, off) * off) < 16.3  # 99.9 % of chi squared, 3
    assert np.linalg.norm(S, axis=1).max() < 500.0  # km
    assert one.chi2 < 22.5  # the orbit too: 99.9 %, 6
    assert one.summary["fit"]["n_rejected"] <= 2


def test_a_drift_of_a_space_telescope_is_recovered_and_spoils_the_orbit_of_who_does_not_know(fit, world):
    """0.13 arcsec a day for 15 days, as in real data of one survey from space."""
    rate = 0.13
    error = np.where(world.space[:, None], rate * world.t_s[:, None] / DAY * [1.0, 0.0], 0.0)
    words = "bias: {sigma: 0.5 arcsec, correlation: drift, drift: 0.2 arcsec/d, treatment: estimated}"
    one = fit(f"{{stations: [{SPACE}], {words}}}", error=error)
    name = f"bias {SPACE} RA* drift"
    unit = ARCSEC / DAY
    found, sigma = one.values[name] / unit, one.estimate.sigma(name) / unit
    assert found == pytest.approx(rate, abs=3.0 * sigma)
    assert sigma < 0.02  # arcsec a day
    assert one.chi2 < 22.5
    assert one.summary["fit"]["n_rejected"] <= 2
    without, trusting = fit(error=error), fit(more=KEEP, error=error)
    # expected 6; here 164 with every observation kept, 4.4 with the drift; the default finds it and leans on it less
    assert trusting.chi2 > 100.0
    assert without.chi2 < 22.5
    (said,) = without.summary["fit"]["shared_errors"]
    assert (said["station"], said["kind"]) == (SPACE, "drift")
    assert said["sigmas"]["drift"] > 5.0
    assert said["estimate"][0] == pytest.approx(rate, abs=3.5 * said["sigma"][0])
    as_before = fit(more="  shared_errors: {treatment: told}\n", error=error)
    assert as_before.chi2 > 30.0


def test_large_errors_drawn_anew_reject_nobody(fit, world):
    """Each place is wrong by 1000 km by itself: who knows it must not take it for gross errors."""
    rng = np.random.default_rng(3)
    wrong = 1000.0 * rng.standard_normal((len(world.t_s), 3, 1))
    error = np.where(world.space[:, None], (world.H_z @ wrong)[:, :, 0] / ARCSEC, 0.0)
    for words in ("white", "gauss_markov, time: 1 h"):
        entry = f"{{stations: [{SPACE}], position: {{sigma: 1000 km, correlation: {words}, treatment: estimated}}}}"
        one = fit(entry, error=error)
        assert one.summary["fit"]["n_rejected"] <= 3
        assert one.chi2 < 22.5


def test_zones_are_those_of_the_observed_directions(fit):
    """An orbit that is a tenth of a radian off must see the same zones."""
    one = fit("{stations: all, bias: {sigma: 0.1 arcsec, correlation: per_zone, zone: 3 deg, treatment: estimated}}")
    scene, seen = one.found.general.scene, one.found.general.fit.observation
    elsewhere = replace(seen, psi=seen.psi + 0.1)
    here, there = (
        [nuisance.term(observation, scene.ephemeris) for nuisance in scene.nuisances]
        for observation in (seen, elsewhere)
    )
    assert [term.names for term in here] == [term.names for term in there]
    for a, b in zip(here, there):
        np.testing.assert_array_equal(a.H, b.H)


def test_a_file_of_the_orbit_gives_the_places_of_the_records(fit):
    """Interpolated from hourly states to below a metre; velocities from it, not from neighbouring records."""
    records, file = fit(more=KEEP), fit(more=KEEP + FILE)
    places = [one.found.material.observers.state_km_km_s for one in (records, file)]
    assert np.abs(places[0][:, :3] - places[1][:, :3]).max() < 1e-3  # km
    assert np.abs(records.values["x_km"] - file.values["x_km"]) < 1e-3 * file.estimate.sigma("x_km")
    assert file.found.material.observers.velocity_known.all()


def test_an_orbit_error_without_a_file_says_that_it_needs_one(fit):
    words = "position: {sigma: 1 km, velocity_sigma: 1 m/s, correlation: orbit_error, treatment: considered}"
    with pytest.raises(CoverageError, match=f"telescope {SPACE}.*give its trajectory as an SPK or OEM file"):
        fit(f"{{stations: [{SPACE}], {words}}}")


def test_the_covariance_in_the_file_of_the_orbit_is_used(fit, tmp_path, monkeypatch):
    rows = "\n".join(
        " ".join("1.0e4" if i == j < 3 else "1.0e-8" if i == j else "0.0" for j in range(i + 1)) for i in range(6)
    )
    block = f"COVARIANCE_START\nEPOCH = 2023-02-28T23:58:50.816\nCOV_REF_FRAME = ICRF\n{rows}\nCOVARIANCE_STOP\n"
    text = oem(block)
    monkeypatch.setitem(globals(), "oem", lambda: text)
    words = "position: {covariance: orbit, correlation: orbit_error, treatment: considered}"
    one = fit(f"{{stations: [{SPACE}], {words}}}", KEEP + FILE)
    B = orbit_error(one.arrays, np.flatnonzero(one.found.material.astrometry.station == SPACE))
    assert_as_dense(one, B, False, f"orbit error {SPACE}", 1e-3)


def test_a_covariance_asked_of_no_file_is_refused_with_its_line(fit):
    words = "position: {covariance: orbit, correlation: orbit_error, treatment: considered}"
    with pytest.raises(InputError, match=r"made.yaml:\d+.*fit.uncertainty\[0\].position.covariance.*got none"):
        fit(f"{{stations: [{SPACE}], {words}}}")


def test_tables_of_weights_and_of_star_catalogues_are_used_and_recorded(fit, world, tmp_path, capsys):
    """The whole command: a bias of the catalogue of the ground records taken off, a weight of a station, every file."""
    bias = np.array([0.3, -0.2])
    (tmp_path / "bias.dat").write_text("! head\n" * 23 + (" ".join(["0.300 -0.200 0.0 0.0"] * 26) + "\n") * 48, "ascii")
    columns = "station,mode,catalogue,from,until,sigma_ra_arcsec,sigma_dec_arcsec,source"
    (tmp_path / "own.csv").write_text(f"{columns}\n{SPACE},*,*,,,0.5,0.7,mine\n", "utf-8")
    more = FILE + "  weights: own.csv\n  debias: bias.dat\n"
    one = fit(more=more, error=np.where(world.space[:, None], 0.0, bias))
    material = one.found.material
    few = [not str(rule).endswith("sqrt(5/4)") for rule in material.rule[world.space]]  # of five in one night, more
    assert sum(few) >= 30
    np.testing.assert_allclose(material.sigma_rad[world.space][few] / ARCSEC, np.tile([0.5, 0.7], (sum(few), 1)))
    clean = offset(world.psi, ARCSEC * world.noise)
    off = (material.observed - clean) / ARCSEC
    assert np.abs(off).max() < 1e-4
    assert one.chi2 < 22.5
    assert fit(error=np.where(world.space[:, None], 0.0, bias)).chi2 > 2.0 * one.chi2
    fit(more=more)  # the files of the right sky again
    assert main(["fit", str(tmp_path / "made.yaml"), "-o", str(tmp_path / "run"), "--json"]) == 0
    said = json.loads((tmp_path / "run" / "manifest.json").read_text("utf-8"))["inputs_sha256"]
    assert {Path(name).name for name in said} == {"made.psv", "own.csv", "bias.dat", "craft.oem"}


@pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference observations is not here")
@pytest.mark.parametrize("treatment", TREATMENTS)
def test_a_drift_of_a_real_survey_from_space_is_that_of_dense_algebra(ephemeris, tmp_path, treatment):
    """(3666) Holman in 2009 and 2010, with the records of WISE."""
    lines = (DATA / "03666_Holman.obs80").read_text("ascii").splitlines()
    (tmp_path / "arc.obs80").write_text("\n".join(x for x in lines if x[15:19] in ("2009", "2010")) + "\n", "ascii")
    words = f"bias: {{sigma: 0.3 arcsec, correlation: drift, drift: 0.13 arcsec/d, treatment: {treatment}}}"
    text = f"schema_version: 1\nname: holman\nfit:\n  observations: [arc.obs80]\n  clock: 0 s\n{KEEP}"
    (tmp_path / "h.yaml").write_text(text + f"  uncertainty: [{{stations: [C51], {words}}}]\n", "utf-8")
    mission = load_fit(tmp_path / "h.yaml")
    found = fit_object(gather(mission), mission, ephemeris)
    said = answer(found)
    arrays = all_arrays(said)
    mine = np.flatnonzero(found.material.astrometry.station == "C51")
    assert len(mine) > 10
    D = np.zeros((len(arrays["psi"]), 2, 4))
    D[mine, :, :2] = np.eye(2)
    D[mine, :, 2:] = arrays["epoch_s"][mine][:, None, None] * np.eye(2)
    B = common(D, np.diag(np.square([0.3, 0.3, 0.13 / DAY, 0.13 / DAY]) * ARCSEC**2))
    one = SimpleNamespace(arrays=arrays, estimate=found.general.fit.estimate, summary=summarise(said))
    assert_as_dense(one, B, treatment == "estimated", "bias C51", 1e-4)


# --- what errs about the object itself ------------------------------------------------------------------------------


def held(text):
    """Settings whose object has more to it."""
    return HEAD.replace("\nfit:\n", f"\n  {text}\nfit:\n")


def shocks(t, later=None, m=600):
    """What accelerations in m short intervals do to the state at the epoch until times t and a later one (., 6, 3 m).

    By the transition of a body in the field of the Sun alone. Also the lengths (3 m,) and the transition to that time.
    """
    radius = STATE[:3]

    def slope(t_s, y):
        r, A = y[:3], np.zeros((6, 6))
        size = np.linalg.norm(r)
        A[:3, 3:] = np.eye(3)
        A[3:, :3] = GM_SUN * (3.0 * np.outer(r, r) / size**5 - np.eye(3) / size**3)
        return np.concatenate([y[3:6], -GM_SUN * r / size**3, (A @ y[6:].reshape(6, 6)).ravel()])

    first, last = t.min(), max(t.max(), later or 0.0)
    edges = np.concatenate([np.linspace(first, 0.0, m // 3 + 1), np.linspace(0.0, last, m - m // 3 + 1)[1:]])
    middle, step = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    start = np.concatenate([radius, STATE[3:], np.eye(6).ravel()])
    Phi: dict[float, np.ndarray] = {}
    for sign in (-1.0, 1.0):
        there = np.unique(np.abs([x for x in (*middle, later or 0.0) if sign * x > 0.0]))
        run = solve_ivp(slope, (0.0, sign * there[-1]), start, t_eval=sign * there, rtol=1e-9, atol=1e-9)
        Phi |= {float(x): y[6:].reshape(6, 6) for x, y in zip(sign * there, run.y.T)}
    push = np.eye(6)[:, 3:]
    back = np.array([np.linalg.solve(Phi[float(x)], push) * h for x, h in zip(middle, step)])  # (m, 6, 3)
    end = np.array([*t, later or 0.0])[:, None]
    # the part of each interval between the epoch and the time, with its sign
    after, before = (end - edges[:-1]) / step, (edges[1:] - end) / step
    part = np.where(middle > 0.0, np.clip(after, 0.0, 1.0), -np.clip(before, 0.0, 1.0))
    B = part[:, :, None, None] * back
    return B.transpose(0, 2, 1, 3).reshape(len(end), 6, -1), np.repeat(step, 3), Phi.get(float(later or 0.0), np.eye(6))


@pytest.mark.parametrize("treatment", ["estimated", "considered"])
def test_process_noise_of_the_object_is_that_of_dense_algebra_then_and_later(fit, monkeypatch, treatment):
    """Accelerations in 600 intervals as unknowns of one least squares, or as an error left out of it."""
    said = f"process_noise: {{velocity: 2 m/s, over: 30 d, intervals: 60, treatment: {treatment}}}"
    monkeypatch.setitem(globals(), "HEAD", held(said))
    later = Epoch.parse("2023-03-21T00:00:00 TDB")
    one = fit(more=KEEP + "  epochs: [2023-03-21 TDB]\n")
    amid = one.found.epoch
    t, until = one.arrays["epoch_s"], later - amid
    B, step, Phi = shocks(t, until)
    q = 2e-3**2 / (30.0 * DAY)
    H = one.arrays["H"].reshape(-1, 6)
    D = np.einsum("nai,nij->naj", one.arrays["H"], B[:-1]).reshape(len(H), -1)
    R = block_diag(*one.arrays["R"])
    C = D * (q / step) @ D.T
    L = np.linalg.cholesky(R + C if treatment == "estimated" else R)
    Q, triangle = np.linalg.qr(np.linalg.solve(L, H))
    gain = np.linalg.solve(triangle, np.linalg.solve(L.T, Q).T)
    state = gain @ (R + C) @ gain.T
    cross = -gain @ D * (q / step)  # of the estimated state's error and the accelerations
    if treatment == "estimated":
        rest = np.diag(q / step) - (D * (q / step)).T @ np.linalg.solve(R + C, D * (q / step))
        across = (D * (q / step)).T @ np.linalg.solve(R + C, H)
        after = rest + across @ state @ across.T
        cross = -state @ across.T
    else:
        after = np.diag(q / step)
    W = Phi @ np.hstack([np.eye(6), B[-1]])
    whole = W @ np.block([[state, cross], [cross.T, after]]) @ W.T
    sigma = np.sqrt(np.diag(state))
    K = one.estimate.covariance(STATE_NAMES)
    np.testing.assert_allclose(K / np.outer(sigma, sigma), state / np.outer(sigma, sigma), atol=5e-3)
    found = next(row for row in one.summary["further"] if row["epoch_tdb"].startswith("2023-03-21"))
    np.testing.assert_allclose(found["sigma_km_km_s"], np.sqrt(np.diag(whole)), rtol=5e-3)
    share = next(row for row in one.summary["budget"] if row["source"] == "process noise")
    assert share["share_position"] > 0.05
    assert one.summary["fit"]["dof"] == 2 * len(t) - 6
    assert not any(name.startswith("process noise") for name in one.summary["physics"]["parameters"])


def test_correlated_parameters_are_one_prior_of_a_fit(fit, monkeypatch):
    """A1 and A2 with a correlation: the prior of the estimate is that covariance, as is what was learned."""
    size = 1e-9
    block = f"{{value: 0 au/d^2, sigma: {size} au/d^2, treatment: estimated}}"
    said = f"nongrav: {{A1: {block}, A2: {block}}}\n  correlations: [{{between: [A1, A2], value: 0.9}}]"
    monkeypatch.setitem(globals(), "HEAD", held(said))
    one = fit(more=KEEP)
    names = one.found.general.seen.parameter_names
    assert names == ("a1_au_d2", "a2_au_d2")
    H = np.concatenate([one.found.general.seen.H_x0, one.found.general.seen.H_c], axis=2).reshape(-1, 8)
    unit = np.array([1e3] * 3 + [1e-3] * 3 + [size] * 2)
    W = np.repeat(1.0 / np.diagonal(one.arrays["R"], axis1=1, axis2=2).ravel(), 1)
    N = (H * unit).T @ (W[:, None] * (H * unit))
    N[6:, 6:] += np.linalg.solve(np.array([[1.0, 0.9], [0.9, 1.0]]), np.eye(2))
    K = np.linalg.solve(N, np.eye(8))
    found = one.estimate.covariance((*STATE_NAMES, *names)) / np.outer(unit, unit)
    sigma = np.sqrt(np.diag(K))
    np.testing.assert_allclose(found / np.outer(sigma, sigma), K / np.outer(sigma, sigma), atol=1e-6)
    assert abs(K[6, 7]) > 0.1 * sigma[6] * sigma[7]


def test_the_light_of_a_partly_lit_object_is_an_error_of_a_fit_too(fit, monkeypatch):
    """It was read and silently left out; here 5000 km of radius are seen from 0.16 au, so that it shows."""
    said = "photocentre: {value: 1.0, sigma: 1.0, radius: 5000 km, treatment: considered}"
    monkeypatch.setitem(globals(), "HEAD", held(said))
    one = fit(more=KEEP)
    row = next(row for row in one.summary["budget"] if row["source"] == "photocentre")
    assert row["share_position"] > 0.1


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("process_noise: {velocity: 1 mm/s, over: 1 d, treatment: estimated, true: {velocity: 2 mm/s}}",
         "object.process_noise.true: belongs to a mission that is simulated; what recorded measurements really are"),
        ("magnitude: {H: 20, sigma: 0.2, treatment: considered}",
         "object.magnitude.sigma: belongs to a mission that is simulated: directions say nothing of H"),
        ("correlations: [{between: [A1, A2], value: 0.5}]", "A1 has no error here: it needs a sigma"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_of_records_is_refused_with_the_reason(fit, monkeypatch, said, message):
    monkeypatch.setitem(globals(), "HEAD", held(said))
    with pytest.raises(InputError, match=re.escape(message)):
        fit(more=KEEP)
