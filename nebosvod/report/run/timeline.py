"""The run over time: what was seen, how bright and how far, and what the measurements made of the prediction."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from nebosvod.dynamics.constants import AU_KM
from nebosvod.report.kit.chart import CHARACTER, WIDE, Chart, Panel, fitted
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.facts import leading
from nebosvod.report.kit.plate import GREY, INK, SERIES, VERMILION, Plate, thin
from nebosvod.report.kit.scale import Scale, calendar, linear, logarithmic, named
from nebosvod.report.kit.wording import finite, quantity, scale_of
from nebosvod.report.run.visibility import Columns, colour_of, seen_caption, sticks, why
from nebosvod.results.folder import Array, RunFolder
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

ROW, TALL, GAP = 22.0, 76.0, 14.0  # px: a telescope, a panel, the room between two
MOST_CURVES = 4
NEXT = 0.6  # of the arc: an encounter so soon after the last measurement stands in the picture
UNDETERMINED = 1e4  # times the final sigma, above which a curve says only that the orbit is not determined yet
Entry = tuple[str, str, dict[str, Any]]
Counts = npt.NDArray[np.int64]
Row = tuple[Scale, Any, float]  # axis of y, what draws in the panel, height


def timeline_plate(run: RunFolder, columns: Columns | None) -> Plate | None:
    """The run over time as a figure of its page; None where it has no measurements at different times."""
    if timeline_chart(run, columns) is None:
        return None
    return fitted(
        lambda width: timeline_chart(run, columns, width) or Chart("timeline"),
        "Timeline: what each telescope saw, magnitude, distance, and sigma of the predictions as measurements come in",
        _caption(run, columns),
        [one for one in (_scheduled(columns), _sigmas(run)) if one],
    )


def timeline_chart(run: RunFolder, columns: Columns | None = None, width: float = WIDE) -> Chart | None:
    """Draw the run over time; None where it has no measurements at different times.

    Parameters
    ----------
    columns : of tables/visibility.ecsv, as text; without them the measurements alone are shown.
    width : px.
    """
    t = run.array("epoch_s")
    times = t if columns is None or not _scheduled_at(columns) else np.array(columns["t"], dtype=np.float64)
    if times is None or not len(times) or not np.ptp(times) > 0.0:
        return None
    met = _encounter(run, times)
    dates = calendar(run.epoch, times if met is None else np.append(times, met[0]), most=5.5 if width > 600 else 3.2)
    entries: list[Entry] = []
    made = (_seen(run, columns, t, entries), _bright(run, columns), _far(run, t), _sigma(run, entries))
    rows = [row for row in made if row]
    chart = Chart("timeline", width=width, height=0.0)
    left = max(58.0, *(9.0 + CHARACTER * scale.width for scale, _, _ in rows if not scale.label), 58.0)
    left = min(left, 0.36 * width)
    top = 8.0
    for k, (scale, draw, tall) in enumerate(rows):
        x = dates if k == len(rows) - 1 else dates.silenced()
        panel = chart.panel(x, scale, top=top, bottom=top + tall, left=left)
        panel.open()
        draw(panel)
        if met is not None:
            panel.upright(met[0] / SECONDS_PER_DAY, stroke=VERMILION, stroke_width=1.2, stroke_dasharray="4 2")
        panel.close()
        top += tall + GAP
    if met is not None:
        entries.append(("line", met[1], {"stroke": VERMILION, "stroke_width": 1.2, "stroke_dasharray": "4 2"}))
    order = {name: i for i, name in enumerate(run.telescopes)}
    marks = [(SERIES[(i + 1) % 6][1], name, _look(i)) for name, i in order.items() if len(order) > 1]
    chart.height = chart.legend([*marks, *entries], top + 34.0, 12.0) - 4.0
    return chart


def _scheduled_at(columns: Columns | None) -> bool:
    return columns is not None and {"t", "telescope", "reason"} <= set(columns) and len(columns["t"]) > 0


def _look(i: int) -> dict[str, Any]:
    """Telescopes that stand at one place stay apart: the first is a ring about the second."""
    return {"color": SERIES[(i + 1) % len(SERIES)][0], "size": 4.4 if i == 0 else 2.4, "hollow": i == 0}


def _dots(run: RunFolder, panel: Panel, t_s: Array, values: Array, who: Sequence[str]) -> None:
    """Values over time by telescope."""
    for i, name in enumerate(run.telescopes):
        mine = np.flatnonzero((np.asarray(who) == name) & np.isfinite(values))
        mine = mine[thin(len(mine), 240)]
        panel.dots(t_s[mine] / SECONDS_PER_DAY, values[mine], SERIES[(i + 1) % len(SERIES)][1], name, **_look(i))


def _names_of(run: RunFolder) -> list[str]:
    """The telescope of each measurement."""
    index = run.array("telescope_index")
    return [] if index is None else [run.telescopes[i] for i in index]


def _seen(run: RunFolder, columns: Columns | None, t: Array | None, entries: list[Entry]) -> Row | None:
    """A line of strokes for each telescope: seen below, lost above by what removes it."""
    if columns is not None and _scheduled_at(columns):
        t_s, who = np.array(columns["t"], dtype=np.float64), np.array(columns["telescope"])
        reason = np.array(columns["reason"])
        names = list(dict.fromkeys(columns["telescope"]))
    elif t is not None:
        t_s, who, reason, names = t, np.array(_names_of(run)), np.full(len(t), "-"), run.telescopes
    else:
        return None
    names = [name for name in run.telescopes if name in names] + [name for name in names if name not in run.telescopes]
    reasons = ["-", *sorted(set(reason.tolist()) - {"-"})]
    entries += [("box", why(one), {"fill": colour_of(one)}) for one in reasons]
    shown = [_short(name) for name in names]

    def draw(panel: Panel) -> None:
        sticks(panel, names, t_s, who, reason, reasons)

    return named(shown), draw, ROW * len(names)


def _short(name: str) -> str:
    return name if len(name) < 19 else name[:17] + "…"


def _bright(run: RunFolder, columns: Columns | None) -> Row | None:
    """Magnitude of every scheduled exposure, bright above."""
    if columns is None or not _scheduled_at(columns) or "magnitude" not in columns:
        return None
    magnitude = np.array(columns["magnitude"], dtype=np.float64)
    if not np.isfinite(magnitude).any():
        return None
    t_s = np.array(columns["t"], dtype=np.float64)
    scale = linear(magnitude[np.isfinite(magnitude)], "V, mag", most=4).reversed()
    return scale, lambda panel: _dots(run, panel, t_s, magnitude, columns["telescope"]), TALL


def _far(run: RunFolder, t: Array | None) -> Row | None:
    """Distance from the telescope at each measurement."""
    place, state = run.array("telescope_position_km"), run.array("state")
    if place is None or state is None or t is None or not len(t):
        return None
    distance = np.linalg.norm(state[:, :3] - place, axis=1)
    factor, unit = (1.0 / AU_KM, "au") if distance.max() > 0.02 * AU_KM else (1e-3, "10³ km")
    values = distance * factor
    wide = values.max() > 8.0 * values.min()
    axis = (
        logarithmic(values, f"distance, {unit}", most=4)
        if wide
        else linear([0.0, *values], f"distance, {unit}", most=4)
    )
    return axis, lambda panel: _dots(run, panel, t, values, _names_of(run)), TALL


def curves_of(run: RunFolder) -> list[tuple[str, str, Counts, Array, Array]]:
    """Of each prediction whose sigma is known as measurements come in: name, unit, count, time in s, total sigma."""
    t = run.array("epoch_s")
    if run.main is None or t is None:
        return []
    order = [p["name"] for p in leading(run, run.main)]
    blocks = [b for b in run.summary.get("curves") or [] if b["prediction"] in order]
    found = []
    for block in sorted(blocks, key=lambda b: order.index(b["prediction"])):
        counted, unit = block["measurements"], block["unit"]
        sigma = np.array([v if finite(v) else np.nan for v in counted.get(f"all_{unit}") or []], dtype=np.float64)
        count = np.array(counted["count"][: len(sigma)], dtype=np.int64)
        kept = (count >= 1) & (count <= len(t)) & (sigma > 0.0)
        if np.count_nonzero(kept) > 1:
            found.append((block["prediction"], unit, count[kept], np.sort(t)[count[kept] - 1], sigma[kept]))
    return found


def _sigma(run: RunFolder, entries: list[Entry]) -> Row | None:
    """Sigma of the predictions that share the unit of the leading one; without curves that of the orbit itself."""
    curves = curves_of(run)
    curves = [one for one in curves if one[1] == curves[0][1]][:MOST_CURVES]
    if curves:
        factor, unit = scale_of(float(curves[0][4][-1]), curves[0][1])
        lines = [(name, when, factor * sigma) for name, _, _, when, sigma in curves]
        label = f"σ of prediction, {unit}"
    else:
        lines, unit = _history(run), "km"
        label = "σ of position, km"
    lines = [(name, when, np.where(sigma < UNDETERMINED * sigma[-1], sigma, np.nan)) for name, when, sigma in lines]
    if not lines:
        return None
    values = np.concatenate([sigma for _, _, sigma in lines])
    looks = [("", ""), ("6 2", ""), ("2 2", ""), ("8 2 2 2", "")]

    def draw(panel: Panel) -> None:
        for (name, when, sigma), (dashes, _) in zip(lines, looks):
            panel.line(when / SECONDS_PER_DAY, sigma, name, **_stroke(dashes))

    entries += [("line", f"σ: {name}", _stroke(dashes)) for (name, _, _), (dashes, _) in zip(lines, looks)]
    return logarithmic(values[np.isfinite(values)], label, most=5), draw, 1.5 * TALL


def _stroke(dashes: str) -> dict[str, Any]:
    look: dict[str, Any] = {"stroke": INK if not dashes else GREY, "stroke_width": 2.0 if not dashes else 1.5}
    return look | ({"stroke_dasharray": dashes} if dashes else {})


def _history(run: RunFolder) -> list[tuple[str, Array, Array]]:
    """Position sigma at the reference epoch, of the first estimator that kept it."""
    for e in run.estimators:
        t, sigma = run.array("history_t_s", e["name"]), run.array("history_sigma_position_km", e["name"])
        if t is None or sigma is None:
            continue
        known = np.isfinite(sigma) & (sigma > 0.0)
        if np.count_nonzero(known) > 1:
            few = thin(int(np.count_nonzero(known)), 300)
            return [("position at the reference epoch", t[known][few], sigma[known][few])]
    return []


def _encounter(run: RunFolder, times: Array) -> tuple[float, str] | None:
    """When the leading prediction's encounter is, if that is in the arc or soon after it, and its name."""
    for p in leading(run, run.main) if run.main else []:
        if not p.get("body"):
            continue
        when = Epoch.parse(p["epoch_tdb"]) - run.epoch
        if times.min() <= when <= times.max() + NEXT * np.ptp(times):
            return when, f"encounter, {p['epoch_tdb'][:10]}"
    return None


