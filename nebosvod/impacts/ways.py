"""The answers of several ways to one question, how probable a hit is, and which of them to believe."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nebosvod.impacts.approaches import Approach
from nebosvod.impacts.cloud import Cloud, Passage
from nebosvod.impacts.hitting import HittingOrbit
from nebosvod.impacts.interval import effective, of_count, of_weights
from nebosvod.impacts.line import Line

ENOUGH = 400  # hits of plain draws: a probability to 5 %
FEW = 50  # effective hits below which a sampling is a hint
WIDER = 1.68  # an interval of 99.9 % over one of 95 %
WORDS = {
    "linear": "linear target plane",
    "line_of_variations": "line of variations",
    "importance_sampling": "importance sampling",
    "sampling": "plain sampling",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Way:
    """One answer to the question how probable a hit is.

    Attributes
    ----------
    name : linear, line_of_variations, importance_sampling or sampling.
    probability, low, high : and its interval at 95 %, of a sampling; of the others the interval is the number itself.
        Of no hit low is 0 and high a bound. The probability is None where the way has no answer.
    draws, hits, effective : orbits flown, how many hit, and the effective number of hits; 0 where nothing was drawn.
    note : what limits it.
    """

    name: str
    probability: float | None
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


def _number(name: str, value: float | None, note: str = "") -> Way:
    return Way(name=name, probability=value, low=value or 0.0, high=1.0 if value is None else value, note=note)


def by_linear(approach: Approach | None) -> Way:
    """By the target plane of the estimate."""
    if approach is None:
        return _number("linear", None, "the estimate itself has no approach within 0.1 au there")
    return _number("linear", approach.probability)


def by_line(line: Line, orbits: Sequence[HittingOrbit], body: str) -> Way:
    """By the line of variations: each separate part of it that comes in reach."""
    if not orbits:
        return _number("line_of_variations", None, "no orbit near the line hits")
    parts = [line.probability(one, body) for one in orbits]
    note = f"straight, {line.why_straight}" if line.why_straight else "curved, corrected to the observations"
    note += f"; {len(parts)} separate parts of the line" if len(parts) > 1 else ""
    return _number("line_of_variations", min(float(sum(parts)), 1.0), note)


def by_sampling(cloud: Cloud, passage: Passage | None) -> Way:
    """By plain draws."""
    hits = 0 if passage is None else int(np.count_nonzero(passage.hits))
    low, high = of_count(hits, len(cloud))
    return Way(
        name="sampling", probability=hits / len(cloud), low=low, high=high, draws=len(cloud), hits=hits,
        effective=float(hits),
    )  # fmt: skip


def by_importance(cloud: Cloud, passage: Passage) -> Way:
    """By weighed draws about the orbits that hit."""
    value, low, high = of_weights(cloud.weights, passage.hits)
    hits, number = int(np.count_nonzero(passage.hits)), effective(cloud.weights[passage.hits])
    return Way(
        name="importance_sampling", probability=value, low=low, high=high, draws=len(cloud), hits=hits,
        effective=number, note="" if number >= FEW else f"only {number:.0f} effective hits",
    )  # fmt: skip


def recommended(ways: Sequence[Way]) -> tuple[str, str]:
    """Which way to believe, and why.

    Notes
    -----
    Plain sampling assumes least, and decides where it has hits enough. Else importance sampling, which assumes that
    every part of the region that hits was found: agreement with the line and the plain draws is said. The linear answer
    and that of the line are recommended by nobody; they are judged.
    """
    by_name = {way.name: way for way in ways}
    plain, weighed = by_name["sampling"], by_name.get("importance_sampling")
    sharp = weighed is not None and (plain.hits == plain.draws or _relative(plain) < 1.5 * _relative(weighed))
    if plain.hits >= ENOUGH or weighed is None or weighed.effective < FEW or sharp:
        best, why = plain, f"{plain.hits} of {plain.draws} drawn orbits hit, and it assumes nothing but the covariance"
        if plain.hits < FEW and plain.hits < plain.draws:
            why += "; they are few, draw more"
    else:
        best = weighed
        why = (
            f"{weighed.effective:.0f} effective hits, where plain sampling has {plain.hits} of {plain.draws}; "
            f"it assumes that no other part of the region hits"
        )
        if plain.hits and not _overlap(plain, weighed):
            best = plain
            why = f"plain draws hit more often than where importance sampling looks: {plain.hits} of {plain.draws}"
    said = [
        f"{WORDS[way.name]} {_judged(way, best)}" for way in ways if way is not best and way.probability is not None
    ]
    return best.name, "; ".join([why, *said])


def _relative(way: Way) -> float:
    """Width of the interval over the probability."""
    return (way.high - way.low) / way.probability if way.probability else np.inf


def _overlap(one: Way, other: Way) -> bool:
    """Whether two samplings can both be right: by intervals of 99.9 %."""
    low, high = zip(*(_wide(way) for way in (one, other)))
    return bool(max(low) <= min(high))


def _wide(way: Way) -> tuple[float, float]:
    """The interval at 99.9 %, from that at 95 %."""
    p = way.probability or 0.0
    return (p * (way.low / p) ** WIDER if p else 0.0), (p * (way.high / p) ** WIDER if p else way.high * 2.3)


def _judged(way: Way, best: Way) -> str:
    """Whether a way agrees with the recommended one."""
    if way.draws:
        return "agrees" if _overlap(way, best) else "disagrees"
    value, margin = way.probability or 0.0, 0.05 * (best.probability or 0.0)
    low, high = _wide(best)
    return "agrees" if low - margin <= value <= high + margin else "disagrees"


def agree(way: Way, best: Way) -> bool:
    """Whether a way and the recommended one can both be right."""
    return _judged(way, best) == "agrees"
