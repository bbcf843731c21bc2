"""What an estimator returns: the estimate, what it believes of its errors, what they are, and from which source.

Every source of error g is kept as a factor G_g: (estimate - truth) = sum_g G_g eta_g with eta_g ~ N(0, I)
independent. The rows of G_g run over the estimated parameters and those left out (considered, ignored), whose
"estimate" is their assumed mean. So K_true = sum G_g G_g^T holds by construction, a prediction w = W x has the
factors W G_g with all cross terms, and nothing needs a covariance to be subtracted from another.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.problem.square_root import lower_factor

Array = npt.NDArray[np.float64]


class Status(StrEnum):
    """How an estimator ended; `sentence` says it to a person."""

    CONVERGED = "converged"
    ITERATION_LIMIT = "iteration_limit"
    NOT_OBSERVABLE = "not_observable"
    DIVERGED = "diverged"

    @property
    def sentence(self) -> str:
        """The status in words."""
        return _SENTENCES[self]


_SENTENCES = {
    Status.CONVERGED: "The estimate is at the minimum of the cost.",
    Status.ITERATION_LIMIT: "The iteration limit was reached before the steps became small against sigma.",
    Status.NOT_OBSERVABLE: "The measurements and priors do not determine all estimated parameters.",
    Status.DIVERGED: "No step, however short, made the cost smaller, or whole steps ran away from its minimum.",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class History:
    """Sigmas of the estimated parameters after each measurement, shape (n, s); inf before they are determined.

    `sigma` is the true one; None where it is not computed (see `recursive.solve`).
    """

    names: tuple[str, ...]
    sigma_formal: Array
    sigma: Array | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """Error of a predicted quantity w = W x, shape (d,): covariance, its factor, and shares by source.

    `value` is W applied to the estimated deviations. `factor` (d, d) is lower triangular, covariance = factor
    factor^T; the shares sum to the covariance.
    """

    value: Array
    factors: Mapping[str, Array]
    factor_formal: Array

    @property
    def covariance(self) -> Array:
        """True covariance (d, d)."""
        return _sum_of_squares(self.factors, len(self.value))

    @property
    def covariance_formal(self) -> Array:
        """Covariance (d, d) the estimator believes."""
        return self.factor_formal @ self.factor_formal.T

    @property
    def factor(self) -> Array:
        """Lower triangular factor (d, d) of the true covariance."""
        return _joint_factor(self.factors, len(self.value))

    @property
    def shares(self) -> dict[str, Array]:
        """Covariance (d, d) that each source contributes."""
        return {name: G @ G.T for name, G in self.factors.items()}

    @property
    def sigma(self) -> Array:
        """True standard deviation of each component (d,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def sigma_formal(self) -> Array:
        """Standard deviation (d,) the estimator believes."""
        return np.sqrt(np.diag(self.covariance_formal))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solution:
    """The numbers of an estimate that exist only where the problem is observable.

    Attributes
    ----------
    mean : shape (s,), estimated deviations from the linearisation point.
    mean_left_out : shape (s_j,), assumed deviations of the considered and ignored parameters.
    S_formal : shape (s, r), K_formal = S_formal S_formal^T.
    factors : source -> G (s + s_j, r_g).
    gains : common source -> M (s + s_j, k), the shift of estimate minus truth by a mean error of the source.
    gain_names : common source -> its k parameter names.
    residual_after : shape (n, p), residual minus what the common parameters explain.
    """

    mean: Array
    mean_left_out: Array
    S_formal: Array
    factors: Mapping[str, Array]
    gains: Mapping[str, Array]
    gain_names: Mapping[str, tuple[str, ...]]
    residual_after: Array
    chi2: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimate:
    """Result of an estimator.

    Attributes
    ----------
    names : s estimated parameters; `left_out` those considered or ignored.
    status, message : how it ended, as a word and as a sentence.
    dof : measurements minus parameters without a prior.
    condition_number, rank : of the column-scaled whitened rows.
    weak_direction : the worst determined combination, largest weight 1, by parameter name.
    history : sigmas after each measurement (recursive estimators).

    Notes
    -----
    When the status is `not_observable` there is no covariance; asking for one raises GeometryError.
    """

    names: tuple[str, ...]
    left_out: tuple[str, ...]
    status: Status
    message: str
    dof: int
    condition_number: float
    rank: int
    weak_direction: dict[str, float]
    solution: Solution | None
    history: History | None = None
    notes: tuple[str, ...] = field(default=())

    @property
    def _found(self) -> Solution:
        if self.solution is None:
            raise GeometryError(self.message, rank=self.rank, weak_direction=self.weak_direction)
        return self.solution

    @property
    def mean(self) -> Array:
        """Estimated deviations (s,) from the linearisation point."""
        return self._found.mean

    @property
    def chi2(self) -> float:
        """Cost at the minimum, priors and nuisances included."""
        return self._found.chi2

    @property
    def residual_after(self) -> Array:
        """Residuals (n, p) after the common parameters."""
        return self._found.residual_after

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the error sources."""
        return tuple(self._found.factors)

    @property
    def S_formal(self) -> Array:
        """Factor (s, r) of the covariance the estimator believes."""
        return self._found.S_formal

    @property
    def K_formal(self) -> Array:
        """Covariance (s, s) the estimator believes."""
        return self.S_formal @ self.S_formal.T

    @property
    def S_true(self) -> Array:
        """Lower triangular factor (s, s) of the true covariance."""
        return _joint_factor(self._factors(self.names), len(self.names))

    @property
    def K_true(self) -> Array:
        """True covariance (s, s) of estimate minus truth."""
        return _sum_of_squares(self._factors(self.names), len(self.names))

    @property
    def shares(self) -> dict[str, Array]:
        """Covariance (s, s) contributed by each source; they sum to K_true."""
        return {name: G @ G.T for name, G in self._factors(self.names).items()}

    def sigma(self, name: str) -> float:
        """True standard deviation of one parameter."""
        return float(np.sqrt(self.covariance((name,))[0, 0]))

    def sigma_formal(self, name: str) -> float:
        """Standard deviation of one estimated parameter as the estimator believes."""
        return float(np.linalg.norm(self.S_formal[self._index((name,))[0]]))

    def value(self, name: str) -> float:
        """Estimated deviation of one parameter from the linearisation point."""
        return float(np.concatenate([self.mean, self._found.mean_left_out])[self._index((name,))[0]])

    def covariance(self, names: Sequence[str]) -> Array:
        """True covariance of some parameters, in the order of the names."""
        return _sum_of_squares(self._factors(names), len(names))

    def factor(self, names: Sequence[str]) -> Array:
        """Lower triangular factor of `covariance(names)`."""
        return _joint_factor(self._factors(names), len(names))

    def shift(self, source: str, error: npt.ArrayLike) -> Array:
        """Shift (s,) of the estimate by an error (k,) in the assumed mean of a common source (truth - assumed)."""
        gains = self._found.gains
        if source not in gains:
            raise InputError(f"shift: no common source {source!r}; there are {', '.join(gains) or 'none'}")
        moved: Array = gains[source][: len(self.names)] @ np.asarray(error, dtype=np.float64)
        return moved

    def mean_shift(self, means: Mapping[str, float], names: Sequence[str] | None = None) -> Array:
        """Mean of estimate minus truth (k,) where the errors of common parameters have means of their own.

        Parameters
        ----------
        means : parameter name -> mean of truth minus assumed value; a parameter not named has none. Considered,
            ignored and estimated parameters with a prior.
        names : k parameters the shift is wanted of, by default all estimated ones; those left out may be among them.

        Raises
        ------
        InputError
            If a parameter has no prior, and so no assumed value to err from, or no error at all.

        Notes
        -----
        sum_g M_g mu_g over the groups g; a predicted w = W x is shifted by W mean_shift(means, names of W), the groups
        in the prediction itself included. Guo, Ivashkin 2018, (3.2), (3.5). Means of errors that are fresh at each
        measurement: `mean_error.shift`.
        """
        found = self._found
        known = {name for group in found.gain_names.values() for name in group}
        unknown = [name for name in means if name not in known]
        if unknown:
            have = ", ".join(sorted(known)) or "none"
            raise InputError(f"mean_shift: {unknown[0]!r} has no assumed value to err from; those with one: {have}")
        moved = np.zeros(len(self.names) + len(self.left_out))
        for source, M in found.gains.items():
            moved += M @ np.array([float(means.get(name, 0.0)) for name in found.gain_names[source]])
        wanted: Array = moved[self._index(self.names if names is None else names)]
        return wanted

    def predict(self, W: Mapping[str, npt.ArrayLike] | npt.ArrayLike, names: Sequence[str] | None = None) -> Prediction:
        """Predict w = W x with its error and the share of each source.

        Parameters
        ----------
        W : partials of the predicted quantity (d,): a mapping parameter name -> (d,), or a matrix (d, k) with
            `names`. Parameters not named do not enter; considered and ignored ones may.
        names : k names, when W is a matrix.
        """
        found = self._found
        if isinstance(W, Mapping):
            names = tuple(W)
            columns = [np.atleast_1d(np.asarray(W[name], dtype=np.float64)) for name in names]
            matrix = np.stack(columns, axis=1)
        else:
            names = self.names if names is None else tuple(names)
            matrix = np.atleast_2d(np.asarray(W, dtype=np.float64))
        if matrix.ndim != 2 or matrix.shape[1] != len(names):
            raise InputError(f"predict: W needs {len(names)} columns, one for each name, got shape {matrix.shape}")
        index = self._index(names)
        full = np.zeros((matrix.shape[0], len(self.names) + len(self.left_out)))
        np.add.at(full.T, index, matrix.T)
        inside = full[:, : len(self.names)]
        return Prediction(
            value=full @ np.concatenate([found.mean, found.mean_left_out]),
            factors={source: full @ G for source, G in found.factors.items()},
            factor_formal=lower_factor(inside @ found.S_formal),
        )

    def _index(self, names: Sequence[str]) -> list[int]:
        place = {name: index for index, name in enumerate(self.names + self.left_out)}
        unknown = [name for name in names if name not in place]
        if unknown:
            raise InputError(f"no parameter {unknown[0]!r} in this estimate; there are {', '.join(place)}")
        return [place[name] for name in names]

    def _factors(self, names: Sequence[str]) -> dict[str, Array]:
        index = self._index(names)
        return {source: G[index] for source, G in self._found.factors.items()}


def _sum_of_squares(factors: Mapping[str, Array], size: int) -> Array:
    total = np.zeros((size, size))
    for G in factors.values():
        total += G @ G.T
    return total


def _joint_factor(factors: Mapping[str, Array], size: int) -> Array:
    return lower_factor(np.hstack([np.zeros((size, 0)), *factors.values()]))