def _caption(run: RunFolder, columns: Columns | None) -> Markup:
    """What was seen, and how sigma fell."""
    parts = [seen_caption(columns)] if _scheduled_at(columns) and columns is not None else []
    curves = curves_of(run)
    if curves:
        name, unit, count, _, sigma = curves[0]
        half = int(np.searchsorted(count, 0.5 * count[-1]))
        text = Markup("The total sigma of <b>{}</b> is {} after {} of {} measurements and {} at the end.")
        now, then = quantity(float(sigma[-1]), unit), quantity(float(sigma[half]), unit)
        parts.append(text.format(name, then, count[half], count[-1], now))
    return Markup(" ").join(parts)


def _scheduled(columns: Columns | None) -> Any:
    """Every scheduled epoch."""
    if columns is None or not _scheduled_at(columns):
        return None
    few = thin(len(columns["t"]), 4000)
    return csv("visibility", {
        "epoch_tdb": list(columns["epoch_tdb"])[few], "telescope": list(columns["telescope"])[few],
        "seen_or_lost": [why(r) for r in list(columns["reason"])[few]],
        "magnitude_v": [float(v) for v in list(columns.get("magnitude", ["nan"] * len(columns["t"])))[few]],
    })  # fmt: skip


def _sigmas(run: RunFolder) -> Any:
    """Sigma of each prediction as measurements come in."""
    curves = curves_of(run)
    if not curves:
        return None
    rows = [(name, int(n), s / SECONDS_PER_DAY, value, unit)
            for name, unit, count, when, sigma in curves for n, s, value in zip(count, when, sigma)]  # fmt: skip
    heads = ("prediction", "measurements", "days_after_reference", "sigma_total", "unit")
    return csv("sigma-of-predictions", dict(zip(heads, map(list, zip(*rows)))))
