"""Figures over time: accuracy, residuals, noise against nuisance."""

from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.report.folder import Array, Item, RunFolder
from nebosvod.report.plate import BLUE, GREY, INK, SERIES, VERMILION, Plate, figure, log_axis, plate, thin, time_axis
from nebosvod.report.wording import NBSP, count, finite, join, quantity
from nebosvod.timescale import SECONDS_PER_DAY

ARCSEC = np.pi / 648000.0
UNDETERMINED_KM = 1.495978707e6  # 0.01 au: a larger position sigma says only that the orbit is not determined yet
MANY = 30  # from so many measurements on, a root mean square says something of the noise model


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
    fig = figure(5.2, 3.3, rows=2)
    upper, lower = fig.subplots(2, 1, sharex=True, height_ratios=(3.2, 1.0))
    days = t / SECONDS_PER_DAY
    upper.plot(days[shown], true[shown], color=BLUE, label="true: what the error really is")
    if formal is not None:
        upper.plot(
            days[shown], formal[shown], color=VERMILION, ls=(0, (4, 2)), label="formal: what the estimator reports"
        )
    log_axis(upper)
    upper.set_ylabel("position sigma, km")
    upper.legend(loc="upper right")
    lower.step(days, np.arange(1, len(t) + 1), where="post", color=INK, lw=1.2)
    lower.set_ylabel("measurements")
    lower.set_ylim(0, None)
    time_axis(lower, run.epoch, t)
    fig.align_ylabels()
    return plate(
        fig,
        "history",
        f"Position sigma of the estimator {name} after each measurement, logarithmic",
        _sigma_caption(name, t, true, formal, shown),
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
    fig = figure(5.2, 0.6 + 1.4 * len(seen), rows=len(seen), gap_in=0.27)
    panels = fig.subplots(len(seen), 2, sharex=True, sharey=True, squeeze=False)
    reach = float(np.nanmax(np.abs(after))) * 1.08 or 1.0
    unit, factor = ("mas", 1e3) if reach < 0.1 else ("arcsec", 1.0)
    for row, i in enumerate(seen):
        mine = np.flatnonzero(index == i)
        days = t[mine] / SECONDS_PER_DAY
        for column, part in enumerate(("RA cos Dec", "Dec")):
            axes = panels[row, column]
            _one_residual(
                axes, days, factor * after[mine, column], None if sigma is None else factor * sigma[mine, column], i
            )
            axes.set_ylim(-factor * reach, factor * reach)
            axes.set_title(f"{run.telescopes[i]}, {part}", loc="left")
        panels[row, 0].set_ylabel(f"residual, {unit}")
    for axes in panels[-1]:
        time_axis(axes, run.epoch, t, right=0.12)
        axes.xaxis.set_major_locator(_every_other(axes))
    label = f"Residuals of the estimator {estimator['name']} in right ascension and declination, by telescope"
    return plate(fig, "residuals", label, _residual_caption(run, estimator, after, sigma, np.asarray(index), seen))


def _every_other(axes: Any) -> Any:
    """The axis' locator, thinned where half a page wide panels would make its dates collide."""
    locator = axes.xaxis.get_major_locator()
    ticks = list(locator.locs)
    texts = [axes.xaxis.get_major_formatter()(x, i) for i, x in enumerate(ticks)]
    room = 3 if max(map(len, texts), default=0) <= 7 else 2
    step = -(-len(ticks) // room) or 1
    kept = texts[::step]
    axes.xaxis.set_major_formatter(lambda _, i: kept[i] if i is not None and i < len(kept) else "")
    return type(locator)(ticks[::step])


def _one_residual(axes: Any, days: Array, value: Array, sigma: Array | None, i: int) -> None:
    """One panel of the residual figure."""
    colour, marker = SERIES[i % len(SERIES)]
    few = thin(len(days), 600)
    if sigma is not None:
        axes.fill_between(days[few], -sigma[few], sigma[few], color=GREY, alpha=0.22, lw=0)
    axes.axhline(0.0, color=GREY, lw=0.7)
    axes.plot(days[few], value[few], marker, ms=2.4, mew=0, color=colour, alpha=0.85)


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


def noise_to_nuisance(run: RunFolder) -> Plate | None:
    """Noise-to-nuisance ratio of each measurement, dB."""
    block = run.summary.get("noise_to_nuisance") or {}
    eta, t, index = block.get("eta_db"), run.array("epoch_s"), run.array("telescope_index")
    if not eta or t is None or index is None or len(eta) != len(t) or np.ptp(t) == 0.0:
        return None
    values = np.array([v if finite(v) else np.nan for v in eta])
    if not np.any(np.isfinite(values)):
        return None
    fig = figure(5.2, 2.4)
    axes = fig.subplots()
    for i, name in enumerate(run.telescopes):
        mine = np.flatnonzero(index == i)
        colour, marker = SERIES[i % len(SERIES)]
        few = thin(len(mine))
        size = (
            3.6 if i == 0 else 1.8
        )  # a second telescope with the same ratio stays visible inside the first one's marker
        axes.plot(t[mine][few] / SECONDS_PER_DAY, values[mine][few], marker, ms=size, mew=0, color=colour, label=name)
    axes.axhline(0.0, color=INK, lw=0.9)
    axes.set_ylabel("noise to nuisance, dB")
    axes.legend(loc="best", markerscale=1.8, handletextpad=0.2)
    time_axis(axes, run.epoch, t)
    return plate(
        fig,
        "nuisance",
        "Noise-to-nuisance ratio of each measurement in decibels over time",
        _nuisance_caption(block, values),
    )


def _nuisance_caption(block: Item, values: Array) -> Markup:
    """Mean and range of the ratio, and what it means."""
    worse = float(np.mean(values[np.isfinite(values)] < 0.0))
    text = Markup(
        "Power of the measurement noise over that of the nuisances (telescope position, bias, "
        "physical parameters) in each measurement: {}{}dB on average, {} to {}{}dB."
    ).format(
        quantity(block.get("eta_db_mean")),
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
    effective = block.get("eta_effective_db_mean")
    if effective is None:
        return text
    return text + Markup(
        " A common nuisance does not average out: counted with every measurement it touches, the mean is {}{}dB."
    ).format(quantity(effective), NBSP)
