"""Gauss-Newton: the prior stays, bad starts converge or say why not."""

import numpy as np
import pytest

from nebosvod.estimation import Block, LinearProblem, Prior, Status, White, gauss_newton
from nebosvod.estimation.solvers.batch import solve
from nebosvod.estimation.solvers.iteration import _bent, cost

BEACONS = np.array([[0.0, 0.0], [10.0, 0.0], [3.0, 8.0]])


def ranges(position):
    return np.linalg.norm(BEACONS - position, axis=1)


def range_problem(truth, start, sigma=0.1, prior_sigma=None, prior_mean=(0.0, 0.0), turns=1.0):
    """Ranges to three beacons; the returned function linearises about start + deviation."""
    observed = ranges(np.asarray(truth))

    def linearise(deviation):
        x = np.asarray(start, dtype=float) + np.array([deviation.get("x", 0.0), deviation.get("y", 0.0)])
        away = x - BEACONS
        distance = np.linalg.norm(away, axis=1)
        priors = []
        if prior_sigma is not None:
            covariance = np.diag([prior_sigma**2] * 2)
            priors.append(Prior(name="prior", names=("x", "y"), covariance=covariance, mean=np.asarray(prior_mean)))
        return LinearProblem(
            residual=(turns * (observed - distance))[:, None],
            R=sigma**2 * np.eye(1),
            blocks=(Block(name="position", names=("x", "y"), H=turns * (away / distance[:, None])[:, None, :]),),
            priors=tuple(priors),
        )

    return linearise


def test_it_finds_the_truth_of_exact_measurements():
    found = gauss_newton(range_problem((4.0, 3.0), (6.0, 6.0)))
    assert found.status is Status.CONVERGED
    np.testing.assert_allclose(
        [6 + found.deviation["x"], 6 + found.deviation["y"]], [4.0, 3.0], atol=2e-5
    )  # 1e-4 sigma
    assert found.cost[-1] < 1e-6 < found.cost[0]  # steps end below 1e-4 sigma, so its cost below 1e-8 a component
    assert len(found.cost) == found.iterations + 1
    assert found.steps[-1] <= 1e-4


def test_the_prior_is_kept_where_it_was():
    """The minimum of the whole cost, against a dense search; the printed update forgets the prior."""
    linearise = range_problem((4.0, 3.0), (6.0, 6.0), sigma=1.0, prior_sigma=1.0, prior_mean=(0.5, -0.2))
    found = gauss_newton(linearise, tolerance=1e-8)
    assert found.status is Status.CONVERGED

    def total(x, y):
        misfit = ranges(np.array([4.0, 3.0])) - ranges(np.array([6.0 + x, 6.0 + y]))
        return np.sum(misfit**2) + (x - 0.5) ** 2 + (y + 0.2) ** 2

    x, y = found.deviation["x"], found.deviation["y"]
    assert found.cost[-1] == pytest.approx(total(x, y), rel=1e-12)
    assert found.estimate.chi2 == pytest.approx(total(x, y), rel=1e-9)
    for dx, dy in ((1e-4, 0), (-1e-4, 0), (0, 1e-4), (0, -1e-4)):
        assert total(x + dx, y + dy) > total(x, y)
    # Without the prior the answer is (-2, -3); the printed update goes there.
    assert np.hypot(x + 2.0, y + 3.0) > 0.5
    np.testing.assert_allclose(found.estimate.mean, [x, y], atol=1e-7)


def test_the_answer_does_not_depend_on_where_the_iteration_begins():
    linearise = range_problem((4.0, 3.0), (6.0, 6.0), sigma=1.0, prior_sigma=1.0)
    one = gauss_newton(linearise, tolerance=1e-9)
    two = gauss_newton(linearise, start={"x": -1.0, "y": 1.0}, tolerance=1e-9)
    for name in "xy":
        assert one.deviation[name] == pytest.approx(two.deviation[name], abs=1e-7)


def test_a_bad_start_is_damped_and_converges():
    """Undamped Gauss-Newton on atan diverges from |x| > 1.39; halving brings it home."""

    def linearise(deviation):
        x = 3.0 + deviation.get("x", 0.0)
        H = np.array([[[1.0 / (1.0 + x * x)]]])
        return LinearProblem(residual=[[-np.arctan(x)]], R=[[1.0]], blocks=(Block(name="x", names=("x",), H=H),))

    found = gauss_newton(linearise)
    assert found.status is Status.CONVERGED
    assert 3.0 + found.deviation["x"] == pytest.approx(0.0, abs=1e-4)
    assert min(found.damping) < 1.0
    assert all(later < earlier for earlier, later in zip(found.cost, found.cost[1:]))


TIMES = np.arange(10) / 3.0
DECAYS = np.exp(-TIMES) + 5.0 * np.exp(-3.0 * TIMES)


