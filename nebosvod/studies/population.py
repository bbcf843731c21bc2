"""What a system makes of a population: what is seen, what is known when, who is warned of, and how often for nothing.

Objects are a sample: the interval of a share is that of Clopper and Pearson. Where truths are drawn (`repeat`), the
rows of one draw have the errors of the telescopes in common and the rows of one object its orbit: neither are
independent, and the interval is a bootstrap over draws and objects at once.

References
----------
Clopper, Pearson 1934, Biometrika 26, 404.
Owen 2007, Annals of Applied Statistics 1, 386: the bootstrap of rows and columns (conservative).
"""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.studies.question import Study

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Columns = Mapping[str, npt.NDArray[Any]]
KIND, DIAMETER, SUN_ANGLE, WEIGHT = "object kind", "object diameter", "object sun angle", "object weight"
IMPACTOR, MISS = "impactor", "near miss"
SEEN = ("ok", "no_answer", "not_determined")
QUANTILES = {"p05": 0.05, "p25": 0.25, "p50": 0.5, "p75": 0.75, "p95": 0.95}
RESAMPLES = 1000
SIZES_M = (0.0, 20.0, 40.0, 80.0, np.inf)


def drawn_columns(study: Study, names: npt.NDArray[np.str_]) -> dict[str, npt.NDArray[Any]]:
    """Columns of what is known of drawn objects, by their names; none where nothing was drawn."""
    if study.objects is None or study.objects.drawn is None:
        return {}
    known, place = study.objects.known(), {name: k for k, name in enumerate(study.objects.axis.texts)}
    rows = [known[place[name]] for name in names.tolist()]
    return {
        KIND: np.array([IMPACTOR if one.hits else MISS for one in rows]),
        DIAMETER: np.array([one.diameter_m for one in rows]),
        SUN_ANGLE: np.array([one.sun_angle_deg for one in rows]),
        WEIGHT: np.array([one.weight for one in rows]),
    }


DRAWN_UNITS = {DIAMETER: "m", SUN_ANGLE: "deg"}


