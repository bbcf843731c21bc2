"""Whether an orbit may hit: every way side by side, one of them recommended, for each virtual impactor.

A virtual impactor is a set of orbits inside of the confidence region that hit one body at one encounter. Plain draws,
the line of variations and the linear target plane look for them, each in its own way; from every one that is found the
most probable hitting orbit begins an importance sampling.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, Trajectory
from nebosvod.dynamics.impact import follow
from nebosvod.errors import EventError, InputError
from nebosvod.impacts.approaches import Approach, approaches_on, sigmas_to_hit
from nebosvod.impacts.bend import Bend, bend_of
from nebosvod.impacts.cloud import Cloud, Passage, draw
from nebosvod.impacts.coordinates import Coordinates
from nebosvod.impacts.flight import GAP_S, Course
from nebosvod.impacts.hitting import HittingOrbit, hitting_orbit
from nebosvod.impacts.importance import sample
from nebosvod.impacts.interval import effective
from nebosvod.impacts.left_out import left_out_sigmas
from nebosvod.impacts.line import NO_OBSERVATIONS, Line, line_of_variations
from nebosvod.impacts.string import Corrected
from nebosvod.impacts.ways import Way, by_importance, by_line, by_linear, by_sampling, recommended
from nebosvod.impacts.yarkovsky import with_yarkovsky
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
BODIES = ("earth", "moon")
WITHIN_AU = 0.1
FARTHEST = 7.0  # sigmas of a hitting orbit
SAME = 1.0  # sigmas between two hitting orbits that are one
MOST_STARTS = 12
EFFECTIVE = 2500  # hits that importance sampling aims at
CHECKED = 400  # and where plain draws have as many hits themselves, so that it only stands beside them


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VirtualImpactor:
    """One possible impact.

    Attributes
    ----------
    body, epoch, sigma_time_s : on what, when and within what spread.
    approach : of the estimate, at this encounter; None where it has none.
    orbits : the most probable ones that hit, of each separate part of the region.
    ways, recommended, reason : every way, which one is to be believed, and why.
    cloud, passage : the drawn orbits that tell most of it, and the encounter among theirs.
    sigmas_line : how many sigmas along the line of variations towards them the hits are; None without a line.
    stretching_km : how far one sigma along the line moves the point in the target plane.
    bend : how far from linear the target plane is about the estimate; None where the line has no encounter there.
    left_out_sigmas : how far asteroids that do not attract here may move it along the line; None where nothing tells.
    """

    body: str
    epoch: Epoch
    sigma_time_s: float
    approach: Approach | None
    orbits: tuple[HittingOrbit, ...]
    ways: tuple[Way, ...]
    recommended: str
    reason: str
    cloud: Cloud
    passage: Passage
    sigmas_line: float | None
    stretching_km: float | None
    bend: Bend | None
    left_out_sigmas: float | None = None

    @property
    def way(self) -> Way:
        """The recommended one."""
        return next(one for one in self.ways if one.name == self.recommended)

    @property
    def hits(self) -> npt.NDArray[np.bool_]:
        """Which orbits of `cloud` hit here."""
        return self.passage.hits


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Risk:
    """The whole answer: virtual impactors by date, the plain draws, and the line.

    Attributes
    ----------
    orbit : whose risk it is. on : from when years count.
    no_line : why there is no line of variations; empty otherwise.
    """

    orbit: UncertainOrbit
    impactors: tuple[VirtualImpactor, ...]
    cloud: Cloud
    line: Line | None
    no_line: str
    on: Epoch
    until: Epoch
    coordinates: Coordinates


def risk(
    orbit: UncertainOrbit, until: Epoch, ephemeris: Ephemeris, *, bodies: Sequence[str] = BODIES,
    on: Epoch | None = None, draws: int = 10_000, seed: int = 1, coordinates: Coordinates = "cartesian",
    diameter_km: float | None = None, corrected: Corrected | str = NO_OBSERVATIONS,
    say: Callable[[str], None] = lambda line: None,
) -> Risk:  # fmt: skip
    """Probability that an orbit hits a body until a date.

    Parameters
    ----------
    bodies : what may be hit: planets and "moon".
    on : from when years count; by default the last observation, else the epoch of the orbit, never the clock.
    diameter_km : by which an A2 that is not estimated is drawn, more than 20 years ahead; None: without.
    draws : orbits of the plain sampling, and the most of each importance sampling.
    coordinates : in which the confidence region is an ellipsoid.
    corrected : the line of variations along a direction by the observations, or why there is none.

    Raises
    ------
    InputError
        If the end is before the epoch, or the number of draws cannot be used.
    CoverageError
        If it is outside the ephemeris, with what to install.
    EventError
        If no drawn orbit can be flown: it is about another body, or below a surface.
    """
    if until <= orbit.epoch:
        raise InputError(f"--until: {until.iso('utc', 0)} is not after the epoch of the orbit, {orbit.epoch.iso()}")
    ephemeris.require(orbit.epoch, np.array([until - orbit.epoch]))
    given, orbit = orbit, with_yarkovsky(orbit, until, diameter_km)
    if orbit is not given:
        corrected = "an A2 is drawn of which the observations know nothing"
    streams = [np.random.default_rng(one) for one in np.random.SeedSequence(seed).spawn(2)]
    course = Course(orbit=orbit, ephemeris=ephemeris, last=until, bodies=tuple(bodies), coordinates=coordinates)
    say("flying the estimate")
    nominal, near, no_line = _estimate(course)
    course = replace(course, planes=tuple((one.body, one.epoch, one.plane.axes) for one in near if one.plane))
    line = None
    if nominal is not None:
        say("flying the line of variations")
        about = min((one.epoch - orbit.epoch for one in near), default=until - orbit.epoch)
        line = line_of_variations(course, nominal, min(about, nominal.span_s[1]), corrected)
    say(f"flying {draws} drawn orbits")
    cloud = course.fly(draw(orbit, draws, streams[0]))
    if len(cloud.lost) == len(cloud):
        raise EventError(f"{orbit.origin or orbit.name}: no drawn orbit can be flown: {no_line or cloud.lost[0]}")
    found = []
    for encounter in _encounters(near, line, cloud):
        say(f"looking at {encounter.body} on {encounter.epoch.iso('utc', 0)[:10]}")
        one = _impactor(course, encounter, near, line, cloud, streams[1], draws)
        if one is not None:
            found.append(one)
    found.sort(key=lambda one: one.epoch - orbit.epoch)
    return Risk(
        orbit=orbit, impactors=tuple(found), cloud=cloud, line=line, no_line=no_line,
        on=on or orbit.last_observation or orbit.epoch, until=until, coordinates=coordinates,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Encounter:
    """Where a hit is to be looked for, and whitened deviations (n,) from which to begin."""

    body: str
    epoch: Epoch
    beginnings: list[Array]


def _estimate(course: Course) -> tuple[Trajectory | None, list[Approach], str]:
    """The estimate with its sensitivities until the end or its impact, its approaches, or why there are none."""
    orbit, end = course.orbit, course.last - course.orbit.epoch
    try:
        nominal = follow(orbit.state, orbit.epoch, (0.0, end), 0.0, orbit.forces(course.ephemeris), True)
    except EventError as error:
        return None, [], f"the estimate cannot be flown: {error}"
    found = approaches_on(nominal, orbit.factor, (0.0, end), WITHIN_AU, course.bodies).found
    return nominal, [one for one in found if one.plane is not None], ""


def _encounters(near: Sequence[Approach], line: Line | None, cloud: Cloud) -> list[_Encounter]:
    """Every encounter at which any way sees a hit in reach."""
    found: list[_Encounter] = []
    size = cloud.deviations.shape[1]

    def add(body: str, epoch: Epoch, beginning: Array | None) -> None:
        same = [one for one in found if one.body == body and abs(one.epoch - epoch) < GAP_S]
        one = same[0] if same else _Encounter(body=body, epoch=epoch, beginnings=[])
        if not same:
            found.append(one)
        if beginning is not None:
            one.beginnings.append(beginning)

    if line is not None:
        for one in sorted(line.minima, key=lambda one: one.distance_km):
            add(one.body, one.epoch, line.string.at(np.array([one.sigma]))[0])
    for approach in near:
        if sigmas_to_hit(approach, FARTHEST) is not None:
            add(approach.body, approach.epoch, np.zeros(size))
    for passage in cloud.passages:
        if passage.hits.any():
            add(passage.body, passage.epoch, None)
    return found


def _impactor(
    course: Course, encounter: _Encounter, near: Sequence[Approach], line: Line | None, plain: Cloud,
    rng: np.random.Generator, draws: int,
) -> VirtualImpactor | None:  # fmt: skip
    """All ways at one encounter; None where none of them finds a hit."""
    body, epoch = encounter.body, encounter.epoch
    drawn = passage_of(plain, body, epoch)
    orbits = _hitting(course, encounter, drawn, plain)
    approach = min(
        (one for one in near if one.body == body and abs(one.epoch - epoch) < GAP_S),
        key=lambda one: abs(one.epoch - epoch), default=None,
    )  # fmt: skip
    seen = 0 if drawn is None else int(np.count_nonzero(drawn.hits))
    wanted = CHECKED if seen >= EFFECTIVE else EFFECTIVE
    weighed = sample(course, body, epoch, orbits, rng, wanted, draws) if orbits else None
    there = None if weighed is None else passage_of(weighed, body, epoch)
    ways = [by_linear(approach)]
    if line is not None:
        ways.append(by_line(line, orbits, body))
    if weighed is not None and there is not None:
        ways.append(by_importance(weighed, there))
    ways.append(by_sampling(plain, drawn))
    ways = [way for way in ways if way.probability is not None]  # the others do not apply here
    if not any(way.hits for way in ways):
        return None
    best, reason = recommended(ways)
    pairs = [(one, at) for one, at in ((plain, drawn), (weighed, there)) if one is not None and at is not None]
    cloud, passage = max(pairs, key=lambda pair: effective(pair[0].weights[pair[1].hits]))
    when, spread = _moment(cloud, passage)
    nu, stretching = _along(line, cloud, passage, orbits)
    string = None if line is None else passage_of(line.cloud, body, epoch)
    bend = None
    if line is not None and string is not None and nu is not None:
        bend = bend_of(line.sigmas, string.xi_zeta_km, string.capture_radius_km, nu)
    return VirtualImpactor(
        body=body, epoch=when, sigma_time_s=spread, approach=approach, orbits=tuple(orbits), ways=tuple(ways),
        recommended=best, reason=reason, cloud=cloud, passage=passage, sigmas_line=nu, stretching_km=stretching,
        bend=bend, left_out_sigmas=left_out_sigmas(course, body, orbits[0]) if orbits else None,
    )  # fmt: skip


def passage_of(cloud: Cloud, body: str, epoch: Epoch) -> Passage | None:
    """The encounter of a cloud with a body about a time."""
    same = [one for one in cloud.passages if one.body == body and abs(one.epoch - epoch) < GAP_S]
    return min(same, key=lambda one: abs(one.epoch - epoch), default=None)


def _hitting(course: Course, encounter: _Encounter, drawn: Passage | None, plain: Cloud) -> list[HittingOrbit]:
    """Hitting orbits from every beginning, each once, the most probable first."""
    beginnings = encounter.beginnings[:MOST_STARTS]
    if drawn is not None and drawn.hits.any():
        white = np.linalg.solve(course.orbit.factor, plain.deviations[drawn.hits].T).T
        beginnings = [white[np.argmin(np.sum(white**2, axis=1))], *beginnings]
    found: list[HittingOrbit] = []
    for beginning in beginnings:
        if any(np.linalg.norm(beginning - one.u) < 0.5 * SAME for one in found):
            continue
        one = hitting_orbit(course, encounter.body, encounter.epoch, beginning)
        if one is None or np.linalg.norm(one.u) > FARTHEST:
            continue
        if all(np.linalg.norm(one.u - other.u) > SAME for other in found):
            found.append(one)
    return sorted(found, key=lambda one: float(np.linalg.norm(one.u)))


def _moment(cloud: Cloud, passage: Passage) -> tuple[Epoch, float]:
    """Mean time and spread of the hits, by their weights."""
    t, w = passage.t_s[passage.hits], cloud.weights[passage.hits]
    mean = float(np.average(t, weights=w))
    return cloud.epoch + mean, float(np.sqrt(np.average((t - mean) ** 2, weights=w)))


def _along(
    line: Line | None, cloud: Cloud, passage: Passage, orbits: Sequence[HittingOrbit]
) -> tuple[float | None, float | None]:
    """Mean sigma of the hits along the line towards them, and how far one sigma moves the point in the target plane."""
    if line is None or not orbits:
        return None, None
    string = line.toward(orbits[0])
    white = np.asarray(np.linalg.solve(line.course.orbit.factor, cloud.deviations[passage.hits].T).T, dtype=np.float64)
    nu = float(np.average(string.sigma_of(white), weights=cloud.weights[passage.hits]))
    return nu, float(np.linalg.norm(orbits[0].J @ string.direction))
