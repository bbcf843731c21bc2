"""The page of a folder of `nebosvod risk`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from nebosvod.borders.stored import read_object
from nebosvod.report.kit.base import render
from nebosvod.report.run.tables import Table
from nebosvod.results.ahead_words import CALLED

Item = Mapping[str, Any]


def make_risk_page(folder: Path) -> str:
    """Return the page of a folder of `nebosvod risk`; the same folder gives the same bytes."""
    summary = read_object(Path(folder) / "summary.json")
    rows = summary["virtual_impactors"]
    return render(
        "orbit.html",
        kind="Impact risk",
        title=summary["title"],
        summary=summary,
        lead=f"until {summary['until_utc'][:10]}",
        tone="caution" if rows else "good",
        headline=_said(summary),
        plates=[],
        rows_title="Virtual impactors",
        rows=_table(rows),
    )


def _chance(row: Item) -> str:
    if row["bound"]:
        return f"< {row['high']:.2g}"
    return f"{row['probability']:.3g} ({row['low']:.3g} to {row['high']:.3g})"


def _said(summary: Item) -> str:
    rows = summary["virtual_impactors"]
    if not rows:
        return f"No virtual impactor until {summary['until_utc'][:10]}"
    worst = max(rows, key=lambda row: row["high"])
    body = CALLED.get(worst["body"], worst["body"].capitalize())
    return f"Probability to hit {body} on {worst['epoch_utc'][:10]}: {_chance(worst)}"


def _table(rows: list[Item]) -> Table | None:
    if not rows:
        return None
    body = tuple((row["body"], row["epoch_utc"], _chance(row), row["recommended"]) for row in rows)
    caption = Markup("Probability of each by the recommended way, with its 95 % interval.")
    return Table(caption=caption, head=("body", "UTC", "probability", "way"), rows=body, align="llrl")
