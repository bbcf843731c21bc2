"""Cases of units: the filters of the textbooks, and smoothers."""

from typing import Any

import numpy as np
from turned_units import STATE, case, problem  # type: ignore[import-not-found]

from nebosvod.estimation.filters import (
    block_loop,
    combined,
    consider,
    continuous,
    current_state,
    kalman,
    refinement,
    smoother,
    steady,
    triad,
    tuning,
    two_stage,
)
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.solvers import batch, parabolic


def system(units, s=3, steps=6):
    """A random system with process noise in all but one component, and its units."""
    rng = np.random.default_rng(6)
    u, m = units.x[:s], units.m
    F = [(np.eye(s) + 0.1 * rng.normal(size=(s, s))) * u[:, None] / u for _ in range(steps - 1)]
    A = [rng.normal(size=(s, s)) for _ in range(steps)]
    A[1][2] = 0.0
    Q = [0.2 * a @ a.T * np.outer(u, u) for a in A[1:]]
    H = [rng.normal(size=(2, s)) * m[:, None] / u for _ in range(steps)]
    C = [rng.normal(size=(2, 2)) for _ in range(steps)]
    R = [(c @ c.T + 0.3 * np.eye(2)) * np.outer(m, m) for c in C]
    y = [rng.normal(size=2) * m for _ in range(steps)]
    return u, F, Q, H, R, y, Belief.of(0.1 * u, (A[0] @ A[0].T + np.eye(s)) * np.outer(u, u))


def beliefs(found, u):
    return {
        "mean": [one_belief.mean / u for one_belief in found],
        "P": [one_belief.covariance / np.outer(u, u) for one_belief in found],
    }


@case("kalman.predict", "kalman.update", "kalman.Belief", "kalman.Innovation", "kalman.joseph", "smoother.smooth",
      "kalman.inform", "kalman.Information", "kalman.normalized_error_squared")  # fmt: skip
def filter_and_smoother(units):
    u, F, Q, H, R, y, belief = system(units)
    information, nis, gains = kalman.Information.nothing(3), [], []
    out = []
    for k in range(len(H)):
        if k:
            belief = kalman.predict(belief, F[k - 1], Q[k - 1], 0.1 * u)
        P = belief.covariance
        belief, innovation = kalman.update(belief, y[k] - H[k] @ belief.mean, H[k], R[k], gate=0.9999)
        gain, posterior = kalman.joseph(P, H[k], R[k])
        gains += [gain / u[:, None] * units.m, innovation.gain / u[:, None] * units.m, posterior / np.outer(u, u)]
        nis.append(innovation.nis)
        information = kalman.inform(information, y[k], H[k], R[k])
        out.append(belief)
    smoothed = smoother.smooth(out, F, Q, [0.1 * u] * len(F))
    found = beliefs([*out, *smoothed, information.belief()], u)
    error = kalman.normalized_error_squared(belief, 0.5 * u)
    return found | {"nis": nis, "gains": gains, "nees": error}


@case("smoother.smooth")
def smoother_of_a_component_that_is_known(units):
    u, F, Q, H, R, y, belief = system(units)
    known = Belief(mean=belief.mean, factor=belief.factor * np.array([1.0, 1.0, 0.0])[:, None])
    F = [f * (np.array([1.0, 1.0, 0.0])[:, None] > 0) + np.diag([0.0, 0.0, 1.0]) for f in F]
    Q = [q * np.outer([1.0, 1.0, 0.0], [1.0, 1.0, 0.0]) for q in Q]
    out = []
    for k in range(len(H)):
        known = kalman.predict(known, F[k - 1], Q[k - 1]) if k else known
        known, _ = kalman.update(known, y[k] - H[k] @ known.mean, H[k], R[k])
        out.append(known)
    return beliefs(smoother.smooth(out, F, Q), u)


@case("kalman.iterated_update", "kalman.iterated_update_as_printed", "kalman.chord", "kalman.chord_update",
      "kalman.Chord")  # fmt: skip
