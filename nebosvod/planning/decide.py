"""`nebosvod plan ORBIT --decide`: what the probability of an impact may be after the next visit.

Truths are drawn from the cloud of the orbit, a visit of each is simulated, and the probability that would then be
known is computed for each. Their distribution tells whether a visit is likely to decide anything.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.impact import follow
from nebosvod.errors import GeometryError, ImpactError, InputError
from nebosvod.estimation.accuracy.preposterior import Foreseen, foresee
from nebosvod.estimation.accuracy.target_map import TargetMap
from nebosvod.impacts.cloud import Cloud, Passage
from nebosvod.impacts.flight import TOLERANCE, WIDER_KM, Course
from nebosvod.impacts.interval import of_count
from nebosvod.impacts.risk import passage_of
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.planning.coming import Visit, Watch, predictions, seen, visit
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Say = Callable[[str], None]
FEWEST_HITS = 10  # of a cloud, for a distribution of future probabilities
FLOWN = 3000
POOL = 300_000  # states among which those nearest to the target are looked for
FLOWN_TRUTHS = 100  # where every orbit drawn anew must be flown
MISJUDGED = 0.03  # of the hits: a map of the cloud that errs more is not used
MOST_CANDIDATES = 200
MOST_TIMES = 2000
AT_ONCE = 40_000  # states that are flown at a time, where the map of the cloud is not used
LEVELS = (0.01, 0.1, 0.25, 0.5, 0.75, 0.9, 0.99)


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """What is asked.

    Attributes
    ----------
    first, last : between which times visits may begin; step_s : from one candidate to the next.
    exposures, spacing_s : of a visit.
    until, bodies : which impacts count.
    draws, truths, seed : members of the cloud, simulated truths of each visit.
    flown : orbits that are flown to make the map of the cloud, which tells of the others.
    below, above : thresholds of the future probability; None: a tenth of P, and the midpoint between P and 1.
    """

    first: Epoch
    last: Epoch
    step_s: float
    exposures: int = 1
    spacing_s: float = 0.0
    until: Epoch
    bodies: Sequence[str] = ("earth", "moon")
    draws: int = 20_000
    truths: int = 2000
    seed: int = 1
    flown: int = FLOWN
    below: float | None = None
    above: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """What a visit may lead to; `hits` (t,): whether each of its truths hits."""

    visit: Visit
    foreseen: Foreseen
    hits: Mask

    @property
    def quantiles(self) -> dict[float, float]:
        """Of the future probability."""
        return {level: float(np.quantile(self.foreseen.probability, level)) for level in LEVELS}

    @property
    def bound(self) -> float | None:
        """Below which (95 %) future probabilities lie of which no orbit hits; None where each has one that does."""
        none = self.foreseen.probability <= 0.0
        return of_count(0, max(float(np.median(self.foreseen.effective[none])), 1.0))[1] if none.any() else None

    def chance_below(self, threshold: float) -> float:
        """That the future probability is below a threshold."""
        return float(np.mean(self.foreseen.probability < threshold))

    def chance_above(self, threshold: float) -> float:
        """That the future probability is above a threshold."""
        return float(np.mean(self.foreseen.probability > threshold))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Decision:
    """The whole answer.

    Attributes
    ----------
    probability : now, from the cloud. hits : members that hit.
    below, above : the thresholds.
    outcomes : by time.
    unseen : telescopes that see the object at no candidate time.
    flown : whether every orbit was flown; else the map of the first ones told of the others, `misjudged` how well.
    warnings : what a reader must know.
    """

    probability: float
    hits: int
    below: float
    above: float
    outcomes: tuple[Outcome, ...]
    unseen: tuple[str, ...]
    flown: bool
    misjudged: float
    warnings: tuple[str, ...]


def decide(
    orbit: UncertainOrbit, watches: Sequence[Watch], wanted: Wanted, ephemeris: Ephemeris,
    say: Say = lambda message: None,
) -> Decision:  # fmt: skip
    """Foresee the probability of an impact after each candidate visit.

    Raises
    ------
    InputError
        If what is asked cannot be; names the option.
    GeometryError
        If no telescope sees the object at a candidate time, or too few orbits of the cloud hit.
    """
    visits, unseen = _visits(orbit, watches, wanted, ephemeris)
    course = Course(
        orbit=orbit, ephemeris=ephemeris, last=wanted.until, bodies=tuple(wanted.bodies), within_km=WIDER_KM
    )  # fmt: skip
    rng = np.random.default_rng(np.random.SeedSequence(wanted.seed))
    u = rng.standard_normal((wanted.draws, len(orbit.factor)))
    say("flying the drawn orbits")
    first = u[: wanted.flown]
    cloud = course.fly(first @ orbit.factor.T)
    flown_hits = np.asarray(np.isin(cloud.body, course.bodies))
    maps = _maps(first, cloud, flown_hits, course, rng)
    flown = maps is None
    hit = _by_flight(course) if maps is None else _by_maps(maps)
    hits = np.concatenate([flown_hits, hit(u[wanted.flown :])])
    count = int(np.count_nonzero(hits))
    if count < FEWEST_HITS:
        raise GeometryError(
            f"{orbit.name}: {count} of {wanted.draws} drawn orbits hit {' or '.join(wanted.bodies)} until "
            f"{wanted.until.iso('utc', 0)[:10]}, too few to foresee a probability; give more --draws or another --until"
        )
    say("observing the drawn orbits")
    predicted = predictions(visits, orbit, u, ephemeris, TOLERANCE)
    now = count / wanted.draws
    outcomes = []
    for one, z in zip(visits, predicted, strict=True):
        say(f"foreseeing {one.telescope}, {(orbit.epoch + float(one.t_s[0])).iso('utc', 0)}")
        truths = min(wanted.truths, FLOWN_TRUTHS) if flown else wanted.truths
        foreseen = foresee(u, z, hits, rng, truths, hit=hit, draws=400 if flown else 1000)
        outcomes.append(Outcome(visit=one, foreseen=foreseen, hits=hits[foreseen.truth]))
    return Decision(
        probability=now,
        hits=count,
        below=0.1 * now if wanted.below is None else wanted.below,
        above=0.5 * (1.0 + now) if wanted.above is None else wanted.above,
        outcomes=tuple(outcomes),
        unseen=unseen,
        flown=flown,
        misjudged=0.0 if maps is None else float(max(one.error for one in maps)),
        warnings=tuple(_warnings(visits, outcomes, flown, 0.1 * now if wanted.below is None else wanted.below)),
    )


def _visits(
    orbit: UncertainOrbit, watches: Sequence[Watch], wanted: Wanted, ephemeris: Ephemeris
) -> tuple[list[Visit], tuple[str, ...]]:
    """Candidate visits that see the object, by time, and the telescopes that have none."""
    first, last = wanted.first - orbit.epoch, wanted.last - orbit.epoch
    count = int((last - first) / wanted.step_s + 1e-9) + 1
    if count * len(watches) > MOST_TIMES:
        raise InputError(f"--step: {count * len(watches):,} candidate times are too many (allowed {MOST_TIMES:,})")
    begin = first + wanted.step_s * np.arange(count)
    within = wanted.spacing_s * np.arange(wanted.exposures)
    whole = (min(first - SECONDS_PER_DAY, 0.0), float(begin[-1] + within[-1]))
    ephemeris.require(orbit.epoch, np.array(whole))
    try:
        trajectory = follow(orbit.state, orbit.epoch, whole, whole[1], orbit.forces(ephemeris), True)
    except ImpactError as error:
        raise InputError(f"--to: {orbit.name}: {error}") from None
    found, unseen = list[Visit](), list[str]()
    for watch in watches:
        times = begin[:, None] + within
        able = seen(watch, trajectory, times.ravel(), orbit, ephemeris).reshape(times.shape).all(axis=1)
        found += [visit(watch, trajectory, one, orbit, ephemeris) for one in times[able]]
        if not able.any():
            unseen.append(watch.telescope.name)
    if not found:
        raise GeometryError(f"{orbit.name}: no telescope sees it at a candidate time; widen --from and --to, or --step")
    if len(found) > MOST_CANDIDATES:
        raise InputError(f"--step: {len(found)} visits are possible, too many (allowed {MOST_CANDIDATES}); lengthen it")
    return sorted(found, key=lambda one: (float(one.t_s[0]), one.telescope)), tuple(unseen)


def _maps(u: Array, cloud: Cloud, hits: Mask, course: Course, rng: np.random.Generator) -> list[TargetMap] | None:
    """The cloud's own maps to the target planes where orbits hit; None where they do not tell hits well enough."""
    found = []
    for passage in cloud.passages:
        if passage.hits.any():
            one = TargetMap.of(u, passage.xi_zeta_km, passage.hits, passage.capture_radius_km)
            if one is not None and one.error > MISJUDGED:
                one = _nearer(one, u, passage, course, rng)
            if one is None or one.error > MISJUDGED:
                return None
            found.append(one)
    if not found or np.count_nonzero(_by_maps(found)(u) != hits) > MISJUDGED * np.count_nonzero(hits):
        return None
    return found


