"""What `nebosvod approaches` says on a terminal: one line for each approach."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

from nebosvod.impacts.chance import chance_words
from nebosvod.results.ahead_words import CALLED
from nebosvod.results.outlook import place_words
from nebosvod.timescale import Epoch

Row = Mapping[str, Any]


def amount(value: float) -> str:
    """A number of km for a column: whole where it is large."""
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def length(km: float) -> str:
    """Four digits, and of long ones those before the point: 23,930, not 2.393e+04."""
    return f"{float(f'{km:.4g}'):,.0f}" if km >= 1e4 else f"{km:.4g}"


def lasting(seconds: float) -> str:
    """A sigma of time."""
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def chance(row: Row) -> str:
    """Probability of impact."""
    p = row["impact_probability_linear"]
    return "-" if p is None else chance_words(p)


COLUMNS: tuple[tuple[str, Callable[[Row], str]], ...] = (
    ("body", lambda row: row["body"] + (" (hits)" if row["impact"] else "")),
    ("UTC", lambda row: Epoch.parse(row["epoch_utc"]).iso("utc", 0)[:19].replace("T", " ")),
    ("1 sigma", lambda row: lasting(row["sigma_time_s"])),
    ("distance, km", lambda row: amount(row["distance_km"])),
    ("au", lambda row: f"{row['distance_au']:.5f}"),
    ("1 sigma, km", lambda row: amount(row["sigma_distance_km"])),
    ("3 sigma min, km", lambda row: amount(row["least_distance_3_sigma_km"])),
    ("v_inf, km/s", lambda row: "-" if row["v_infinity_km_s"] is None else f"{row['v_infinity_km_s']:.3f}"),
    ("P impact", chance),
)


def print_approaches(summary: Mapping[str, Any], folder: Path | None) -> None:
    """Print the orbit, the table, and what a reader must know."""
    orbit, rows = summary["orbit"], summary["approaches"]
    click.echo(f"{summary['object']}; orbit: {orbit['origin']}")
    click.echo(
        f"position known to {length(orbit['sigma_position_km'])} km (1 sigma, root trace) at {orbit['epoch_tdb']}"
    )
    for text in summary["warnings"]:
        click.echo(f"notice: {text}", err=True)
    span = f"from {summary['from_utc'][:10]} to {summary['to_utc'][:10]}"
    if rows:
        click.echo("")
        lines = [[head for head, _ in COLUMNS], *([make(row) for _, make in COLUMNS] for row in rows)]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        for line in lines:
            click.echo("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))
        click.echo("\nsigmas and probabilities are linear; distances from the centre of the body")
    else:
        click.echo(f"no approach within {summary['within_au']:g} au {span}{_nearest(summary['nearest'])}")
    for row in rows:
        if row["latitude_deg"] is not None:
            click.echo(f"falls at {place_words(row['longitude_deg'], row['latitude_deg'])}")
    if summary["ended"]:
        click.echo(summary["ended"])
    if folder is not None:
        click.echo(f"report: {folder / 'report.html'}")


def _nearest(row: Row | None) -> str:
    if row is None:
        return ""
    body = CALLED.get(row["body"], row["body"].capitalize())
    return f"; the nearest is to {body} on {row['epoch_utc'][:10]} at {row['distance_au']:.4g} au"
