"""What an arc too short for Gauss's method says: the attributable, and orbits for any distance and range rate.

References
----------
Milani, Gronchi, Farnocchia, Knezevic, Jedicke, Denneau and Pierfederici 2008, Icarus 195, 474 (attributables).
Farnocchia, Chesley and Micheli 2015, Icarus 258, 18 (systematic ranging).
"""

from dataclasses import dataclass

import numpy as np

from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Rows
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.initial.two_body_fit import Arc, improve
from nebosvod.observation.reduction.weights import Weights, weigh
from nebosvod.units import ARCSEC

NEAREST_AU, FARTHEST_AU = 1e-4, 10.0
COARSE_NEAREST_AU = 3e-3
FINE, COARSE = (40, 9), (14, 5)  # distances and range rates of the two grids
FEW_ROWS = 10  # directions that choose nodes of the coarse grid
BOUND = 0.98  # range rates go up to this share of those with parabolic speed
LONGEST_D = 10.0  # an arc longer than this is no line with a curvature
SIGNIFICANT = 3.0  # sigmas of curvature above which an arc says something of the distance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Attributable:
    """Direction and motion at the middle of an arc.

    Attributes
    ----------
    t_s : the middle, TDB seconds after the epoch of the records; arc_s : length; number : of observations.
    psi : (2,) RA and Dec, rad.
    rate_rad_s : (2,) motion in RA cos Dec and Dec; sigma_rad, sigma_rate_rad_s : (2,) standard deviations.
    curvature_rad_s2 : (2,) second derivatives; sigma_curvature_rad_s2; zeros and infinity with fewer than three times.
    significance : length of the curvature in its sigmas; below 3 the arc is a straight line, and says nothing of the
        distance but what the observer's own motion adds.

    References
    ----------
    Milani et al. 2008, Icarus 195, 474.
    """

    t_s: float
    arc_s: float
    number: int
    psi: Array
    rate_rad_s: Array
    sigma_rad: Array
    sigma_rate_rad_s: Array
    curvature_rad_s2: Array
    sigma_curvature_rad_s2: Array
    significance: float

    @property
    def text(self) -> str:
        """What is known, in a sentence."""
        hours = self.arc_s / 3600.0
        if hours > 24.0 * LONGEST_D:
            return f"{self.number} observations over {hours / 24.0:.1f} d"
        arc = f"{hours:.1f} h" if hours < 48.0 else f"{hours / 24.0:.1f} d"
        motion = float(np.linalg.norm(self.rate_rad_s)) / ARCSEC * 3600.0
        error = float(np.linalg.norm(self.sigma_rate_rad_s)) / ARCSEC * 3600.0
        curve = (
            f"its path is curved by {self.significance:.1f} sigma"
            if self.significance >= SIGNIFICANT
            else f"its path shows no curvature ({self.significance:.1f} sigma), so the distance is not known"
        )
        return (
            f"{self.number} observations over {arc}: RA {np.degrees(self.psi[0]):.5f} deg, Dec "
            f"{np.degrees(self.psi[1]):+.5f} deg, moving {motion:.2f} +- {error:.2g} arcsec an hour; {curve}"
        )


def attributable(astrometry: Astrometry, weights: Weights | None = None) -> Attributable:
    """Fit direction, motion and, with three times or more, curvature to the records of one object.

    Raises
    ------
    InputError
        If there are fewer than two times: then there is a direction and nothing else.

    Notes
    -----
    Quadratic in time, in the plane tangent to the middle direction, each coordinate by itself. The observer's own
    motion (the turning Earth) is in it: over hours, of an object near the Earth, it is the larger part.

    References
    ----------
    Milani et al. 2008, Icarus 195, 474.
    """
    times = np.unique(astrometry.t_s)
    if times.size < 2:
        raise InputError("one time of observation: a direction is known, no motion")
    sigma = (weights or weigh(astrometry)).sigma_rad
    middle, arc = float(0.5 * (times[0] + times[-1])), float(times[-1] - times[0])
    near = int(np.argmin(np.abs(astrometry.t_s - middle)))
    degree = 2 if times.size > 2 else 1
    x = 2.0 * (astrometry.t_s - middle) / arc
    V = np.vander(x, degree + 1, increasing=True) * np.array([1.0, 1.0, 0.5])[: degree + 1]
    found, spread = np.zeros((2, 3)), np.full((2, 3), np.inf)
    away = _tangent(astrometry.psi, astrometry.psi[near])
    for axis in range(2):
        Q, R = np.linalg.qr(V / sigma[:, axis, None])
        found[axis, : degree + 1] = np.linalg.solve(R, Q.T @ (away[:, axis] / sigma[:, axis]))
        spread[axis, : degree + 1] = np.linalg.norm(np.linalg.solve(R, np.eye(degree + 1)), axis=1)
    half = 0.5 * arc
    psi = astrometry.psi[near] + found[:, 0] / np.array([np.cos(astrometry.psi[near, 1]), 1.0])
    return Attributable(
        t_s=middle,
        arc_s=arc,
        number=len(astrometry),
        psi=np.array([psi[0] % (2.0 * np.pi), psi[1]]),
        rate_rad_s=found[:, 1] / half,
        sigma_rad=spread[:, 0],
        sigma_rate_rad_s=spread[:, 1] / half,
        curvature_rad_s2=found[:, 2] / half**2,
        sigma_curvature_rad_s2=spread[:, 2] / half**2,
        significance=float(np.linalg.norm(found[:, 2] / spread[:, 2])),
    )


