"""Importance sampling of orbits that hit: drawn about the most probable ones, weighed by prior over proposal.

Draws come from a mixture: normal ones about every hitting orbit that is known, wider than the orbits that hit, and a
tenth from the prior itself, which bounds the weights by ten. A first round of draws shows where the hits are; the
second, which counts, is drawn about them.

References
----------
Roa, Farnocchia, Chesley 2021, Astronomical Journal 162, 277.
Owen, Zhou 2000, Journal of the American Statistical Association 95, 135: the mixture with the prior.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from nebosvod.estimation.problem.square_root import solve_lower
from nebosvod.impacts.cloud import Cloud
from nebosvod.impacts.flight import Course
from nebosvod.impacts.hitting import AFTER_S, HittingOrbit
from nebosvod.impacts.interval import effective
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
PRIOR = 0.1
WIDER = 1.25
SCOUTS = 400
FEWEST = 1500


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Proposal:
    """A mixture in whitened deviations: means (k, n), lower factors (k, n, n), and a tenth of the standard normal."""

    means: Array
    factors: Array

    @classmethod
    def about(cls, orbits: Sequence[HittingOrbit]) -> "Proposal":
        """Wider than what the pseudo-observation leaves of each."""
        lower = [WIDER * np.linalg.cholesky(one.factor @ one.factor.T) for one in orbits]
        return cls(means=np.array([one.u for one in orbits]), factors=np.array(lower))

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Whitened deviations (count, n)."""
        k, n = self.means.shape
        u = rng.standard_normal((count, n))
        which = rng.choice(k + 1, size=count, p=[PRIOR, *np.full(k, (1.0 - PRIOR) / k)])
        for j in range(k):
            u[which == j + 1] = self.means[j] + u[which == j + 1] @ self.factors[j].T
        return u

    def weights(self, u: Array) -> Array:
        """Prior density over that of the mixture at (m, n); the powers of 2 pi cancel."""
        k = len(self.means)
        prior = -0.5 * np.sum(u**2, axis=1)
        parts = [np.log(PRIOR) + prior]
        for mean, factor in zip(self.means, self.factors):
            white = solve_lower(factor, (u - mean).T)
            size = np.sum(np.log(np.diag(factor)))
            parts.append(np.log((1.0 - PRIOR) / k) - size - 0.5 * np.sum(white**2, axis=0))
        weights: Array = np.exp(prior - logsumexp(np.array(parts), axis=0))
        return weights


def sample(
    course: Course, body: str, near: Epoch, orbits: Sequence[HittingOrbit], rng: np.random.Generator, wanted: int,
    most: int,
) -> Cloud:  # fmt: skip
    """A weighed cloud with at least so many effective hits of a body, if `most` draws can give them.

    Parameters
    ----------
    near : the encounter; nothing is flown beyond it.
    orbits : that hit there, from which to begin.
    """
    S, last = course.orbit.factor, min(near + AFTER_S + max(abs(one.epoch - near) for one in orbits), course.last)
    proposal = Proposal.about(orbits)
    scouts = proposal.draw(SCOUTS, rng)
    weights = proposal.weights(scouts)
    seen = course.fly(scouts @ S.T, weights, last)
    hits = seen.body == body
    if not hits.any():  # nothing there is in reach after all
        return seen
    rate = effective(weights[hits]) / SCOUTS
    if np.count_nonzero(hits) > 10 * S.shape[0] and len(orbits) == 1:
        proposal = _about_hits(scouts[hits], weights[hits])
        rate = max(rate, 0.25)
    count = int(np.clip(1.3 * wanted / max(rate, 1e-6), FEWEST, max(most, FEWEST)))
    u = proposal.draw(count, rng)
    return course.fly(u @ S.T, proposal.weights(u), last)


def _about_hits(u: Array, weights: Array) -> Proposal:
    """One component about the hits that were seen, a little wider than they are."""
    share = weights / weights.sum()
    mean = share @ u
    spread = (u - mean) * np.sqrt(share)[:, None]
    lower = np.linalg.cholesky(spread.T @ spread + 1e-12 * np.eye(u.shape[1]))
    return Proposal(means=mean[None], factors=WIDER * lower[None])
