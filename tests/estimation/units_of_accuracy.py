"""Cases of units: budgets, bounds, ellipses, judges and scores."""

from dataclasses import replace
from typing import Any

import numpy as np
from turned_units import MIXED, STATE, case, numbers, problem  # type: ignore[import-not-found]

from nebosvod.estimation.accuracy import (
    addition,
    appearing,
    budget,
    conditional,
    consistency,
    correlation,
    elasticity,
    ellipse,
    extended,
    guaranteed,
    inside,
    mean_error,
    periodogram,
    polynomial,
    preposterior,
    recursive_residuals,
    repeated,
    reweighed,
    score,
    target_map,
    variance_components,
)
from nebosvod.estimation.accuracy import refined as nuisance
from nebosvod.estimation.filters import normal_places
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.problem import sources, subset
from nebosvod.estimation.solvers import batch, iteration, least_moduli


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


@case("elasticity.probability_budget", "elasticity.ProbabilityBudget", "elasticity.Elasticity",
      "elasticity.halving_weights")  # fmt: skip
def budget_of_a_probability(units):
    rng, sizes = np.random.default_rng(8), units.of(STATE)
    plain = {"noise": rng.normal(size=(4, 4)), "bias": rng.normal(size=(4, 1))}
    d = np.sum([rng.normal(size=(900, G.shape[1])) @ G.T for G in plain.values()], axis=0)
    parts = {name: G * sizes[:, None] for name, G in plain.items()}
    found = elasticity.probability_budget(d * sizes, d[:, 0] > 0.4, parts)
    told = [(row.value, row.error, row.share, row.halved, row.halved_error) for row in found.rows]
    assert found.line is not None
    return {"rows": told, "line": found.line / sizes, "sigmas": found.sigmas, "hits": found.effective_hits}


@case("preposterior.foresee", "preposterior.reweighed", "preposterior.Foreseen", "polynomial.Polynomial",
      "target_map.TargetMap")  # fmt: skip
def future_probabilities(units):
    """States are whitened and measurements in units of their noise; points of the target plane have a unit."""
    u, size = np.random.default_rng(9).standard_normal((900, 3)), units.length
    points = np.stack([3.0 * u[:, 0] + 0.1 * u[:, 1] ** 2, u[:, 2]], axis=1)
    hits = np.linalg.norm(points, axis=1) < 1.5
    target = target_map.TargetMap.of(u, points * size, hits, 1.5 * size)
    assert target is not None
    curve = polynomial.Polynomial.through(u * size, points, 2)
    found = preposterior.foresee(u, 3.0 * u[:, :2], hits, np.random.default_rng(1), 20, hit=target.hit)
    alone = preposterior.reweighed(np.zeros((1, 2)), u[:, :2], hits, np.ones(900), np.zeros(1, dtype=np.int64))
    return {
        "probability": found.probability,
        "effective": found.effective,
        "map": [target.radius / size, target.reach / size, target.error],
        "curve": curve.gradient(u[:2] * size) * size,
        "alone": alone,
    }


@case("refined.refine", "refined.response", "refined.NuisanceEstimate")
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
        gain = nuisance.response(given_problem, name, sources.measurement_gain(given_problem))
        out[f"{z} gain"] = gain * units.m / units.z[:, None, None]
    return out


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


@case("reweighed.responses", "reweighed.Response", "reweighed.scaled")
def responses(units):
    given_problem = problem(units, treatments=MIXED, z="both", truth=True, state_prior="own")
    found = batch.solve(given_problem)
    told = reweighed.responses(given_problem, found, found.names, batch.solve)
    assert len(told) > 3
    return {f"{source} {part}": getattr(one, part) for source, one in told.items() for part in ("shift", "growth")}


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


