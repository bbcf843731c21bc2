"""`nebosvod plan ORBIT --decide`: what is asked, and what is said on a terminal."""

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.markup import escape

from nebosvod.commands.plan_answer import table
from nebosvod.commands.risk_answer import asked_bodies, asked_date
from nebosvod.errors import InputError
from nebosvod.impacts.chance import chance_words
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.planning.coming import Watch
from nebosvod.planning.decide import Wanted
from nebosvod.planning.decision import advice, said_chance, said_share
from nebosvod.results.ahead_words import CALLED
from nebosvod.timescale import SECONDS_PER_DAY, Epoch
from nebosvod.units import ANGLE, DURATION, Dimension, quantity

DRAWS = (500, 1_000_000)
TRUTHS = (100, 100_000)
EXPOSURES = 100
SHOWN = ("0.01", "0.1", "0.5", "0.9", "0.99")
STEPS = 20  # candidate times over the schedule of a mission


def decided(path: str, said: Mapping[str, Any]) -> dict[str, Any]:
    """The answer to what a command line asks.

    Raises
    ------
    InputError
        If an option cannot be used; names it.
    """
    from nebosvod.commands.progress import stages
    from nebosvod.dynamics import Ephemeris
    from nebosvod.planning.decide import decide
    from nebosvod.planning.decision import decision_row
    from nebosvod.planning.watches import watches
    from nebosvod.scene.orbit import read_orbit

    if said["until"] is None:
        raise InputError("--until: is needed with --decide: the last date of an impact")
    sigma = None if said["sigma"] is None else _positive("sigma", said["sigma"], ANGLE)
    orbit = read_orbit(path)
    watching = watches(path, orbit, said["telescope"], sigma)
    wanted = _wanted(orbit, watching, said)
    with stages() as progress:
        return decision_row(orbit, wanted, decide(orbit, watching, wanted, Ephemeris.load(), progress))


def _wanted(orbit: UncertainOrbit, watching: list[Watch], said: Mapping[str, Any]) -> Wanted:
    """Every option checked."""
    until = asked_date("until", said["until"])
    first, last = _window(watching, said)
    if last < first:
        raise InputError(f"--to: {last.iso('utc', 0)} is before --from {first.iso('utc', 0)}")
    if not orbit.epoch < last < until:
        raise InputError(
            f"--to: {last.iso('utc', 0)} must be after the epoch of the orbit, {orbit.epoch.iso('utc', 0)}, and before "
            f"--until, {until.iso('utc', 0)}"
        )
    step = _positive("step", said["step"], DURATION) if said["step"] is not None else _usual_step(first, last)
    exposures = _between("exposures", said["exposures"], 1, EXPOSURES)
    spacing = 0.0 if said["spacing"] is None else _positive("spacing", said["spacing"], DURATION)
    if (exposures > 1) != (spacing > 0.0):
        raise InputError('--spacing: goes with --exposures: several of them, and the time to the next, as "1 min"')
    for name in ("below", "above"):
        if said[name] is not None and not 0.0 < said[name] < 1.0:
            raise InputError(f"--{name}: {said[name]:g} is no probability (allowed: between 0 and 1)")
    if said["below"] is not None and said["above"] is not None and not said["below"] < said["above"]:
        raise InputError(f"--below: {said['below']:g} is not below --above, {said['above']:g}")
    return Wanted(
        first=first, last=last, step_s=step, exposures=exposures, spacing_s=spacing, until=until,
        bodies=asked_bodies(said["bodies"]), draws=_between("draws", said["draws"], *DRAWS),
        truths=_between("truths", said["truths"], *TRUTHS), seed=_between("seed", said["seed"], 0, 2**32),
        below=said["below"], above=said["above"],
    )  # fmt: skip


def _window(watching: list[Watch], said: Mapping[str, Any]) -> tuple[Epoch, Epoch]:
    """First and last candidate time: those said, else of the schedule of the mission that the telescopes come from."""
    from nebosvod.mission import Mission

    missions = [one.question for one in watching if isinstance(one.question, Mission)]
    arcs = [arc for mission in missions for arc in mission.schedule]
    found = []
    for option, key, ends in (("from", "start", min), ("to", "end", max)):
        if said[key] is not None:
            found.append(asked_date(option, said[key]))
        elif arcs:
            found.append(ends((arc.start if key == "start" else arc.end for arc in arcs), key=lambda e: e.day))
        else:
            raise InputError(f"--{option}: is needed: no mission says when these telescopes may observe")
    return found[0], found[1]


def _usual_step(first: Epoch, last: Epoch) -> float:
    """A day, or a twentieth of the span if that is longer."""
    return max((last - first) / STEPS, SECONDS_PER_DAY)


def _positive(option: str, text: str, dimension: Dimension) -> float:
    try:
        value = quantity(text, dimension)
    except ValueError as error:
        raise InputError(f"--{option}: {error}") from None
    if not value > 0.0:
        raise InputError(f"--{option}: must be more than 0 (got {text})")
    return value


def _between(option: str, value: int, least: int, most: int) -> int:
    if not least <= value <= most:
        raise InputError(f"--{option}: {value} (allowed: {least} to {most})")
    return value


def print_decision(found: Mapping[str, Any], console: Console | None = None) -> None:
    """Print the probability now, and what each visit may make of it."""
    out = console or Console(highlight=False, soft_wrap=True)
    out.print(f"[bold]{escape(found['title'])}[/bold]")
    bodies = " or ".join(CALLED.get(body, body.capitalize()) for body in found["bodies"])
    out.print(escape(f"P = {chance_words(found['probability'])} to hit {bodies} until {found['until_utc'][:10]}"))
    headings = ("1 %", "10 %", "50 %", "90 %", "99 %", f"P < {found['below']:.2g}", f"P > {found['above']:.2g}")
    rows = table(
        "Probability after one visit: quantiles, and chances",
        ("telescope", f"UTC, {found['visits'][0]['epoch_utc'][:4]}"),
        headings,
    )
    for row in found["visits"]:
        quantiles = [said_chance(row["quantiles"][level], row["bound"]) for level in SHOWN]
        chances = [said_share(row[name]) for name in ("chance_below", "chance_above")]
        when = row["epoch_utc"][5:16].replace("T", " ")
        rows.add_row(escape(row["telescope"]), when, *quantiles, *chances)
    out.print(rows)
    out.print(escape(advice(found)))
    for name in found["never_visible"]:
        out.print(escape(f"{name} never sees it at these times"))
    for warning in found["warnings"]:
        out.print(f"warning: {escape(warning)}")
