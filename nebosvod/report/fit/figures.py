"""Figures of a fit: residuals over time, on the sky and by station, correlations of the elements."""

from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from nebosvod.estimation.accuracy.formed import matrix_of
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.edge import at_edge
from nebosvod.report.kit.plate import BLUE, GREY, INK, VERMILION, Plate, thin
from nebosvod.report.kit.scale import calendar, linear, named
from nebosvod.report.kit.wording import MINUS, NBSP, count, number, quantity, signed
from nebosvod.results.folder import Array, Item, RunFolder
from nebosvod.timescale import SECONDS_PER_DAY
from nebosvod.units import ARCSEC

Flags = npt.NDArray[np.bool_]
REACH = 1.25  # of the largest selected residual: what lies beyond stands at the edge with its value
STATIONS = 24  # drawn; the table has them all
REJECTED: dict[str, Any] = {"color": VERMILION, "size": 3.4}
SELECTED: dict[str, Any] = {"color": BLUE, "size": 2.6, "opacity": 0.75}


def residual_plates(run: RunFolder) -> list[Plate]:
    """Residuals over time and on the sky; nothing where the fit left none."""
    v, t, selected = run.array("residual"), run.array("epoch_s"), run.array("selected")
    if v is None or t is None or selected is None or not len(t):
        return []
    chosen = np.asarray(selected, dtype=bool)
    return [_over_time(run, v / ARCSEC, np.asarray(t), chosen), _on_the_sky(v / ARCSEC, chosen)]


def _reach(v: Array, chosen: Flags) -> float:
    """Half height of the axes, arcsec: all selected residuals lie inside."""
    kept = v[chosen] if chosen.any() else v
    return REACH * (float(np.abs(kept).max()) or 1.0)


def _over_time(run: RunFolder, v: Array, t: Array, chosen: Flags) -> Plate:
    """RA* above, Dec below; rejected ones in red, those off the axis as arrowheads with their value."""
    reach, dates = _reach(v, chosen), calendar(run.epoch, t)
    chart = Chart("residuals-by-time", height=330.0)
    days = t / SECONDS_PER_DAY
    for row, part in enumerate(("RA cos Dec", "Dec")):
        y = linear([-reach, reach], "arcsec", pad=0.0, most=5)
        top = 20.0 + 146.0 * row
        panel = chart.panel(
            dates if row else dates.silenced(), y, top=top, bottom=top + 118.0, left=54.0, title=f"residual in {part}"
        )
        panel.level(0.0, stroke=GREY, stroke_width=0.7)
        panel.open()
        few = np.flatnonzero(chosen)[thin(int(chosen.sum()))]
        panel.dots(days[few], v[few, row], "o", f"selected, {part}", **SELECTED)
        out = np.flatnonzero(~chosen)[thin(int((~chosen).sum()))]
        far = np.abs(v[out, row]) > reach
        panel.dots(days[out][~far], v[out, row][~far], "v", f"rejected, {part}", **REJECTED)
        panel.close()
        at_edge(panel, days[out], v[out, row], [signed(one) for one in v[out, row]], VERMILION)
    entries: list[tuple[str, str, dict[str, Any]]] = [("o", "selected", SELECTED)]
    if (~chosen).any():
        entries.append(("v", "rejected (arrowhead: off the axis, with its value)", REJECTED))
    chart.height = chart.legend(entries, 322.0, 52.0)
    rms = np.sqrt(np.mean(v[chosen] ** 2, axis=0)) if chosen.any() else np.zeros(2)
    caption = Markup(
        "Observed minus computed after the fit, by time. {} selected, rms {} in RA cos Dec and {} in Dec; {} rejected."
    ).format(
        count(int(chosen.sum()), "observation"),
        quantity(float(rms[0]), "arcsec"),
        quantity(float(rms[1]), "arcsec"),
        int((~chosen).sum()),
    )
    columns = {
        "days_after_epoch": days,
        "station": [run.telescopes[i] for i in _index(run)],
        "residual_ra_arcsec": v[:, 0],
        "residual_dec_arcsec": v[:, 1],
        "selected": [bool(one) for one in chosen],
    }
    return chart.plate("Residuals in right ascension and declination by time", caption, [csv("residuals", columns)])


def _on_the_sky(v: Array, chosen: Flags) -> Plate:
    """Residuals as points of the plane, east to the left."""
    reach = _reach(v, chosen)
    chart = Chart("residuals-sky", width=340.0, height=330.0)
    x = linear([-reach, reach], "RA cos Dec, arcsec", pad=0.0, most=5).reversed()
    y = linear([-reach, reach], "Dec, arcsec", pad=0.0, most=5)
    panel = chart.panel(x, y, top=8.0, bottom=278.0, left=56.0, right=326.0)
    panel.level(0.0, stroke=GREY, stroke_width=0.7)
    panel.upright(0.0, stroke=GREY, stroke_width=0.7)
    panel.open()
    few = np.flatnonzero(chosen)[thin(int(chosen.sum()))]
    panel.dots(v[few, 0], v[few, 1], "o", "selected", **SELECTED)
    inside = ~chosen & (np.abs(v) <= reach).all(axis=1)
    panel.dots(v[inside, 0], v[inside, 1], "v", "rejected", **REJECTED)
    panel.close()
    out = v[np.flatnonzero(~chosen)[thin(int((~chosen).sum()))]]
    at_edge(panel, out[:, 0], out[:, 1], [f"{signed(a)}, {signed(b)}" for a, b in out], VERMILION)
    beyond = int((~chosen & ~inside).sum())
    mean = v[chosen].mean(axis=0) if chosen.any() else np.zeros(2)
    caption = Markup("The same on the sky, east to the left. Mean of the selected: {} and {}.").format(
        quantity(float(mean[0]), "arcsec"), quantity(float(mean[1]), "arcsec")
    )
    if beyond:
        caption += Markup(" {} rejected off the picture: arrowheads at its edge, RA cos Dec and Dec beside.").format(
            beyond
        )
    return chart.plate("Residuals on the sky", caption)