@case("conditional.regress", "conditional.Regression", "conditional.conditional_sigmas")
def regressions(units):
    rng = np.random.default_rng(3)
    u = units.x[:5]
    A = rng.normal(size=(5, 5))
    belief = Belief.of(0.1 * u, (A @ A.T + np.eye(5)) * np.outer(u, u))
    found = conditional.regress(belief, [3, 0], [1, 4])
    given = found.at(0.4 * u[[1, 4]])
    a, b = u[[3, 0]], u[[1, 4]]
    return {
        "slope": found.slope / a[:, None] * b,
        "mean": given.mean / a,
        "P": given.covariance / np.outer(a, a),
        "sigmas": conditional.conditional_sigmas(belief.factor) / u,
    }


@case("variance_components.estimate_components", "variance_components.Components", "variance_components.scaled",
      "least_moduli.solve", "least_moduli.LeastModuli")  # fmt: skip
def components_and_moduli(units):
    given_problem = problem(units, n=30)
    found = variance_components.estimate_components(given_problem, limit=20)
    moduli = least_moduli.solve(given_problem)
    u = units.of(moduli.names)
    return {
        "factors": found.factors,
        "sigma": found.sigma,
        "R": found.problem.R / np.outer(units.m, units.m),
        "mean": np.round(moduli.mean / u, 7),
        "factor": moduli.factor @ moduli.factor.T / np.outer(u, u),
        "cost": moduli.cost,
        "exact": moduli.exact.sum(),
    }


@case("correlation.roughly_worst")
def roughly_worst_correlation(units):
    t = np.cumsum(np.random.default_rng(5).uniform(0.5, 1.5, 20)) * units.time
    series = correlation.Series.of(np.cos(np.arange(20.0) * 2.0) * units.length, t, np.zeros(20, np.int64))
    return {"place": np.array(correlation.roughly_worst(series, np.array([3.0, 7.0]) * units.time)) * units.time}


@case("periodogram.Rhythm", "periodogram.strongest_rhythm", "periodogram.strongest_rhythms", "periodogram.rhythm_at",
      "periodogram.power")  # fmt: skip
def rhythms(units):
    rng, T, unit = np.random.default_rng(5), units.time, units.x[0]
    t = np.sort(rng.uniform(0.0, 50.0, 60))
    y = np.sin(2.0 * np.pi * t / 7.3) + 0.3 * rng.normal(size=60)
    both = [periodogram.strongest_rhythm(t * T, y * unit), periodogram.rhythm_at(t * T, y * unit, 7.3 * T)]
    return {
        "period": [np.array([one.period, one.shortest]) / T for one in both],
        "amplitude": [one.amplitude / unit for one in both],
        "power": [one.power for one in both],
        "chance": [np.log(one.chance) for one in both],
        "powers": periodogram.power(t * T, (y * unit)[:, None], 0.01 / T, 40),
    }


@case("recursive_residuals.recursive_residuals", "recursive_residuals.nothing_left_out")
def one_after_another(units):
    given_problem = problem(units, treatments=MIXED, z="white", state_prior="own")
    whole = recursive_residuals.nothing_left_out(given_problem)
    return {"w": recursive_residuals.recursive_residuals(whole), "chi2": batch.solve(whole).chi2}


@case("appearing.Ground", "appearing.Scan", "appearing.Scatter")
def biases_that_appear(units):
    ground = appearing.Ground.of(problem(units, z="white", state_prior="own", n=40))
    names = units.of(ground.names)
    out: dict[str, Any] = {}
    for kind, clusters in (("stated", None), ("seen", np.arange(30) // 3)):
        found = ground.scan(np.arange(5, 35), [5, 12, 20], clusters)
        assert found is not None
        b, P = found.estimate(found.best)
        out |= {
            f"{kind} statistics": found.statistics,
            f"{kind} bias": b / units.m,
            f"{kind} P": P / np.outer(units.m, units.m),
            f"{kind} shift": found.shift(1) / names,
            f"{kind} sigma": found.sigma / names,
            f"{kind} scatter": found.scatter.variance,
        }
    return out
