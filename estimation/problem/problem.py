"""The linear estimation problem: residuals, partials, what is uncertain and how each uncertainty is treated.

Four kinds of uncertainty make a problem: parameters common to all measurements (`Block` with `Prior`), errors
drawn anew at each measurement (`White`), errors correlated in time (`Markov`), and measurement noise. Each
common group is `fixed` (no error anywhere), `ignored` (the truth has it, the estimator does not know),
`considered` (not estimated, not in the weights, added to the reported covariance) or `estimated`.
"""

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered_fields
from nebosvod.borders.treatment import TREATMENTS, Treatment
from nebosvod.errors import InputError
from nebosvod.estimation.problem.square_root import covariance_factor

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Block:
    """Parameters common to all measurements that share one treatment: state, radius, a telescope's bias.

    Parameters
    ----------
    name : name of the group.
    names : k parameter names, unique in the problem.
    H : shape (n, p, k), partials of the measurements by the parameters, in any units.
    treatment : fixed, ignored, considered or estimated.
    """

    name: str
    names: tuple[str, ...]
    H: Array
    treatment: Treatment = "estimated"

    def __post_init__(self) -> None:
        _set(self, "names", _names(self.names, f"block {self.name}"))
        _set(self, "H", readonly(self.H, f"block {self.name}: H", (None, None, len(self.names))))
        _check_treatment(self.treatment, f"block {self.name}")


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prior:
    """Gaussian information on parameters by name, independent of everything else: a source of the budget.

    Parameters
    ----------
    name : name of the source.
    names : k parameter names; they may span blocks, so correlated groups stay one source.
    covariance : shape (k, k), assumed; zero or singular is allowed (its null space is then held).
    mean : shape (k,), assumed value as a deviation from the linearisation point; zero by default.
    true_covariance : shape (k, k), what the error really is; the assumed one by default.
    """

    name: str
    names: tuple[str, ...]
    covariance: Array
    mean: Array | None = None
    true_covariance: Array | None = None

    def __post_init__(self) -> None:
        where = f"prior {self.name}"
        names = _names(self.names, where)
        size = len(names)
        _set(self, "names", names)
        _set(self, "covariance", readonly(self.covariance, f"{where}: covariance", (size, size)))
        _set(self, "mean", readonly(np.zeros(size) if self.mean is None else self.mean, f"{where}: mean", (size,)))
        covariance_factor(self.covariance, where)
        if self.true_covariance is not None:
            _set(self, "true_covariance", readonly(self.true_covariance, f"{where}: true covariance", (size, size)))
            covariance_factor(self.true_covariance, f"{where}, true")

    @property
    def truth(self) -> Array:
        """The covariance (k, k) the error really has."""
        return self.covariance if self.true_covariance is None else self.true_covariance


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class White:
    """A nuisance drawn anew at each measurement it touches, such as a telescope's position error.

    Parameters
    ----------
    name : name of the source.
    H : shape (n_r, p, q), partials of the touched measurements by the nuisance.
    Q : shape (q, q) or (n_r, q, q), assumed covariance; singular is allowed.
    rows : shape (n_r,), which measurements it touches, each at most once.
    treatment : estimated (its covariance is in the weights), considered, ignored or fixed.
    true_Q : what the covariance really is; the assumed one by default.
    """

    name: str
    H: Array
    Q: Array
    rows: IntArray
    treatment: Treatment = "estimated"
    true_Q: Array | None = None

    def __post_init__(self) -> None:
        where = f"white {self.name}"
        _set(self, "H", readonly(self.H, f"{where}: H", (None, None, None)))
        n, _, q = self.H.shape
        _set(self, "rows", _rows(self.rows, n, where))
        if np.unique(self.rows).size != n:
            raise InputError(f"{where}: rows name a measurement twice; one draw touches one measurement")
        _set(self, "Q", _covariances(self.Q, n, q, f"{where}: Q"))
        if self.true_Q is not None:
            _set(self, "true_Q", _covariances(self.true_Q, n, q, f"{where}: true Q"))
        _check_treatment(self.treatment, where)

    @property
    def truth(self) -> Array:
        """The covariance (1 or n_r, q, q) the nuisance really has."""
        return self.Q if self.true_Q is None else self.true_Q


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Markov:
    """A nuisance correlated in time, z_{i} = F_i z_{i-1} + w_i, as a Gauss-Markov position error.

    Parameters
    ----------
    name : name of the source.
    H : shape (n_r, p, q), partials of the touched measurements by z.
    F : shape (n_r, q, q), transition INTO touched row i; F[0] is not used.
    Q : shape (n_r, q, q), covariance of the step noise w_i; Q[0] is not used.
    P0 : shape (q, q), covariance of z at the first touched row (stationary, as a rule).
    rows : shape (n_r,), touched measurements in time order, strictly increasing.
    treatment : as for `White`.
    true_F, true_Q, true_P0 : what they really are; the assumed ones by default.
    """

    name: str
    H: Array
    F: Array
    Q: Array
    P0: Array
    rows: IntArray
    treatment: Treatment = "estimated"
    true_F: Array | None = None
    true_Q: Array | None = None
    true_P0: Array | None = None

    def __post_init__(self) -> None:
        where = f"markov {self.name}"
        _set(self, "H", readonly(self.H, f"{where}: H", (None, None, None)))
        n, _, q = self.H.shape
        _set(self, "rows", _rows(self.rows, n, where))
        if (np.diff(self.rows) <= 0).any():
            raise InputError(f"{where}: rows must increase strictly (time order)")
        _set(self, "F", readonly(self.F, f"{where}: F", (n, q, q)))
        _set(self, "Q", _covariances(readonly(self.Q, f"{where}: Q", (n, q, q)), n, q, f"{where}: Q"))
        _set(self, "P0", readonly(self.P0, f"{where}: P0", (q, q)))
        covariance_factor(self.P0, f"{where}: P0")
        if self.true_F is not None:
            _set(self, "true_F", readonly(self.true_F, f"{where}: true F", (n, q, q)))
        if self.true_Q is not None:
            true_Q = readonly(self.true_Q, f"{where}: true Q", (n, q, q))
            _set(self, "true_Q", _covariances(true_Q, n, q, f"{where}: true Q"))
        if self.true_P0 is not None:
            _set(self, "true_P0", readonly(self.true_P0, f"{where}: true P0", (q, q)))
            covariance_factor(self.true_P0, f"{where}: true P0")
        _check_treatment(self.treatment, where)

    @property
    def differs(self) -> bool:
        """Whether the truth is not as assumed."""
        return any(true is not None for true in (self.true_F, self.true_Q, self.true_P0))

    @property
    def truth(self) -> "Markov":
        """The nuisance as it really is, the assumptions replaced."""
        if not self.differs:
            return self
        F = self.F if self.true_F is None else self.true_F
        Q = self.Q if self.true_Q is None else self.true_Q
        P0 = self.P0 if self.true_P0 is None else self.true_P0
        return Markov(name=self.name, H=self.H, F=F, Q=Q, P0=P0, rows=self.rows, treatment=self.treatment)

    @property
    def assumed(self) -> "Markov":
        """The nuisance as the estimator has it, the truth forgotten."""
        return replace(self, true_F=None, true_Q=None, true_P0=None) if self.differs else self


