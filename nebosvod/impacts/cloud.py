"""Cloud: orbits drawn about one, each with its weight and its fate. What risk, its budget and its pages share.

A cloud knows nothing of how it was drawn: plain draws weigh one each, draws of a proposal prior over proposal, so that
the mean of `weights` where something happens is its probability in both cases.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Passage:
    """The members of a cloud at one encounter; nan (and False) for those that do not have it.

    Attributes
    ----------
    body : near what. epoch : about when, TDB.
    t_s : (n,) when each is nearest or comes to the surface, TDB seconds after the epoch of the cloud.
    distance_km : (n,) smallest distance from the centre; of a hit that of the osculating hyperbola.
    xi_zeta_km : (n, 2) in the b-plane on common `axes`.
    axes : (3, 3), rows xi, normal, zeta, ICRF.
    hits : (n,) whether it comes down to the surface here: of the Earth the ellipsoid of WGS 84, else a sphere.
    v_infinity_km_s, capture_radius_km : medians over the members.
    """

    body: str
    epoch: Epoch
    t_s: Array
    distance_km: Array
    xi_zeta_km: Array
    axes: Array
    hits: Flags
    v_infinity_km_s: float
    capture_radius_km: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Crossing:
    """Where members come down through a height above the surface of a body; nan for those that do not.

    Attributes
    ----------
    t_s : (n,) TDB seconds after the epoch of the cloud.
    longitude_deg, latitude_deg : (n,) geodetic, on the Earth; nan on other bodies.
    speed_km_s, elevation_deg : (n,) relative to the body's centre; the angle of the path below the horizon.
    """

    t_s: Array
    longitude_deg: Array
    latitude_deg: Array
    speed_km_s: Array
    elevation_deg: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cloud:
    """Drawn orbits with their fates.

    Attributes
    ----------
    epoch : of the deviations.
    names : the columns of the deviations: the six of the state, then the parameters.
    deviations : (n, 6 + m) from the estimate, normal with its covariance where weights are 1; km, km/s, units of the
        parameters. The orbits flown are `coordinates.starts` of them.
    weights : (n,) prior density over that of the draw; ones for plain draws.
    body : (n,) what it hits; "" for nothing until the end.
    ground, entry : at the surface of what it hits, and 100 km above the surface of what it first comes down to; one
        with an entry that hits nothing grazes.
    passages : encounters of members with the bodies that were watched, by time.
    lost : why a member could not be flown to the end, by its number; it counts as one that hits nothing.
    """

    epoch: Epoch
    names: tuple[str, ...]
    deviations: Array
    weights: Array
    body: npt.NDArray[np.str_]
    ground: Crossing
    entry: Crossing
    passages: tuple[Passage, ...]
    lost: Mapping[int, str] = field(default_factory=dict)

    def __len__(self) -> int:
        """How many orbits."""
        return len(self.weights)

    @property
    def t_s(self) -> Array:
        """When each comes to the surface (n,), TDB seconds after `epoch`; nan without a hit."""
        return self.ground.t_s

    @property
    def grazes(self) -> Flags:
        """Which members (n,) come below 100 km, and not to the ground."""
        found: Flags = np.isfinite(self.entry.t_s) & ~self.hit
        return found

    @property
    def hit(self) -> Flags:
        """Which orbits (n,) hit anything."""
        found: Flags = self.body != ""
        return found

    def probability(self, which: Flags) -> float:
        """Of what some members (n,) do, by the weights."""
        return float(np.sum(self.weights[which]) / len(self))


def draw(orbit: UncertainOrbit, count: int, rng: np.random.Generator) -> Array:
    """Plain draws: deviations (count, 6 + m) from an orbit, normal with its covariance.

    Raises
    ------
    InputError
        If `count` is not positive.
    """
    if count < 1:
        raise InputError(f"draws: needs a positive number (got {count})")
    deviations: Array = rng.standard_normal((count, len(orbit.factor))) @ orbit.factor.T
    return deviations
