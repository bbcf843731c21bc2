"""Units change nothing: each component's unit times 1e-12 ... 1e12, in everything that is public in this folder.

A case computes numbers from a problem written in some units and returns them in the units of the reference, where all
sizes are about one. Two problems in different units must then agree to 1e-9. The last test holds the list complete.
"""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nebosvod.estimation import Block, Estimate, LinearProblem, Markov, Prior, White, gauss_newton
from nebosvod.estimation.accuracy import (
    addition,
    budget,
    consistency,
    ellipse,
    extended,
    guaranteed,
    inside,
    mean_error,
    repeated,
    score,
)
from nebosvod.estimation.accuracy import refined as nuisance
from nebosvod.estimation.filters import combined, consider, current_state, kalman, normal_places, smoother, two_stage
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.problem import sources, square_root, subset
from nebosvod.estimation.solvers import batch, iteration, recursive, rejection, separated, sequential

Array = npt.NDArray[np.float64]
Numbers = dict[str, object]
STATE = ("x", "y", "vx", "vy")


@dataclass(frozen=True)
class Units:
    """Values in the reference's units times these are values in the new ones."""

    x: Array  # (16,), of parameters, in their order
    z: Array  # (3,), of a fresh nuisance
    m: Array  # (2,), of a measurement's components
    length: float  # where several components share one unit
    time: float

    def of(self, names: tuple[str, ...]) -> Array:
        """Units of parameters by name, whatever the names."""
        return np.array([self.x[sum(map(ord, name)) % len(self.x)] for name in names])


def one(size: float) -> Units:
    return Units(np.full(16, size), np.full(3, size), np.full(2, size), size, size)


NONE = one(1.0)


def drawn(exponents: list[int]) -> Units:
    size = 10.0 ** np.array(exponents, dtype=float)
    return Units(size[:16], size[16:19], size[19:21], float(size[21]), float(size[22]))


EXPONENTS = st.lists(st.integers(-12, 12), min_size=23, max_size=23)
FIXED = [drawn(list(np.random.default_rng(seed).integers(-12, 13, 23))) for seed in range(4)] + [one(1e12), one(1e-12)]


def turned(problem: LinearProblem, units: Units) -> LinearProblem:
    """The same problem in other units."""
    m, z = units.m, units.z
    square = np.outer(m, m)

    def white(w: White) -> White:
        true = None if w.true_Q is None else w.true_Q * np.outer(z, z)
        return replace(w, H=w.H * m[:, None] / z, Q=w.Q * np.outer(z, z), true_Q=true)

    def markov(c: Markov) -> Markov:
        ratio, both = z[:, None] / z, np.outer(z, z)
        return replace(c, H=c.H * m[:, None] / z, F=c.F * ratio, Q=c.Q * both, P0=c.P0 * both)

    def prior(p: Prior) -> Prior:
        u = units.of(p.names)
        true = None if p.true_covariance is None else p.true_covariance * np.outer(u, u)
        assert p.mean is not None
        return replace(p, covariance=p.covariance * np.outer(u, u), mean=p.mean * u, true_covariance=true)

    def block(b: Block) -> Block:
        return replace(b, H=b.H * m[:, None] / units.of(b.names))

    return replace(
        problem,
        residual=problem.residual * m,
        R=problem.R * square,
        true_R=None if problem.true_R is None else problem.true_R * square,
        blocks=tuple(map(block, problem.blocks)),
        priors=tuple(map(prior, problem.priors)),
        white=tuple(map(white, problem.white)),
        markov=tuple(map(markov, problem.markov)),
    )


