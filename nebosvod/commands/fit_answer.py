"""The short answer of a fit on a terminal: the orbit with its sigmas, how the observations agree, who is to blame."""

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from nebosvod.commands.diagnosis_answer import diagnosis_lines
from nebosvod.errors import counted
from nebosvod.impacts.chance import chance_words
from nebosvod.results.ahead_words import ahead_sentences
from nebosvod.results.condensed import condensed, foremost, without
from nebosvod.results.outlook import (
    answered,
    event_words,
    impact_sentences,
    unanswered_sentences,
    unit_of,
)

STATIONS_SHOWN = 8
REJECTED_SHOWN = 8
SHARED_SHOWN = 6
BUDGET_SHOWN = 6
PARAMETERS_SHOWN = 8
DOUBT = "; not to be believed, see the warnings"
LEFT_OUT = {"date": "by date"}
ELEMENTS = (
    ("e", "e", ""),
    ("a_au", "a", "au"),
    ("q_au", "q", "au"),
    ("i_deg", "i", "deg"),
    ("node_deg", "node", "deg"),
    ("peri_deg", "peri", "deg"),
    ("mean_anomaly_deg", "M", "deg"),
    ("tp_jd_tdb", "tp", "JD TDB"),
)


def print_fit(summary: Mapping[str, Any], folder: Path | None, console: Console | None = None) -> None:
    """Print what a reader wants first, and where the rest is."""
    out = console or Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 120)
    fit = summary["fit"]
    out.print(f"[bold]{_plain(summary['title'])}[/bold]")
    for line in _headline(summary):
        out.print(_plain(line))
    for line in impact_sentences(summary):
        out.print(_plain(line), style="bold")
    if summary["orbit"] is not None:
        out.print(_orbit(summary["orbit"]))
        for line in _state_lines(summary):
            out.print(_plain(line))
        for line in ahead_sentences(summary["ahead"]):
            out.print(_plain(line), style="bold" if "impact on" in line or "hits" in line else "")
    out.print(_stations(fit))
    for line in (
        *_rejected(fit),
        *_tests(fit),
        *diagnosis_lines(summary),
        *_budget(summary),
        *_predictions(summary),
        *_reference(summary),
    ):
        out.print(_plain(line))
    for line in (*fit["notices"], *(f"warning: {text}" for text in summary["warnings"])):
        out.print(_plain(line))
    if folder is not None:
        out.print(f"report: {_plain(str(folder / 'report.html'))}")


def _plain(text: str) -> str:
    """Text in which rich sees no markup."""
    return text.replace("[", r"\[")


def _headline(summary: Mapping[str, Any]) -> Iterator[str]:
    fit = summary["fit"]
    left = ", ".join(f"{count} {LEFT_OUT.get(reason, reason)}" for reason, count in fit["left_out"].items())
    yield (
        f"{counted(summary['n_observations'], 'observation')} by {counted(len(fit['stations']), 'station')}, "
        f"{fit['first_observation_utc'][:10]} to {fit['last_observation_utc'][:10]} ({fit['arc']})"
        + (f"; left out: {left}" if left else "")
    )
    yield f"{fit['status'].replace('_', ' ')}: {fit['message']}"
    reduced = fit["reduced_chi2"]
    yield (
        f"{fit['n_selected']} selected, {fit['n_rejected']} rejected; rms {fit['rms_ra_arcsec']:.3f} arcsec in RA*, "
        f"{fit['rms_dec_arcsec']:.3f} in Dec; chi2 {fit['chi2']:.1f} for {counted(fit['dof'], 'degree')} of freedom"
        + (f" ({reduced:.2f})" if reduced is not None else "")
    )


def with_sigma(value: float, sigma: float) -> tuple[str, str]:
    """Value and sigma with digits down to a hundredth of the sigma."""
    if not sigma > 0.0:
        return f"{value:.12g}", "0"
    digits = 0
    while digits < 14 and sigma * 10.0**digits < 10.0:
        digits += 1
    return f"{value:.{digits}f}", f"{sigma:.2g}" if sigma < 1e-4 or sigma >= 1e5 else f"{sigma:.{digits}f}"


