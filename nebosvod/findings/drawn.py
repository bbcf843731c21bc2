"""What orbits drawn from the error of an estimate do to a prediction, held against its linear ellipse."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.engine.quantity import SIGMAS, Quantity
from nebosvod.engine.trial import DRAWING, generator
from nebosvod.estimation.accuracy import ellipse
from nebosvod.estimation.accuracy.consistency import binomial_interval
from nebosvod.findings.cloud import displacements
from nebosvod.findings.displacement import moved_events, uncertain
from nebosvod.scene.process_noise import process_noise_of
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]
DECEIVED = 1.1  # a sigma of drawn orbits over the linear one, from which the linear one misleads
INTERVAL = 0.95


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HitShare:
    """Share of drawn orbits that hit the body of an encounter.

    Attributes
    ----------
    runs, hits : orbits that could be flown, and those of them that hit.
    probability : hits over runs; None without runs. interval_95 : its exact binomial interval.
    """

    runs: int
    hits: int
    probability: float | None
    interval_95: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AgainstLinear:
    """Whether drawn points come from the linear ellipse.

    Attributes
    ----------
    inside_linear_3_sigma, expected_3_sigma : share of the points inside 3 sigma, and what belongs there.
    sigma_ratio_largest, sigma_ratio_smallest : of drawn over linear sigma, over all directions.
    misleads : whether the ellipse must not be believed.
    """

    inside_linear_3_sigma: float
    expected_3_sigma: float
    sigma_ratio_largest: float
    sigma_ratio_smallest: float
    misleads: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cloud:
    """Drawn points of a prediction, d components in its unit, and what they say of the linear ellipse.

    Attributes
    ----------
    mean_shift, sigma, max_deviation : (d,) mean, standard deviation, and |mean| + 3 sigma of the displacements.
    semi_axes : (d,) of their 1 sigma ellipsoid, largest first.
    statement : the comparison in words.
    """

    mean_shift: Array
    sigma: Array
    semi_axes: Array
    max_deviation: Array
    against: AgainstLinear
    statement: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnSpread:
    """How drawn orbits spread in one prediction.

    Attributes
    ----------
    runs, undefined : orbits drawn, and those of them on which the prediction does not exist.
    cloud : of the others; None where too few are left to have a spread.
    """

    runs: int
    undefined: int
    cloud: Cloud | None

    @property
    def misleads(self) -> bool:
        """Whether the linear ellipse must not be believed."""
        return self.cloud is not None and self.cloud.against.misleads


def clones(scene: Scene, fit: Fit, asked: Sequence[Quantity], runs: int, seed: int) -> tuple[list[Array], list[Array]]:
    """Displacements (runs, d) of each quantity on orbits drawn from the error of the estimate; nan where undefined.

    The second list says of each (runs,) whether the drawn orbit hits the body of the encounter: 1, 0, or nan where
    there is no such orbit. Truth is the estimate minus its error: where the error has a mean, the draws lie about the
    estimate minus that mean.
    Draw i comes from SeedSequence(seed, spawn_key=(1, i)).
    """
    noise, known = process_noise_of(scene.nuisances), {*fit.estimate.names, *fit.estimate.left_out}
    accelerations = () if noise is None else tuple(name for name in noise.names if name in known)
    names = (*uncertain(fit), *accelerations)
    S, mean = fit.estimate.factor(names), fit.mean_errors.shift(fit.estimate, names)
    rows = [S @ generator(seed, DRAWING, i).standard_normal(S.shape[1]) - mean for i in range(runs)]
    draws = np.array(rows).reshape(runs, len(names))
    orbit = len(names) - len(accelerations)
    deviations = [dict(zip(names[:orbit], row[:orbit].tolist())) for row in draws]
    found, fates = _moved(scene, fit, asked, deviations)
    if accelerations:  # white accelerations act linearly, for an orbit cannot be flown with them
        found = [points + draws[:, orbit:] @ one.partials_by(accelerations).T for points, one in zip(found, asked)]
    return found, fates


def _moved(
    scene: Scene, fit: Fit, asked: Sequence[Quantity], deviations: Sequence[Mapping[str, float]]
) -> tuple[list[Array], list[Array]]:
    """Displacements and fates of orbits moved by deviations."""
    runs = len(deviations)
    fates = [np.full(runs, np.nan) for _ in asked]
    at_once = displacements(scene, fit, asked, deviations)
    if at_once is not None:
        return at_once, fates
    found = [np.full((runs, len(one.partials)), np.nan) for one in asked]
    for i, drawn in enumerate(deviations):
        for points, fate, (moved, hit) in zip(found, fates, moved_events(scene, fit, asked, drawn)):
            if moved is not None:
                points[i] = moved
            fate[i] = np.nan if hit is None else float(hit)
    return found, fates


def impact_share(fate: Array) -> HitShare:
    """Share of drawn orbits that hit, with its exact binomial interval.

    Parameters
    ----------
    fate : (runs,) 1 for a hit, 0 for none, nan for an orbit that cannot be flown.

    References
    ----------
    Clopper, Pearson 1934, Biometrika 26, 404.
    """
    from scipy.special import betaincinv

    valid = fate[np.isfinite(fate)]
    n, hits = len(valid), int(np.count_nonzero(valid))
    tail = 0.5 * (1.0 - INTERVAL)
    low = float(betaincinv(hits, n - hits + 1, tail)) if hits > 0 else 0.0
    high = float(betaincinv(hits + 1, n - hits, 1.0 - tail)) if hits < n else 1.0
    return HitShare(runs=n, hits=hits, probability=hits / n if n else None, interval_95=(low, high))


def spread_of(one: Quantity, points: Array, factor: Array, mean_error: Array | float = 0.0) -> DrawnSpread:
    """What drawn orbits did, held against the linear ellipse: their mean, ellipse, and whether the linear one misleads.

    Parameters
    ----------
    factor : (d, r), K = factor factor^T is the linear covariance.
    mean_error : (d,), mean of predicted minus true; the linear ellipse lies about minus this.
    """
    valid, unit = points[np.isfinite(points).all(axis=1)], one.unit
    undefined = len(points) - len(valid)
    if len(valid) <= valid.shape[1]:
        return DrawnSpread(runs=len(points), undefined=undefined, cloud=None)
    mean, sigma = valid.mean(axis=0), valid.std(axis=0, ddof=1)
    axes = np.linalg.svd((valid - mean) / np.sqrt(len(valid) - 1.0), compute_uv=False)
    linear = np.linalg.svd(factor, compute_uv=False)
    found = against_linear(valid + mean_error, factor)
    label = {"m_s": "m/s", "1": ""}.get(unit, unit)
    drawn, believed = (" x ".join(f"{axis:.4g}" for axis in size) for size in (axes, linear[: len(axes)]))
    held, expected = 100.0 * found.inside_linear_3_sigma, 100.0 * found.expected_3_sigma
    verdict = "the linear ellipse misleads" if found.misleads else "the linear ellipse holds"
    cloud = Cloud(
        mean_shift=mean,
        sigma=sigma,
        semi_axes=axes,
        max_deviation=ellipse.maximum_deviation(mean, sigma, SIGMAS),
        against=found,
        statement=f"{drawn} {label} drawn against {believed} {label} linear, {held:.3g} % of the orbits inside its "
        f"3-sigma limit where {expected:.3g} % belong: {verdict}",
    )
    return DrawnSpread(runs=len(points), undefined=undefined, cloud=cloud)


def against_linear(points: Array, factor: Array) -> AgainstLinear:
    """Do points (N, d), deviations from the predicted value, come from N(0, factor factor^T)?

    Notes
    -----
    The second moments of whitened points have roots between 1 -+ (sqrt d + 3) / sqrt N with 98 %; it misleads where a
    root is a tenth beyond that, or the share inside 3 sigma is off by more than a hundredth with a chance below 1e-3.

    References
    ----------
    Davidson, Szarek 2001, Handbook of the Geometry of Banach Spaces 1, chapter 8, II.13.
    """
    left, lengths, _ = np.linalg.svd(factor, full_matrices=False)
    kept = lengths > 1e-12 * lengths[0]
    white = (points @ left[:, kept]) / lengths[kept]
    n, d = white.shape
    roots = np.linalg.svd(white / np.sqrt(n), compute_uv=False)
    play = (np.sqrt(d) + 3.0) / np.sqrt(n)
    wide, narrow = roots[0] > DECEIVED * (1.0 + play), roots[-1] < (1.0 - play) / DECEIVED
    inside, expected = int(np.count_nonzero(np.sum(white**2, axis=1) <= SIGMAS**2)), ellipse.probability(SIGMAS, d)
    low, high = binomial_interval(inside, n, level=1e-3)
    off = abs(inside / n - expected) > 0.01 and not low <= expected <= high
    return AgainstLinear(
        inside_linear_3_sigma=inside / n,
        expected_3_sigma=expected,
        sigma_ratio_largest=float(roots[0]),
        sigma_ratio_smallest=float(roots[-1]),
        misleads=bool(wide or narrow or off),
    )
