"""The line of variations: a string of orbits along the weak direction, its returns, and the chance of a hit from them.

The string goes through the estimate along the most probable deviations that move the orbit ahead or behind: corrected
to the observations where they are at hand, else straight. Where it passes near the body its closest points are refined.
The chance of a hit is told by a string of its own, through the estimate along the deviations that move the point in
this target plane most: an encounter on the way may have stretched others than those that move the orbit ahead. What is
left of the confidence region across that string is taken as normal there, so the chance is an integral along it.

References
----------
Milani, Chesley, Sansaturio, Tommei, Valsecchi 2005, Icarus 173, 362.
Milani, Sansaturio, Tommei, Arratia, Chesley 2005, Astronomy & Astrophysics 431, 729.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Trajectory
from nebosvod.errors import InputError
from nebosvod.estimation.accuracy.inside import inside_disc
from nebosvod.impacts.cloud import Cloud, Passage
from nebosvod.impacts.flight import GAP_S, WITHIN_KM, Course
from nebosvod.impacts.hitting import AFTER_S, HittingOrbit
from nebosvod.impacts.string import Corrected, String
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
ENDS, POINTS, MOST_POINTS = 5.0, 401, 4001
SPACING_KM = WITHIN_KM  # along the track between neighbours: one of two is seen at every encounter that the string has
TIMES = 200  # at which that is looked at
ROUNDS, FINE = 10, 9
ONE = 0.05  # of the capture radius between points: nearer ones are one
NODES = 121
REACH = 6.0  # sigmas across the string
MOST_LOOKED_AT, MOST_MINIMA = 100, 16  # of one string, the nearest of them
NO_OBSERVATIONS = "no observations are at hand"
DEEP = 40.0  # capture radii: a string that comes no nearer is not looked at
ALIGNED = 0.999  # cosine of the angle between directions whose curved strings are one
ABOUT, ABOUT_POINTS = 1.0, 41  # sigmas either way where a curved string is looked for its nearest point


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Minimum:
    """A point of the string that is nearest to a body: its sigma, when, and how far in the target plane."""

    body: str
    epoch: Epoch
    sigma: float
    distance_km: float
    capture_radius_km: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """The string, sigmas (k,) of it, their flight, and the returns.

    `why_straight` says why it is not corrected to observations; empty where it is. `corrected` makes curved strings,
    `strings` are those that were made. Neighbours are up to `spacing_km` apart along the track.
    """

    course: Course
    string: String
    sigmas: Array
    cloud: Cloud
    minima: tuple[Minimum, ...]
    why_straight: str
    corrected: Corrected | str
    strings: list[String]
    spacing_km: float

    @property
    def coarse(self) -> bool:
        """Whether it may step over an encounter."""
        return self.spacing_km > 2.0 * SPACING_KM

    def toward(self, orbit: HittingOrbit) -> String:
        """The string along which the point in the target plane of a hitting orbit moves most, in the line's sense.

        Its direction is the leading singular vector of d(xi, zeta)/du, so that what is left moves the point across it.
        """
        direction: Array = np.linalg.svd(orbit.J, full_matrices=False)[2][0]
        if direction @ self.string.direction < 0.0:
            direction = -direction
        if not self.string.curved:
            return String.straight(direction)
        for one in self.strings:
            if one.direction @ direction > ALIGNED:
                return one
        string, _ = _string(self.course, direction, self.corrected)
        self.strings.append(string)
        return string

    def probability(self, orbit: HittingOrbit, body: str) -> float:
        """Chance of a hit near one hitting orbit, by a string of its own.

        Parameters
        ----------
        orbit : whose partials tell how wide the region is across the string, and where the string is nearest.
        """
        string = self.toward(orbit)
        along = orbit.J @ string.direction
        across = orbit.J - np.outer(along, string.direction)
        size, radius = float(np.linalg.norm(along)), orbit.plane.capture_radius_km
        middle = self._nearest(string, orbit, body)
        half = (1.5 * radius + REACH * float(np.linalg.norm(across, 2))) / max(size, 1e-300)
        low, high = string.ends
        sigmas = np.linspace(max(middle - half, low), min(middle + half, high), NODES)
        last = min(orbit.epoch + AFTER_S, self.course.last)
        passage = _passage(self.course.fly(_strung(self.course, string, sigmas), None, last), body, orbit.epoch)
        if passage is None:
            return 0.0
        turn = orbit.plane.axes[[0, 2]] @ passage.axes[[0, 2]].T
        points = passage.xi_zeta_km @ turn.T
        known = np.isfinite(points).all(axis=1)
        chance = np.array([inside_disc(b, across, radius) for b in points[known]])
        density = np.exp(-0.5 * sigmas[known] ** 2) / np.sqrt(2.0 * np.pi)
        return float(np.trapezoid(density * chance, sigmas[known]))

    def _nearest(self, string: String, orbit: HittingOrbit, body: str) -> float:
        """Sigma where a string is nearest to the body for a hitting orbit, which a curved one need not go through."""
        level = float(string.sigma_of(orbit.u[None])[0])
        if not string.curved:
            return level
        sigmas = np.linspace(max(level - ABOUT, string.ends[0]), min(level + ABOUT, string.ends[1]), ABOUT_POINTS)
        last = min(orbit.epoch + GAP_S, self.course.last)
        passage = _passage(self.course.fly(_strung(self.course, string, sigmas), None, last), body, orbit.epoch)
        lowest = [] if passage is None else lowest_points(sigmas, passage)
        if not lowest:
            return level
        return _refined(self.course, string, *min(lowest, key=lambda one: abs(one[1] - level))[1:]).sigma


def line_of_variations(
    course: Course, nominal: Trajectory, about_s: float, corrected: Corrected | str = NO_OBSERVATIONS
) -> Line:
    """Fly the string and refine where it comes nearest.

    Parameters
    ----------
    nominal : the estimate with its sensitivities.
    about_s : when the direction is that along the track, TDB seconds after the epoch.
    corrected : the string of a direction by the observations, or why there is none.
    """
    string, why_straight = _string(course, weak_direction(course, nominal, about_s), corrected)
    low, high = max(-ENDS, string.ends[0]), min(ENDS, string.ends[1])
    length = (high - low) * _stretching(course, nominal, string.direction)
    sigmas = np.linspace(low, high, int(np.clip(np.ceil(length / SPACING_KM) + 1, POINTS, MOST_POINTS)))
    cloud = course.fly(_strung(course, string, sigmas))
    coarse = sorted(
        (one for passage in cloud.passages for one in lowest_points(sigmas, passage)), key=lambda one: one[0]
    )
    fine = [_refined(course, string, *one[1:]) for one in coarse[:MOST_LOOKED_AT]]
    near = [one for one in fine if one.distance_km <= DEEP * one.capture_radius_km]
    minima = sorted(near, key=lambda one: one.distance_km)[:MOST_MINIMA]
    return Line(
        course=course, string=string, sigmas=sigmas, cloud=cloud, minima=tuple(minima), why_straight=why_straight,
        corrected=corrected, strings=[string], spacing_km=length / (len(sigmas) - 1),
    )  # fmt: skip


def _string(course: Course, direction: Array, corrected: Corrected | str) -> tuple[String, str]:
    """The string by the observations; a straight one where they do not give it, and why."""
    if isinstance(corrected, str):
        return String.straight(direction), corrected
    if course.coordinates != "cartesian":
        return String.straight(direction), f"draws are straight in {course.coordinates} elements, and so is it"
    try:
        return corrected(direction), ""
    except InputError as error:
        return String.straight(direction), str(error)


def _stretching(course: Course, nominal: Trajectory, direction: Array) -> float:
    """How far one sigma of a direction moves the orbit along its track at most, km, at any time.

    Beyond the impact of an estimate that hits it is taken to grow with time.
    """
    span = nominal.span_s[1]
    at = nominal.at(np.linspace(0.0, span, TIMES))
    moved = np.concatenate([at.Phi[:, :3], at.zeta[:, :3]], axis=2) @ (course.orbit.factor @ direction)
    speed = np.linalg.norm(at.state[:, 3:], axis=1)
    longest = float(np.abs(np.sum(moved * at.state[:, 3:], axis=1) / speed).max())
    return longest * max((course.last - course.orbit.epoch) / span, 1.0)


def weak_direction(course: Course, nominal: Trajectory, about_s: float) -> Array:
    """Unit vector (n,) of whitened deviations: the most probable ones for a displacement along the track."""
    at = nominal.at([about_s])
    velocity = at.state[0, 3:]
    row = (velocity / np.linalg.norm(velocity)) @ np.hstack([at.Phi[0, :3], at.zeta[0, :3]]) @ course.orbit.factor
    direction: Array = row / np.linalg.norm(row)
    return direction


def _strung(course: Course, string: String, sigmas: Array) -> Array:
    """Deviations (k, n) of the string."""
    deviations: Array = string.at(np.clip(sigmas, *string.ends)) @ course.orbit.factor.T
    return deviations


def lowest_points(sigmas: Array, passage: Passage) -> list[tuple[float, float, float, Passage]]:
    """Points of the string nearer than their neighbours at one encounter, the target in reach between them.

    Of each how near the string may come, its sigma, the spacing. A neighbour without the encounter may be anywhere.
    """
    points = passage.xi_zeta_km
    distance = np.linalg.norm(points, axis=1)
    held = np.where(np.isfinite(distance), distance, np.inf)
    before, after = np.concatenate([[np.inf], held[:-1]]), np.concatenate([held[1:], [np.inf]])
    found = []
    for k in np.flatnonzero(np.isfinite(held) & (held <= before) & (held < after)):
        beside = [points[j] for j in (k - 1, k + 1) if 0 <= j < len(points) and np.isfinite(held[j])]
        bend = float(np.linalg.norm(beside[0] - 2.0 * points[k] + beside[1])) / 8.0 if len(beside) == 2 else held[k]
        least = max(min((_to_origin(points[k], one) for one in beside), default=0.0) - bend, 0.0)
        if least <= DEEP * passage.capture_radius_km:
            found.append((least, float(sigmas[k]), float(sigmas[1] - sigmas[0]), passage))
    return found


def _to_origin(one: Array, other: Array) -> float:
    """Distance of the origin from the segment between two points (2,)."""
    along = other - one
    size = float(along @ along)
    part = 0.0 if size == 0.0 else min(max(float(-(one @ along)) / size, 0.0), 1.0)
    return float(np.linalg.norm(one + part * along))


def _refined(course: Course, string: String, middle: float, half: float, passage: Passage) -> Minimum:
    """The point of the string nearest to the body, by finer and finer strings; until it is out of reach."""
    last, lowest, radius = min(passage.epoch + GAP_S, course.last), np.inf, passage.capture_radius_km
    for _ in range(ROUNDS):
        near = middle + half * np.linspace(-1.0, 1.0, FINE)
        fine = _passage(course.fly(_strung(course, string, near), None, last), passage.body, passage.epoch)
        if fine is None:
            break
        reach = np.linalg.norm(fine.xi_zeta_km, axis=1)
        if not np.isfinite(reach).any():
            break
        best = int(np.nanargmin(reach))
        middle, half, lowest = float(near[best]), half / 4.0, float(reach[best])
        apart = np.linalg.norm(np.diff(fine.xi_zeta_km, axis=0), axis=1)[max(best - 1, 0) : best + 1]
        if apart.max() < ONE * radius or lowest - 2.0 * apart.max() > DEEP * radius:
            break
    return Minimum(
        body=passage.body, epoch=passage.epoch, sigma=middle, distance_km=lowest, capture_radius_km=radius
    )  # fmt: skip


def _passage(cloud: Cloud, body: str, near: Epoch) -> Passage | None:
    """The encounter of a cloud with a body about a time."""
    same = [one for one in cloud.passages if one.body == body and abs(one.epoch - near) < GAP_S]
    return min(same, key=lambda one: abs(one.epoch - near), default=None)
