"""Two-stage filters: equal to the augmented filter; the printed form is not."""

import numpy as np
import pytest
from scipy.stats import chi2

from nebosvod.errors import GeometryError
from nebosvod.estimation.filters import two_stage
from nebosvod.estimation.filters.two_stage import BiasTest, System, TwoStage


def random_case(rng, bias_noise, s=3, r=2, p=2):
    """A random system with cond(B) <= 3 and |A| |iB| <= 1, D and P_xb(0) not zero."""
    q1, _ = np.linalg.qr(rng.normal(size=(r, r)))
    q2, _ = np.linalg.qr(rng.normal(size=(r, r)))
    B = q1 @ np.diag(rng.uniform(0.5, 1.4, r)) @ q2
    A = rng.normal(size=(s, s))
    A *= rng.uniform(0.4, 1.0) / (np.linalg.norm(A, 2) * np.linalg.norm(np.linalg.solve(B, np.eye(r)), 2))
    joint = _spd(rng, s + r)
    Q = _spd(rng, s + r) * 0.1
    system = System(
        A=A,
        D=rng.normal(size=(s, r)),
        B=B,
        Q_x=Q[:s, :s],
        Q_b=Q[s:, s:] if bias_noise else None,
        Q_xb=Q[:s, s:] if bias_noise else None,
    )
    return (
        system,
        joint,
        rng.normal(size=(20, p, s)),
        rng.normal(size=(20, p, r)),
        _spd(rng, p),
        rng.normal(size=(20, p)),
    )


def _spd(rng, size):
    A = rng.normal(size=(size, size))
    return A @ A.T / size + 0.3 * np.eye(size)


def compare(predict, bias_noise, seeds):
    worst = 0.0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        system, joint, C, G, R, y = random_case(rng, bias_noise)
        s = len(system.A)
        x, P = np.zeros(s + 2), joint.copy()
        F = np.block([[system.A, system.D], [np.zeros((2, s)), system.B]])
        Q = np.zeros_like(joint)
        Q[:s, :s] = system.Q_x
        if bias_noise:
            Q[s:, s:], Q[:s, s:], Q[s:, :s] = system.Q_b, system.Q_xb, system.Q_xb.T
        stage = TwoStage.start(np.zeros(s), np.zeros(2), joint[:s, :s], joint[s:, s:], joint[:s, s:])
        for k in range(20):
            if k:
                x, P = F @ x, F @ P @ F.T + Q
                stage = predict(stage, system)
            H = np.hstack([C[k], G[k]])
            K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
            keep = np.eye(s + 2) - K @ H
            x, P = x + K @ (y[k] - H @ x), keep @ P @ keep.T + K @ R @ K.T
            stage, _ = two_stage.update(stage, y[k], C[k], G[k], R)
            found = np.block([[stage.P_x, stage.P_xb], [stage.P_xb.T, stage.P_b]])
            sigma = np.sqrt(np.diag(P))
            worst = max(worst, np.max(np.abs(found - P) / np.outer(sigma, sigma)))
            worst = max(worst, np.max(np.abs(np.concatenate([stage.x, stage.b]) - x) / sigma))
    return worst


def test_friedland_equals_the_augmented_filter_over_200_random_systems():
    assert compare(two_stage.predict_friedland, False, range(200)) < 1e-11


def test_hsieh_chen_equals_the_augmented_filter_with_bias_noise_too():
    assert compare(two_stage.predict_hsieh_chen, True, range(200)) < 1e-11
    assert compare(two_stage.predict_hsieh_chen, False, range(20)) < 1e-11


def test_friedland_refuses_what_it_cannot_do():
    rng = np.random.default_rng(0)
    system, joint, *_ = random_case(rng, True)
    stage = TwoStage.start(np.zeros(3), np.zeros(2), joint[:3, :3], joint[3:, 3:])
    with pytest.raises(GeometryError, match="process noise"):
        two_stage.predict_friedland(stage, system)
    flat = System(A=system.A, D=system.D, B=np.zeros((2, 2)), Q_x=system.Q_x)
    with pytest.raises(GeometryError, match="invertible B"):
        two_stage.predict_friedland(stage, flat)
    with_noise = System(A=system.A, D=system.D, B=np.zeros((2, 2)), Q_x=system.Q_x, Q_b=system.Q_b)
    assert np.isfinite(two_stage.predict_hsieh_chen(stage, with_noise).P).all()


def test_the_form_printed_in_the_paper_is_wrong_even_for_an_identity_b():
    """Volovik et al. 2017 feed the blended covariance back into the bias-free stage: 20 % off in this system."""
    A, D, B, C, G, R = 0.9 * np.eye(1), np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)), np.eye(1)
    system = System(A=A, D=D, B=B, Q_x=0.1 * np.eye(1))
    stage = TwoStage.start(np.zeros(1), np.zeros(1), np.eye(1), np.eye(1))
    printed = stage
    for _ in range(10):
        stage, _ = two_stage.update(two_stage.predict_friedland(stage, system), np.zeros(1), C, G, R)
        fed = TwoStage(x0=printed.x0, P=printed.P_x, b=printed.b, P_b=printed.P_b, V=printed.V)
        printed, _ = two_stage.update(two_stage.predict_friedland(fed, system), np.zeros(1), C, G, R)
    assert printed.P_x[0, 0] / stage.P_x[0, 0] == pytest.approx(1.203, abs=1e-3)


def bias_statistic(bias, seed):
    rng = np.random.default_rng(seed)
    system = System(A=np.array([[1.0, 1.0], [0.0, 1.0]]), D=np.zeros((2, 1)), B=np.eye(1), Q_x=np.zeros((2, 2)))
    stage = TwoStage.start(np.zeros(2), np.zeros(1), np.diag([1.0, 0.01]), np.eye(1))
    truth = np.linalg.cholesky(np.diag([1.0, 0.01])) @ rng.normal(size=2)
    test = BiasTest.start(1)
    for k in range(30):
        if k:
            stage, truth = two_stage.predict_friedland(stage, system), system.A @ truth
        G = np.array([[1.0], [0.0]])  # the bias is in one of two instruments
        y = np.array([truth[0] + bias, truth[0]]) + 0.5 * rng.normal(size=2)
        stage, innovation = two_stage.update(stage, y, np.array([[1.0, 0.0], [1.0, 0.0]]), G, 0.25 * np.eye(2))
        test = test.add(innovation)
    return test


def test_no_bias_is_called_no_bias_as_often_as_promised_and_a_bias_is_found():
    statistics = np.array([bias_statistic(0.0, seed).statistic for seed in range(300)])
    low, high = chi2.ppf([0.005, 0.995], 300)
    assert low < statistics.sum() < high
    assert all(bias_statistic(1.0, seed).verdict() == "bias" for seed in range(20))
    quiet = [bias_statistic(0.0, seed).verdict(0.05) for seed in range(300)]
    assert 3 <= quiet.count("bias") <= 27  # 15 expected
