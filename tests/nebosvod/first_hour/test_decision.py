"""What one more observation would do: its errors are those of its station, and answers to files with one more line.

Against dense covariances with every nuisance, on orbits by Runge and Kutta; of the files truths and their nuisances are
drawn by importance sampling, and `nebosvod alert` reads them as any other.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import ks_2samp

from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris
from nebosvod.ephemerides.observers import observer
from nebosvod.first_hour.alert import Alert, Question, alert
from nebosvod.first_hour.candidate import Candidate
from nebosvod.first_hour.conditional import Conditional
from nebosvod.first_hour.decision import decide
from nebosvod.first_hour.observed import prepared, tracklet_of, with_shared
from nebosvod.first_hour.sight import Flights
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.observation import Telescope
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.pipeline import mission_of, objects

sys.path.insert(0, str(Path(__file__).resolve().parent))
import hour_oracle as oracle  # type: ignore[import-not-found]
from hour_cases import ARCSEC, CASES, Case, Made, columns_of, made, spacecraft  # type: ignore[import-not-found]

Array = npt.NDArray[np.float64]
CASE = CASES[3]  # one station, a bias of 0.2 arcsec, a clock of 1 s
LATER_S = 7200.0


@pytest.fixture(scope="module")
def bodies() -> Ephemeris:
    return Ephemeris.load()


@pytest.fixture(scope="module")
def one(bodies: Ephemeris) -> Made:
    return made(CASE, bodies)


def asked(one: Made, name: str) -> Candidate:
    """A telescope that may look again."""
    return Candidate.of(one.tracklet, Telescope(name=name, spacecraft=spacecraft(name), sigma_rad=1.0))


def dense(longer: Tracklet, case: Case, sigma: Array, bodies: Ephemeris) -> Any:
    """The oracle's problem of a longer tracklet, whose columns it finds itself."""
    exposures = replace(longer.exposures, sigma_rad=np.tile(sigma[:, None], (1, 2)))
    return oracle.Problem(
        bodies=oracle.Bodies.of(bodies, longer.epoch, exposures.t_s, 300.0), exposures=exposures,
        reference=longer.reference, observed=longer.observed, case=case, columns=columns_of(case, exposures),
        sigma=sigma, low=np.log(1e-4), high=np.log(5.0),
    )  # fmt: skip


@pytest.mark.parametrize("name", ["F51", "W84"])
def test_a_station_errs_as_before_and_another_one_has_a_bias_and_a_clock_of_its_own(
    name: str, one: Made, bodies: Ephemeris
) -> None:
    """Directions of a truth with its nuisances, and densities of orbits with the errors marginalised."""
    candidate, tracklet = asked(one, name), one.tracklet
    t_s = np.array([float(tracklet.exposures.t_s.max()) + LATER_S])
    truth = Conditional(tracklet).states(one.truth[None])
    wrong = np.array([[0.1 * ARCSEC, -0.2 * ARCSEC, 1.3]])
    new = np.array([[0.5, -1.0, 2.0]])  # of another station: 0.1 and -0.2 arcsec, 2 s
    seen, psi = candidate.observed(
        t_s, Flights(tracklet, t_s).fly(truth), candidate.errors(wrong, new), np.zeros((1, 2))
    )
    longer = candidate.longer(seen, psi[0, 0])
    case = CASE if name == "F51" else replace(CASE, observers=("F51", "W84"))
    sigma = np.append(np.full(len(tracklet), CASE.sigma_arcsec), CASE.sigma_arcsec if name == "F51" else 0.5) * ARCSEC
    problem = dense(longer, case, sigma, bodies)
    x = Conditional(longer).coordinates(Flights(tracklet, np.array([longer.epoch - tracklet.epoch])).fly(truth)[:, 0])
    clean, rate, _ = oracle.directions(problem.bodies, problem.exposures, longer.reference, problem.frame, x)
    away = ((psi[0, 0] - clean[0, -1] + np.pi) % (2.0 * np.pi) - np.pi) * np.array([np.cos(clean[0, -1, 1]), 1.0])
    bias, clock = (wrong[0, :2], 1.3) if name == "F51" else (np.array([0.1, -0.2]) * ARCSEC, 2.0)
    np.testing.assert_allclose(away, bias + rate[0, -1] * clock, atol=0.01 * ARCSEC)

    near = x + np.linspace(-1.0, 1.0, 7)[:, None] * np.array([0.003, 0.05, 0.0, 0.0, 0.0, 0.0])
    nodes = Conditional(longer).solve(near, 2)
    a, factor = problem.attributable(near[:, :2], nodes.coordinates[:, 2:])
    judge = problem.log_target(np.hstack([near[:, :2], a])) + np.log(np.abs(np.linalg.det(factor))) - near[:, 0]
    ours = nodes.log_spread - 0.5 * nodes.chi2
    assert np.ptp(judge) > 1.0
    np.testing.assert_allclose(ours - ours[3], judge - judge[3], atol=0.05)


LA = """\
     K18L00A tC2018 06 02.34329516 11 10.342-11 19 34.92               V~2i5UG96
     K18L00A tC2018 06 02.34850816 10 59.352-11 20 21.37         18.2 GV~2i5UG96
     K18L00A tC2018 06 02.35372316 10 48.154-11 21 08.95         18.3 GV~2i5UG96
     K18L00A tC2018 06 02.35894416 10 36.604-11 21 57.30         18.0 GV~2i5UG96
"""
HOURS = 3.0  # after the last, on a hundred thousandth of a day
TRUTHS = 40


