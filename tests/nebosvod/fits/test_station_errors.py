"""Errors of clocks, errors correlated in time or shared by stations, and spacecraft known by an SPK file, in fits.

Each is held to dense algebra: its covariance over all measurements is written from its definition here, rates by moving
observer and object a second on, and the fit must weigh, consider or ignore it as matrices of full size do. The made-up
sky: an object 0.16 au away, seen for 16 days by two sites on the ground and a spacecraft that leads the Earth by 3 deg.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from nebosvod.dynamics import ForceModel, propagate
from nebosvod.dynamics.spkwriter import write_spk
from nebosvod.fits.answer import answer
from nebosvod.fits.engine import fit_object
from nebosvod.mission import load_fit
from nebosvod.observation import read_spk
from nebosvod.observation.formats.reading import read_astrometry
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.direction import offset, residual
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.observation.reduction.observers import telescopes
from nebosvod.observation.spacecraft.kinds import turn_about_ecliptic_pole
from nebosvod.results.fit_summary import summarise
from nebosvod.results.fit_tables import all_arrays
from nebosvod.scene.material import gather
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.timescale import Epoch

ARCSEC, DAY = np.pi / 648000.0, 86400.0
EPOCH = Epoch.parse("2023-03-01T00:00:00 TDB")
STATE = np.array([-1.62e8, 5.6e7, 2.4e7, -13.0, -26.0, -9.0])
SPACE, NUMBER = "C49", -234
SIGMA = 0.2  # arcsec, of every direction
COLUMNS = ("permID", "mode", "stn", "sys", "ctr", "pos1", "pos2", "pos3", "obsTime", "rmsTime", "ra", "dec", "rmsRA",
           "rmsDec", "astCat")  # fmt: skip
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
  rejection: {{enabled: false}}
  spacecraft: {{{SPACE}: {{kind: spk, file: craft.bsp}}}}
"""
JWST = Path(__file__).resolve().parents[3].parent / "shared/data/observers/jwst_horizons_20200101_20240101_v01.bsp"


def utc(day: float) -> str:
    """Days after 2023-03-01 as a UTC time."""
    return str(np.datetime64("2023-03-01T00:00:00.000") + np.timedelta64(round(day * DAY * 1e3), "ms")) + "Z"


def psv(rows) -> str:
    """An ADES file."""
    lines = ["# version=2022", "|".join(COLUMNS), *("|".join(row.get(c, "") for c in COLUMNS) for row in rows)]
    return "\n".join(lines) + "\n"


def seen_from(ephemeris, t_s, places):
    """Directions (n, 2) of the object from barycentric states (n, 6)."""
    trajectory = propagate(STATE, EPOCH, [t_s.min(), t_s.max()], ForceModel(ephemeris=ephemeris))
    R = np.tile((SIGMA * ARCSEC) ** 2 * np.eye(2), (len(t_s), 1, 1))
    return compute(trajectory, Sky.of(EPOCH, t_s, np.zeros((len(t_s), 2)), R, places, ephemeris).exposures).psi


