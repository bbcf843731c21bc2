"""Which new states hit, by the cloud's own map from its states to a target plane."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.estimation.accuracy.polynomial import Polynomial

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
DEGREE = 3
TELLING = 50  # hits from which the radius is taken, and errors are counted
NEAREST = 10  # members near the target for each coefficient of the local map


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetMap:
    """States -> points of a target plane, by two polynomials: one of all members, one of those near the target.

    Attributes
    ----------
    rough, fine : both to points (xi, zeta); `reach` : how near the rough one must come for the fine one to be asked.
    radius : of the disc of hits.
    error : twice the error of the fine one over the radius, root mean square, or the share of misjudged hits where that
        is more: at members that had no part in a map made the same way.
    """

    rough: Polynomial
    fine: Polynomial
    reach: float
    radius: float
    error: float

    @classmethod
    def of(cls, u: Array, points: Array, hits: Mask, capture: float) -> "TargetMap | None":
        """The map of a cloud, and how well half of it tells of the other half; None where too few members are there.

        Parameters
        ----------
        u : shape (n, r). points : shape (n, 2), nan of members without the encounter. hits : shape (n,).
        capture : radius of the disc, for a cloud with too few hits to tell.
        """
        there = np.isfinite(points).all(axis=1)
        if np.count_nonzero(there) < 4 * Polynomial.terms(u.shape[1], DEGREE):
            return None
        half = np.arange(len(u)) % 2 == 0
        first = cls._made(u[there & half], points[there & half], hits[there & half], capture)
        other = there & ~half
        asked = np.linalg.norm(points[other], axis=1) <= first.reach
        off = np.linalg.norm(first.fine(u[other][asked]) - points[other][asked], axis=1)
        near = np.linalg.norm(points[other][asked], axis=1) <= 3.0 * first.radius
        error = 2.0 * float(np.sqrt(np.mean(off[near] ** 2))) / first.radius if near.any() else 0.0
        if np.count_nonzero(hits[~half]) >= TELLING:
            error = max(error, np.count_nonzero(first.hit(u[~half]) != hits[~half]) / np.count_nonzero(hits[~half]))
        whole = cls._made(u[there], points[there], hits[there], capture)
        return cls(rough=whole.rough, fine=whole.fine, reach=whole.reach, radius=whole.radius, error=error)

    @classmethod
    def _made(cls, u: Array, points: Array, hits: Mask, capture: float) -> "TargetMap":
        distance = np.linalg.norm(points, axis=1)
        count = min(NEAREST * Polynomial.terms(u.shape[1], DEGREE), len(u))
        near = np.argpartition(distance, count - 1)[:count]
        rough = Polynomial.through(u, points, DEGREE)
        off = np.linalg.norm(rough(u[near]) - points[near], axis=1).max()
        return cls(
            rough=rough,
            fine=Polynomial.through(u[near], points[near], DEGREE),
            reach=float(distance[near].max() + off),
            radius=_radius(distance, hits) if np.count_nonzero(hits) >= TELLING else capture,
            error=0.0,
        )

    def hit(self, u: Array) -> Mask:
        """Which states (k, r) hit."""
        near = np.linalg.norm(self.rough(u), axis=1) <= self.reach
        found = np.zeros(len(u), dtype=np.bool_)
        found[near] = np.linalg.norm(self.fine(u[near]), axis=1) <= self.radius
        return found


def _radius(distance: Array, hits: Mask) -> float:
    """The radius that tells hits from misses with the fewest errors."""
    order = np.argsort(distance)
    best = int(np.argmin(np.cumsum(np.where(hits[order], -1, 1))))
    after = distance[order[best + 1]] if best + 1 < len(order) else distance[order[best]]
    return float(0.5 * (distance[order[best]] + after))
