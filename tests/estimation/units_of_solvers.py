"""Cases of units: factors, the batch, the recursive filters, the iteration around them, rejection."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from turned_units import MAKE, MIXED, STATE, case, numbers, problem, turned  # type: ignore[import-not-found]

from nebosvod.estimation import Block, LinearProblem, Prior, gauss_newton
from nebosvod.estimation.accuracy import refined as nuisance
from nebosvod.estimation.problem import square_root
from nebosvod.estimation.problem.reduction import reduced, solved
from nebosvod.estimation.solvers import batch, iteration, recursive, rejection, separated, sequential, tracked


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


def of_components(names, units):
    """Units of parameters, and of the components of a time-correlated nuisance by the number at their end, from 0."""
    known = {name for block in MAKE["problem"]().blocks for name in block.names}
    return np.array([units.of((name,))[0] if name in known else units.z[int(name.rsplit(" ", 1)[1])] for name in names])


@case("tracked.Moving", "tracked.Chain", "tracked.Track", "tracked.follow", "tracked.smoothed")
def tracked_filter(units):
    moving = tracked.Moving.of(problem(units, z="markov", state_prior="own"))
    u = of_components(moving.names, units)
    ahead = tracked.follow(moving)
    return {
        name: [
            track.mean / u,
            track.factor @ track.factor.transpose(0, 2, 1) / np.outer(u, u),
            track.innovation / units.m,
            track.spread @ track.spread.transpose(0, 2, 1) / np.outer(units.m, units.m),
        ]
        for name, track in (("ahead", ahead), ("smoothed", tracked.smoothed(moving, ahead)))
    }


@case("separated.solve_drifting", "separated.stages", "separated.Stages")
def two_stages_that_drift(units):
    given_problem = problem(units, z="markov", state_prior="own")
    found = separated.stages(given_problem)
    a, r = of_components(found.state, units), of_components(found.bias, units)
    return numbers(separated.solve_drifting(given_problem), units) | {
        "x0": [found.x0 / a, found.sigma_x0 / a],
        "V": found.V / a[:, None] * r,
        "stages' chi2": found.chi2,
    }


@case("reduction.reduced", "reduction.solved")
def rows_of_pairs(units):
    rng, u, m = np.random.default_rng(8), units.x[:4], units.m
    H, v = rng.normal(size=(30, 2, 4)), rng.normal(size=(30, 2))
    whitener = np.tile(np.array([[2.0, 0.0], [0.3, 1.5]]), (30, 1, 1))
    chosen = np.arange(30) % 4 > 0
    triangle, cost = reduced(H * m[:, None] / u, v * m, whitener / m, chosen, np.zeros((0, 5)))
    x, length = solved(triangle, 1e-13)
    return {"triangle": triangle * np.append(u, 1.0), "cost": cost, "x": x / u, "length": length}
