"""Sigma of each prediction against number of measurements, arc length, cadence and telescope noise, with slopes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.mission.slugs import array_name
from nebosvod.report.kit.chart import Chart, Panel
from nebosvod.report.kit.download import Download, csv
from nebosvod.report.kit.facts import leading
from nebosvod.report.kit.plate import BLUE, GREEN, GREY, INK, PURPLE, Plate
from nebosvod.report.kit.scale import logarithmic
from nebosvod.report.kit.wording import NBSP, finite, quantity, scale_of
from nebosvod.report.run.tables import Cell, Table
from nebosvod.results.folder import Array, Item, RunFolder

WORLDS: Mapping[str, tuple[str, dict[str, Any]]] = {
    "all": ("everything", {"stroke": INK, "stroke_width": 2.0}),
    "noise_and_prior": ("noise and prior", {"stroke": GREEN, "stroke_width": 1.5, "stroke_dasharray": "6 2"}),
    "noise_only": ("noise only", {"stroke": BLUE, "stroke_width": 1.5, "stroke_dasharray": "2 2"}),
    "prior_only": ("prior only", {"stroke": PURPLE, "stroke_width": 1.5, "stroke_dasharray": "8 2 2 2"}),
}
GUIDE: dict[str, Any] = {"stroke": GREY, "stroke_width": 1.0, "stroke_dasharray": "1 3"}
MOST = 2e3  # times the final sigma, above which a curve says only that the orbit is not determined yet
SATURATED = -0.1  # a slope above this: more of the same brings next to nothing


def curve_plates(run: RunFolder) -> list[Plate]:
    """A figure of four panels for each prediction, the leading one first."""
    blocks = run.summary.get("curves") or []
    order = [p["name"] for p in leading(run, run.main)] if run.main else []
    blocks = sorted(blocks, key=lambda b: order.index(b["prediction"]) if b["prediction"] in order else len(order))
    return [p for p in (_curve_plate(block) for block in blocks) if p is not None]


def _numbers(values: Sequence[Any] | None) -> Array:
    """Values of a curve, nan where there is none."""
    return np.array([v if finite(v) else np.nan for v in values or []], dtype=np.float64)


def _curve_plate(block: Item) -> Plate | None:
    """Sigma against number of measurements, arc, cadence and noise, on one scale."""
    unit, counted = block["unit"], block["measurements"]
    every = {name: _numbers(counted.get(f"{name}_{unit}")) for name in ("all", "noise_and_prior", "noise_only")}
    sparse, noisy = (_numbers(block[k][f"sigma_total_{unit}"]) for k in ("cadence", "telescope_noise"))
    finals = every["all"][np.isfinite(every["all"])]
    if not len(finals) or not finals[-1] > 0.0:
        return None
    factor, text = scale_of(float(finals[-1]), unit)
    every = {k: np.where((v > 0.0) & (v < MOST * finals[-1]), v * factor, np.nan) for k, v in every.items() if len(v)}
    values = [v for curve in (*every.values(), sparse * factor, noisy * factor) for v in curve]
    y = logarithmic(values, f"total σ, {text}", most=5)
    key = "curves-" + array_name(block["prediction"]).replace("_", "-")
    chart = Chart(key, height=0.0)
    edge = 18.0 + 5.7 * y.width + 5.0
    wide = (440.0 - 13.0 - edge - 16.0) / 2.0
    boxes = [(left, left + wide, top, top + 112.0) for top in (18.0, 184.0) for left in (edge, edge + wide + 16.0)]
    count, days = _numbers(counted["count"]), _numbers(counted["days"])
    every_m, noise_f = _numbers(block["cadence"]["every"]), _numbers(block["telescope_noise"]["factor"])
    axes = ((count, "measurements"), (np.where(days > 0, days, np.nan), "arc, days"),
            (every_m, "every m-th exposure"), (noise_f, "times the telescope noise"))  # fmt: skip
    panels = []
    for i, ((x, name), (left, right, top, bottom)) in enumerate(zip(axes, boxes)):
        good = x if i > 1 else x[np.isfinite(every["all"])]
        if not np.any(np.isfinite(good)):
            good = x
        scale = logarithmic(good, name, most=4)
        panels.append(
            chart.panel(scale, y if i % 2 == 0 else y.silenced(), top=top, bottom=bottom, left=left, right=right)
        )
    _draw_curves(panels, axes, every, sparse * factor, noisy * factor, counted.get(f"prior_only_{unit}"), factor, block)
    used = [k for k in WORLDS if k in every and np.any(np.isfinite(every[k]))]
    used += ["prior_only"] if finite(counted.get(f"prior_only_{unit}")) else []
    entries = [("line", WORLDS[k][0], WORLDS[k][1]) for k in used] + [
        ("line", "averaging alone, or proportional to noise", GUIDE)
    ]
    chart.height = chart.legend(entries, 342.0)
    label = f"Sigma of {block['prediction']} against number of measurements, arc length, cadence and telescope noise"
    return chart.plate(label, curve_caption(block), _curve_data(key, block))


def _draw_curves(panels: list[Panel], axes: Any, every: Mapping[str, Array], sparse: Array, noisy: Array,
                 prior: object, factor: float, block: Item) -> None:  # fmt: skip
    """The lines of the four panels and their asymptotes."""
    for panel, (x, _) in zip(panels[:2], axes[:2]):
        last = every["all"][-1]
        if panel is panels[0] and np.isfinite(last):
            guide = last * (x / x[-1]) ** block["measurements"]["expected_slope"]
            panel.line(x, np.where((guide < panel.y.high) & (x >= panel.x.low), guide, np.nan), **GUIDE)
        panel.open()
        for name, curve in reversed(list(every.items())):
            inside = (x >= panel.x.low) & np.isfinite(x)
            panel.line(x[inside], curve[inside], WORLDS[name][0], **WORLDS[name][1])
        panel.close()
        if finite(prior) and panel.y.low < prior * factor < panel.y.high:
            panel.level(prior * factor, **WORLDS["prior_only"][1])
    everything = WORLDS["all"][1]
    (m, _), (f, _) = axes[2:]
    guide = sparse[0] * (m / m[0]) ** -block["cadence"]["expected_slope"]
    panels[2].line(m, np.where(guide < panels[2].y.high, guide, np.nan), **GUIDE)
    guide = noisy[-1] * (f / f[-1]) ** block["telescope_noise"]["expected_slope_noisy"]
    panels[3].line(f, np.where(guide > panels[3].y.low, guide, np.nan), **GUIDE)
    for panel, x, curve in ((panels[2], m, sparse), (panels[3], f, noisy)):
        panel.open()
        panel.line(x, curve, **everything)
        panel.dots(x, curve, "o", "everything", color=INK, size=4.0)
        panel.close()


def curve_caption(block: Item) -> Markup:
    """The slopes, and what is left when the noise goes."""
    unit, counted, noise = block["unit"], block["measurements"], block["telescope_noise"]
    slopes = counted.get("slope") or {}
    text = Markup("<b>{}</b>.").format(block["prediction"])
    if finite(slopes.get("all")):
        text += Markup(" Over the second half of the measurements sigma falls as their number to the power {}").format(
            quantity(slopes["all"], "", 2)
        )
        steep = slopes["all"] < 1.2 * counted["expected_slope"]
        text += (Markup(": faster than averaging alone (−0.5), the arc still grows.") if steep else
                 Markup(": more of the same brings next to nothing.") if slopes["all"] > SATURATED else
                 Markup(" (averaging alone: −0.5)."))  # fmt: skip
    now = next((s for f, s in zip(noise["factor"], noise[f"sigma_total_{unit}"]) if f == 1.0), None)
    floor = next((v for v in noise[f"sigma_total_{unit}"] if finite(v)), None)
    if finite(now) and finite(floor) and floor > 0 and now > 0:
        least = noise["factor"][0]
        text += Markup(" With {:g}{}% of the noise {} would be left of {}: what nuisances cost.").format(
            100 * least, NBSP, quantity(floor, unit), quantity(now, unit))  # fmt: skip
    sparse, every = block["cadence"][f"sigma_total_{unit}"], block["cadence"]["every"]
    if len(every) > 1 and finite(sparse[1]) and finite(sparse[0]) and sparse[0] > 0:
        text += Markup(" One exposure in {} alone would give {}.").format(every[1], quantity(sparse[1], unit))
    return text


def _curve_data(key: str, block: Item) -> list[Download]:
    """Three files: by number and arc, by cadence, by noise."""
    unit, counted = block["unit"], block["measurements"]
    worlds = [k for k in counted if k.endswith(f"_{unit}") and isinstance(counted[k], list)]
    first = {
        "measurements": counted["count"],
        "arc_days": counted["days"],
        **{f"sigma_{k}": counted[k] for k in worlds},
    }
    sigma = f"sigma_total_{unit}"
    return [
        csv(f"{key}-number", first),
        csv(f"{key}-cadence", {k: block["cadence"][k] for k in ("every", "count", sigma)}),
        csv(f"{key}-noise", {k: block["telescope_noise"][k] for k in ("factor", sigma)}),
    ]


def slope_table(run: RunFolder) -> Table | None:
    """Asymptotic slopes of all curves."""
    rows: list[tuple[Cell, ...]] = []
    for b in run.summary.get("curves") or []:
        slope = b["measurements"].get("slope") or {}
        rows.append((
            b["prediction"], *(quantity(slope.get(k), "", 3) for k in ("noise_only", "noise_and_prior", "all")),
            quantity(b["cadence"].get("slope")),
            *(quantity(b["telescope_noise"].get(k)) for k in ("slope_quiet", "slope_noisy")),
            quantity(b["measurements"].get(f"prior_only_{b['unit']}"), b["unit"]),
        ))  # fmt: skip
    if not rows:
        return None
    return Table(
        caption="Slopes of the curves in logarithms over their last octave (averaging alone: −0.5 by number; "
        "proportional to the noise: 1)",
        head=("prediction", "by number, noise only", "noise and prior", "everything", "by number, sparser cadence",
              "by noise, quiet end", "noisy end", "prior alone"),
        align="lrrrrrrr", rows=tuple(rows),
    )  # fmt: skip
