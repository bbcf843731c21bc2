"""Which source a probability hangs on: d ln P / d ln theta_s, from the draws that gave the probability.

With the covariance K = sum_s theta_s^2 K_s of a normal draw d, the elasticity at theta = 1 is

    e_s = E[ d' K^-1 K_s K^-1 d - tr(K^-1 K_s) | hit ].

By factors: K_s = G_s G_s', K = S S', u = S^-1 d, B_s = S^-1 G_s: what is averaged is |B_s' u|^2 - |B_s|^2, and no
covariance is ever inverted. Directions without error are dropped.

That is with the estimate and its weights held. Where the weights are solved anew the estimate moves by m per d ln
theta_s and the covariance by dK, and e_s = E[ d' K^-1 m + (d' K^-1 dK K^-1 d - tr(K^-1 dK)) / 2 | hit ].
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.accuracy.reweighed import Response
from nebosvod.estimation.problem.square_root import EPS, row_units

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
ENOUGH_HITS = 2000  # effective ones; with fewer the elasticities are only a hint
HALF = 0.5
LINE_HITS = 10  # effective hits for each dimension, below which the direction of the hits is not looked for


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Elasticity:
    """One source's hold on a probability.

    Attributes
    ----------
    source : name.
    value, error : e_s = d ln P / d ln theta_s and its standard error: 1 % less of this source changes P by -e_s %. The
        estimate and its weights are held.
    reoptimised, reoptimised_error : the same where the weights are solved anew and the estimate moves; None where that
        is not known.
    log_odds, log_odds_error : d ln(P / (1 - P)) / d ln theta_s, where P > 0.5; else None.
    share : part of the variance along the line, 0 to 1; None where there is no line.
    halved, halved_error : P if this source were halved, with its standard error; the estimate stays.
    """

    source: str
    value: float
    error: float
    log_odds: float | None
    log_odds_error: float | None
    share: float | None
    halved: float
    halved_error: float
    reoptimised: float | None = None
    reoptimised_error: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProbabilityBudget:
    """Every source's hold on a probability, the strongest first.

    Attributes
    ----------
    probability : from the draws and their weights.
    effective_hits : (sum w)^2 / sum w^2 over the hits; below ENOUGH_HITS the budget is only a hint.
    rank : directions with an error.
    sigmas : how far along the line the hits are, in sigmas; None where there is no line.
    line : shape (n,), one sigma of the draws along the line on which the hits are narrow, towards them; or None.
    rows : one for each source.
    """

    probability: float
    effective_hits: float
    rank: int
    sigmas: float | None
    line: Array | None
    rows: tuple[Elasticity, ...]

    @property
    def enough(self) -> bool:
        """Whether the hits are enough for elasticities that can be trusted."""
        return self.effective_hits >= ENOUGH_HITS


def probability_budget(
    deviations: npt.ArrayLike,
    hits: npt.ArrayLike,
    sources: Mapping[str, npt.ArrayLike],
    weights: npt.ArrayLike | None = None,
    total: float | None = None,
    responses: Mapping[str, Response] | None = None,
    factor: npt.ArrayLike | None = None,
) -> ProbabilityBudget:
    """Tell for each source of the covariance how a probability depends on its size.

    Parameters
    ----------
    deviations : shape (k, n), draws minus their mean, normal with the covariance sum_s G_s G_s' where the weights are
        equal; any units.
    hits : shape (k,), which draws count.
    sources : factors G_s (n, .) by name; together they may be singular.
    weights : shape (k,), density wanted over density drawn from; equal by default.
    total : of the weights of all draws, where it is known better than by their sum: k for the weights of normalised
        densities. P is the weight of the hits over it.
    responses, factor : how the estimate answers to a source by name, in units of the factor (n, n) of its covariance;
        of those that are named the elasticity is also told re-optimised.

    Raises
    ------
    InputError
        If shapes disagree, numbers are not finite, a weight is negative, the sources have no error at all, or fewer
        than two draws hit.

    Notes
    -----
    "If this source were halved" is the same hits, each weighed by the ratio of the densities with and without it
    halved, a ratio that never exceeds 2^rank(K_s). Where P > 0.5 the misses tell more than the hits, and it is they
    that d ln(P/(1 - P)) and the halved P come from. A narrow target at nu sigmas has e_s = share_s (nu^2 - 1): that
    vanishes at nu = 1, where halving still changes P; so shares, nu and P halved stand beside it.
    The line is the direction in which hits differ least from one another, in units of sigma.
    """
    d, hit, w = _checked(deviations, hits, weights)
    basis = _Basis.of(sources, d.shape[1])
    whole = float(w.sum()) if total is None else float(total)
    if not (np.isfinite(whole) and whole > 0.0):
        raise InputError(f"probability_budget: total: needs a positive number, got {whole}")
    u = d @ basis.inverse.T
    mine = hit & (w > 0.0)
    if np.count_nonzero(mine) < 2:
        raise InputError(
            f"probability_budget: {np.count_nonzero(mine)} of {len(d)} draws hit; elasticities need at least two, "
            f"and {ENOUGH_HITS} to be trusted: draw more, or nearer to the target"
        )
    p = float(w[mine].sum()) / whole
    effective = float(w[mine].sum() ** 2 / np.sum(w[mine] ** 2))
    likely = total is None and p > HALF and not mine.all()
    line = _line(u[mine], w[mine], effective)
    rows = [_row(name, B, u, w, mine, whole, p if likely else None, line) for name, B in basis.parts.items()]
    if responses and factor is not None:
        turn = basis.inverse @ np.asarray(factor, dtype=np.float64)
        rows = [_reoptimised(row, responses.get(row.source), turn, u[mine], w[mine]) for row in rows]
    return ProbabilityBudget(
        probability=p,
        effective_hits=effective,
        rank=basis.rank,
        sigmas=None if line is None else float(line @ _mean(u[mine], w[mine])),
        line=None if line is None else basis.factor @ line,
        rows=tuple(sorted(rows, key=lambda row: -abs(row.value))),
    )


def halving_weights(whitened: Array, part: Array, scale: float = HALF) -> Array:
    """Density with one source scaled over the density as it is, at whitened draws.

    Parameters
    ----------
    whitened : shape (k, r), u = S^-1 d.
    part : shape (r, m), B = S^-1 G of the source.
    scale : of the source's sigma, 0 or more.

    Notes
    -----
    In the principal axes of B B' with eigenvalues a: v = 1 - (1 - scale^2) a, and the ratio is the product of
    v^-1/2 exp(-(1/v - 1) y^2 / 2). Where a source is alone in a direction and scaled to 0 the ratio is 0 off its mean.
    """
    axes, values, _ = np.linalg.svd(part, full_matrices=False)
    a = np.minimum(values**2, 1.0)
    v = np.maximum(1.0 - (1.0 - scale * scale) * a, EPS)
    y = whitened @ axes
    ratio: Array = np.exp(-0.5 * (y * y) @ (1.0 / v - 1.0) - 0.5 * float(np.sum(np.log(v))))
    return ratio


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Basis:
    """The draws' own coordinates: factor S (n, r), its inverse (r, n), and the sources in them, B_s (r, .)."""

    factor: Array
    inverse: Array
    parts: Mapping[str, Array]

    @property
    def rank(self) -> int:
        return int(self.factor.shape[1])

    @classmethod
    def of(cls, sources: Mapping[str, npt.ArrayLike], size: int) -> "_Basis":
        factors = {name: np.asarray(G, dtype=np.float64) for name, G in sources.items()}
        for name, G in factors.items():
            if G.ndim != 2 or len(G) != size or not np.isfinite(G).all():
                raise InputError(f"probability_budget: {name}: needs a finite factor ({size}, m), got shape {G.shape}")
        wide = np.hstack([np.zeros((size, 0)), *factors.values()])
        unit = row_units(wide)
        axes, lengths, _ = np.linalg.svd(wide / unit[:, None], full_matrices=False)
        kept = lengths > 100 * EPS * lengths.max(initial=0.0)
        if not kept.any():
            raise InputError("probability_budget: no source has an error, so nothing is drawn from them")
        axes, lengths = axes[:, kept], lengths[kept]
        inverse = (axes / lengths).T / unit
        return cls(
            factor=unit[:, None] * axes * lengths,
            inverse=inverse,
            parts={name: inverse @ G for name, G in factors.items()},
        )


