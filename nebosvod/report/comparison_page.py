"""The page of a comparison: predictions side by side, the ellipses of all runs over each other, who is to blame."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.estimation.accuracy.formed import matrix_of
from nebosvod.mission.slugs import array_name
from nebosvod.report.kit import wording
from nebosvod.report.kit.base import render
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.facts import LEADING
from nebosvod.report.kit.outline import outline
from nebosvod.report.kit.plate import SERIES, Plate
from nebosvod.report.kit.scale import linear
from nebosvod.report.kit.wording import NBSP, TIMES, join, percent, product, quantity
from nebosvod.report.run.ellipses import LEFT, ROOM, SIDE
from nebosvod.report.run.tables import Cell, Table
from nebosvod.results.compare import shown_budget

Item = Mapping[str, Any]
LEVEL = 3.0
DASHES = ("", "7 3", "2 3", "8 3 2 3", "4 2", "1 2")
MOST = 12  # sources in a table by themselves


def make_comparison_page(found: Item) -> str:
    """Return the page of what `nebosvod compare --json` prints; the same comparison gives the same bytes."""
    labels = [run["label"] for run in found["runs"]]
    telescopes = sorted({name for run in found["runs"] for name in run["telescopes"]})
    return render(
        "comparison.html",
        kind="Comparison",
        title=" · ".join(labels),
        found=found,
        headline=_headline(found, labels),
        answers=_answers(found, labels),
        warnings=found["warnings"],
        plates=[ellipse_plate(row, labels) for row in found["ellipses"]],
        orbit=_orbit(found, labels),
        predictions=_predictions(found, labels),
        budgets=[_budget(row, labels, telescopes) for row in found["predictions"] if row["comparable"]],
    )


def _headline(found: Item, labels: Sequence[str]) -> Markup | str:
    """Which run knows the first prediction best, before anything else."""
    comparable = [row for row in found["predictions"] if row["comparable"]]
    if not comparable:
        return "These runs have no prediction in common."
    first = next((row for row in comparable if row["plane"] in LEADING), comparable[0])
    return sentence(first, labels)


def _answers(found: Item, labels: Sequence[str]) -> list[tuple[str, list[Cell]]]:
    """How accurate each run is, because of what, and whether they may be compared at all."""
    comparable = [row for row in found["predictions"] if row["comparable"]]
    if not comparable:
        return [("Can it be believed", ["The runs answer different questions."])]
    said: list[tuple[str, list[Cell]]] = [("How accurate", [sentence(row, labels) for row in comparable])]
    first = next((row for row in comparable if row["plane"] in LEADING), comparable[0])
    parts = []
    for k, label in enumerate(labels):
        worst = max(first["budget"], key=lambda row: row["share"][k], default=None)
        if worst is not None and worst["share"][k] > 0.0:
            parts.append(Markup("{}: {} {}").format(label, worst["source"], percent(worst["share"][k])))
    if parts:
        text = Markup("Largest error contribution to {}: {}.").format(first["name"], Markup("; ").join(parts))
        said.append(("Because of what", [text]))
    n = len(found["warnings"])
    told = (
        "All runs answer the same questions." if not n
        else f"Not everything compares: {wording.count(n, 'thing')} {'differs' if n == 1 else 'differ'} among them."
    )  # fmt: skip
    return [*said, ("Can it be believed", [told])]


def sentence(row: Item, labels: Sequence[str]) -> Markup:
    """Which run knows a prediction best, and how many times worse the worst one is."""
    known = [(one["sigma_total"], label) for one, label in zip(row["by_run"], labels) if one is not None]
    (best, first), (worst, last) = min(known), max(known)
    if worst < 1.005 * best:
        return Markup("<b>{}</b> is known equally well: {}.").format(row["name"], quantity(best, row["unit"]))
    return Markup("<b>{}</b>: best by {}, {}; worst by {}, {} ({}{} as large).").format(
        row["name"], first, quantity(best, row["unit"]), last, quantity(worst, row["unit"]),
        quantity(worst / best), f"{NBSP}{TIMES}",
    )  # fmt: skip


def ellipse_plate(row: Item, labels: Sequence[str]) -> Plate:
    """The 3-sigma ellipses of one prediction of all runs over each other, each about its own predicted value."""
    shown = [(k, one) for k, one in enumerate(row["by_run"]) if one is not None]
    unit, names = row["unit"], wording.axis_names(row["plane"], 2)
    held = [matrix_of(one, "covariance", "factor") for _, one in shown]
    covariances = [np.diag(np.square(one["sigma"])) if K is None else K for K, (_, one) in zip(held, shown)]
    reach = LEVEL * ROOM * max(float(np.sqrt(np.diag(K)).max()) for K in covariances)
    factor, text = wording.scale_of(reach, unit)
    x, y = (linear([-factor * reach, factor * reach], f"Δ {name}, {text}", pad=0.0) for name in names)
    x = x.reversed() if row["plane"] == "sky" else x
    key = "overlay-" + array_name(row["name"]).replace("_", "-")
    chart = Chart(key, width=LEFT + SIDE + 6.0, height=SIDE + 84.0)
    panel = chart.panel(x, y, top=8.0, bottom=8.0 + SIDE, left=LEFT, right=LEFT + SIDE)
    panel.open()
    columns: dict[str, Any] = {}
    entries: list[tuple[str, str, dict[str, Any]]] = []
    for (k, _), K in zip(shown, covariances):
        look: dict[str, Any] = {"stroke": SERIES[k % len(SERIES)][0], "stroke_width": 2.0}
        if DASHES[k % len(DASHES)]:
            look["stroke_dasharray"] = DASHES[k % len(DASHES)]
        points = outline(K, LEVEL)
        panel.line(factor * points[:, 0], factor * points[:, 1], labels[k], **look)
        entries.append(("line", labels[k], look))
        for name, values in zip(names, points.T):
            columns[f"{labels[k]} {name}_{unit}"] = values[::2].tolist()
    panel.close()
    chart.height = chart.legend(entries, chart.height - 34.0, LEFT - 4.0) - 4.0
    sizes = (Markup("{} {}").format(labels[k], product(one["semi_axes"], unit)) for k, one in shown)
    caption = Markup("<b>{}</b>, {}: 3σ ellipses, each about its own predicted value. Semi-axes (1σ): {}.").format(
        row["name"], wording.plane_name(row["plane"]), join(sizes)
    )
    return chart.plate(f"3 sigma ellipses of {row['name']} by run, over each other", caption, [csv(key, columns)])


def _orbit(found: Item, labels: Sequence[str]) -> Table:
    """Sigmas of the orbit at the reference epoch."""
    rows: list[tuple[Cell, ...]] = []
    for key, unit, words in (("sigma_position_km", "km", "position"), ("sigma_velocity_m_s", "m_s", "velocity")):
        for row in found["estimators"]:
            cells = ("—" if one is None else quantity(one[key], unit) for one in row["by_run"])
            rows.append((f"{row['name']}, {words}", *cells))
    return Table(
        caption="The orbit at the reference epoch, 1σ (root trace)",
        head=("estimator", *labels),
        align="l" + "r" * len(labels),
        rows=tuple(rows),
    )


def _predictions(found: Item, labels: Sequence[str]) -> Table | None:
    """Sigmas of every prediction, and their ratio to the first run."""
    rows: list[tuple[Cell, ...]] = []
    for row in found["predictions"]:
        cells: list[Cell] = []
        for one, ratio in zip(row["by_run"], row["ratio"]):
            times = f" ({ratio:.3g}{NBSP}{TIMES})" if ratio is not None and row["comparable"] else ""
            cells.append("—" if one is None else quantity(one["sigma_total"], one["unit"]) + times)
        rows.append((row["name"], *cells))
    if not rows:
        return None
    return Table(
        caption="Predictions, 1σ (root trace), and the ratio to the first run",
        head=("prediction", *labels),
        align="l" + "r" * len(labels),
        rows=tuple(rows),
    )


def _budget(row: Item, labels: Sequence[str], telescopes: Sequence[str]) -> Table:
    """Who is to blame for one prediction in each run."""
    shown = shown_budget(row["budget"], telescopes, MOST)
    return Table(
        caption=Markup("What is to blame for {}: share of the variance").format(row["name"]),
        head=("source", *labels),
        align="l" + "r" * len(labels),
        rows=tuple((one["source"], *(percent(share) for share in one["share"])) for one in shown),
    )
