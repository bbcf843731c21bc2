"""The page of a decision: what the probability of an impact may be after each visit, and the chance to decide."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.planning.decision import advice, said_chance, said_share
from nebosvod.report.kit.base import render
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import BLUE, GREY, INK, Plate
from nebosvod.report.kit.scale import linear
from nebosvod.report.kit.wording import NBSP, join
from nebosvod.report.run.tables import Cell, Table
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

Item = Mapping[str, Any]
SHOWN = ("0.01", "0.1", "0.5", "0.9", "0.99")


def make_decision_page(found: Item) -> str:
    """Return the page of what `nebosvod plan --decide --json` prints; the same decision gives the same bytes."""
    said = advice(found)
    return render(
        "decision.html",
        kind="Plan of measurements",
        title=found["title"],
        found=found,
        said=said[0].upper() + said[1:] + ".",
        warnings=_warnings(found),
        plates=[future_plate(found), chances_plate(found)],
        rows=_table(found),
    )


def _warnings(found: Item) -> list[str]:
    """Warnings, and who never sees the object."""
    blind = found["never_visible"]
    said = [f"{join(blind)} never {'see' if len(blind) > 1 else 'sees'} the object at these times"] if blind else []
    return [*said, *found["warnings"]]


def future_plate(found: Item) -> Plate:
    """For each visit the future probability: 1 to 99 %, 10 to 90 % and the median; now and the thresholds as levels."""
    days, label = _days(found)
    quantiles = {level: np.array([row["quantiles"][level] for row in found["visits"]]) for level in SHOWN}
    now, marks = found["probability"], (found["below"], found["above"])
    x = linear(days, label)
    y = linear([0.0, now, *quantiles["0.99"], *(one for one in marks if one <= 1.1 * quantiles["0.99"].max())],
               "probability of an impact")  # fmt: skip
    chart = Chart("decision-future", height=320.0)
    panel = chart.panel(x, y, top=8.0, bottom=250.0)
    panel.open()
    panel.level(now, stroke=GREY, stroke_width=1.2, stroke_dasharray="6 4")
    for one in marks:
        if y.low <= one <= y.high:
            panel.level(one, stroke=INK, stroke_width=0.8, stroke_dasharray="2 3")
    for k, day in enumerate(days):
        for low, high, width in (("0.01", "0.99", 1.2), ("0.1", "0.9", 5.0)):
            panel.line(
                [day, day], [quantiles[low][k], quantiles[high][k]], stroke=BLUE, stroke_width=width, opacity=0.6
            )
    panel.dots(days, quantiles["0.5"], "o", name="median", color=INK, size=4.0)
    panel.close()
    entries: list[tuple[str, str, dict[str, Any]]] = [
        ("o", "median", {"color": INK, "size": 4.0}),
        ("line", "10 to 90 %", {"stroke": BLUE, "stroke_width": 5.0, "opacity": 0.6}),
        ("line", "1 to 99 %", {"stroke": BLUE, "stroke_width": 1.2, "opacity": 0.6}),
        ("line", "now", {"stroke": GREY, "stroke_width": 1.2, "stroke_dasharray": "6 4"}),
        ("line", "thresholds", {"stroke": INK, "stroke_width": 0.8, "stroke_dasharray": "2 3"}),
    ]
    chart.height = chart.legend(entries, 292.0) + 4.0
    caption = Markup(
        "What would be known of the probability, now {:.3g}, after one visit at each time: over {} truths drawn from "
        "the present orbit, each observed and weighed anew. Half of them end above the dot."
    ).format(now, found["n_truths"])
    columns: dict[str, list[Any]] = {
        "telescope": [row["telescope"] for row in found["visits"]],
        "epoch_utc": [row["epoch_utc"] for row in found["visits"]],
    }
    columns |= {f"quantile_{level}": values.tolist() for level, values in quantiles.items()}
    return chart.plate("Quantiles of the future probability against the time of a visit", caption,
                       [csv("decision-future", columns)])  # fmt: skip


def chances_plate(found: Item) -> Plate:
    """The chance that a visit takes the probability below or above the thresholds, against its time."""
    days, label = _days(found)
    chances = {
        name: np.array([100.0 * row[f"chance_{name}"] for row in found["visits"]]) for name in ("below", "above")
    }
    x, y = linear(days, label), linear([0.0, *chances["below"], *chances["above"], 1.0], "chance, %")
    chart = Chart("decision-chances", height=280.0)
    panel = chart.panel(x, y, top=8.0, bottom=210.0)
    panel.open()
    looks = {"below": (BLUE, "o"), "above": (INK, "s")}
    for name, (color, marker) in looks.items():
        panel.dots(days, chances[name], marker, name=name, color=color, size=4.0)
    panel.close()
    entries: list[tuple[str, str, dict[str, Any]]] = [
        (marker, f"P {'<' if name == 'below' else '>'} {found[name]:.2g}", {"color": color, "size": 4.0})
        for name, (color, marker) in looks.items()
    ]
    chart.height = chart.legend(entries, 252.0) + 4.0
    best = found["visits"][found["best"]]
    caption = Markup("The visit most likely to decide is that of {} on {}.").format(best["telescope"], _when(best))
    columns: dict[str, list[Any]] = {"epoch_utc": [row["epoch_utc"] for row in found["visits"]]}
    columns |= {f"chance_{name}_percent": values.tolist() for name, values in chances.items()}
    return chart.plate("Chance to fall below or rise above the thresholds", caption, [csv("decision-chances", columns)])


def _days(found: Item) -> tuple[np.ndarray, str]:
    """Days of the visits after the first, and what the axis is called."""
    epochs = [Epoch.parse(row["epoch_tdb"]) for row in found["visits"]]
    days = np.array([(epoch - epochs[0]) / SECONDS_PER_DAY for epoch in epochs])
    return days, f"days after {_when(found['visits'][0])} UTC"


def _when(row: Item) -> str:
    """When a visit begins, to the minute, breaking nowhere."""
    return str(row["epoch_utc"][:16]).replace("T", NBSP).replace("-", "\u2011")


def _table(found: Item) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for row in found["visits"]:
        quantiles = [said_chance(row["quantiles"][level], row.get("bound")) for level in SHOWN]
        chances = [said_share(row[name]) for name in ("chance_below", "chance_above")]
        rows.append((row["telescope"], _when(row), *quantiles, *chances))
    return Table(
        caption="Quantiles of the probability after one visit, and the chances to decide",
        head=("telescope", "UTC", "1 %", "10 %", "50 %", "90 %", "99 %", f"P < {found['below']:.2g}",
              f"P > {found['above']:.2g}"),
        align="llrrrrrrr",
        rows=tuple(rows),
    )  # fmt: skip