def _row(
    name: str, B: Array, u: Array, w: Array, hit: Mask, whole: float, likely: float | None, line: Array | None
) -> Elasticity:
    """One source; `likely` is P where the misses are to be asked as well."""
    g = np.sum((u @ B) ** 2, axis=1) - float(np.sum(B**2))
    value, error = _mean_and_error(g[hit], w[hit])
    odds, odds_error = None, None
    ratio = w * halving_weights(u, B)
    if likely is None:
        halved, halved_error = _part(ratio, hit, whole)
    else:
        # E g = 0 over all draws: P e_hit + (1 - P) e_miss = 0, so that e_hit - e_miss = -e_miss / P
        missed, missed_error = _mean_and_error(g[~hit], w[~hit])
        odds, odds_error = -missed / likely, missed_error / likely
        left, halved_error = _part(ratio, ~hit, whole)
        halved = 1.0 - left
    return Elasticity(
        source=name,
        value=value,
        error=error,
        log_odds=odds,
        log_odds_error=odds_error,
        share=None if line is None else float(np.sum((B.T @ line) ** 2)),
        halved=halved,
        halved_error=halved_error,
    )


def _reoptimised(row: Elasticity, response: Response | None, turn: Array, u: Array, w: Array) -> Elasticity:
    """A row with the elasticity at weights solved anew; `turn` (r, n) is from units of the factor to those of u."""
    if response is None:
        return row
    D = turn @ response.growth @ turn.T
    g = u @ (turn @ response.shift) + 0.5 * (np.einsum("ki,ij,kj->k", u, D, u) - np.trace(D))
    value, error = _mean_and_error(g, w)
    return replace(row, reoptimised=value, reoptimised_error=error)