def nonlinear_updates(units):
    u, _, _, _, R, _, belief = system(units)

    def h(x):
        a, b, c = x / u
        return np.array([np.hypot(3.0 + a, b + c), np.arctan2(b, 3.0 + a) + 0.1 * a * c]) * units.m

    def measure(x):
        step = 1e-6
        H = np.stack([(h(x + step * e * u) - h(x - step * e * u)) / (2.0 * step * e.sum()) for e in np.eye(3)], axis=1)
        return h(x), H / u

    small = Belief(mean=belief.mean, factor=0.2 * belief.factor)
    y = np.array([3.5, 0.2]) * units.m
    one_step, _, converged = kalman.iterated_update(small, y, measure, R[0])
    printed = kalman.iterated_update_as_printed(small, y, measure, R[0], 3)
    line = kalman.chord(h, belief)
    by_chord, _ = kalman.chord_update(belief, y, h, R[0])
    found = beliefs([one_step, printed, by_chord], u)
    loose = {key: np.round(value, 6) for key, value in found.items()}  # partials by differences
    return loose | {
        "converged": converged,
        "value": line.value / units.m,
        "shift": line.mean_shift / units.m,
        "slope": line.slope * u / units.m[:, None],
        "left": line.residual_covariance / np.outer(units.m, units.m),
    }


@case("consider.predict", "consider.update", "consider.ConsiderBelief", "consider.Audit")
def considered(units):
    u, F, Q, H, R, y, belief = system(units)
    rng = np.random.default_rng(2)
    w = units.z[:2]
    zeta, H_c = rng.normal(size=(3, 2)) * u[:, None] / w, rng.normal(size=(2, 2)) * units.m[:, None] / w
    S = np.array([[1.0, 0.4], [0.4, 2.0]]) * np.outer(w, w)
    out: dict[str, Any] = {}
    for gain in ("considered", "schmidt"):
        now = consider.ConsiderBelief.start(belief.mean, belief.covariance, S)
        audit = consider.Audit(parts={"prior": belief.covariance})
        for k in range(len(H)):
            if k:
                now = consider.predict(now, F[k - 1], zeta, Q[k - 1], np.diag([0.5, 1.0]))
                audit = audit.predict(F[k - 1], {"process": Q[k - 1]})
            now, K = consider.update(now, y[k] - H[k] @ now.mean, H[k], H_c, R[k], gain)
            audit = audit.update(K, H[k], {"noise": R[k]})
        out |= {
            f"{gain} mean": now.mean / u,
            f"{gain} P": [P / np.outer(u, u) for P in (now.P, now.P_formal, audit.total)],
            f"{gain} C": now.C / np.outer(u, w),
        }
    return out


@case("two_stage.TwoStage", "two_stage.System", "two_stage.predict_friedland", "two_stage.predict_hsieh_chen",
      "two_stage.update", "two_stage.BiasTest", "two_stage.BiasInnovation", "two_stage.restart")  # fmt: skip
def two_stages(units):
    u, F, Q, H, R, y, belief = system(units)
    rng = np.random.default_rng(2)
    w = units.z
    D, G = rng.normal(size=(3, 3)) * u[:, None] / w, rng.normal(size=(2, 3)) * units.m[:, None] / w
    B = (np.eye(3) + 0.2 * rng.normal(size=(3, 3))) * w[:, None] / w
    A = rng.normal(size=(3, 3))
    P_b = (A @ A.T + np.eye(3)) * np.outer(w, w)
    cross = 0.2 * rng.normal(size=(3, 3)) * np.outer(u, w)
    out: dict[str, Any] = {}
    for name, predict in (("friedland", two_stage.predict_friedland), ("hsieh", two_stage.predict_hsieh_chen)):
        stage = two_stage.TwoStage.start(belief.mean, 0.1 * w, belief.covariance, P_b, cross)
        test = two_stage.BiasTest.start(3)
        for k in range(len(H)):
            if k:
                noise = None if name == "friedland" else 0.1 * P_b
                stage = predict(stage, two_stage.System(A=F[k - 1], D=D, B=B, Q_x=Q[k - 1], Q_b=noise))
            stage, seen = two_stage.update(stage, y[k], H[k], G, R[k])
            test = test.add(seen)
        anew = two_stage.restart(stage, P_b)
        out |= {
            f"{name} x": stage.x / u,
            f"{name} anew": [anew.x / u, anew.P_x / np.outer(u, u), anew.P_b / np.outer(w, w)],
            f"{name} b": stage.b / w,
            f"{name} P": stage.P_x / np.outer(u, u),
            f"{name} P_b": stage.P_b / np.outer(w, w),
            f"{name} P_xb": stage.P_xb / np.outer(u, w),
            f"{name} statistic": test.statistic,
            f"{name} verdict": test.verdict() == "bias",
        }
    return out


