"""Who is solved for and in which coordinates: the split of a problem's parameters that all estimators share.

An estimated parameter with a prior is written x = mean + L y, where L is the factor of its prior covariance and
y has a unit prior. A prior of zero or singular covariance, a prior of 1e12 and parameters whose units differ by
1e12 are then the same case. A parameter without a prior is its own y.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.problem.problem import LinearProblem, Prior
from nebosvod.estimation.problem.square_root import covariance_factor, left_inverse, row_units

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CommonSource:
    """One prior as a source of error: how a unit draw of it enters the unknowns y and the groups left out.

    The error of the parameters about their assumed mean is eps = draw eta, eta ~ N(0, I_r), in truth.
    """

    name: str
    names: tuple[str, ...]  # k names: the estimated ones first, then those left out
    unknowns: slice  # its columns among y
    inverse: Array  # (r_y, k_e), left inverse of the assumed factor of the estimated names
    left_out: IntArray  # (k_j,) columns among the parameters left out
    draw: Array  # (k, r), factor of the true covariance, rows as names


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Partition:
    """Estimated parameters x = mean + T y and the considered and ignored ones left out of the estimate.

    Attributes
    ----------
    estimated, left_out : names, in the order of the blocks.
    T : shape (s, s_y); y are the parameters without a prior first, then the whitened ones prior by prior.
    mean : shape (s,), assumed means of the estimated parameters.
    left_out_mean : shape (s_j,).
    n_free : number of unknowns without a prior (the first of y).
    sources : one for each prior on a parameter that is not fixed.
    """

    estimated: tuple[str, ...]
    left_out: tuple[str, ...]
    T: Array
    mean: Array
    left_out_mean: Array
    n_free: int
    sources: tuple[CommonSource, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """All parameters that have an error: estimated, then left out."""
        return self.estimated + self.left_out

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns y."""
        return int(self.T.shape[1])

    @classmethod
    def of(cls, problem: LinearProblem) -> "Partition":
        """Split the parameters of a problem.

        Raises
        ------
        InputError
            If a prior correlates a fixed parameter with others, or its true covariance gives an error to a
            direction that the assumed, singular one holds exactly.
        """
        estimated = problem.names("estimated")
        left_out = problem.names("considered", "ignored")
        place = {name: index for index, name in enumerate(estimated)}
        place_out = {name: index for index, name in enumerate(left_out)}
        with_prior = {name for prior in problem.priors for name in prior.names}
        free = [index for name, index in place.items() if name not in with_prior]
        columns = [np.eye(len(estimated))[:, free]]
        mean, mean_out = np.zeros(len(estimated)), np.zeros(len(left_out))
        sources = []
        first = len(free)
        for prior in problem.priors:
            live = _live(prior, place, place_out)
            if not live:
                continue
            source, factor, assumed_mean = _common_source(prior, live, place, place_out, first)
            spread = np.zeros((len(estimated), factor.shape[1]))
            for row, name in enumerate(source.names):
                if name in place:
                    spread[place[name]] = factor[row]
                    mean[place[name]] = assumed_mean[row]
                else:
                    mean_out[place_out[name]] = assumed_mean[row]
            columns.append(spread)
            sources.append(source)
            first += factor.shape[1]
        return cls(
            estimated=estimated,
            left_out=left_out,
            T=np.hstack(columns),
            mean=mean,
            left_out_mean=mean_out,
            n_free=len(free),
            sources=tuple(sources),
        )


def _live(prior: Prior, place: dict[str, int], place_out: dict[str, int]) -> list[int]:
    """Indices of the prior's names that have an error: estimated first, then left out."""
    inside = [i for i, name in enumerate(prior.names) if name in place]
    outside = [i for i, name in enumerate(prior.names) if name in place_out]
    fixed = [i for i, name in enumerate(prior.names) if name not in place and name not in place_out]
    live = inside + outside
    for matrix in (prior.covariance, prior.truth):
        if live and fixed and matrix[np.ix_(live, fixed)].any():
            names = ", ".join(prior.names[i] for i in fixed)
            raise InputError(
                f"prior {prior.name}: {names} is fixed but correlated with parameters that are not; "
                "estimate or consider it, or give the prior without it"
            )
    return live


def _common_source(
    prior: Prior, live: list[int], place: dict[str, int], place_out: dict[str, int], first: int
) -> tuple[CommonSource, Array, Array]:
    """Build the source of one prior; also its assumed factor for the estimated names and its mean."""
    assert_mean = np.zeros(len(prior.names)) if prior.mean is None else prior.mean
    names = tuple(prior.names[i] for i in live)
    n_inside = sum(name in place for name in names)
    inside = live[:n_inside]
    factor = covariance_factor(prior.covariance[np.ix_(inside, inside)], f"prior {prior.name}")
    draw = factor
    if prior.true_covariance is not None or n_inside < len(live):
        draw = covariance_factor(prior.truth[np.ix_(live, live)], f"prior {prior.name}")
    unit = row_units(factor)
    inverse = _left_inverse(factor)
    lost = draw[:n_inside] - factor @ (inverse @ draw[:n_inside])
    if np.abs(lost / unit[:, None]).max(initial=0.0) > 1e-6:
        raise InputError(
            f"prior {prior.name}: the truth errs in a direction that the assumed, singular covariance holds exactly; "
            "consider or ignore that parameter instead"
        )
    source = CommonSource(
        name=prior.name,
        names=names,
        unknowns=slice(first, first + factor.shape[1]),
        inverse=inverse,
        left_out=np.array([place_out[name] for name in names[n_inside:]], dtype=np.int64),
        draw=draw,
    )
    return source, factor, assert_mean[live]


def _left_inverse(factor: Array) -> Array:
    """Left inverse (r, k) of a factor (k, r)."""
    if np.count_nonzero(factor) == factor.shape[0] == factor.shape[1] == np.count_nonzero(factor.diagonal()):
        return np.diag(1.0 / factor.diagonal())  # independent parameters, and the commonest case
    return left_inverse(factor)
