"""Considered and Schmidt filters and audits: against batches, an independent formula, and NASA's baselines."""

import json
from pathlib import Path

import numpy as np
import pytest

from nebosvod.estimation import Block, LinearProblem, Prior
from nebosvod.estimation.filters import consider
from nebosvod.estimation.filters.consider import Audit, ConsiderBelief
from nebosvod.estimation.solvers import batch

DATA = Path(__file__).resolve().parents[4] / "shared" / "data" / "filters" / "odtbx_cases_1_2.json"


def setup(seed, n=15, s=3, r=2, p=2):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, p, s)), rng.normal(size=(n, p, r)), np.diag([0.5, 1.5]), 2.0 * np.eye(s), np.eye(r)


def run(gain, H_x, H_c, R, P0, S, y=None):
    belief = ConsiderBelief.start(np.zeros(len(P0)), P0, S)
    for k in range(len(H_x)):
        residual = np.zeros(2) if y is None else y[k] - H_x[k] @ belief.mean
        belief, _ = consider.update(belief, residual, H_x[k], H_c[k], R, gain)
    return belief


def test_the_considered_filter_equals_the_batch_consider_covariance():
    for seed in range(5):
        H_x, H_c, R, P0, S = setup(seed)
        belief = run("considered", H_x, H_c, R, P0, S)
        names, nuisance = ("a", "b", "c"), ("d", "e")
        problem = LinearProblem(
            residual=np.zeros(H_x.shape[:2]),
            R=R,
            blocks=(
                Block(name="x", names=names, H=H_x),
                Block(name="c", names=nuisance, H=H_c, treatment="considered"),
            ),
            priors=(Prior(name="x", names=names, covariance=P0), Prior(name="c", names=nuisance, covariance=S)),
        )
        found = batch.solve(problem)
        np.testing.assert_allclose(belief.P, found.K_true, atol=1e-13)
        np.testing.assert_allclose(belief.P_formal, found.K_formal, atol=1e-14)
        cross = found.covariance((*names, *nuisance))[:3, 3:]
        np.testing.assert_allclose(belief.C, cross, atol=1e-13)


def test_the_schmidt_gain_is_the_best_of_each_step_and_honest():
    """Sample covariance of Schmidt's error; and no other gain does better at a single step."""
    H_x, H_c, R, P0, S = setup(3)
    belief = run("schmidt", H_x, H_c, R, P0, S)
    rng = np.random.default_rng(9)
    runs = 4000
    x = np.linalg.cholesky(P0) @ rng.normal(size=(3, runs))
    c = rng.normal(size=(2, runs))
    current, mean = ConsiderBelief.start(np.zeros(3), P0, S), np.zeros((3, runs))
    for k in range(len(H_x)):
        y = H_x[k] @ x + H_c[k] @ c + np.sqrt(R) @ rng.normal(size=(2, runs))
        current, K = consider.update(current, np.zeros(2), H_x[k], H_c[k], R, "schmidt")
        mean = mean + K @ (y - H_x[k] @ mean)
    error = np.linalg.solve(np.linalg.cholesky(belief.P), mean - x)
    assert np.mean(error**2) == pytest.approx(1.0, abs=2.58 * np.sqrt(2 / (3 * runs)) * 1.2)
    one_step, K = consider.update(ConsiderBelief.start(np.zeros(3), P0, S), np.zeros(2), H_x[0], H_c[0], R)
    for _ in range(20):
        other = K + 0.05 * rng.normal(size=K.shape)
        keep = np.eye(3) - other @ H_x[0]
        worse = keep @ P0 @ keep.T + other @ (H_c[0] @ S @ H_c[0].T + R) @ other.T
        assert np.trace(worse) > np.trace(one_step.P)


def test_schmidt_equals_the_update_written_with_the_joint_covariance():
    """Independent form: the optimal joint gain with its rows for the nuisance set to zero."""
    rng = np.random.default_rng(4)
    A = rng.normal(size=(5, 5))
    J = A @ A.T + np.eye(5)
    H_x, H_c, R = rng.normal(size=(2, 3)), rng.normal(size=(2, 2)), np.diag([0.3, 0.7])
    belief = ConsiderBelief.start(np.zeros(3), J[:3, :3], J[3:, 3:], J[:3, 3:])
    after, K = consider.update(belief, np.array([1.0, -2.0]), H_x, H_c, R)
    H = np.hstack([H_x, H_c])
    V = H @ J @ H.T + R
    joint = np.linalg.solve(V, H @ J).T
    joint[3:] = 0.0
    keep = np.eye(5) - joint @ H
    wanted = keep @ J @ keep.T + joint @ R @ joint.T
    np.testing.assert_allclose(K, joint[:3], atol=1e-13)
    np.testing.assert_allclose(after.P, wanted[:3, :3], atol=1e-12)
    np.testing.assert_allclose(after.C, wanted[:3, 3:], atol=1e-12)
    np.testing.assert_allclose(after.mean, joint[:3] @ [1.0, -2.0], atol=1e-13)


def test_time_update_with_a_moving_nuisance_equals_the_joint_transition():
    rng = np.random.default_rng(6)
    A = rng.normal(size=(5, 5))
    J = A @ A.T + np.eye(5)
    Phi, zeta, F = rng.normal(size=(3, 3)), rng.normal(size=(3, 2)), 0.7 * np.eye(2)
    Q_x, Q_c = 0.1 * np.eye(3), 0.2 * np.eye(2)
    belief = ConsiderBelief.start(np.ones(3), J[:3, :3], J[3:, 3:], J[:3, 3:])
    after = consider.predict(belief, Phi, zeta, Q_x, F, Q_c)
    step = np.block([[Phi, zeta], [np.zeros((2, 3)), F]])
    wanted = step @ J @ step.T
    wanted[:3, :3] += Q_x
    wanted[3:, 3:] += Q_c
    np.testing.assert_allclose(after.P, wanted[:3, :3], atol=1e-12)
    np.testing.assert_allclose(after.C, wanted[:3, 3:], atol=1e-12)
    np.testing.assert_allclose(after.S, wanted[3:, 3:], atol=1e-12)


