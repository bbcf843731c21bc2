"""Whether an orbit may hit: every way side by side, one of them recommended, for each virtual impactor.

A virtual impactor is a set of orbits inside of the confidence region that hit one body at one encounter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nebosvod.dynamics import Ephemeris
from nebosvod.errors import InputError
from nebosvod.impacts.approaches import Approach, approaches
from nebosvod.impacts.cloud import Cloud, draw
from nebosvod.impacts.flight import fly
from nebosvod.impacts.interval import LEVEL, effective, of_count
from nebosvod.impacts.scales import diameter_km, energy_mt, palermo, torino
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

BODIES = ("earth", "moon")
WITHIN_AU = 0.1
LEAST = 1e-10  # linear probability of an encounter without a drawn hit that is still told of
YEAR_S = 365.25 * SECONDS_PER_DAY


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Way:
    """One answer to the question how probable a hit is.

    Attributes
    ----------
    name : linear, line_of_variations, importance_sampling or sampling.
    probability, low, high : and its interval at 95 %; of no hit low is 0 and high a bound.
    draws, hits, effective : orbits flown and how many hit; effective number of hits; 0 where nothing was drawn.
    note : what limits it.
    """

    name: str
    probability: float
    low: float
    high: float
    draws: int = 0
    hits: int = 0
    effective: float = 0.0
    note: str = ""

    @property
    def is_bound(self) -> bool:
        """Whether no orbit hit, so that only the bound is known."""
        return self.draws > 0 and self.hits == 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VirtualImpactor:
    """One possible impact.

    Attributes
    ----------
    body, epoch, sigma_time_s : on what, when and within what spread.
    approach : of the estimate, at this encounter.
    passage : the number of the encounter among those of the cloud.
    ways, recommended, reason : every way, which one is to be believed, and why.
    energy_mt, palermo, torino : of the Earth; None for other bodies and without a magnitude.
    """

    body: str
    epoch: Epoch
    sigma_time_s: float
    approach: Approach
    passage: int
    ways: tuple[Way, ...]
    recommended: str
    reason: str
    energy_mt: float | None
    palermo: float | None
    torino: int | None

    @property
    def way(self) -> Way:
        """The recommended one."""
        return next(one for one in self.ways if one.name == self.recommended)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Risk:
    """The whole answer: virtual impactors by date, and the cloud that was drawn."""

    impactors: tuple[VirtualImpactor, ...]
    cloud: Cloud
    on: Epoch
    until: Epoch


def risk(
    orbit: UncertainOrbit, until: Epoch, ephemeris: Ephemeris, *, bodies: Sequence[str] = BODIES,
    on: Epoch | None = None, draws: int = 10_000, seed: int = 1,
) -> Risk:  # fmt: skip
    """Probability that an orbit hits a body until a date.

    Parameters
    ----------
    bodies : what may be hit: planets and "moon".
    on : from when the years of the Palermo scale count; the epoch of the orbit by default, never the clock.
    draws : orbits of the plain sampling.

    Raises
    ------
    InputError
        If the end is before the epoch, or the number of draws cannot be used.
    CoverageError
        If it is outside the ephemeris, with what to install.
    """
    if until <= orbit.epoch:
        raise InputError(f"--until: {until.iso('utc', 0)} is not after the epoch of the orbit, {orbit.epoch.iso()}")
    on = orbit.epoch if on is None else on
    near = [
        one for one in approaches(orbit, orbit.epoch, until, WITHIN_AU, ephemeris).found
        if one.body in bodies and one.plane is not None
    ]  # fmt: skip
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    deviations = draw(orbit, draws, rng)
    cloud = fly(orbit, deviations, np.ones(draws), until, near, ephemeris)
    told = [k for k, one in enumerate(near) if cloud.passages[k].hits.any() or (one.probability or 0.0) >= LEAST]
    found = [_impactor(orbit, near[k], k, cloud, on) for k in told]
    return Risk(impactors=tuple(found), cloud=cloud, on=on, until=until)


def _impactor(orbit: UncertainOrbit, one: Approach, number: int, cloud: Cloud, on: Epoch) -> VirtualImpactor:
    """One encounter of the estimate, with the linear answer and that of the drawn orbits."""
    passage = cloud.passages[number]
    hits, there = int(np.count_nonzero(passage.hits)), cloud.weights[passage.hits]
    low, high = of_count(hits, len(cloud))
    ways = [
        Way(name="linear", probability=one.probability or 0.0, low=one.probability or 0.0, high=one.probability or 0.0),
        Way(
            name="sampling", probability=cloud.probability(passage.hits), low=low, high=high, draws=len(cloud),
            hits=hits, effective=effective(there),
        ),
    ]  # fmt: skip
    times = passage.t_s[passage.hits] if hits else passage.t_s[np.isfinite(passage.t_s)]
    epoch = cloud.epoch + float(np.median(times)) if len(times) else one.epoch
    years = (epoch - on) / YEAR_S
    chance = ways[1].probability if hits else ways[0].probability
    energy = None
    if one.body == "earth" and orbit.magnitude is not None:
        speed = float(np.hypot(passage.v_infinity_km_s, 11.186))
        energy = energy_mt(diameter_km(orbit.magnitude[0]), speed)
    return VirtualImpactor(
        body=one.body, epoch=epoch, sigma_time_s=float(np.std(times)) if len(times) > 1 else one.sigma_time_s,
        approach=one, passage=number, ways=tuple(ways), recommended="sampling",
        reason=f"it assumes nothing: {hits} of {len(cloud)} drawn orbits hit ({LEVEL:.0%} interval)",
        energy_mt=energy, palermo=None if energy is None else palermo(chance, energy, years),
        torino=None if energy is None else torino(chance, energy, years),
    )  # fmt: skip