def make_world(ephemeris, folder, spk, station):
    """Records of three stations, and where the object really was at each moment.

    The spacecraft's records must state a place and state a wrong one: its file is used instead.
    """
    rng = np.random.default_rng(5)
    times = [(code, day) for code in ("F51", "W94", station) for day in rng.uniform(-8.0, 8.0, 25)]
    blank = {"permID": "1", "mode": "CCD", "ra": "1", "dec": "1", "astCat": "Gaia2"}
    blank |= {"rmsRA": str(SIGMA), "rmsDec": str(SIGMA)}
    wrong = {"sys": "ICRF_KM", "ctr": "10", "pos1": "-140000000.0", "pos2": "50000000.0", "pos3": "20000000.0"}
    rows = [
        blank | (wrong if code == station else {}) | {"stn": code, "obsTime": utc(day)}
        for code, day in sorted(times, key=lambda pair: pair[1])
    ]
    (folder / "draft.psv").write_text(psv(rows), "utf-8")
    records = read_astrometry(folder / "draft.psv")
    t_s = records.t_s + (records.epoch - EPOCH)
    observers = telescopes(records, ephemeris, files={station: read_spk(spk)})

    def psi(late_s):
        """Directions (n, 2) of the object, exposed later by so much, s (n,)."""
        places = np.empty((t_s.size, 6))
        for name, craft in observers.spacecraft.items():
            mine = observers.telescope == name
            carrier = getattr(craft, "carrier", craft)
            places[mine] = carrier.state_km_km_s(ephemeris, EPOCH, t_s[mine] + late_s[mine])
        return seen_from(ephemeris, t_s + late_s, places)

    second = np.ones(t_s.size)
    sun = ephemeris.state_km_km_s("sun", EPOCH, t_s)
    return SimpleNamespace(
        rows=rows, station=records.station, t_s=t_s, psi=psi, rate=residual(psi(second), psi(-second)) / 2.0, spk=spk,
        noise=SIGMA * rng.standard_normal((t_s.size, 2)), state=observers.state_km_km_s - sun,
        ephemeris=ephemeris,
    )  # fmt: skip


@pytest.fixture(scope="module")
def world(ephemeris, tmp_path_factory):
    """The sky with a spacecraft whose SPK file (type 3) was written from an orbit integrated here."""
    folder = tmp_path_factory.mktemp("made")
    now = np.zeros(1)
    earth = (ephemeris.state_km_km_s("earth", EPOCH, now) - ephemeris.state_km_km_s("sun", EPOCH, now)).reshape(2, 3)
    start = (earth @ turn_about_ecliptic_pole(np.radians(3.0)).T).ravel()
    orbit = propagate(start, EPOCH, [-10.0 * DAY, 10.0 * DAY], ForceModel(ephemeris=ephemeris))
    write_spk(orbit, folder / "craft.bsp", NUMBER, "CRAFT")
    return make_world(ephemeris, folder, folder / "craft.bsp", SPACE)


@pytest.fixture
def fit(ephemeris, tmp_path):
    """A function that writes records and settings and fits them: exposed `late_s` (n,) later than recorded."""

    def run(world, entry="", *, late_s=None, change=None, head=HEAD):
        psi = world.psi(np.zeros(world.t_s.size) if late_s is None else late_s)
        psi = offset(psi, ARCSEC * world.noise)
        rows = [
            row | {"ra": f"{np.degrees(ra):.12f}", "dec": f"{np.degrees(dec):.12f}"} | (change or {}).get(k, {})
            for k, (row, (ra, dec)) in enumerate(zip(world.rows, psi.tolist()))
        ]
        (tmp_path / "made.psv").write_text(psv(rows), "utf-8")
        (tmp_path / "craft.bsp").write_bytes(world.spk.read_bytes())
        block = f"  uncertainty:\n    - {entry}\n" if entry else ""
        (tmp_path / "made.yaml").write_text(head + block, "utf-8")
        mission = load_fit(tmp_path / "made.yaml")
        found = fit_object(gather(mission), mission, ephemeris)
        said = answer(found)
        return SimpleNamespace(
            summary=summarise(said), arrays=all_arrays(said), found=found, estimate=found.general.fit.estimate,
            values=found.general.fit.point.values, state=found.general.fit.point.state,
        )  # fmt: skip

    return run


# --- what each error does to all measurements at once, written from its definition ------------------------------------


def spread(D, kernel):
    """Covariance (2n, 2n) of errors D_i e_i, e with a covariance kernel (n, n, q, q) between exposures i and j."""
    return np.einsum("iaq,ijqr,jbr->iajb", D, kernel, D).reshape(2 * len(D), -1)


def of(world, *stations):
    """1 (n,) for exposures of these stations."""
    return np.isin(world.station, stations).astype(float)