def station_plate(rows: list[Item]) -> Plate | None:
    """Mean and root mean square by station, RA* and Dec side by side."""
    shown = [row for row in rows if row["rms_ra_arcsec"] is not None][:STATIONS]
    if len(shown) < 2:
        return None
    names = [f"{row['station']} ({row['n_selected']})" for row in shown]
    height = 18.0 * len(shown)
    chart = Chart("stations", height=height + 84.0)
    largest = max(max(row[f"rms_{axis}_arcsec"] for axis in ("ra", "dec")) for row in shown)
    for column, (axis, title) in enumerate((("ra", "RA cos Dec"), ("dec", "Dec"))):
        x = linear([-largest, largest], "arcsec", most=6)
        y = named(names) if column == 0 else named(names).silenced()
        left, right = ((78.0, 246.0), (256.0, 424.0))[column]
        panel = chart.panel(x, y, top=20.0, bottom=20.0 + height, left=left, right=right, title=title)
        panel.upright(0.0, stroke=GREY, stroke_width=0.7)
        panel.open()
        for place, row in enumerate(shown):
            rms, mean = row[f"rms_{axis}_arcsec"], row[f"mean_{axis}_arcsec"]
            tip = f"{row['station']}: rms {rms:.3f}, mean {mean:+.3f} arcsec"
            panel.bar(-rms, rms, -float(place), 7.0, tip, fill=BLUE, fill_opacity=0.3)
            panel.marks([(mean, -float(place))], "|", row["station"], color=INK)
        panel.close()
    bar, mark = {"fill": BLUE, "fill_opacity": 0.3}, {"color": INK}
    chart.height = chart.legend([("box", "± rms", bar), ("|", "mean", mark)], height + 66.0, 76.0)
    more = len([row for row in rows if row["rms_ra_arcsec"] is not None]) - len(shown)
    caption = Markup("Selected residuals by station (number of observations in brackets), most observations first.")
    if more > 0:
        caption += Markup(" {} more in the table.").format(count(more, "station"))
    caption += Markup(
        " Of few observations a mean is beyond rms/√n by chance; what is more than chance is said below. A mean that "
        "stays there is a bias: name the station under <code>uncertainty</code>."
    )
    return chart.plate("Mean and root mean square of the residuals by station", caption)


def correlation_plate(elements: Item) -> Plate:
    """Correlations of the elements as a square of shades."""
    names = {"e": "e", "q_au": "q", "tp_jd_tdb": "tp", "node_deg": "node", "peri_deg": "peri", "i_deg": "i"}
    K = matrix_of(elements, "covariance", "factor")
    if K is None:
        raise ValueError("elements without a covariance have no correlations")
    sigma = np.sqrt(np.diag(K))
    r = K / sigma[:, None] / sigma
    labels = [names[name] for name in elements["names"]]
    side, left, top = 44.0, 46.0, 8.0
    chart = Chart("correlation", width=left + 6 * side + 14.0, height=top + 6 * side + 26.0)
    for i, row in enumerate(labels):
        chart.text(left - 6.0, top + side * i + side / 2 + 3.6, row, anchor="end")
        chart.text(left + side * i + side / 2, top + 6 * side + 14.0, row, anchor="middle")
        for j in range(6):
            chart.box(
                left + side * j, top + side * i, side - 1.5, side - 1.5,
                fill=VERMILION if r[i, j] < 0 else BLUE, fill_opacity=round(0.04 + 0.66 * abs(float(r[i, j])), 3),
            )  # fmt: skip
            x, y = left + side * j + side / 2, top + side * i + side / 2 + 3.6
            chart.text(x, y, _correlation(float(r[i, j])), anchor="middle")
    off = np.abs(r - np.eye(6))
    first, second = divmod(int(off.argmax()), 6)
    caption = Markup("Correlations of the elements (blue +, orange −). The strongest: {} with {}, {}.").format(
        labels[first], labels[second], number(float(r[first, second]), 6).replace(" ", NBSP)
    )
    return chart.plate("Correlations of the elements", caption)


def _correlation(r: float) -> str:
    """`+0.98`, `−1.00`, `0.00` without a sign."""
    text = f"{r:+.2f}"
    return text[1:] if text in ("+0.00", "-0.00") else text.replace("-", MINUS)


def _index(run: RunFolder) -> list[int]:
    """Place of the telescope of each observation."""
    found = run.array("telescope_index")
    return [] if found is None else [int(one) for one in found]
