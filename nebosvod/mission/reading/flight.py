"""How far an orbit flies in a mission, by two bodies alone: where it starts, and how often it goes round the Sun."""

import math
from collections.abc import Iterator

from nebosvod.mission.fields import KeyPath
from nebosvod.mission.fit import FitMission
from nebosvod.mission.model import Mission
from nebosvod.mission.spacecraft import SUN_RADIUS_KM
from nebosvod.mission.target import Orbit

GM_SUN_KM3_S2 = 1.32712440041e11  # of DE440
MOST_STEPS = 13_000  # of one flight, as of `nebosvod.dynamics.impact`, which is not loaded for a number
STEPS_EACH = 17.2  # to a revolution, on a circle; more on an ellipse
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


def flights_s(mission: Mission) -> tuple[float, float]:
    """How long the orbit is flown: from its epoch to the reference epoch, and over all that is asked for."""
    from nebosvod.mission.reading.rules import ephemeris_span

    asked = [epoch for path, epoch in mission.epochs() if path != ("object", "orbit", "epoch")]
    first, last = ephemeris_span(mission.force_model.asteroids)
    asked += [min(max(prediction.when, first), last) for prediction in mission.predictions]
    asked = asked or [mission.reference_epoch]
    return abs(mission.reference_epoch - mission.object.orbit.epoch), max(asked) - min(asked)


def steps(mission: Mission) -> float:
    """About how many steps of the integration the longer flight takes, from its revolutions and the longest step."""
    flown, around = flown_s(mission)
    return max(STEPS_EACH * around, flown / LARGEST_STEP_S)


def flown_s(mission: Mission) -> tuple[float, float]:
    """How long the longer flight is, and how many revolutions it makes; an orbit into the Sun makes one at most."""
    q, a = size_km(mission.object.orbit)
    period = 2.0 * math.pi * math.sqrt(a / GM_SUN_KM3_S2) * a
    flown = max(flights_s(mission))
    flown = flown if q >= SUN_RADIUS_KM else min(flown, period)
    return flown, flown / period


def complaints(mission: Mission) -> Iterator[tuple[KeyPath, str]]:
    """The orbit starts above the Sun, and does not go round it more often than can be flown."""
    if isinstance(mission, FitMission) and mission.object.given_orbit is None:
        return
    place: KeyPath = ("object", "orbit")
    if size_km(mission.object.orbit)[0] < SUN_RADIUS_KM and (r := _distance_km(mission)) < SUN_RADIUS_KM:
        text = f"starts inside the Sun (got {r:.6g} km from its centre; allowed from {SUN_RADIUS_KM:.0f} km)"
        yield place, f"{text}; check the units of its elements and its epoch"
    elif not isinstance(mission, FitMission) and (count := steps(mission)) > MOST_STEPS:
        flown, around = flown_s(mission)
        often = f"goes round the Sun {around:,.0f} times"
        how = often if STEPS_EACH * around == count else f"is flown over {flown / YEAR_S:,.0f} years"
        text = f"{how} between the epochs of the mission, some {count:,.0f} steps of"
        yield (
            place,
            f"{text} the integration (allowed {MOST_STEPS:,}); bring its epoch, the schedule and the predictions "
            "nearer to each other",
        )


def _distance_km(mission: Mission) -> float:
    """From the centre of the Sun at the epoch of the orbit."""
    from nebosvod.mission.state import orbit_state  # loads the stages, for an orbit that dives into the Sun only

    return math.hypot(*orbit_state(mission, GM_SUN_KM3_S2)[:3].tolist())
