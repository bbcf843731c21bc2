"""Figures of a study: curves with their slopes, maps with contours, the front, sensitivities, who is to blame where.

Maps have cells of one colour from light to dark, lines of equal value with their numbers, and letters for sources: they
read the same in grey.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from nebosvod.report.kit.chart import Chart, Panel
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import BLUE, GREY, INK, SERIES, VERMILION, Plate
from nebosvod.report.kit.scale import Scale, linear, logarithmic, named, power_text
from nebosvod.report.kit.wording import MINUS, quantity

Array = npt.NDArray[np.float64]
Item = Mapping[str, Any]
Columns = Mapping[str, npt.NDArray[Any]]
LIGHT, DARK = np.array([236.0, 244.0, 250.0]), np.array([8.0, 64.0, 110.0])
LEVELS = 5  # lines of equal value
WIDE = 15.0  # largest over smallest, from which a logarithm is shown
MOST_TICKS = 8
MOST_SHOWN = 4000  # points of a cloud
PATTERN = ("#dfe9f2", "#b4cfe4", "#88b3d4", "#f3d9bd", "#e7b184", "#cfd8c6", "#a9bb98", "#e6cfe0", "#c9a2bd", "#d9d9d9")


def titled(one: Item) -> str:
    """A column with its unit."""
    return f"{one['name']}, {one['unit']}" if one["unit"] else str(one["name"])


def scale_of(values: Array, label: str, log: bool | None = None) -> Scale:
    """An axis that suits some values."""
    good = values[np.isfinite(values)]
    wide = bool(good.size and good.min() > 0.0 and good.max() / good.min() > WIDE)
    return logarithmic(good, label) if (wide if log is None else log and wide) else linear(good, label)


def curve_plate(axis: Item, answer: Item, columns: Columns, slopes: Item | None) -> Plate:
    """An answer against the one thing that is varied, with its slopes at both ends."""
    x, y = np.asarray(columns[axis["name"]], dtype=float), np.asarray(columns[answer["name"]], dtype=float)
    order = np.argsort(x, kind="stable")
    x, y = x[order], y[order]
    chart = Chart(f"curve-{_key(answer['name'])}", height=0.0)
    panel = chart.panel(_axis_scale(axis, x), scale_of(y, titled(answer)), top=8.0, bottom=228.0)
    entries: list[tuple[str, str, dict[str, Any]]] = [("o", answer["name"], {"color": BLUE, "size": 5.0})]
    if slopes is not None and panel.x.kind == "log" and panel.y.kind == "log":
        panel.clip()
        for power, k in ((slopes["at_least"], 0), (slopes["at_largest"], -1)):
            good = np.flatnonzero(np.isfinite(y))
            ends = np.array([panel.x.low, panel.x.high])
            dashes: dict[str, Any] = {"stroke": GREY, "stroke_width": 1.2, "stroke_dasharray": "5 3" if k else "2 3"}
            panel.line(ends, y[good[k]] * (ends / x[good[k]]) ** power, **dashes)
            where = "high" if k else "low"
            entries.append(("line", f"slope {power:+.2f} at the {where} end".replace("-", MINUS), dashes))
        panel.unclip()
    panel.open()
    panel.line(x, y, stroke=BLUE, stroke_width=1.4)
    panel.dots(x, y, "o", answer["name"], color=BLUE, size=5.0)
    panel.close()
    chart.height = chart.legend(entries, 270.0)
    said = Markup("")
    if slopes is not None:
        low, high = (f"{slopes[key]:.2f}".replace("-", MINUS) for key in ("at_least", "at_largest"))
        said = Markup(
            " It goes with the power {} at the low end and {} at the high end: where that is 0, {} matters no more."
        ).format(low, high, axis["name"])
    caption = Markup("<b>{}</b> against {}.{}").format(answer["name"], axis["name"], said)
    return chart.plate(
        f"{answer['name']} against {axis['name']}", caption, [csv(chart.key, {titled(axis): x, titled(answer): y})]
    )


def _axis_scale(axis: Item, values: Array) -> Scale:
    return scale_of(values, titled(axis), bool(axis["log"]))


def slice_of(found: Item, columns: Columns, axes: Sequence[Item]) -> tuple[npt.NDArray[np.int64], list[str]]:
    """Rows of a grid on two axes, the others as at the point that was found, or in the middle; and what they are."""
    rows, said = np.arange(len(columns["point"])), []
    if "draw" in columns:
        rows = rows[columns["draw"][rows] == 0]
    at = found["find"]["row"] if found["find"] and found["find"]["found"] else None
    for one in found["vary"]:
        if one in axes:
            continue
        values = list(dict.fromkeys(columns[one["name"]].tolist()))
        value = columns[one["name"]][at] if at is not None else values[len(values) // 2]
        rows = rows[columns[one["name"]][rows] == value]
        shown = f"{value:.4g}" if isinstance(value, float | np.floating) else str(value)
        said.append(f"{one['name']} {shown} {one['unit']}".strip())
    return rows, said


def _cells(axes: Sequence[Item], columns: Columns, rows: npt.NDArray[np.int64]) -> tuple[list[list[Any]], Any, Any]:
    """Distinct values of two axes, and for each row its place in them."""
    values = [sorted(dict.fromkeys(columns[one["name"]][rows].tolist()), key=_order(one)) for one in axes]
    places = [
        np.array([lookup[value] for value in columns[one["name"]][rows].tolist()])
        for one, lookup in zip(axes, [{v: k for k, v in enumerate(own)} for own in values])
    ]
    return values, places[0], places[1]


def _order(axis: Item) -> Any:
    """Numbers by size, words as they stand in the file."""
    if axis["numeric"]:
        return float
    listed = list(axis["values"] or [])
    return lambda value: listed.index(value) if value in listed else len(listed)


def _steps(values: Sequence[Any], label: str) -> Scale:
    """An axis of cells, each with its value."""
    every = max(1, -(-len(values) // MOST_TICKS))
    ticks = tuple(
        (float(k), f"{v:.3g}" if isinstance(v, float) else str(v)) for k, v in enumerate(values) if k % every == 0
    )
    return Scale(kind="linear", low=-0.5, high=len(values) - 0.5, label=label, ticks=ticks)


def _map_panel(key: str, axes: Sequence[Item], values: Sequence[Sequence[Any]]) -> tuple[Chart, Panel]:
    chart = Chart(key, height=0.0)
    tall = min(300.0, max(120.0, 34.0 * len(values[1])))
    x, y = (_steps(own, titled(one)) for own, one in zip(values, axes))
    return chart, chart.panel(x, y, top=8.0, bottom=8.0 + tall)


def _cell(panel: Panel, i: int, j: int, fill: str, tip: str) -> None:
    (x0, x1), (y1, y0) = panel.at([i - 0.5, i + 0.5], [j - 0.5, j + 0.5])
    panel.chart.box(x0, y0, x1 - x0, y1 - y0, tip=tip, fill=fill)


def heat_plate(found: Item, answer: Item, columns: Columns, axes: Sequence[Item]) -> Plate:
    """An answer over two axes of a grid."""
    rows, said = slice_of(found, columns, axes)
    values, i, j = _cells(axes, columns, rows)
    z = np.full((len(values[1]), len(values[0])), np.nan)
    z[j, i] = np.asarray(columns[answer["name"]], dtype=float)[rows]
    good = z[np.isfinite(z)]
    log = bool(good.size and good.min() > 0.0 and good.max() / good.min() > WIDE)
    of = np.log(z) if log else z
    low, high = (float(np.nanmin(of)), float(np.nanmax(of))) if good.size else (0.0, 1.0)
    chart, panel = _map_panel(f"map-{_key(answer['name'])}", axes, values)
    for row, column in zip(j, i):
        part = (of[row, column] - low) / (high - low) if high > low else 0.5
        _cell(panel, int(column), int(row), _shade(part), _tip(answer, z[row, column]))
    levels = [low + (high - low) * (k + 1) / (LEVELS + 1) for k in range(LEVELS)] if high > low else []
    panel.clip()
    _contours(panel, of, levels, log)
    _found_mark(panel, found, rows, i, j)
    panel.unclip()
    chart.height = _bar(chart, panel.bottom + 40.0, low, high, log, titled(answer))
    fixed = f" with {', '.join(said)}" if said else ""
    caption = Markup("<b>{}</b> over {} and {}{}; lines of equal value{}.").format(
        titled(answer), axes[0]["name"], axes[1]["name"], fixed, _mark_words(found, rows)
    )
    data = {titled(one): [values[k][n] for n in place] for k, (one, place) in enumerate(zip(axes, (i, j)))}
    data[titled(answer)] = z[j, i]
    return chart.plate(
        f"{answer['name']} over {axes[0]['name']} and {axes[1]['name']}", caption, [csv(chart.key, data)]
    )


def _shade(part: float) -> str:
    """A colour from light to dark, even in lightness; white where there is no value."""
    if not math.isfinite(part):
        return "#ffffff"
    red, green, blue = (round(one) for one in LIGHT + (DARK - LIGHT) * min(max(part, 0.0), 1.0))
    return f"#{red:02x}{green:02x}{blue:02x}"


def _tip(answer: Item, value: float) -> str:
    return f"{answer['name']} {value:.4g} {answer['unit']}".strip() if math.isfinite(value) else "no value"


def _contours(panel: Panel, z: Array, levels: Sequence[float], log: bool) -> None:
    """Lines of equal value between the centres of cells, each with its number."""
    from contourpy import contour_generator

    if min(z.shape) < 2:
        return
    lines = contour_generator(z=np.ma.masked_invalid(z))
    for level in levels:
        for line in lines.lines(level):
            points = np.asarray(line, dtype=float)
            panel.line(points[:, 0], points[:, 1], stroke="#ffffff", stroke_width=2.6)
            panel.line(points[:, 0], points[:, 1], stroke=INK, stroke_width=1.1)
            middle = points[len(points) // 2]
            (px,), (py,) = panel.at([middle[0]], [middle[1]])
            value = math.exp(level) if log else level
            panel.chart.text(float(px), float(py) + 3.5, f"{value:.3g}", "middle", class_="halo")


def _found_mark(
    panel: Panel, found: Item, rows: npt.NDArray[np.int64], i: npt.NDArray[np.int64], j: npt.NDArray[np.int64]
) -> None:
    place = _place_found(found, rows)
    if place is not None:
        x = float(i[place]) + np.array([-0.46, 0.46, 0.46, -0.46, -0.46])
        y = float(j[place]) + np.array([-0.44, -0.44, 0.44, 0.44, -0.44])
        panel.line(x, y, stroke="#ffffff", stroke_width=4.0)
        panel.line(x, y, stroke=VERMILION, stroke_width=2.2)


def _place_found(found: Item, rows: npt.NDArray[np.int64]) -> int | None:
    find = found["find"]
    if not find or not find["found"]:
        return None
    places = np.flatnonzero(rows == find["row"])
    return int(places[0]) if places.size else None


def _mark_words(found: Item, rows: npt.NDArray[np.int64]) -> str:
    return "; the frame marks the point that was looked for" if _place_found(found, rows) is not None else ""


def _bar(chart: Chart, top: float, low: float, high: float, log: bool, label: str) -> float:
    """The colours of a map with their values; returns the height below."""
    left, wide, count = 60.0, 300.0, 30
    for k in range(count):
        chart.box(left + wide * k / count, top, wide / count + 0.3, 10.0, fill=_shade((k + 0.5) / count))
    for k in range(5):
        value = low + (high - low) * k / 4.0
        text = power_text(float(f"{math.exp(value):.2g}")) if log else f"{value:.3g}"
        chart.text(left + wide * k / 4.0, top + 21.0, text, "middle")
    chart.text(left + wide / 2.0, top + 34.0, label, "middle")
    return top + 42.0


def blame_plate(found: Item, answer: Item, columns: Columns, axes: Sequence[Item]) -> Plate:
    """Which source has the largest share, over two axes of a grid."""
    rows, said = slice_of(found, columns, axes)
    values, i, j = _cells(axes, columns, rows)
    leading = columns[f"{answer['name']}: leading"][rows].tolist()
    sources = [source for source in dict.fromkeys(leading) if source]
    letters = {source: chr(ord("A") + k % 26) for k, source in enumerate(sources)}
    chart, panel = _map_panel(f"blame-{_key(answer['name'])}", axes, values)
    for row, column, source in zip(j, i, leading):
        fill = PATTERN[sources.index(source) % len(PATTERN)] if source else "#ffffff"
        _cell(panel, int(column), int(row), fill, source or "no value")
    panel.clip()
    for row, column, source in zip(j, i, leading):
        if source and len(values[0]) <= 30:
            (px,), (py,) = panel.at([float(column)], [float(row)])
            chart.text(float(px), float(py) + 3.5, letters[source], "middle")
    _found_mark(panel, found, rows, i, j)
    panel.unclip()
    entries = [
        ("box", f"{letters[one]}: {one}", {"fill": PATTERN[k % len(PATTERN)], "stroke": GREY, "stroke_width": 0.6})
        for k, one in enumerate(sources)
    ]
    chart.height = chart.legend(entries, panel.bottom + 44.0)
    fixed = f" with {', '.join(said)}" if said else ""
    caption = Markup("<b>{}</b>: the source with the largest share, over {} and {}{}{}.").format(
        answer["name"], axes[0]["name"], axes[1]["name"], fixed, _mark_words(found, rows)
    )
    data: dict[str, Any] = {
        titled(one): [values[k][n] for n in place] for k, (one, place) in enumerate(zip(axes, (i, j)))
    }
    data["leading source"] = leading
    return chart.plate(f"Largest source of {answer['name']}", caption, [csv(chart.key, data)])


def shares_plate(axis: Item, answer: Item, columns: Columns) -> Plate:
    """The shares of the sources against the one thing that is varied."""
    x = np.asarray(columns[axis["name"]], dtype=float)
    order = np.argsort(x, kind="stable")
    start = f"{answer['name']}: "
    shares = {
        name.removeprefix(start): np.asarray(column, dtype=float)[order]
        for name, column in columns.items()
        if name.startswith(start) and name != f"{start}leading"
    }
    shown = sorted(shares, key=lambda name: -np.nanmax(shares[name]))[: len(SERIES)]
    chart = Chart(f"shares-{_key(answer['name'])}", height=0.0)
    panel = chart.panel(_axis_scale(axis, x), linear([0.0, 1.0], "share of variance", pad=0.02), top=8.0, bottom=208.0)
    panel.open()
    for name, (colour, marker) in zip(shown, SERIES):
        panel.line(x[order], shares[name], stroke=colour, stroke_width=1.2)
        panel.dots(x[order], shares[name], marker, name, color=colour, size=4.0)
    panel.close()
    entries = [(marker, name, {"color": colour, "size": 4.0}) for name, (colour, marker) in zip(shown, SERIES)]
    chart.height = chart.legend(entries, 250.0)
    caption = Markup("<b>{}</b>: shares of the sources against {}.").format(answer["name"], axis["name"])
    return chart.plate(f"Shares of {answer['name']}", caption, [csv(chart.key, {titled(axis): x[order], **shares})])


def front_plate(found: Item, columns: Columns) -> Plate | None:
    """What the objective costs: every point, those that no other beats, and the limit."""
    front = found["pareto"]
    if front is None or len(front["rows"]) < 1:
        return None
    units = {one["name"]: one["unit"] for one in (*found["vary"], *found["answers"])}
    x, y = (np.asarray(columns[front[key]], dtype=float) for key in ("objective", "against"))
    label_x, label_y = (
        titled({"name": front[key], "unit": units.get(front[key], "")}) for key in ("objective", "against")
    )
    chart = Chart("front", height=0.0)
    panel = chart.panel(scale_of(x, label_x), scale_of(np.append(y, front["limit"]), label_y), top=8.0, bottom=258.0)
    panel.level(front["limit"], stroke=GREY, stroke_width=1.2, stroke_dasharray="5 3")
    panel.open()
    every = slice(None, None, max(1, len(x) // MOST_SHOWN))
    panel.dots(x[every], y[every], "o", "point", color=GREY, size=3.0, opacity=0.6)
    rows = np.array(front["rows"])
    panel.line(x[rows], y[rows], stroke=BLUE, stroke_width=1.2)
    panel.dots(x[rows], y[rows], "s", "not beaten", color=BLUE, size=5.0)
    entries: list[tuple[str, str, dict[str, Any]]] = [
        ("o", "points", {"color": GREY, "size": 3.0}), ("s", "not beaten in both", {"color": BLUE, "size": 5.0}),
        ("line", f"{front['against']} {front['condition']}",
         {"stroke": GREY, "stroke_width": 1.2, "stroke_dasharray": "5 3"}),
    ]  # fmt: skip
    if found["find"]["found"]:
        best = found["find"]["row"]
        panel.dots([x[best]], [y[best]], "D", "found", color=VERMILION, size=7.0)
        entries.append(("D", "found", {"color": VERMILION, "size": 5.0}))
    panel.close()
    chart.height = chart.legend(entries, 300.0)
    caption = Markup("<b>{}</b> against {}: {} of {} points are beaten by no other in both.").format(
        front["against"], front["objective"], len(rows), len(x)
    )
    return chart.plate("Objective against condition", caption, [csv("front", {label_x: x[rows], label_y: y[rows]})])


def sensitivity_plate(one: Item, found: Item) -> Plate | None:
    """First-order and total indices of an answer with their intervals."""
    if not one["indices"]:
        return None
    ranked = sorted(one["indices"], key=lambda row: -row["total"])
    chart = Chart(f"sensitivity-{_key(one['answer'])}", height=0.0)
    high = 34.0 * len(ranked)
    ends = [v for row in ranked for key in ("first_order_interval_95", "total_interval_95") for v in row[key]]
    panel = chart.panel(
        linear([0.0, 1.0, *ends], "share of the variance"),
        named([row["name"] for row in ranked]),
        top=6.0,
        bottom=6.0 + high,
    )
    panel.upright(0.0, stroke=GREY, stroke_width=0.8)
    for k, row in enumerate(ranked):
        for key, shift, colour in (("first_order", 0.16, BLUE), ("total", -0.16, VERMILION)):
            low, up = row[f"{key}_interval_95"]
            panel.line([low, up], [-k + shift, -k + shift], stroke=colour, stroke_width=1.6)
    panel.open()
    for key, shift, colour, marker, text in (
        ("first_order", 0.16, BLUE, "o", "by itself"), ("total", -0.16, VERMILION, "s", "with all interactions"),
    ):  # fmt: skip
        panel.marks([(row[key], -k + shift) for k, row in enumerate(ranked)], marker, text, color=colour, size=6.0)
    panel.close()
    entries = [
        ("o", "first order: by itself", {"color": BLUE, "size": 5.0}),
        ("s", "total: with all interactions", {"color": VERMILION, "size": 5.0}),
    ]
    chart.height = chart.legend(entries, high + 50.0)
    caption = Markup(
        "What moves <b>{}</b>: Sobol indices of {} base points{}, with 95 % intervals; {} by most ({})."
    ).format(
        one["answer"], one["n"], f" ({one['n_left_out']} left out, without a value)" if one["n_left_out"] else "",
        ranked[0]["name"], quantity(ranked[0]["total"], "", 2),
    )  # fmt: skip
    keys = ("name", "first_order", "total")
    return chart.plate(
        f"What moves {one['answer']}", caption, [csv(chart.key, {k: [r[k] for r in ranked] for k in keys})]
    )


def cloud_plate(axis: Item, answer: Item, columns: Columns) -> Plate:
    """An answer against one axis of a sample."""
    x, y = np.asarray(columns[axis["name"]], dtype=float), np.asarray(columns[answer["name"]], dtype=float)
    chart = Chart(f"cloud-{_key(answer['name'])}-{_key(axis['name'])}", height=252.0)
    panel = chart.panel(_axis_scale(axis, x), scale_of(y, titled(answer)), top=8.0, bottom=210.0)
    every = slice(None, None, max(1, len(x) // MOST_SHOWN))
    panel.open()
    panel.dots(x[every], y[every], "o", answer["name"], color=BLUE, size=2.6, opacity=0.6)
    panel.close()
    caption = Markup("<b>{}</b> against {}, all else varied as well.").format(answer["name"], axis["name"])
    data = csv(chart.key, {titled(axis): x[every], titled(answer): y[every]})
    return chart.plate(f"{answer['name']} against {axis['name']}", caption, [data])


def distribution_plate(answer: Item, columns: Columns) -> Plate:
    """How many objects have at most so much of an answer."""
    values = np.asarray(columns[answer["name"]], dtype=float)
    x = np.sort(values[np.isfinite(values)])
    share = np.arange(1, x.size + 1) / values.size
    chart = Chart(f"distribution-{_key(answer['name'])}", height=252.0)
    panel = chart.panel(
        scale_of(x, titled(answer)), linear([0.0, 1.0], "share of all", pad=0.02), top=8.0, bottom=208.0
    )
    every = slice(None, None, max(1, x.size // MOST_SHOWN))
    panel.open()
    panel.line(
        np.repeat(x[every], 2)[1:], np.repeat(share[every], 2)[:-1], answer["name"], stroke=BLUE, stroke_width=1.6
    )
    panel.close()
    caption = Markup("Share of all rows with at most so much of <b>{}</b>; {} of {} have a value.").format(
        answer["name"], x.size, values.size
    )
    data = csv(chart.key, {titled(answer): x[every], "share": share[every]})
    return chart.plate(f"Distribution of {answer['name']}", caption, [data])


def _key(name: str) -> str:
    return "".join(one if one.isalnum() and one.isascii() else "-" for one in name)
