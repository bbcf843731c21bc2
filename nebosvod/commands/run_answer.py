"""The short answer of a run on a terminal: what was seen, how well the orbit and the predictions are known, and why."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from nebosvod.commands.diagnosis_answer import diagnosis_lines
from nebosvod.errors import counted
from nebosvod.report.kit.facts import earlier_orbit, grouped
from nebosvod.results.outlook import answered, event_words, impact_sentences, unanswered_sentences, unit_of
from nebosvod.timescale import Epoch

BUDGET_ROWS = 6
SHIFTED = 3  # predictions whose shifts are shown; summary.json has all
BLAMED = 3  # kinds of source named behind each prediction
BASIS = {True: " and a prior orbit", False: ", no earlier orbit used", None: ""}
SEEN = 0.01  # of a sigma, from which a mean error is told
AGREE = 0.01  # formal and true sigmas that differ by less are called equal
UNITS = {"m_s": "m/s", "km2_s2": "km^2/s^2", "deg_d": "deg/d", "1": ""}  # as read, where the key cannot say it
MEANING = "true = what the error really is under the mission's error model; formal = what the estimator reports"


def print_answer(summary: Mapping[str, Any], folder: Path, console: Console | None = None) -> None:
    """Print what a reader wants first, and where the report is."""
    out = console or _console()
    out.print(f"[bold]{_plain(summary['title'])}[/bold]")
    for line in _seen(summary):
        out.print(_plain(line))
    for line in impact_sentences(summary):
        out.print(_plain(line), style="bold")
    out.print(_estimators(summary))
    out.print(_plain(MEANING))
    for line in _predictions(summary):
        out.print(_plain(line))
    if summary["budget"]:
        out.print(_blamed(summary))
    if summary.get("shifts"):
        out.print(_shifts(summary))
    for line in (*_trials(summary), *diagnosis_lines(summary), *_cautions(summary)):
        out.print(_plain(line))
    out.print(f"report: {_plain(str(folder / 'report.html'))}")


def _console() -> Console:
    """The terminal as it is; a pipe or file gets lines as long as they need, without colour."""
    return Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 120)


def _plain(text: str) -> str:
    """Text in which rich sees no markup."""
    return text.replace("[", r"\[")


def _table(title: str, left: tuple[str, ...], right: tuple[str, ...]) -> Table:
    table = Table(title=title, title_justify="left", title_style="", box=SIMPLE, pad_edge=False)
    for heading in left:
        table.add_column(heading, no_wrap=True)
    for heading in right:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def _number(value: float | None) -> str:
    """Three significant digits in full up to 99 999, then with a power of ten; a dash where there is no number."""
    if value is None:
        return "-"
    if not 1e-3 <= abs(value) < 1e5:
        return f"{value:.2e}" if value else "0"
    text = f"{value:.3g}"
    return f"{value:.0f}" if "e" in text else f"{value:#.3g}".rstrip(".")


def _seen(summary: Mapping[str, Any]) -> Iterator[str]:
    """How many measurements, and for each telescope that lost some, to which limit."""
    used = earlier_orbit(summary, summary["estimators"][0]["name"]) if summary["estimators"] else None
    seen = counted(summary["n_observations"], "measurement") + BASIS[used]
    yield f"{seen}; reference epoch {_reference_epoch(summary)}"
    for row in summary["visibility"]:
        lost = row["candidates"] - row["visible"]
        if lost:
            reasons = ", ".join(f"{reason} {count}" for reason, count in row["removed"].items())
            yield f"{row['telescope']}: {lost} of {row['candidates']} scheduled epochs not seen ({reasons})"


def _reference_epoch(summary: Mapping[str, Any]) -> str:
    """As the mission states it."""
    return Epoch.parse(summary["reference_epoch_tdb"]).iso(summary.get("time_scale", "tdb"))


def _estimators(summary: Mapping[str, Any]) -> Table:
    table = _table(
        "Position (km) and velocity (m/s) at the reference epoch, 1 sigma (root trace)",
        ("estimator", "status"),
        ("true km", "formal km", "true m/s"),
    )
    for row in summary["estimators"]:
        sigmas = (row["sigma_position_km"], row["sigma_formal_position_km"], row["sigma_velocity_m_s"])
        table.add_row(_plain(row["name"]), row["status"], *(_number(sigma) for sigma in sigmas))
    return table


def _predictions(summary: Mapping[str, Any]) -> Iterator[str]:
    """Predictions of the first estimator, each with the kinds of source behind its variance."""
    if not summary["predictions"]:
        return
    first = summary["predictions"][0]["estimator"]
    yield f"\nPredictions of {first}, 1 sigma, and the shares of their variance"
    for row in answered(summary["predictions"]):
        if row["estimator"] != first:
            continue
        unit = unit_of(row)
        axes = " x ".join(_number(axis) for axis in row[f"semi_axes_{unit}"])
        shares = [(part["source"], part["share_total"]) for part in row["budget"]]
        kinds = grouped(shares, summary["telescopes"])[:BLAMED]
        blame = ", ".join(f"{kind} {_percent(share)}" for kind, share, _ in kinds)
        yield f"  {row['name']} ({row['plane']}): {axes} {UNITS.get(unit, unit)}; {blame}"
        if event_words(row):
            yield f"    {event_words(row)}"
        mean, far = row.get(f"mean_error_{unit}") or [], row[f"max_deviation_{unit}"]
        if any(abs(one) > SEEN * sigma for one, sigma in zip(mean, row[f"sigma_{unit}"])):
            yield f"    off on average by {_each(mean, unit)}, so at most by {_each(far, unit)} (|mean| + 3 sigma)"
    for line in unanswered_sentences(summary["predictions"]):
        yield f"  {line}"


def _each(values: Sequence[float], unit: str) -> str:
    """Components in brackets, with their unit."""
    return f"({', '.join(_number(value) for value in values)}) {UNITS.get(unit, unit)}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 0.095 else f"{100.0 * share:.1f} %"


def _blamed(summary: Mapping[str, Any]) -> Table:
    """What is to blame for the first prediction; for the position at the reference epoch where nothing is predicted."""
    first = summary["budget"][0]["estimator"]
    told = [row for row in answered(summary["predictions"]) if row["estimator"] == first and row["budget"]]
    if told:
        return _budget_of(told[0], first)
    rows = sorted(
        (row for row in summary["budget"] if row["estimator"] == first), key=lambda row: -row["share_position"]
    )
    title = f"\nWhat is to blame for the position sigma of {_plain(first)} at the reference epoch"
    table = _table(title, ("source",), ("share", "position, km", "velocity, m/s"))
    for row in rows[:BUDGET_ROWS]:
        sigmas = (row["sigma_position_km"], row["sigma_velocity_m_s"])
        table.add_row(_plain(row["source"]), _percent(row["share_position"]), *(_number(sigma) for sigma in sigmas))
    return table


def _budget_of(prediction: Mapping[str, Any], estimator: str) -> Table:
    """Each source of one prediction: its share, its own sigma, and what would be left without its error."""
    key = f"sigma_total_{unit_of(prediction)}"
    unit = UNITS.get(unit_of(prediction), unit_of(prediction))
    after = f", {unit}" if unit else ""
    total = sum(sigma * sigma for sigma in prediction[f"sigma_{unit_of(prediction)}"]) ** 0.5
    name = f"{prediction['name']} ({prediction['plane']})"
    title = (
        f"\nWhat is to blame for {_plain(name)} by {_plain(estimator)}: total sigma {_number(total)} {unit}".rstrip()
    )
    table = _table(title, ("source",), ("share", f"its sigma{after}", f"total without it{after}"))
    larger = False
    for row in sorted(prediction["budget"], key=lambda row: -row["share_total"])[:BUDGET_ROWS]:
        left = (row.get("if_vanished") or {}).get(f"{key}_new_gain")
        table.add_row(_plain(row["source"]), _percent(row["share_total"]), _number(row.get(key)), _number(left))
        larger = larger or (left is not None and left > 1.01 * total)
    if larger:
        table.caption = (
            "larger without it: the estimator leaves other errors out of its weights and, told that this one is gone, "
            "would trust those measurements too much"
        )
        table.caption_justify, table.caption_style = "left", ""
    return table


def _shifts(summary: Mapping[str, Any]) -> Table:
    """What is off on average, and how far it moves the first estimate and its predictions."""
    first = summary["shifts"][0]["estimator"]
    rows = [row for row in summary["shifts"] if row["estimator"] == first]
    table = _table(
        f"\nShift of {_plain(first)} by each source that is off on average (its sigmas are about it)",
        ("source",),
        ("position, km", "in sigmas", *(_plain(part["prediction"]) for part in rows[0]["predictions"][:SHIFTED])),
    )
    for row in rows:
        moved = sum(x * x for x in row["shift_position_km"]) ** 0.5
        parts = []
        for part in row["predictions"][:SHIFTED]:
            unit = next(key.removeprefix("shift_") for key in part if key.startswith("shift_"))
            length = sum(x * x for x in part[f"shift_{unit}"]) ** 0.5
            parts.append(f"{_number(length)} {UNITS.get(unit, unit)}")
        table.add_row(_plain(row["source"]), _number(moved), _number(row["in_sigmas"]), *parts)
    return table


def _trials(summary: Mapping[str, Any]) -> Iterator[str]:
    """What Monte Carlo said of each estimator, where it was asked for."""
    for row in summary.get("consistency", {}).get("by_estimator", ()):
        low, high = row["nees_interval_99"]
        verdict = "inside" if low <= row["nees_mean"] <= high else "OUTSIDE"
        how = ", estimates iterated" * bool(row.get("iterated")) + f", {row['n_failed']} lost" * bool(
            row.get("n_failed")
        )
        yield (
            f"Monte Carlo, {row['estimator']}: {row['n_runs']} runs{how}, mean NEES/6 {row['nees_mean']:.3f}, "
            f"{verdict} its 99 % interval {low:.3f} to {high:.3f}"
        )


def _cautions(summary: Mapping[str, Any]) -> Iterator[str]:
    """Warnings of the run, and every estimator whose own sigma is not the true one."""
    for row in summary["estimators"]:
        true, formal = row["sigma_position_km"], row["sigma_formal_position_km"]
        if true is not None and formal is not None and abs(true / formal - 1.0) > AGREE:
            yield (
                f"caution: {row['name']} reports {_number(formal)} km where the true sigma is {_number(true)} km, "
                f"{true / formal:.2f} times as large{'' if true > formal else ': its own sigma is too large'}"
            )
    for warning in summary["warnings"]:
        yield f"warning: {warning}"
