"""What can be read off the table of a study: the point that is looked for, trade-offs, slopes, sensitivities."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.studies.population import SEEN, interval
from nebosvod.studies.question import Search, Study

Array = npt.NDArray[np.float64]
Columns = Mapping[str, npt.NDArray[Any]]
RESAMPLES = 400
INTERVAL = (0.025, 0.975)
ENOUGH = 16  # base points for an interval


def found_point(study: Study, columns: Columns) -> dict[str, Any] | None:
    """The row that keeps every condition with the best objective, or what comes nearest where none does."""
    search = study.search
    if search is None:
        return None
    objective = np.asarray(columns[search.objective], dtype=float)
    kept = np.isfinite(objective)
    for one in search.conditions:
        kept &= np.asarray(one.holds(np.asarray(columns[one.name], dtype=float)), dtype=bool)
    row: dict[str, Any] = {
        "objective": search.objective,
        "direction": "minimise" if search.least else "maximise",
        "cost": search.cost.text if search.cost is not None else None,
        "where": [{"name": one.name, "condition": one.text} for one in search.conditions],
        "n_feasible": int(np.count_nonzero(kept)),
    }
    if not kept.any():
        return row | {"found": False, "row": None, "values": None, "reason": _why_none(search, columns)}
    ranked = np.where(kept, objective if search.least else -objective, np.inf)
    best = int(np.argmin(ranked))
    return row | {"found": True, "row": best, "values": _values(study, columns, best), "reason": None}


def _values(study: Study, columns: Columns, row: int) -> dict[str, Any]:
    names = [axis.name for axis in study.axes] + [one.name for one in study.answers if not one.shares]
    names += ["cost"] if "cost" in columns else []
    return {name: _plain(columns[name][row]) for name in names}


def _plain(value: Any) -> Any:
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return str(value)


def _why_none(search: Search, columns: Columns) -> str:
    """Which condition keeps all points away, and how near they come."""
    said = []
    for one in search.conditions:
        values = np.asarray(columns[one.name], dtype=float)
        good = values[np.isfinite(values)]
        if not good.size:
            said.append(f"{one.name} has no value at any point")
        elif not np.any(one.holds(good)):
            best = float(good.min() if one.sign in ("<", "<=") else good.max())
            said.append(f"{one.name} {one.text} at no point (the nearest has {best:.4g})")
    return "; ".join(said) or "each condition is kept somewhere, all of them together nowhere"


def pareto(study: Study, columns: Columns) -> dict[str, Any] | None:
    """Points that no other one beats in the objective and in the first condition's number at once."""
    search = study.search
    if search is None:
        return None
    other = next((one for one in search.conditions if one.name != search.objective), None)
    if other is None:
        return None
    x = np.asarray(columns[search.objective], dtype=float) * (1.0 if search.least else -1.0)
    y = np.asarray(columns[other.name], dtype=float) * (1.0 if other.sign in ("<", "<=") else -1.0)
    return {
        "objective": search.objective,
        "against": other.name,
        "condition": other.text,
        "limit": other.limit,
        "rows": front(x, y),
    }


def front(x: Array, y: Array) -> list[int]:
    """Rows for which no other row is as good in both numbers and better in one; smaller is better."""
    order = np.lexsort((y, x))
    best, rows = np.inf, []
    for row in order.tolist():
        if np.isfinite(x[row]) and y[row] < best:
            best = y[row]
            rows.append(row)
    return rows


def slopes(study: Study, columns: Columns) -> list[dict[str, Any]]:
    """Of a study of one range: d log(answer) / d log(value) at both ends, over the outer pairs of values."""
    if len(study.axes) != 1 or columns[study.axes[0].name].dtype.kind != "f":
        return []
    x = np.asarray(columns[study.axes[0].name], dtype=float)
    found = []
    for one in study.answers:
        if one.shares:
            continue
        y = np.asarray(columns[one.name], dtype=float)
        good = (x > 0.0) & (y > 0.0) & np.isfinite(y)
        order = np.argsort(x[good], kind="stable")
        logs = np.log(np.stack([x[good][order], y[good][order]]))
        if logs.shape[1] < 3 or np.ptp(logs[0]) == 0.0:
            continue
        pairs = np.diff(logs[1]) / np.where(np.diff(logs[0]) > 0.0, np.diff(logs[0]), np.nan)
        ends = pairs[np.isfinite(pairs)]
        found.append({"answer": one.name, "at_least": float(ends[0]), "at_largest": float(ends[-1])})
    return found


def sensitivities(study: Study, columns: Columns) -> list[dict[str, Any]]:
    """First-order and total indices of each answer, with 95 % intervals of a bootstrap over base points.

    References
    ----------
    Saltelli et al. 2010, Computer Physics Communications 181, 259, table 2 (b) and (f).
    """
    if study.sample.method != "sobol" or study.drawn > 1:
        return []
    d = len(study.axes)
    found = []
    for one in study.answers:
        if one.shares:
            continue
        values = np.asarray(columns[one.name], dtype=float).reshape(-1, d + 2)
        good = values[np.isfinite(values).all(axis=1)]
        row: dict[str, Any] = {"answer": one.name, "n": len(good), "n_left_out": len(values) - len(good)}
        if len(good) < ENOUGH or np.ptp(good) == 0.0:
            found.append(row | {"indices": []})
            continue
        first, total = indices(good)
        rng = np.random.default_rng(study.sample.seed)
        again = np.array([indices(good[rng.integers(0, len(good), len(good))]) for _ in range(RESAMPLES)])
        low, high = np.quantile(again, INTERVAL, axis=0)
        found.append(
            row
            | {
                "indices": [
                    {
                        "name": axis.name,
                        "first_order": float(first[k]),
                        "first_order_interval_95": [float(low[0, k]), float(high[0, k])],
                        "total": float(total[k]),
                        "total_interval_95": [float(low[1, k]), float(high[1, k])],
                    }
                    for k, axis in enumerate(study.axes)
                ]
            }
        )
    return found


def indices(values: Array) -> tuple[Array, Array]:
    """First-order and total indices (d,) from values (n, d + 2): of A, of B, and of A with column i of B."""
    a, b, mixed = values[:, 0], values[:, 1], values[:, 2:]
    centre = values[:, :2].mean()  # the estimator of the first order is better about the mean
    variance = np.concatenate([a, b]).var()
    first = np.mean((b - centre)[:, None] * (mixed - a[:, None]), axis=0) / variance
    total = 0.5 * np.mean((a[:, None] - mixed) ** 2, axis=0) / variance
    return first, total


def completeness(study: Study, columns: Columns) -> list[dict[str, Any]]:
    """Of objects of a catalogue: how many are seen at all, by the values of what else is varied."""
    if study.objects is None or study.objects.drawn is not None:  # of drawn ones `population` tells more
        return []
    others = [axis.name for axis in study.axes if axis.name != "object"]
    groups: dict[tuple[Any, ...], list[str]] = {}
    once = slice(None, None, max(1, study.drawn))
    statuses_of = columns["status"][once].tolist()
    keys = zip(*(columns[name][once].tolist() for name in others)) if others else iter([()] * len(statuses_of))
    for key, status in zip(keys, statuses_of):
        groups.setdefault(key, []).append(status)
    rows = []
    for key, statuses in groups.items():
        n, seen = len(statuses), sum(one in SEEN for one in statuses)
        where = {name: _plain(value) for name, value in zip(others, key)}
        rows.append({"where": where, "n": n, "n_seen": seen, "share": seen / n, "interval_95": interval(seen, n)})
    return rows
