"""The page of compared ephemerides, approaches or risks: rows side by side, and a figure of what differs."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.report.kit.base import render
from nebosvod.report.kit.chart import NARROW, Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.edge import below
from nebosvod.report.kit.plate import SERIES, Plate, thin
from nebosvod.report.kit.scale import Scale, calendar, linear, logarithmic, named
from nebosvod.report.kit.wording import DASH, join, moment, quantity
from nebosvod.report.risk.words import body_name, chance, consistent, impactor_name, way_name
from nebosvod.report.run.tables import Cell, Table
from nebosvod.results.compare_orbits import not_asked
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

Item = Mapping[str, Any]
SHOWN = 400  # rows on the page; --json has them all
WIDE = 30.0  # values that differ by more than this factor need a logarithmic axis
WORDS = {"ephemeris": "ephemerides", "approaches": "approaches", "risk": "risks"}


def make_orbit_comparison_page(found: Item) -> str:
    """Return the page of what `nebosvod compare --json` prints of such folders; the same gives the same bytes."""
    labels = [run["label"] for run in found["runs"]]
    make_table, make_plates = PARTS[found["kind"]]
    agreed = [_agreed(row, found["runs"]) for row in found["rows"]] if found["kind"] == "risk" else []
    return render(
        "orbit_comparison.html",
        kind="Comparison",
        title=" · ".join(labels),
        words=WORDS[found["kind"]],
        found=found,
        plates=make_plates(found, labels),
        rows=make_table(found, labels),
        headline="Not everything compares." if found["warnings"] else "All answer the same question.",
        told=[("How they agree", agreed)] if agreed else [],
        orbits=_orbits(found),
    )


def _orbits(found: Item) -> Table:
    """Which orbit each folder was made from."""
    return Table(
        caption="The orbits, and how well their positions are known, 1σ",
        head=("folder", "object", "orbit", "epoch", "position, 1σ"),
        align="llllr",
        rows=tuple(
            (run["label"], run["object"], run["orbit"], moment(run["epoch_tdb"]),
             quantity(run["sigma_position_km"], "km"))
            for run in found["runs"]
        ),
    )  # fmt: skip


def _places(found: Item, labels: Sequence[str]) -> Table | None:
    """Offsets from the first ephemeris at its times."""
    rows: list[tuple[Cell, ...]] = []
    for row in found["rows"][:SHOWN]:
        first, *others = row["by_run"]
        ellipse = f"{first['semi_major_arcsec']:.3g} × {first['semi_minor_arcsec']:.3g}"
        rows.append((row["epoch_utc"].removesuffix(" UTC"), ellipse, *map(_offset, others)))
    more = "" if len(found["rows"]) <= SHOWN else f" The first {SHOWN} of {len(found['rows'])} times."
    caption = f"Offsets from {labels[0]} in RA cos Dec and Dec, and in sigmas of the row's own ellipse.{more}"
    head = ("UTC", f"{labels[0]}: ellipse, 1σ, arcsec", *(f"{label} minus it, arcsec" for label in labels[1:]))
    return _table(caption, head, rows)


def _offset(one: Item | None) -> str:
    if one is None:
        return DASH
    text = f"{one['offset_ra_arcsec']:+.3g}, {one['offset_dec_arcsec']:+.3g} ({one['offset_sigmas']:.2g}σ)"
    return text.replace("-", "−")


def _offset_plates(found: Item, labels: Sequence[str]) -> list[Plate]:
    """How many of its own sigmas each ephemeris lies from the first."""
    rows = found["rows"]
    if len(rows) < 2:
        return []
    epochs = [Epoch.parse(row["epoch_utc"]) for row in rows]
    t = np.array([epoch - epochs[0] for epoch in epochs])
    nan = float("nan")
    sigmas = np.array([[nan if one is None else one["offset_sigmas"] for one in row["by_run"][1:]] for row in rows])
    if not np.isfinite(sigmas).any():
        return []
    chart = Chart("offsets", width=NARROW, height=0.0)
    panel = chart.panel(calendar(epochs[0], t, most=3.5), _axis(sigmas, "offset, own sigmas"), top=8.0, bottom=190.0)
    panel.open()
    few, entries = thin(len(t)), []
    for k, label in enumerate(labels[1:]):
        color, _ = SERIES[k % len(SERIES)]
        panel.line(t[few] / SECONDS_PER_DAY, np.maximum(sigmas[few, k], panel.y.low), label, stroke=color)
        entries.append(("line", label, {"stroke": color, "stroke_width": 1.5}))
    panel.close()
    chart.height = chart.legend(entries, 232.0) + 2.0
    caption = Markup("How far each lies from {}, in sigmas of its own ellipse.").format(labels[0])
    columns = {"epoch_utc": [row["epoch_utc"] for row in rows]}
    columns |= {label: sigmas[:, k].tolist() for k, label in enumerate(labels[1:])}
    return [chart.plate("Offsets in sigmas by date", caption, [csv("offsets", columns)])]


def _axis(values: Any, label: str, most: int = 5) -> Scale:
    """A linear axis, or a logarithmic one where values differ much."""
    known = np.asarray(values)[np.isfinite(values)]
    wide = bool(len(known)) and known.min() > 0.0 and known.max() > WIDE * known.min()
    return logarithmic(known, label) if wide else linear(known, label, most=most)


def _approaches(found: Item, labels: Sequence[str]) -> Table | None:
    """When and how near by each."""
    rows = [(body_name(row["body"]).removeprefix("the "), *map(_approach, row["by_run"])) for row in found["rows"]]
    return _table("Time and distance of each approach, 1σ.", ("body", *labels), rows)


def _approach(one: Item | None) -> Cell:
    if one is None:
        return DASH
    return Markup("{} ± {}, {} ± {}").format(
        moment(one["epoch_utc"]), quantity(one["sigma_time_s"], "s"), quantity(one["distance_km"], "km", 5),
        quantity(one["sigma_distance_km"], "km"),
    )  # fmt: skip


def _distance_plates(found: Item, labels: Sequence[str]) -> list[Plate]:
    """The distance of each approach by each, with three sigmas."""
    plates = []
    for number, row in enumerate(found["rows"][:6]):
        known = [(label, one) for label, one in zip(labels, row["by_run"]) if one is not None]
        values = [(one["distance_km"], 3.0 * one["sigma_distance_km"]) for _, one in known]
        ranges = [(max(d - s, 0.0), d, d + s) for d, s in values]
        name = f"{body_name(row['body'])}, {known[0][1]['epoch_utc'][:10]}"
        plates.append(_ranges(f"distances-{number}", [label for label, _ in known], ranges, "distance, km, 3σ", name))
    return plates


def _risks(found: Item, labels: Sequence[str]) -> Table | None:
    """How probable each impact is by each."""
    rows: list[tuple[Cell, ...]] = []
    for row in found["rows"]:
        pairs = zip(row["by_run"], found["runs"], strict=True)
        rows.append((body_name(row["body"]).removeprefix("the "), *(_risk(one, run, row) for one, run in pairs)))
    if not rows:
        rows.append(("nothing", *(Markup("not found: {}").format(chance(run["sampling"])) for run in found["runs"])))
    return _table("Probability of each virtual impactor by each, 95 %.", ("may hit", *labels), rows)


def _agreed(row: Item, runs: Sequence[Item]) -> Markup:
    """Whether all that were asked about one virtual impactor find it equally probable."""
    pairs = zip(row["by_run"], runs, strict=True)
    asked = [(one, run) for one, run in pairs if one is not None or not_asked(row, run) is None]
    found = [run["sampling"] if one is None else one for one, run in asked]
    runs = [run for _, run in asked]
    name = impactor_name({"body": row["body"], "epoch_utc": next(one for one in row["by_run"] if one)["epoch_utc"]})
    apart = [run["label"] for run, one in zip(runs, found, strict=True) if not consistent(found[0], one)]
    if len(runs) == 1:
        return Markup("{}: only {} was asked.").format(name[:1].upper() + name[1:], runs[0]["label"])
    if not apart:
        return Markup("{}: equally probable to all, within their intervals.").format(name[:1].upper() + name[1:])
    return Markup("{}: {} and {} cannot both be right.").format(
        name[:1].upper() + name[1:], runs[0]["label"], join(apart)
    )


def _risk(one: Item | None, run: Item, row: Item) -> Cell:
    if one is None:
        reason = not_asked(row, run)
        if reason is not None:
            return reason
        return Markup("not found: all together {}").format(chance(run["sampling"]))
    return Markup("{} by {}, {}").format(chance(one), way_name(one["recommended"]), moment(one["epoch_utc"]))


def _risk_plates(found: Item, labels: Sequence[str]) -> list[Plate]:
    """The probability of each virtual impactor by each, with its interval."""
    plates = []
    for number, row in enumerate(found["rows"][:6]):
        known = [(label, one) for label, one in zip(labels, row["by_run"]) if one is not None]
        ranges = [
            (one["low"], one["high"] if one["probability"] is None else one["probability"], one["high"])
            for _, one in known
        ]
        name = f"{body_name(row['body'])}, {known[0][1]['epoch_utc'][:10]}"
        plates.append(_ranges(f"chances-{number}", [label for label, _ in known], ranges, "probability", name))
    return plates


def _ranges(
    key: str, labels: Sequence[str], ranges: Sequence[tuple[float, float, float]], label: str, name: str
) -> Plate:
    """A dot with its interval for each folder."""
    x = _axis([v for one in ranges for v in one if v > 0.0] or [0.0, 1.0], label, 3)
    high = 24.0 * len(labels)
    chart = Chart(key, width=NARROW, height=high + 46.0)
    panel = chart.panel(x, named([*labels]), top=6.0, bottom=6.0 + high)
    panel.open()
    for i, (low, value, top) in enumerate(ranges):
        color, marker = SERIES[i % len(SERIES)]
        if top > x.low:
            panel.line([max(low, x.low), top], [-float(i)] * 2, stroke=color, stroke_width=1.8)
        if value < x.low:
            below(panel, -float(i), f"{value:.3g}", color)
        else:
            panel.dots([value], [-float(i)], marker, labels[i], color=color, size=5.0)
    panel.close()
    columns = {"folder": [*labels], **{k: [one[j] for one in ranges] for j, k in enumerate(("low", "value", "high"))}}
    caption = Markup("<b>{}</b>: {}.").format(name[:1].upper() + name[1:], label)
    return chart.plate(f"{name}: {label} by folder", caption, [csv(key, columns)])


def _table(caption: str, head: Sequence[str], rows: Sequence[tuple[Cell, ...]]) -> Table | None:
    if not rows:
        return None
    return Table(caption=caption, head=tuple(head), align="l" + "r" * (len(head) - 1), rows=tuple(rows))


PARTS = {
    "ephemeris": (_places, _offset_plates),
    "approaches": (_approaches, _distance_plates),
    "risk": (_risks, _risk_plates),
}