def two_decays(deviation):
    """Rates and sizes of two exponentials from rates that are almost one: the normal matrix is almost singular."""
    p = np.array([1.9, 2.0, 3.0, 3.0]) + [deviation.get(name, 0.0) for name in "abcd"]
    one, two = np.exp(-p[0] * TIMES), np.exp(-p[1] * TIMES)
    H = np.stack([-p[2] * TIMES * one, -p[3] * TIMES * two, one, two], axis=1)
    v = DECAYS - p[2] * one - p[3] * two
    return LinearProblem(residual=v[:, None], R=np.eye(1), blocks=(Block(name="p", names=tuple("abcd"), H=H[:, None]),))


@pytest.mark.filterwarnings("ignore:overflow")  # trial steps far off, which are then shortened
def test_levenberg_and_marquardt_leave_an_almost_singular_place_in_fewer_steps():
    straight, bent = (gauss_newton(two_decays, bent=way, tolerance=1e-9, limit=200) for way in (False, True))
    assert bent.status is Status.CONVERGED
    found = np.array([1.9, 2.0, 3.0, 3.0]) + [bent.deviation[name] for name in "abcd"]
    assert sorted(zip(found[:2], found[2:])) == [
        pytest.approx((1.0, 1.0), abs=1e-6), pytest.approx((3.0, 5.0), abs=1e-6)
    ]  # fmt: skip
    assert 2 * bent.iterations < straight.iterations


def test_a_bent_step_solves_marquardts_equations():
    problem = range_problem((4.0, 3.0), (6.0, 6.0), prior_sigma=2.0)({})
    estimate = solve(problem)
    H, v = problem.blocks[0].H[:, 0], problem.residual[:, 0]
    N = H.T @ H / 0.01 + np.eye(2) / 4.0
    for fraction in (1.0, 0.5, 2.0**-10):
        damping = 1e-3 * (1.0 / fraction - 1.0) ** 2
        wanted = np.linalg.solve(N + damping * np.diag(np.diag(N)), H.T @ v / 0.01)
        np.testing.assert_allclose(_bent(estimate, fraction), wanted, rtol=1e-10)


def test_the_limit_of_iterations_is_a_status_with_the_last_point():
    found = gauss_newton(range_problem((4.0, 3.0), (60.0, 60.0)), limit=1)
    assert found.status is Status.ITERATION_LIMIT
    assert "limit" in found.message
    assert np.isfinite([found.deviation["x"], found.deviation["y"]]).all()


def test_a_wrong_gradient_ends_as_diverged_not_as_a_loop():
    def linearise(deviation):
        x = 1.0 + deviation.get("x", 0.0)
        block = Block(name="x", names=("x",), H=np.array([[[-1.0]]]))  # sign error
        return LinearProblem(residual=[[5.0 - x]], R=[[1.0]], blocks=(block,))

    found = gauss_newton(linearise)
    assert found.status is Status.DIVERGED
    assert found.iterations == 0


def test_an_unobservable_problem_is_a_status():
    def linearise(deviation):
        block = Block(name="x", names=("x", "y"), H=np.ones((3, 1, 2)))
        return LinearProblem(residual=np.ones((3, 1)), R=[[1.0]], blocks=(block,))

    found = gauss_newton(linearise)
    assert found.status is Status.NOT_OBSERVABLE
    assert "weakest combination" in found.message


def test_cost_is_chi2_at_no_deviation(make_problem):
    problem = make_problem(seed=2, z="both", state_prior="own")
    from nebosvod.estimation.problem.partition import Partition
    from nebosvod.estimation.problem.whitening import Whitener, whitened_rows

    rows = whitened_rows(problem, Partition.of(problem), Whitener.of(problem))
    assert cost(problem) == pytest.approx(np.sum(rows[:, :, Partition.of(problem).n_unknowns] ** 2), rel=1e-12)


def arctan(start, power=1.0):
    def linearise(deviation):
        x = start + deviation.get("x", 0.0)
        H = np.array([[[1.0 / (1.0 + x * x)]]])
        return LinearProblem(residual=[[-np.arctan(x)]], R=[[1.0]], blocks=(Block(name="x", names=("x",), H=H),))

    return linearise


@pytest.mark.parametrize("start", [1.4, 1.5, 2.0, 3.0, 10.0, -3.0, 1e3])
@pytest.mark.parametrize("limit", [3, 8, 10, 20, 60])
def test_undamped_steps_into_nowhere_have_not_converged(start, limit):
    """Undamped Gauss-Newton on arctan doubles away from |x| > 1.39; at 1e146 its steps are short in sigmas."""
    found = gauss_newton(arctan(start), damped=False, limit=limit)
    assert found.status in (Status.DIVERGED, Status.ITERATION_LIMIT, Status.NOT_OBSERVABLE)
    assert found.message == (found.estimate.message if found.estimate.solution is None else found.status.sentence)


