"""Directions, rates, ellipses, distances and brightness of an orbit at given times."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, Trajectory
from nebosvod.dynamics.impact import follow, what_it_hits
from nebosvod.ephemerides.angles import SunAngles, sun_angles
from nebosvod.errors import ImpactError, InputError
from nebosvod.observation import GroundSite, Telescope, observe, visibility
from nebosvod.observation.measurement.photometry import apparent_magnitude
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.timescale import SECONDS_PER_DAY, Epoch, to_tdb, utc_jd

Array = npt.NDArray[np.float64]
MOST_TIMES = 200_000
MARGIN_S = SECONDS_PER_DAY  # light time
LONGEST = np.radians(3.0)  # 1 sigma ellipse on the sky that is taken for the region where an object may be


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sky:
    """What an observer sees at n times.

    Attributes
    ----------
    epoch : t = 0; t_s : (n,) TDB seconds after it, times of reception.
    psi : (n, 2) astrometric RA and Dec, ICRF, rad.
    rate : (n, 2) apparent motion in RA cos Dec and Dec, rad/s.
    factor : (n, 2, 2) lower factor of the covariance of RA cos Dec and Dec, rad.
    semi_axes : (n, 2) of the 1 sigma ellipse, major and minor, rad.
    position_angle : (n,) of the major axis, from north to east, in [0, pi), rad.
    distance_km, sigma_distance_km : (n,) from the observer.
    r_sun_km : (n,) from the Sun.
    phase, elongation : (n,) angles at the object and at the observer, rad.
    magnitude : (n,) V by H and G; nan where these are not known.
    altitude, sun_altitude : (n,) above the horizon of a site, without refraction, rad; nan of other observers.
    reason : (n,) which limit of a mission's telescope keeps it from being seen; "" where none does.
    notices : what a reader must know.
    ended : why there are fewer times than were asked for; empty otherwise.
    """

    observer: Telescope
    epoch: Epoch
    t_s: Array
    psi: Array
    rate: Array
    factor: Array
    semi_axes: Array
    position_angle: Array
    distance_km: Array
    sigma_distance_km: Array
    r_sun_km: Array
    phase: Array
    elongation: Array
    magnitude: Array
    altitude: Array
    sun_altitude: Array
    reason: npt.NDArray[np.str_]
    notices: tuple[str, ...] = ()
    ended: str = ""


def times(first: Epoch, last: Epoch, step_s: float) -> Array:
    """Times (n,) from first to last, both included where the step allows, TDB s after the first.

    Steps are of the scale in which the first is said: days of UTC are its days, although the seconds of TDB differ by
    up to 2 ms, and by leap seconds.

    Raises
    ------
    InputError
        If they are none, or more than can be meant.
    """
    if last < first:
        raise InputError(f"--to {last.iso('utc', 0)} is before --from {first.iso('utc', 0)}")
    if not step_s > 0.0:
        raise InputError(f"--step needs to be positive (got {step_s:g} s)")
    count = int(min((last - first + 2e-3) / step_s + 1e-9, 1e15)) + 1
    if count > MOST_TIMES:
        raise InputError(f"--step: {count:,} times are asked for (allowed {MOST_TIMES:,}); take a longer step")
    t_s = np.asarray(step_s * np.arange(count), dtype=np.float64)
    if first.scale != "utc":
        return t_s
    day, fraction = utc_jd(first, np.zeros(1))
    tdb = to_tdb(np.full(count, day[0]), fraction[0] + t_s / SECONDS_PER_DAY, "utc")
    t_s = ((tdb[0] - first.day) + (tdb[1] - first.fraction)) * SECONDS_PER_DAY
    return np.asarray(t_s[t_s <= (last - first) + 2e-3])


def sky(orbit: UncertainOrbit, observer: Telescope, epoch: Epoch, t_s: Array, ephemeris: Ephemeris) -> Sky:
    """Where an observer sees an orbit.

    Parameters
    ----------
    epoch, t_s : times of reception (n,), ascending, TDB seconds after an epoch.

    Raises
    ------
    CoverageError
        If a time is outside the ephemeris, with what to install.
    ImpactError
        If the orbit hits a body before the first time.

    Notes
    -----
    One flight with its variations gives everything: the covariance of (RA cos Dec, Dec) is J S (J S)^T with the
    partials J by state and parameters at the orbit's epoch and the factor S.
    """
    flown_s = t_s + (epoch - orbit.epoch)
    ephemeris.require(orbit.epoch, flown_s)
    trajectory = _flight(orbit, flown_s, ephemeris)
    alive = flown_s <= trajectory.span_s[1]
    ended = ""
    if not alive.all():
        hit = what_it_hits(trajectory)
        what = f"hits {hit.body} on {hit.epoch.iso('utc', 0)}" if hit is not None else "ends"
        ended = f"the orbit {what}: {np.count_nonzero(~alive)} of {len(alive)} times are after that"
    flown_s = flown_s[alive]
    seen = observe(trajectory, observer, flown_s, ephemeris)
    facts = visibility(observer, trajectory, flown_s, ephemeris, orbit.magnitude)
    angles = sun_angles(seen, ephemeris)
    J = np.concatenate([seen.H_x0, seen.H_c], axis=2) @ orbit.factor
    along = np.concatenate([seen.Phi_emission, seen.zeta_emission], axis=2) @ orbit.factor
    axes, semi_axes, _ = np.linalg.svd(J, full_matrices=False)
    return Sky(
        observer=observer,
        epoch=epoch,
        t_s=t_s[alive],
        psi=seen.psi,
        rate=seen.rate,
        factor=_lower(J),
        semi_axes=semi_axes,
        position_angle=np.arctan2(axes[:, 0, 0], axes[:, 1, 0]) % np.pi,
        distance_km=seen.distance_km,
        sigma_distance_km=np.linalg.norm(np.einsum("ni,nij->nj", seen.u, along), axis=1),
        r_sun_km=angles.r_sun_km,
        phase=angles.phase,
        elongation=angles.elongation,
        magnitude=_magnitude(orbit, angles, seen.distance_km),
        altitude=facts.altitude_rad,
        sun_altitude=facts.sun_altitude_rad,
        reason=facts.reason,
        notices=(*_notices(orbit, observer, flown_s), *_bent(orbit.epoch, flown_s, semi_axes[:, 0])),
        ended=ended,
    )


def _flight(orbit: UncertainOrbit, t_s: Array, ephemeris: Ephemeris) -> Trajectory:
    """The orbit over the times asked about, or to the impact that ends it."""
    first, last = (end - orbit.epoch for end in ephemeris.coverage(asteroids=True))
    span = (max(min(0.0, float(t_s[0]) - MARGIN_S), min(first, 0.0)), min(max(0.0, float(t_s[-1])), last))
    try:
        return follow(orbit.state, orbit.epoch, span, float(t_s[0]), orbit.forces(ephemeris), True)
    except ImpactError as error:
        raise ImpactError(f"{orbit.name}: {error}", body=error.body, t_s=error.t_s) from None


def _lower(J: Array) -> Array:
    """Lower factors (n, 2, 2) of J J^T, J (n, 2, k)."""
    upper = np.asarray(np.linalg.qr(J.transpose(0, 2, 1), mode="r"))
    sign = np.where(np.einsum("nii->ni", upper) < 0.0, -1.0, 1.0)
    lower: Array = (upper * sign[:, :, None]).transpose(0, 2, 1)
    return lower


def _magnitude(orbit: UncertainOrbit, angles: SunAngles, distance_km: Array) -> Array:
    """V (n,) by H and G, nan where these are not known."""
    if orbit.magnitude is None:
        return np.full(len(distance_km), np.nan)
    return apparent_magnitude(*orbit.magnitude, angles.r_sun_km, distance_km, angles.phase)


def _notices(orbit: UncertainOrbit, observer: Telescope, t_s: Array) -> tuple[str, ...]:
    """What stands in for data that are not there, and what is said of the orbit."""
    site = observer.spacecraft
    said = site.notices(orbit.epoch, t_s) if isinstance(site, GroundSite) and site.has_horizon and len(t_s) else ()
    return (*orbit.notices, *said)


def _bent(epoch: Epoch, t_s: Array, major: Array) -> list[str]:
    """Where ellipses are so long that they tell no more than that little is known."""
    long = np.flatnonzero(major > LONGEST)
    if not long.size:
        return []
    when = (epoch + float(t_s[long[0]])).iso("utc", 0)
    return [
        f"{len(long)} of {len(major)} ellipses are longer than {np.degrees(LONGEST):.0f} deg at 1 sigma, the first at "
        f"{when}: a linear ellipse of that size is not the region where the object may be, which is bent"
    ]
