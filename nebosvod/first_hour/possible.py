"""Whether a telescope can see the drawn orbits: horizon, twilight, Sun, Earth, Moon, and its own limits.

What is judged, and how, is `nebosvod.observation.measurement.visibility`. An observatory whose limits nobody has said
stops at nautical twilight, as a telescope of a mission does, and at 10 deg above the horizon.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.errors import CoverageError
from nebosvod.first_hour.falls import Falls
from nebosvod.first_hour.region import SLOPE, magnitudes_of
from nebosvod.first_hour.sight import lines, until
from nebosvod.first_hour.tangent import angles
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.mission.telescope import NAUTICAL_TWILIGHT
from nebosvod.observation import GroundSite, Telescope
from nebosvod.observation.measurement.direction import angle_between
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.observation.measurement.photometry import apparent_magnitude
from nebosvod.observation.measurement.sight import Sight
from nebosvod.observation.measurement.visibility import visibility_along
from nebosvod.timescale import Epoch
from nebosvod.units import DEG

Array = npt.NDArray[np.float64]
LOWEST = 10.0 * DEG  # rad, 5.6 air masses
SUNSET = -0.833 * DEG  # rad, of the Sun's centre
FORWARD_S, STEP_S = 3.0 * 86400.0, 900.0  # how far, and how finely, the next time is looked for
FEW = 16  # orbits that are flown for it
WORDS = {
    "duty": "off duty", "sun": "angle to the Sun", "earth": "behind or beside the Earth",
    "moon": "behind or beside the Moon", "magnitude": "too faint",
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Possible:
    """Whether one telescope can look in one direction at one time.

    Attributes
    ----------
    altitude_rad, sun_altitude_rad : above the horizon of a site, without refraction; None of other observers.
    elongation_rad : from the Sun's centre.
    visible : None of the Earth's centre, where nobody stands.
    reasons : every reason why not, in words.
    """

    altitude_rad: float | None
    sun_altitude_rad: float | None
    elongation_rad: float
    visible: bool | None
    reasons: tuple[str, ...]


def possible(
    telescope: Telescope, seen: Exposures, u: Array, distance_km: Array, velocity: Array, ephemeris: Ephemeris,
    magnitude: tuple[float, float] | None = None,
) -> list[Possible]:  # fmt: skip
    """Of each exposure (n,) of a telescope.

    Parameters
    ----------
    u, distance_km, velocity : (n, 3), (n,) and (n, 3) direction and distance of the object, its heliocentric velocity.
    magnitude : H and G.
    """
    site = telescope.spacecraft
    has_horizon = isinstance(site, GroundSite) and site.has_horizon
    somewhere = has_horizon or not isinstance(site, GroundSite)
    place = seen.observer[:, :3] + distance_km[:, None] * u
    target = np.hstack([place, velocity + seen.sun[:, 3:]])
    line = Sight(
        t_s=seen.t_s, telescope_state=seen.observer, target_state=target, heliocentric_state=target - seen.sun, u=u,
        distance_km=distance_km, light_time_s=distance_km / SPEED_OF_LIGHT_KM_S, psi=angles(u),
    )  # fmt: skip
    facts = visibility_along(_limited(telescope) if has_horizon else telescope, seen.epoch, line, ephemeris, magnitude)
    found = []
    for k in range(len(u)):
        altitude, sun = float(facts.altitude_rad[k]), float(facts.sun_altitude_rad[k])
        limits = [limit for limit, mask in facts.removed.items() if mask[k] and not (has_horizon and limit == "earth")]
        found.append(Possible(
            altitude_rad=altitude if has_horizon else None,
            sun_altitude_rad=sun if has_horizon else None,
            elongation_rad=float(facts.sun_angle_rad[k]),
            visible=not limits if somewhere else None,
            reasons=tuple(_word(limit, altitude, sun) for limit in limits) if somewhere else (),
        ))  # fmt: skip
    return found


def _limited(telescope: Telescope) -> Telescope:
    """With limits where a site has none."""
    sun, least = telescope.sun_altitude_rad, telescope.altitude_rad
    return replace(
        telescope,
        sun_altitude_rad=NAUTICAL_TWILIGHT if sun is None else sun,
        altitude_rad=LOWEST if least is None else least,
    )


def _word(limit: str, altitude: float, sun: float) -> str:
    if limit == "twilight":
        return "daylight" if sun > SUNSET else "twilight"
    if limit == "altitude":
        return "below the horizon" if altitude < 0.0 else "too low"
    return WORDS[limit]


def of_mean(
    telescope: Telescope, seen: Exposures, line: Array, velocity: Array, ephemeris: Ephemeris, V: float | None
) -> Possible:
    """Of the mean of lines of sight (m, 3), km, to orbits with heliocentric velocities (m, 3), in one exposure."""
    u, d = _middle(line)
    magnitude = None
    if V is not None and telescope.limiting_magnitude is not None:
        place = seen.observer[0, :3] - seen.sun[0, :3] + d * u
        phase = angle_between(-place[None], -u[None])
        bare = apparent_magnitude(0.0, SLOPE, np.linalg.norm(place[None], axis=1), np.array([d]), phase)
        magnitude = (V - float(bare[0]), SLOPE)
    (found,) = possible(telescope, seen, u[None], np.array([d]), velocity.mean(axis=0)[None], ephemeris, magnitude)
    return found


def _middle(line: Array) -> tuple[Array, float]:
    """Mean direction (3,) and median distance of lines (m, 3)."""
    d = np.linalg.norm(line, axis=1)
    u = (line / d[:, None]).mean(axis=0)
    return u / np.linalg.norm(u), float(np.median(d))


def next_possible(
    tracklet: Tracklet, falls: Falls, telescopes: Sequence[Telescope], span_s: tuple[float, float],
    rng: np.random.Generator,
) -> tuple[str, Epoch] | None:  # fmt: skip
    """Who can look next within s after the reference time, and when, to a quarter of an hour; None where nobody."""
    t_s = np.arange(span_s[0] + STEP_S, min(span_s[1], span_s[0] + FORWARD_S), STEP_S)
    draws, ephemeris = falls.draws, tracklet.forces.ephemeris
    rows = rng.choice(len(draws), FEW, p=draws.weight())
    flown = until(tracklet, draws.states[rows], falls.t_s[rows], t_s)
    t_s = t_s[np.isfinite(flown[..., 0]).any(axis=0)]
    if not t_s.size:
        return None
    H = magnitudes_of(tracklet, draws.states[rows, :3])
    brightness = None if H is None else (float(np.median(H)), SLOPE)
    best: tuple[float, str] | None = None
    for telescope in telescopes:
        try:
            observer = telescope.spacecraft.state_km_km_s(ephemeris, tracklet.epoch, t_s)
        except CoverageError:  # its trajectory ends before
            continue
        seen = Exposures.at(tracklet.epoch, t_s, observer, ephemeris)
        line, _ = lines(seen, flown[:, : len(t_s)])
        middle = [_middle(one[np.isfinite(one).all(axis=1)]) for one in line.swapaxes(0, 1)]
        found = possible(
            telescope, seen, np.array([u for u, _ in middle]), np.array([d for _, d in middle]),
            np.nanmean(flown[:, : len(t_s), 3:], axis=0), ephemeris, brightness,
        )  # fmt: skip
        first = next((t for t, one in zip(t_s.tolist(), found, strict=True) if one.visible), None)
        if first is not None and (best is None or first < best[0]):
            best = (first, telescope.name)
    return None if best is None else (best[1], tracklet.epoch + best[0])
