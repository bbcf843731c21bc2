"""Which exposures a telescope can make, and why it loses the others."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered
from nebosvod.dynamics.constants import RADIUS_KM
from nebosvod.observation.contracts import Array, Ephemeris, Trajectory
from nebosvod.observation.earth.sites import GroundSite
from nebosvod.observation.measurement.direction import angle_between
from nebosvod.observation.measurement.photometry import apparent_magnitude, trailing_loss
from nebosvod.observation.measurement.sight import Sight, sight
from nebosvod.observation.measurement.telescope import Telescope
from nebosvod.timescale import Epoch

Mask = npt.NDArray[np.bool_]
HALF_A_DEGREE = 0.5 * np.pi / 180.0  # rad
ONE_TENTH_MAG = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Visibility:
    """What can be seen at n reception times and why not.

    Attributes
    ----------
    t_s : (n,) TDB seconds after the trajectory's epoch.
    visible : (n,) no limit removes the exposure.
    removed : for each limit ("duty", "twilight", "sun", "altitude", "earth", "moon", "magnitude"), (n,) whether it
        removes the exposure; "twilight" and "altitude" of sites on the ground only.
    reason : (n,) the first limit, in that order, that removes the exposure; "" where visible.
    sun_angle_rad : (n,) to the Sun's centre; earth_limb_rad, moon_limb_rad : (n,) to the limb, negative on the disc.
    phase_rad : (n,) angle Sun - asteroid - telescope.
    apparent_magnitude : (n,) V without trailing loss, nan where no H, G were given.
    psi : (n, 2) astrometric RA and Dec, rad.
    altitude_rad, sun_altitude_rad : (n,) of the target and of the Sun's centre above the horizon of a ground site
        (geodetic vertical, no refraction); nan of any other telescope.
    short : for each limit, (n,) how much is missing where it removes the exposure, rad or mag; 0 elsewhere, nan for
        "duty".
    """

    t_s: Array
    visible: Mask
    removed: Mapping[str, Mask]
    reason: npt.NDArray[np.str_]
    sun_angle_rad: Array
    earth_limb_rad: Array
    moon_limb_rad: Array
    phase_rad: Array
    apparent_magnitude: Array
    psi: Array
    altitude_rad: Array
    sun_altitude_rad: Array
    short: Mapping[str, Array]

    @property
    def counts(self) -> dict[str, int]:
        """How many exposures each limit removes by itself; they overlap, so the sum may exceed the loss."""
        return {limit: int(np.count_nonzero(mask)) for limit, mask in self.removed.items()}

    def explain(self) -> str:
        """One sentence: how many exposures remain and which limits removed the others."""
        lost = ", ".join(f"{limit} {count}" for limit, count in self.counts.items() if count)
        seen = f"{np.count_nonzero(self.visible)} of {self.t_s.size} epochs visible"
        return f"{seen}; removed by {lost}" if lost else seen

    @property
    def nearest(self) -> int | None:
        """Number of the exposure, of those that are lost, that the fewest and smallest shortfalls remove.

        Half a degree weighs as a tenth of a magnitude; an exposure off duty comes last. None where nothing is lost.
        """
        if self.t_s.size == 0 or self.visible.all():
            return None
        missing = np.zeros(self.t_s.size)
        for limit, lack in self.short.items():
            unit = ONE_TENTH_MAG if limit == "magnitude" else HALF_A_DEGREE
            missing += np.where(np.isnan(lack), np.where(self.removed[limit], 1e6, 0.0), lack / unit)
        return int(np.argmin(np.where(self.visible, np.inf, missing)))


@bordered()
def visibility(
    telescope: Telescope,
    trajectory: Trajectory,
    t_s: Array,
    ephemeris: Ephemeris,
    magnitude: tuple[float, float] | None = None,
) -> Visibility:
    """Decide at which of the times `t_s` the telescope can measure the target.

    Parameters
    ----------
    t_s : shape (n,), reception times, TDB seconds after `trajectory.epoch`.
    magnitude : (H, G) of the target, or None: its brightness then limits nothing.

    Raises
    ------
    InputError
        If a time is not finite or (H, G) are out of range.
    CoverageError
        If trajectory or ephemeris do not cover a time.

    Notes
    -----
    Angles are taken at the telescope between the target and the body as they stand at reception (the light time of
    the Sun moves it 20", of the Moon 1"). An exposure through the disc of a nearer body is always lost, also
    without an exclusion angle.
    """
    line = sight(trajectory, telescope.spacecraft, np.asarray(t_s, dtype=np.float64), ephemeris)
    return visibility_along(telescope, trajectory.epoch, line, ephemeris, magnitude)


def visibility_along(
    telescope: Telescope, epoch: Epoch, line: Sight, ephemeris: Ephemeris, magnitude: tuple[float, float] | None = None
) -> Visibility:
    """The same along lines of sight that are known, whose times count from `epoch`."""
    sun_angle, _, sun_hides = _angles("sun", line, epoch, ephemeris)
    _, earth_limb, earth_hides = _angles("earth", line, epoch, ephemeris)
    _, moon_limb, moon_hides = _angles("moon", line, epoch, ephemeris)
    altitude, sun_altitude = _altitudes(telescope, line, epoch, ephemeris)
    phase = angle_between(-line.heliocentric_state[:, :3], -line.u)
    r_sun = np.linalg.norm(line.heliocentric_state[:, :3], axis=1)
    V = np.full(line.t_s.size, np.nan)
    loss = np.zeros(line.t_s.size)
    if magnitude is not None:
        V = apparent_magnitude(*magnitude, r_sun, line.distance_km, phase)
        if telescope.fwhm_rad is not None:
            speed = np.linalg.norm(line.rate(line.sky_partials()), axis=1)
            loss = trailing_loss(speed, telescope.exposure_s, telescope.fwhm_rad)
    limit = np.inf if telescope.limiting_magnitude is None else telescope.limiting_magnitude
    on_the_ground = bool(np.isfinite(altitude).all())
    removed = {
        "duty": ~telescope.works(epoch, line.t_s),
        **({"twilight": _closer(-sun_altitude, _negative(telescope.sun_altitude_rad))} if on_the_ground else {}),
        "sun": sun_hides
        | _closer(sun_angle, telescope.exclusion_sun_rad)
        | _closer(-sun_angle, _negative(telescope.largest_sun_rad)),
        **({"altitude": _closer(altitude, telescope.altitude_rad)} if on_the_ground else {}),
        "earth": earth_hides | _closer(earth_limb, telescope.exclusion_earth_rad),
        "moon": moon_hides | _closer(moon_limb, telescope.exclusion_moon_rad),
        # nan > limit is False: without H, G the brightness limits nothing
        "magnitude": limit < V + loss,
    }
    lacks = {
        "twilight": _lack(-sun_altitude, _negative(telescope.sun_altitude_rad)),
        "sun": _lack(sun_angle, telescope.exclusion_sun_rad) + _lack(-sun_angle, _negative(telescope.largest_sun_rad)),
        "altitude": _lack(altitude, telescope.altitude_rad),
        "earth": _lack(earth_limb, telescope.exclusion_earth_rad or 0.0),
        "moon": _lack(moon_limb, telescope.exclusion_moon_rad or 0.0),
        "magnitude": V + loss - limit,
    }
    masks = list(removed.values())
    return Visibility(
        t_s=line.t_s,
        visible=~np.any(masks, axis=0),
        removed=removed,
        reason=np.select(masks, list(removed), default=""),
        sun_angle_rad=sun_angle,
        earth_limb_rad=earth_limb,
        moon_limb_rad=moon_limb,
        phase_rad=phase,
        apparent_magnitude=V,
        psi=line.psi,
        altitude_rad=altitude,
        sun_altitude_rad=sun_altitude,
        short={
            name: np.where(mask, lacks[name], 0.0) if name in lacks else np.full(line.t_s.size, np.nan)
            for name, mask in removed.items()
        },
    )


def _closer(angle: Array, limit: float | None) -> Mask:
    """Where the angle is below the limit, if there is one."""
    return np.zeros(angle.shape, dtype=np.bool_) if limit is None else angle < limit


def _lack(angle: Array, limit: float | None) -> Array:
    """By how much the angle is below the limit, rad; 0 where it is not."""
    return np.zeros(angle.shape) if limit is None else np.maximum(limit - angle, 0.0)


def _negative(limit: float | None) -> float | None:
    """A limit from above as one from below of the negative angle."""
    return None if limit is None else -limit


def _altitudes(telescope: Telescope, line: Sight, epoch: Epoch, ephemeris: Ephemeris) -> tuple[Array, Array]:
    """Altitudes (n,) of the target and of the Sun at a site on the ground, nan elsewhere."""
    site = telescope.spacecraft
    if not isinstance(site, GroundSite) or not site.has_horizon:
        return np.full(line.t_s.size, np.nan), np.full(line.t_s.size, np.nan)
    up = site.zenith(epoch, line.t_s)
    to_sun = ephemeris.position_km("sun", epoch, line.t_s) - line.telescope_state[:, :3]
    return np.pi / 2.0 - angle_between(line.u, up), np.pi / 2.0 - angle_between(to_sun, up)


def _angles(body: str, line: Sight, epoch: Epoch, ephemeris: Ephemeris) -> tuple[Array, Array, Mask]:
    """Angles (n,) from the target to the body's centre and to its limb, and whether the body hides the target."""
    to_body = ephemeris.position_km(body, epoch, line.t_s) - line.telescope_state[:, :3]
    distance = np.linalg.norm(to_body, axis=1)
    inside = distance < 1.0  # a fictitious observer at the body's centre looks away from it and is not hidden by it
    to_body[inside], distance[inside] = -line.u[inside], np.inf
    angle = angle_between(line.u, to_body)
    limb = angle - np.arcsin(np.minimum(RADIUS_KM[body] / distance, 1.0))
    return angle, limb, (limb < 0.0) & (line.distance_km > distance)
