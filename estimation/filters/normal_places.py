"""Normal places: arcs condensed to as many numbers as parameters, combined again as if never taken apart.

The measurements of an arc say about its parameters exactly what the square root of their normal equations says:
R x = d + N(0, I). Arcs combine by stacking, and a common nuisance keeps its one prior, applied once, when they are
combined. `GaussFilter` accumulates the normal equations themselves, the classical form: half the digits, the same
answer. Condensing hides correlation of the residuals: test their pattern (`consistency.residual_pattern`) before.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import Block, LinearProblem, Markov, White
from nebosvod.estimation.problem.square_root import (
    append_rows,
    conditioning,
    covariance_factor,
    solve_lower,
    solve_square,
    solve_upper,
)
from nebosvod.estimation.problem.whitening import Whitener, raw_rows

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NormalPlace:
    """What an arc says of its parameters x (k,), priors apart: R x = d + N(0, I).

    Attributes
    ----------
    name, names : of the arc; of its k parameters, those left out of the estimate included.
    R : shape (k, k), upper triangular; rows of zeros where the arc says nothing.
    d : shape (k,).
    misfit : chi2 of the arc's own best fit.
    count : measured numbers in the arc.
    """

    name: str
    names: tuple[str, ...]
    R: Array
    d: Array
    misfit: float
    count: int


def condense(problem: LinearProblem, name: str = "arc") -> NormalPlace:
    """Condense the measurements of a problem; its priors are not used.

    Raises
    ------
    InputError
        If assumed and true model of the measurements differ: one covariance is all that a normal place carries.

    Notes
    -----
    White and time-correlated nuisances that are estimated go into the weights. A time-correlated one must not run on
    from arc to arc: arcs are then not independent, and no normal places of them are exact.
    """
    nuisances: tuple[White | Markov, ...] = (*problem.white, *problem.markov)
    odd = any(white.true_Q is not None for white in problem.white) or any(one.differs for one in problem.markov)
    if problem.true_R is not None or odd:
        raise InputError("condense: assumed and true noise differ; condense with one of them")
    if any(nuisance.treatment in ("considered", "ignored") for nuisance in nuisances):
        raise InputError("condense: a considered or ignored nuisance of each measurement has no normal place")
    centred = replace(problem, priors=tuple(replace(prior, mean=None) for prior in problem.priors))
    partition = Partition.of(centred)
    rows = raw_rows(centred, partition)
    Whitener.of(centred).whiten(rows)
    s, k = len(partition.estimated), len(partition.names)
    order = [*range(s), *range(s + 1, k + 1), s]  # the residual last
    triangle = append_rows(np.zeros((k + 1, k + 1)), rows.reshape(-1, k + 1)[:, order])
    return NormalPlace(
        name=name,
        names=partition.names,
        R=triangle[:k, :k],
        d=triangle[:k, k],
        misfit=float(triangle[k, k] ** 2),
        count=problem.residual.size,
    )


def combine(places: Sequence[NormalPlace], like: LinearProblem) -> LinearProblem:
    """Make one problem of several arcs: each is a measurement of as many components as there are parameters.

    Parameters
    ----------
    places : the arcs, all about one linearisation point.
    like : gives blocks (names and treatments), priors and scale; its measurements are not used. A parameter that an
        arc does not have, such as the bias of an instrument that was off, has no partials there.

    Returns
    -------
    LinearProblem
        Its solution equals that of all measurements at once, chi2 included, and its noise source is that of all. The
        degrees of freedom are `sum(place.count) - parameters without a prior`.
    """
    if not places:
        raise InputError("combine: no normal places")
    place_of = {name: column for column, name in enumerate(n for block in like.blocks for n in block.names)}
    live = {n for block in like.blocks if block.treatment != "fixed" for n in block.names}
    size = len(place_of)
    H, residual = np.zeros((len(places), size + 1, size)), np.zeros((len(places), size + 1))
    for arc, place in enumerate(places):
        unknown = [name for name in place.names if name not in live]
        if unknown:
            raise InputError(f"combine: {place.name} has {unknown[0]!r}, which is not a parameter of the problem")
        k = len(place.names)
        H[np.ix_([arc], range(k), [place_of[name] for name in place.names])] = place.R
        residual[arc, :k] = place.d
        residual[arc, size] = np.sqrt(place.misfit)  # a row without partials keeps chi2 whole
    blocks = tuple(
        Block(name=b.name, names=b.names, H=H[:, :, [place_of[n] for n in b.names]], treatment=b.treatment)
        for b in like.blocks
    )
    return LinearProblem(residual=residual, R=np.eye(size + 1), blocks=blocks, priors=like.priors, scale=like.scale)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GaussFilter:
    """Gauss' accumulating filter: normal equations N x = b of everything so far, solved when an answer is wanted.

    N (s, s) and b (s,) are sums, so the order of the data does not matter, nothing has to be known beforehand, and
    filters of separate arcs are added. `cost` is the weighted square sum of the residuals at x = 0.
    """

    N: Array
    b: Array
    cost: float

    @classmethod
    def start(cls, size: int) -> "GaussFilter":
        """Nothing is known."""
        return cls(N=np.zeros((size, size)), b=np.zeros(size), cost=0.0)

    def add(self, residual: npt.ArrayLike, H: Array, R: Array) -> "GaussFilter":
        """Add a measurement residual = H x + v, residual (p,), H (p, s), v ~ N(0, R); a prior is one with H = I."""
        try:
            L = np.asarray(np.linalg.cholesky(R), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise GeometryError("GaussFilter: the measurement covariance is not positive definite") from None
        v = np.atleast_1d(np.asarray(residual, dtype=np.float64))
        rows = solve_lower(L, np.hstack([H, v[:, None]]))
        gram = rows.T @ rows
        return GaussFilter(N=self.N + gram[:-1, :-1], b=self.b + gram[:-1, -1], cost=self.cost + float(gram[-1, -1]))

    def __add__(self, other: "GaussFilter") -> "GaussFilter":
        """Join independent data about the same parameters."""
        return GaussFilter(N=self.N + other.N, b=self.b + other.b, cost=self.cost + other.cost)

    def move(self, F: Array, Q: Array) -> "GaussFilter":
        """Move what has been accumulated to the next epoch, x' = F x + w, w ~ N(0, Q): Genin's accumulation.

        Parameters
        ----------
        F : shape (s, s), regular. Q : shape (s, s), noise of the phase coordinates; singular allowed.

        Raises
        ------
        InputError
            If F is singular: then accumulated information has no place after the motion.

        Notes
        -----
        N' = (F N^-1 F^T + Q)^-1 without N^-1, which need not exist: with M = F^-T N F^-1, Q = G G^T and
        D = I + G^T M G, N' = M - M G D^-1 G^T M, b' = F^-T b - M G D^-1 G^T F^-T b. With measurements added the
        solution is the Kalman filter's. As printed on p. 90 the gain holds K^-1 where K is right, and on p. 88 the
        prior counts twice.

        References
        ----------
        Platonov, Ivanov 2013, Methods of measurement processing, pp. 88-90.
        """
        G = covariance_factor(np.asarray(Q, dtype=np.float64), "phase noise")
        try:
            turned = solve_square(F.T, np.hstack([self.N, self.b[:, None]]))
            M = solve_square(F.T, turned[:, :-1].T).T
        except np.linalg.LinAlgError:
            raise InputError("GaussFilter.move: the transition is singular") from None
        M, b = 0.5 * (M + M.T), turned[:, -1]
        L = np.asarray(np.linalg.cholesky(np.eye(G.shape[1]) + G.T @ M @ G), dtype=np.float64)
        half = solve_lower(L, np.hstack([G.T @ M, (G.T @ b)[:, None]]))
        gram = half.T @ half
        return GaussFilter(N=M - gram[:-1, :-1], b=b - gram[:-1, -1], cost=self.cost - float(gram[-1, -1]))

    def solution(self) -> tuple[Array, Array, float]:
        """Estimate (s,), factor (s, s) of its covariance, and chi2.

        Raises
        ------
        GeometryError
            While the normal matrix is singular to working accuracy.
        """
        lengths = np.sqrt(np.diag(self.N))
        unit = np.where(lengths > 0.0, lengths, 1.0)
        try:
            R = np.asarray(np.linalg.cholesky(self.N / unit[:, None] / unit), dtype=np.float64).T
        except np.linalg.LinAlgError:
            raise GeometryError("GaussFilter: the measurements do not determine all parameters") from None
        # Past 5e7 the normal equations, which square it, keep no digit.
        if conditioning(R).number > 5e7:
            raise GeometryError("GaussFilter: the normal equations cannot resolve all parameters")
        S = solve_upper(R, np.eye(len(R))) / unit[:, None]
        x = S @ (S.T @ self.b)
        return x, S, self.cost - float(x @ self.b)