def clock(*stations):
    """20 s, the same in all exposures of all of them."""

    def covariance(world, arrays):
        D = (world.rate * of(world, *stations)[:, None])[:, :, None]
        return spread(D, np.full((len(D), len(D), 1, 1), 20.0**2))

    return covariance


def bias(correlation, *stations):
    """0.3 arcsec in each axis, correlated in time over all these stations."""

    def covariance(world, arrays):
        D = of(world, *stations)[:, None, None] * np.eye(2)
        pairs = correlation(world, stations) * (0.3 * ARCSEC) ** 2
        return spread(D, pairs[:, :, None, None] * np.eye(2))

    return covariance


def fading(days):
    """exp(-dt / time)."""
    return lambda world, stations: np.exp(-np.abs(world.t_s[:, None] - world.t_s) / (days * DAY))


def arcs(days):
    """One within an arc of the stations, zero beyond a pause."""

    def same(world, stations):
        mine = np.flatnonzero(np.isin(world.station, stations))
        arc = np.full(world.t_s.size, -1)
        arc[mine] = np.cumsum(np.diff(world.t_s[mine], prepend=world.t_s[mine[0]]) > days * DAY)
        assert 3 < arc.max() < mine.size - 5
        return arc[:, None] == arc

    return same


def wandering_place(world, arrays):
    """20, 200 and 60 km along radius, track and normal, each fading over two days."""
    r, v = world.state[:, :3], world.state[:, 3:]
    radial, normal = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (r, np.cross(r, v)))
    axes = np.stack([radial, np.cross(normal, radial), normal], axis=2)
    D = of(world, SPACE)[:, None, None] * (arrays["H_z"] @ axes)
    pairs = fading(2.0)(world, ())
    return spread(D, pairs[:, :, None, None] * np.diag(np.square([20.0, 200.0, 60.0])))


def orbit_error(world, arrays):
    """100 km and 100 mm/s at the epoch, carried along by the pull of Sun and Earth."""
    t_s = np.arange(-240.0, 241.0) * 3600.0
    orbit = read_spk(world.spk)
    place = orbit.state_km_km_s(world.ephemeris, EPOCH, t_s)[:, :3]
    bodies = [
        (gm, CubicSpline(t_s, place - world.ephemeris.position_km(body, EPOCH, t_s)))
        for body, gm in (("sun", 1.32712e11), ("earth", 398600.4))
    ]

    def slope(t, Phi):
        A = np.zeros((6, 6))
        A[:3, 3:] = np.eye(3)
        for gm, from_body in bodies:
            d = from_body(t)
            size = np.linalg.norm(d)
            A[3:, :3] += gm * (3.0 * np.outer(d, d) / size**5 - np.eye(3) / size**3)
        return (A @ Phi.reshape(6, 6)).ravel()

    D = np.zeros((world.t_s.size, 2, 6))
    for sign in (-1.0, 1.0):
        mine = np.flatnonzero((world.station == SPACE) & (sign * world.t_s > 0.0))
        mine = mine[np.argsort(np.abs(world.t_s[mine]))]
        span = (0.0, sign * 8.5 * DAY)
        run = solve_ivp(slope, span, np.eye(6).ravel(), t_eval=world.t_s[mine], rtol=1e-9, atol=1e-12)
        D[mine] = arrays["H_z"][mine] @ run.y.T.reshape(-1, 6, 6)[:, :3]
    return spread(D, np.broadcast_to(np.diag(np.square([100.0] * 3 + [1e-4] * 3)), (len(D), len(D), 6, 6)))


