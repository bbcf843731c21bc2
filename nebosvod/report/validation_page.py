"""The page of a validation campaign: verdict, NEES distribution, every sigma against what the errors did."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.borders.wholefile import write_whole
from nebosvod.errors import OutputError
from nebosvod.report.kit.base import render
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import BLUE, GREY, INK, SERIES, VERMILION, Plate
from nebosvod.report.kit.scale import linear, named
from nebosvod.report.kit.stamp import stamp
from nebosvod.report.kit.wording import NBSP, PARAMETERS, join, number, percent, quantity, series
from nebosvod.report.run.tables import Cell, Table
from nebosvod.results.recognise import is_validation

Item = Mapping[str, Any]
SIZE = 6  # of the state, over which the NEES is judged


def write_validation_report(folder: Path, found: Item) -> Path:
    """Write validation.html beside validation.json, which must not be anybody else's; returns its path."""
    path = folder / "validation.html"
    if path.exists() and not is_validation(path):
        raise OutputError(f"{path}: was not written by this program; move it away")
    return write_whole(path, make_validation_report(found).encode("utf-8"))


def make_validation_report(found: Item) -> str:
    """Return the page of what validation.json holds; the same campaign gives the same bytes."""
    claims = [(e["name"], kind, judged) for e in found["estimators"] for kind, judged in e["judged"].items()]
    return render(
        "validation.html",
        kind="Validation report",
        stamp=stamp(found),
        title=found["title"],
        found=found,
        tone="good" if found["passed"] else "bad",
        tiles=_tiles(found, claims),
        headline=_headline(found),
        answers=_answers(found, claims),
        quantiles=_quantile_plate(claims),
        sigmas=[p for p in (_sigma_plate(*one) for one in claims) if p is not None],
        verdicts=_verdict_table(claims),
        coverage=_coverage_table(claims),
        innovations=_innovation_table(claims),
        directions=[_direction_table(*one) for one in claims],
    )


def title_of(name: str, kind: str) -> str:
    """An estimator and the covariance it is judged with."""
    return f"{name}, {'true' if kind == 'true' else 'formal'} covariance"


def _tiles(found: Item, claims: Sequence[tuple[str, str, Item]]) -> list[tuple[str, Cell]]:
    """The numbers a reader looks for first."""
    tiles: list[tuple[str, Cell]] = [
        ("verdict", "passed" if found["passed"] else "failed"),
        ("runs", str(found["n_runs"])),
    ]
    if claims:
        name, kind, judged = claims[0]
        tiles.append(
            (f"NEES/6, {title_of(name, kind)} (1 if sigma is right)", quantity(judged["nees"]["value"], "", 4))
        )
        worst = max(judged["resolution_percent"] for _, _, judged in claims)
        tiles.append(
            ("an error of sigma that every second campaign sees", Markup("{}{}%").format(number(worst, 2), NBSP))
        )
    return tiles


def _headline(found: Item) -> str:
    """The verdict: whether it passed, and what fails first."""
    return f"{found['verdict'][:1].upper()}{found['verdict'][1:]}."


def _answers(found: Item, claims: Sequence[tuple[str, str, Item]]) -> list[tuple[str, list[Cell]]]:
    """Sentences made from numbers: how far sigmas are off, whether to believe that, what would help."""
    judged: list[Cell] = [
        Markup("<b>{}</b>: {}.").format(title_of(name, kind), one["verdict"]) for name, kind, one in claims
    ]
    failed: list[Cell] = [
        Markup("<b>{}</b>: {}.").format(e["name"], e["reason"]) for e in found["estimators"] if e["reason"]
    ]
    wrong = [one for one in claims if not one[2]["consistent"]]
    first: list[Cell] = []
    if claims:
        right = [title_of(name, kind) for name, kind, one in claims if one["consistent"]]
        said = [f"sigmas right by {join(right)}"] if right else []
        said += [f"wrong by {join(title_of(name, kind) for name, kind, _ in wrong)}"] if wrong else []
        text = "; ".join(said)
        first = [f"{text[:1].upper()}{text[1:]}."]
    family = number(100 * found["family_level"], 1)
    tested = Markup("{} runs, seed {}; all tests of one verdict together err with {}{}% at the most.").format(
        found["n_runs"], found["seed"], family, NBSP
    )
    answers: list[tuple[str, list[Cell]]] = [("How accurate", [*first, *judged])]
    left_out = {e["name"]: e["left_out"] for e in found["estimators"] if e.get("left_out")}
    if left_out:
        parts = [Markup("{} leaves out {}").format(name, join(groups)) for name, groups in left_out.items()]
        answers.append(("Because of what", [Markup("{}.").format(Markup("; ").join(parts))]))
    answers.append(("Can it be believed", [tested, f"{found['method'][:1].upper()}{found['method'][1:]}."]))
    if failed:
        answers.append(("What has no answer" if not claims else "What fails", failed))
    if claims:
        worst = max(one["resolution_percent"] for _, _, one in claims)
        more = Markup(
            "An error of sigma of {}{}% is seen by every second such campaign; four times the runs halve that."
        )
        answers.append(("What would help", [more.format(number(worst, 2), NBSP)]))
    out = {e["name"]: e["n_failed"] for e in found["estimators"] if e["n_failed"]}
    if out:
        text = join(f"{name}: {n} of {found['n_runs']}" for name, n in out.items())
        answers.append(("Runs without an answer", [Markup("{}.").format(text)]))
    return answers