def numbers(found: Estimate, units: Units) -> Numbers:
    """Everything an estimate says."""
    names = found.names + found.left_out
    u, own = units.of(names), units.of(found.names)
    factors = found.predict(np.diag(1.0 / u), names).factors
    solution = found.solution
    assert solution is not None
    out: Numbers = {
        "mean": found.mean / own,
        "sigma": [found.sigma(name) / unit for name, unit in zip(names, u)],
        "formal": found.K_formal / np.outer(own, own),
        "true": found.K_true / np.outer(own, own),
        "factor": found.S_true / own[:, None],
        "joint": found.factor(names) / u[:, None],
        "shares": [share / np.outer(own, own) for share in found.shares.values()],
        "predicted": [G @ G.T for G in factors.values()],
        "gains": [
            M / u[:, None] * units.of(solution.gain_names[source]) for source, M in solution.gains.items()
        ],
        "shift": [
            found.shift(source, units.of(solution.gain_names[source])) / own for source in solution.gains
        ],
        "mean shift": found.mean_shift(
            {n: 0.3 * float(units.of((n,))[0]) for group in solution.gain_names.values() for n in group}, names
        ) / u,
        "chi2": found.chi2,
        "residual": found.residual_after / units.m,
        "condition": np.log(found.condition_number),
        "rank": found.rank,
        "weak": np.abs(list(found.weak_direction.values())),
        "shares of the state": [share.share for share in budget.shares(found, STATE[:1])],
    }  # fmt: skip
    return out


Case = Callable[[Units], Numbers]
CASES: dict[str, Case] = {}
COVERED: set[str] = set()


def case(*covers: str) -> Callable[[Case], Case]:
    """Register a case and the public names (module.name) it covers."""

    def register(function: Case) -> Case:
        CASES[function.__name__] = function
        COVERED.update(covers)
        return function

    return register


@pytest.fixture(scope="module", autouse=True)
def _builder(make_problem):
    MAKE["problem"] = make_problem


MAKE: dict[str, Callable[..., LinearProblem]] = {}


def problem(units: Units, **options: object) -> LinearProblem:
    return turned(MAKE["problem"](**({"seed": 4, "n": 20} | options)), units)


MIXED = {"c": "considered", "bias": "ignored"}


@case("batch.solve", "normal_equations.solve_blocks", "normal_equations.solve_identity", "sources.estimate_of")
def batch_ways(units):
    out: dict[str, Any] = {}
    for z in ("white", "markov", "both"):
        for state_prior in ("none", "joint"):
            given_problem = problem(units, z=z, state_prior=state_prior)
            for way in ("qr", "blocks", "identity"):
                found = numbers(batch.solve(given_problem, way), units)
                out |= {f"{z} {state_prior} {way} {key}": value for key, value in found.items() if key != "condition"}
    return out


@case("estimate.Estimate", "estimate.Prediction", "estimate.Solution", "partition.Partition", "whitening.Whitener")
def batch_treatments(units):
    out: dict[str, Any] = {}
    for treat in (MIXED, {"z": "considered"}, {"z": "ignored", "bias": "considered"}, {"c": "fixed"}):
        found = batch.solve(problem(units, treatments=treat, truth=True))
        out |= {f"{treat} {key}": value for key, value in numbers(found, units).items()}
    return out


@case("batch.solve", "sources.not_observable", "sources.weak_direction")
def batch_of_too_little(units):
    bare = problem(units)
    blocks = tuple(replace(b, H=b.H * 0.0) if b.name == "c" else b for b in bare.blocks)
    free = replace(bare, blocks=blocks, priors=tuple(p for p in bare.priors if p.name != "c"))
    found = batch.solve(free)
    return {"status": found.status == "not_observable", "rank": found.rank, "dof": found.dof}


@case("budget.unknown", "iteration.recentred")
def worlds_and_points(units):
    given_problem = problem(units, state_prior="own")
    unknown = budget.unknown(given_problem, "c")
    assert unknown is not None
    moved = iteration.recentred(given_problem, {"vy": 0.3 * units.of(("vy",))[0]})
    first, second = numbers(batch.solve(unknown), units), numbers(batch.solve(moved), units)
    return {f"unknown {key}": value for key, value in first.items() if key != "condition"} | {
        f"moved {key}": value for key, value in second.items() if key != "condition"
    }


