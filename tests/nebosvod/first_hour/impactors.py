"""Made-up impactors: an end on the Earth, the way back by Runge and Kutta, and what a station would have seen."""

from dataclasses import dataclass, replace
from typing import Any

import hour_oracle as oracle  # type: ignore[import-not-found]
import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, ForceModel
from nebosvod.first_hour.tracklet import Columns, Tracklet
from nebosvod.observation import GroundSite, Telescope
from nebosvod.observation.earth.ground import R_itrf_from_icrf
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
ARCSEC = np.pi / 648000.0
FALLS = Epoch.parse("2026-03-21T12:00:00 TDB")
SITE = (np.radians(203.74409), 0.936241, 0.351543)  # F51; a spherical Earth has no night here
RADIUS_KM, GM, GM_SUN = 6371.0, 398600.4418, 1.32712440018e11


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Impactor:
    """A tracklet, and where its object passes a height of 25 km, (2,) longitude and latitude, deg."""

    tracklet: Tracklet
    place_deg: Array


def impactor(ephemeris: Ephemeris, rng: np.random.Generator, sigma_arcsec: float = 0.3) -> Impactor:
    """From anywhere within the Sun's reach, at 3 to 16 km/s, hours to two days before; 4 to 8 records in an hour."""
    earth, sun = (ephemeris.state_km_km_s(body, FALLS, np.zeros(1))[0] for body in ("earth", "sun"))
    away = _end(rng)
    while not bound(away + earth - sun, away):
        away = _end(rng)
    lead_s = float(np.exp(rng.uniform(np.log(4.0), np.log(48.0)))) * 3600.0
    count, minutes = int(rng.integers(4, 9)), float(rng.uniform(20.0, 60.0))
    t_s = np.linspace(0.0, 60.0 * minutes, count)
    site = Telescope(name="F51", spacecraft=GroundSite.from_parallax(*SITE, extrapolate=True), sigma_rad=1.0)
    begun = FALLS + -lead_s
    exposures = Exposures.of(begun, [(site, t_s)], ephemeris)
    sigma = sigma_arcsec * ARCSEC
    exposures = replace(exposures, sigma_rad=np.full((count, 2), sigma))
    bare = Tracklet.of(
        "made up", exposures, np.zeros((count, 2)), ForceModel(ephemeris=ephemeris), Columns.none(count), 20.0
    )
    back = oracle.Bodies.of(ephemeris, FALLS, np.array([bare.epoch - FALLS]), 30.0)
    start = back.fly((away + earth - sun)[None])[0, 0]
    bodies = oracle.Bodies.of(ephemeris, bare.epoch, bare.exposures.t_s, 60.0)
    psi = _seen(bodies, bare.exposures, start)
    psi += sigma * rng.standard_normal((count, 2)) / np.stack([np.cos(psi[:, 1]), np.ones(count)], axis=1)
    psi[:, 0] %= 2.0 * np.pi
    on_earth: Any = R_itrf_from_icrf(FALLS) @ away[:3]
    lon, lat = np.arctan2(on_earth[1], on_earth[0]), np.arcsin(on_earth[2] / np.linalg.norm(on_earth))
    lat = np.arctan(np.tan(lat) / (1.0 - 1.0 / 298.257) ** 2)
    return Impactor(
        tracklet=replace(bare, observed=psi),
        place_deg=np.degrees([lon, lat]),
    )


def bound(state: Array, away: Array) -> bool:
    """Whether an orbit (6,), and what it would be without the Earth's pull, is bound to the Sun: a below 4 au."""
    r, v = np.linalg.norm(state[:3]), np.linalg.norm(away[3:])
    slower = away[3:] / v * np.sqrt(v**2 - 2.0 * GM / np.linalg.norm(away[:3]))
    speed2 = np.sum((state[3:] - away[3:] + slower) ** 2)
    return bool(2.0 / r - speed2 / GM_SUN > 1.0 / (4.0 * oracle.AU))


def _end(rng: np.random.Generator) -> Array:
    """Geocentric state (6,) 25 km above the ground, coming down by at least 10 deg."""
    up = rng.standard_normal(3)
    up /= np.linalg.norm(up)
    down = np.arcsin(np.sqrt(rng.uniform(np.sin(np.radians(10.0)) ** 2, 1.0)))  # as a uniform flux falls on a sphere
    aside = np.cross(up, rng.standard_normal(3))
    aside /= np.linalg.norm(aside)
    speed = np.sqrt(rng.uniform(3.0, 16.0) ** 2 + 2.0 * GM / RADIUS_KM)
    squeezed = np.hypot(np.hypot(up[0], up[1]) / 6378.137, up[2] / 6356.752)
    r = up * (1.0 / squeezed + 25.0)
    return np.concatenate([r, speed * (np.cos(down) * aside - np.sin(down) * up)])


def _seen(bodies: oracle.Bodies, exposures: Exposures, start: Array) -> Array:
    """Directions (n, 2) of an orbit, RA and Dec."""
    flown = bodies.fly(start[None])[0]
    r, v = flown[:, :3], flown[:, 3:]
    line = r + bodies.sun[:, :3] - exposures.observer[:, :3]
    for _ in range(4):
        tau = np.linalg.norm(line, axis=1)[:, None] / oracle.C
        line = r + bodies.sun[:, :3] - exposures.observer[:, :3] - tau * (v + bodies.sun[:, 3:])
    ra = np.arctan2(line[:, 1], line[:, 0])
    return np.stack([ra, np.arctan2(line[:, 2], np.hypot(line[:, 0], line[:, 1]))], axis=1)


def inside(edges: Any, place_deg: Any) -> bool:
    """Whether a place lies inside of closed lines of longitudes and latitudes, whichever turn these are on."""
    crossed = [False] * 5
    for edge in edges:
        x, y = np.asarray(edge).T
        for turn in range(5):
            east, north = place_deg[0] + 360.0 * (turn - 2), place_deg[1]
            cut = (y[:-1] > north) != (y[1:] > north)
            rise = np.where(cut, y[1:] - y[:-1], 1.0)
            right = east < x[:-1] + (north - y[:-1]) / rise * (x[1:] - x[:-1])
            crossed[turn] ^= bool(np.sum(cut & right) % 2)
    return any(crossed)