def _quantile_plate(claims: Sequence[tuple[str, str, Item]]) -> Plate | None:
    """Quantiles of the NEES against those of chi-square: on the diagonal if the covariance is right."""
    if not claims:
        return None
    every = [v for _, _, one in claims for k in ("sample", "chi_square") for v in one["nees_quantiles"][k]]
    top = float(np.quantile(every, 0.995))
    chart = Chart("nees", width=400.0, height=0.0)
    axis = linear([0.0, top], f"chi-square, {SIZE} degrees of freedom", pad=0.03)
    panel = chart.panel(axis, linear([0.0, top], "NEES of the runs", pad=0.03), top=8.0, bottom=308.0)
    panel.line([0.0, top], [0.0, top], stroke=GREY, stroke_width=1.2)
    panel.open()
    entries: list[tuple[str, str, dict[str, Any]]] = []
    columns: dict[str, Any] = {"probability": claims[0][2]["nees_quantiles"]["probability"],
                               "chi_square": claims[0][2]["nees_quantiles"]["chi_square"]}  # fmt: skip
    for i, (name, kind, one) in enumerate(claims):
        colour, marker = SERIES[i % len(SERIES)]
        sample = np.array(one["nees_quantiles"]["sample"])
        shown = sample <= top
        x = np.array(one["nees_quantiles"]["chi_square"])
        look: dict[str, Any] = {"color": colour, "size": 5.0 if i == 0 else 2.6}
        panel.dots(x[shown], sample[shown], marker, title_of(name, kind), **look)
        entries.append((marker, title_of(name, kind), look))
        columns[title_of(name, kind)] = sample
    panel.close()
    chart.height = chart.legend([("line", "covariance right", {"stroke": GREY, "stroke_width": 1.2}), *entries], 352.0)
    parts = [
        Markup("{}: mean {} per component, {}").format(
            title_of(name, kind), quantity(one["nees"]["value"], "", 4), _place(one["nees"])
        )
        for name, kind, one in claims
    ]
    caption = Markup(
        "Normalised error squared (NEES) of the state, 1{}% to 99{}% quantiles. Above the diagonal errors are larger "
        "than sigma says. {}."
    ).format(NBSP, NBSP, Markup("; ").join(parts))
    return chart.plate("Quantiles of the NEES against chi-square", caption, [csv("nees", columns)])


def _place(row: Item) -> str:
    """Where a value lies against its interval."""
    low, high = row["interval"]
    where = "inside" if low <= row["value"] <= high else "below" if row["value"] < low else "above"
    return f"{where} {number(low)} to {number(high)}"


def _name(row: Item) -> str:
    """A direction as a reader knows it."""
    if row["group"] == "parameter":
        return PARAMETERS.get(row["name"], (row["name"], ""))[0]
    return f"{row['group']}, {row['name']}"


