"""Figures over time: accuracy, residuals, noise against nuisance."""

from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.report.kit.chart import Chart, band_grey
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import BLUE, GREY, INK, SERIES, VERMILION, Plate, thin
from nebosvod.report.kit.scale import calendar, linear, logarithmic
from nebosvod.report.kit.wording import NBSP, count, finite, join, number, quantity
from nebosvod.results.folder import Array, Item, RunFolder
from nebosvod.timescale import SECONDS_PER_DAY
from nebosvod.units import ARCSEC

UNDETERMINED_KM = 1.495978707e6  # 0.01 au: a larger position sigma says only that the orbit is not determined yet
MANY = 30  # from so many measurements on, a root mean square says something of the noise model
FORMAL: dict[str, Any] = {"stroke": VERMILION, "stroke_width": 1.4, "stroke_dasharray": "5 3"}
RESIDUALS_WIDE = 182.0  # px of a panel; two stand side by side
MOST = 600  # dots of one telescope in one panel: more cannot be told apart


def sigma_over_time(run: RunFolder) -> Plate | None:
    """Position sigma after each measurement, true and formal, of the first estimator that kept a history."""
    for estimator in run.estimators:
        name = estimator["name"]
        t, true = run.array("history_t_s", name), run.array("history_sigma_position_km", name)
        if t is not None and true is not None and len(t) > 1:
            formal = run.array("history_sigma_formal_position_km", name)
            return _sigma_plate(run, name, np.asarray(t), np.asarray(true), formal)
    return None


