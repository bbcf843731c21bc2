"""Process noise of the asteroid: dense covariances of continuous white noise, Monte Carlo, and closed forms."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from nebosvod.engine.assembly import computed_psi
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.fitting import fit
from nebosvod.engine.montecarlo import repeat
from nebosvod.engine.quantity import known_partials
from nebosvod.errors import InputError
from nebosvod.mission import Mission, load_mission_text
from nebosvod.mission.reading.cost import estimate_cost
from nebosvod.observation import ProcessNoise, Reach
from nebosvod.pipeline import run
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES, PriorTable
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]
Setting = tuple[Scene, PriorTable, View]
NOISE = "  process_noise: {velocity: 20 mm/s, over: 30 d, intervals: 24, treatment: T}\n"
DENSITY = (2e-5) ** 2 / (30 * 86400.0)  # km^2/s^3
DAY = 86400.0
EXACT = "estimated", "fixed"


def made(minimal: Mission, treatment: str, epoch: str = "2028-03-20") -> Mission:
    """State, noise and process noise alone, so that the dense problem stays small."""
    text = minimal.text.replace(
        "telescopes:\n", NOISE.replace("treatment: T", f"treatment: {treatment}") + "telescopes:\n", 1
    )
    text = text.replace("reference_epoch: 2028-03-20", f"reference_epoch: {epoch}")
    text = text.replace("    bias: {sigma: 0.05 arcsec, treatment: estimated}\n", "")
    text = text.replace("    position: {sigma: 3 km, correlation: white, treatment: estimated}\n", "")
    for old in (
        "sigma: 2 m, treatment: estimated",
        "sigma: 2e6 kg, treatment: estimated",
        "sigma: 0.05, treatment: estimated",
    ):
        assert old in text
        text = text.replace(old, old.replace("estimated", "fixed"))
    return load_mission_text(text)


def inverse(matrix: Array) -> Array:
    unit = 1.0 / np.sqrt(np.diag(matrix))
    return np.asarray(np.linalg.solve(matrix * unit[:, None] * unit, np.eye(len(unit))) * unit[:, None] * unit)


def pulls(scene: Scene, times: Array, steps: int = 600) -> Array:
    """Factors (n, 6, 3 steps) of z(t) = Phi(t) int_0^t Phi(s)^-1 [0; I] w ds by midpoints on a fine grid."""
    low, high = min(0.0, times.min()), max(0.0, times.max())
    edges = np.linspace(low, high, steps + 1)
    middle, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    unit = np.array([1.0, 1.0, 1.0, 1e-6, 1e-6, 1e-6])
    Phi = scene.trajectory.at(middle).Phi / unit[:, None] * unit
    push = np.vstack([np.zeros((3, 3)), np.eye(3)]) / unit[:, None]
    back = np.linalg.solve(Phi, np.broadcast_to(push, (steps, 6, 3))) * unit[:, None]
    at = scene.trajectory.at(times).Phi
    out = np.zeros((len(times), 6, 3 * steps))
    for k, t in enumerate(times):
        weight = np.where((middle > 0.0) & (middle < t), 1.0, np.where((middle < 0.0) & (middle > t), -1.0, 0.0))
        columns = back * (weight * np.sqrt(DENSITY * width))[:, None, None]
        out[k] = at[k] @ columns.transpose(1, 0, 2).reshape(6, -1)
    return out


@pytest.mark.parametrize("epoch", ["2028-03-20", "2028-04-05"])
@pytest.mark.parametrize("treatment", ["estimated", "considered"])
def test_state_and_prediction_are_those_of_continuous_white_noise(
    treatment: str, epoch: str, minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    scene, priors, nominal = make_setting(made(minimal, treatment, epoch))
    found = fit(scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors, history=False).estimate
    seen = nominal.observation
    n = seen.t_s.size
    request = scene.mission.predictions[0]
    ahead = request.when - scene.epoch
    every = pulls(scene, np.append(seen.t_s, ahead))
    H = seen.H_x0.reshape(2 * n, 6)
    # the state at reception seen through H_x: what the walk does to each measurement
    Z = np.einsum("nij,njk->nik", seen.H_x, every[:n]).reshape(2 * n, -1)
    R = np.diag(np.tile((0.1 * np.pi / 648000.0) ** 2, 2 * n))
    weights = inverse(R + Z @ Z.T) if treatment == "estimated" else inverse(R)
    K = inverse(H.T @ weights @ H)
    k = K @ H.T @ weights
    error = np.hstack([k @ np.sqrt(R), k @ Z])  # of the state, by unit draws of noise and walk
    true = error @ error.T
    unit = np.sqrt(np.diag(true))
    assert found.covariance(STATE_NAMES) / unit / unit[:, None] == pytest.approx(true / unit / unit[:, None], abs=0.01)
    Phi = scene.trajectory.at(np.array([ahead])).Phi[0]
    if treatment == "estimated":  # the walk is smoothed too: z given the measurements left by the state
        gain = every[n] @ Z.T @ weights
        state = Phi @ error + gain @ (np.hstack([np.sqrt(R), Z]) - H @ error)
        state[:, 2 * n :] -= every[n]
    else:
        state = Phi @ error
        state[:, 2 * n :] -= every[n]
    asked = quantity(scene, scene.trajectory, request)
    sigma = found.predict(*known_partials(asked, found)).sigma
    assert sigma == pytest.approx(np.sqrt(np.sum(state[:3] ** 2, axis=1)), rel=0.02)
    share = found.shares["process noise"]
    assert np.max(np.diag(share)[:6] / np.diag(found.covariance(STATE_NAMES))) > 0.05


@pytest.mark.parametrize("treatment", ["estimated", "ignored"])
def test_drawn_truths_scatter_by_k_true(
    treatment: str, minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    scene, priors, nominal = make_setting(made(minimal, treatment))
    sample = repeat(scene, scene.mission.estimators[0], nominal, priors, 200, 3)
    assert sample.factors is None
    y = np.linalg.solve(sample.reference.factor(STATE_NAMES), sample.errors[:, :6].T)
    low, high = stats.chi2.ppf([0.001, 0.999], 1200)
    assert low < np.sum(y**2) < high


def test_a_walk_in_free_space_has_the_textbook_covariance() -> None:
    """Phi = [I, t I; 0, I]: velocity q t, position q t^3 / 3, less q D^3 / 12 in each interval."""
    nodes = np.linspace(0.0, 10.0 * DAY, 41)
    slope = np.zeros((41, 6, 3))
    slope[:, :3], slope[:, 3:] = -nodes[:, None, None] * np.eye(3), np.eye(3)
    integral = np.zeros((41, 6, 3))
    integral[:, :3] = -0.5 * nodes[:, None, None] ** 2 * np.eye(3)
    integral[:, 3:] = nodes[:, None, None] * np.eye(3)
    reach = Reach(nodes_s=nodes, integral=integral, slope=slope)
    edges = np.linspace(0.0, 10.0 * DAY, 11)
    noise = ProcessNoise(name="walk", telescopes=(), density_km2_s3=DENSITY, edges_s=edges, reach=reach)
    t = 10.0 * DAY
    Phi = np.eye(6)
    Phi[:3, 3:] = t * np.eye(3)
    B = Phi @ noise.moved_by(np.array([t]))[0]
    P = DENSITY / DAY * B @ B.T
    assert np.diag(P)[3:] == pytest.approx(DENSITY * t)
    assert np.diag(P)[:3] == pytest.approx(DENSITY * (t**3 / 3.0 - 10 * DAY**3 / 12.0))
    assert np.diag(P[:3, 3:]) == pytest.approx(DENSITY * t**2 / 2.0)


def test_a_run_blames_it_and_shows_no_parameter_of_each_interval(minimal: Mission) -> None:
    text = made(minimal, "estimated").text + "monte_carlo: {runs: 30}\n"
    summary = run(load_mission_text(text), seed=1).summary
    assert any(row["source"] == "process noise" and row["share_velocity"] > 0.01 for row in summary["budget"])
    assert not any("process" in name for name in summary["estimators"][0]["parameters"])
    drawn = summary["predictions"][0]["monte_carlo"]
    assert not drawn["misleads"]


@pytest.mark.parametrize("method", ["smoother", "hsieh_chen", "ekf", "iterated_ekf"])
def test_a_filter_knows_the_state_after_its_last_measurement_as_a_prediction_for_then_does(
    method: str, minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    """With what the accelerations have done to it: the prediction is held against dense algebra above."""
    text = made(minimal, "estimated").text.replace("at: 2028-04-29T00", "at: 2028-04-19T00")
    text += "prior: {sigma: {position: 300 km, velocity: 0.1 m/s}}\n"
    text += f"estimators: [{{name: batch, method: batch_qr}}, {{name: path, method: {method}}}]\n"
    scene, priors, nominal = make_setting(load_mission_text(text))
    psi = computed_psi(nominal)
    batch, path = (fit(scene, one, nominal, psi, priors).estimate for one in scene.mission.estimators)
    found = fit(scene, scene.mission.estimators[1], nominal, psi, priors).filtered
    assert found is not None
    asked = quantity(scene, scene.trajectory, scene.mission.predictions[0])
    sigma = batch.predict(*known_partials(asked, batch)).sigma
    for last in (found.now.factor[-1], found.smoothed.factor[-1]):
        assert np.linalg.norm(last, axis=1)[:3] == pytest.approx(sigma, rel=2e-3)
    without = batch.predict(asked.partials[:, :6], STATE_NAMES).sigma
    assert np.max(np.abs(without / sigma - 1.0)) > 0.01  # or the test could not tell
    assert path.solution is not None


def test_more_intervals_than_a_run_can_bear_are_refused_with_the_reason(minimal: Mission) -> None:
    """Three parameters each, solved densely: 200 intervals took minutes."""
    assert made(minimal, "estimated").object.process_noise is not None
    text = minimal.text.replace(
        "telescopes:\n", NOISE.replace("T}", "estimated}").replace("24", "101") + "telescopes:\n", 1
    )
    with pytest.raises(
        InputError, match=r"process_noise\.intervals: is out of range \(got 101; allowed 100 or less\); .*cube"
    ):
        load_mission_text(text)
    most = load_mission_text(text.replace("intervals: 101", "intervals: 100"))
    few = load_mission_text(text.replace("intervals: 101", "intervals: 10"))
    assert 10.0 < estimate_cost(most).time_s - estimate_cost(few).time_s < 100.0  # measured: 72 take 10 s