@case("current_state.at_epoch", "current_state.step", "current_state.follow")
def current(units):
    u, w = units.of(STATE), units.of(("c1", "c2"))
    rng = np.random.default_rng(3)
    Phi = np.stack([np.eye(4) + 0.3 * rng.normal(size=(4, 4)) for _ in range(5)]) * u[:, None] / u
    zeta = rng.normal(size=(5, 4, 2)) * u[:, None] / w
    found = current_state.at_epoch(batch.solve(problem(units)), Phi[2], zeta[2], STATE, ("c1", "c2"))
    moves = current_state.step(Phi, zeta)
    both = np.concatenate([u, w])
    H = rng.normal(size=(5, 2, 6)) * units.m[:, None] / both
    R = np.stack([np.array([[1.0, 0.3], [0.3, 2.0]]) * np.outer(units.m, units.m)] * 5)
    prior = Belief.of(np.zeros(6), np.diag(both**2))
    followed = current_state.follow(prior, moves, rng.normal(size=(5, 2)) * units.m, H, R)
    shares = [share / np.outer(u, u) for share in found.shares.values()]
    return beliefs(followed, both) | {
        "moves": [move / both[:, None] * both for move in moves],
        "value": found.value / u,
        "shares": shares,
        "sigma": [found.sigma / u, found.sigma_formal / u],
        "factor": found.factor / u[:, None],
    }


@case("combined.GridBlock", "combined.equivalent_measurement", "combined.EquivalentMeasurement", "combined.with_drift",
      "combined.drift_covariance", "combined.ready", "combined.adapt")  # fmt: skip
def combined_algorithm(units):
    u, _, _, _, R, _, prior = system(units)
    block = combined.GridBlock.of_prior(prior, 2, points=31)
    empty = len(combined.equivalent_measurement(prior, block.moments()).y)
    H = np.array([[0.5], [-1.0]]) * units.m[:, None] / u[2]
    x = block.nodes / u[:2]
    predicted = np.stack([x[:, 0] ** 2, np.sin(x[:, 1])], axis=1) * units.m
    block = block.update(np.array([1.0, 0.2]) * units.m, predicted, H, R[0])
    block = block.move(np.array([[0.9]]), np.array([[0.1]]) * u[2] ** 2)
    moments = block.moments()
    linear = combined.equivalent_measurement(prior, moments)
    drift = combined.drift_covariance(np.diag((u / units.time) ** 2) * 0.01, 2.0 * units.time)
    after, _ = kalman.update(prior, linear.y - linear.H @ prior.mean, linear.H, linear.R)
    drifting = combined.with_drift(linear, drift)
    later, _ = kalman.update(prior, linear.y - linear.H @ prior.mean, drifting.H, drifting.R)

    def evaluate(nodes):
        away = nodes / u[:2] - [0.3, -0.2]
        weight = -0.5 * np.sum((away @ np.array([[1.0, 5.0], [-2.0, 4.0]])) ** 2, axis=1)
        return combined.GridBlock(
            nodes=nodes, log_weight=weight, mean=np.zeros((len(nodes), 0)), covariance=np.zeros((0, 0))
        )

    grid = combined.adapt(evaluate, Belief.of(np.zeros(2), np.diag(u[:2] ** 2)))
    flat = Belief.of(np.zeros(2), np.diag([4.0, 0.09]) * units.length**2)
    out = beliefs([moments, after, later], u)
    return out | {
        "empty": empty,
        "rows": len(linear.y),
        "R": np.diag(linear.R),
        "effective": [block.effective, grid.effective],
        "grid": beliefs([grid.moments()], u[:2])["P"],
        "ready": [combined.ready(flat, 2, size * units.length) for size in (0.2, 0.4)],
    }


