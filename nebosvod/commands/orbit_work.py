"""What `ephemeris`, `approaches` and `risk` do with an orbit: options as typed in, an answer and its folder out."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from nebosvod.commands.ephemeris_answer import asked_dates
from nebosvod.commands.risk_answer import asked_bodies, asked_date, asked_size
from nebosvod.commands.risk_corrected import corrected_line
from nebosvod.commands.risk_history import NIGHTLY, records_of, told
from nebosvod.dynamics import Ephemeris
from nebosvod.ephemerides.observers import observer
from nebosvod.ephemerides.sky import sky, times
from nebosvod.errors import InputError
from nebosvod.impacts.approaches import approaches
from nebosvod.impacts.risk import risk
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.results import approaches_folder, ephemeris_folder, risk_folder
from nebosvod.results.result import Result
from nebosvod.scene.orbit import read_orbit
from nebosvod.units import AU_KM, DURATION, LENGTH, quantity

Say = Callable[[str], None]
Coordinates = Literal["cartesian", "equinoctial"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Made:
    """An answer: its summary, and the result that a folder holds."""

    summary: dict[str, Any]
    result: Result


def ephemeris_of(orbit: str | UncertainOrbit, since: str, until: str, step: str, site: str) -> Made:
    """Where an orbit is seen.

    Raises
    ------
    InputError
        If an option cannot be used; names it.
    """
    started = time.time()
    first, last = asked_dates(since, until)
    step_s = _said("step", step, DURATION)
    t_s = times(first, last, step_s)
    given, who, bodies = _opened(orbit), observer(site), Ephemeris.load()
    found = sky(given, who, first, t_s, bodies)
    summary = ephemeris_folder.summarise(given, found, step_s)
    result = ephemeris_folder.ephemeris_result(summary, found, bodies, _named(orbit), started)
    return Made(summary=summary, result=result)


def approaches_of(orbit: str | UncertainOrbit, since: str, until: str, within: str, say: Say) -> Made:
    """What an orbit comes near to.

    Raises
    ------
    InputError
        If an option cannot be used; names it.
    """
    started = time.time()
    first, last = asked_dates(since, until)
    within_au = _said("within", within, LENGTH) / AU_KM
    given, bodies = _opened(orbit), Ephemeris.load()
    say("flying the orbit and looking for approaches")
    found = approaches(given, first, last, within_au, bodies)
    summary = approaches_folder.summarise(given, found, first, last, within_au)
    return Made(
        summary=summary,
        result=approaches_folder.approaches_result(summary, found, bodies, _named(orbit), started),
    )


def risk_of(
    orbit: str | UncertainOrbit, until: str, bodies: str, on: str | None, draws: int, coordinates: Coordinates,
    diameter: str | None, density: float | None, seed: int, history: bool, say: Say,
) -> Made:  # fmt: skip
    """How probable it is that an orbit hits.

    Raises
    ------
    InputError
        If an option cannot be used; names it.
    """
    started = time.time()
    last, targets = asked_date("until", until), asked_bodies(bodies)
    since = None if on is None else asked_date("on", on)
    if not 1 <= draws <= 10_000_000:
        raise InputError(f"--draws: {draws} (allowed: 1 to 10000000)")
    if seed < 0:
        raise InputError(f"--seed: {seed} (allowed: 0 or more)")
    recorded = records_of(_named(orbit)) if history else None
    given, ephemeris = _opened(orbit), Ephemeris.load()
    size = asked_size(given.magnitude, diameter, density)
    found = risk(
        given, last, ephemeris, bodies=targets, on=since, draws=draws, seed=seed, coordinates=coordinates,
        diameter_km=None if size is None else size.diameter_km,
        corrected=corrected_line(_named(orbit), given, ephemeris, say), say=say,
    )  # fmt: skip
    summary = risk_folder.summarise(found, targets, seed, size)
    if recorded is not None:
        summary |= told(recorded, found, summary, ephemeris, min(draws, NIGHTLY), seed, say)
    return Made(summary=summary, result=risk_folder.risk_result(summary, found, ephemeris, _named(orbit), started))


def _said(option: str, text: str, dimension: Any) -> float:
    try:
        return quantity(text, dimension)
    except InputError as error:
        raise InputError(f"--{option}: {error}") from None


def _opened(orbit: str | UncertainOrbit) -> UncertainOrbit:
    return orbit if isinstance(orbit, UncertainOrbit) else read_orbit(orbit)


def _named(orbit: str | UncertainOrbit) -> str:
    return orbit.name if isinstance(orbit, UncertainOrbit) else orbit