@case("score.score_test", "score.Score", "score.sigmas")
def score_of_what_was_left_out(units):
    rng, sizes, new = np.random.default_rng(8), units.of(STATE), units.of(STATE[:2])
    B, G, q = rng.normal(size=(40, 2, 4)), rng.normal(size=(40, 2, 2)), rng.normal(size=(40, 2))
    q = q + G @ np.array([0.7, -0.4])
    q = q - (B.reshape(-1, 4) @ np.linalg.lstsq(B.reshape(-1, 4), q.ravel())[0]).reshape(q.shape)
    B, G = B / sizes, G / new
    flat, everyone, nights = B.reshape(-1, 4), np.ones(40, dtype=np.bool_), np.arange(40) // 2
    found = score.score_test(q, B, G, flat.T @ flat, flat.T @ q.ravel(), everyone, nights)
    assert found is not None
    told = [found.statistic, found.explained, found.scatter, found.significance, found.part(slice(0, 1))]
    return {"estimate": found.estimate / new, "covariance": found.covariance / np.outer(new, new), "told": told}


@case("recursive.solve", "recursive.follow", "estimate.History")
def recursive_filter(units):
    given_problem = problem(units, z="markov", state_prior="own")
    found = recursive.solve(given_problem)
    assert found.history is not None
    assert found.history.sigma is not None
    own = units.of(found.names)
    W = np.random.default_rng(1).normal(size=(2, 4)) / units.of(STATE)
    formal, true = recursive.follow(problem(units, treatments=MIXED, truth=True), W, STATE)
    late = slice(12, None)
    return numbers(found, units) | {
        "history": [found.history.sigma_formal[late] / own, found.history.sigma[late] / own],
        "followed": [formal[late], true[late]],
    }


@case("sequential.solve", "sequential.resolved", "sequential.as_printed_takes_afresh")
def sequential_gains(units):
    out: dict[str, Any] = {}
    for gain in ("formal", "schmidt"):
        for gate in (None, 0.9):
            found = sequential.solve(problem(units, treatments=MIXED, truth=True, state_prior="own"), gain, gate)
            out |= {f"{gain} {gate} {key}": value for key, value in numbers(found, units).items()}
            out[f"{gain} {gate} notes"] = len(found.notes)
    with pytest.warns(UserWarning, match="as fresh noise"):
        found = sequential.solve(problem(units, state_prior="own"), "as_printed")
    return out | {f"printed {key}": value for key, value in numbers(found, units).items()}


@case("separated.solve")
def two_stage_over_a_problem(units):
    return numbers(separated.solve(problem(units, z="both", state_prior="own")), units)


@case("refined.refine", "refined.NuisanceEstimate")
def refined(units):
    out: dict[str, Any] = {}
    for z in ("white", "markov"):
        given_problem = problem(units, z=z, state_prior="joint", q=3)
        found_problem = batch.solve(given_problem)
        name = (given_problem.white or given_problem.markov)[0].name
        found = nuisance.refine(given_problem, found_problem, name)
        own = units.of(found_problem.names)
        out |= {
            f"{z} mean": found.mean / units.z,
            f"{z} P": found.covariance / np.outer(units.z, units.z),
            f"{z} cross": found.cross / own[:, None] / units.z,
        }
    return out


