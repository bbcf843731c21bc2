"""What `nebosvod risk` says on a terminal: each virtual impactor, and every way side by side."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from nebosvod.commands.approaches_answer import lasting, length
from nebosvod.commands.risk_history import print_history
from nebosvod.dynamics.ephemeris import PLANETS
from nebosvod.errors import InputError
from nebosvod.impacts.chance import bound_words, chance_words, row_words
from nebosvod.impacts.scales import Size
from nebosvod.impacts.ways import WORDS
from nebosvod.mission.fields import observation_time
from nebosvod.results.ahead_words import CALLED
from nebosvod.timescale import Epoch
from nebosvod.units import LENGTH, quantity

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


def asked_size(magnitude: tuple[float, float] | None, diameter: str | None, density: float | None) -> Size | None:
    """What --diameter and --density say, else the size by the magnitude.

    Raises
    ------
    InputError
        If one cannot be used; names the option.
    """
    km = None
    if diameter is not None:
        try:
            km = quantity(diameter, LENGTH)
        except InputError as error:
            raise InputError(f"--diameter: {error}") from None
        if not 0.0 < km < 10_000.0:
            raise InputError(f"--diameter: {diameter} (allowed: more than 0, below 10000 km)")
    if density is not None and not 10.0 <= density <= 20_000.0:
        raise InputError(f"--density: {density:g} kg/m3 (allowed: 10 to 20000)")
    return Size.of(None if magnitude is None else magnitude[0], km, density)


def print_risk(summary: Row, folder: Path | None) -> None:
    """Print the orbit, each virtual impactor with its ways, and what a reader must know."""
    orbit = summary["orbit"]
    click.echo(f"{summary['object']}; orbit: {orbit['origin']}")
    click.echo(
        f"position known to {length(orbit['sigma_position_km'])} km (1 sigma, root trace) at {orbit['epoch_tdb']}"
    )
    for text in summary["warnings"]:
        click.echo(f"notice: {text}", err=True)
    for row in summary["virtual_impactors"]:
        for line in _impactor(row):
            click.echo(line)
    if not summary["virtual_impactors"]:
        bound = f"P {bound_words(summary['sampling']['high'])}"
        where = " or ".join(CALLED.get(body, body.capitalize()) for body in summary["bodies"])
        click.echo(
            f"\nno virtual impactor of {where} until {summary['until_utc'][:10]}: none of "
            f"{summary['n_draws']} drawn orbits hits, {bound}; {_others(summary)}"
        )
    if summary["palermo_cumulative"] is not None and len(summary["virtual_impactors"]) > 1:
        click.echo(f"\nPalermo scale of all together {summary['palermo_cumulative']:.2f}")
    if summary["history"]:
        print_history(summary["history"])
    if folder is not None:
        click.echo(f"report: {folder / 'report.html'}")


def _others(summary: Row) -> str:
    """How far the ways that draw nothing have looked."""
    line = summary.get("line")
    if line is None:
        return "no other way looks for one"
    ends = f"{line['from_sigmas']:.2g} to {line['to_sigmas']:.2g} sigmas"
    return f"the line of variations from {ends} and the target planes of the estimate to 7 sigmas have none in reach"


def _impactor(row: Row) -> list[str]:
    """Lines of one virtual impactor."""
    when = row["epoch_utc"][:19].replace("T", " ")
    said = [
        "",
        f"{row['body'].capitalize()} on {when} UTC +- {lasting(row['sigma_time_s'])}: {row_words(row)}",
        f"  {WORDS[row['recommended']]}: {row['reason']}",
    ]
    for way in row["ways"]:
        said.append(f"    {WORDS[way['way']]:<21} {row_words(way)}{'; ' + way['note'] if way['note'] else ''}")
    if row["sigmas"] is not None:
        stretched = "" if row["stretching_km"] is None else f", where one moves it by {length(row['stretching_km'])} km"
        said.append(f"  {row['sigmas']:.2f} sigmas along the line of variations{stretched}")
    if row["energy_mt"] is not None:
        scales = "" if row["palermo"] is None else f"; Palermo {row['palermo']:.2f}"
        scales += "" if row["torino"] is None else f", Torino {row['torino']}"
        said.append(f"  {row['energy_mt']:.3g} Mt of TNT{scales}")
    elif row["body"] == "earth":
        said.append("  energy, Palermo and Torino scale not known: no magnitude; --diameter gives them")
    ground = row["corridor"]["ground"]
    if ground is not None and ground["latitude_deg"] is not None:
        said.append(f"  ground: {_place(ground)}")
    budget = row["budget"]
    said += [f"  what it hangs on: {row['no_budget']}"] if budget is None else _budget(budget)
    return said


def _place(level: Row) -> str:
    """Where, when, and how sharply."""
    place = f"{abs(level['latitude_deg']):.2f} {'N' if level['latitude_deg'] >= 0.0 else 'S'}, "
    place += f"{abs(level['longitude_deg']):.2f} {'E' if level['longitude_deg'] >= 0.0 else 'W'} (geodetic)"
    if level["semi_major_km"] is not None:
        place += f", {level['semi_major_km']:.3g} x {level['semi_minor_km']:.3g} km"
    else:
        place += f" amid a corridor ({level['no_ellipse']})"
    return f"{place}; {level['speed_km_s']:.2f} km/s, {level['below_horizon_deg']:.0f} deg below the horizon"


def _budget(budget: Row) -> list[str]:
    """What the probability hangs on: the strongest sources, with the estimate held and, where known, re-optimised."""
    anew = any(row.get("elasticity_reoptimised") is not None for row in budget["rows"])  # an older folder has no key
    said = ["  what it hangs on: source, d ln P / d ln sigma with the estimate held"]
    said[0] += ", re-optimised (weights solved anew, the estimate moves)" if anew else ""
    said[0] += ", P if it were halved and the estimate held"
    if not budget["enough"]:
        said[0] += f" (a hint, from {budget['effective_hits']:.0f} effective hits)"
    for row in budget["rows"][:5]:
        held = _with_error(row["elasticity"], row["elasticity_error"])
        other = _with_error(row.get("elasticity_reoptimised"), row.get("elasticity_reoptimised_error")) if anew else ""
        halved = chance_words(min(row["probability_if_halved"], 1.0))
        said.append(f"    {row['source']:<32} {held}   {other}{'   ' if anew else ''}{halved}")
    return said


def _with_error(value: float | None, error: float | None) -> str:
    return f"{'-':^14}" if value is None or error is None else f"{value:+.2f} +- {error:.2f}"
