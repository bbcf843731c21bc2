"""The page of a study: what was looked for, the trade, who is to blame, what moves it, the table to take away."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from nebosvod.report import study_words
from nebosvod.report.kit.base import render
from nebosvod.report.kit.download import Download, csv
from nebosvod.report.kit.plate import Plate
from nebosvod.report.kit.stamp import stamp
from nebosvod.report.kit.wording import DASH, percent, quantity
from nebosvod.report.run.tables import Cell, Table
from nebosvod.report.study_figures import (
    blame_plate,
    cloud_plate,
    curve_plate,
    distribution_plate,
    front_plate,
    heat_plate,
    sensitivity_plate,
    shares_plate,
    titled,
)
from nebosvod.report.study_population import KIND, paired_table, seen_table, sky_plate, time_plates, warned_table
from nebosvod.report.study_words import is_number, page_unit

Item = Mapping[str, Any]
Columns = Mapping[str, npt.NDArray[Any]]
MOST_ROWS = 5000  # of the table that stands in the page
KEYS = ("least", "median", "largest")
OBJECT = "object"  # the column of a catalogue
CLOUDS = 4  # axes of a sample that are shown


def make_study_page(found: Item, columns: Columns) -> str:
    """Return the page of a study; the same study gives the same bytes.

    Parameters
    ----------
    found : what study.json holds.
    columns : of the table, by name.
    """
    lost = found["n_failed"] + found["n_without_answer"]
    searched = found["find"]
    bad = searched is not None and not searched["found"]
    return render(
        "study.html",
        kind="Study",
        stamp=stamp(found),
        title=found["title"],
        found=found,
        tone="bad" if bad else "caution" if lost else "good",
        verdict=study_words.verdict(found),
        told=study_words.answers(found),
        tiles=_tiles(found),
        trade=_trade(found, columns),
        blame=_blame(found, columns),
        sensitivities=[p for one in found["sensitivity"] if (p := sensitivity_plate(one, found))],
        front=front_plate(found, columns),
        required=_required(found),
        together=study_words.together(found),
        averaging=_averaging(found),
        seen=_seen(found),
        paired=paired_table(found),
        population=_population(found, columns),
        answers=_answer_table(found),
        table=_download(found, columns),
    )


def _tiles(found: Item) -> list[tuple[str, Cell]]:
    tiles: list[tuple[str, Cell]] = [("point" if found["n_points"] == 1 else "points", f"{found['n_points']:,}")]
    if found["draws"]:
        tiles.append(("drawn, each", str(found["draws"])))
    if found["find"]:
        tiles.append(("points that will do", f"{found['find']['n_feasible']:,}"))
    if found["n_failed"] + found["n_without_answer"]:
        tiles.append(("points without an answer", f"{found['n_failed'] + found['n_without_answer']:,}"))
    return tiles


def _trade(found: Item, columns: Columns) -> list[Plate]:
    """Curves of one axis, maps of two, clouds of a sample; answers that have values."""
    answers = [one for one in found["answers"] if not one["shares"] and one["n"]]
    axes = _shown_axes(found)
    if any(one["name"] == OBJECT for one in found["vary"]):
        return [distribution_plate(one, columns) for one in answers if one.get("before_d") is None]
    if found["sample"]["method"] != "grid":
        numeric = [one for one in found["vary"] if one["numeric"]][:CLOUDS]
        return [cloud_plate(axis, answer, columns) for answer in answers[:2] for axis in numeric]
    if len(axes) == 2:
        return [heat_plate(found, answer, columns, axes) for answer in answers]
    if not axes or not axes[0]["numeric"]:
        return []
    slopes = {one["answer"]: one for one in found["slopes"]}
    return [curve_plate(axes[0], one, columns, slopes.get(one["name"])) for one in answers]


def _shown_axes(found: Item) -> list[Item]:
    """The two axes of the maps: numbers before words, as they stand in the file."""
    several = [one for one in found["vary"] if one["n_values"] > 1 and one["name"] != OBJECT]
    return sorted(several, key=lambda one: not one["numeric"])[:2]


def _blame(found: Item, columns: Columns) -> list[Plate]:
    """Which source leads where, for each answer that is shares."""
    shares = [one for one in found["answers"] if one["shares"] and one["leading"]]
    axes = _shown_axes(found)
    if found["sample"]["method"] != "grid" or not axes or any(one["name"] == OBJECT for one in found["vary"]):
        return []
    if len(axes) == 2:
        return [blame_plate(found, one, columns, axes) for one in shares]
    return [shares_plate(axes[0], one, columns) for one in shares] if axes[0]["numeric"] else []


def _required(found: Item) -> Table | None:
    """What is needed of each thing by itself."""
    wanted = found["require"]
    if wanted is None:
        return None
    unit = page_unit(next(one["unit"] for one in found["answers"] if one["name"] == wanted["answer"]))
    rows: list[tuple[Cell, ...]] = [
        (
            one["name"], quantity(one["now"], page_unit(one["unit"]), 4),
            quantity(one["needed"], page_unit(one["unit"]), 4) if one["needed"] is not None else DASH,
            one["verdict"], _end(one["floor"], unit), _knee(one, "no_better_below"), _end(one["without"], unit),
            _knee(one, "no_worse_above"),
        )
        for one in wanted["each"]
    ]  # fmt: skip
    caption = Markup("What is needed of each, the others as they are, for {} {} (now {})").format(
        wanted["answer"], wanted["wanted"], _end(wanted["now"], unit)
    )
    head: tuple[Cell, ...] = (
        "of", "now", "needed", "", "if it were perfect", "as good as perfect below", "if nothing were known of it",
        "as good as unknown above",
    )  # fmt: skip
    return Table(caption=caption, head=head, align="lrrlrrrr", rows=tuple(rows))


def _knee(one: Item, key: str) -> Cell:
    """Where a thing stops to matter; a dash where it never does."""
    value = one.get(key)
    return DASH if value is None else quantity(value, page_unit(one["unit"]), 3)


def _averaging(found: Item) -> tuple[Cell, Table] | None:
    """How many measurements do what a better telescope does, and what one tells: the matrix D0."""
    told = (found["require"] or {}).get("averaging")
    if not told:
        return None
    unit = page_unit(next(one["unit"] for one in found["answers"] if one["name"] == found["require"]["answer"]))
    said = []
    if told["n_needed"] is not None:
        said.append(
            Markup("{} measurements of the same kind bring it as well (now {}).").format(
                f"{math.ceil(told['n_needed'] - 1e-9):,}", f"{told['n']:,}"
            )
        )
    if told["n_where_equal"] is not None:
        said.append(
            Markup(
                "Averaging brings most up to about {} measurements; however many, what they have in common leaves {}."
            ).format(f"{max(1, round(told['n_where_equal'])):,}", _end(told["floor"], unit))
        )
    said.append(
        Markup("Noise alone would leave {} of position, by σ² D0⁻¹ / N with σ {} and N = {} components.").format(
            _end(told["sigma_position_km"], "km"), quantity(told["sigma_arcsec"], "arcsec", 3), told["components"]
        )
    )
    rows = tuple((name, *(f"{value:.3g}" for value in line)) for name, line in zip(told["D0_names"], told["D0"]))
    table = Table(
        caption="D0, what one component of a measurement tells of the state on average (rad, km, km/s)",
        head=("", *told["D0_names"]), align="l" + "r" * len(told["D0_names"]), rows=rows,
    )  # fmt: skip
    return Markup(" ").join(said), table


def _end(value: float | None, unit: str) -> Cell:
    return DASH if value is None else quantity(value, unit, 4)


def _seen(found: Item) -> Table | None:
    """How many objects of a catalogue are seen at all."""
    if not found["seen"]:
        return None
    names = list(found["seen"][0]["where"])
    rows: list[tuple[Cell, ...]] = []
    for one in found["seen"]:
        low, high = one["interval_95"]
        where = [f"{value:.4g}" if is_number(value) else str(value) for value in one["where"].values()]
        share = Markup("{} ({} to {})").format(percent(one["share"]), percent(low), percent(high))
        rows.append((*(where or ["all"]), f"{one['n_seen']} of {one['n']}", share))
    head: tuple[Cell, ...] = (*(names or ["objects"]), "seen at all", "share, 95 % interval")
    return Table(caption="Objects that are seen", head=head, align="l" * max(1, len(names)) + "rr", rows=tuple(rows))


def _population(found: Item, columns: Columns) -> Mapping[str, Any] | None:
    """What is said of drawn impactors: tables and figures."""
    own = found.get("population")
    if own is None or KIND not in columns:
        return None
    return {
        "seen": seen_table(own),
        "warned": warned_table(own),
        "plates": [sky_plate(columns), *time_plates(own)],
        "shared": own["shared"],
        "draws": own["draws"],
    }


def _answer_table(found: Item) -> Table:
    """Every answer in numbers."""
    rows: list[tuple[Cell, ...]] = [
        (one["name"], one["of"], *(quantity(one[key], page_unit(one["unit"]), 4) for key in KEYS))
        if one["n"]
        else (one["name"], one["of"], "none", "none", "none")
        for one in found["answers"]
        if not one["shares"]
    ]
    head: tuple[Cell, ...] = ("answer", "what it is", *KEYS)
    return Table(caption="Answers over all points", head=head, align="llrrr", rows=tuple(rows))


def _download(found: Item, columns: Columns) -> Download | None:
    """The whole table, where it is not too long for a page."""
    if found["n_rows"] > MOST_ROWS:
        return None
    titles = {one["name"]: titled(one) for one in (*found["vary"], *(a for a in found["answers"] if not a["shares"]))}
    return csv("results", {titles.get(name, name): _plain(column) for name, column in columns.items()})


def _plain(column: npt.NDArray[Any]) -> list[Any]:
    return [str(one) if isinstance(one, str | np.str_) else one for one in column.tolist()]