def _nearer(
    rough: TargetMap, u: Array, passage: Passage, course: Course, rng: np.random.Generator
) -> TargetMap | None:  # fmt: skip
    """The map with more orbits near the target: those of many that a first map leads nearest to it, flown too."""
    pool = rng.standard_normal((POOL, u.shape[1]))
    distance = np.linalg.norm(rough.rough(pool), axis=1)
    near = distance <= rough.reach
    distance[near] = np.linalg.norm(rough.fine(pool[near]), axis=1)
    chosen = pool[np.argsort(distance)[: len(u)]]
    there = passage_of(course.fly(chosen @ course.orbit.factor.T), passage.body, passage.epoch)
    if there is None:
        return None
    order = rng.permutation(2 * len(u))  # halves are compared
    points, hits = np.concatenate([passage.xi_zeta_km, there.xi_zeta_km]), np.concatenate([passage.hits, there.hits])
    return TargetMap.of(np.concatenate([u, chosen])[order], points[order], hits[order], passage.capture_radius_km)


def _by_maps(maps: Sequence[TargetMap]) -> Callable[[Array], Mask]:
    def hit(u: Array) -> Mask:
        return np.asarray(np.any([one.hit(u) for one in maps], axis=0))

    return hit


def _by_flight(course: Course) -> Callable[[Array], Mask]:
    def hit(u: Array) -> Mask:
        found = np.zeros(len(u), dtype=np.bool_)
        for start in range(0, len(u), AT_ONCE):
            part = slice(start, start + AT_ONCE)
            found[part] = np.isin(course.fly(u[part] @ course.orbit.factor.T).body, course.bodies)
        return found

    return hit


def _warnings(visits: Sequence[Visit], outcomes: Sequence[Outcome], flown: bool, below: float) -> list[str]:
    """What limits the answer."""
    said = [
        f"{name}: is taken as drawn anew for a visit, though it is correlated in time with past measurements"
        for name in dict.fromkeys(name for one in visits for name in one.chained)
    ]
    if flown:
        said.append(
            f"orbits are bent too much for a map to the target plane: they were flown, {FLOWN_TRUTHS} truths each"
        )
    poor = sum(int(np.count_nonzero(one.foreseen.effective < 50.0)) for one in outcomes)
    if poor:
        said.append(f"{poor} future probabilities rest on fewer than 50 orbits; give more --draws")
    bound = max((one.bound or 0.0 for one in outcomes), default=0.0)
    if bound > below:
        said.append(
            f"where no orbit that agrees with a visit hits, the probability is only known below {bound:.1g} (95 %), "
            f"and counts as below {below:.2g}"
        )
    return said