def _line(u: Array, w: Array, effective: float) -> Array | None:
    """The unit direction (r,) in which weighted hits (k, r) are narrowest, towards them; None for too few."""
    if effective < LINE_HITS * u.shape[1]:
        return None
    middle = _mean(u, w)
    spread = (u - middle) * np.sqrt(w / w.sum())[:, None]
    direction: Array = np.linalg.svd(spread, full_matrices=False)[2][-1]
    return direction if direction @ middle >= 0.0 else -direction


def _mean(values: Array, w: Array) -> Array:
    mean: Array = w @ values / w.sum()
    return mean


def _mean_and_error(g: Array, w: Array) -> tuple[float, float]:
    """Weighted mean of some values (k,) and its standard error; that of a single value is not known: inf."""
    mean = float(_mean(g, w))
    if len(g) < 2:
        return mean, np.inf
    error = float(np.sqrt(np.sum((w * (g - mean)) ** 2)) / w.sum() * np.sqrt(len(g) / (len(g) - 1)))
    return mean, error


def _part(weights: Array, chosen: Mask, whole: float) -> tuple[float, float]:
    """Weight of the chosen draws over the whole, and its standard error over draws."""
    counted = np.where(chosen, weights, 0.0)
    return float(counted.sum()) / whole, float(np.sqrt(len(counted)) * counted.std()) / whole


def _checked(
    deviations: npt.ArrayLike, hits: npt.ArrayLike, weights: npt.ArrayLike | None
) -> tuple[Array, Mask, Array]:
    d = np.asarray(deviations, dtype=np.float64)
    if d.ndim != 2 or not d.size or not np.isfinite(d).all():
        raise InputError(f"probability_budget: deviations: need finite numbers of shape (k, n), got shape {d.shape}")
    hit = np.asarray(hits)
    if hit.shape != (len(d),) or hit.dtype != np.bool_:
        raise InputError(f"probability_budget: hits: need {len(d)} booleans, got {hit.dtype} of shape {hit.shape}")
    w = np.ones(len(d)) if weights is None else np.asarray(weights, dtype=np.float64)
    if w.shape != (len(d),) or not np.isfinite(w).all() or (w < 0.0).any():
        raise InputError(f"probability_budget: weights: need {len(d)} finite numbers, none negative")
    return d, hit, w