@pytest.fixture(scope="module")
def odtbx():
    if not DATA.exists():
        pytest.skip(f"reference data not found at {DATA}")
    return json.loads(DATA.read_text())


def test_odtbx_case_1_scalar_filter_without_process_noise(odtbx):
    """NASA ODTBX regression, case 1: A = 0, Q = 1, H = R = 1, P0 = 10; the filter assumes Q = 0."""
    P, true, formal = 10.0, Audit(parts={"a": np.array([[10.0]])}), Audit(parts={"a": np.array([[10.0]])})
    one = np.eye(1)
    for k in range(5):
        if k:
            true = true.predict(one, {"w": one})
        K = np.array([[P / (P + 1.0)]])
        P = (1 - K[0, 0]) * P
        true = true.update(K, one, {"v": one})
        formal = formal.update(K, one, {"v": one})
    for source in "avw":
        wanted = odtbx["case1"]
        zero = np.zeros((1, 1))
        np.testing.assert_allclose(true.parts.get(source, zero), wanted[f"P{source}_test_final"], atol=1e-10)
        np.testing.assert_allclose(formal.parts.get(source, zero), wanted[f"Phat{source}_test_final"], atol=1e-10)


def test_odtbx_case_2_consider_covariance_by_source(odtbx):
    """NASA ODTBX regression, case 2: six estimated states, a drifting bias considered, a wrong filter model."""
    transition, H_true, H = np.eye(8), np.zeros((3, 8)), np.zeros((3, 6))
    transition[:3, 3:6] = np.eye(3)
    transition[6, 7] = 1.0
    H_true[:, :3] = H[:, :3] = np.eye(3)
    H_true[:, 6] = -1.0
    process = _double_integrator(8, 1e-6) + _drift(8, 1e-6)
    filter_process = _double_integrator(6, 1e-2)
    true = Audit(parts={"a": np.diag([1.0] * 6 + [2.0, 2.0])})
    formal = Audit(parts={"a": 2.0 * np.eye(6)})
    P = 2.0 * np.eye(6)
    for k in range(30):
        if k:
            P = transition[:6, :6] @ P @ transition[:6, :6].T + filter_process
            true = true.predict(transition, {"w": process})
            formal = formal.predict(transition[:6, :6], {"w": filter_process})
        R = 1e4 * np.eye(3)
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        keep = np.eye(6) - K @ H
        P = keep @ P @ keep.T + K @ R @ K.T
        true = true.update(np.vstack([K, np.zeros((2, 3))]), H_true, {"v": np.eye(3)})
        formal = formal.update(K, H, {"v": R})
    wanted = odtbx["case2"]
    for source in "avw":
        np.testing.assert_allclose(true.parts[source], wanted[f"P{source}_test_final"], rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(formal.parts[source], wanted[f"Phat{source}_test_final"], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(formal.total, P, rtol=1e-10, atol=1e-12)


def _double_integrator(size, q):
    """Discrete noise of white acceleration of density q over one second."""
    Q = np.zeros((size, size))
    for i in range(3):
        Q[i, i], Q[i, i + 3], Q[i + 3, i], Q[i + 3, i + 3] = q / 3, q / 2, q / 2, q
    return Q


def _drift(size, q):
    Q = np.zeros((size, size))
    Q[6, 6], Q[6, 7], Q[7, 6], Q[7, 7] = q / 3, q / 2, q / 2, q
    return Q


def test_schmidt_equals_the_updater_of_stone_soup():
    """An independent implementation, where it is installed (`pip install 'nebosvod[oracles]'`): 20 updates."""
    pytest.importorskip("stonesoup", reason="Stone Soup is an optional oracle: the extra `oracles` installs it")
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.prediction import GaussianStatePrediction
    from stonesoup.updater.kalman import SchmidtKalmanUpdater

    class Partials(LinearGaussian):
        """A linear measurement of any matrix; the library's own picks single components."""

        partials = np.zeros((2, 5))

        def matrix(self, **_):
            return self.partials

    H_x, H_c, R, P0, S = setup(7, n=20)
    y = np.random.default_rng(8).normal(size=(20, 2))
    left_out = np.array([False] * 3 + [True] * 2)
    model = Partials(ndim_state=5, mapping=(0, 1), noise_covar=R)
    updater = SchmidtKalmanUpdater(measurement_model=model, consider=left_out)
    mean, joint = np.zeros((5, 1)), np.zeros((5, 5))
    joint[:3, :3], joint[3:, 3:] = P0, S
    belief, worst = ConsiderBelief.start(np.zeros(3), P0, S), 0.0
    for k in range(20):
        model.partials = np.hstack([H_x[k], H_c[k]])
        prediction = GaussianStatePrediction(mean, joint)
        after = updater.update(SingleHypothesis(prediction, Detection(y[k][:, None], measurement_model=model)))
        mean, joint = np.asarray(after.mean, dtype=float), np.asarray(after.covar, dtype=float)
        belief, _ = consider.update(belief, y[k] - H_x[k] @ belief.mean, H_x[k], H_c[k], R)
        worst = max(
            np.abs(belief.mean - mean[:3, 0]).max(),
            np.abs(belief.P - joint[:3, :3]).max(),
            np.abs(belief.C - joint[:3, 3:]).max(),
            worst,
        )
    assert worst < 1e-12
