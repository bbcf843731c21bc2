"""Figures of a risk: target plane, corridor, ways side by side, budget of the probability, its history."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from nebosvod.dynamics.surface import SURFACE_KM
from nebosvod.report.kit.chart import NARROW, Chart
from nebosvod.report.kit.coastlines import on_land
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.edge import below
from nebosvod.report.kit.ground import reached
from nebosvod.report.kit.outline import covariance_of, outline
from nebosvod.report.kit.plate import BLUE, GREY, INK, SERIES, VERMILION, Plate, thin
from nebosvod.report.kit.scale import calendar, linear, logarithmic, named
from nebosvod.report.kit.target import TargetView, target_plates
from nebosvod.report.kit.wording import count, number, percent, quantity
from nebosvod.report.kit.worldmap import Corridor, maps
from nebosvod.report.risk.draws import Arrays, draws_of, is_weighed
from nebosvod.report.risk.words import body_name, chance, impactor_name, unanswered, way_name
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

Array = npt.NDArray[np.float64]
Item = Mapping[str, Any]
LONGEST = 26  # letters of a source beside its bar
MOST_DRAWN = 3000
WIDE = 30.0  # probabilities that differ by more than this factor need a logarithmic axis


def by_weight(draws: Arrays, which: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    """Numbers of draws to show: all, or of unequal weights as many of each as it weighs."""
    numbers = np.flatnonzero(which)
    weights = np.asarray(draws["weights"], dtype=np.float64)[numbers]
    if not len(numbers) or np.ptp(weights) <= 1e-9 * weights.max():
        return numbers[thin(len(numbers), MOST_DRAWN)]
    steps = (np.arange(MOST_DRAWN // 2) + 0.5) / (MOST_DRAWN // 2)
    found = np.searchsorted(np.cumsum(weights) / weights.sum(), steps)
    return np.unique(numbers[np.minimum(found, len(numbers) - 1)])


def plane_plates(row: Item, arrays: Arrays) -> list[Plate]:
    """The target plane of one virtual impactor."""
    k, one, draws = row["number"], row["approach"], draws_of(row["number"], arrays)
    points, hits = np.asarray(draws["xi_zeta_km"]), np.asarray(draws["hits"], dtype=np.bool_)
    chosen = np.flatnonzero(np.isfinite(points).all(axis=1))
    chosen = chosen[thin(len(chosen), MOST_DRAWN)]
    other = np.asarray(draws["hit_body"])[chosen] != ""
    fates = np.where(hits[chosen], "hit", np.where(other, "other", "miss"))
    if "grazes" in draws:
        fates = np.where(np.asarray(draws["grazes"], dtype=np.bool_)[chosen] & (fates == "miss"), "graze", fates)
    centre, K = (None, None) if one is None else _ellipse(one)
    line = arrays.get(f"line_xi_zeta_km_{k}")
    if centre is not None and line is not None and len(line) == len(arrays.get("line_sigmas", ())):
        # an approach takes the asymptote elsewhere on the path than the draws do: a km apart in one that falls
        estimate = line[np.argmin(np.abs(arrays["line_sigmas"]))]
        centre = estimate if np.isfinite(estimate).all() else centre
    view = TargetView(
        body=row["body"], radius_km=SURFACE_KM[row["body"]], capture_km=float(arrays[f"capture_radius_km_{k}"]),
        centre=centre, covariance=K, points=points[chosen], fates=fates,
        line=None if line is None else line[np.isfinite(line).all(axis=1)],
    )  # fmt: skip
    caption = Markup(
        "The b-plane of the encounter at one scale: {} (radius {}), the dashed circle that its pull makes of it ({}), "
        "and {} by their fate."
    ).format(
        body_name(row["body"]), quantity(view.radius_km, "km", 4), quantity(view.capture_km, "km", 4),
        count(len(chosen), "drawn orbit"),
    )  # fmt: skip
    if is_weighed(k, arrays):
        caption += Markup(" They were drawn about the orbits that hit: denser there than the orbit itself may be.")
    if one is not None and K is not None:
        caption += Markup(" The linear ellipse is {} × {} (1σ).").format(
            quantity(one["semi_major_km"], "km"), quantity(one["semi_minor_km"], "km")
        )
    return target_plates(f"target-{k}", view, f"Target plane of {impactor_name(row)}", caption)


def _ellipse(one: Item) -> tuple[Array | None, Array | None]:
    """Centre and covariance of the linear ellipse of an approach."""
    if one["xi_km"] is None or one["semi_major_km"] is None:
        return None, None
    K = covariance_of(one["semi_major_km"], one["semi_minor_km"], one["angle_deg"])
    return np.array([one["xi_km"], one["zeta_km"]]), K


def corridor_plates(rows: Sequence[Item], arrays: Arrays) -> list[Plate]:
    """Where the drawn orbits that hit the Earth come down, all virtual impactors on one map."""
    corridors, land, drawn = [], 0, 0
    mine = [row for row in rows if row["body"] == "earth"]
    for place_in_list, row in enumerate(mine):
        draws = draws_of(row["number"], arrays)
        place = np.stack([np.asarray(draws["longitude_deg"]), np.asarray(draws["latitude_deg"])], axis=1)
        hits = np.asarray(draws["hits"], dtype=np.bool_) & np.isfinite(place).all(axis=1)
        points = place[by_weight(draws, hits)]
        corridors.append(_corridor(row, points, *SERIES[(place_in_list + 1) % len(SERIES)], alone=len(mine) == 1))
        land, drawn = land + int(on_land(*points.T).sum()), drawn + len(points)
    if not drawn and all(one.nominal is None for one in corridors):
        return []
    caption = Markup("Where the drawn orbits that hit come to the ground")
    caption += Markup(", {} of {} on land.").format(percent(land / drawn), count(drawn, "place")) if drawn else "."
    grazing = sum(((row.get("corridor") or {}).get("grazing_probability") or 0.0) for row in mine)
    if grazing > 0.0:
        caption += Markup(" Beside them, with a probability of {}, orbits come below 100 km and leave again.").format(
            number(grazing, 2)
        )
    return maps("map-corridor", corridors, "Where it may come down", caption)


def _corridor(row: Item, points: Array, color: str, marker: str, *, alone: bool) -> Corridor:
    """One virtual impactor on the map: its places, the place of the estimate, and an ellipse where there is one."""
    one, level = row["approach"], (row.get("corridor") or {}).get("ground")
    nominal = None if one is None or one["longitude_deg"] is None else (one["longitude_deg"], one["latitude_deg"])
    outlines = []
    if level is not None and level["semi_major_km"] is not None:
        K = covariance_of(level["semi_major_km"], level["semi_minor_km"], level["angle_from_east_deg"])
        amid = level["longitude_deg"], level["latitude_deg"]
        outlines = [np.stack(reached(*amid, 90.0, outline(K, k)), axis=1) for k in (1.0, 3.0)]
    name = "drawn orbits" if alone else row["epoch_utc"][:10]
    return Corridor(
        name=name, points=points, nominal=nominal, outlines=outlines, outlines_name="1 and 3σ of the places",
        color=color, marker=marker,
    )  # fmt: skip


def ways_plate(row: Item) -> Plate:
    """Every way with its interval, the recommended one heavier."""
    ways = [way for way in row["ways"] if not unanswered(way)]
    values = [v for way in ways for v in (way["probability"], way["low"] or None, way["high"]) if v]
    wide = bool(values) and max(values) > WIDE * min(values)
    factor = 1.0 if wide else 100.0
    label = "probability" if wide else "probability, %"
    x = (logarithmic if wide else linear)([factor * v for v in values] or [0.0, 1.0], label, pad=0.08)
    high = 24.0 * len(ways)
    chart = Chart(f"ways-{row['number']}", width=NARROW, height=high + 46.0)
    panel = chart.panel(x, named([way_name(way["way"]) for way in ways]), top=6.0, bottom=6.0 + high)
    panel.open()
    for i, way in enumerate(ways):
        best = way["way"] == row["recommended"]
        color, y = (VERMILION if best else BLUE), -float(i)
        low, top = max(factor * way["low"], x.low), factor * way["high"]
        if top > x.low:
            panel.line([low, top], [y, y], stroke=color, stroke_width=3.0 if best else 1.6)
        if way["bound"]:
            panel.dots([factor * way["high"]], [y], "|", way_name(way["way"]), color=color)
        elif factor * way["probability"] < x.low:
            below(panel, y, number(factor * way["probability"]), color)
        else:
            name = f"{way_name(way['way'])}{', recommended' if best else ''}"
            panel.dots([factor * way["probability"]], [y], "o", name, color=color, size=5.0)
    panel.close()
    keys = ("way", "probability", "low", "high", "draws", "hits", "effective_hits")
    caption = Markup("The probability by each way with its 95 % interval; <b>{}</b> is the one to go by: {}.").format(
        way_name(row["recommended"]), row["reason"]
    )
    columns = {key: [way[key] for way in ways] for key in keys}
    return chart.plate(
        f"Probability of {impactor_name(row)} by each way", caption, [csv(f"ways-{row['number']}", columns)]
    )


def budget_plate(row: Item) -> Plate | None:
    """Elasticities of the probability with their errors."""
    budget = row.get("budget") or {}
    rows = (budget.get("rows") or [])[:12]
    if not rows:
        return None
    key, error = ("log_odds", "log_odds_error") if rows[0]["log_odds"] is not None else (
        "elasticity", "elasticity_error"
    )  # fmt: skip
    values = [v for one in rows for v in (one[key] - 2.0 * one[error], one[key] + 2.0 * one[error])]
    what = "change of ln P" if key == "elasticity" else "change of ln P/(1 − P)"
    high = 22.0 * len(rows)
    names = [one["source"] if len(one["source"]) <= LONGEST else f"{one['source'][: LONGEST - 1]}…" for one in rows]
    chart = Chart(f"budget-{row['number']}", width=NARROW, height=high + 46.0)
    panel = chart.panel(
        linear([*values, 0.0], f"{what} by that of ln σ", most=4), named(names), top=6.0,
        bottom=6.0 + high,
    )  # fmt: skip
    panel.upright(0.0, stroke=INK, stroke_width=0.9)
    panel.open()
    for i, one in enumerate(rows):
        panel.line([one[key] - 2.0 * one[error], one[key] + 2.0 * one[error]], [-i, -i], stroke=BLUE, stroke_width=2.0)
        panel.dots([one[key]], [-float(i)], "o", one["source"], color=BLUE, size=5.0)
    panel.close()
    caption = Markup(
        "What the probability hangs on: elasticity of each source with two standard errors. Above 0 the probability "
        "falls as the source is made smaller; below 0 it grows, because the orbit is then better known to hit."
    )
    columns = {name: [one[name] for one in rows] for name in rows[0]}
    return chart.plate("Elasticities of the probability by source", caption, [csv(f"budget-{row['number']}", columns)])


def history_plate(history: Sequence[Item]) -> Plate | None:
    """The probability after each night, and the sigma of the target plane then."""
    if len(history) < 2:
        return None
    epochs = [Epoch.parse(one["until_utc"]) for one in history]
    t = np.array([one - epochs[0] for one in epochs])
    days, dates = t / SECONDS_PER_DAY, calendar(epochs[0], t, most=3.5)
    low = np.array([one["low"] or one["probability"] or one["high"] for one in history])
    top = np.array([one["high"] for one in history])
    chart = Chart("chances-by-night", width=NARROW, height=0.0)
    upper = chart.panel(
        dates.silenced(), logarithmic([*low, *top], "probability"), top=8.0, bottom=150.0, left=62.0
    )  # fmt: skip
    upper.open()
    known = np.array([not one["bound"] for one in history])
    p = np.array([one["high"] if one["probability"] is None else one["probability"] for one in history])
    for k in np.flatnonzero(known):
        upper.line([days[k]] * 2, [max(low[k], upper.y.low), top[k]], stroke=BLUE, stroke_width=1.4)
    upper.line(days[known], p[known], stroke=BLUE, stroke_width=1.0)
    upper.dots(days[known], p[known], "o", "probability", color=BLUE, size=4.5)
    upper.dots(days[~known], top[~known], "v", "below", color=GREY, size=4.0)
    upper.close()
    sigma = np.array([one["semi_major_km"] or np.nan for one in history])
    lower = chart.panel(dates, logarithmic(sigma, "1σ, km"), top=164.0, bottom=234.0, left=62.0)
    lower.open()
    lower.line(days, sigma, stroke=INK, stroke_width=1.0)
    lower.dots(days, sigma, "s", "long axis of the ellipse", color=INK, size=3.5)
    lower.close()
    entries: list[tuple[str, str, dict[str, Any]]] = [("o", "probability", {"color": BLUE})]
    entries += [] if known.all() else [("v", "only a bound", {"color": GREY})]
    entries.append(("s", "long axis in the target plane, 1σ", {"color": INK}))
    chart.height = chart.legend(entries, 278.0)
    names = ("until_utc", "n_observations", "probability", "low", "high", "semi_major_km")
    columns = {name: [one.get(name) for one in history] for name in names}
    last = history[-1]
    caption = Markup(
        "After each night, by orbits drawn about a fit of its own: {} with all {}. The line of variations only shows "
        "where to look for hits here, and is straight."
    ).format(chance(last), count(last["n_observations"], "observation"))
    return chart.plate("Probability after each night of observations", caption, [csv("history", columns)])
