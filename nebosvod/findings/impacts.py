"""Encounters that may be impacts: each once, whatever was asked about it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from nebosvod.engine.facts import EncounterFacts, encounter_of
from nebosvod.engine.quantity import time_scale
from nebosvod.findings.drawn import HitShare
from nebosvod.findings.prediction import Answered, Prediction
from nebosvod.timescale import SECONDS_PER_DAY, Scale

LEAST = 1e-6  # a chance of impact smaller than this is not spoken of, unless a drawn orbit hits


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Impact:
    """An encounter of the orbit of one estimator that may be an impact.

    Attributes
    ----------
    predictions : names of those that are about it.
    probability : linear; drawn : by drawn orbits, None where none were drawn.
    sigma_time_s : of the closest approach, or of the entry first asked about; None where no prediction exists.
    time_scale : its times are told in.
    """

    encounter: EncounterFacts
    estimator: str
    predictions: tuple[str, ...]
    probability: float
    drawn: HitShare | None
    sigma_time_s: float | None
    time_scale: Scale

    @property
    def told(self) -> bool:
        """Whether it is worth a word."""
        return self.encounter.impact or self.probability >= LEAST or bool(self.drawn is not None and self.drawn.hits)


def impacts_of(predictions: Sequence[Prediction]) -> list[Impact]:
    """Each encounter of the first estimator that may be an impact, once.

    Probability and time come from the first prediction of an encounter that has them; a Monte Carlo one goes before
    none.
    """
    found: list[Impact] = []
    for row in predictions:
        one = _impact(row) if row.estimator == predictions[0].estimator else None
        if one is None:
            continue
        place = next((k for k, other in enumerate(found) if _same(other, one)), None)
        if place is None:
            found.append(one)
        else:
            found[place] = _joined(found[place], one)
    return [one for one in found if one.told]


def _impact(row: Prediction) -> Impact | None:
    """What one prediction says; None where it is about no impact."""
    encounter = encounter_of(row.facts)
    if encounter is None or row.impact_probability is None:
        return None
    known = row if isinstance(row, Answered) else None
    return Impact(
        encounter=encounter,
        estimator=row.estimator,
        predictions=(row.request.name,),
        probability=row.impact_probability,
        drawn=None if known is None else known.drawn_impacts,
        sigma_time_s=None if known is None else known.sigma_time_s,
        time_scale="utc" if encounter.body == "earth" else time_scale(row.request),
    )


def _same(one: Impact, other: Impact) -> bool:
    """Whether both are the same encounter: one body, within a day."""
    apart = one.encounter.closest_approach - other.encounter.closest_approach
    return one.encounter.body == other.encounter.body and abs(apart) < SECONDS_PER_DAY


def _joined(one: Impact, more: Impact) -> Impact:
    """An encounter with what a further prediction knows of it."""
    return replace(
        one,
        predictions=one.predictions + more.predictions,
        drawn=more.drawn if one.drawn is None else one.drawn,
        sigma_time_s=more.sigma_time_s if one.sigma_time_s is None else one.sigma_time_s,
    )
