"""What `nebosvod alert` says on a terminal: probability, range, orbits and sizes, where it falls, where to look."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from nebosvod.errors import counted
from nebosvod.impacts.chance import short_words
from nebosvod.results.alert_words import (
    angle,
    arc,
    duration,
    first_visible,
    headline,
    none_visible,
    prior_decides,
    sight,
)

Row = Mapping[str, Any]
QUANTITIES = (
    ("range_au", "range", "au"), ("rate_km_s", "range rate", "km/s"), ("a_au", "a", "au"), ("e", "e", ""),
    ("i_deg", "i", "deg"), ("q_au", "q", "au"), ("H", "H", "mag"), ("diameter_m", "diameter", "m"),
)  # fmt: skip
CALLED = {"uniform": "uniform in range and rate", "cartesian": "uniform in space and velocity", "jeffreys": "Jeffreys'"}
SHOWN = 12


def print_alert(summary: Row, folder: Path | None, fitted: bool = False) -> None:
    """Print the answer and where the rest is; notices go to stderr. `fitted`: least squares have been tried."""
    for line in alert_lines(summary, fitted):
        click.echo(line)
    for text in summary["warnings"]:
        click.echo(f"notice: {text}", err=True)
    if folder is not None:
        click.echo(f"report: {folder / 'report.html'}")


def alert_lines(summary: Row, fitted: bool = False) -> Iterator[str]:
    """The answer, line by line."""
    out = f", {len(summary['rejected'])} more left out as gross errors" if summary["rejected"] else ""
    yield (
        f"{summary['object']}: {counted(summary['n_observations'], 'observation')} over {arc(summary['arc_h'])}, "
        f"{summary['first_utc'][:16].replace('T', ' ')} to {_until(summary)} UTC, "
        f"by {', '.join(summary['stations'])}{out}"
    )
    yield headline(summary)
    others = (
        f"{CALLED[prior]} {short_words(row)}"
        for prior, row in summary["by_prior"].items()
        if prior != summary["headline"]
    )
    yield f"  prior: {CALLED[summary['headline']]}; others: {'; '.join(others)}"
    if prior_decides(summary["by_prior"]):
        yield "  the prior decides: believe none of these alone"
    yield f"{summary['message'][0].upper()}{summary['message'][1:]}"
    if summary["orbit_status"] == "observable" and not fitted:
        yield "  least squares may be believed as well: nebosvod fit"
    yield from _fall(summary["impact"])
    yield ""
    yield f"{'':<12}{'2.5 %':>12}{'16 %':>12}{'median':>12}{'84 %':>12}{'97.5 %':>12}"
    for key, label, unit in QUANTITIES:
        if row := summary["quantities"].get(key):
            cells = "".join(f"{row[name]:>12.5g}" for name in ("q025", "q16", "median", "q84", "q975"))
            yield f"{label:<12}{cells} {unit}".rstrip()
    told = ", ".join(
        f"{name.replace('_', ' ')} {value:.2g}" for name, value in summary["scores"].items() if value > 5e-4
    )
    yield f"scores of classes (no probabilities): {told}"
    yield from _fields(summary)
    yield from _history(summary["history"])
    yield from _decisions(summary["decisions"])
    grid = summary["grid"]
    heavy = grid["effective"][summary["headline"]]
    yield f"\n{grid['n_nodes']} nodes of the grid, {heavy:.0f} carry the weight; chi2 of the best {grid['chi2']:.2f}"


def _until(summary: Row) -> str:
    """The time of the last observation, with its date where that is another one."""
    first, last = str(summary["first_utc"]), str(summary["last_utc"])[:16].replace("T", " ")
    return last[11:] if first[:10] == last[:10] else last


def line_of(summary: Row) -> str:
    """One object in a line."""
    size = summary["quantities"].get("H")
    brightness = f", H {size['median']:.1f}" if size else ""
    best = summary["quantities"]["range_au"]["median"]
    return (
        f"{summary['object']}: P {short_words(summary)}; {counted(summary['n_observations'], 'observation')} over "
        f"{arc(summary['arc_h'])}; range {best:.3g} au{brightness}; {summary['orbit_status'].replace('_', ' ')}"
    )


def _fall(fall: Row | None) -> Iterator[str]:
    if fall is None:
        return
    east, north = fall["longitude_deg"], fall["latitude_deg"]
    yield (
        f"If it hits: {fall['epoch_utc'][:19].replace('T', ' ')} UTC +- {duration(fall['half_68_s'])} (68 %), "
        f"longitude {east['median']:.2f} ({east['q025']:.2f} to {east['q975']:.2f}), latitude {north['median']:.2f} "
        f"({north['q025']:.2f} to {north['q975']:.2f}) deg; {fall['speed_km_s']['median']:.1f} km/s at "
        f"{fall['entry_km']:.0f} km, {fall['elevation_deg']['median']:.0f} deg below the horizon"
    )


def _fields(summary: Row) -> Iterator[str]:
    rows: list[Row] = summary["fields"]
    if rows:
        yield "\nwhere to look next (mean of the drawn orbits, 1 sigma semi-axes):"
    for row in rows[:SHOWN]:
        faint = "" if row["V"] is None else f"  V {row['V']:.1f}"
        yield (
            f"  {row['epoch_utc'][:16].replace('T', ' ')}  {row['telescope']}: RA {row['ra_deg']:.4f}, Dec "
            f"{row['dec_deg']:+.4f} deg, {angle(row['semi_major_arcsec'])} x {angle(row['semi_minor_arcsec'])}{faint}"
            f"  {sight(row)}".rstrip()
        )
    if len(rows) > SHOWN:
        yield f"  and {len(rows) - SHOWN} more (summary.json, page)"
    if rows and first_visible(summary) is None:
        yield f"  {none_visible(summary)}"


def _history(rows: list[Row]) -> Iterator[str]:
    if rows:
        yield "\nafter each observation:"
    for row in rows:
        values = "; ".join(f"{CALLED[prior]} {short_words(one)}" for prior, one in row["chances"].items())
        yield f"  {row['n_observations']:>3}  {row['epoch_utc'][:19].replace('T', ' ')}  {values}"


def _decisions(rows: list[Row]) -> Iterator[str]:
    if rows:
        yield "\nwhat one more observation would do to the probability:"
    for row in rows:
        spread = row["quantiles"]
        yield (
            f"  {row['epoch_utc'][:16].replace('T', ' ')}  {row['telescope']}: settles it with chance "
            f"{row['settles']:.2f} ({row['settles_low']:.2f} to {row['settles_high']:.2f}); "
            f"P then {spread['q16']:.2g} to {spread['q84']:.2g} (16 to 84 %), median {spread['median']:.2g}"
        )