def ranging(arc: Arc, observer_velocity: Array, *, keep: int, fine: bool) -> Array:
    """Orbits (k, 6) bound to the Sun that fit an arc best, one for each of a grid of distances and range rates.

    Parameters
    ----------
    observer_velocity : shape (3,), of the observer about the Sun at the middle of the arc, au/d.
    keep : how many to return, best first, no two next to each other on the grid.
    fine : the whole search, from 1e-4 au on; else a coarse one that only gives least squares other places to start.

    Notes
    -----
    Each node of the grid holds its distance and range rate while direction and motion are fitted.

    References
    ----------
    Farnocchia, Chesley, Micheli 2015, Icarus 258, 18.
    """
    states, place = _grid(arc, observer_velocity, fine)
    if not len(states):
        return states
    used = arc if fine else arc.thinned(FEW_ROWS)
    states, cost = improve(used, states, free="sky", steps=3 if fine else 2)
    chosen: list[int] = []
    for number in np.argsort(cost, kind="stable").tolist():
        if all(np.max(np.abs(place[number] - place[other])) > 1 for other in chosen):
            chosen.append(number)
        if len(chosen) == keep:
            break
    return np.asarray(states[chosen])


def _grid(arc: Arc, observer_velocity: Array, fine: bool) -> tuple[Array, Rows]:
    """States (k, 6) at the middle of the arc for every distance and range rate with a bound orbit, and their places."""
    distances, rates = FINE if fine else COARSE
    middle = int(np.argmin(np.abs(arc.t - arc.t0)))
    x = arc.t - arc.t0
    towards = arc.u @ np.stack([arc.east[middle], arc.north[middle]], axis=1)
    towards = towards / (arc.u @ arc.u[middle])[:, None]
    fit = np.polynomial.polynomial.polyfit(x, towards, min(2, np.unique(x).size - 1))
    u = arc.u[middle] + fit[0, 0] * arc.east[middle] + fit[0, 1] * arc.north[middle]
    length = np.linalg.norm(u)
    u = u / length
    sweep = (fit[1, 0] * arc.east[middle] + fit[1, 1] * arc.north[middle]) / length
    sweep = sweep - (sweep @ u) * u
    distance = np.geomspace(NEAREST_AU if fine else COARSE_NEAREST_AU, FARTHEST_AU, distances)
    r = arc.q[middle] + distance[:, None] * u
    across = observer_velocity + distance[:, None] * sweep
    along = across @ u
    room = 2.0 * arc.gm / np.linalg.norm(r, axis=1) - np.sum(across**2, axis=1) + along**2
    possible = np.flatnonzero(room > 0.0)
    share = BOUND * np.linspace(-1.0, 1.0, rates)
    rate = -along[possible, None] + share * np.sqrt(room[possible, None])
    v = across[possible, None] + rate[:, :, None] * u
    states = np.concatenate([np.broadcast_to(r[possible, None], v.shape), v], axis=2).reshape(-1, 6)
    places: Rows = np.stack(np.meshgrid(possible, np.arange(rates), indexing="ij"), axis=2).reshape(-1, 2)
    return np.asarray(states), places


def _tangent(psi: Array, centre: Array) -> Array:
    """Offsets (n, 2) from a direction in RA cos Dec and Dec, rad, gnomonic."""
    d_ra = psi[:, 0] - centre[0]
    cos_dec, sin_dec, cos_0, sin_0 = np.cos(psi[:, 1]), np.sin(psi[:, 1]), np.cos(centre[1]), np.sin(centre[1])
    depth = sin_0 * sin_dec + cos_0 * cos_dec * np.cos(d_ra)
    return np.stack(
        [cos_dec * np.sin(d_ra) / depth, (cos_0 * sin_dec - sin_0 * cos_dec * np.cos(d_ra)) / depth], axis=1
    )
