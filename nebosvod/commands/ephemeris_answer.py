"""What `nebosvod ephemeris` says on a terminal: one line for each time, wide columns only where they hold something."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

from nebosvod.commands.approaches_answer import length
from nebosvod.errors import InputError
from nebosvod.mission.fields import observation_time
from nebosvod.timescale import Epoch

Row = Mapping[str, Any]
Column = tuple[str, str, Callable[[Row], str]]


def asked_dates(since: str, until: str) -> tuple[Epoch, Epoch]:
    """What --from and --to say.

    Raises
    ------
    InputError
        If one is no date, or they are in the wrong order; names the option.
    """
    found = []
    for option, text in (("from", since), ("to", until)):
        try:
            found.append(observation_time(text))
        except InputError as error:
            raise InputError(f"--{option}: {error}") from None
    if found[1] < found[0]:
        raise InputError(f"--to: {found[1].iso('utc', 0)} is before --from {found[0].iso('utc', 0)}")
    return found[0], found[1]


def sexagesimal(value: float, digits: int) -> str:
    """`12 34 56.789` of hours or degrees, 0 or more."""
    whole = round(value * 3600.0 * 10**digits)
    seconds, part = divmod(whole, 10**digits)
    minutes, seconds = divmod(seconds, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:02d} {minutes:02d} {seconds:02d}" + (f".{part:0{digits}d}" if digits else "")


def _ra(row: Row) -> str:
    return sexagesimal(row["ra_deg"] / 15.0, 3)


def _dec(row: Row) -> str:
    return ("-" if row["dec_deg"] < 0.0 else "+") + sexagesimal(abs(row["dec_deg"]), 2)


def _ellipse(row: Row) -> str:
    return f"{row['semi_major_arcsec']:.3g} x {row['semi_minor_arcsec']:.3g}"


def _optional(key: str, digits: int) -> Callable[[Row], str]:
    return lambda row: "-" if row[key] is None else f"{row[key]:.{digits}f}"


COLUMNS: tuple[Column, ...] = (
    ("", "UTC", lambda row: row["epoch_utc"].removesuffix(" UTC").removesuffix(".000").replace("T", " ")),
    ("", "RA", _ra),
    ("", "Dec", _dec),
    ("", 'RA*"/h', lambda row: f"{row['rate_ra_arcsec_h']:.2f}"),
    ("", 'Dec"/h', lambda row: f"{row['rate_dec_arcsec_h']:.2f}"),
    ("", 'ellipse 1s, "', _ellipse),
    ("", "PA", lambda row: f"{row['position_angle_deg']:.0f}"),
    ("", "delta", lambda row: f"{row['distance_au']:.5f}"),
    ("", "r", lambda row: f"{row['r_au']:.4f}"),
    ("", "phase", lambda row: f"{row['phase_deg']:.1f}"),
    ("", "elong", lambda row: f"{row['elongation_deg']:.1f}"),
    ("V", "V", _optional("V", 2)),
    ("altitude_deg", "alt", _optional("altitude_deg", 1)),
    ("twilight", "sky", lambda row: row["twilight"] or "-"),
    ("not_seen", "not seen", lambda row: row["not_seen"] or ""),
)


def print_ephemeris(summary: Mapping[str, Any], folder: Path | None) -> None:
    """Print the orbit, the table, and what a reader must know."""
    orbit, rows = summary["orbit"], summary["rows"]
    click.echo(f"{summary['object']} from {summary['observer']}; orbit: {orbit['origin']}")
    click.echo(
        f"position known to {length(orbit['sigma_position_km'])} km (1 sigma, root trace) at {orbit['epoch_tdb']}"
    )
    for text in summary["warnings"]:
        click.echo(f"notice: {text}", err=True)
    shown = [column for column in COLUMNS if not column[0] or any(row[column[0]] is not None for row in rows)]
    cells = [[head for _, head, _ in shown], *([make(row) for _, _, make in shown] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    click.echo("")
    click.echo("\n".join("  ".join(cell.rjust(w) for cell, w in zip(line, widths, strict=True)) for line in cells))
    if summary["ended"]:
        click.echo(f"\n{summary['ended']}")
    click.echo("\nastrometric places, ICRF; distances in au, angles in deg; position angle from north to east")
    if folder is not None:
        click.echo(f"report: {folder / 'report.html'}")
