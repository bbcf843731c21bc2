"""What `nebosvod study` says on the terminal."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from nebosvod.errors import counted
from nebosvod.report.study_population import before_words
from nebosvod.studies.axes import Axis
from nebosvod.studies.question import Study
from nebosvod.studies.requirement import words
from nebosvod.studies.sampling import Points
from nebosvod.studies.study import evaluate_row, plan, require_possible


def print_check(study: Study, workers: int) -> None:
    """What a study means, and what it will cost."""
    require_possible(study, workers)
    click.echo(f"{study.title}: mission {study.mission.name}")
    for axis in study.axes:
        where = f" {', '.join(axis.paths)}:" if axis.paths else ""
        click.echo(f"  vary {axis.name}:{where} {_values(axis, study.points)}")
    click.echo(f"  {_how(study)}")
    status, message, found = evaluate_row(study, 0)
    for asked, value in zip(study.answers, found):
        said = "shares of every source" if asked.shares else f"{_number(value)} {asked.unit}".strip()
        click.echo(f"  answer {asked.name}: {asked.of}: {said if status != 'failed' else 'none'} at the first point")
    if message:
        click.echo(f"notice: the first point: {message}", err=True)
    click.echo(f"cost: {plan(study, workers).words()} with {counted(workers, 'worker')}")


def _how(study: Study) -> str:
    sample, drawn = study.sample, f", each drawn {counted(study.drawn, 'time')}" if study.drawn else ""
    if sample.method == "grid":
        return f"grid of {counted(study.points.count, 'point')}{drawn}"
    if sample.method == "sobol":
        return (
            f"Sobol sample of {sample.n:,} base points, {counted(study.points.count, 'point')} for sensitivity indices"
            f"{drawn}"
        )
    return f"Latin hypercube of {counted(study.points.count, 'point')}{drawn}"


def _values(axis: Axis, points: Points) -> str:
    if not axis.is_range:
        shown = list(axis.texts) or [str(value) for value in axis.values]
        return ", ".join(shown) if len(shown) <= 8 else f"{', '.join(shown[:3])} ... {shown[-1]} ({len(shown)})"
    how = "in the logarithm" if axis.log else "evenly"
    steps = f"{axis.steps} values" if points.sample.method == "grid" else "sampled"
    return f"{axis.low:.6g} to {axis.high:.6g} {axis.unit}, {steps} {how}"


def print_study(found: Mapping[str, Any], folder: Path) -> None:
    """What a study found."""
    click.echo(f"{found['title']}: {counted(found['n_points'], 'point')} of mission {found['mission']['name']}")
    for one in found["answers"]:
        if one["shares"]:
            said = ", ".join(f"{name} at {count}" for name, count in list(one["leading"].items())[:4])
            click.echo(f"  {one['name']}: largest share: {said or 'none'}")
        elif one["n"]:
            low, middle, high = (_number(one[key]) for key in ("least", "median", "largest"))
            click.echo(f"  {one['name']}: {low} to {high} {one['unit']}".rstrip() + f", median {middle}")
        else:
            click.echo(f"  {one['name']}: no value at any point")
    for one in found["slopes"]:
        click.echo(
            f"  slope of {one['answer']}: {one['at_least']:+.2f} at the low end, {one['at_largest']:+.2f} at the high"
        )
    for one in found["sensitivity"]:
        ranked = sorted(one["indices"], key=lambda row: -row["total"])
        said = ", ".join(f"{row['name']} {row['first_order']:.2f} (total {row['total']:.2f})" for row in ranked)
        click.echo(f"  {one['answer']} is moved by: {said or 'nothing that can be told'}")
    for one in found["seen"]:
        low, high = one["interval_95"]
        where = ", ".join(f"{name} {_number(value)}" for name, value in one["where"].items())
        click.echo(
            f"  seen at all: {one['n_seen']} of {counted(one['n'], 'object')}, {100 * one['share']:.3g} % "
            f"(95 %: {100 * low:.3g} to {100 * high:.3g} %){f'; {where}' if where else ''}"
        )
    if found.get("population"):
        _print_population(found["population"])
    for one in found.get("paired", []):
        click.echo(f"  {paired_words(one)}")
    if found["find"]:
        click.echo(f"found: {found_words(found)}")
    if found["require"]:
        unit = next(one["unit"] for one in found["answers"] if one["name"] == found["require"]["answer"])
        for line in words(found["require"], unit):
            click.echo(line)
    lost = found["n_failed"] + found["n_without_answer"]
    if lost:
        click.echo(f"{counted(lost, 'point')} of {found['n_rows']} failed or have no answer, such as:", err=True)
        for one in found["failures"][:3]:
            click.echo(f"  row {one['row']}: {one['message']}", err=True)
    click.echo(f"page: {folder / 'study.html'}")


def _print_population(own: Mapping[str, Any]) -> None:
    """Of drawn impactors: what is seen, who is warned of, how often for nothing."""
    click.echo(f"  {counted(own['n_impactors'], 'impactor')}, {own['n_misses']} near misses")
    for one in own["seen"]:
        click.echo(f"  seen at all, {one['group']}: {one['k']} of {one['n']}, {_share_words(one)}{_where_words(one)}")
    for one in own["warned"]:
        false = one["false_per_impactor"]
        said = ""
        if false is not None:
            low, high = (f"{value:.2g}" for value in false["interval_95"])
            said = f"; false warnings for each impactor: {false['value']:.2g} ({low} to {high})"
        when = before_words(one["before_d"])
        click.echo(f"  warned of, {when}: {_share_words(one['impactors'])}{said}{_where_words(one)}")


def _share_words(one: Mapping[str, Any]) -> str:
    if one["share"] is None:
        return "none"
    low, high = one["interval_95"]
    return f"{100 * one['share']:.3g} % (95 %: {100 * low:.3g} to {100 * high:.3g} %)"


def _where_words(one: Mapping[str, Any]) -> str:
    said = ", ".join(f"{name} {_number(value)}" for name, value in one["where"].items())
    return f"; {said}" if said else ""


def paired_words(one: Mapping[str, Any]) -> str:
    """What one setting sees of the same objects beside the first one."""
    here, first = (", ".join(f"{name} {_number(value)}" for name, value in one[k].items()) for k in ("where", "than"))
    low, high = (f"{100 * value:+.2g}" for value in one["interval_95"])
    return (
        f"{here} beside {first}, the same {counted(one['n'], 'object')}: {one['only_here']} seen only here, "
        f"{one['only_first']} only there; {100 * one['difference']:+.2g} % (95 %: {low} to {high} %), p {one['p']:.2g}"
    )


def found_words(found: Mapping[str, Any]) -> str:
    """The point that is looked for, in a sentence."""
    find = found["find"]
    if not find["found"]:
        return f"no point keeps every condition: {find['reason']}"
    units = {one["name"]: one["unit"] for one in (*found["vary"], *found["answers"])}
    shown = [f"{name} {_number(value)} {units.get(name, '')}".strip() for name, value in find["values"].items()]
    what = "least" if find["direction"] == "minimise" else "largest"
    return f"{what} {find['objective']} of {counted(find['n_feasible'], 'point')} that will do: {', '.join(shown)}"


def print_studies(found: Mapping[str, Any]) -> None:
    """Studies side by side."""
    for number, one in enumerate(found["studies"], start=1):
        points = counted(one["n_points"], "point")
        click.echo(f"{number}: {one['title']}, {points} of {one['mission']['name']} ({one['folder']})")
        if one["find"] and one["find"]["found"]:
            values = ", ".join(f"{name} {_number(value)}" for name, value in one["find"]["values"].items())
            click.echo(f"   found: {values}")
    for row in found["answers"]:
        for number, cell in enumerate(row["studies"], start=1):
            ends = f"{_number(cell['least'])} to {_number(cell['largest'])} {cell['unit']}".strip()
            ratio = cell["to_first"]
            beside = "" if number == 1 or ratio is None else (
                f"; {_number(ratio['median'])} times the first at {counted(ratio['n'], 'point')} "
                f"({_number(ratio['least'])} to {_number(ratio['largest'])})"
            )  # fmt: skip
            click.echo(f"  {row['name']}, {number}: {ends}, median {_number(cell['median'])}{beside}")
    for warning in found["warnings"]:
        click.echo(f"notice: {warning}", err=True)


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float | int) else str(value)