@bordered_fields()
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearProblem:
    """Measurements linear in their uncertainties: residual = sum H x + noise, x = deviations.

    Parameters
    ----------
    residual : shape (n, p), observed minus predicted at the linearisation point.
    R : shape (p, p) or (n, p, p), assumed measurement noise.
    blocks, priors, white, markov : what is uncertain.
    noise_label : shape (n,), index into `noise_names`: which noise source a measurement belongs to.
    noise_names : names of the noise sources in the budget.
    true_R : what the noise really is; the assumed one by default.
    scale : typical size of parameters by name; used only to weigh the names of a weak direction.
    weightless : measurements whose assumed noise is beyond all measure; no degrees of freedom are counted for them.

    Raises
    ------
    InputError
        If shapes disagree, something is not finite, a covariance is not positive semidefinite, a name is
        unknown or used twice, or an ignored or considered parameter has no prior.
    """

    residual: Array
    R: Array
    blocks: tuple[Block, ...]
    priors: tuple[Prior, ...] = ()
    white: tuple[White, ...] = ()
    markov: tuple[Markov, ...] = ()
    noise_label: IntArray | None = None
    noise_names: tuple[str, ...] = ("measurement noise",)
    true_R: Array | None = None
    scale: dict[str, float] | None = None
    weightless: int = 0

    def __post_init__(self) -> None:
        for field in ("blocks", "priors", "white", "markov", "noise_names"):
            _set(self, field, tuple(getattr(self, field)))
        _set(self, "residual", readonly(self.residual, "residual", (None, None)))
        n, p = self.residual.shape
        if n == 0:
            raise InputError("residual: no measurements")
        _set(self, "R", _covariances(self.R, n, p, "R"))
        if self.true_R is not None:
            _set(self, "true_R", _covariances(self.true_R, n, p, "true R"))
        label = np.zeros(n, dtype=np.int64) if self.noise_label is None else self.noise_label
        _set(self, "noise_label", _labels(label, n, len(self.noise_names)))
        _check_shapes(self)
        _check_names(self)

    @property
    def n(self) -> int:
        """Number of measurements."""
        return len(self.residual)

    @property
    def p(self) -> int:
        """Components of one measurement."""
        return int(self.residual.shape[1])

    @property
    def counted(self) -> int:
        """Components of the measurements that have weight."""
        return (self.n - self.weightless) * self.p

    @property
    def truth(self) -> Array:
        """The covariance (1 or n, p, p) the noise really has."""
        return self.R if self.true_R is None else self.true_R

    def names(self, *treatments: Treatment) -> tuple[str, ...]:
        """Return the names of the parameters with one of these treatments, in the order of the blocks."""
        return tuple(name for block in self.blocks if block.treatment in treatments for name in block.names)