@case("refined.refine", "markov.merge", "markov.accumulated", "markov.Chain", "markov.ChainFilter")
def a_chain_that_is_partly_known(units):
    """A component without error and one that stands still: the smoother of the nuisance meets a singular covariance."""
    given_problem = MAKE["problem"](seed=4, n=20, z="markov")
    chain = given_problem.markov[0]
    P0, F, Q = np.array(chain.P0), np.array(chain.F), np.array(chain.Q)
    P0[2], P0[:, 2], F[:, 0, 0] = 0.0, 0.0, 1.0
    Q[:, 2], Q[:, :, 2], Q[:, 0], Q[:, :, 0] = 0.0, 0.0, 0.0, 0.0
    chain = replace(chain, P0=P0, F=F, Q=Q)
    given_problem = turned(replace(given_problem, markov=(chain, *given_problem.markov[1:])), units)
    found_problem = batch.solve(given_problem)
    found = nuisance.refine(given_problem, found_problem, chain.name)
    return numbers(found_problem, units) | {
        "z": found.mean / units.z,
        "P": found.covariance / np.outer(units.z, units.z),
    }


@case(
    "budget.if_vanished", "budget.without", "budget.scaled", "budget.shares", "budget.group_shares",
    "budget.prediction_shares", "budget.Share", "budget.Vanished",
)  # fmt: skip
def budgets(units):
    given_problem = problem(units, treatments=MIXED, z="both")
    out: dict[str, Any] = {}
    for source in ("c", "bias A", "z A", "z B slow"):
        found = budget.if_vanished(given_problem, source, ("vy",))
        sizes = np.array([found.sigma, found.sigma_same_gain, found.sigma_new_gain])
        out[source] = sizes / units.of(("vy",))
    half = batch.solve(budget.scaled(given_problem, "noise A", 0.5))
    groups = budget.group_shares(half, {"x": ("x",)})["x"]
    return out | numbers(half, units) | {"group": [share.sigma / units.of(("x",))[0] for share in groups]}


@case("budget.noise_to_nuisance", "budget.critical_sigma", "budget.NoiseToNuisance")
def noise_and_nuisance(units):
    """Free of units by itself only where whitened; in one unit for all components everywhere."""
    whole = replace(units, m=np.full(2, units.length), z=np.full(3, units.time))
    found = budget.noise_to_nuisance(problem(whole, treatments=MIXED))
    whitened = budget.noise_to_nuisance(problem(units, treatments=MIXED)).eta_whitened_db
    return {"eta": found.eta_db, "whitened": whitened, "critical": found.sigma_critical / units.time}


@case("sources.measurement_gain", "repeated.Repeated", "mean_error.shift")
def gains_of_the_measurements(units):
    given_problem = problem(units, z="markov", treatments=MIXED)
    found = batch.solve(given_problem)
    own = units.of(found.names)
    gain = sources.measurement_gain(given_problem) * units.m[:, None] / own
    many = np.random.default_rng(3).normal(size=(5, 20, 2))
    means = repeated.Repeated.of(given_problem, found).means(many * units.m) / own
    off = {"c1": 0.4 * float(units.of(("c1",))[0]), "noise A": 0.2 * units.m, "z A slow": 0.1 * units.z}
    shift = mean_error.shift(given_problem, off)
    return {"gain": gain, "means": means, "shift": [shift[n] / float(units.of((n,))[0]) for n in shift]}


@case("repeated.Innovations", "repeated.first_determined", "subset.subset")
def innovations(units):
    given_problem = problem(units, n=30, treatments=MIXED, truth=True, state_prior="own")
    prepared = repeated.Innovations.of(given_problem)
    assert prepared is not None
    formal, true = prepared.squares(np.random.default_rng(3).normal(size=(3, 30, 2)) * units.m)
    bare = problem(units, n=30, state_prior="none")
    some = batch.solve(subset.subset(problem(units, z="markov"), np.arange(20) % 3 > 0))
    return {"formal": formal, "true": true, "first": repeated.first_determined(bare)} | numbers(some, units)


