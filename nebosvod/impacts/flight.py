"""Clouds flown to their fates: what each drawn orbit hits, when and where, and how it passes an encounter."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, propagate_many
from nebosvod.dynamics.fates import Fates
from nebosvod.dynamics.hyperbola import b_plane_points
from nebosvod.engine.entry import R_itrf_from_icrf, place_of
from nebosvod.impacts.approaches import Approach
from nebosvod.impacts.cloud import Cloud, Passage
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
TOLERANCE = 1e-8  # of the steps of a cloud: 2 cm after twelve years


def fly(
    orbit: UncertainOrbit, deviations: Array, weights: Array, last: Epoch, near: Sequence[Approach], bodies: Ephemeris
) -> Cloud:
    """Fly drawn orbits until a date or their impact.

    Parameters
    ----------
    deviations : (n, 6 + m) from the orbit's state and parameters, at its epoch.
    near : encounters of the orbit whose target planes are wanted.
    """
    forces, end = orbit.forces(bodies), last - orbit.epoch
    values = np.array([orbit.parameters[name] for name in orbit.parameter_names]) + deviations[:, 6:]
    starts, count = orbit.state + deviations[:, :6], len(deviations)
    found = [
        propagate_many(
            starts, orbit.epoch, [min(one.epoch - orbit.epoch + 86400.0, end)], forces,
            values if values.shape[1] else None, tolerance=TOLERANCE, body=one.body,
        ).fates
        for one in near
    ]  # fmt: skip
    body, when = np.full(count, "", dtype="<U16"), np.full(count, np.nan)
    ground = np.full((count, 4), np.nan)
    for fates in found:
        for k in np.flatnonzero(fates.impact & ~(when <= fates.t_s)):
            body[k], when[k] = fates.body[k], fates.t_s[k]
            ground[k] = _on_the_ground(fates, int(k), orbit.epoch)
    return Cloud(
        epoch=orbit.epoch, names=orbit.names, deviations=deviations, weights=weights, body=body, t_s=when,
        longitude_deg=ground[:, 0], latitude_deg=ground[:, 1], speed_km_s=ground[:, 2], elevation_deg=ground[:, 3],
        passages=tuple(_passage(one, fates, bodies) for one, fates in zip(near, found, strict=True)),
    )  # fmt: skip


def _on_the_ground(fates: Fates, k: int, epoch: Epoch) -> tuple[float, float, float, float]:
    """Longitude, latitude, speed and angle below the horizon of one impact; the first two of the Earth alone."""
    r, v = fates.position_km[k], fates.velocity_km_s[k]
    speed = float(np.linalg.norm(v))
    below = float(np.degrees(-np.arcsin(r @ v / (np.linalg.norm(r) * speed))))
    if fates.body[k] != "earth":
        return np.nan, np.nan, speed, below
    place = place_of(R_itrf_from_icrf(epoch + float(fates.t_s[k])) @ r)
    return float(np.degrees(place.longitude_rad)), float(np.degrees(place.latitude_rad)), speed, below


def _passage(one: Approach, fates: Fates, bodies: Ephemeris) -> Passage:
    """The target plane of one encounter, by the osculating hyperbolas of all members."""
    plane, here = one.plane, fates.body == one.body
    if plane is None:
        raise ValueError(one.no_plane)
    gm = bodies.gm_km3_s2[one.body]
    points, _, lowest = b_plane_points(np.hstack([fates.position_km, fates.velocity_km_s]), gm, plane.axes)
    return Passage(
        body=one.body, epoch=one.epoch, t_s=np.where(here, fates.t_s, np.nan),
        distance_km=np.where(here, lowest, np.nan), xi_zeta_km=np.where(here[:, None], points, np.nan),
        axes=plane.axes, hits=fates.impact & here, v_infinity_km_s=plane.v_infinity_km_s,
        capture_radius_km=plane.capture_radius_km,
    )  # fmt: skip
