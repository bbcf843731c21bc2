"""The page of a plan: what a visit would bring at each epoch by each telescope, and the schedule beside an even one."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.planning.advice import CRITERIA, advice
from nebosvod.report.kit import wording
from nebosvod.report.kit.base import render
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import BLUE, GREY, INK, SERIES, Plate
from nebosvod.report.kit.scale import linear
from nebosvod.report.kit.stamp import stamp
from nebosvod.report.kit.wording import NBSP, join, quantity
from nebosvod.report.run.tables import Cell, Table
from nebosvod.timescale import SECONDS_PER_DAY
from nebosvod.version import __version__

Item = Mapping[str, Any]


def make_plan_page(found: Item) -> str:
    """Return the page of what `nebosvod plan --json` prints; the same plan gives the same bytes."""
    said = advice(found)
    return render(
        "plan.html",
        kind="Plan of measurements",
        stamp=stamp({"versions": {"nebosvod": __version__}, **found}),
        title=found["title"],
        found=found,
        said=said[0].upper() + said[1:] + ".",
        answers=_answers(found),
        warnings=_warnings(found),
        plates=[gain_plate(found), schedule_plate(found)],
        windows=_windows(found),
        schedule=_schedule(found),
    )


def _answers(found: Item) -> list[tuple[str, list[Cell]]]:
    """What is known now, what the visits bring, how far that is to be believed, what would help."""
    which, unit, name = found["criterion"], found["unit"], found["prediction"]["name"]
    now, best, greedy, even = found["sigma_now"][which], found["windows"][0], found["greedy"][which], found["uniform"]
    after, evenly = greedy[-1]["sigma_after"][which], even[-1]["sigma_after"][which]
    accurate = Markup("<b>{}</b> {} now ({}); after {} chosen so {}, after as many at even times {}.").format(
        name, quantity(now, unit), CRITERIA[which], wording.count(len(greedy), "visit"), quantity(after, unit),
        quantity(evenly, unit),
    )  # fmt: skip
    first, last = best["window_tdb"]
    helps = Markup("A visit of {} at {}: {} less; at least 90{}% of that gain {}.").format(
        best["telescope"], wording.moment(best["epoch_tdb"]), f"{best['reduction_percent'][which]:.2g}{NBSP}%", NBSP,
        Markup("only then") if first == last else Markup("from {}").format(_span(first, last)),
    )  # fmt: skip
    believed = (
        f"As far as the mission's error model holds: sigmas foretold by estimator {found['estimator']}, linear about "
        "the reference orbit; nothing is drawn."
    )
    return [("How accurate", [accurate]), ("What would help", [helps]), ("Can it be believed", [believed])]


def _warnings(found: Item) -> list[str]:
    """Warnings, and who never sees the object."""
    blind = found["never_visible"]
    said = [f"{join(blind)} never {'see' if len(blind) > 1 else 'sees'} the object at these epochs"] if blind else []
    return [*said, *found["warnings"]]


def gain_plate(found: Item) -> Plate:
    """Sigma after one visit against its epoch, for every telescope; the level without any visit."""
    which, unit = found["criterion"], found["unit"]
    now = found["sigma_now"][which]
    factor, text = wording.scale_of(now, unit)
    start = min(curve["epoch_s"][0] for curve in found["curves"])
    days = [(np.array(curve["epoch_s"]) - start) / SECONDS_PER_DAY for curve in found["curves"]]
    values = [factor * np.array(curve["sigma_after"][which]) for curve in found["curves"]]
    first = next(c["epoch_tdb"][0] for c in found["curves"] if c["epoch_s"][0] == start)
    x = linear(np.concatenate(days), f"days after {_day(first)} TDB")
    y = linear([factor * now, *np.concatenate(values)], f"sigma after one visit, {text}")
    chart = Chart("plan-gain", height=300.0)
    panel = chart.panel(x, y, top=8.0, bottom=230.0)
    panel.open()
    panel.level(factor * now, stroke=GREY, stroke_width=1.2, stroke_dasharray="6 4")
    entries: list[tuple[str, str, dict[str, Any]]] = []
    columns: dict[str, list[Any]] = {"telescope": [], "epoch_tdb": [], f"sigma_after_{unit}": []}
    for k, (curve, t, sigma) in enumerate(zip(found["curves"], days, values)):
        color, marker = SERIES[k % len(SERIES)]
        panel.dots(t, sigma, marker, name=curve["telescope"], color=color, size=3.0)
        entries.append((marker, curve["telescope"], {"color": color, "size": 4.0}))
        columns["telescope"] += [curve["telescope"]] * len(t)
        columns["epoch_tdb"] += curve["epoch_tdb"]
        columns[f"sigma_after_{unit}"] += curve["sigma_after"][which]
    panel.close()
    entries.append(("line", "no visit", {"stroke": GREY, "stroke_width": 1.2, "stroke_dasharray": "6 4"}))
    chart.height = chart.legend(entries, 270.0) + 4.0
    best = found["windows"][0]
    caption = Markup("The best single visit is {} at {}: {} instead of {} ({}).").format(
        best["telescope"], wording.moment(best["epoch_tdb"]), quantity(best["sigma_after"][which], unit),
        quantity(now, unit), CRITERIA[which],
    )  # fmt: skip
    return chart.plate("Sigma after one visit against its epoch, by telescope", caption, [csv("plan-gain", columns)])


def schedule_plate(found: Item) -> Plate:
    """Sigma after each visit of the chosen schedule and of the even one."""
    which, unit = found["criterion"], found["unit"]
    now = found["sigma_now"][which]
    factor, text = wording.scale_of(now, unit)
    both = {
        "chosen": [now, *(row["sigma_after"][which] for row in found["greedy"][which])],
        "even": [now, *(row["sigma_after"][which] for row in found["uniform"])],
    }
    x = linear([0.0, max(len(values) for values in both.values()) - 1.0], "visits")
    y = linear([factor * v for values in both.values() for v in values], f"sigma, {text}")
    chart = Chart("plan-schedule", height=280.0)
    panel = chart.panel(x, y, top=8.0, bottom=210.0)
    panel.open()
    looks = {"chosen": (BLUE, "o"), "even": (INK, "s")}
    for name, values in both.items():
        color, marker = looks[name]
        count = np.arange(float(len(values)))
        panel.line(count, factor * np.array(values), stroke=color, stroke_width=1.6)
        panel.dots(count, factor * np.array(values), marker, name=name, color=color, size=4.0)
    panel.close()
    entries = [(marker, name, {"color": color, "size": 4.0}) for name, (color, marker) in looks.items()]
    chart.height = chart.legend(entries, 250.0) + 4.0
    caption = Markup("{} visits chosen one after the other bring {}, as many at even times {}.").format(
        len(both["chosen"]) - 1, quantity(both["chosen"][-1], unit), quantity(both["even"][-1], unit)
    )
    columns: dict[str, Any] = {"visits": list(range(min(len(values) for values in both.values())))}
    columns |= {f"{name}_{unit}": values[: len(columns["visits"])] for name, values in both.items()}
    label = "Sigma after each visit, chosen and at even times"
    return chart.plate(label, caption, [csv("plan-schedule", columns)])


def _windows(found: Item) -> Table:
    """The best visit of each telescope, when it is good, and when the object is seen at all."""
    which, unit = found["criterion"], found["unit"]
    rows: list[tuple[Cell, ...]] = []
    for row in found["windows"]:
        first, last = row["window_tdb"]
        seen = join(_span(a, b) for a, b in row["visible_tdb"])
        good = _span(first, last)
        less = f"{row['reduction_percent'][which]:.2g} %"
        cells = (wording.moment(row["epoch_tdb"]), good, seen, quantity(row["sigma_after"][which], unit), less)
        rows.append((row["telescope"], *cells))
    return Table(
        caption="The best visit of each telescope; good: at least 90 % of its gain",
        head=("telescope", "best", "good, TDB", "sees the object, TDB", "sigma after", "less by"),
        align="llllrr",
        rows=tuple(rows),
    )


def _span(first: str, last: str) -> Markup:
    """From one epoch to another, or one epoch."""
    return Markup(_day(first)) if first == last else Markup("{} to {}").format(_day(first), _day(last))


def _day(epoch: str) -> str:
    """An epoch to the minute, without its scale, that breaks nowhere."""
    return epoch[:16].replace("T", NBSP).replace("-", "\u2011")


def _schedule(found: Item) -> Table:
    """Visits in the order they are chosen, and the even ones."""
    which, unit = found["criterion"], found["unit"]
    rows: list[tuple[Cell, ...]] = []
    for k, (one, other) in enumerate(zip(found["greedy"][which], found["uniform"]), start=1):
        cells = [
            cell
            for row in (one, other)
            for cell in (row["telescope"], wording.moment(row["epoch_tdb"]), quantity(row["sigma_after"][which], unit))
        ]
        rows.append((str(k), *cells))
    return Table(
        caption="The schedule, chosen greedily and at even times",
        head=("visit", "chosen", "epoch", "sigma after", "even", "epoch", "sigma after"),
        align="lllrllr",
        rows=tuple(rows),
    )
