"""What a probability will be once measurements are made that nobody has made yet: its distribution over the truths.

Of a cloud of states u ~ N(0, I), whitened, each member predicts the measurements z (in units of their noise) and hits
or not. One member is the truth, its measurement is y = z + noise, and what would then be known of the probability is

    P_i = sum_j w_j exp(-|y_i - z_j|^2 / 2) hit_j / sum_j w_j exp(-|y_i - z_j|^2 / 2),  j not the truth itself,

as long as enough members agree with y. Where they do not, new states are drawn near the most probable one: z(u) is
taken as a polynomial through all members, or where that is not good enough through those nearest to y; Gauss-Newton
finds the maximum, and draws of the normal distribution there are weighed by prior and likelihood.

That the mean of P_i is P holds for any cloud, however poor, and shows nothing; whether truths that end at P_i hit that
often does.

References
----------
Raiffa, Schlaifer 1961, Applied Statistical Decision Theory, chapter 4 (preposterior analysis).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.estimation.accuracy.polynomial import Polynomial

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.int64]
Hits = Callable[[Array], Mask]
ENOUGH = 200.0  # members that must agree with a measurement for the cloud to be weighed anew
AT_ONCE = 2_000_000  # weights held at a time
NEAREST = 12  # members for each coefficient of a local polynomial
TOGETHER = 50  # measurements for which states are drawn together
FAITHFUL = 0.05  # of the noise: how well one polynomial must predict the members it was not made of
ROUNDS, HALVINGS = 30, 12
LEVEL = 1e-9  # of a cost: its rounding
STILL = 1e-6  # sigma: a step of Gauss-Newton that ends it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Foreseen:
    """Future probabilities over simulated truths.

    Attributes
    ----------
    truth : (t,) which member of the cloud each truth is.
    probability : (t,) what P would be after the measurements of each truth.
    effective : (t,) states that each of these rests on: of the cloud weighed anew, or of the new draws.
    redrawn : (t,) for which truths states were drawn anew.
    """

    truth: Rows
    probability: Array
    effective: Array
    redrawn: Mask


def foresee(
    u: Array,
    z: Array,
    hits: Mask,
    rng: np.random.Generator,
    truths: int,
    *,
    weights: Array | None = None,
    hit: Hits | None = None,
    draws: int = 1000,
) -> Foreseen:
    """Simulate truths and their measurements, and tell what the probability would be after each.

    Parameters
    ----------
    u : shape (n, r), states of the cloud in coordinates in which the prior is N(0, I).
    z : shape (n, m), the measurements that each predicts, divided by the factor of their noise.
    hits : shape (n,), which members hit.
    truths : how many are simulated, drawn from the cloud by its weights.
    weights : shape (n,), prior density over that of the draw; equal by default.
    hit : tells of states (k, r) which hit; where fewer than ENOUGH members agree with a measurement, new ones are drawn
        for it. Without it what the cloud says stands, `effective` tells how little that is.
    draws : new states for each such truth.

    Raises
    ------
    InputError
        If shapes disagree or numbers are not finite, or the cloud is too small.
    """
    w = _checked(u, z, hits, weights, truths)
    truth = rng.choice(len(u), size=truths, p=w / w.sum()).astype(np.int64)
    y = z[truth] + rng.standard_normal((truths, z.shape[1]))
    probability, effective = reweighed(y, z, hits, w, truth)
    redrawn = np.zeros(truths, dtype=np.bool_)
    if hit is not None:
        redrawn = effective < ENOUGH
        some = np.flatnonzero(redrawn)
        states, weighed = _redrawn(y[some], u, z, rng, draws)
        found = hit(states.reshape(-1, u.shape[1])).reshape(weighed.shape)
        probability[some] = np.sum(weighed * found, axis=1) / np.sum(weighed, axis=1)
        effective[some] = np.sum(weighed, axis=1) ** 2 / np.sum(weighed**2, axis=1)
    return Foreseen(truth=truth, probability=probability, effective=effective, redrawn=redrawn)


def reweighed(y: Array, z: Array, hits: Mask, weights: Array, truth: Rows) -> tuple[Array, Array]:
    """Probability and effective number of members (t,) after measurements (t, m), the truth itself left out."""
    probability, effective = np.empty(len(y)), np.empty(len(y))
    middle = z.mean(axis=0)
    y, z = y - middle, z - middle
    with np.errstate(divide="ignore"):
        half = 0.5 * np.sum(z * z, axis=1) - np.log(weights)
    for start in range(0, len(y), max(AT_ONCE // len(z), 1)):
        part = slice(start, start + max(AT_ONCE // len(z), 1))
        logarithm = y[part] @ z.T - half
        logarithm[np.arange(len(logarithm)), truth[part]] = -np.inf
        logarithm -= logarithm.max(axis=1, keepdims=True)
        w = np.exp(logarithm)
        total = w.sum(axis=1)
        probability[part] = w @ hits / total
        effective[part] = total**2 / np.einsum("tn,tn->t", w, w)
    return probability, effective


def _redrawn(y: Array, u: Array, z: Array, rng: np.random.Generator, draws: int) -> tuple[Array, Array]:
    """New states (t, draws, r) for measurements (t, m) and their weights (t, draws)."""
    states, weights = np.empty((len(y), draws, u.shape[1])), np.empty((len(y), draws))
    whole = _whole(u, z)
    size = 1 if whole is None else TOGETHER
    parts = [np.arange(start, min(start + size, len(y))) for start in range(0, len(y), size)]
    for part in parts:
        curve = whole or _nearby(u, z, y[part[0]])
        best = _most_probable(curve, y[part])
        J = curve.gradient(best)
        prior = np.broadcast_to(np.eye(u.shape[1]), (len(part), u.shape[1], u.shape[1]))
        axes, lengths, _ = np.linalg.svd(np.concatenate([prior, J], axis=1).transpose(0, 2, 1), full_matrices=False)
        eta = rng.standard_normal((len(part), draws, u.shape[1]))
        new = best[:, None] + (eta / lengths[:, None]) @ axes.transpose(0, 2, 1)
        off = y[part][:, None] - curve(new.reshape(-1, u.shape[1])).reshape(len(part), draws, -1)
        cost = np.sum(off**2, axis=2) + np.sum(new**2, axis=2) - np.sum(eta**2, axis=2)
        states[part], weights[part] = new, np.exp(-0.5 * (cost - cost.min(axis=1, keepdims=True)))
    return states, weights


def _whole(u: Array, z: Array) -> Polynomial | None:
    """One polynomial for the whole cloud, where it is good to a fraction of the noise."""
    for degree in (2, 3):
        if 4 * Polynomial.terms(u.shape[1], degree) <= len(u):
            curve = Polynomial.through(u[::2], z[::2], degree)
            if np.sqrt(np.mean((curve(u[1::2]) - z[1::2]) ** 2)) < FAITHFUL:
                return curve
    return None


def _nearby(u: Array, z: Array, y: Array) -> Polynomial:
    """A polynomial of second degree through the members whose measurements are nearest to y."""
    count = min(NEAREST * Polynomial.terms(u.shape[1], 2), len(u))
    near = np.argpartition(np.sum((z - y) ** 2, axis=1), count - 1)[:count]
    return Polynomial.through(u[near], z[near], 2)


def _most_probable(curve: Polynomial, y: Array) -> Array:
    """The states (t, r) of largest prior times likelihood for measurements (t, m), by damped Gauss-Newton."""

    def cost(at: Array) -> Array:
        return np.asarray(np.sum((y - curve(at)) ** 2, axis=1) + np.sum(at**2, axis=1))

    best = np.broadcast_to(curve.centre, (len(y), len(curve.centre))).copy()
    least = cost(best)
    for _ in range(ROUNDS):
        J = curve.gradient(best)
        normal = np.eye(best.shape[1]) + J.transpose(0, 2, 1) @ J
        pull = np.einsum("tmr,tm->tr", J, y - curve(best)) - best
        step = np.linalg.solve(normal, pull[:, :, None])[:, :, 0]
        for _ in range(HALVINGS):
            worse = cost(best + step) > least + LEVEL * (1.0 + least)
            if not worse.any():
                break
            step[worse] *= 0.5
        else:
            step[cost(best + step) > least] = 0.0
        best = best + step
        least = cost(best)
        if np.abs(step).max(initial=0.0) <= STILL:
            break
    return best


def _checked(u: Array, z: Array, hits: Mask, weights: Array | None, truths: int) -> Array:
    """Weights (n,), all else refused if it cannot be used."""
    count = len(u)
    w = np.ones(count) if weights is None else np.asarray(weights, dtype=np.float64)
    if u.ndim != 2 or z.ndim != 2 or z.shape[0] != count or hits.shape != (count,) or w.shape != (count,):
        raise InputError(
            f"foresee: states {u.shape}, measurements {z.shape}, hits {hits.shape} and weights {w.shape} must be of "
            "the same members"
        )
    if not all(np.isfinite(one).all() for one in (u, z, w)) or (w < 0.0).any():
        raise InputError("foresee: needs finite numbers, and weights that are not negative")
    if count < ENOUGH or not np.count_nonzero(w) > 1:
        raise InputError(f"foresee: {count} members are too few (needs {ENOUGH:.0f}); draw more")
    if truths < 1:
        raise InputError(f"foresee: needs at least one truth, got {truths}")
    return w