@case(
    "addition.additions", "addition.gains", "addition.predicted", "addition.take", "addition.Belief",
    "addition.Additions",
)  # fmt: skip
def additions(units):
    given_problem = problem(units, treatments=MIXED, truth=True, state_prior="own")
    belief = addition.Belief.of(batch.solve(given_problem))
    u = units.of(belief.names)
    added = addition.additions(given_problem)
    K, _ = addition.gains(belief, added)
    W = np.eye(len(u))[:3] / u[:3, None]
    after = addition.take(belief, added, 7)
    factors = addition.predicted(belief, added, W)
    size = len(belief.S)
    return {
        "gain": K / u[:size, None],
        "predicted": factors @ factors.transpose(0, 2, 1),
        "S": (after.S @ after.S.T) / np.outer(u[:size], u[:size]),
        "G": (after.G @ after.G.T) / np.outer(u, u),
    }


@case("normal_places.condense", "normal_places.combine", "normal_places.GaussFilter", "normal_places.NormalPlace")
def condensed(units):
    given_problem = problem(units, z="white", state_prior="joint")
    early = np.arange(20) < 9
    arcs = [normal_places.condense(subset.subset(given_problem, keep)) for keep in (early, ~early)]
    found = batch.solve(normal_places.combine(arcs, given_problem))
    own, gauss = units.of(found.names), normal_places.GaussFilter.start(4)
    other, state = normal_places.GaussFilter.start(4), given_problem.blocks[0].H
    for k in range(20):
        H, v, R = state[k], given_problem.residual[k], given_problem.R[k]
        gauss, other = (gauss.add(v, H, R), other) if k % 2 else (gauss, other.add(v, H, R))
    x, S, chi2 = (gauss + other).solution()
    u = units.of(STATE)
    return {
        "mean": found.mean / own,
        "K": found.K_true / np.outer(own, own),
        "chi2": [found.chi2, chi2],
        "gauss": x / u,
        "gauss K": S @ S.T / np.outer(u, u),
    }


@case("extended.klaus", "extended.bias_imitates", "extended.Klaus")
def klaus(units):
    found = extended.bias_imitates(problem(units, z="white"), "state", "bias A")
    u = units.of(STATE)
    assert found.covariance is not None
    return {
        "K": found.covariance / np.outer(u, u),
        "number": found.condition_number,
        "direction": np.abs(list(found.direction.values())),
    }


@case("extended.worst_prediction", "extended.worst_correlation", "extended.WorstCorrelation", "correlation.worst",
      "correlation.Series")  # fmt: skip
def worst_correlation(units):
    t = np.cumsum(np.random.default_rng(5).uniform(0.5, 1.5, 20)) * units.time
    given_problem = problem(units, z="white", state_prior="own")
    inside_names = batch.solve(given_problem).names
    W = np.eye(len(inside_names))[:3] / units.of(inside_names)
    found = extended.worst_prediction(given_problem, W, t)
    single = extended.worst_correlation(np.cos(np.arange(20.0) * 2.0) * units.length, t)
    return {
        "sigma": [[w.sigma, w.sigma_white, w.bound] for w in found],
        # of a maximum, which is flat: a ten-millionth of its place is all that can be told
        "frequency": [1e-3 * w.frequency_rad_per_s * units.time for w in found],
        "single": np.array([single.sigma, single.sigma_white, single.bound]) / units.length,
    }


@case("extended.few_measurements", "extended.base_bound", "extended.FewMeasurements")
def few_measurements(units):
    rng = np.random.default_rng(1)
    U, sigma, p, u = rng.normal(size=(9, 3)), rng.uniform(0.5, 2.0, 9), rng.normal(size=3), units.x[:3]
    rows = np.resize(units.m, 9)
    found = extended.few_measurements(U * rows[:, None] / u, sigma * rows, p / u * units.length)
    S = extended.base_bound(U * rows[:, None] / u, sigma * rows, found.rows) / u[:, None]
    return {
        "bound": np.array([found.bound, found.bound_all]) / units.length,
        "rows": found.rows,
        "weights": found.weights * rows / units.length,
        "base": S @ S.T,
    }


@case("guaranteed.bound", "guaranteed.largest_error", "guaranteed.Bounds", "guaranteed.extreme",
      "guaranteed.polytope", "guaranteed.Polytope", "zonogon.largest", "zonogon.Segments")  # fmt: skip
