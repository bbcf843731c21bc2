"""Can the answer be believed: five accuracies side by side, Monte Carlo consistency, departure from linear."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from nebosvod.report.kit import wording
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.facts import leading
from nebosvod.report.kit.plate import BLUE, GREEN, INK, PURPLE, VERMILION, Plate
from nebosvod.report.kit.scale import logarithmic, named
from nebosvod.report.kit.wording import DASH, NBSP, finite, join, number, percent, quantity, series
from nebosvod.report.run.tables import Cell, Table
from nebosvod.results.folder import Item, RunFolder
from nebosvod.results.outlook import unit_of

KINDS = ("formal", "extended", "worst_correlation", "guaranteed", "monte_carlo")
TITLES = {"formal": "reported (formal)", "extended": "realistic (extended)", "worst_correlation": "worst correlation",
          "guaranteed": "guaranteed bound", "monte_carlo": "Monte Carlo"}  # fmt: skip
LOOKS: dict[str, tuple[str, dict[str, Any]]] = {
    "guaranteed": ("s", {"color": VERMILION, "size": 6.0}), "worst_correlation": ("^", {"color": PURPLE}),
    "extended": ("|", {"color": INK}), "formal": ("O", {"color": BLUE}), "monte_carlo": ("D", {"color": GREEN}),
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """One of the five accuracies of one number: its name, the number, what it means."""

    name: str
    value: Markup
    meaning: str


def rows_of(run: RunFolder, estimator: Item) -> list[Item]:
    """Rows of the comparison of one estimator, in the order of its leading predictions."""
    every = (run.summary.get("accuracy_comparison") or {}).get("rows") or []
    order = [p["name"] for p in leading(run, estimator)]
    mine = [row for row in every if row["estimator"] == estimator["name"] and row["prediction"] in order]
    return sorted(mine, key=lambda row: (order.index(row["prediction"]), row["component"]))


def component_name(run: RunFolder, estimator: Item, row: Item) -> str:
    """`encounter, ζ`; the name of the prediction alone where it has one component."""
    p = next(p for p in run.predictions(estimator["name"]) if p["name"] == row["prediction"])
    names = wording.axis_names(p["plane"], len(p[f"sigma_{unit_of(p)}"]))
    return str(row["prediction"]) if len(names) == 1 else f"{row['prediction']}, {names[row['component']]}"


def five(run: RunFolder, estimator: Item) -> tuple[str, list[Accuracy]]:
    """The five accuracies of the leading prediction's worst component, each with its meaning; empty without them."""
    rows = rows_of(run, estimator)
    if not rows:
        return "", []
    row = max((r for r in rows if r["prediction"] == rows[0]["prediction"]), key=lambda r: r["extended"])
    meaning = run.summary["accuracy_comparison"].get("meaning") or {}
    found = []
    for kind in KINDS:
        value, reason = row.get(kind), row.get(f"{kind}_reason")
        shown = quantity(value, row["unit"]) if finite(value) else Markup("none")
        shown = Markup("≤ {}").format(shown) if kind == "guaranteed" and finite(value) else shown  # a bound, no sigma
        text = meaning.get(kind, "") if finite(value) or not reason else f"None here: {reason}."
        found.append(Accuracy(name=TITLES[kind], value=shown, meaning=text))
    return component_name(run, estimator, row), found


def comparison_plate(run: RunFolder, estimator: Item) -> Plate | None:
    """The five accuracies of every component, as multiples of the extended one."""
    rows = [row for row in rows_of(run, estimator) if row["extended"] and row["extended"] > 0.0]
    if not rows:
        return None
    ratio = [{k: row[k] / row["extended"] for k in KINDS if finite(row.get(k))} for row in rows]
    values = [v for one in ratio for v in one.values()]
    high = 21.0 * len(rows)
    chart = Chart("accuracies", height=0.0)
    x = logarithmic([*values, 0.9, 1.2], "times the realistic sigma")
    panel = chart.panel(x, named([component_name(run, estimator, row) for row in rows]), top=6.0, bottom=6.0 + high)
    panel.upright(1.0, stroke=INK, stroke_width=0.9)
    panel.open()
    for i, row in enumerate(rows):
        interval = row.get("monte_carlo_interval_99")
        if interval:
            panel.line([v / row["extended"] for v in interval], [-i, -i], stroke=GREEN, stroke_width=4, opacity=0.4)
    for kind, (marker, look) in LOOKS.items():
        points = [(one[kind], -float(i)) for i, one in enumerate(ratio) if kind in one]
        if points:
            panel.marks(points, marker, TITLES[kind], **look)
    panel.close()
    entries = [(m, TITLES[k], look) for k, (m, look) in reversed(LOOKS.items()) if any(k in one for one in ratio)]
    chart.height = chart.legend(entries, high + 52.0)
    columns: dict[str, Sequence[Any]] = {
        "prediction": [r["prediction"] for r in rows], "component": [r["component"] for r in rows],
        "unit": [r["unit"] for r in rows], **{k: [r.get(k) for r in rows] for k in KINDS},
        "worst_any_correlation": [r.get("worst_any_correlation") for r in rows],
    }  # fmt: skip
    label = "Formal, extended, worst-correlation, guaranteed and Monte Carlo accuracy of each predicted component"
    return chart.plate(label, _comparison_caption(rows, ratio), [csv("accuracies", columns)])


