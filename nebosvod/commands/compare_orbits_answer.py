"""What a comparison of ephemerides, approaches or risks says on a terminal."""

from collections.abc import Mapping
from typing import Any

import click

from nebosvod.commands.approaches_answer import amount, chance, lasting
from nebosvod.impacts.chance import row_words
from nebosvod.results.compare_orbits import not_asked
from nebosvod.timescale import Epoch

MOST_ROWS = 40


def print_orbit_comparison(found: Mapping[str, Any]) -> None:
    """Print the folders, warnings, and a line for each time or approach."""
    for run in found["runs"]:
        seen = f", from {run['observer']}" if run["observer"] else ""
        click.echo(f"{run['label']}: {run['object']}{seen}; orbit: {run['orbit']}")
    for warning in found["warnings"]:
        click.echo(f"warning: {warning}")
    labels = [run["label"] for run in found["runs"]]
    lines = LINES[found["kind"]](found, labels)
    click.echo("")
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines[: MOST_ROWS + 1]:
        click.echo("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))
    if len(lines) > MOST_ROWS + 1:
        click.echo(f"... and {len(lines) - MOST_ROWS - 1} more (--json has them all)")


def _places(found: Mapping[str, Any], labels: list[str]) -> list[list[str]]:
    """Offsets from the first, arcsec, with the number of own sigmas."""
    lines = [["UTC", f"{labels[0]}, ellipse", *(f"{label} minus first" for label in labels[1:])]]
    for row in found["rows"]:
        first, *others = row["by_run"]
        cells = [row["epoch_utc"].removesuffix(" UTC").removesuffix(".000").replace("T", " ")]
        cells.append(f'{first["semi_major_arcsec"]:.3g} x {first["semi_minor_arcsec"]:.3g}"')
        for one in others:
            shift = "-" if one is None else f'{one["offset_ra_arcsec"]:+.3g} {one["offset_dec_arcsec"]:+.3g}"'
            cells.append(shift if one is None else f"{shift} ({one['offset_sigmas']:.2g} sigma)")
        lines.append(cells)
    return lines


def _approaches(found: Mapping[str, Any], labels: list[str]) -> list[list[str]]:
    """When and how near by each."""
    lines = [["body", *labels]]
    for row in found["rows"]:
        cells = [row["body"]]
        for one in row["by_run"]:
            if one is None:
                cells.append("-")
                continue
            when = Epoch.parse(one["epoch_utc"]).iso("utc", 0)[:19].replace("T", " ")
            near = f"{amount(one['distance_km'])} +- {amount(one['sigma_distance_km'])} km"
            hit = "" if (one["impact_probability_linear"] or 0.0) < 1e-12 else f", P {chance(one)}"
            cells.append(f"{when} +- {lasting(one['sigma_time_s'])}, {near}{hit}")
        lines.append(cells)
    return lines


def _risks(found: Mapping[str, Any], labels: list[str]) -> list[list[str]]:
    """How probable each impact is by each; of those that do not find it what their draws exclude."""
    lines = [["may hit", *labels]]
    for row in found["rows"]:
        cells = [row["body"]]
        for one, run in zip(row["by_run"], found["runs"], strict=True):
            if one is None:
                unseen = f"not found, P of all < {run['sampling']['high']:.2g}"
                cells.append(not_asked(row, run) or unseen)
                continue
            when = Epoch.parse(one["epoch_utc"]).iso("utc", 0)[:19].replace("T", " ")
            cells.append(f"{when}, P {row_words(one)}")
        lines.append(cells)
    if len(lines) == 1:
        lines.append(["nothing", *(f"P < {run['sampling']['high']:.2g}" for run in found["runs"])])
    return lines


LINES = {"ephemeris": _places, "approaches": _approaches, "risk": _risks}