def readonly(value: npt.ArrayLike, what: str, shape: tuple[int | None, ...]) -> Array:
    """View an array as read-only float64 after checking its shape (None = any) and that it is finite."""
    array = np.asarray(value, dtype=np.float64).view()
    wanted = "(" + ", ".join("any" if size is None else str(size) for size in shape) + ")"
    if array.ndim != len(shape) or any(size not in (None, have) for size, have in zip(shape, array.shape)):
        raise InputError(f"{what}: needs shape {wanted}, got {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{what}: contains a value that is not finite")
    array.flags.writeable = False
    return array


def _set(instance: object, field: str, value: Any) -> None:
    object.__setattr__(instance, field, value)


def _names(names: Sequence[str], where: str) -> tuple[str, ...]:
    if isinstance(names, str):
        raise InputError(f"{where}: names must be a tuple of names, got the text {names!r}")
    found = tuple(names)
    if not found or len(set(found)) != len(found):
        raise InputError(f"{where}: needs at least one name and no name twice, got {found}")
    return found


def _rows(rows: npt.ArrayLike, n: int, where: str) -> IntArray:
    array = np.asarray(rows)
    if array.shape != (n,) or not np.issubdtype(array.dtype, np.integer):
        raise InputError(
            f"{where}: rows must be {n} integers, one for each H, got {array.dtype} of shape {array.shape}"
        )
    out = array.astype(np.int64)
    out.flags.writeable = False
    return out


def _labels(label: npt.ArrayLike, n: int, sources: int) -> IntArray:
    array = _rows(label, n, "noise_label")
    if n and (array.min() < 0 or array.max() >= sources):
        raise InputError(f"noise_label: must lie in 0..{sources - 1}, one for each noise name")
    return array


