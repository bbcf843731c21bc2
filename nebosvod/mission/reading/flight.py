"""How far an orbit flies in a mission, by two bodies alone: where it starts, and how often it goes round the Sun."""

import math
from collections.abc import Iterator

from nebosvod.dynamics.constants import RADIUS_KM
from nebosvod.mission.fields import KeyPath
from nebosvod.mission.fit import FitMission
from nebosvod.mission.question import Question
from nebosvod.mission.target import Orbit

GM_SUN_KM3_S2 = 1.32712440041e11  # of DE440
MOST_STEPS = 13_000  # of one flight, as of `nebosvod.dynamics.impact`, which is not loaded for a number
STEPS_EACH = 17.2  # to a revolution, on a circle; more on an ellipse
CALLED = {"sun": "the Sun", "earth": "the Earth", "moon": "the Moon"}
YEAR_S = 365.25 * 86400.0
LARGEST_STEP_S = 20.0 * 86400.0  # as of `nebosvod.dynamics.integrator`: far from the Sun steps are no longer


def size_km(orbit: Orbit) -> tuple[float, float]:
    """Perihelion distance and semi-major axis, the latter infinite where the orbit does not return."""
    elements = orbit.elements
    if orbit.representation == "cometary":
        e, q = elements[:2]
        return q, q / (1.0 - e) if e < 1.0 else math.inf
    if orbit.representation == "keplerian":
        return elements[0] * (1.0 - elements[1]), elements[0]
    if orbit.representation == "equinoctial":
        return elements[0] * (1.0 - math.hypot(elements[1], elements[2])), elements[0]
    position, velocity = elements[:3], elements[3:]
    r, speed = math.hypot(*position), math.hypot(*velocity)
    radial = sum(x * v for x, v in zip(position, velocity)) / r
    inverse = 2.0 / r - speed * speed / GM_SUN_KM3_S2
    p = r * r * max(speed * speed - radial * radial, 0.0) / GM_SUN_KM3_S2
    e = math.sqrt(max(1.0 - p * inverse, 0.0))
    return p / (1.0 + e), 1.0 / inverse if inverse > 0.0 else math.inf


def flights_s(mission: Question) -> tuple[float, float]:
    """How long the orbit is flown: from its epoch to the reference epoch, and over all that can be answered."""
    from nebosvod.mission.reading.rules import ephemeris_span

    asked = [epoch for path, epoch in mission.epochs() if path != ("object", "orbit", "epoch")]
    first, last = ephemeris_span(mission.force_model.asteroids)
    asked += [prediction.when for prediction in mission.predictions if first <= prediction.when <= last]
    asked = asked or [mission.reference_epoch]
    return abs(mission.reference_epoch - mission.orbit.epoch), max(asked) - min(asked)


def steps(mission: Question) -> float:
    """About how many steps of the integration the longer flight takes."""
    return steps_over(mission.orbit, max(flights_s(mission)))


def steps_over(orbit: Orbit, flown_s: float) -> float:
    """About how many steps a flight takes, from its revolutions and the longest step."""
    flown, around = _flown(orbit, flown_s)
    return max(STEPS_EACH * around, flown / LARGEST_STEP_S)


def _flown(orbit: Orbit, flown_s: float) -> tuple[float, float]:
    """How long a flight is, and how many revolutions it makes; an orbit into the Sun makes one at most."""
    q, a = size_km(orbit)
    period = 2.0 * math.pi * math.sqrt(a / GM_SUN_KM3_S2) * a
    flown = flown_s if q >= RADIUS_KM["sun"] else min(flown_s, period)
    return flown, flown / period


def too_often(orbit: Orbit, flown_s: float, between: str) -> str:
    """Why a flight takes more steps than may be, in words; empty where it does not."""
    count = steps_over(orbit, flown_s)
    if count <= MOST_STEPS:
        return ""
    flown, around = _flown(orbit, flown_s)
    often = f"goes round the Sun {around:,.0f} times"
    how = often if STEPS_EACH * around == count else f"is flown over {flown / YEAR_S:,.0f} years"
    return f"{how} between {between}, some {count:,.0f} steps of the integration (allowed {MOST_STEPS:,})"


def complaints(mission: Question) -> Iterator[tuple[KeyPath, str]]:
    """Orbits start outside of all bodies, and do not go round the Sun more often than can be flown."""
    inside = [(place, text) for place, orbit in mission.given_orbits.items() if (text := _inside(orbit))]
    yield from inside
    if inside or isinstance(mission, FitMission):
        return
    if text := too_often(mission.orbit, max(flights_s(mission)), "the epochs of the mission"):
        yield ("object", "orbit"), f"{text}; bring its epoch, the schedule and the predictions nearer to each other"


def _inside(orbit: Orbit) -> str:
    """In which body an orbit starts, in words; empty where in none."""
    from nebosvod.mission.state import body_around_start  # loads the stages, but not their compiler

    found = body_around_start(orbit)
    if found is None:
        return ""
    body, r = found
    return (
        f"starts inside {CALLED.get(body, body.capitalize())} (got {r:.6g} km from its centre; allowed from "
        f"{RADIUS_KM[body]:.0f} km); check the units of its elements and its epoch"
    )
