"""The figure of a filter: how well the current state is known, the largest bias as it was followed, the innovations."""

from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.report.kit.chart import Chart, Panel, band_grey
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import BLUE, GREY, INK, SERIES, VERMILION, Plate, thin
from nebosvod.report.kit.scale import Scale, calendar, linear, logarithmic
from nebosvod.report.kit.wording import count, number, quantity
from nebosvod.results.folder import Array, Item, RunFolder
from nebosvod.timescale import SECONDS_PER_DAY

SMOOTHED: dict[str, Any] = {"stroke": VERMILION, "stroke_width": 1.4, "stroke_dasharray": "5 3"}
FILTERED: dict[str, Any] = {"stroke": BLUE, "stroke_width": 2}


def filter_plates(run: RunFolder) -> list[Plate]:
    """A figure for the first filter that kept its history."""
    for estimator in run.estimators:
        t = run.array("filter_t_s", estimator["name"])
        if t is not None and len(t) > 1:
            return [_plate(run, estimator, np.asarray(t))]
    return []


def _plate(run: RunFolder, estimator: Item, t: Array) -> Plate:
    """Three panels under one calendar."""
    name = estimator["name"]

    def array(what: str) -> Array:
        return np.asarray(run.arrays[what] if what in run.arrays else run.array(what, name))

    few = thin(len(t))
    days = (t / SECONDS_PER_DAY)[few]
    now, after = (_position_sigma(array(f"{kind}_factor"))[few] for kind in ("filter", "smoothed"))
    normal = (array("innovation") / array("innovation_sigma"))[few]
    dates = calendar(run.epoch, t)
    followed = _followed(array, few)
    chart = Chart("filter", height=300.0 if followed is None else 420.0)
    upper = chart.panel(
        dates.silenced(),
        logarithmic(np.concatenate([now, after]), "position sigma, km"),
        top=8.0,
        bottom=118.0,
        left=58.0,
    )
    _two_lines(upper, days, now, after)
    bottom = 118.0
    if followed is not None:
        _bias_panel(chart, dates.silenced(), days, followed)
        bottom = 238.0
    reach = max(float(np.abs(normal).max()) * 1.05, 4.0)
    lower = chart.panel(
        dates,
        linear([-reach, reach], "innovation, σ", pad=0.0, most=4),
        top=bottom + 14.0,
        bottom=bottom + 114.0,
        left=58.0,
    )
    for level in (-3.0, 0.0, 3.0):
        lower.level(level, stroke=GREY, stroke_width=0.7)
    lower.open()
    for column, part in enumerate(("RA cos Dec", "Dec")):
        colour, marker = SERIES[column]
        lower.dots(days, normal[:, column], marker, part, color=colour, size=2.4, opacity=0.85)
    lower.close()
    entries: list[tuple[str, str, dict[str, Any]]] = [
        ("line", "from the measurements so far", FILTERED),
        ("line", "from all (smoothed)", SMOOTHED),
        *((SERIES[k][1], part, {"color": SERIES[k][0], "size": 2.4}) for k, part in enumerate(("RA cos Dec", "Dec"))),
    ]
    chart.height = chart.legend(entries, bottom + 158.0, 54.0)
    columns: dict[str, Any] = {
        "days_after_reference": days,
        "sigma_position_km": now,
        "smoothed_sigma_position_km": after,
        "innovation_ra_sigmas": normal[:, 0],
        "innovation_dec_sigmas": normal[:, 1],
    }
    if followed is not None:
        columns |= dict(zip(("bias", "bias_sigma", "bias_smoothed", "bias_smoothed_sigma"), followed[1:]))
    return chart.plate(
        f"The filter {name} after each measurement: position sigma, the bias it follows, its innovations",
        _caption(estimator, len(t), now, after, followed),
        [csv("filter", columns)],
    )


Followed = tuple[str, Array, Array, Array, Array]


def _followed(array: Any, few: slice) -> Followed | None:
    """The bias, in arcsec, that is the most of its sigmas from zero in the end: filtered and smoothed with sigmas."""
    names = [str(one) for one in array("filter_names")]
    biases = [k for k, one in enumerate(names) if one.endswith("_arcsec")]
    if not biases:
        return None
    kinds = ("filter_beside", "filter_beside_sigma", "smoothed_beside", "smoothed_beside_sigma")
    now, sigma, after, after_sigma = (array(kind)[few] for kind in kinds)
    k = max(biases, key=lambda one: float(np.abs(after[:, one] / after_sigma[:, one]).max()))
    return names[k].removesuffix("_arcsec"), now[:, k], sigma[:, k], after[:, k], after_sigma[:, k]


def _bias_panel(chart: Chart, dates: Scale, days: Array, followed: Followed) -> None:
    """A bias as the filter followed it, with the band of one sigma."""
    name, now, sigma, after, _ = followed
    label = "arcsec"
    panel = chart.panel(
        dates, linear(np.concatenate([now - sigma, now + sigma]), label, most=4), top=138.0, bottom=238.0, left=58.0,
        title=name,
    )  # fmt: skip
    panel.band(days, now - sigma, now + sigma, **band_grey())
    panel.level(0.0, stroke=INK, stroke_width=0.6)
    _two_lines(panel, days, now, after)


def _two_lines(panel: Panel, days: Array, now: Array, after: Array) -> None:
    """What is known so far, and from all measurements."""
    panel.open()
    panel.line(days, now, "so far", **FILTERED)
    panel.line(days, after, "smoothed", **SMOOTHED)
    panel.close()


def _position_sigma(factor: Array) -> Array:
    """Root trace (n,) of the position block of covariances from factors (n, 6, 6)."""
    return np.asarray(np.sqrt(np.sum(factor[:, :3] ** 2, axis=(1, 2))))


def _caption(estimator: Item, n: int, now: Array, after: Array, followed: Followed | None) -> Markup:
    """Where it ends, what smoothing gains, and whether the innovations are as they should be."""
    text = Markup("Filter “{}”: the position where the object is then is known to {} after the last of {}").format(
        estimator["name"], quantity(float(now[-1]), "km"), count(n, "measurement")
    )
    text += Markup(", and to {} at the first one from all of them.").format(quantity(float(after[0]), "km"))
    if followed is not None:
        name, _, _, last, sigma = followed
        text += Markup(" {} in the end: {} ± {}.").format(
            name, quantity(float(last[-1]), "arcsec"), quantity(float(sigma[-1]), "arcsec")
        )
    seen = estimator["innovations"]
    low, high = seen["nis_interval_99"]
    inside = low <= seen["nis_mean"] <= high
    text += Markup(" Innovations: mean square {} of what the filter expects ({} to {} with 99 %), {}.").format(
        number(seen["nis_mean"]),
        number(low),
        number(high),
        "as it should be" if inside else "which is not as it should be",
    )
    return text