def _sigma_plate(name: str, kind: str, judged: Item) -> Plate | None:
    """Sigma seen over sigma claimed in every direction, with the interval of chance."""
    rows = judged["directions"]
    if not rows:
        return None
    ratio = [row["value"] ** 0.5 for row in rows]
    ends = [[v**0.5 for v in row["interval"]] for row in rows]
    high = 18.0 * len(rows)
    chart = Chart(f"sigmas-{name}-{kind}".replace(" ", "-"), height=0.0)
    x = linear([0.9, 1.1, *ratio, *(v for pair in ends for v in pair)], "sigma of the errors over sigma claimed")
    panel = chart.panel(x, named([_name(row) for row in rows]), top=6.0, bottom=6.0 + high)
    for i, (low, up) in enumerate(ends):
        panel.bar(low, up, -float(i), 9.0, f"chance: {low:.3f} to {up:.3f}", fill=GREY, fill_opacity=0.25)
    panel.upright(1.0, stroke=INK, stroke_width=1.0)
    panel.open()
    for wrong, marker, colour, text in ((False, "o", BLUE, "inside"), (True, "s", VERMILION, "rejected")):
        points = [(r, -float(i)) for i, (r, row) in enumerate(zip(ratio, rows)) if row["rejected"] is wrong]
        if points:
            panel.marks(points, marker, text, color=colour, size=6.0)
    panel.close()
    chart.height = chart.legend(
        [("box", "where chance puts it if sigma is right", {"fill": GREY, "fill_opacity": 0.25}),
         ("o", "passed", {"color": BLUE, "size": 6.0}), ("s", "rejected", {"color": VERMILION, "size": 6.0})],
        high + 52.0)  # fmt: skip
    wrong_rows = [row for row in rows if row["rejected"]]
    far = max(rows, key=lambda row: abs(row["optimism_percent"]))
    said = Markup("{} of {} directions rejected").format(len(wrong_rows), len(rows))
    caption = Markup("<b>{}</b>: {}; the furthest from 1 is {} ({}).").format(
        title_of(name, kind), said, _name(far), quantity(far["value"] ** 0.5, "", 4)
    )
    columns = {key: [row[key] for row in rows] for key in ("group", "name", "unit", "sigma_claimed", "sigma_sample")}
    columns |= {"ratio": ratio, "ratio_low": [e[0] for e in ends], "ratio_high": [e[1] for e in ends]}
    columns["rejected"] = [row["rejected"] for row in rows]
    return chart.plate(
        f"Sigma of the errors over sigma claimed, {title_of(name, kind)}", caption, [csv(chart.key, columns)]
    )


def _verdict_table(claims: Sequence[tuple[str, str, Item]]) -> Table | None:
    """One row for each covariance on trial."""
    rows: list[tuple[Cell, ...]] = [
        (
            title_of(name, kind), "yes" if one["claimed"] else "no", "consistent" if one["consistent"] else "wrong",
            f"{one['n_rejected']} of {one['n_tests']}", quantity(one["nees"]["value"], "", 4),
            series(one["nees"]["interval"], "", " to "), quantity(one["cramer_von_mises"]["value"]),
            quantity(one["cramer_von_mises"]["p"]),
        )
        for name, kind, one in claims
    ]  # fmt: skip
    if not rows:
        return None
    head = ("covariance", "claimed", "verdict", "tests failed", "NEES / 6", "interval", "Cramér-von Mises", "its p")
    return Table(caption="Covariances on trial", head=head, align="lllrrrrr", rows=tuple(rows))


def _coverage_table(claims: Sequence[tuple[str, str, Item]]) -> Table | None:
    """How many errors the ellipsoids hold."""
    rows: list[tuple[Cell, ...]] = []
    for name, kind, one in claims:
        cells: list[Cell] = [title_of(name, kind)]
        for level in one["coverage"]:
            low, high = level["value_interval_99"]
            cells.append(Markup("{}<br>{} to {}").format(percent(level["value"]), percent(low), percent(high)))
        rows.append(tuple(cells))
    if not rows:
        return None
    heads = [f"{100 * level['fraction']:g}{NBSP}% ellipsoid" for level in claims[0][2]["coverage"]]
    return Table(caption="Coverage: errors inside the ellipsoid that should hold so many (99 % interval of the share)",
                 head=("covariance", *heads), align="l" + "r" * len(heads), rows=tuple(rows))  # fmt: skip


def _innovation_table(claims: Sequence[tuple[str, str, Item]]) -> Table | None:
    """NIS of each telescope."""
    rows = tuple(
        (Markup("{}<br>{}").format(title_of(name, kind), row["telescope"]), quantity(row["value"], "", 4),
         series(row["interval"], "", " to "), "rejected" if row["rejected"] else "passed")
        for name, kind, one in claims for row in one["nis"]
    )  # fmt: skip
    head = ("covariance, telescope", "NIS", "interval", "test")
    caption = "Innovations: normalised square (NIS) per component, by telescope"
    return Table(caption=caption, head=head, align="lrrl", rows=rows) if rows else None


def _direction_table(name: str, kind: str, judged: Item) -> Table:
    """Every direction in numbers."""
    rows = tuple(
        (_name(r), quantity(r["sigma_claimed"], r["unit"]), quantity(r["sigma_sample"], r["unit"]),
         quantity(r["mean_error"], r["unit"]), Markup("{}{}%").format(number(r["optimism_percent"], 2), NBSP),
         quantity(r["p"]), "rejected" if r["rejected"] else "passed")
        for r in judged["directions"]
    )  # fmt: skip
    return Table(
        caption=Markup("Directions, {}: sigma claimed and seen; a positive error of sigma is optimism").format(
            title_of(name, kind)
        ),
        head=("direction", "claimed", "seen", "mean error", "sigma wrong by", "p", "test"), align="lrrrrrl", rows=rows,
    )  # fmt: skip
