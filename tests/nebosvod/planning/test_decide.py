"""`nebosvod plan --decide`: the future probability against the linear-Gaussian answer, fresh fits, and kept odds."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from scipy.stats import binom, norm

import nebosvod
from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris, ForceModel, propagate
from nebosvod.dynamics.impact import follow
from nebosvod.ephemerides.observers import observer
from nebosvod.estimation.accuracy.preposterior import Foreseen
from nebosvod.impacts.approaches import approaches
from nebosvod.impacts.flight import WIDER_KM, Course
from nebosvod.mission import load_mission_text
from nebosvod.observation import observe, residual
from nebosvod.orbits.conversion import balanced_factor
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.planning.coming import Watch, visit
from nebosvod.planning.decide import Decision, Outcome, Wanted, decide
from nebosvod.planning.decision import advice, said_chance, said_share
from nebosvod.planning.watches import watches
from nebosvod.report.decision_page import make_decision_page
from nebosvod.scene.instruments import telescopes
from nebosvod.scene.orbit import read_orbit
from nebosvod.timescale import Epoch
from nebosvod.units import ARCSEC

SCHEMA = json.loads((Path(nebosvod.__file__).parent / "planning" / "decision.schema.json").read_text("utf-8"))
IMPACT, EPOCH = Epoch.parse("2030-05-20T06:00:00 TDB"), Epoch.parse("2030-04-10T00:00:00 TDB")
UNTIL = Epoch.parse("2030-06-01 TDB")
DAY = 86400.0
PDC27 = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "impact" / "2026pdc27.epoch1.psv"
SIGMA = 4.0  # arcsec
LEVELS = (0.01, 0.1, 0.5, 0.9)
TIMES = {"first": EPOCH + 4 * DAY, "last": EPOCH + 10 * DAY, "step_s": 3 * DAY, "exposures": 3, "spacing_s": 600.0}


def made_up(bodies: Ephemeris) -> UncertainOrbit:
    """An orbit that passes the Earth's centre at 3,000 km after forty days, 44,000 km long and 50 km wide there."""
    earth, sun = (bodies.state_km_km_s(name, IMPACT, np.array([-DAY]))[0] for name in ("earth", "sun"))
    v = 12.0 * np.array([0.6, -0.7, 0.387]) / np.linalg.norm([0.6, -0.7, 0.387])
    side = np.cross(v, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    near = earth - sun + np.concatenate([3000.0 * side - DAY * v, v])
    before = IMPACT + (-DAY)
    start = propagate(near, before, [EPOCH - before], ForceModel(ephemeris=bodies), False, margin_s=0.0)
    covariance = np.diag([30.0**2] * 3 + [1e-10] * 3)
    covariance[3:, 3:] += np.outer(side, side) * 1.2e-2**2
    return UncertainOrbit(name="made up", epoch=EPOCH, state=start.state[0], factor=np.linalg.cholesky(covariance))


@pytest.fixture(scope="module")
def bodies() -> Ephemeris:
    return Ephemeris.load()


@pytest.fixture(scope="module")
def orbit(bodies: Ephemeris) -> UncertainOrbit:
    return made_up(bodies)


def geocentre(sigma_arcsec: float) -> Watch:
    return Watch(telescope=replace(observer("500"), name="500", sigma_rad=sigma_arcsec * ARCSEC), question=None)


@pytest.fixture(scope="module")
def decision(orbit: UncertainOrbit, bodies: Ephemeris) -> Decision:
    wanted = Wanted(**TIMES, until=UNTIL, bodies=("earth",), draws=10_000, truths=2500, flown=1000)
    return decide(orbit, [geocentre(SIGMA)], wanted, bodies)


def linear_quantiles(orbit: UncertainOrbit, bodies: Ephemeris, t_s: np.ndarray) -> list[float]:
    """Quantiles of P by covariances alone: of the target point the mean moves by what its variance loses."""
    near = next(one for one in approaches(orbit, EPOCH, UNTIL, 0.1, bodies).found if one.body == "earth")
    assert near.plane is not None
    K = orbit.factor @ orbit.factor.T
    path = follow(orbit.state, EPOCH, (-DAY, t_s[-1]), t_s[-1], orbit.forces(bodies), True)
    H = observe(path, geocentre(SIGMA).telescope, t_s, bodies).H.reshape(2 * len(t_s), 6)
    S = H @ K @ H.T + np.eye(2 * len(t_s)) * (SIGMA * ARCSEC) ** 2
    T = near.plane.partials_state
    now, learnt = T @ K @ T.T, T @ K @ H.T @ np.linalg.solve(S, H @ K @ T.T)
    axis = np.linalg.eigh(now)[1][:, 1]  # it is 50 km wide and as good as a line
    along, across = float(near.plane.coordinates_km @ axis), near.plane.coordinates_km @ [-axis[1], axis[0]]
    half = np.sqrt(near.plane.capture_radius_km**2 - across**2)
    moved, left = np.sqrt(axis @ learnt @ axis), np.sqrt(axis @ (now - learnt) @ axis)
    mean = along + moved * norm.ppf((np.arange(100_000) + 0.5) / 100_000)
    return [float(q) for q in np.quantile(norm.cdf((half - mean) / left) - norm.cdf((-half - mean) / left), LEVELS)]


def test_where_linear_is_right_the_distribution_is_the_linear_one(
    decision: Decision, orbit: UncertainOrbit, bodies: Ephemeris
) -> None:
    assert [one.visit.telescope for one in decision.outcomes] == ["500"] * 3
    assert not decision.flown
    assert decision.misjudged < 0.01
    spread = 0.0
    for one in decision.outcomes:
        wanted = linear_quantiles(orbit, bodies, one.visit.t_s)
        assert [one.quantiles[level] for level in LEVELS] == pytest.approx(wanted, abs=0.02)
        spread = max(spread, wanted[-1] - wanted[0])
    assert spread > 0.3  # a visit that changes nothing would agree with anything


def test_thresholds_are_a_tenth_and_the_midpoint_unless_said(decision: Decision) -> None:
    assert decision.below == pytest.approx(0.1 * decision.probability)
    assert decision.above == pytest.approx(0.5 + 0.5 * decision.probability)
    last = decision.outcomes[-1]
    assert last.chance_below(decision.below) == np.mean(last.foreseen.probability < decision.below)
    assert last.chance_below(0.0) == 0.0
    assert last.chance_above(decision.probability) > 0.1


def test_errors_shared_with_past_measurements_are_those_of_the_joint_covariance(
    minimal_folder: Path, bodies: Ephemeris
) -> None:
    """Covariance of coming measurements by the stored estimate of orbit and biases together, in dense algebra."""
    orbit = read_orbit(minimal_folder)
    assert {"bias ahead RA*", "bias ahead Dec"} <= set(orbit.shared)
    mission = load_mission_text(json.loads((minimal_folder / "manifest.json").read_text("utf-8"))["mission"]["text"])
    watch = Watch(telescope=telescopes(mission)[0], question=mission)
    t_s = 40.0 * DAY + 600.0 * np.arange(3)
    path = follow(orbit.state, orbit.epoch, (-DAY, t_s[-1]), t_s[-1], orbit.forces(bodies), True)
    found = visit(watch, path, t_s, orbit, bodies)
    seen = observe(path, watch.telescope, t_s, bodies)
    with np.load(minimal_folder / "arrays.npz") as arrays:
        names, S = [str(name) for name in arrays["names_batch"]], arrays["factor_batch"]
    H = np.zeros((6, len(names)))
    for k, name in enumerate(orbit.names):
        H[:, names.index(name)] = seen.H[:, :, k].reshape(6)
    for k, name in enumerate(("bias ahead RA*", "bias ahead Dec")):
        H[k::2, names.index(name)] = 1.0
    noise = np.zeros((6, 6))
    for k in range(3):
        at = slice(2 * k, 2 * k + 2)
        noise[at, at] = (0.1 * ARCSEC) ** 2 * np.eye(2) + 9.0 * seen.H_z[k] @ seen.H_z[k].T
    wanted = H @ S @ S.T @ H.T + noise
    members = seen.H.reshape(6, -1) @ orbit.factor + found.by_draws
    unit = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    np.testing.assert_allclose((members @ members.T + found.noise) / unit, wanted / unit, atol=1e-7)
    # errors drawn anew would not: what the estimate knows of the bias is lost
    anew = visit(watch, path, t_s, replace(orbit, shared={}), bodies)
    plain = seen.H.reshape(6, -1) @ orbit.factor
    assert abs((plain @ plain.T + anew.noise - wanted) / unit).max() > 0.01


MISSION = """schema_version: 1
name: decide
reference_epoch: 2030-04-10T00:00:00 TDB
object:
  name: made up
  orbit: {{kind: state, frame: icrf, epoch: 2030-04-10T00:00:00 TDB, position: {position}, velocity: {velocity}}}
prior:
  names: [x, y, z, vx, vy, vz]
  covariance: {covariance}
telescopes:
  - name: companion
    orbit: {{kind: heliocentric, lead: 10 deg}}
    noise: {{sigma: 1 arcsec}}
    bias: {{sigma: 0.5 arcsec, treatment: considered}}
    position: {{sigma: 100 km, correlation: gauss_markov, time: 5 d, treatment: considered}}
  - {{name: blind, like: companion, exclusion: {{sun: 179 deg}}}}
schedule: [{{start: 2030-04-14T00:00:00 TDB, end: 2030-04-20T00:00:00 TDB, cadence: 1 d}}]
"""


@pytest.fixture(scope="module")
def mission(orbit: UncertainOrbit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("decide") / "decide.yaml"
    halves = zip(np.split(orbit.state, 2), ("km", "km/s"))
    state = [[f"{value!r} {unit}" for value in part.tolist()] for part, unit in halves]
    text = MISSION.format(position=state[0], velocity=state[1], covariance=orbit.covariance.tolist())
    path.write_text(text.replace("'", ""))
    return path


def test_the_command_answers_in_words_json_and_a_page(
    mission: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "decide.html"
    asked = ["plan", str(mission), "--decide", "--until", "2030-06-01", "--draws", "1200", "--truths", "200"]
    asked += ["--bodies", "earth", "--step", "3 d", "--above", "0.5"]
    assert main([*asked, "-o", str(tmp_path / "decide.json"), "--page", str(page)]) == 0
    said = capsys.readouterr().out
    found: dict[str, Any] = json.loads((tmp_path / "decide.json").read_text("utf-8"))
    jsonschema.validate(found, SCHEMA)
    assert [row["epoch_tdb"][:10] for row in found["visits"]] == ["2030-04-14", "2030-04-17", "2030-04-20"]
    assert {row["telescope"] for row in found["visits"]} == {"companion"}
    assert found["never_visible"] == ["blind"]
    assert found["above"] == 0.5
    assert found["n_hits"] == pytest.approx(1200 * found["probability"])
    assert advice(found) in said.replace("\n", " ")
    assert "blind never sees it" in said
    assert "telescope position companion: is taken as drawn anew" in said
    text = page.read_text("utf-8")
    assert text == make_decision_page(found)
    assert advice(found)[1:] in text
    assert "://" not in text.replace("http://www.w3.org/2000/svg", "")


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["--decide"], 2, "--until: is needed with --decide"),
        (["--until", "2030-06-01"], 2, "--until: goes with --decide"),
        (["--decide", "--until", "2030-06-01", "--visits", "3"], 2, "--visits: goes without --decide"),
        (["--decide", "--until", "soon"], 2, "--until: "),
        (["--decide", "--until", "2030-04-12"], 2, "and before --until"),
        (["--decide", "--until", "2030-06-01", "--telescope", "F51", "--from", "2030-04-14"], 2, "give --sigma"),
        (["--decide", "--until", "2030-06-01", "-t", "F51", "--sigma", "1 arcsec"], 2, "--from: is needed"),
        (
            ["--decide", "--until", "2030-06-01", "-t", "nowhere", "--sigma", "1 arcsec"],
            2,
            "--telescope: an observer is",
        ),
        (["--decide", "--until", "2030-06-01", "--sigma", "1 km"], 2, "--sigma: "),
        (["--decide", "--until", "2030-06-01", "--exposures", "3"], 2, "--spacing: goes with --exposures"),
        (["--decide", "--until", "2030-06-01", "--below", "1.5"], 2, "--below: 1.5 is no probability"),
        (["--decide", "--until", "2030-06-01", "--below", "0.5", "--above", "0.2"], 2, "is not below --above"),
        (["--decide", "--until", "2030-06-01", "--draws", "3"], 2, "--draws: 3 (allowed: 500 to"),
        (["--decide", "--until", "2030-06-01", "--step", "1 s"], 2, "--step: "),
        (["--decide", "--until", "2030-06-01", "--bodies", "vulcan"], 2, '"vulcan" is no target'),
        (["--decide", "--until", "2030-06-01", "--from", "2030-05-25", "--to", "2030-05-26"], 2, "hits earth"),
        (["--decide", "--until", "2030-06-01", "-t", "blind", "-t", "blind"], 2, "is given twice"),
        (["--decide", "--until", "2030-06-01", "-t", "blind"], 1, "no telescope sees it at a candidate time"),
        (["--decide", "--until", "2030-06-01", "--bodies", "mars"], 1, "0 of 600 drawn orbits hit mars"),
    ],
)
def test_what_cannot_be_answered_is_said(
    options: list[str], code: int, said: str, mission: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = ["--draws", "600"] if "--decide" in options and "--draws" not in options else []
    assert main(["plan", str(mission), *options, *more]) == code
    assert said in capsys.readouterr().err


def test_truths_that_end_at_a_probability_hit_that_often(decision: Decision) -> None:
    """2,500 truths of each visit, flown and observed, inside the 99 % binomial band of each fifth."""
    for one in decision.outcomes:
        P, hits = one.foreseen.probability, one.hits
        order = np.argsort(P)
        for part in np.array_split(order, 5):
            low, high = binom.ppf([0.0005, 0.9995], len(part), np.clip(P[part].mean(), 1e-4, 1.0 - 1e-4))
            assert low - 1 <= np.count_nonzero(hits[part]) <= high + 1
        assert np.count_nonzero(hits) == pytest.approx(len(hits) * decision.probability, rel=0.15)


def bent(bodies: Ephemeris) -> UncertainOrbit:
    """An orbit known along its path to a million km after 23 months, where it bends; the estimate is 1.5 sigma off."""
    earth, sun = (bodies.state_km_km_s(name, IMPACT, np.array([-DAY]))[0] for name in ("earth", "sun"))
    v = 8.0 * np.array([0.6, -0.7, 0.387]) / np.linalg.norm([0.6, -0.7, 0.387])
    before, epoch = IMPACT + (-DAY), IMPACT + (-700.0 * DAY)
    near = earth - sun + np.concatenate([-DAY * v, v])
    start = propagate(near, before, [epoch - before], ForceModel(ephemeris=bodies), False, margin_s=0.0).state[0]
    along = start[3:] / np.linalg.norm(start[3:])
    sigma = 4e-3
    covariance = np.diag([30.0**2] * 3 + [1e-12] * 3)
    covariance[3:, 3:] += np.outer(along, along) * sigma**2
    moved = start - np.concatenate([np.zeros(3), 1.5 * sigma * along])
    return UncertainOrbit(name="bent", epoch=epoch, state=moved, factor=np.linalg.cholesky(covariance))


def fresh_fit(orbit: UncertainOrbit, t_s: np.ndarray, rng: np.random.Generator, bodies: Ephemeris) -> UncertainOrbit:
    """A truth drawn and observed, and fitted from the estimate on with what was known before."""
    watch, forces = geocentre(SIGMA).telescope, orbit.forces(bodies)

    def observed(state: np.ndarray) -> Any:
        path = follow(state, orbit.epoch, (-DAY, t_s[-1]), t_s[-1], forces, True)
        return observe(path, watch, t_s, bodies)

    truth = orbit.state + orbit.factor @ rng.standard_normal(6)
    seen = observed(truth)
    psi = seen.psi + SIGMA * ARCSEC * rng.standard_normal(seen.psi.shape) / np.cos(seen.psi[:, 1:]) ** [1.0, 0.0]
    u = np.zeros(6)
    for _ in range(5):
        now = observed(orbit.state + orbit.factor @ u)
        H = now.H_x0.reshape(-1, 6) @ orbit.factor / (SIGMA * ARCSEC)
        v = residual(psi, now.psi).ravel() / (SIGMA * ARCSEC)
        u = u + np.linalg.lstsq(np.vstack([np.eye(6), H]), np.concatenate([-u, v]))[0]
    R = np.linalg.qr(np.vstack([np.eye(6), H]), mode="r")
    factor = balanced_factor(orbit.factor @ np.linalg.solve(R, np.eye(6)))
    return UncertainOrbit(name="fresh", epoch=orbit.epoch, state=orbit.state + orbit.factor @ u, factor=factor)


@pytest.mark.long
def test_where_linear_is_wrong_the_distribution_is_that_of_fresh_fits(bodies: Ephemeris) -> None:
    """The path bends by a radius of the Earth: its target plane says that it cannot hit, and one in 250 orbits does."""
    orbit = bent(bodies)
    until = IMPACT + 20.0 * DAY
    first = orbit.epoch + 150.0 * DAY
    wanted = Wanted(
        first=first, last=first, step_s=DAY, exposures=3, spacing_s=600.0, until=until, bodies=("earth",),
        draws=60_000, truths=10_000,
    )  # fmt: skip
    found = decide(orbit, [geocentre(SIGMA)], wanted, bodies).outcomes[0]
    fits, rng = 1500, np.random.default_rng(8)
    each = np.zeros(fits)
    for k in range(fits):
        one = fresh_fit(orbit, found.visit.t_s, rng, bodies)
        near = [a for a in approaches(one, IMPACT + (-20.0 * DAY), until, 0.1, bodies).found if a.body == "earth"]
        each[k] = max((a.probability or 0.0 for a in near), default=0.0)
    linear = approaches(orbit, IMPACT + (-20.0 * DAY), until, 0.1, bodies).found
    assert all((one.probability or 0.0) < 1e-9 for one in linear if one.body == "earth")
    ours = found.foreseen.probability
    for level in (0.5, 0.9, 0.95, 0.97, 0.98, 0.99):
        assert np.quantile(ours, level) == pytest.approx(np.quantile(each, level), abs=0.02)
    for threshold in (1e-3, 0.01, 0.03, 0.1):
        share = float(np.mean(each > threshold))
        assert np.mean(ours > threshold) == pytest.approx(share, abs=3.0 * np.sqrt(share / fits))


@pytest.mark.long
def test_where_linear_is_wrong_truths_that_end_at_a_probability_hit_that_often(bodies: Ephemeris) -> None:
    """10,000 truths of the bent orbit, each flown to its fate, inside the 99 % binomial band in every class of P."""
    orbit, until = bent(bodies), IMPACT + 20.0 * DAY
    first = orbit.epoch + 150.0 * DAY
    wanted = Wanted(
        first=first, last=first, step_s=DAY, exposures=3, spacing_s=600.0, until=until, bodies=("earth",),
        draws=60_000, truths=10_000,
    )  # fmt: skip
    foreseen = decide(orbit, [geocentre(SIGMA)], wanted, bodies).outcomes[0].foreseen
    u = np.random.default_rng(np.random.SeedSequence(wanted.seed)).standard_normal((wanted.draws, 6))
    course = Course(orbit=orbit, ephemeris=bodies, last=until, bodies=("earth",), within_km=WIDER_KM)
    hits = course.fly(u[foreseen.truth] @ orbit.factor.T).body == "earth"
    assert np.count_nonzero(hits) > 20
    P, edges = foreseen.probability, [-1.0, 1e-4, 1e-3, 0.01, 0.05, 0.2, 1.0]
    for low, high in pairwise(edges):
        some = (low < P) & (high >= P)
        if some.any():
            least, most = binom.ppf([0.005, 0.995], np.count_nonzero(some), P[some].mean())
            assert least <= np.count_nonzero(hits[some]) <= most, (low, high)


@pytest.mark.skipif(not PDC27.is_file(), reason="the folder of reference data is not here")
def test_a_station_keeps_the_bias_that_its_fit_has_considered(tmp_path: Path, bodies: Ephemeris) -> None:
    """The bias is known no better after the fit, and with the orbit as its part of the budget says."""
    lines = PDC27.read_text("utf-8").split("\n")
    (tmp_path / "few.psv").write_text("\n".join([*lines[:2], *lines[10:14], *lines[-9:]]), encoding="utf-8")
    bias = "uncertainty: [{stations: all, bias: {sigma: 0.1 arcsec, treatment: considered}}]"
    text = f"schema_version: 1\nname: few\nfit:\n  observations: [few.psv]\n  {bias}\n"
    (tmp_path / "few.yaml").write_text(text, encoding="utf-8")
    assert main(["fit", str(tmp_path / "few.yaml"), "-o", str(tmp_path / "fit")]) == 0
    orbit = read_orbit(tmp_path / "fit")
    assert list(orbit.shared) == ["bias 500 RA*", "bias 500 Dec"]
    rows, sigma = np.array(list(orbit.shared.values())), 0.1 * ARCSEC
    np.testing.assert_allclose(rows @ rows.T, sigma**2 * np.eye(2), atol=1e-6 * sigma**2)
    together, part = orbit.factor @ rows[:, :6].T / sigma, orbit.sources["bias 500"]
    unit = np.outer(orbit.sigma, orbit.sigma)
    np.testing.assert_allclose(together @ together.T / unit, part @ part.T / unit, atol=1e-6)
    (watch,) = watches(str(tmp_path / "fit"), orbit, ["500"], sigma)
    t_s = 60.0 * DAY + 600.0 * np.arange(2)
    path = follow(orbit.state, orbit.epoch, (-DAY, t_s[-1]), t_s[-1], orbit.forces(bodies), True)
    found = visit(watch, path, t_s, orbit, bodies)
    np.testing.assert_allclose(found.by_draws, np.vstack([rows[:, :6]] * 2), atol=1e-6 * sigma)
    whole = found.noise + found.by_draws @ found.by_draws.T  # what both exposures have in common is the bias
    np.testing.assert_allclose(whole[:2, 2:] / sigma**2, np.eye(2), atol=1e-6)


def test_advice_names_no_chance_of_0_and_no_span_from_nothing_to_nothing() -> None:
    """Of a Moon that a visit all but clears: a hundred truths of which none is above is no 0 %."""
    row = {
        "telescope": "F51", "epoch_utc": "2028-11-20T00:00:00Z", "quantiles": {"0.1": 0.0, "0.9": 0.0},
        "bound": 3e-4, "chance_below": 1.0, "chance_above": 0.0,
    }  # fmt: skip
    said = advice({"visits": [row], "best": 0, "below": 0.0041, "above": 0.52, "probability": 0.041})
    assert "with more than 99 % and rises above 0.52 with less than 1 %; it will be below 0.0003 (80 %)" in said


def test_a_future_probability_of_no_hit_is_told_as_the_bound_it_is(decision: Decision) -> None:
    """Of 600 orbits that agree with a visit none hits: 0.05^(1/600) is what is left, and never ~0."""
    one = decision.outcomes[0]
    seen = Foreseen(
        truth=np.arange(4), probability=np.array([0.0, 0.0, 0.3, 0.4]), effective=np.array([200.0, 1000.0, 9.0, 9.0]),
        redrawn=np.zeros(4, dtype=np.bool_),
    )  # fmt: skip
    some = Outcome(visit=one.visit, foreseen=seen, hits=np.zeros(4, dtype=np.bool_))
    assert some.bound == pytest.approx(1.0 - 0.05 ** (1.0 / 600.0))
    assert said_chance(some.quantiles[0.01], some.bound) == "< 0.005"
    assert said_chance(0.24, some.bound) == "0.24"
    assert said_chance(0.99996, some.bound) == "0.99996"
    hit = replace(some, foreseen=replace(seen, probability=np.full(4, 0.2)))
    assert hit.bound is None


def test_shares_of_a_few_hundred_truths_are_no_certainties() -> None:
    assert [said_share(chance) for chance in (0.0, 1 / 300, 0.35, 0.9967, 1.0)] == [
        "< 1 %",
        "< 1 %",
        "35 %",
        "> 99 %",
        "> 99 %",
    ]
