"""Which measurements a fit keeps: automatic rejection, and recovery of what was rejected too early.

Each measurement is judged by its residual against the covariance of that residual, not against the noise alone: a
selected measurement has pulled the estimate towards itself, so its residual is smaller than its noise by H K H^T; one
that is left out has not, and its residual carries the error of the estimate on top.

References
----------
Carpino, Milani, Chesley 2003, Icarus 166, 248: section 4 (chi of a residual), section 5 (thresholds).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.problem.square_root import solve_rows
from nebosvod.estimation.problem.whitening import projected

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
LEAST_SHARE = 1e-3  # of its noise variance that a selected residual keeps: one that the fit passes through has none


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Thresholds:
    """When a measurement is rejected, and when it comes back, in chi squared of its p components.

    Parameters
    ----------
    reject : a selected measurement above this is rejected.
    recover : a rejected one below this comes back; less than `reject`, so that nothing goes to and fro.
    fraction : only those above this part of the largest chi squared go in one round, for one gross error makes its
        neighbours look bad.
    fudge, decay : fudge * decay^n is added to both thresholds with n selected measurements: a few measurements cannot
        outvote one another.

    References
    ----------
    Carpino, Milani, Chesley 2003, Icarus 166, 248, section 5.
    """

    reject: float = 8.0
    recover: float = 7.0
    fraction: float = 0.25
    fudge: float = 400.0
    decay: float = 1.0 / 1.2

    def __post_init__(self) -> None:
        if not 0.0 < self.recover <= self.reject < np.inf:
            raise InputError(
                f"rejection: needs 0 < recover <= reject (got recover {self.recover:g}, reject {self.reject:g})"
            )
        if not (0.0 <= self.fraction < 1.0 and 0.0 <= self.fudge < np.inf and 0.0 <= self.decay < 1.0):
            raise InputError(
                "rejection: needs 0 <= fraction < 1, fudge >= 0 and 0 <= decay < 1 "
                f"(got {self.fraction:g}, {self.fudge:g}, {self.decay:g})"
            )


def chi_squared(residual: Array, R: Array, H: Array, S: Array, selected: Flags) -> Array:
    """Chi squared (n,) of each measurement by the covariance of its own residual.

    Parameters
    ----------
    residual : shape (n, p), observed minus computed at the estimate.
    R : shape (n, p, p), noise covariance; white nuisances may be in it.
    H : shape (n, p, s), partials by the estimated parameters.
    S : shape (s, r), factor of the covariance of the estimate, K = S S^T.
    selected : shape (n,), which measurements the estimate was made from.

    Raises
    ------
    InputError
        If a noise covariance is not positive definite.

    Notes
    -----
    chi^2 = v^T (R -+ H K H^T)^-1 v, minus for selected measurements, plus for the others. With R = L L^T and
    G = iL H S this is q^T (I -+ G G^T)^-1 q, q = iL v, whose eigenvalues lie in [0, 1] for selected ones. Where an
    eigenvalue is 0 the fit passes through the measurement, and its residual says nothing: it is held at 1e-3, so that
    round-off is not taken for a gross error.

    References
    ----------
    Carpino, Milani, Chesley 2003, Icarus 166, 248, section 4.
    """
    try:
        L = np.asarray(np.linalg.cholesky(R), dtype=np.float64)
    except np.linalg.LinAlgError:
        worst = int(np.argmin(np.linalg.eigvalsh(R)[:, 0]))
        raise InputError(f"rejection: the noise covariance of measurement {worst} is not positive definite") from None
    whitened = np.concatenate([residual[:, :, None], H @ S], axis=2)
    solve_rows(L, whitened)
    q, G = whitened[:, :, 0], whitened[:, :, 1:]
    leverage = projected(G, np.eye(G.shape[2])[None])
    if q.shape[1] == 2:
        return _of_two(q, leverage, selected)
    values, axes = np.linalg.eigh(leverage)
    chi2: Array = np.sum(np.einsum("npk,np->nk", axes, q) ** 2 / _share(values, selected[:, None]), axis=1)
    return chi2


def _share(leverage: Array, selected: Flags) -> Array:
    """What is left of the noise variance in a residual, along an axis of such leverage."""
    return np.where(selected, np.maximum(1.0 - leverage, LEAST_SHARE), 1.0 + leverage)


def _of_two(q: Array, leverage: Array, selected: Flags) -> Array:
    """q^T f(A) q for leverages A (n, 2, 2), f the inverse of what is left of the variance.

    On two eigenvalues f is a straight line, so f(A) needs no eigenvectors, a stack of which takes ten times as long.
    """
    a, b, c = leverage[:, 0, 0], leverage[:, 1, 0], leverage[:, 1, 1]
    middle, apart = 0.5 * (a + c), np.hypot(0.5 * (a - c), b)
    smaller = np.maximum(middle - apart, 0.0)
    low, high = 1.0 / _share(smaller, selected), 1.0 / _share(middle + apart, selected)
    slope = np.divide(high - low, middle + apart - smaller, out=np.zeros_like(apart), where=apart > 0.0)
    square, along = q[:, 0] ** 2, q[:, 1] ** 2
    turned = a * square + 2.0 * b * q[:, 0] * q[:, 1] + c * along - smaller * (square + along)
    return np.asarray(low * (square + along) + slope * turned, dtype=np.float64)


def reselect(chi2: Array, selected: Flags, thresholds: Thresholds, least: int, held: Flags | None = None) -> Flags:
    """Which measurements (n,) are selected in the next round.

    Parameters
    ----------
    chi2 : shape (n,), of `chi_squared`.
    selected : shape (n,), which are selected now.
    least : never fewer than so many stay selected; those with the smallest chi squared stay.
    held : shape (n,), measurements whose selection is the user's and does not change.

    References
    ----------
    Carpino, Milani, Chesley 2003, Icarus 166, 248, section 5.
    """
    free = np.ones(len(chi2), dtype=bool) if held is None else ~held
    fudge = thresholds.fudge * thresholds.decay ** int(selected.sum())
    largest = chi2[selected & free].max(initial=0.0)
    bound = max(thresholds.reject + fudge, thresholds.fraction * largest)
    out = selected & free & (chi2 > bound)
    back = ~selected & free & (chi2 < thresholds.recover + fudge)
    found: Flags = (selected & ~out) | back
    if found.sum() < least:
        worst_first = np.flatnonzero(out)[np.argsort(-chi2[out])]
        spared = worst_first[max(0, int(found.sum()) + len(worst_first) - least) :]
        found[spared] = True
    return found


def settled(history: list[Flags], latest: Flags) -> bool:
    """Whether a selection has been there before: it then stays, for going on would only go round in a circle."""
    return any(np.array_equal(latest, earlier) for earlier in history)


def turning(history: list[Flags], latest: Flags) -> Flags:
    """Measurements (n,) that go to and fro in the circle which the latest selection closes.

    Parameters
    ----------
    history : earlier selections in their order, one of them equal to the latest.
    """
    first = max(place for place, earlier in enumerate(history) if np.array_equal(latest, earlier))
    circle = np.array([*history[first:], latest])
    return np.asarray(circle.any(axis=0) & ~circle.all(axis=0), dtype=np.bool_)