def _comparison_caption(rows: list[Item], ratio: list[dict[str, float]]) -> Markup:
    """How far the five lie apart."""
    formal = [one["formal"] for one in ratio if "formal" in one]
    parts = []
    if formal:
        low = min(formal)
        parts.append(
            Markup("Reported and realistic sigma agree within 1{}%").format(NBSP) if _near_one(formal)
            else Markup("The estimator's own sigma is as small as {} of the extended one").format(percent(low))
        )  # fmt: skip
    for kind, text in (("worst_correlation", "noise correlated in time could make it {} times worse"),
                       ("guaranteed", "the guaranteed bound is {} sigmas")):  # fmt: skip
        found = [one[kind] for one in ratio if kind in one]
        if found:
            low, high = min(found), max(found)
            span = quantity(low) if high < 1.05 * low else Markup("{} to {}").format(quantity(low), quantity(high))
            parts.append(Markup(text).format(span))
    drawn = [row for row in rows if row.get("monte_carlo_interval_99")]
    if drawn:
        inside = sum(
            row["monte_carlo_interval_99"][0] <= row["extended"] <= row["monte_carlo_interval_99"][1] for row in drawn
        )
        parts.append(Markup("the extended sigma lies inside the 99{}% interval of Monte Carlo in {} of {}").format(
            NBSP, inside, wording.count(len(drawn), "component")))  # fmt: skip
    return Markup("{}.").format(Markup("; ").join(parts))


def _near_one(ratios: list[float]) -> bool:
    """Whether all lie within a per cent of 1."""
    return max(abs(ratio - 1.0) for ratio in ratios) < 0.01


def comparison_table(run: RunFolder, estimator: Item) -> Table | None:
    """The five numbers of every component of every differing estimator, with the sentence on how they agree."""
    rows: list[tuple[Cell, ...]] = []
    every = (run.summary.get("accuracy_comparison") or {}).get("rows") or []
    named_ = list(dict.fromkeys(row["estimator"] for row in every))
    for name in named_:
        other = next(e for e in run.estimators if e["name"] == name)
        for row in rows_of(run, other):
            what = component_name(run, other, row) + (f" (“{name}”)" if len(named_) > 1 else "")
            interval = row.get("monte_carlo_interval_99")
            drawn = quantity(row.get("monte_carlo"), row["unit"])
            if interval:
                drawn += Markup("<br>{}").format(series(interval, row["unit"], " to "))
            rows.append((
                what, *(quantity(row.get(k), row["unit"]) for k in ("formal", "extended", "worst_correlation")),
                quantity(row.get("worst_any_correlation"), row["unit"]), quantity(row.get("guaranteed"), row["unit"]),
                drawn, row.get("statement", ""),
            ))  # fmt: skip
    if not rows:
        return None
    level = run.summary["accuracy_comparison"].get("guaranteed_level", 3.0)
    return Table(
        caption=Markup(
            "Five accuracies of every predicted component (1σ; guaranteed: the largest error if none exceeds {}σ)"
        ).format(number(level, 1)),
        head=("component", "reported sigma", "realistic sigma", "worst correlation", "any correlation",
              "guaranteed bound", "Monte Carlo, 99 %", "how they agree"),
        align="lrrrrrrw", rows=tuple(rows),
    )  # fmt: skip


def consistency_table(run: RunFolder) -> Table | None:
    """Monte Carlo: mean NEES with its interval, and coverage, for each estimator."""
    block = run.summary.get("consistency") or {}
    blocks = block.get("by_estimator") or []
    rows: list[tuple[Cell, ...]] = []
    for one in blocks:
        low, high = one["nees_interval_99"]
        rows.append((
            one["estimator"], str(one["n_runs"]), quantity(one["nees_mean"], "", 4), series([low, high], "", " to "),
            "yes" if low <= one["nees_mean"] <= high else "no", *(percent(v) for v in one["coverage"].values()),
        ))  # fmt: skip
    if not rows:
        return None
    held = [f"inside {key.removesuffix('_percent')}{NBSP}%" for key in blocks[0]["coverage"]]
    return Table(
        caption="Repeated estimation of drawn truths: mean normalised error squared (NEES per component, 1 if sigma is "
        "right), and how many errors the ellipsoids hold",
        head=("estimator", "runs", "NEES / 6", "99 % interval", "inside", *held),
        align="lrrrl" + "r" * len(held), rows=tuple(rows),
    )  # fmt: skip