TWO = "stations: [F51, W94], shared: common, "
FADING = "sigma: 0.3 arcsec, correlation: gauss_markov, time: 2 d"
WANDERING = "sigmas: [20 km, 200 km, 60 km], correlation: gauss_markov, time: 2 d, frame: rtn"
ORBIT = "sigma: 100 km, velocity_sigma: 100 mm/s, correlation: orbit_error, frame: icrf"
KINDS = {
    "clock of a site": ("stations: [F51], timing: {sigma: 20 s, ", clock("F51"), "timing F51"),
    "clock of a spacecraft": (f"stations: [{SPACE}], timing: {{sigma: 20 s, ", clock(SPACE), f"timing {SPACE}"),
    "clock of two sites": (TWO + "timing: {sigma: 20 s, ", clock("F51", "W94"), "common"),
    "fading bias": (f"stations: [F51], bias: {{{FADING}, ", bias(fading(2.0), "F51"), "bias F51"),
    "fading bias of two sites": (TWO + f"bias: {{{FADING}, ", bias(fading(2.0), "F51", "W94"), "common"),
    "bias by arc": ("stations: [F51], bias: {sigma: 0.3 arcsec, correlation: per_arc, gap: 12 h, ",
                    bias(arcs(0.5), "F51"), "bias F51"),
    "wandering spacecraft": (f"stations: [{SPACE}], position: {{{WANDERING}, ", wandering_place,
                             f"telescope position {SPACE}"),
    "orbit error by SPK": (f"stations: [{SPACE}], position: {{{ORBIT}, ", orbit_error, f"orbit error {SPACE}"),
}  # fmt: skip


