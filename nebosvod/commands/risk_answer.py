"""What `nebosvod risk` says on a terminal: each virtual impactor, and every way side by side."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from nebosvod.dynamics.ephemeris import PLANETS
from nebosvod.errors import InputError
from nebosvod.mission.fields import observation_time
from nebosvod.timescale import Epoch

Row = Mapping[str, Any]
ALLOWED = tuple(body for body in PLANETS if body not in ("sun", "pluto"))


def asked_date(option: str, text: str) -> Epoch:
    """What an option with a date says.

    Raises
    ------
    InputError
        If it is none; names the option.
    """
    try:
        return observation_time(text)
    except InputError as error:
        raise InputError(f"--{option}: {error}") from None


def asked_bodies(text: str) -> list[str]:
    """What --bodies says.

    Raises
    ------
    InputError
        If one is no planet or moon, or stands twice.
    """
    names = [name.strip().lower() for name in text.split(",")]
    for name in names:
        if name not in ALLOWED:
            raise InputError(f'--bodies: "{name}" is no target (allowed: {", ".join(ALLOWED)}, several by commas)')
    if len(set(names)) < len(names):
        raise InputError(f"--bodies: {text}: each once")
    return names


def chance(row: Row) -> str:
    """Probability and its interval; of no hit the bound."""
    if row["bound"]:
        return f"< {row['high']:.2g} (95 %)"
    p, low, high = row["probability"], row["low"], row["high"]
    return f"{p:.3g}" if low == high else f"{p:.3g} ({low:.3g} to {high:.3g})"


def print_risk(summary: Row, folder: Path | None) -> None:
    """Print the orbit, each virtual impactor with its ways, and what a reader must know."""
    orbit = summary["orbit"]
    click.echo(f"{summary['object']}; orbit: {orbit['origin']}")
    click.echo(f"position known to {orbit['sigma_position_km']:.4g} km (1 sigma, root trace) at {orbit['epoch_tdb']}")
    for text in summary["warnings"]:
        click.echo(f"notice: {text}", err=True)
    for row in summary["virtual_impactors"]:
        click.echo(f"\n{row['body'].capitalize()} on {row['epoch_utc'][:19].replace('T', ' ')} UTC: {chance(row)}")
        click.echo(f"  {row['recommended']}: {row['reason']}")
        for way in row["ways"]:
            click.echo(f"  {way['way']:<20} {chance(way)}{'; ' + way['note'] if way['note'] else ''}")
        if row["palermo"] is not None:
            torino = "" if row["torino"] is None else f", Torino {row['torino']}"
            click.echo(f"  {row['energy_mt']:.3g} Mt of TNT; Palermo {row['palermo']:.2f}{torino}")
    if not summary["virtual_impactors"]:
        bound = f"P < {summary['sampling']['high']:.2g} (95 %)"
        where = " or ".join(summary["bodies"])
        click.echo(
            f"\nno virtual impactor of {where} until {summary['until_utc'][:10]}: none of "
            f"{summary['n_draws']} drawn orbits hits, {bound}"
        )
    if folder is not None:
        click.echo(f"report: {folder / 'report.html'}")