def _covariances(value: Array, n: int, size: int, what: str) -> Array:
    """Check one covariance (size, size) or a stack (1 or n, size, size); return it as a stack."""
    array = np.asarray(value, dtype=np.float64)
    stack = array[None] if array.ndim == 2 else array
    stack = readonly(stack, what, (1 if len(stack) == 1 else n, size, size))
    if len(stack) == 1:
        covariance_factor(stack[0], what)
        return stack
    for start in range(0, len(stack), 16384):
        part = stack[start : start + 16384]
        for index in np.flatnonzero(_doubtful(part)):  # the eigenvalues decide, and word the message
            covariance_factor(part[index], f"{what} of row {start + index}")
    return stack


def _doubtful(stack: Array) -> npt.NDArray[np.bool_]:
    """Flag the matrices of a stack (n, q, q) that a vectorised elimination does not find clearly definite."""
    work = stack.copy()
    size = work.shape[1]
    diagonal = np.einsum("nii->ni", stack)
    sigma = np.sqrt(np.abs(diagonal))
    skew = np.abs(stack - stack.transpose(0, 2, 1)) > 1e-9 * sigma[:, :, None] * sigma[:, None, :]
    doubt: npt.NDArray[np.bool_] = skew.any(axis=(1, 2))
    for j in range(size):
        pivot = work[:, j, j]
        zero = ~stack[:, j].any(axis=1)  # an axis without error is common and harmless
        alive = pivot > 1e-10 * diagonal[:, j]
        doubt |= ~(alive | zero)
        column = work[:, j + 1 :, j] / np.sqrt(np.where(alive, pivot, 1.0))[:, None]
        work[:, j + 1 :, j + 1 :] -= column[:, :, None] * column[:, None, :]
    return doubt


def _check_treatment(treatment: str, where: str) -> None:
    if treatment not in TREATMENTS:
        raise InputError(f"{where}: treatment must be one of {', '.join(TREATMENTS)}, got {treatment!r}")


def _check_shapes(problem: LinearProblem) -> None:
    n, p = problem.residual.shape
    for block in problem.blocks:
        if block.H.shape[:2] != (n, p):
            raise InputError(f"block {block.name}: H needs shape ({n}, {p}, {len(block.names)}), got {block.H.shape}")
    nuisances: tuple[White | Markov, ...] = (*problem.white, *problem.markov)
    for nuisance in nuisances:
        if nuisance.H.shape[1] != p:
            raise InputError(f"{nuisance.name}: H needs {p} components a measurement, got {nuisance.H.shape[1]}")
        if nuisance.rows.size and (nuisance.rows.min() < 0 or nuisance.rows.max() >= n):
            raise InputError(f"{nuisance.name}: rows must lie in 0..{n - 1}")


def _check_names(problem: LinearProblem) -> None:
    treatment = {name: block.treatment for block in problem.blocks for name in block.names}
    if len(treatment) != sum(len(block.names) for block in problem.blocks):
        raise InputError("blocks: a parameter name is used twice")
    groups: tuple[White | Markov | Prior, ...] = (*problem.white, *problem.markov, *problem.priors)
    sources = [*problem.noise_names, *(group.name for group in groups)]
    if len(set(sources)) != len(sources):
        raise InputError(f"sources: names must differ, got {sources}")
    owner: dict[str, str] = {}
    for prior in problem.priors:
        for name in prior.names:
            if name not in treatment:
                near = difflib.get_close_matches(name, treatment, 1)
                raise InputError(f"prior {prior.name}: no parameter {name!r}" + (f"; {near[0]!r}?" if near else ""))
            if name in owner:
                raise InputError(
                    f"parameter {name!r} has two priors, {owner[name]} and {prior.name}; combine them first"
                )
            owner[name] = prior.name
    for name, kind in treatment.items():
        if kind in ("ignored", "considered") and name not in owner:
            raise InputError(f"parameter {name!r} is {kind} but has no prior: its error has no size")
    if "estimated" not in treatment.values():
        raise InputError("blocks: nothing is estimated")