def interval(k: int, n: int) -> list[float]:
    """95 % of Clopper and Pearson for k of n."""
    from scipy import stats

    low = float(stats.beta.ppf(0.025, k, n - k + 1)) if k else 0.0
    high = float(stats.beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
    return [low, high]


def share_of(flags: Flags, draws: int, seed: int = 0) -> dict[str, Any]:
    """Share of rows, objects by draws, with its 95 % interval.

    Parameters
    ----------
    flags : (objects * draws,), the draws of an object together.
    """
    k, n = int(np.count_nonzero(flags)), len(flags)
    row = {"n": n, "k": k, "share": k / n if n else None}
    if draws <= 1 or not n:
        return row | {"interval_95": interval(k, n) if n else None}
    return row | {"interval_95": clustered(flags.reshape(-1, draws).astype(float), seed)}


def clustered(values: Array, seed: int) -> list[float]:
    """95 % interval of the mean of values (objects, draws), objects and draws drawn again with replacement."""
    rng, (n, m) = np.random.default_rng(seed), values.shape
    of_objects = rng.multinomial(n, np.full(n, 1.0 / n), RESAMPLES) / n
    of_draws = rng.multinomial(m, np.full(m, 1.0 / m), RESAMPLES) / m
    means = np.einsum("ko,od,kd->k", of_objects, values, of_draws, optimize=True)
    low, high = np.quantile(means, [0.025, 0.975])
    if not values.any() or values.all():  # a bootstrap of what never, or always, happened has no width
        low, high = interval(int(values.any(axis=1).sum()), n)
    return [float(low), float(high)]


def population(study: Study, columns: Columns) -> dict[str, Any] | None:
    """What study.json holds of drawn impactors and near misses; None where none were drawn."""
    if KIND not in columns or study.objects is None:
        return None
    names = study.objects.axis.texts
    hits, draws = columns[KIND] == IMPACTOR, max(1, study.drawn)
    groups = list(_groups(study, columns))
    return {
        "n_impactors": sum(name.startswith(IMPACTOR) for name in names),
        "n_misses": sum(name.startswith(MISS) for name in names),
        "draws": study.drawn,
        "shared": study.outer,
        "seen": [row for where, which in groups for row in _seen(where, which & hits, columns, draws)],
        "numbers": [row for where, which in groups for row in _numbers(study, where, which & hits, columns)],
        "warned": [row for where, which in groups for row in _warned(study, where, which, columns)],
        "warning": None
        if study.warning is None
        else {"answer": study.warning.answer, "at_least": study.warning.at_least},
    }


def _groups(study: Study, columns: Columns) -> Iterator[tuple[dict[str, Any], Flags]]:
    """Rows with the same values of what else is varied."""
    others = [axis.name for axis in study.axes if axis.name != "object"]
    keys = list(zip(*(columns[name].tolist() for name in others))) if others else [()] * len(columns["status"])
    for key in dict.fromkeys(keys):
        yield dict(zip(others, key)), np.array([one == key for one in keys], dtype=np.bool_)


def _seen(where: dict[str, Any], which: Flags, columns: Columns, draws: int) -> Iterator[dict[str, Any]]:
    """How many impactors are seen at all: all, from the day sky and the night sky, by size."""
    once = which & (columns["draw"] == 0) if draws > 1 else which
    day, size = columns[SUN_ANGLE] < 90.0, columns[DIAMETER]
    parts = [("all", once), ("from the day sky", once & day), ("from the night sky", once & ~day)]
    parts += [
        (f"{low:g} m and larger" if np.isinf(high) else f"{low:g} to {high:g} m", once & (size >= low) & (size < high))
        for low, high in pairwise(SIZES_M)
    ]
    for name, rows in parts:
        if rows.any():
            yield {"where": where, "group": name} | share_of(np.isin(columns["status"][rows], SEEN), 1)


def _numbers(study: Study, where: dict[str, Any], which: Flags, columns: Columns) -> Iterator[dict[str, Any]]:
    """Quantiles of each answer over the impactors that have it."""
    for one in study.answers:
        if one.shares:
            continue
        values = np.asarray(columns[one.name], dtype=float)[which]
        good = values[np.isfinite(values)]
        found = np.quantile(good, list(QUANTILES.values())) if good.size else [None] * len(QUANTILES)
        yield {
            "where": where,
            "answer": one.title,
            "unit": one.unit,
            "before_d": one.before_s / 86400.0 if one.before_s else None,
            "n": len(values),
            "n_with": int(good.size),
            **{key: None if value is None else float(value) for key, value in zip(QUANTILES, found)},
        }


def _warned(study: Study, where: dict[str, Any], which: Flags, columns: Columns) -> Iterator[dict[str, Any]]:
    """Impactors that are warned of, near misses that are, and how many of these there are for each impactor."""
    if study.warning is None:
        return
    draws, hits = max(1, study.drawn), columns[KIND] == IMPACTOR
    for name in study.warning.columns:
        values = np.asarray(columns[name], dtype=float)
        alarm = np.isfinite(values) & (np.nan_to_num(values) >= study.warning.at_least)
        asked = next(one for one in study.answers if one.name == name)
        misses = which & ~hits
        yield {
            "where": where,
            "before_d": asked.before_s / 86400.0 if asked.before_s else None,
            "impactors": share_of(alarm[which & hits], draws),
            "misses": share_of(alarm[misses], draws) if misses.any() else None,
            "false_per_impactor": _false(alarm[misses], columns[WEIGHT][misses], draws) if misses.any() else None,
        }


def _false(alarm: Flags, weight: Array, draws: int) -> dict[str, Any]:
    """Warnings of near misses for each impactor, as many near misses as there are out to the stated distance."""
    values = (alarm * weight).reshape(-1, draws)
    low, high = clustered(values, 1) if alarm.any() else (0.0, float(weight.mean()) * interval(0, len(values))[1])
    return {"value": float(values.mean()), "interval_95": [low, high]}
