"""The page of a risk: `make_risk_page` reads a folder of `nebosvod risk` and returns one self-contained document."""

from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from nebosvod.borders.stored import read_arrays, read_object
from nebosvod.report.kit.base import render
from nebosvod.report.kit.plate import Plate
from nebosvod.report.kit.stamp import stamp_of
from nebosvod.report.kit.wording import count, moment, number, quantity
from nebosvod.report.risk import figures, tables
from nebosvod.report.risk.draws import Arrays
from nebosvod.report.risk.words import (
    Item,
    belief_words,
    blame_words,
    body_name,
    chance,
    halved_words,
    headline,
    impactor_name,
    leading,
    nominal_words,
)
from nebosvod.report.run.tables import Cell, Table

MOST_SHOWN = 3  # virtual impactors with figures of their own


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shown:
    """What the page shows of one virtual impactor."""

    row: Item
    name: str
    planes: list[Plate]
    ways: Plate
    ways_table: Table
    budget: Plate | None
    budget_table: Table | None
    encounter: Table | None


def make_risk_page(folder: Path) -> str:
    """Return the page of a folder of `nebosvod risk`; the same folder gives the same bytes."""
    summary, arrays = read_object(Path(folder) / "summary.json"), read_arrays(Path(folder) / "arrays.npz")
    rows = summary["virtual_impactors"]
    first = leading(rows)[:MOST_SHOWN]
    return render(
        "risk.html",
        kind="Impact risk",
        stamp=stamp_of(Path(folder)),
        title=summary["title"],
        summary=summary,
        headline=headline(summary),
        tone="caution" if rows or summary["ended"] or summary["warnings"] else "good",
        tiles=_tiles(summary, first),
        answers=_answers(summary, first),
        table=tables.impactor_table(rows),
        shown=[_shown(row, arrays) for row in first],
        levels=[t for row in first if (t := tables.level_table(row)) is not None],
        corridor_tables=[
            t for row in first if (t := tables.corridor_table(row, arrays, summary["orbit"]["epoch_tdb"])) is not None
        ],
        corridor=figures.corridor_plates(first, arrays),
        history=[plate for plate in [figures.history_plate(summary.get("history") or [])] if plate is not None],
    )


def _shown(row: Item, arrays: Arrays) -> Shown:
    """Figures and tables of one virtual impactor."""
    return Shown(
        row=row, name=impactor_name(row), planes=figures.plane_plates(row, arrays), ways=figures.ways_plate(row),
        ways_table=tables.ways_table(row), budget=figures.budget_plate(row), budget_table=tables.budget_table(row),
        encounter=tables.encounter_table(row),
    )  # fmt: skip


def _tiles(summary: Item, first: list[Item]) -> list[tuple[str, Cell]]:
    """The numbers a reader looks for."""
    if not first:
        return []
    row = first[0]
    tiles: list[tuple[str, Cell]] = [
        (f"probability to hit {body_name(row['body'])}, 95 %", chance(row)),
        ("when, 1σ", Markup("{} ± {}").format(moment(row["epoch_utc"]), quantity(row["sigma_time_s"], "s"))),
    ]
    if row["palermo"] is not None:
        torino = "" if row["torino"] is None else f", Torino {row['torino']}"
        tiles.append(("scales", f"Palermo {row['palermo']:.2f}{torino}".replace("-", "−")))
    if row["energy_mt"] is not None:
        tiles.append(("energy, by the magnitude", f"{number(row['energy_mt'])} Mt of TNT"))
    else:
        tiles.append(("size and energy", "not known: no magnitude"))
    return tiles


def _answers(summary: Item, first: list[Item]) -> list[tuple[str, list[Cell]]]:
    """Sentences: how near, because of what, whether to believe it, what would help, what else may happen."""
    said: list[tuple[str, list[Cell]]] = []
    if summary["ended"]:
        said.append(("How it ended", [_sentence(summary["ended"])]))
    if not first:
        drawn = summary["sampling"]
        told = f"None of {count(drawn['draws'], 'drawn orbit')} hits; they cannot see a probability below the bound."
        if line := summary.get("line"):
            ends = f"{line['from_sigmas']:.2g} to {line['to_sigmas']:.2g}".replace("-", "−")
            told += f" The line of variations, from {ends} sigmas, has none in reach either, and would see rarer ones."
        return [*said, ("Can it be believed", [told])]
    row = first[0]
    said.append(("How accurate", nominal_words(row)))
    blame = blame_words(row)
    if blame is not None:
        said.append(("Because of what", [Markup("{}.").format(_upper(blame))]))
    elif row.get("no_budget"):
        said.append(("Because of what", [_sentence(row["no_budget"])]))
    said.append(("Can it be believed", belief_words(row)))
    helps: list[Cell] = [halved_words(row)] if blame is not None else []
    helps.append(
        Markup("Which night may settle it: <code>nebosvod plan ORBIT --decide --until {}</code>.").format(
            summary["until_utc"][:10]
        )
    )
    said.append(("What would help", helps))
    others = [one for one in summary["virtual_impactors"] if one is not row]
    if others:
        parts = [Markup("{}: {}").format(impactor_name(one), chance(one)) for one in leading(others)[:3]]
        more = f", and {len(others) - 3} more" if len(others) > 3 else ""
        said.append(("What else may be hit", [Markup("{}{}.").format(_upper(Markup("; ").join(parts)), more)]))
    total = summary.get("palermo_cumulative")
    if total is not None and len(summary["virtual_impactors"]) > 1:
        said.append(("All together", [f"Cumulative Palermo scale {total:.2f}."]))
    return said


def _upper(text: Cell) -> Cell:
    """With a capital letter."""
    return Markup(text[:1].upper() + text[1:]) if isinstance(text, Markup) else text[:1].upper() + text[1:]


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + ("" if text.endswith(".") else ".")
