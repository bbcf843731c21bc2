"""What is known of a predicted event beside the quantity itself: where, when, how near and how fast."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import NoAnswerError
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
ESTIMATED, REFERENCE = "estimated orbit", "reference orbit"  # what an entry was evaluated on


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyFacts:
    """Astrometric ICRF direction, and distance, as a telescope sees the object."""

    telescope: str
    ra_deg: float
    dec_deg: float
    distance_km: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateFacts:
    """Heliocentric ICRF position (3,) and velocity (3,)."""

    position_km: Array
    velocity_km_s: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ValueFacts:
    """The element or the formula whose value it is."""

    formula: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ground:
    """Where over the Earth: geodetic longitude and latitude, and latitude as seen from the centre."""

    longitude_deg: float
    latitude_deg: float
    latitude_geocentric_deg: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EncounterFacts:
    """A closest approach, or an impact.

    Attributes
    ----------
    closest_approach : when; of an impact, when it meets the surface.
    distance_km, speed_km_s : then, from the centre of the body.
    ground : where an impact meets the surface of the Earth; None otherwise.
    capture_radius_km : of the disc of the target plane whose orbits hit; None where no such plane was asked for.
    """

    body: str
    impact: bool
    closest_approach: Epoch
    distance_km: float
    speed_km_s: float
    ground: Ground | None = None
    capture_radius_km: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EntryFacts:
    """How an orbit comes down through an altitude, over the encounter that leads to it.

    Attributes
    ----------
    evaluated_on : ESTIMATED or REFERENCE orbit.
    speed_km_s, path_below_horizon_deg : relative to the centre of the body; the angle of the path.
    ground, path_azimuth_deg : over the Earth; direction of flight over the ground, from north to east; None over
        another body.
    """

    encounter: EncounterFacts
    evaluated_on: str
    epoch: Epoch
    altitude_km: float
    speed_km_s: float
    path_below_horizon_deg: float
    ground: Ground | None
    path_azimuth_deg: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImpactFacts:
    """The impact that has ended the orbit before the time asked about."""

    body: str
    epoch: Epoch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyFacts:
    """The body that was asked about, where nothing else is known."""

    body: str


Facts = SkyFacts | StateFacts | ValueFacts | EncounterFacts | EntryFacts | ImpactFacts | BodyFacts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Disc:
    """The disc of a b-plane whose orbits hit: value (2,) and radius, km; partials (2, k) by the quantity's names."""

    value: Array
    partials: Array
    radius_km: float


class NoEventError(NoAnswerError):
    """A prediction does not exist for this orbit, and this is what is known all the same.

    Parameters
    ----------
    disc : of its encounter, where there is one that has a b-plane.
    """

    def __init__(self, reason: str, *, status: str, facts: Facts, disc: Disc | None = None) -> None:
        super().__init__(reason, status=status)
        self.facts, self.disc = facts, disc


def encounter_of(facts: Facts | None) -> EncounterFacts | None:
    """The encounter behind a prediction; None where it is about none."""
    if isinstance(facts, EntryFacts):
        return facts.encounter
    return facts if isinstance(facts, EncounterFacts) else None