@pytest.mark.long
def test_outcomes_are_those_of_fresh_files_with_one_more_line(
    tmp_path: Path, bodies: Ephemeris, capsys: pytest.CaptureFixture[str]
) -> None:
    """2018 LA after four records, one more three hours later: the law of P then, and the chance to settle it.

    By 198 and 200 truths it was 0.783 +- 0.029 and 0.825 +- 0.027, Kolmogorov and Smirnov's distance 0.07.
    """
    (tmp_path / "la.obs80").write_text(LA)
    mission = mission_of([str(tmp_path / "la.obs80")])
    (records,) = objects(mission, split=False)
    shared = with_shared(records, mission)
    tracklet = tracklet_of(prepared(records, shared, bodies), records, shared)
    now = alert(tracklet, Question())
    (ours,) = decide(now, [observer("G96")], np.array([3600.0 * HOURS]), lambda line: None, TRUTHS)
    fresh = []
    for line in fifth_lines(tracklet, now, bodies):
        (tmp_path / "five.obs80").write_text(LA + line)
        assert main(["alert", str(tmp_path / "five.obs80"), "--hours", "1", "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["rejected"] == []
        fresh.append(found["probability"] or 0.0)
    beyond = np.mean([(p < ours.low) or (p > ours.high) for p in fresh])
    error = np.sqrt(2.0 * 0.2 * 0.8 / TRUTHS)
    assert abs(beyond - ours.settles) < 3.0 * error
    floor = 3e-3  # below, a probability is a bound
    assert ks_2samp(np.maximum(fresh, floor), np.maximum(ours.outcomes, floor)).pvalue > 1e-3


def fifth_lines(tracklet: Tracklet, now: Alert, bodies: Ephemeris) -> list[str]:
    """Records of truths drawn by importance sampling, seen with the bias and clock that the first four leave open."""
    rng, site = np.random.default_rng(11), observer("G96").spacecraft
    low, high = now.question.region.ranges(tracklet)
    exposures, columns = tracklet.exposures, tracklet.columns
    problem = oracle.Problem(
        bodies=oracle.Bodies.of(bodies, tracklet.epoch, exposures.t_s, 60.0), exposures=exposures,
        reference=tracklet.reference, observed=tracklet.observed, case=None, columns=columns,
        sigma=float(exposures.sigma_rad[0, 0]), low=low, high=high,
    )  # fmt: skip
    drawn = oracle.sample_about(problem, now.grid, 4000, rng)
    assert drawn.effective > 2000.0
    x = drawn.x[rng.choice(len(drawn.w), TRUTHS, p=drawn.w)]
    u = nuisances(problem, x, rng)
    t_s = np.array([float(exposures.t_s.max()) + 3600.0 * HOURS])
    seen = Exposures.at(tracklet.epoch, t_s, site.state_km_km_s(bodies, tracklet.epoch, t_s), bodies)
    both = replace(
        exposures,
        **{name: np.concatenate([getattr(exposures, name), getattr(seen, name)]) for name in PLACES},
    )
    flown = oracle.Bodies.of(bodies, tracklet.epoch, both.t_s, 30.0)
    psi, rate, _ = oracle.directions(flown, both, tracklet.reference, problem.frame, x)
    away = u[:, :2] + rate[:, -1] * u[:, 2:] + problem.sigma * rng.standard_normal((TRUTHS, 2))
    psi = psi[:, -1] + away / np.stack([np.cos(psi[:, -1, 1]), np.ones(TRUTHS)], axis=1)
    return [_line(np.degrees(one)) for one in psi]


PLACES = ("t_s", "observer", "sun", "sun_pull", "sigma_rad", "correlation", "timing_sigma_s")


def nuisances(problem: Any, x: Array, rng: np.random.Generator) -> Array:
    """Bias and clock (m, 3) drawn of what residuals of orbits (m, 6) leave: u | v is normal."""
    v, rate, psi, far = problem.residual(x)
    columns = problem.columns
    C = oracle.covariance(None, columns, far, rate, psi, problem.sigma)
    V = np.diag(1.0 / np.diag(columns.information) ** 2)
    drawn = np.empty((len(x), len(V)))
    for k in range(len(x)):
        H = (columns.bias + rate[k][..., None] * columns.clock[:, None]).reshape(-1, len(V))
        gain = np.linalg.solve(C[k], H @ V).T
        S = np.linalg.cholesky(V - gain @ H @ V)
        drawn[k] = gain @ v[k] + S @ rng.standard_normal(len(V))
    return drawn


def _line(psi_deg: Array) -> str:
    """One line of the MPC's eighty columns, 2018-06-02 11:36:52.76 UTC, G96."""
    hours, degrees = psi_deg[0] % 360.0 / 15.0, abs(psi_deg[1])
    ra = f"{int(hours):02d} {int(hours * 60.0 % 60.0):02d} {hours * 3600.0 % 60.0:06.3f}"
    dec = f"{int(degrees):02d} {int(degrees * 60.0 % 60.0):02d} {degrees * 3600.0 % 60.0:05.2f}"
    sign = "-" if psi_deg[1] < 0.0 else "+"
    return f"     K18L00A  C2018 06 02.483944{ra}{sign}{dec}         18.0 GV~2i5UG96\n"