def assert_as_dense(one, B, known, name, tolerance):
    """Covariances and the share of the source agree with matrices of full size; `known` has B in the weights."""
    H, R = one.arrays["H"].reshape(-1, 6), np.zeros_like(B)
    for k, block in enumerate(one.arrays["R"]):
        R[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    L = np.linalg.cholesky(R + B if known else R)
    Q, triangle = np.linalg.qr(np.linalg.solve(L, H))
    gain = np.linalg.solve(triangle, np.linalg.solve(L.T, Q).T)
    formal = np.sum(np.linalg.solve(triangle, np.eye(6)) ** 2, axis=1)
    part = gain @ B @ gain.T
    true = gain @ R @ gain.T + part
    sigma = np.sqrt(np.diag(true))
    found = one.estimate.covariance(STATE_NAMES)
    np.testing.assert_allclose(found / np.outer(sigma, sigma), true / np.outer(sigma, sigma), atol=tolerance)
    np.testing.assert_allclose(np.diag(one.estimate.K_formal)[:6], formal, rtol=tolerance)
    share = np.trace(part[:3, :3]) / np.trace(true[:3, :3])
    row = next(row for row in one.summary["budget"] if row["source"] == name)
    assert row["share_position"] == pytest.approx(share, abs=tolerance)
    assert known or share > 0.02, "the source must matter, or the test would prove nothing"


@pytest.mark.parametrize("treatment", ["estimated", "considered", "ignored"])
@pytest.mark.parametrize("kind", KINDS)
def test_errors_of_clocks_and_errors_correlated_in_time_are_those_of_dense_algebra(fit, world, kind, treatment):
    words, covariance, name = KINDS[kind]
    one = fit(world, f"{{{words}treatment: {treatment}}}}}")
    # rates are differences over two seconds on an orbit that the noise has moved: 1e-5 of them
    assert_as_dense(one, covariance(world, one.arrays), treatment == "estimated", name, 1e-4)


@pytest.mark.parametrize("treatment", ["considered", "ignored"])
def test_a_mean_that_is_left_out_is_not_taken_off_and_its_shift_is_that_of_dense_algebra(fit, world, treatment):
    without, one = (
        fit(world, f"{{stations: [F51], timing: {{sigma: 20 s, {mean}treatment: {treatment}}}}}")
        for mean in ("", "mean: 60 s, ")
    )
    np.testing.assert_allclose(one.state, without.state, rtol=0.0, atol=1e-3)
    H, n = one.arrays["H"].reshape(-1, 6), world.t_s.size
    L = np.zeros((2 * n, 2 * n))
    for k, block in enumerate(one.arrays["R"]):
        L[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = np.linalg.cholesky(block)
    caused = 60.0 * (world.rate * of(world, "F51")[:, None]).ravel()
    shift = np.linalg.lstsq(np.linalg.solve(L, H), np.linalg.solve(L, caused), rcond=None)[0]
    sigma = np.array([one.estimate.sigma(name) for name in STATE_NAMES])
    row = one.summary["estimators"][0]
    np.testing.assert_allclose(row["mean_error_km_km_s"] / sigma, shift / sigma, rtol=1e-3, atol=1e-3)
    assert np.max(np.abs(shift / sigma)) > 2.0
    assert not np.any(without.summary["estimators"][0]["mean_error_km_km_s"])
    assert any("mean error" in warning for warning in one.summary["warnings"])


def test_stated_errors_of_the_time_tilt_the_noise_along_the_motion(fit, world):
    mine = np.flatnonzero(world.station == "F51")[::2]
    one = fit(world, change={k: {"rmsTime": "30"} for k in mine})
    expected = np.tile((SIGMA * ARCSEC) ** 2 * np.eye(2), (world.t_s.size, 1, 1))
    expected[mine] += 900.0 * world.rate[mine, :, None] * world.rate[mine, None, :]
    np.testing.assert_allclose(one.arrays["R"], expected, rtol=0.0, atol=1e-4 * (SIGMA * ARCSEC) ** 2)
    assert np.max(expected[mine, 0, 0]) > 2.0 * (SIGMA * ARCSEC) ** 2


@pytest.mark.parametrize("station", ["F51", SPACE])
def test_a_clock_that_is_late_is_found_late(fit, world, station):
    """Exposed 80 s later than recorded, five times the noise: the sign is that of the documentation."""
    entry = f"{{stations: [{station}], timing: {{sigma: 100 s, treatment: estimated}}}}"
    one = fit(world, entry, late_s=80.0 * of(world, station))
    name = f"timing {station}"
    sigma = one.estimate.sigma(name)
    assert sigma < 10.0
    assert one.values[name] == pytest.approx(80.0, abs=3.5 * sigma)
    S = one.estimate.factor(STATE_NAMES)
    assert np.sum(np.linalg.solve(S, one.state - STATE) ** 2) < 22.5  # 99.9 % of chi squared, 6


@pytest.mark.parametrize("kind", [3, pytest.param(13, marks=pytest.mark.skipif(not JWST.is_file(), reason="no JWST"))])
def test_a_station_known_by_an_spk_file_is_where_its_records_would_put_it(
    fit, world, ephemeris, tmp_path, tmp_path_factory, kind
):
    """Type 3 written here; type 13, of the James Webb telescope (station 274)."""
    station = SPACE if kind == 3 else "274"
    there = world if kind == 3 else make_world(ephemeris, tmp_path_factory.mktemp("jwst"), JWST, station)
    by_file = fit(there, head=HEAD.replace(f"{SPACE}:", f'"{station}":'))
    assert by_file.found.material.observers.velocity_known.all()
    mine = np.flatnonzero(there.station == station)
    places = [[f"{x:.6f}" for x in there.state[k, :3]] for k in mine]
    stated = {int(k): {"pos1": x, "pos2": y, "pos3": z} for k, (x, y, z) in zip(mine, places)}
    without = HEAD.replace(f"  spacecraft: {{{SPACE}: {{kind: spk, file: craft.bsp}}}}\n", "")
    by_records = fit(there, change=stated, head=without)
    sigma = np.array([by_file.estimate.sigma(name) for name in STATE_NAMES])
    assert np.max(np.abs(by_file.state - by_records.state) / sigma) < 1e-4
    assert np.sum(np.linalg.solve(by_file.estimate.factor(STATE_NAMES), by_file.state - STATE) ** 2) < 22.5
    ignoring = fit(there, head=without)
    assert np.max(np.abs(ignoring.state - by_records.state) / sigma) > 100.0