def _sigma_plate(run: RunFolder, name: str, t: Array, true: Array, formal: Array | None) -> Plate | None:
    """Draw one history; see `sigma_over_time`."""
    usable = np.isfinite(true) & (true > 0)
    shown = usable & (true < UNDETERMINED_KM)
    if np.count_nonzero(shown) < max(2, len(t) // 2):
        shown = usable
    if np.count_nonzero(shown) < 2:
        return None
    days = t / SECONDS_PER_DAY
    dates, few = calendar(run.epoch, t), thin(int(np.count_nonzero(shown)))
    chart = Chart("history", height=292.0)
    every = true[shown] if formal is None else np.concatenate([true[shown], formal[shown]])
    upper = chart.panel(dates.silenced(), logarithmic(every, "position sigma, km"), top=8.0, bottom=168.0, left=58.0)
    upper.open()
    upper.line(days[shown][few], true[shown][few], "true", stroke=BLUE, stroke_width=2)
    if formal is not None:
        upper.line(days[shown][few], formal[shown][few], "formal", **FORMAL)
    upper.close()
    n = np.arange(1.0, len(t) + 1.0)
    lower = chart.panel(dates, linear([0.0, n[-1]], "count", most=3), top=180.0, bottom=232.0, left=58.0)
    lower.open()
    lower.line(days[thin(len(t))], n[thin(len(t))], "measurements", stroke=INK, stroke_width=1.3)
    lower.close()
    entries: list[tuple[str, str, dict[str, Any]]] = [
        ("line", "true: what the error really is", {"stroke": BLUE, "stroke_width": 2})
    ]
    if formal is not None:
        entries.append(("line", "formal: what the estimator reports", FORMAL))
    chart.height = chart.legend(entries, 274.0, 54.0)
    columns: dict[str, Any] = {
        "days_after_reference": days[thin(len(t))],
        "measurements": n[thin(len(t))],
        "sigma_position_km": true[thin(len(t))],
    }
    if formal is not None:
        columns["sigma_formal_position_km"] = formal[thin(len(t))]
    return chart.plate(
        f"Position sigma of the estimator {name} after each measurement, logarithmic",
        _sigma_caption(name, t, true, formal, shown),
        [csv("history", columns)],
    )


def _sigma_caption(name: str, t: Array, true: Array, formal: Array | None, shown: Any) -> Markup:
    """Where the history starts and ends, when it was last twice the final value, and whether formal and true part."""
    first = int(np.argmax(shown))
    last = float(true[shown][-1])
    late = np.flatnonzero(shown & (true > 2.0 * last))
    text = Markup(
        "Estimator “{}”: the position sigma at the reference epoch falls from {} after {} to {} after {}."
    ).format(
        name,
        quantity(float(true[first]), "km"),
        count(first + 1, "measurement"),
        quantity(last, "km"),
        count(len(t), "measurement"),
    )
    if len(late) and late[-1] + 1 < len(t):
        part = (t[late[-1] + 1] - t[0]) / (t[-1] - t[0])
        text += Markup(" It is within a factor of two of the final value after {}{}% of the arc.").format(
            round(100 * part), NBSP
        )
    if formal is not None:
        ratio = true[shown] / formal[shown]
        worst = float(ratio[np.argmax(np.abs(np.log(ratio)))])
        same = abs(worst - 1) < 0.01
        text += (
            Markup(" Formal and true sigma agree throughout.") if same
            else Markup(" True over formal sigma is {} at its furthest from 1.").format(quantity(worst))
        )  # fmt: skip
    if first:
        cut = quantity(UNDETERMINED_KM / 1.495978707e8, "", 1)
        text += Markup(" Earlier values, above {}{}au or undefined, are not shown.").format(cut, NBSP)
    return text


def residuals(run: RunFolder, estimator: Item) -> Plate | None:
    """Residuals after the fit in RA* and Dec, a row for each telescope, with the band of one sigma."""
    after, t = run.array("residual_after", estimator["name"]), run.array("epoch_s")
    index, sigma = run.array("telescope_index"), run.array("sigma_measurement")
    if after is None or t is None or index is None or not len(t):
        return None
    after = after / ARCSEC
    sigma = None if sigma is None else sigma / ARCSEC
    seen = [i for i in range(len(run.telescopes)) if np.any(index == i)]
    known = np.abs(after[np.isfinite(after)])
    if not known.size:
        return None
    reach = float(known.max()) * 1.04 or 1.0
    unit, factor = ("mas", 1e3) if reach < 0.1 else ("arcsec", 1.0)
    y = linear([-factor * reach, factor * reach], f"residual, {unit}", pad=0.0, most=4)
    dates = calendar(run.epoch, t, most=2.6).within(RESIDUALS_WIDE, 10.0, 4.0)
    chart = Chart("residuals", height=42.0 + 112.0 * len(seen))
    for row, i in enumerate(seen):
        mine = np.flatnonzero(index == i)
        mine = mine[thin(len(mine), MOST)]
        for column, part in enumerate(("RA cos Dec", "Dec")):
            band = None if sigma is None else factor * sigma[mine, column]
            left = (54.0, 252.0)[column]
            last = row == len(seen) - 1
            x, side = dates if last else dates.silenced(), y if column == 0 else y.silenced()
            panel = chart.panel(
                x,
                side,
                top=18.0 + 112.0 * row,
                bottom=108.0 + 112.0 * row,
                left=left,
                right=left + RESIDUALS_WIDE,
                title=f"{run.telescopes[i]}, {part}",
            )
            days = t[mine] / SECONDS_PER_DAY
            if band is not None:
                panel.band(days, -band, band, **band_grey())
            panel.level(0.0, stroke=GREY, stroke_width=0.7)
            panel.open()
            colour, marker = SERIES[(i + 1) % len(SERIES)]
            panel.dots(
                days,
                factor * after[mine, column],
                marker,
                f"{run.telescopes[i]}, {part}",
                color=colour,
                size=2.6,
                opacity=0.85,
            )
            panel.close()
    label = f"Residuals of the estimator {estimator['name']} in right ascension and declination, by telescope"
    few = thin(len(t))
    columns = {"days_after_reference": (t / SECONDS_PER_DAY)[few], "telescope": [run.telescopes[i] for i in index[few]],
               "residual_ra_arcsec": after[few, 0], "residual_dec_arcsec": after[few, 1]}  # fmt: skip
    return chart.plate(
        label, _residual_caption(run, estimator, after, sigma, np.asarray(index), seen), [csv("residuals", columns)]
    )


def _residual_caption(
    run: RunFolder, estimator: Item, after: Array, sigma: Array | None, index: Any, seen: list[int]
) -> Markup:
    """Root mean squares, and how they compare with the noise sigma."""
    parts = []
    for i in seen:
        rms = np.sqrt(np.mean(after[index == i] ** 2, axis=0))
        text = Markup("{}: {} in RA cos Dec and {} in Dec").format(
            run.telescopes[i], quantity(float(rms[0]), "arcsec"), quantity(float(rms[1]), "arcsec")
        )
        parts.append(text)
    caption = Markup("Residuals after the fit of “{}”, root mean square {}.").format(estimator["name"], join(parts))
    if sigma is None:
        return caption
    normal = after / sigma
    outside = float(np.mean(np.abs(normal) > 3.0))
    caption += Markup(
        " The grey band is ±1σ of the measurement noise alone; {} of the residuals lie inside it "
        "(68{}% of Gaussian noise would)."
    ).format(f"{100 * float(np.mean(np.abs(normal) <= 1.0)):.0f}{NBSP}%", NBSP)
    if outside > 0 and len(after) >= MANY:
        beyond = int(np.sum(np.abs(normal) > 3.0))
        caption += Markup(" Beyond 3σ: {} of {}.").format(beyond, count(normal.size, "component"))
    return caption


NUISANCES = {"parameters": "dynamic parameters", "position": "telescope position"}


def noise_to_nuisance(run: RunFolder) -> Plate | None:
    """Noise-to-nuisance ratio of each measurement, dB, and the telescope position error that equals the noise."""
    block = run.summary.get("noise_to_nuisance") or {}
    eta, t, index = block.get("eta_db"), run.array("epoch_s"), run.array("telescope_index")
    if not eta or t is None or index is None or len(eta) != len(t) or np.ptp(t) == 0.0:
        return None
    values = np.array([v if finite(v) else np.nan for v in eta])
    if not np.any(np.isfinite(values)):
        return None
    critical = np.array([v if finite(v) else np.nan for v in block.get("sigma_z_critical_km") or [None] * len(t)])
    chart = Chart("nuisance", height=0.0)
    dates = calendar(run.epoch, t)
    both = bool(np.any(np.isfinite(critical)))
    low = float(np.nanmin(values))
    panels = [
        (
            chart.panel(
                dates.silenced() if both else dates,
                linear([*values, 0.0] if low > 0 else values, "noise to nuisance, dB", most=5),
                top=8.0,
                bottom=132.0,
                left=58.0,
            ),
            values,
        )
    ]
    panels[0][0].level(0.0, stroke=INK, stroke_width=0.9)
    goal = block.get("eta_min_db")
    if finite(goal) and low < goal < float(np.nanmax(values)):
        panels[0][0].level(goal, stroke=INK, stroke_width=0.9, stroke_dasharray="5 3")
    if both:
        panels.append(
            (chart.panel(dates, logarithmic(critical, "critical σ, km"), top=146.0, bottom=238.0, left=58.0), critical)
        )
    for panel, series in panels:
        panel.open()
        for i, name in enumerate(run.telescopes):
            mine = np.flatnonzero(index == i)
            few, (colour, marker) = thin(len(mine), MOST), SERIES[(i + 1) % len(SERIES)]
            # a second telescope with the same ratio stays visible inside the first one's marker
            panel.dots(
                t[mine][few] / SECONDS_PER_DAY,
                series[mine][few],
                marker,
                name,
                color=colour,
                size=4.4 if i == 0 else 2.2,
            )
        panel.close()
    chart.height = chart.legend(_telescope_marks(run, index), (238.0 if both else 132.0) + 44.0, 54.0)
    few = thin(len(t))
    columns = {"days_after_reference": (t / SECONDS_PER_DAY)[few], "telescope": [run.telescopes[i] for i in index[few]],
               "noise_to_nuisance_db": values[few], "critical_position_sigma_km": critical[few]}  # fmt: skip
    return chart.plate(
        "Noise-to-nuisance ratio of each measurement in decibels, and critical telescope position error, over time",
        _nuisance_caption(run, block, values, critical),
        [csv("noise-to-nuisance", columns)],
    )


def _telescope_marks(run: RunFolder, index: Array) -> list[tuple[str, str, dict[str, Any]]]:
    """Legend of the telescopes that measure anything."""
    return [
        (SERIES[(i + 1) % len(SERIES)][1], name, {"color": SERIES[(i + 1) % len(SERIES)][0], "size": 5.0})
        for i, name in enumerate(run.telescopes)
        if np.any(index == i)
    ]


def _nuisance_caption(run: RunFolder, block: Item, values: Array, critical: Array) -> Markup:
    """Mean and range of the ratio, and what it means."""
    worse = float(np.mean(values[np.isfinite(values)] < 0.0))
    named = join(NUISANCES.get(group, group) for group in block.get("nuisances") or ["all"])
    text = Markup(
        "Power of the measurement noise over that of the nuisances ({}) in each measurement: {}{}dB on average (a "
        "ratio of sums), {}{}dB in the median one, {} to {}{}dB."
    ).format(
        named,
        quantity(block.get("eta_db_mean")),
        NBSP,
        quantity(float(np.nanmedian(values))),
        NBSP,
        quantity(float(np.nanmin(values))),
        quantity(float(np.nanmax(values))),
        NBSP,
    )
    if worse == 0.0:
        text += Markup(" Noise outweighs the nuisances in every single measurement.")
    else:
        text += Markup(" Below 0{}dB the nuisances outweigh the noise: {}{}% of the measurements.").format(
            NBSP, round(100 * worse), NBSP
        )
    every, goal = block.get("eta_all_db_mean"), block.get("eta_min_db")
    if every is not None:
        text += Markup(" With all nuisances of the mission the mean is {}{}dB.").format(quantity(every), NBSP)
    if goal is not None:
        text += Markup(" {} of {} stay below the {}{}dB that are wanted.").format(
            block["n_below_eta_min"], count(len(values), "measurement"), number(goal), NBSP
        )
    if finite(block.get("sigma_nuisance_arcsec")):
        text += Markup(" The nuisances act as an error of {} of one measurement, with the noise {}.").format(
            quantity(block["sigma_nuisance_arcsec"], "arcsec"), quantity(block["sigma_equivalent_arcsec"], "arcsec")
        )
    effective = block.get("eta_effective_db_mean")
    if effective is not None:
        text += Markup(
            " A common nuisance does not average out: counted with every measurement it touches, the mean is {}{}dB."
        ).format(quantity(effective), NBSP)
    if np.any(np.isfinite(critical)):
        text += Markup(
            " A telescope position error as large as the noise of one measurement is {} at the least, {} at the most."
        ).format(quantity(float(np.nanmin(critical)), "km"), quantity(float(np.nanmax(critical)), "km"))
    return text