def guaranteed_bounds(units):
    given_problem = problem(units, n=10, z="white", state_prior="own")
    u = units.of(("vx", "c1"))
    W = np.array([[1.0, 0.0], [0.5, -1.0]]) / u * units.length
    found = guaranteed.bound(given_problem, W, ("vx", "c1"))
    worst = guaranteed.largest_error(given_problem, W, ("vx", "c1"))
    rows, x = np.array([1.0, 2.0]), units.x[:2]
    square = guaranteed.polytope(
        np.array([[1.0, 1.0], [1.0, -1.0]]) * units.m[:, None] / x, rows * units.m, np.array([0.2, 0.1]) * units.m
    )
    corner = guaranteed.extreme(square, np.diag(1.0 / x))
    return {
        "bounds": np.array([found.lower, found.upper, worst]) / units.length,
        "consistent": [found.consistent, found.inflation, corner.consistent],
        "gap": found.duality_gap < 1e-6 and corner.duality_gap < 1e-6,
        "corner": [corner.lower, corner.upper],
    }


@case("iteration.gauss_newton", "iteration.cost", "iteration.step_length", "iteration.IterationResult")
def iterated(units):
    beacons = np.array([[0.0, 0.0], [10.0, 0.0], [3.0, 8.0], [-5.0, 2.0]])
    u, m = units.x[:2], units.length
    observed = np.linalg.norm(beacons - [4.0, 3.0], axis=1)

    def linearise(deviation):
        x = np.array([6.0, 6.0]) + np.array([deviation.get("a", 0.0), deviation.get("b", 0.0)]) / u
        distance = np.linalg.norm(x - beacons, axis=1)
        H = ((x - beacons) / distance[:, None])[:, None, :] * m / u
        prior = Prior(name="prior", names=("a", "b"), covariance=np.diag(u**2), mean=0.3 * u)
        block = Block(name="position", names=("a", "b"), H=H)
        return LinearProblem(
            residual=(observed - distance)[:, None] * m, R=[[0.01 * m**2]], blocks=(block,), priors=(prior,)
        )

    out: dict[str, Any] = {}
    for damped in (True, False):
        found = gauss_newton(linearise, damped=damped, tolerance=1e-10)
        out |= {
            f"{damped} x": np.array(list(found.deviation.values())) / u,
            f"{damped} cost": found.cost,
            f"{damped} status": found.status == "converged",
            f"{damped} steps": found.steps,
        }
    start = linearise({})
    length = iteration.step_length(batch.solve(start))
    return out | {"cost": iteration.cost(start), "length": length}


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
      "two_stage.update", "two_stage.BiasTest", "two_stage.BiasInnovation")  # fmt: skip
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
        out |= {
            f"{name} x": stage.x / u,
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


@case("ellipse.Ellipse", "ellipse.Ellipsoid", "ellipse.sigma_along", "ellipse.normalized_distance",
      "ellipse.maximum_deviation", "ellipse.probability", "ellipse.level_of", "inside.inside_disc",
      "inside.inside_ellipse")  # fmt: skip
def ellipses(units):
    size, u = units.length, units.x[:3]
    rng = np.random.default_rng(9)
    L, wide = rng.normal(size=(2, 2)), rng.normal(size=(3, 5))
    plane = ellipse.Ellipse.of_covariance(L @ L.T * size**2, level=2.0)
    flat = ellipse.Ellipse.of_factor(np.array([[1.0], [2.0]]) * size)
    body = ellipse.Ellipsoid.of_factor(wide * size)
    return {
        "axes": [*(plane.semi_axes / size), *(flat.semi_axes / size), *(body.semi_axes / size)],
        "angle": [plane.angle_rad, flat.angle_rad],
        "probability": [plane.probability, body.probability, ellipse.level_of(0.5), ellipse.probability(1.0)],
        "outline": plane.at(1.0).points(9) / size,
        "along": ellipse.sigma_along(wide * size, [1.0, 2.0, 3.0]) / size,
        "distance": ellipse.normalized_distance(wide * u[:, None], np.ones(3) * u),
        "deviation": ellipse.maximum_deviation(u, 0.5 * u) / u,
        "disc": inside.inside_disc(np.array([0.5, 0.2]) * size, L * size, 1.3 * size),
        "ellipse": inside.inside_ellipse(np.array([0.5, 0.2]) * size, L * size, plane),
    }


@case("consistency.nees", "consistency.judge", "consistency.coverage", "consistency.residual_pattern",
      "consistency.Consistency", "consistency.Pattern", "consistency.binomial_interval")  # fmt: skip
def judged(units):
    rng = np.random.default_rng(10)
    u = units.x[:4]
    A = rng.normal(size=(4, 4))
    K = A @ A.T + 0.1 * np.eye(4)
    errors = rng.multivariate_normal(np.zeros(4), K, 60)
    L = np.linalg.cholesky(K)
    verdict = consistency.judge(errors * u, L * u[:, None])
    each = consistency.nees(errors * u, np.stack([L * u[:, None]] * 60))
    pattern = consistency.residual_pattern(errors[:, 0] * units.length)
    return {
        "nees": each,
        "mean": verdict.nees_mean,
        "variances": verdict.variances,
        "consistent": verdict.consistent,
        "coverage": consistency.coverage(errors * u, L * u[:, None], 2.0),
        "pattern": [pattern.runs, pattern.runs_p, pattern.whiteness, pattern.whiteness_p],
    }


@case("rejection.chi_squared", "rejection.reselect", "rejection.settled", "rejection.Thresholds")
def rejected(units):
    given_problem = problem(units, z="white", state_prior="own")
    found = batch.solve(given_problem)
    H = np.concatenate([block.H for block in given_problem.blocks], axis=2)
    selected = np.arange(20) % 4 > 0
    chi2 = rejection.chi_squared(found.residual_after, given_problem.R, H, found.S_formal, selected)
    kept = rejection.reselect(chi2, selected, rejection.Thresholds(reject=3.0, recover=1.0, fudge=0.0), 5)
    return {"chi2": chi2, "kept": kept}


@case("square_root.covariance_factor", "square_root.lower_factor", "square_root.gram_factor",
      "square_root.append_rows", "square_root.solve_upper", "square_root.solve_lower", "square_root.solve_square",
      "square_root.solve_positive",
      "square_root.solve_covariance", "square_root.left_inverse", "square_root.row_units", "square_root.whiten",
      "square_root.conditioning", "square_root.Conditioning", "square_root.cholesky_rows", "square_root.root_rows",
      "square_root.solve_rows", "square_root.solve_rows_transposed", "square_root.multiply_rows")  # fmt: skip
def factors(units):
    rng = np.random.default_rng(11)
    u = units.x[:5]
    A = rng.normal(size=(5, 5))
    K = A @ A.T + 0.1 * np.eye(5)
    thin = rng.normal(size=(5, 3))
    rows, right = rng.normal(size=(30, 5)), rng.normal(size=(5, 2))
    stack = np.stack([K, np.diag(np.diag(K)), thin @ thin.T])
    both = np.outer(u, u)
    flat = square_root.covariance_factor(thin @ thin.T * both, "thin")
    triangle = square_root.append_rows(np.zeros((0, 5)), rows / u)
    condition = square_root.conditioning(triangle)
    roots = square_root.root_rows(stack * both)
    regular = square_root.cholesky_rows(stack[:2] * both, "stack")
    low = np.array(np.broadcast_to(right * u[:, None], (2, 5, 2)))
    square_root.solve_rows(regular, low)
    square_root.solve_rows_transposed(regular, low)
    L = square_root.covariance_factor(K * both, "K")
    lower = square_root.lower_factor(thin * u[:, None])
    return {
        "factor": L / u[:, None],
        "thin": (flat @ flat.T) / both,
        "rank": flat.shape[1],
        "lower": (lower @ lower.T) / both,
        "normal": (triangle.T @ triangle) * both,
        "condition": [condition.number, condition.rank],
        "direction": np.abs(condition.direction) / u,
        "roots": (roots @ roots.transpose(0, 2, 1)) / both,
        "regular": regular / u[:, None],
        "rows": low * u[:, None],
        "multiplied": square_root.multiply_rows(regular, 1.0 / np.broadcast_to(right, (2, 5, 2))
                                                / u[:, None] ** 0) / u[:, None],
        "solved": [
            square_root.solve_square(A * u[:, None] / u[::-1], right * u[:, None]) / u[::-1, None],
            square_root.solve_square(K * both, right * u[:, None]) * u[:, None],
            square_root.solve_positive(K * both, right * u[:, None]) * u[:, None],
            square_root.solve_covariance(K * both, right * u[:, None]) * u[:, None],
            square_root.solve_lower(L, right * u[:, None]),
            square_root.solve_upper(L.T, right) * u[:, None],
        ],
        "inverse": square_root.left_inverse(thin * u[:, None]) * u,
        "white": square_root.whiten(thin * u[:, None], (thin @ np.ones(3)) * u),
        "units": square_root.row_units(thin * u[:, None]) / u,
    }  # fmt: skip


def agree(name: str, units: Units) -> None:
    """The case in these units gives the numbers of the reference."""
    wanted, found = CASES[name](NONE), CASES[name](units)
    for key, value in wanted.items():
        for first, second in zip(flat(value), flat(found[key]), strict=True):
            np.testing.assert_allclose(second, first, rtol=1e-9, atol=1e-9, err_msg=f"{name}: {key}")


def flat(value: object) -> list[Array]:
    if isinstance(value, (list, tuple)):
        return [one_array for part in value for one_array in flat(part)]
    return [np.asarray(value, dtype=np.float64)]


@pytest.mark.parametrize("units", FIXED, ids=["a", "b", "c", "d", "all times 1e12", "all times 1e-12"])
@pytest.mark.parametrize("name", CASES)
def test_units_change_nothing(name: str, units: Units) -> None:
    agree(name, units)


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(exponents=EXPONENTS)
def test_any_units_change_nothing(name: str, exponents: list[int]) -> None:
    agree(name, drawn(exponents))


# What has no numbers of its own to turn: descriptions of a problem, words, and helpers that a covered function calls.
WITHOUT = {
    "problem.Block", "problem.Prior", "problem.White", "problem.Markov", "problem.LinearProblem", "problem.readonly",
    "estimate.Status", "partition.CommonSource", "sources.Solved", "sources.residual_after", "sources.prior_draws",
    "rejection.turning", "recursive.mismatched",
    "formed.formed", "formed.definite", "formed.matrices", "formed.matrix_of", "score.among", "score.alone",
    "batch.prior_rows", "batch.solved_triangle", "whitening.chunks", "whitening.add_white", "whitening.projected",
    "whitening.whitened_rows", "whitening.raw_rows",
}  # fmt: skip


def test_every_public_name_of_the_folder_is_covered() -> None:
    public = set()
    stage = Path(batch.__file__).parent.parent
    for path in sorted(stage.rglob("*.py")):
        if path.stem == "__init__":
            continue
        module = import_module(f"nebosvod.estimation.{path.parent.name}.{path.stem}")
        for name, thing in vars(module).items():
            own = getattr(thing, "__module__", None) == module.__name__
            if own and not name.startswith("_") and (inspect.isfunction(thing) or inspect.isclass(thing)):
                public.add(f"{path.stem}.{name}")
    assert not public - COVERED - WITHOUT
    assert not COVERED - public
