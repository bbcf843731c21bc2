"""Impactors drawn from orbits of near-Earth objects, and companions that miss: who would have been warned of what?

Orbits are drawn from a population (`near_earth`) by their probability of encounter with the Earth (Opik's theory,
circular orbit of the Earth, focusing by its gravity). The direction of approach is one of the four of such an orbit,
the time is even over a span, the place on the target plane even over the disc that the Earth captures: so elevations of
entry follow sin 2e, and places, directions and speeds belong together. Companions are drawn in the same way from the
ring around that disc, out to a stated distance, the nearer ones more often and with a smaller weight: without them
nobody knows how many warnings are false. Diameters follow a power law. Everything is a function of the seed.

References
----------
Opik 1951, Proc. Royal Irish Academy 54A, 165; Wetherill 1967, J. Geophys. Res. 72, 2429: probability and velocities.
Shoemaker 1962, in Physics and Astronomy of the Moon: elevations of entry, sin 2e.
Brown et al. 2002, Nature 420, 294: number of impactors above a diameter goes with D^-2.70.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import erfa
import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.constants import EARTH_FLATTENING, EARTH_RADIUS_KM
from nebosvod.errors import InputError
from nebosvod.mission.fields import epoch_text
from nebosvod.observation.earth.ground import R_itrf_from_icrf
from nebosvod.timescale import Epoch
from nebosvod.units import AU_KM

Array = npt.NDArray[np.float64]
EARTH_SPEED_KM_S = 29.784691831  # circular, at 1 au
ENTRY_KM = 100.0  # over the equator, where an orbit is said to come down
SIZE_POWER = 2.70
ALBEDO = 0.14  # geometric, by which a diameter becomes H
DAY_S = 86400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Draw:
    """What is drawn.

    Attributes
    ----------
    impacts, misses : how many of each; within_km : how far from the Earth's centre misses pass at the most.
    start, days : the span of the encounters.
    smallest_m, largest_m : of the diameters.
    """

    impacts: int
    misses: int
    within_km: float
    start: Epoch
    days: float
    smallest_m: float
    largest_m: float
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """What is known of an object beside its orbit.

    Attributes
    ----------
    hits : or misses.
    diameter_m : of it.
    sun_angle_deg : between the Sun and where it comes from, before the Earth bends its way: below 90 from the day sky.
    weight : of how many near misses out to the stated distance it stands, for each impactor; 1 for an impactor.
    """

    hits: bool
    diameter_m: float
    sun_angle_deg: float
    weight: float


def encounter_probability(a_au: Array, e: Array, i_rad: Array) -> tuple[Array, Array]:
    """Mean number of impacts a year (n,), and U (n, 3) without signs: velocity by that of the Earth on its way.

    Axes: from the Sun, along the Earth's motion, normal. Zero where the orbit does not reach 1 au.
    """
    p = a_au * (1.0 - e**2)
    radial2 = 2.0 - 1.0 / a_au - p
    U = np.stack(
        [np.sqrt(np.maximum(radial2, 0.0)), np.sqrt(p) * np.cos(i_rad) - 1.0, np.sqrt(p) * np.sin(i_rad)], axis=1
    )
    speed = np.linalg.norm(U, axis=1)
    crosses = (a_au * (1.0 - e) < 1.0) & (a_au * (1.0 + e) > 1.0) & (radial2 > 1e-4) & (np.sin(i_rad) > 1e-4)
    with np.errstate(divide="ignore", invalid="ignore"):
        disc = (capture_radius_km(speed * EARTH_SPEED_KM_S) / AU_KM) ** 2
        chance = disc * speed / (math.pi * np.sin(i_rad) * U[:, 0]) / a_au**1.5
    return np.where(crosses, chance, 0.0), U


def capture_radius_km(v_km_s: Array | float, gm_km3_s2: float = 398600.4415) -> Array:
    """Radius of the disc on the target plane whose orbits come down to the level of entry."""
    level = EARTH_RADIUS_KM + ENTRY_KM
    return np.asarray(level * np.sqrt(1.0 + 2.0 * gm_km3_s2 / level / np.asarray(v_km_s) ** 2))


class DrawnObjects(Sequence[dict[str, Any]]):
    """Objects as of a catalogue, each drawn when it is asked for: a function of the seed and its number.

    Each has `name`, `orbit`, `magnitude`, and what is known of it as `drawn`, a `Drawn`.

    Parameters
    ----------
    orbits : a in au, e, and i in rad (n,), of which is drawn (`near_earth`).

    Raises
    ------
    InputError
        If none of them can meet the Earth.
    CoverageError
        If the ephemeris does not cover the span.
    """

    def __init__(self, orbits: tuple[Array, Array, Array], drawn: Draw, ephemeris: Ephemeris) -> None:
        chance, self._U = encounter_probability(*orbits)
        if not chance.sum() > 0.0:
            raise InputError("none of its orbits crosses that of the Earth: no impactor can be drawn from them")
        for days in (0.0, drawn.days):
            ephemeris.require(drawn.start, days * DAY_S)
        self._until = np.cumsum(chance) / chance.sum()
        self._drawn, self._ephemeris = drawn, ephemeris

    def __len__(self) -> int:
        return self._drawn.impacts + self._drawn.misses

    @property
    def names(self) -> tuple[str, ...]:
        """Of all of them, none drawn."""
        return tuple(self._name(number) for number in range(len(self)))

    def _name(self, number: int) -> str:
        impacts = self._drawn.impacts
        return f"impactor {number}" if number < impacts else f"near miss {number - impacts}"

    def __getitem__(self, number: Any) -> Any:
        if isinstance(number, slice):
            return [self[k] for k in range(*number.indices(len(self)))]
        if not 0 <= number < len(self):
            raise IndexError(number)
        drawn, hits = self._drawn, number < self._drawn.impacts
        rng = np.random.default_rng(np.random.SeedSequence(drawn.seed, spawn_key=(number,)))
        which = int(np.searchsorted(self._until, rng.uniform(), side="right"))
        signs = rng.choice([-1.0, 1.0], 2)
        v = self._U[which] * EARTH_SPEED_KM_S * np.array([signs[0], 1.0, signs[1]])
        epoch = drawn.start + float(rng.uniform(0.0, drawn.days)) * DAY_S
        orbit, weight = _orbit(self._ephemeris, epoch, v, rng, drawn, hits)
        low, high = drawn.smallest_m**-SIZE_POWER, drawn.largest_m**-SIZE_POWER
        diameter_m = float((low + (high - low) * rng.uniform()) ** (-1.0 / SIZE_POWER))
        return {
            "name": self._name(number),
            "orbit": orbit,
            "magnitude": {"H": round(5.0 * math.log10(1.329e6 / math.sqrt(ALBEDO) / diameter_m), 3), "G": 0.15},
            "drawn": Drawn(
                hits=hits, diameter_m=diameter_m, weight=weight,
                sun_angle_deg=math.degrees(math.acos(float(v[0] / np.linalg.norm(v)))),
            ),
        }  # fmt: skip


def _orbit(
    ephemeris: Ephemeris, epoch: Epoch, v: Array, rng: np.random.Generator, drawn: Draw, hits: bool
) -> tuple[dict[str, Any], float]:
    """An orbit that approaches with a velocity on the Earth's axes, at a random place of its target plane.

    And its weight: of misses as many pass through each part of the ring as it is larger than the disc, and they are
    drawn even in the logarithm of its area, for those that pass near are those that may be warned of.
    """
    at = np.zeros(1)
    earth = ephemeris.state_km_km_s("earth", epoch, at)[0] - ephemeris.state_km_km_s("sun", epoch, at)[0]
    gm = ephemeris.gm_km3_s2["earth"]
    x = earth[:3] / np.linalg.norm(earth[:3])
    z = np.cross(earth[:3], earth[3:])
    z /= np.linalg.norm(z)
    far = v @ np.stack([x, np.cross(z, x), z])
    speed = float(np.linalg.norm(far))
    inner = float(capture_radius_km(speed, gm))
    outer = drawn.within_km * math.sqrt(1.0 + 2.0 * gm / drawn.within_km / speed**2)
    wide = 2.0 * math.log(max(outer / inner, 1.0))
    b = max(inner * math.sqrt(rng.uniform()), 1e-3) if hits else inner * math.exp(0.5 * wide * rng.uniform())
    side = np.linalg.svd(far[None])[2][1:]
    angle = rng.uniform(0.0, 2.0 * math.pi)
    offset = b * (math.cos(angle) * side[0] + math.sin(angle) * side[1])
    r, w = hyperbola_state(far, offset, gm, EARTH_RADIUS_KM + ENTRY_KM if hits else None)
    weight = 1.0 if hits else (b / inner) ** 2 * wide
    if not hits:
        state = earth + np.concatenate([r, w])
        return {
            "kind": "state", "frame": "icrf", "epoch": epoch_text(epoch),
            "position": [f"{value!r} km" for value in state[:3].tolist()],
            "velocity": [f"{value!r} km/s" for value in state[3:].tolist()],
        }, weight  # fmt: skip
    return _impact(epoch, r, w), weight


def hyperbola_state(far: Array, offset: Array, gm: float, radius_km: float | None) -> tuple[Array, Array]:
    """Geocentric position and velocity (3,) on a hyperbola, coming in through a radius, or at its perigee.

    Parameters
    ----------
    far : (3,) velocity from far away; offset : (3,) from the centre to the asymptote, normal to it.
    """
    speed, b = float(np.linalg.norm(far)), float(np.linalg.norm(offset))
    s, h = far / speed, b * speed
    pole = np.cross(offset, far) / h
    e = math.sqrt(1.0 + (b * speed**2 / gm) ** 2)
    end = math.acos(-1.0 / e)
    p = -(s * math.cos(end) + np.cross(pole, s) * math.sin(end))
    q = np.cross(pole, p)
    nu = 0.0
    if radius_km is not None:
        nu = -math.acos(min(max((h * h / gm / radius_km - 1.0) / e, -1.0), 1.0))
    r = h * h / gm / (1.0 + e * math.cos(nu))
    position: Array = r * (math.cos(nu) * p + math.sin(nu) * q)
    velocity: Array = gm / h * (-math.sin(nu) * p + (e + math.cos(nu)) * q)
    return position, velocity


def _impact(epoch: Epoch, r: Array, v: Array) -> dict[str, Any]:
    """A geocentric state, ICRF, as an orbit that comes down over a place."""
    to_ground = R_itrf_from_icrf(epoch)
    longitude, latitude, altitude = (
        float(one) for one in erfa.gc2gde(EARTH_RADIUS_KM, EARTH_FLATTENING, to_ground @ r)
    )
    path = to_ground @ v
    speed = float(np.linalg.norm(path))
    up = np.array(
        [math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), math.sin(latitude)]
    )
    east = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
    azimuth = math.atan2(float(path @ east), float(path @ np.cross(up, east)))
    degrees = {"longitude": longitude, "latitude": latitude, "elevation": -math.asin(float(up @ path) / speed),
               "azimuth": azimuth}  # fmt: skip
    return {
        "kind": "impact",
        "at": epoch_text(epoch),
        **{key: f"{math.degrees(value)!r} deg" for key, value in degrees.items()},
        "altitude": f"{altitude!r} km",
        "speed": f"{speed!r} km/s",
    }