def nonlinearity_table(run: RunFolder, estimator: Item) -> Table | None:
    """Second-order terms of each prediction, and what drawn orbits did."""
    rows: list[tuple[Cell, ...]] = []
    drawn = any(p.get("monte_carlo") for p in leading(run, estimator))
    for p in leading(run, estimator):
        bent, unit = p.get("nonlinearity"), unit_of(p)
        if not bent:
            continue
        said = bent.get("reason") or ("misleads" if bent.get("misleads") else "holds")
        cells: list[Cell] = [p["name"], quantity(bent.get("measure")), said]
        for key in ("mean_shift", "second_order_sigma"):
            cells.append(series(bent[f"{key}_{unit}"], unit) if bent.get(f"{key}_{unit}") else DASH)
        if drawn:
            run_of = p.get("monte_carlo") or {}
            cells += [str(run_of.get("runs", DASH))]
            cells += [series(v, unit) if (v := run_of.get(f"{k}_{unit}")) else DASH for k in ("mean_shift", "sigma")]
        rows.append(tuple(cells))
    if not rows:
        return None
    more = ("drawn orbits", "their mean shift", "their sigma") if drawn else ()
    return Table(
        caption="Departure from linear: rms size of the second-order term in sigmas of the linear ellipse (above 0.3 "
        "it misleads)",
        head=("prediction", "departure, σ", "linear ellipse", "mean shift", "second-order sigma", *more),
        align="lrlrr" + "r" * len(more), rows=tuple(rows),
    )  # fmt: skip


def nonlinearity_sentence(run: RunFolder, estimator: Item) -> Markup | None:
    """Whether the linear ellipses may be used, and of which predictions that cannot be told."""
    bent = [(p["name"], p["nonlinearity"]) for p in leading(run, estimator) if p.get("nonlinearity")]
    known = [(name, one["measure"]) for name, one in bent if finite(one.get("measure"))]
    unknown = [(name, one["reason"]) for name, one in bent if one.get("reason")]
    wrong = [name for name, one in bent if one.get("misleads")]
    said = []
    if wrong:
        largest = max(measure for _, measure in known)
        said.append(Markup("The linear ellipse of {} misleads: its second-order term reaches {}{}σ.").format(
            join(wrong), quantity(largest, "", 2), NBSP))  # fmt: skip
    elif known:
        name, largest = max(known, key=lambda item: item[1])
        which = "The other predictions" if unknown else "The predictions"
        said.append(Markup("{} are linear enough: second-order terms stay below {}{}σ ({}).").format(
            which, quantity(largest, "", 2), NBSP, name))  # fmt: skip
    for reason in dict.fromkeys(reason for _, reason in unknown):
        names = join(name for name, one in unknown if one == reason)
        said.insert(0, Markup("How far the linear ellipse of {} holds is not known: {}.").format(names, reason))
    return Markup(" ").join(said) if said else None


def doubtful(run: RunFolder, estimator: Item) -> bool:
    """True where a linear ellipse misleads, or it cannot be told whether it does."""
    every = [p.get("nonlinearity") or {} for p in leading(run, estimator)]
    return any(one.get("misleads") or one.get("reason") for one in every)


def consistency_sentence(run: RunFolder, estimator: Item) -> Markup | None:
    """What Monte Carlo says of the sigmas of an estimator."""
    blocks = (run.summary.get("consistency") or {}).get("by_estimator") or []
    one = next((b for b in blocks if b["estimator"] == estimator["name"]), None)
    if one is None:
        return None
    low, high = one["nees_interval_99"]
    inside = low <= one["nees_mean"] <= high
    how = ", estimates iterated" if one.get("iterated") else ""
    return Markup("Monte Carlo ({} runs{}) {} the sigma: mean NEES/6 is {}, {} its 99{}% interval of {} to {}.").format(
        one["n_runs"], how, "confirms" if inside else "contradicts", quantity(one["nees_mean"], "", 4),
        "inside" if inside else "outside", NBSP, number(low), number(high),
    )  # fmt: skip


def worst_sentence(run: RunFolder, estimator: Item) -> Markup | None:
    """What the leading prediction has to fear from noise that is not white."""
    rows = [row for row in rows_of(run, estimator) if finite(row.get("worst_correlation")) and row["extended"]]
    if not rows:
        return None
    row = max((r for r in rows if r["prediction"] == rows[0]["prediction"]), key=lambda r: r["extended"])
    return Markup("All of it assumes white noise: noise correlated in time could make {} {}{}times worse.").format(
        component_name(run, estimator, row), quantity(row["worst_correlation"] / row["extended"]),
        NBSP,
    )  # fmt: skip
