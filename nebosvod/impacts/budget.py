"""What the probability of a virtual impactor hangs on: elasticities by source, from the draws that tell most of it."""

from nebosvod.errors import InputError
from nebosvod.estimation.accuracy.elasticity import ProbabilityBudget, probability_budget
from nebosvod.impacts.risk import VirtualImpactor
from nebosvod.orbits.uncertain import UncertainOrbit


def why_none(orbit: UncertainOrbit, one: VirtualImpactor) -> str:
    """Why there is no budget."""
    if not orbit.sources:
        return (
            f"the sources of the covariance are not known: {orbit.origin or orbit.name} tells one matrix and not what "
            "it was made of; a fit of its observations (nebosvod fit) knows them"
        )
    if one.hits.all():
        return "every drawn orbit hits: they tell nothing of what a certainty hangs on"
    return "fewer than two drawn orbits hit"


def budget_of(orbit: UncertainOrbit, one: VirtualImpactor) -> ProbabilityBudget | None:
    """The budget; None where the sources of the covariance are not known, hardly an orbit hits, or each of them does.

    Notes
    -----
    Weights of importance sampling are those of normalised densities, so that their total is the number of draws.
    """
    if not orbit.sources or one.hits.all():
        return None
    cloud = one.cloud
    weighed = bool((cloud.weights != 1.0).any())
    try:
        return probability_budget(
            cloud.deviations, one.passage.hits, orbit.sources, cloud.weights, float(len(cloud)) if weighed else None,
            orbit.responses, orbit.factor,
        )  # fmt: skip
    except InputError:  # fewer than two hits
        return None
