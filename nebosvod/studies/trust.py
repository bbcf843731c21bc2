"""Do the errors of many runs look as a covariance says? One verdict for each estimator and each covariance it has.

Every test works on normalised errors z = S^-1 e (unit variance, independent, if the covariance is right): mean NEES,
variance of each whitened component, of each direction a reader knows (radial, along the track, normal; parameters)
and of each predicted quantity, coverage, Cramer-von Mises, NIS of each telescope. The family of all tests of one
verdict is held at one level by Holm's rule; intervals are Bonferroni's.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from nebosvod.estimation.accuracy.consistency import binomial_interval
from nebosvod.estimation.problem.square_root import lower_factor, solve_square

Array = npt.NDArray[np.float64]
LEVELS = (0.5, 0.9, 0.99)
QUANTILES = 99


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Direction:
    """A linear combination of errors that has a name.

    Attributes
    ----------
    group : "position", "velocity", "parameter" or the name of a prediction.
    name : of the direction inside the group, as in "sigma is optimistic by 12 % <name>".
    unit : of the combination.
    weights : (s + s_j,) by estimated parameters, then those left out.
    """

    group: str
    name: str
    unit: str
    weights: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Claim:
    """A covariance on trial.

    Attributes
    ----------
    factor : (s + s_j, r), or (N, s + s_j, r) where every run has its own; the parameters left out have rows of zero
        in a formal one.
    nis : (N, telescopes), mean normalised square of the innovations; nan where there is none.
    independent : whether the innovations are independent under the claim (they are what the estimator believes).
    nis_components : (telescopes,) how many components each mean is over.
    """

    factor: Array
    nis: Array
    nis_components: Array
    independent: bool


NAMED = {  # the tests of no single direction, and what their number is
    "nees": "NEES/6 (1 expected)",
    "whitened": "variance of whitened component {component} (1 expected)",
    "prediction": "NEES of a prediction (1 expected)",
    "coverage": "share of errors inside their ellipsoid",
    "cramer_von_mises": "Cramer-von Mises statistic of the NEES",
    "nis": "NIS (1 expected)",
}


def judge(
    errors: Array, claim: Claim, directions: Sequence[Direction], state: Array, telescopes: Sequence[str], level: float
) -> dict[str, Any]:
    """Judge errors (N, s + s_j) against a claimed covariance; every number of the verdict.

    Parameters
    ----------
    state : (6, s + s_j), the state on radial, transverse, normal axes.
    level : family error of all tests together.
    """
    white = _normalised(errors @ state.T, state @ claim.factor)
    squares = np.sum(white**2, axis=1)
    runs, size = white.shape
    rows: list[dict[str, Any]] = [{"test": "nees", **_variance(squares / size, runs * size)}]
    rows += [_component(white, k) for k in range(size)]
    rows += list(_directions(errors, claim.factor, directions))
    rows += list(_predictions(errors, claim.factor, directions))
    rows += [_coverage(squares, size, fraction) for fraction in LEVELS]
    rows.append(_cramer_von_mises(squares, size))
    rows += list(_innovations(claim, telescopes))
    _hold_family(rows, level)
    return _arranged(rows, squares, size, runs, level)


def _normalised(errors: Array, factor: Array) -> Array:
    """z = S^-1 e for errors (N, d) and a wide factor (d, r) or (N, d, r)."""
    if factor.ndim == 2:
        return solve_square(lower_factor(factor), errors.T).T
    each = [solve_square(lower_factor(one), error) for one, error in zip(factor, errors)]
    return np.array(each)


def _variance(squares: Array, freedom: int) -> dict[str, Any]:
    """Two-sided chi-square test of a mean square that should be 1."""
    value, total = float(squares.mean()), float(squares.mean()) * freedom
    tail = min(float(stats.chi2.cdf(total, freedom)), float(stats.chi2.sf(total, freedom)))
    return {"value": value, "p": min(1.0, 2.0 * tail), "freedom": freedom}


def _component(white: Array, k: int) -> dict[str, Any]:
    return {"test": "whitened", "component": k + 1, **_variance(white[:, k] ** 2, len(white))}


def _directions(errors: Array, factor: Array, directions: Sequence[Direction]) -> Iterator[dict[str, Any]]:
    """Each direction by itself: the sigma claimed and the sigma seen."""
    for one in directions:
        sigma = np.linalg.norm(one.weights @ factor, axis=-1)
        if not np.all(sigma > 0.0):
            continue  # held exactly: there is no sigma to judge
        error = errors @ one.weights
        row = _variance((error / sigma) ** 2, len(error))
        yield {
            "test": "direction",
            "group": one.group,
            "name": one.name,
            "unit": one.unit,
            "sigma_claimed": float(np.sqrt(np.mean(sigma**2))),
            "sigma_sample": float(np.sqrt(np.mean(error**2))),
            "mean_error": float(error.mean()),
            **row,
        }


def _predictions(errors: Array, factor: Array, directions: Sequence[Direction]) -> Iterator[dict[str, Any]]:
    """Predictions of several components as a whole."""
    for group in dict.fromkeys(one.group for one in directions):
        W = np.array([one.weights for one in directions if one.group == group])
        if group in ("position", "velocity", "parameter") or len(W) < 2:
            continue
        white = _normalised(errors @ W.T, W @ factor)
        yield {"test": "prediction", "group": group, **_variance(np.mean(white**2, axis=1), white.size)}


def _coverage(squares: Array, size: int, fraction: float) -> dict[str, Any]:
    """How many runs lie inside the ellipsoid that should hold a fraction of them."""
    inside = int(np.count_nonzero(squares <= stats.chi2.ppf(fraction, size)))
    p = float(stats.binomtest(inside, len(squares), fraction).pvalue)
    low, high = binomial_interval(inside, len(squares))
    return {
        "test": "coverage",
        "fraction": fraction,
        "value": inside / len(squares),
        "value_interval_99": [low, high],
        "p": p,
        "freedom": len(squares),
    }


def _cramer_von_mises(squares: Array, size: int) -> dict[str, Any]:
    """The whole distribution of the NEES against chi-square."""
    found = stats.cramervonmises(stats.chi2.cdf(squares, size), "uniform")
    return {"test": "cramer_von_mises", "value": float(found.statistic), "p": float(found.pvalue)}


def _innovations(claim: Claim, telescopes: Sequence[str]) -> Iterator[dict[str, Any]]:
    """NIS of each telescope: chi-square if the innovations are independent, else by the scatter of the runs."""
    for number, name in enumerate(telescopes):
        mean = claim.nis[:, number]
        if not np.isfinite(mean).all():
            continue
        if claim.independent:
            row = _variance(mean, len(mean) * int(claim.nis_components[number]))
        else:
            error = float(mean.std(ddof=1) / np.sqrt(len(mean)))
            p = 2.0 * float(stats.t.sf(abs(mean.mean() - 1.0) / error, len(mean) - 1)) if error > 0.0 else 1.0
            row = {"value": float(mean.mean()), "p": p, "error": error, "freedom": len(mean) - 1}
        yield {"test": "nis", "telescope": name, **row}


def _hold_family(rows: list[dict[str, Any]], level: float) -> None:
    """Mark what Holm's rule rejects and add the interval of each test at Bonferroni's level, in place."""
    count = len(rows)
    for rank, row in enumerate(sorted(rows, key=lambda row: row["p"])):
        if row["p"] >= level / (count - rank):
            break
        row["rejected"] = True
    for row in rows:
        row.setdefault("rejected", False)
        row["interval"] = _interval(row, level / count)


def _interval(row: Mapping[str, Any], level: float) -> list[float]:
    """Where the value of a test lies with probability 1 - level when the claim is right."""
    if "fraction" in row:
        low, high = stats.binom.interval(1.0 - level, row["freedom"], row["fraction"])
        return [float(low) / row["freedom"], float(high) / row["freedom"]]
    if row["test"] == "cramer_von_mises":
        return [0.0, _largest_statistic(level)]
    if "error" in row:
        reach = float(stats.t.isf(0.5 * level, row["freedom"])) * row["error"]
        return [1.0 - reach, 1.0 + reach]
    freedom = row["freedom"]
    return [float(stats.chi2.ppf(q, freedom)) / freedom for q in (0.5 * level, 1.0 - 0.5 * level)]


def _largest_statistic(level: float) -> float:
    """Limit of the Cramer-von Mises statistic for a small level.

    It is sum z_k^2 / (k pi)^2; the tail is that of its first term times prod_(k>1) (1 - 1/k^2)^(-1/2) = sqrt 2.
    """
    return float(stats.chi2.isf(level / np.sqrt(2.0), 1)) / float(np.pi) ** 2


def _arranged(rows: list[dict[str, Any]], squares: Array, size: int, runs: int, level: float) -> dict[str, Any]:
    """The rows by test, the verdict in words first."""
    by: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        by.setdefault(row.pop("test"), []).append(_finished(row))
    rejected = sum(row["rejected"] for group in by.values() for row in group)
    directions = by.get("direction", [])
    grid = np.arange(1, QUANTILES + 1) / (QUANTILES + 1.0)
    return {
        "consistent": rejected == 0,
        "verdict": verdict(directions, rejected, len(rows), runs, failed(by), level),
        "family_level": level,
        "n_tests": len(rows),
        "n_rejected": rejected,
        "resolution_percent": _resolution(runs, level / len(rows)),
        "nees": by["nees"][0],
        "cramer_von_mises": by["cramer_von_mises"][0],
        "coverage": by["coverage"],
        "whitened": by["whitened"],
        "directions": directions,
        "predictions": by.get("prediction", []),
        "nis": by.get("nis", []),
        "nees_quantiles": {
            "probability": grid.tolist(),
            "sample": np.quantile(squares, grid).tolist(),
            "chi_square": stats.chi2.ppf(grid, size).tolist(),
        },
    }


def _finished(row: dict[str, Any]) -> dict[str, Any]:
    """Drop what only the tests needed; say a wrong sigma in percent."""
    row.pop("error", None)
    row.pop("freedom", None)
    if "sigma_claimed" in row:
        row["optimism_percent"] = 100.0 * (row["value"] ** 0.5 - 1.0)
    return row


def _resolution(runs: int, level: float) -> float:
    """A sigma wrong by so many percent lies outside its interval as often as not."""
    return float(100.0 * (np.sqrt(stats.chi2.ppf(1.0 - 0.5 * level, runs) / runs) - 1.0))


def failed(by: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[str]:
    """The tests of no single direction that were rejected, in words."""
    said = []
    for test, words in NAMED.items():
        for row in by.get(test, ()):
            if row["rejected"]:
                what = words.format(**row) if "{" in words else words
                said.append(f"{what} {row['value']:.3g}")
    return said


def verdict(
    directions: Sequence[Mapping[str, Any]],
    rejected: int,
    tests: int,
    runs: int,
    others: Sequence[str] = (),
    level: float = 0.01,
) -> str:
    """One sentence: consistent, or which sigma is wrong, by how much and where; worst directions first."""
    if not rejected:
        return f"no sigma is wrong: all {tests} tests of {runs} runs passed"
    wrong = sorted((row for row in directions if row["rejected"]), key=lambda row: -abs(np.log(row["value"])))
    chance = (
        f"; one right covariance in {1.0 / level:.0f} fails so by chance, more --runs tell" if rejected == 1 else ""
    )
    if not wrong:
        listed = ", ".join(others[:4]) + (f" and {len(others) - 4} more" if len(others) > 4 else "")
        return f"{rejected} of {tests} tests failed, none of them in a single direction: {listed}{chance}"
    said = [f"{amount(row['optimism_percent'])} {place(row)}" for row in wrong[:3]]
    more = f", and {len(wrong) - 3} more" if len(wrong) > 3 else ""
    return "sigma is " + "; ".join(said) + more + chance


def amount(optimism_percent: float) -> str:
    """'optimistic by 12 %', or a factor where percent would be silly."""
    ratio = 1.0 + optimism_percent / 100.0
    word, factor = ("optimistic", ratio) if ratio > 1.0 else ("pessimistic", 1.0 / max(ratio, 1e-300))
    if factor >= 2.0:
        return f"{word} by a factor of {factor:.3g}"
    return f"{word} by {abs(optimism_percent):.2g} %"


def place(row: Mapping[str, Any]) -> str:
    """Where, in words: 'along the track (position)', 'in radius_m', 'in xi of encounter'."""
    if row["group"] in ("position", "velocity"):
        return f"{row['name']} ({row['group']})"
    return f"in {row['name']}" if row["group"] == "parameter" else f"in {row['name']} of {row['group']}"
