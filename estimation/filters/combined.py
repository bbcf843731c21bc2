"""Combined algorithm: a grid over the strongly nonlinear coordinates, condensed into one linear measurement.

Where a measurement is too nonlinear for any linearisation (a map, the range of a short arc), the posterior is held
on nodes over a few coordinates, Gaussian in the rest at each node. Its moments against the prior of the Kalman
filter define the linear measurement that would have led there; the filter takes that and goes on. After Stepanov
(correlation-extreme navigation), in a form that stands rank deficiency and posteriors wider than the prior.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.problem.square_root import lower_factor, row_units, solve_lower, solve_positive, solve_rows

Array = npt.NDArray[np.float64]
MIN_EFFECTIVE = 30.0
REACH = 6.0  # sigmas; beyond lie 7e-8 of the variance, less than the information that counts
SINGULAR = 1e-12  # of a sigma: what is left of it, given the components before


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GridBlock:
    """A belief on nodes, conditionally Gaussian in the rest.

    Attributes
    ----------
    nodes : shape (g, d), values of the nonlinear coordinates.
    log_weight : shape (g,), up to a constant.
    mean : shape (g, r), conditional means of the rest.
    covariance : shape (r, r), the same at all nodes, or (g, r, r).
    """

    nodes: Array
    log_weight: Array
    mean: Array
    covariance: Array

    @classmethod
    def of_prior(cls, belief: Belief, d: int, points: int = 41, reach: float = REACH) -> "GridBlock":
        """Lay nodes over the first d coordinates of a Gaussian prior, along its axes, to `reach` sigmas.

        The prior is the filter's current marginal; a fixed broad one gave a 2-sigma error in a bimodal case.

        Raises
        ------
        GeometryError
            If the prior is singular.

        Notes
        -----
        A grid that ends is narrower than the prior (0.1 % of the variance at 4 sigmas), and what it has lost would
        pass for information. The nodes are therefore spread until the moments of the bare grid are those of the prior.
        """
        L = _regular_factor(belief, "GridBlock")
        axis = np.linspace(-reach, reach, points)
        weight = np.exp(-0.5 * axis**2)
        wider = axis / np.sqrt(np.sum(weight * axis**2) / np.sum(weight))
        unit, own = (np.stack(np.meshgrid(*[x] * d, indexing="ij"), axis=-1).reshape(-1, d) for x in (wider, axis))
        return cls(
            nodes=belief.mean[:d] + unit @ L[:d, :d].T,
            log_weight=-0.5 * np.sum(own**2, axis=1),
            mean=belief.mean[d:] + unit @ L[d:, :d].T,
            covariance=L[d:, d:] @ L[d:, d:].T,
        )

    @property
    def weight(self) -> Array:
        """Normalised weights (g,)."""
        raw = np.exp(self.log_weight - self.log_weight.max())
        normalised: Array = raw / raw.sum()
        return normalised

    @property
    def effective(self) -> float:
        """Effective number of nodes, 1 / sum w^2; moments from fewer than 30 are not to be trusted."""
        return float(1.0 / np.sum(self.weight**2))

    def update(self, observed: Array, predicted: Array, H: Array, R: Array) -> "GridBlock":
        """Take in a measurement y = h(node) + H rest + v.

        Parameters
        ----------
        observed : shape (p,). predicted : shape (g, p), h at the nodes. H : shape (p, r). R : shape (p, p).
        """
        shared = self.covariance.ndim == 2
        P = self.covariance[None] if shared else self.covariance
        V = H @ P @ H.T + R
        innovation = observed - predicted - self.mean @ H.T
        L = np.asarray(np.linalg.cholesky(V), dtype=np.float64)
        white = np.array(innovation[:, :, None])
        solve_rows(L, white)
        logs = np.log(np.einsum("npp->np", L)).sum(axis=1)
        gain = solve_positive(V, H @ P).transpose(0, 2, 1)
        keep = np.eye(P.shape[1]) - gain @ H
        posterior = keep @ P @ keep.transpose(0, 2, 1) + gain @ R @ gain.transpose(0, 2, 1)
        return replace(
            self,
            log_weight=self.log_weight - 0.5 * np.sum(white[:, :, 0] ** 2, axis=1) - logs,
            mean=self.mean
            + np.einsum("nrp,np->nr", np.broadcast_to(gain, (len(self.nodes), *gain.shape[1:])), innovation),
            covariance=posterior[0] if shared else posterior,
        )

    def move(self, F: Array, Q: Array) -> "GridBlock":
        """Move the rest by rest' = F rest + w while the nonlinear coordinates stand still."""
        P = self.covariance
        return replace(self, mean=self.mean @ F.T, covariance=F @ P @ F.T + Q)

    def moments(self) -> Belief:
        """Mean and factor of the whole belief (d + r), by moments: spread of the nodes plus the conditional part."""
        w = self.weight
        both = np.hstack([self.nodes, self.mean])
        mean = w @ both
        spread = np.sqrt(w)[:, None] * (both - mean)
        d, r = self.nodes.shape[1], self.mean.shape[1]
        inner = np.zeros((d + r, d + r))
        inner[d:, d:] = self.covariance if self.covariance.ndim == 2 else np.einsum("n,nij->ij", w, self.covariance)
        return Belief.of(mean, spread.T @ spread + inner)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EquivalentMeasurement:
    """Linear measurement y = H x + v, v ~ N(0, R), that leads from a prior to a posterior; R diagonal, drift apart."""

    y: Array
    H: Array
    R: Array