def test_undamped_steps_that_do_come_down_have_converged():
    found = gauss_newton(arctan(1.2), damped=False)
    assert found.status is Status.CONVERGED
    assert 1.2 + found.deviation["x"] == pytest.approx(0.0, abs=1e-4)


def test_a_gain_of_its_own_may_end_above_the_least_squares_it_began_at():
    """Started at the minimum of the plain cost, Schmidt's gain, which knows the considered bias, has to climb."""
    from functools import partial

    from nebosvod.estimation.solvers import batch, sequential

    def linearise(deviation):
        x = 2.0 + deviation.get("x", 0.0)
        t = np.linspace(0.0, 1.0, 12)
        H = np.exp(0.05 * x) * np.ones(12) + t
        observed = 20.0 * np.exp(0.05 * 2.0) + 2.0 * t + 3.0 * (t < 0.5)
        return LinearProblem(
            residual=(observed - 20.0 * np.exp(0.05 * x) - x * t)[:, None],
            R=[[0.01]],
            blocks=(
                Block(name="x", names=("x",), H=H[:, None, None]),
                Block(name="b", names=("b",), H=1.0 * (t < 0.5)[:, None, None], treatment="considered"),
            ),
            priors=(
                Prior(name="x", names=("x",), covariance=np.array([[100.0]])),
                Prior(name="b", names=("b",), covariance=np.array([[9.0]])),
            ),
        )

    least = gauss_newton(linearise, solve=batch.solve)
    found = gauss_newton(
        linearise, start=least.deviation, solve=partial(sequential.solve, gain="schmidt"), damped=False
    )
    assert found.status is Status.CONVERGED
    assert found.cost[-1] > 1.5 * found.cost[0]
    assert abs(found.deviation["x"]) < 0.3 * abs(least.deviation["x"])  # the bias did not fool it


@pytest.mark.parametrize("damped", [True, False])
def test_a_step_out_of_the_domain_is_no_exception(damped):
    """log x from 3 towards 0.01: the first step leads to a negative x, where the model does not exist."""

    def linearise(deviation):
        x = 3.0 + deviation.get("x", 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            value = np.log(x)
        block = Block(name="x", names=("x",), H=np.array([[[1.0 / x]]]))
        return LinearProblem(residual=[[np.log(0.01) - value]], R=[[1.0]], blocks=(block,))

    found = gauss_newton(linearise, damped=damped, limit=40)
    if damped:
        assert found.status is Status.CONVERGED
        assert 3.0 + found.deviation["x"] == pytest.approx(0.01, rel=1e-3)
    else:
        assert found.status is Status.DIVERGED
        assert found.deviation["x"] == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_weights_that_go_with_the_point_do_not_stop_it(seed):
    """Angles to an object whose noise falls with its distance: the fixed point of reweighted least squares.

    The reference iterates whole steps in dense numpy, weights anew in each, until nothing moves.
    """
    rng = np.random.default_rng(seed)
    baselines = np.linspace(-1.0, 1.0, 9)
    sigma, place = 1e-4, 1e-2  # of an angle, and of the observer's position across the line of sight

    def angle(x):
        return np.arctan2(x[0] - baselines, x[1])

    def partials(x):
        square = (x[0] - baselines) ** 2 + x[1] ** 2
        return np.stack([x[1] / square, -(x[0] - baselines) / square], axis=1)

    def spread(x):
        return sigma**2 + place**2 / ((x[0] - baselines) ** 2 + x[1] ** 2)

    start = np.array([0.0, 60.0])
    observed = angle(start) + 3.0 * np.sqrt(spread(start)) * rng.standard_normal(9)

    def linearise(deviation):
        x = start + np.array([deviation.get("x", 0.0), deviation.get("y", 0.0)])
        distance = np.sqrt((x[0] - baselines) ** 2 + x[1] ** 2)
        return LinearProblem(
            residual=(observed - angle(x))[:, None],
            R=np.full((9, 1, 1), sigma**2),
            blocks=(Block(name="position", names=("x", "y"), H=partials(x)[:, None, :]),),
            white=(
                White(
                    name="place",
                    H=(1.0 / distance)[:, None, None],
                    Q=place**2 * np.eye(1),
                    rows=np.arange(9),
                    treatment="estimated",
                ),
            ),
        )

    x = start
    for _ in range(200):
        weight = 1.0 / spread(x)
        H = partials(x)
        x = x + np.linalg.solve((H.T * weight) @ H, (H.T * weight) @ (observed - angle(x)))
    found = gauss_newton(linearise, limit=100)
    assert found.status is Status.CONVERGED
    reached = start + np.array([found.deviation["x"], found.deviation["y"]])
    H = partials(x)
    factor = np.linalg.cholesky((H.T / spread(x)) @ H)
    assert np.linalg.norm(factor.T @ (reached - x)) < 1e-3  # sigmas