@case("refinement.refine", "refinement.Refined", "block_loop.follow", "block_loop.Step", "block_loop.Condensed")
def loop_of_blocks(units):
    u, F, Q, _, R, _, prior = system(units, steps=7)
    H = np.array([[0.5], [-1.0]]) * units.m[:, None] / u[2]

    def predict(nodes):
        x = nodes / u[:2]
        return np.stack([x[:, 0] + 0.1 * x[:, 0] ** 2, np.sin(x[:, 1]) + x[:, 1]], axis=1) * units.m

    steps = [
        block_loop.Step(F=f, Q=q, observed=np.array([1.0, 0.2]) * units.m, predict=predict, H=H, R=R[0], shift=0.1 * u)
        for f, q in zip(F, Q)
    ]
    found = list(block_loop.follow(prior, steps, 2, cell=0.5 * u[:2]))
    length = Belief.of(np.zeros(2), np.array([[1.0, 0.3], [0.3, 0.5]]) * units.length**2)

    def evaluate(nodes):
        x = nodes / units.length
        logs = -0.5 * np.sum(np.linalg.solve(length.factor, nodes.T) ** 2, axis=0) - 50.0 * (x[:, 0] - x[:, 1]) ** 2
        return combined.GridBlock(
            nodes=nodes, log_weight=logs, mean=np.zeros((len(nodes), 0)), covariance=np.zeros((0, 0))
        )

    grid = refinement.refine(evaluate, length, cell=np.array([0.5, 0.4]) * units.length)
    beliefs_after = beliefs([one.belief for one in found] + [one.before for one in found], u)
    return beliefs_after | {
        "blocks": [[one.first, one.last, one.rows] for one in found],
        "dQ": [matrix / np.outer(u[:2], u[:2]) for one in found for matrix in (one.dQ, one.drift)],
        "refined": beliefs([grid.block.moments()], np.full(2, units.length))["P"],
        "quality": [grid.effective, grid.stages, grid.steepness, grid.rim],
    }


@case("continuous.discretise", "steady.steady_state", "steady.Steady", "steady.steady_map", "tuning.run", "tuning.Pass")
def systems_without_end(units):
    u, _, _, H, R, y, belief = system(units)
    rng = np.random.default_rng(9)
    A, G = rng.normal(size=(3, 3)) - np.eye(3), rng.normal(size=(3, 2))
    F1, Q1 = continuous.discretise(
        A * u[:, None] / u / units.time, G @ G.T * np.outer(u, u) / units.time, 0.7 * units.time
    )
    found = steady.steady_state(F1, Q1, H[0], R[0])

    def model(first, second):
        return F1, Q1 * first, H[0], R[0] * second

    maps = steady.steady_map(model, [0.5, 2.0], [1.0, 3.0], np.diag(1.0 / u))
    n = len(y)
    passed = tuning.run(belief, np.array(y), [F1] * n, [Q1] * n, H, R)
    return beliefs([passed.beliefs[-1]], u) | {
        "F": F1 * u / u[:, None],
        "Q": Q1 / np.outer(u, u),
        "steady": [P / np.outer(u, u) for P in (found.predicted, found.filtered)],
        "gain": found.gain / u[:, None] * units.m,
        "sigma": found.sigma / u,
        "maps": maps,
        "nis": passed.nis,
        "cost": passed.cost - 2.0 * n * np.log(units.m).sum(),
    }


@case("tuning.by_likelihood", "tuning.by_nees", "tuning.Tuned", "triad.triad", "triad.Attitude", "parabolic.descend",
      "parabolic.Path")  # fmt: skip
def tuned_turned_and_descended(units):
    m = float(units.m[0])
    rng = np.random.default_rng(3)
    v = 1.7 * m * rng.normal(size=40)
    found = tuning.by_likelihood(lambda f: float(np.sum(v**2) / (f[0] * m**2) + 40.0 * np.log(f[0] * m**2)))
    pair = rng.normal(size=(2, 3))
    attitude = triad.triad(pair * m, pair[:, [1, 2, 0]] * units.length, (1e-3, 2e-3))
    u = units.x[:2]

    def rosenbrock(x):
        a, b = x / u
        return np.array([10.0 * (b - a**2), 1.0 - a]), np.array([[-20.0 * a, 10.0], [-1.0, 0.0]]) / u

    path = parabolic.descend(rosenbrock, np.array([-1.2, 1.0]) * u)
    return {
        "factor": found.factors,
        "sigma": found.sigma_log,
        "nees": tuning.by_nees(lambda q: 4.0 / q),
        "R": attitude.R_body_from_reference,
        "P": attitude.covariance,
        "x": path.x[-1] / u,
        "steps": len(path.s),
    }
