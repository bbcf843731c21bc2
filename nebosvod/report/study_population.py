"""What the page of a study says of drawn impactors: what is seen of them, what was known when, who is warned of."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import BLUE, GREY, VERMILION, Plate
from nebosvod.report.kit.scale import linear, logarithmic
from nebosvod.report.kit.wording import DASH, percent, quantity
from nebosvod.report.run.tables import Cell, Table
from nebosvod.report.study_figures import scale_of, titled

Array = npt.NDArray[np.float64]
Item = Mapping[str, Any]
Columns = Mapping[str, npt.NDArray[Any]]
KIND, DIAMETER, SUN_ANGLE = "object kind", "object diameter", "object sun angle"
UNSEEN = ("not_seen", "failed")


def seen_table(found: Item) -> Table:
    """How many impactors are seen at all: all, by the sky they come from, by size."""
    rows: list[tuple[Cell, ...]] = [
        (*_where(one), one["group"], f"{one['k']} of {one['n']}", _share(one)) for one in found["seen"]
    ]
    names = list(found["seen"][0]["where"]) if found["seen"] else []
    head: tuple[Cell, ...] = (*names, "impactors", "seen at all", "share, 95 % interval")
    return Table(
        caption="Impactors that are seen and are not", head=head, align="l" * (len(names) + 1) + "rr", rows=tuple(rows)
    )


def paired_table(found: Item) -> Table | None:
    """Who sees what another setting does not, of the same objects."""
    rows: list[tuple[Cell, ...]] = []
    for one in found.get("paired") or []:
        low, high = (f"{100.0 * value:+.2g}" for value in one["interval_95"])
        rows.append(
            (
                *_where(one), str(one["only_here"]), str(one["only_first"]),
                f"{100.0 * one['difference']:+.2g} ({low} to {high}) %", quantity(one["p"], "", 2),
            )
        )  # fmt: skip
    if not rows:
        return None
    first = found["paired"][0]["than"]
    beside = ", ".join(f"{name} {shown}" for name, shown in zip(first, _where({"where": first})))
    head: tuple[Cell, ...] = (
        *first, "only here", f"only with {beside}", "difference of shares, 95 % interval", "p, if neither saw more",
    )  # fmt: skip
    caption = Markup("The same {} objects, beside {}").format(found["paired"][0]["n"], beside)
    return Table(caption=caption, head=head, align="l" * len(first) + "rrrr", rows=tuple(rows))


def warned_table(found: Item) -> Table | None:
    """Who is warned of, and how often for nothing."""
    if not found["warned"]:
        return None
    names = list(found["warned"][0]["where"])
    rows: list[tuple[Cell, ...]] = []
    for one in found["warned"]:
        false = one["false_per_impactor"]
        said: Cell = DASH
        if false is not None:
            low, high = false["interval_95"]
            said = Markup("{} ({} to {})").format(*(quantity(value, "", 2) for value in (false["value"], low, high)))
        misses = one["misses"]
        rows.append(
            (
                *_where(one), before_words(one["before_d"]), _share(one["impactors"]),
                DASH if misses is None else f"{misses['k']} of {misses['n']}", said,
            )
        )  # fmt: skip
    warning = found["warning"]
    head: tuple[Cell, ...] = (
        *names, "known", "impactors warned of, 95 % interval", "near misses warned of",
        "false warnings for each impactor",
    )  # fmt: skip
    return Table(
        caption=Markup("Warned of, with {} at least {}").format(warning["answer"], f"{warning['at_least']:g}"),
        head=head,
        align="l" * (len(names) + 1) + "rrr",
        rows=tuple(rows),
    )


def population_words(own: Item) -> Cell:
    """The answer in one sentence: how many are seen, how many warned of at the last time."""
    last, said = {tuple(one["where"].items()): one for one in own["warned"]}, []
    for one in own["seen"]:
        if one["group"] != "all":
            continue
        row = Markup("{}of {:,} impactors {} are seen").format(_where_words(one), one["n"], percent(one["share"]))
        warned = last.get(tuple(one["where"].items()))
        if warned is not None and warned["impactors"]["share"] is not None:
            share = percent(warned["impactors"]["share"])
            row += Markup(" and {} warned of {}").format(share, before_words(warned["before_d"]))
        said.append(row)
    return Markup("; ").join(said) + Markup(".")


def _where_words(one: Item) -> str:
    said = ", ".join(f"{name} {shown}" for name, shown in zip(one["where"], _where(one)))
    return f"{said}: " if said else ""


def before_words(before_d: float | None) -> str:
    """How long before the fall."""
    if before_d is None:
        return "at the end"
    return f"{before_d:g} d before" if before_d >= 1.0 else f"{24.0 * before_d:g} h before"


def _where(one: Item) -> Iterator[str]:
    return (f"{value:.4g}" if isinstance(value, float) else str(value) for value in one["where"].values())


def _share(one: Item) -> Cell:
    if one["share"] is None:
        return DASH
    low, high = one["interval_95"]
    return Markup("{} ({} to {})").format(percent(one["share"]), percent(low), percent(high))


def time_plates(found: Item) -> list[Plate]:
    """Each answer that is told at several times: median and middle half and 90 % of the impactors that have it."""
    rows = [one for one in found["numbers"] if one["before_d"] is not None and one["p50"] is not None]
    groups: dict[tuple[Any, ...], list[Item]] = {}
    for one in rows:
        groups.setdefault((one["answer"], *one["where"].items()), []).append(one)
    return [_time_plate(key[0], dict(key[1:]), own) for key, own in groups.items() if len(own) > 1]


def _time_plate(answer: str, where: Item, rows: list[Item]) -> Plate:
    rows = sorted(rows, key=lambda one: -one["before_d"])
    x = np.array([one["before_d"] for one in rows])
    quantiles = {key: np.array([one[key] for one in rows]) for key in ("p05", "p25", "p50", "p75", "p95")}
    every = np.concatenate(list(quantiles.values()))
    suffix = "-".join(f"{value:g}" if isinstance(value, float) else str(value) for value in where.values())
    chart = Chart(f"time-{_key(answer)}{'-' + _key(suffix) if suffix else ''}", height=0.0)
    title = titled({"name": answer, "unit": rows[0]["unit"]})
    share = not rows[0]["unit"] and every.min() >= 0.0 and every.max() <= 1.0
    panel = chart.panel(
        logarithmic(x, "days before the fall").reversed(),
        linear([0.0, 1.0], title) if share else scale_of(every, title),
        top=8.0,
        bottom=228.0,
    )
    panel.open()
    panel.band(x, quantiles["p05"], quantiles["p95"], fill=BLUE, fill_opacity=0.15)
    panel.band(x, quantiles["p25"], quantiles["p75"], fill=BLUE, fill_opacity=0.3)
    panel.line(x, quantiles["p50"], answer, stroke=BLUE, stroke_width=1.6)
    panel.dots(x, quantiles["p50"], "o", answer, color=BLUE, size=5.0)
    panel.close()
    chart.height = chart.legend(
        [
            ("o", "median", {"color": BLUE, "size": 5.0}),
            ("box", "middle half", {"fill": BLUE, "fill_opacity": 0.4}),
            ("box", "middle 90 %", {"fill": BLUE, "fill_opacity": 0.15}),
        ],
        270.0,
    )
    said = _where_words({"where": where}).removesuffix(": ")
    caption = Markup("<b>{}</b> of the impactors that have it by then ({} of {} at the last time){}.").format(
        answer, rows[-1]["n_with"], rows[-1]["n"], f"; {said}" if said else ""
    )
    data = {"days before": x, **quantiles}
    return chart.plate(f"{answer} against time", caption, [csv(chart.key, data)])


def sky_plate(columns: Columns) -> Plate:
    """Where impactors come from and how large they are, seen or not."""
    hits = columns[KIND] == "impactor"
    unseen = np.isin(columns["status"], UNSEEN)
    x, y = np.asarray(columns[SUN_ANGLE], dtype=float), np.asarray(columns[DIAMETER], dtype=float)
    chart = Chart("sky", height=0.0)
    panel = chart.panel(
        linear([0.0, 180.0], "angle from the Sun of where they come from, deg", pad=0.02),
        logarithmic(y[hits], "diameter, m"),
        top=8.0,
        bottom=228.0,
    )
    panel.upright(90.0, stroke=GREY, stroke_width=1.0, stroke_dasharray="5 3")
    panel.open()
    for rows, marker, name, colour in (
        (hits & unseen, "x", "not seen", VERMILION),
        (hits & ~unseen, "o", "seen", BLUE),
    ):
        panel.dots(x[rows], y[rows], marker, name, color=colour, size=3.4)
    panel.close()
    chart.height = chart.legend(
        [("o", "seen", {"color": BLUE, "size": 4.0}), ("x", "not seen", {"color": VERMILION, "size": 4.0})], 270.0
    )
    caption = Markup("Impactors by the direction they come from, left of the broken line the day sky, and by size.")
    data = csv("sky", {"angle from the Sun, deg": x[hits], "diameter, m": y[hits], "seen": (~unseen[hits]).astype(int)})
    return chart.plate("Where impactors come from", caption, [data])


def _key(name: str) -> str:
    return "".join(one if one.isalnum() and one.isascii() else "-" for one in name)
