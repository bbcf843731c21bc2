"""Is there a bias, and since when: likelihood ratios against whole solutions, filters begun anew, and drawn worlds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation import Block, LinearProblem
from nebosvod.estimation.accuracy.appearing import Ground
from nebosvod.estimation.filters import two_stage
from nebosvod.estimation.filters.two_stage import BiasTest, System, TwoStage
from nebosvod.estimation.solvers import batch

MINE = np.arange(0, 60, 2)  # rows of the telescope that is asked
MOMENTS = np.arange(4, 56, 4)


@pytest.fixture(params=["none", "white", "both"])
def problem(request, make_problem) -> LinearProblem:
    return make_problem(seed=3, n=60, z=request.param, treatments={"bias": "fixed"})


def with_bias(problem: LinearProblem, since: int) -> LinearProblem:
    H = np.zeros((problem.n, problem.p, problem.p))
    H[MINE[since <= MINE]] = np.eye(problem.p)
    return replace(problem, blocks=(*problem.blocks, Block(name="new", names=("new 0", "new 1"), H=H)))


def drawn(ground: Ground, rng: np.random.Generator) -> Ground:
    """The same ground in a world where H0 is true: whitened residuals are noise."""
    v = rng.standard_normal(ground.v.shape)
    return replace(ground, v=v, told=ground.half.T @ (ground.B.reshape(-1, ground.B.shape[2]).T @ v.ravel()))


def test_every_number_is_that_of_two_whole_solutions(problem):
    found = Ground.of(problem).scan(MINE, np.array([0, *MOMENTS]))
    without = batch.solve(problem)
    for i, since in enumerate(found.onsets):
        one = batch.solve(with_bias(problem, since))
        assert found.statistics[i] == pytest.approx(without.chi2 - one.chi2, abs=1e-8)
        bias, covariance = found.estimate(i)
        np.testing.assert_allclose(bias, [one.value("new 0"), one.value("new 1")], rtol=1e-9)
        np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [one.sigma_formal("new 0"), one.sigma_formal("new 1")])
        np.testing.assert_allclose(found.shift(i), one.mean[: len(without.mean)] - without.mean, atol=1e-10)
    np.testing.assert_allclose(found.sigma, np.sqrt(np.diag(without.K_formal)))


def test_the_bias_stage_of_a_filter_without_a_bias_sums_the_same(make_problem):
    problem = make_problem(seed=2, n=30, z="none", treatments={"bias": "fixed"}, state_prior="own")
    stage = _two_stages(problem)
    test = BiasTest.start(2)
    L = np.linalg.cholesky(problem.R)
    for k in range(problem.n):
        stage, seen = two_stage.update(stage, problem.residual[k], _state(problem)[k], _offset(k), problem.R[k])
        test = test.add(seen)
    assert len(L) == problem.n
    found = Ground.of(problem).scan(MINE[:15], [0])
    assert test.statistic == pytest.approx(found.statistics[0], rel=1e-9)
    assert (test.verdict(0.01) == "bias") == (found.chance() < 0.01)


def test_a_bias_stage_begun_anew_ends_at_the_estimate_of_the_scan(make_problem):
    """From the moment on, with next to nothing known of the new bias, as a filter whose bias is drawn anew (B = 0)."""
    problem = make_problem(seed=2, n=30, z="none", treatments={"bias": "fixed"}, state_prior="own")
    since, wide = 12, 1e6 * np.eye(2)
    stage, other = _two_stages(problem), _two_stages(problem)
    still = System(A=np.eye(6), D=np.zeros((6, 2)), B=np.zeros((2, 2)), Q_x=np.zeros((6, 6)), Q_b=wide)
    for k in range(problem.n):
        G = _offset(k) if k >= since else np.zeros((2, 2))
        if k == since:
            stage, other = two_stage.restart(stage, wide), two_stage.predict_hsieh_chen(other, still)
        stage, _ = two_stage.update(stage, problem.residual[k], _state(problem)[k], G, problem.R[k])
        other, _ = two_stage.update(other, problem.residual[k], _state(problem)[k], G, problem.R[k])
    found = Ground.of(problem).scan(MINE[:15], [since])
    bias, covariance = found.estimate(0)
    np.testing.assert_allclose(stage.b, bias, rtol=1e-5)
    np.testing.assert_allclose(stage.P_b, covariance, rtol=1e-5)
    np.testing.assert_allclose(stage.x - batch.solve(problem).mean, found.shift(0), atol=1e-5)
    for one, two in ((stage.x, other.x), (stage.P_x, other.P_x), (stage.b, other.b), (stage.P_b, other.P_b)):
        np.testing.assert_allclose(one, two, rtol=1e-6, atol=1e-9)


def _state(problem: LinearProblem) -> np.ndarray:
    return np.concatenate([b.H for b in problem.blocks if b.treatment == "estimated"], axis=2)


def _offset(k: int) -> np.ndarray:
    return np.eye(2) * float(k % 2 == 0)


def _two_stages(problem: LinearProblem) -> TwoStage:
    names = problem.names("estimated")
    P = np.zeros((len(names), len(names)))
    for prior in problem.priors:
        if set(prior.names) <= set(names):
            at = [names.index(name) for name in prior.names]
            P[np.ix_(at, at)] = prior.covariance
    return TwoStage.start(np.zeros(len(names)), np.zeros(2), P, np.eye(2))


def rates(ground: Ground, runs: int, level: float, clusters: np.ndarray | None = None) -> tuple[int, int]:
    """False alarms in drawn worlds, of a bias all the time and of one that appears."""
    rng = np.random.default_rng(7)
    alarms = np.zeros(2, dtype=int)
    for _ in range(runs):
        world = drawn(ground, rng)
        if clusters is not None:  # errors of a night are mostly one draw, and three times as large as stated
            night = rng.standard_normal((clusters.max() + 1, 2))
            v = world.v.copy()
            v[MINE] = 3.0 * (0.6 * v[MINE] + 0.8 * night[clusters])
            world = replace(world, v=v, told=ground.half.T @ (ground.B.reshape(-1, ground.B.shape[2]).T @ v.ravel()))
        for i, onsets in enumerate((MINE[:1], MOMENTS)):
            alarms[i] += world.scan(MINE, onsets, clusters).chance(level) < level
    return int(alarms[0]), int(alarms[1])


def test_false_alarms_are_as_frequent_as_stated(make_problem):
    ground = Ground.of(make_problem(seed=3, n=60, z="white", treatments={"bias": "fixed"}))
    runs, level = 600, 0.05
    for alarms in rates(ground, runs, level):
        assert stats.binomtest(alarms, runs, level).pvalue > 0.005


def test_false_alarms_stay_so_where_errors_of_a_night_are_alike(make_problem):
    ground = Ground.of(make_problem(seed=3, n=60, z="none", treatments={"bias": "fixed"}))
    runs, level = 400, 0.05
    believed, held = rates(ground, runs, level), rates(ground, runs, level, np.arange(len(MINE)) // 2)
    for alarms in held:
        assert stats.binomtest(alarms, runs, level, alternative="greater").pvalue > 0.005
    assert min(held) > 0 or min(believed) > 0


@pytest.mark.long
def test_false_alarms_of_ten_thousand_worlds(make_problem):
    ground = Ground.of(make_problem(seed=3, n=60, z="both", treatments={"bias": "fixed"}))
    for level in (0.01, 0.0025):
        for alarms in rates(ground, 10_000, level):
            assert stats.binomtest(alarms, 10_000, level).pvalue > 1e-3
    held = rates(Ground.of(make_problem(seed=3, n=60, z="none", treatments={"bias": "fixed"})), 10_000, 0.01,
                 np.arange(len(MINE)) // 2)  # fmt: skip
    assert all(stats.binomtest(one, 10_000, 0.01, alternative="greater").pvalue > 1e-3 for one in held)


@pytest.mark.parametrize(("onsets", "i"), [(MINE[:1], 0), (MOMENTS, 6)])
def test_the_power_curve_is_how_often_a_bias_is_found(make_problem, onsets, i):
    ground = Ground.of(make_problem(seed=3, n=60, z="none", treatments={"bias": "fixed"}))
    level, runs, rng = 0.01, 250, np.random.default_rng(5)
    scan = ground.scan(MINE, onsets)
    vectors = np.linalg.eigh(scan.own(i))[1]
    sizes = np.array([1.0, 2.0, 3.5, 5.0]) / np.sqrt(np.linalg.eigvalsh(scan.own(i))[0])
    told = scan.power(i, sizes, level)
    assert (np.diff(told) > 0).all()
    assert told[0] < 0.3 < told[-1]
    limit, begun = scan.threshold(level), MINE[onsets[i] <= MINE]
    L = ground.whitener.L
    for size, wanted in zip(sizes, told):
        signal = np.zeros_like(ground.v)
        signal[begun] = np.linalg.solve(L[begun], np.tile(size * vectors[:, 0], (len(begun), 1))[:, :, None])[:, :, 0]
        found = 0
        for _ in range(runs):
            world = drawn(ground, rng)
            v = world.v + signal
            world = replace(world, v=v, told=ground.half.T @ (ground.B.reshape(-1, ground.B.shape[2]).T @ v.ravel()))
            found += world.scan(MINE, onsets).statistics.max() > limit
        assert stats.binomtest(int(found), runs, float(wanted)).pvalue > 1e-3


def test_units_change_nothing(make_problem):
    problem = make_problem(seed=3, n=60, z="white", treatments={"bias": "fixed"})
    tiny = replace(
        problem,
        residual=1e-9 * problem.residual,
        R=1e-18 * problem.R,
        blocks=tuple(replace(b, H=1e-9 * b.H) for b in problem.blocks),
        white=tuple(replace(w, H=1e-9 * w.H) for w in problem.white),
    )
    one, two = (Ground.of(p).scan(MINE, MOMENTS) for p in (problem, tiny))
    np.testing.assert_allclose(one.statistics, two.statistics, rtol=1e-9)
    assert one.chance() == pytest.approx(two.chance(), abs=1e-3)


def test_what_cannot_be_told_is_not(make_problem):
    problem = make_problem(seed=3, n=60, z="none")  # its biases are in the model, with priors
    free = tuple(p for p in problem.priors if p.name != "bias A")
    unknown = replace(problem, priors=free)
    assert Ground.of(unknown).scan(MINE, [0]) is None
    assert Ground.of(unknown).scan(MINE, [0, 20]).onsets.tolist() == [20]
    with pytest.raises(InputError, match="ascending"):
        Ground.of(problem).scan(MINE, [20, 0])
    flat = replace(problem, blocks=tuple(replace(b, H=0.0 * b.H) if b.name == "state" else b for b in problem.blocks))
    with pytest.raises(GeometryError, match="not observable"):
        Ground.of(flat)