def _orbit(orbit: Mapping[str, Any]) -> Table:
    title = f"\nElements, ecliptic of J2000, at {orbit['epoch_tdb']}"
    table = Table(title=title, title_justify="left", title_style="", box=SIMPLE, pad_edge=False)
    for heading, justify in (("", "left"), ("value", "right"), ("1 sigma", "right"), ("", "left")):
        table.add_column(heading, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    for key, label, unit in ELEMENTS if orbit["elements"] is not None else ():
        found = orbit["elements"][key]
        table.add_row(label, *with_sigma(found["value"], found["sigma"]), unit)
    return table


def _state_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    orbit = summary["orbit"]
    yield (
        f"position to {_number(orbit['sigma_position_km'])} km, velocity to {_number(orbit['sigma_velocity_m_s'])} m/s "
        "at that epoch (1 sigma, root trace)"
    )
    true, formal = orbit["sigma_position_km"], orbit["sigma_formal_position_km"]
    if abs(true / formal - 1.0) > 0.01:
        yield f"without what is only considered: {_number(formal)} km; the sigmas above count it"
    shown, rest = foremost(summary["estimators"][0]["parameters"], summary["telescopes"], PARAMETERS_SHOWN)
    for name, row in shown.items():
        known = "" if row["prior_sigma"] is None else f" (before: {_number(row['prior_sigma'])})"
        yield f"  {name}: {row['estimate']:.4g} +- {row['sigma']:.2g}{known}"
    if rest:
        others, nearer = ("other number", ", nearer to zero in its sigmas") if shown else ("number", "")
        yield f"  {counted(len(rest), others)} of stations{nearer} (all in tables/parameters.ecsv)"


def _stations(fit: Mapping[str, Any]) -> Table:
    table = Table(
        title="\nResiduals by station, arcsec", title_justify="left", title_style="", box=SIMPLE, pad_edge=False
    )
    for heading in ("station", "n", "selected", "rms RA*", "rms Dec", "mean RA*", "mean Dec"):
        table.add_column(heading, justify="left" if heading == "station" else "right", no_wrap=True)
    rows = fit["stations"]
    for row in rows[:STATIONS_SHOWN]:
        values = (row[f"{what}_{axis}_arcsec"] for what in ("rms", "mean") for axis in ("ra", "dec"))
        cells = ("-" if value is None else f"{value:.2f}" for value in values)
        table.add_row(row["station"], str(row["n_observations"]), str(row["n_selected"]), *cells)
    if len(rows) > STATIONS_SHOWN:
        rest = rows[STATIONS_SHOWN:]
        table.add_row(
            f"{len(rest)} more", str(sum(r["n_observations"] for r in rest)), str(sum(r["n_selected"] for r in rest)),
            "", "", "", "",
        )  # fmt: skip
    return table


def _rejected(fit: Mapping[str, Any]) -> Iterator[str]:
    rows = sorted(fit["rejected"], key=lambda row: -(row["chi"] or 0.0))
    if rows:
        yield f"Rejected, worst of {len(rows)} first (all in tables/residuals.ecsv)"
    for row in rows[:REJECTED_SHOWN]:
        yield (
            f"  {row['utc'][:19]}  {row['station']:<4} {row['residual_ra_arcsec']:+8.2f} "
            f"{row['residual_dec_arcsec']:+8.2f} arcsec, chi {row['chi'] or float('nan'):.1f}, sigma "
            f"{_pair(row, 'sigma')} of the record, {_pair(row, 'residual_sigma')} of the residual"
            f"  {Path(row['file']).name}:{row['line']}"
        )


def _pair(row: Mapping[str, Any], what: str) -> str:
    """Two numbers of RA* and Dec, one where they are alike."""
    ra, dec = (f"{row[f'{what}_{axis}_arcsec']:.2g}" for axis in ("ra", "dec"))
    return ra if ra == dec else f"{ra}, {dec}"


def _tests(fit: Mapping[str, Any]) -> Iterator[str]:
    """What the score tests found, each a line."""
    forces = [
        f"{row['name']} {row['sigmas_before']:.1f} and {row['sigmas_after']:.1f}" for row in fit["missing_forces"]
    ]
    if forces:
        yield f"Score tests of forces left out, sigmas by all records and by those selected: {'; '.join(forces)}"
    for row in fit["shared_errors"][:SHARED_SHOWN]:
        yield f"Shared error: {row['told']}"
        yield f"  mend it: uncertainty: [{row['settings']}]"
    if len(fit["shared_errors"]) > SHARED_SHOWN:
        more = len(fit["shared_errors"]) - SHARED_SHOWN
        yield f"  and {more} more (all in summary.json; --suggest writes the settings)"


def _budget(summary: Mapping[str, Any]) -> Iterator[str]:
    rows = summary["budget"]
    if not rows:
        return
    parts = condensed(rows, summary["telescopes"], BUDGET_SHOWN)
    width = max(34, *(len(part.source) for part in parts))
    yield "What is to blame for the position sigma amid the arc (all in tables/budget.ecsv)"
    yield f"  {'':<{width}}   share        alone   if no error"
    for part in parts:
        alone, rest = part.sigma("sigma_position_km"), without(rows, part, "sigma_position_km")
        share = 100.0 * part.share("share_position")
        yield f"  {part.source:<{width}} {share:5.1f} % {_number(alone):>9} km  {_number(rest):>9} km"


def _predictions(summary: Mapping[str, Any]) -> Iterator[str]:
    if summary["predictions"]:
        yield "Predictions, 1 sigma"
    for row in answered(summary["predictions"]):
        unit = unit_of(row)
        axes = " x ".join(_number(axis) for axis in row[f"semi_axes_{unit}"])
        where = f"; RA {row['ra_deg']:.6f} Dec {row['dec_deg']:+.6f} deg" if "ra_deg" in row else ""
        where += DOUBT if _doubted(row) else ""
        yield f"  {row['name']} ({row['plane']}): {axes} {unit.replace('_', '/')}{where}"
        if event_words(row):
            yield f"    {event_words(row)}"
    for line in unanswered_sentences(summary["predictions"]):
        yield f"  {line}"


def _doubted(prediction: Mapping[str, Any]) -> bool:
    """Whether the linear ellipse of a prediction misleads, or nobody can tell."""
    return bool(prediction["nonlinearity"]["misleads"] or prediction["nonlinearity"]["reason"])


def _reference(summary: Mapping[str, Any]) -> Iterator[str]:
    row = summary["reference_orbit"]
    if row is None:
        return
    yield (
        f"Against {row['name']}: {_number(row['difference_position_km'])} km apart at {row['epoch_tdb']}, "
        f"chi2 {row['chi2']:.2f} for 6 by this fit's covariance"
        + (f", {row['chi2_by_reference']:.2f} by its own" if row["chi2_by_reference"] is not None else "")
    )


def _number(value: float) -> str:
    """Three significant digits."""
    if not 1e-3 <= abs(value) < 1e5:
        return f"{value:.2e}" if value else "0"
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"


def print_line(summary: Mapping[str, Any], folder: Path, console: Console | None = None) -> None:
    """One line for one object of many."""
    out = console or Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 120)
    fit, orbit = summary["fit"], summary["orbit"]
    sigma = "" if orbit is None else f", position to {_number(orbit['sigma_position_km'])} km"
    likely = max((one["impact_probability_linear"] for one in summary["impacts"]), default=None)
    struck = "" if likely is None else f"; impact probability {chance_words(likely)}"
    warned = f"; warnings: {len(summary['warnings'])}" if summary["warnings"] else ""
    used = f"{fit['n_selected']} of {counted(summary['n_observations'], 'observation')} over {fit['arc']}"
    out.print(
        _plain(
            f"{summary['object']:<14} {fit['status'].replace('_', ' '):<15} {used}, rms {fit['rms_arcsec']:.3f} arcsec"
            f"{sigma}{struck}{warned}; {folder}"
        )
    )
