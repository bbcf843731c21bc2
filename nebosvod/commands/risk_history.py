"""`nebosvod risk FIT --history`: the probability after each night of the observations."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

from nebosvod.dynamics import Ephemeris
from nebosvod.errors import InputError
from nebosvod.fits.history import Night, Watched, history
from nebosvod.impacts.chance import row_words
from nebosvod.impacts.risk import Risk
from nebosvod.mission import FitMission
from nebosvod.mission.reading.again import made_from
from nebosvod.observation.formats.records import Astrometry
from nebosvod.orbits.folders import is_folder_of_ours
from nebosvod.pipeline import objects
from nebosvod.results.risk_folder import way_row

Row = dict[str, Any]
Recorded = tuple[FitMission, Astrometry]
NIGHTLY = 2000  # draws after each night, of what --draws allows


def records_of(path: str) -> Recorded:
    """The records a fit was made from.

    Raises
    ------
    InputError
        If the path is no folder of a fit, or its files have changed or gone.
    """
    folder = Path(path)
    made = made_from(folder) if is_folder_of_ours(folder) else None
    if not isinstance(made, FitMission):
        raise InputError(f"--history: {path} is no folder of nebosvod fit, so its observations are not known")
    (records,) = objects(made, split=False)
    return made, records


def told(
    recorded: Recorded, found: Risk, summary: Mapping[str, Any], ephemeris: Ephemeris, draws: int, seed: int,
    say: Callable[[str], None],
) -> Row:  # fmt: skip
    """What joins the summary: the nights, and in warnings those without an orbit."""
    warnings = list(summary["warnings"])
    if not found.impactors:
        said = "--history: no virtual impactor is left whose probability could be followed"
        return {"history": None, "warnings": [*warnings, said]}
    worst = max(found.impactors, key=lambda one: one.way.high)
    watched = Watched(body=worst.body, epoch=worst.epoch, until=found.until)
    nights = history(recorded[1], recorded[0], watched, ephemeris, draws=draws, seed=seed, say=say)
    unknown = [one for one in nights if one.way is None]
    if unknown:
        first = unknown[0]
        warnings.append(
            f"--history: no orbit was known after {len(unknown)} of {len(nights)} nights (the first, "
            f"{first.until.iso('utc', 0)[:10]}, {first.n_observations} observations: {first.reason})"
        )
    return {"history": [_row(one) for one in nights if one.way is not None], "warnings": warnings}


def _row(one: Night) -> Row:
    """One night as the summary has it."""
    way = way_row(one.way) if one.way is not None else {}
    axes = one.semi_axes_km or (None, None)
    return {
        "until_utc": one.until.iso("utc", 0),
        "n_observations": one.n_observations,
        **{key: way[key] for key in ("probability", "low", "high", "bound")},
        "recommended": way["way"],
        "semi_major_km": axes[0],
        "semi_minor_km": axes[1],
    }


def print_history(rows: list[Row]) -> None:
    """Print one line for each night."""
    click.echo("\nAfter each night (UTC): observations, probability, 1 sigma in the target plane")
    for row in rows:
        axes = "" if row["semi_major_km"] is None else f"{row['semi_major_km']:,.0f} x {row['semi_minor_km']:.3g} km"
        click.echo(f"  {row['until_utc'][:10]}  {row['n_observations']:>4}  {row_words(row):<28} {axes}")
