"""The worst case of a prediction after some visits: whatever the correlation of the errors, or inside boxes.

`minimax`: the largest sigma of a component of the prediction over all correlations that errors of the stated sigmas may
have among each other, for the linear estimate that makes it smallest (Lidov). `guaranteed`: the largest error when each
stays within three sigmas. Which visits make it smallest is a choice among subsets: made greedily, then each visit is
exchanged for a better one while there is any. All candidates together bound what any choice can reach.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError
from nebosvod.estimation import LinearProblem
from nebosvod.estimation.accuracy.guaranteed import largest_error
from nebosvod.estimation.problem.whitening import add_white
from nebosvod.planning.visits import Candidates

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Worst = Literal["minimax", "guaranteed"]
LEVEL = {"minimax": 1.0, "guaranteed": 3.0}
BETTER = 1e-9  # part of the bound by which an exchange must be better, or round-off would exchange for ever


class WorstCase:
    """Bounds of one prediction for sets of candidates.

    Parameters
    ----------
    offered : the mission's measurements and the candidates.
    W, names : partials (d, k) of the prediction's components by the parameters.
    overlapping : takes numbers of candidates, says which (c,) cannot be made beside them.

    References
    ----------
    Lidov 1964; Eneev, Zolotukhina; as in Platonov, Ivanov 2013, Methods of measurement processing, pp. 131-138.
    """

    def __init__(
        self,
        offered: Candidates,
        W: Array,
        names: tuple[str, ...],
        criterion: Worst,
        overlapping: Callable[[Sequence[int]], Mask],
    ) -> None:
        self.W, self.names, self.overlapping = W, names, overlapping
        self.level = LEVEL[criterion]
        problem = together(offered.problem) if criterion == "minimax" else offered.problem
        self.offered = replace(offered, problem=problem)

    @property
    def count(self) -> int:
        """How many candidates there are."""
        return len(self.offered.rows)

    def after(self, taken: Sequence[int]) -> float:
        """The bound with the mission's measurements and some candidates; inf where they do not determine it."""
        try:
            return float(np.max(largest_error(self.offered.with_one(taken), self.W, self.names, self.level)))
        except GeometryError:
            return np.inf

    def each(self, taken: Sequence[int]) -> Array:
        """Bounds (c,) after each candidate on top of those taken; inf for these and those they overlap."""
        closed = self.overlapping(taken)
        found = np.full(self.count, np.inf)
        for k in np.flatnonzero(~closed).tolist():
            found[k] = self.after([*taken, k])
        return found

    def along(self, taken: Sequence[int]) -> list[float]:
        """Bounds after each of some visits in turn."""
        return [self.after(taken[: k + 1]) for k in range(len(taken))]

    def best(self, visits: int, hours: Array, first: Array) -> list[int]:
        """Numbers of the visits that make the bound small, the one that shrinks it most an hour first.

        Parameters
        ----------
        hours : (c,) that each candidate takes; exchanges are among those that take no more.
        first : (c,) bounds after one candidate.
        """
        taken = self._greedy(visits, hours, first)
        bound, changed = self.after(taken), True
        while changed and len(taken) > 1:
            changed = False
            for place in range(len(taken)):
                rest = [*taken[:place], *taken[place + 1 :]]
                others = self.each(rest)
                others[hours > hours[taken[place]]] = np.inf
                k = int(np.argmin(others))
                if others[k] < bound * (1.0 - BETTER):
                    taken, bound, changed = [*rest, k], float(others[k]), True
        return taken

    def _greedy(self, visits: int, hours: Array, first: Array) -> list[int]:
        taken: list[int] = []
        bounds, present = first, self.after([])
        for _ in range(min(visits, self.count)):
            if not np.isfinite(bounds).any():
                break
            # from no bound at all to some: the smallest
            gain = (present - bounds) / hours if np.isfinite(present) else -bounds
            taken.append(int(np.argmax(gain)))
            present = float(bounds[taken[-1]])
            bounds = self.each(taken)
        return taken

    def floor(self) -> float:
        """The bound with all candidates, which no choice among them can pass."""
        return self.after(range(self.count))


def together(problem: LinearProblem) -> LinearProblem:
    """The problem with its white nuisances counted into the noise of each measured component."""
    noise = np.array(np.broadcast_to(problem.truth, (problem.n, problem.p, problem.p)))
    for white in problem.white:
        if white.treatment != "fixed":
            add_white(noise, white, white.truth)
    return replace(problem, R=noise, true_R=None, white=())