def equivalent_measurement(prior: Belief, posterior: Belief, tolerance: float = 1e-6) -> EquivalentMeasurement:
    """Find the linear measurement that turns a Gaussian prior into a given posterior.

    Parameters
    ----------
    posterior : of moments on a grid that begins with those of the prior (`GridBlock.of_prior`): what the grid itself
        lacks would pass for information.
    tolerance : information gain below which a direction is dropped; directions in which the posterior is wider
        than the prior are dropped too (no linear measurement can do that).

    Raises
    ------
    GeometryError
        If the prior is singular.

    Notes
    -----
    L = chol(P0), A = iL P iL^T = U diag(a) U^T, mu = 1/a - 1, kept where mu > tolerance; H = U^T iL, R = diag(1/mu),
    y = H m0 + R U^T iA iL (m - m0). In the coordinates of the prior.

    References
    ----------
    Stepanov, combined algorithm of correlation-extreme navigation (Avtometriya), appendix A.
    """
    L = _regular_factor(prior, "equivalent_measurement")
    half = solve_lower(L, posterior.factor)
    vectors, lengths, _ = np.linalg.svd(np.hstack([half, np.zeros((len(L), len(L)))]), full_matrices=False)
    # a posterior without error in some direction would be an infinite weight: floor it at 1e-12 of the prior
    a = np.maximum(lengths**2, 1e-12)
    mu = 1.0 / a - 1.0
    kept = mu > tolerance
    U = vectors[:, kept]
    H = solve_lower(L, np.eye(len(L))).T @ U
    move = U.T @ solve_lower(L, posterior.mean - prior.mean)
    return EquivalentMeasurement(
        y=H.T @ prior.mean + move / (mu[kept] * a[kept]), H=np.ascontiguousarray(H.T), R=np.diag(1.0 / mu[kept])
    )


def _regular_factor(belief: Belief, what: str) -> Array:
    """The lower triangular factor of a belief, which must not be singular."""
    L = lower_factor(belief.factor)
    if not (np.diag(L) > SINGULAR * row_units(L)).all():
        raise GeometryError(f"{what}: the prior covariance is singular")
    return L


def drift_covariance(P_rate: Array, interval: float) -> Array:
    """Covariance of what the nonlinear coordinates drift over a block's interval, which the block holds still.

    Parameters
    ----------
    P_rate : shape (d, d), covariance of their rate of error at the filter. interval : length, in the rate's time.

    Notes
    -----
    The error at the end differs from that at a moment t of the interval T by rate (T - t); its mean square over the
    interval is P_rate T^2 / 3. This is dQ_L.

    References
    ----------
    Stepanov, combined algorithm of correlation-extreme navigation (Avtometriya), (31).
    """
    return np.asarray(P_rate, dtype=np.float64) * (interval**2 / 3.0)


def with_drift(measurement: EquivalentMeasurement, dQ: Array) -> EquivalentMeasurement:
    """Add the drift dQ (k, k) of the measured coordinates over the block's interval: R + H dQ H^T."""
    return replace(measurement, R=measurement.R + measurement.H @ dQ @ measurement.H.T)


def ready(block: Belief, d: int, drift: float) -> bool:
    """Whether the block is to be condensed now: minor semi-axis of its ellipse down to the drift over its interval.

    Parameters
    ----------
    block : moments of the block, the d nonlinear coordinates first.
    drift : sigma of the drift, e.g. the root of the largest eigenvalue of `drift_covariance`.

    Notes
    -----
    Earlier the block is still nonlinear; later its coordinates have moved by more than it resolves.
    """
    semi_axes = np.linalg.svd(np.hstack([block.factor[:d], np.zeros((d, d))]), compute_uv=False)
    return bool(semi_axes[d - 1] <= drift)


def adapt(
    evaluate: Callable[[Array], GridBlock],
    start: Belief,
    *,
    points: int = 41,
    reach: float = REACH,
    limit: int = 12,
) -> GridBlock:
    """Lay a grid that follows the posterior: re-centre and turn it until enough nodes carry the weight.

    Parameters
    ----------
    evaluate : takes nodes (g, d), returns the block with their log weights (density, not cell mass).
    start : first guess of mean and factor (d, d) of the nonlinear coordinates.

    Raises
    ------
    GeometryError
        If the grid does not reach 30 effective nodes; an axis-aligned grid across a ridge gave sigma ratios of
        0.4 to 0.7.
    """
    d = len(start.mean)
    if d < 1 or points < 5:
        raise InputError(f"adapt: needs at least one coordinate and five points, got {d} and {points}")
    axis = np.linspace(-reach, reach, points)
    unit = np.stack(np.meshgrid(*[axis] * d, indexing="ij"), axis=-1).reshape(-1, d)
    mean, factor = start.mean, start.factor
    for _ in range(limit):
        block = evaluate(mean + unit @ factor.T)
        w = block.weight
        if block.effective >= MIN_EFFECTIVE and _inside(w, unit, reach):
            return block
        mean = w @ block.nodes
        spread = np.sqrt(w)[:, None] * (block.nodes - mean)
        # Never narrower than one cell: with all weight on one node the moments say nothing about the width.
        cell = factor * (2.0 * reach / (points - 1))
        factor = np.asarray(np.linalg.cholesky(spread.T @ spread + cell @ cell.T), dtype=np.float64)
    raise GeometryError(f"adapt: {block.effective:.1f} effective nodes after {limit} grids; use more points")


def _inside(w: Array, unit: Array, reach: float) -> bool:
    """Whether the rim of the grid carries next to nothing."""
    rim = (np.abs(unit) > 0.999 * reach).any(axis=1)
    return bool(w[rim].sum() < 1e-3)
