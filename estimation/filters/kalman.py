"""Kalman filters as pure functions: predict and update a Gaussian belief, in square-root or Joseph form.

For systems that move between measurements; estimators of a `LinearProblem` are in `batch` and `recursive`. A
nonlinear measurement is handled by the iterated update, which moves the linearisation point but counts the
measurement once, or by chord linearisation, which replaces the tangent where the belief is wide.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincinv

from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.problem.descent import Trial, shortened
from nebosvod.estimation.problem.square_root import (
    covariance_factor,
    left_inverse,
    lower_factor,
    row_units,
    solve_lower,
    solve_positive,
    solve_square,
    solve_upper,
    whiten,
)

Array = npt.NDArray[np.float64]
Measure = Callable[[Array], tuple[Array, Array]]
Draws = Mapping[int, float]
SIDES = (-1.0, 1.0)
CORNER = float(np.sqrt(3.0))  # sigmas to the points that show mixed curvature
# Nodes and weights of four-point Gauss-Hermite quadrature: right to degree 7 for a normal variable.
NODES = np.sqrt(3.0 + np.sqrt(6.0) * np.array([1.0, -1.0, -1.0, 1.0])) * np.array([-1.0, -1.0, 1.0, 1.0])
WEIGHTS = (3.0 - np.sqrt(6.0) * np.array([1.0, -1.0, -1.0, 1.0])) / 12.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Belief:
    """A Gaussian belief: mean (s,) and factor (s, r) of its covariance, covariance = factor factor^T."""

    mean: Array
    factor: Array

    @classmethod
    def of(cls, mean: npt.ArrayLike, covariance: npt.ArrayLike) -> "Belief":
        """Make a belief from a covariance (s, s); one that is not positive semidefinite raises InputError."""
        P = np.atleast_2d(np.asarray(covariance, dtype=np.float64))
        return cls(mean=np.atleast_1d(np.asarray(mean, dtype=np.float64)), factor=covariance_factor(P, "belief"))

    @property
    def covariance(self) -> Array:
        """Covariance (s, s)."""
        return self.factor @ self.factor.T


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Innovation:
    """What a measurement said: residual (p,), factor (p, p) of its covariance, gain (s, p), whether it was used."""

    residual: Array
    factor: Array
    gain: Array
    accepted: bool

    @property
    def nis(self) -> float:
        """Normalised innovation squared: chi-square with p degrees of freedom when the model is right."""
        return float(np.sum(solve_lower(self.factor, self.residual) ** 2))


def predict(belief: Belief, F: Array, Q: Array | None = None, shift: Array | None = None) -> Belief:
    """Move a belief to the next epoch: x' = F x + shift + w, w ~ N(0, Q).

    Parameters
    ----------
    F : shape (s, s); Q : shape (s, s), singular allowed, None = no process noise; shift : shape (s,).
    """
    noise = np.zeros((len(F), 0)) if Q is None else covariance_factor(Q, "process noise")
    mean = F @ belief.mean if shift is None else F @ belief.mean + shift
    return Belief(mean=mean, factor=lower_factor(np.hstack([F @ belief.factor, noise])))


def update(
    belief: Belief, residual: npt.ArrayLike, H: Array, R: Array, gate: float | None = None
) -> tuple[Belief, Innovation]:
    """Correct a belief by one linear measurement (square-root form).

    Parameters
    ----------
    residual : shape (p,), observed minus predicted at the mean.
    H : shape (p, s). R : shape (p, p), positive definite.
    gate : probability of a good measurement to pass (e.g. 0.999); a residual outside is not used. None = use all.

    Raises
    ------
    GeometryError
        If R is not positive definite.

    Notes
    -----
    One orthogonal reduction of [[R^1/2, H S], [0, S]] gives the innovation factor, the gain and the posterior
    factor together, so the covariance cannot lose positive definiteness, which P - K V K^T does for weak priors.

    References
    ----------
    Bierman 1977, Factorization Methods for Discrete Sequential Estimation.
    Tapley, Schutz, Born 2004, Statistical Orbit Determination.
    """
    v = np.atleast_1d(np.asarray(residual, dtype=np.float64))
    p, s = H.shape
    S = belief.factor
    try:
        noise = np.linalg.cholesky(R)
    except np.linalg.LinAlgError:
        raise GeometryError("update: the measurement covariance is not positive definite") from None
    array = np.zeros((p + s, p + S.shape[1]))
    array[:p, :p] = noise
    array[:p, p:] = H @ S
    array[p:, p:] = S
    triangle = lower_factor(array)
    V, cross = triangle[:p, :p], triangle[p:, :p]
    gain = solve_lower(V, np.eye(p)).T
    gain = cross @ gain.T
    whitened = solve_lower(V, v)
    accepted = gate is None or float(np.sum(whitened**2)) <= 2.0 * float(gammaincinv(0.5 * p, gate))
    innovation = Innovation(residual=v, factor=V, gain=gain, accepted=accepted)
    if not accepted:
        return belief, innovation
    return Belief(mean=belief.mean + cross @ whitened, factor=triangle[p:, p:]), innovation


def joseph(P: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Gain (s, p) and posterior covariance (I - K H) P (I - K H)^T + K R K^T (s, s).

    Agrees with the square-root form to 1e-12 for priors of 1e4 in units of the noise, 1e-8 at 1e8, 1e-4 at 1e12.

    References
    ----------
    Tapley, Schutz, Born 2004, Statistical Orbit Determination.
    """
    V = H @ P @ H.T + R
    gain = solve_positive(V, H @ P).T
    keep = np.eye(len(P)) - gain @ H
    posterior = keep @ P @ keep.T + gain @ R @ gain.T
    return gain, 0.5 * (posterior + posterior.T)


def iterated_update(
    belief: Belief,
    observed: npt.ArrayLike,
    measure: Measure,
    R: Array,
    *,
    limit: int = 20,
    tolerance: float = 1e-6,
) -> tuple[Belief, Innovation, bool]:
    """Correct a belief by one nonlinear measurement, re-linearising until the point stands still.

    Parameters
    ----------
    observed : shape (p,). measure : takes x (s,), returns h(x) (p,) and its partials H (p, s).
    limit : number of iterations. tolerance : a step of so many prior sigmas ends the iteration.

    Returns
    -------
    belief, innovation at the last point, whether it converged.

    Notes
    -----
    x_i = x + K_{i-1} [psi - h(x_{i-1}) - H_{i-1} (x - x_{i-1})]: a Gauss-Newton step from the PRIOR, and the
    covariance is updated once, at the end. Guo and Ivashkin (2.146) as printed feeds the posterior back and counts
    the measurement i times; see `iterated_update_as_printed`.

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, (2.146).
    """
    psi = np.atleast_1d(np.asarray(observed, dtype=np.float64))
    point = belief.mean
    unit = row_units(belief.factor)
    best = _cost(belief, point, psi, measure, R)
    for _ in range(limit):
        value, H = measure(point)
        posterior, innovation = update(belief, psi - value - H @ (belief.mean - point), H, R)
        step = posterior.mean - point
        if not (np.isfinite(step).all() and np.isfinite(posterior.factor).all()):
            break
        if np.max(np.abs(step) / unit) <= tolerance:
            return posterior, innovation, bool(np.isfinite(best))
        begun = (point, step)

        def attempt(fraction: float, begun: tuple[Array, Array] = begun) -> Trial[Array]:
            there = begun[0] + fraction * begun[1]
            cost = _cost(belief, there, psi, measure, R)
            return Trial(point=there, cost=cost, own_cost=cost)

        # Damping keeps a strongly curved measurement from throwing the point away; the same step, shortened. What
        # round-off adds to a cost must not stop it at the minimum.
        found = shortened(attempt, best + 1e-10 * max(best, 1.0), 0.0)
        if found is None:
            break  # no step makes the cost smaller: the partials are wrong, or the point is where they jump
        point, best = found[0].point, min(found[0].cost, best)
    return Belief(mean=point, factor=posterior.factor), innovation, False


def iterated_update_as_printed(
    belief: Belief, observed: npt.ArrayLike, measure: Measure, R: Array, iterations: int = 5
) -> Belief:
    """Iterate as (2.146) of the source prints it: kept to show that it counts the measurement i times.

    After i iterations the covariance is (iP0 + i H^T iR H)^-1: wildly optimistic. Do not use it to estimate.
    """
    psi = np.atleast_1d(np.asarray(observed, dtype=np.float64))
    for _ in range(iterations):
        value, H = measure(belief.mean)
        belief, _ = update(belief, psi - value, H, R)
    return belief


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chord:
    """Chord linearisation y = slope (x - mean) + value + e: value (p,), slope (p, s), residual covariance (p, p)."""

    value: Array
    slope: Array
    residual_covariance: Array
    mean_shift: Array


def chord(function: Callable[[Array], Array], belief: Belief) -> Chord:
    """Linearise a function over the width of a belief: the line of least mean square error, and what it leaves.

    Parameters
    ----------
    function : takes x (s,), returns (p,); called 1 + 6 r + 2 r (r - 1) + 4 r (r - 1) (r - 2) / 3 times for a belief of
        rank r.

    Notes
    -----
    Statistical linearisation with the function expanded in Hermite polynomials
    of the whitened state to the third degree: along each axis by four-point Gauss-Hermite quadrature, what two and
    three axes do together by mixed differences over corners at sqrt(3) sigmas. Right for every cubic polynomial, mixed
    terms included: chords along the axes alone give x y no residual at all. The mean shift is E f - f(mean); the
    residual covariance is a sum of squares, so it can not lose sign.

    References
    ----------
    Platonov, Ivanov 2013, Methods of measurement processing, pp. 116-119.
    """
    wide = belief.factor
    S = wide if wide.shape[1] <= wide.shape[0] else lower_factor(wide)

    def at(draws: Draws) -> Array:
        x = belief.mean + sum((step * S[:, i] for i, step in draws.items()), np.zeros(len(belief.mean)))
        return np.atleast_1d(np.asarray(function(x), dtype=np.float64))

    centre = at({})
    shift, first, unexplained = _hermite(at, centre, S.shape[1])
    return Chord(
        value=centre + shift,
        slope=first.T @ left_inverse(S),
        residual_covariance=unexplained.T @ unexplained,
        mean_shift=shift,
    )


def _hermite(at: Callable[[Draws], Array], centre: Array, axes: int) -> tuple[Array, Array, Array]:
    """Expand a function of independent normal draws: mean minus `centre` (p,), slopes (r, p), rows of all the rest."""
    first, second, third = (np.zeros((axes, len(centre))) for _ in range(3))
    shift = np.zeros(len(centre))
    for i in range(axes):
        values = np.stack([at({i: node}) - centre for node in NODES])
        shift += WEIGHTS @ values
        first[i] = (WEIGHTS * NODES) @ values
        second[i] = (WEIGHTS * (NODES**2 - 1.0)) @ values / 2.0
        third[i] = (WEIGHTS * (NODES**3 - 3.0 * NODES)) @ values / 6.0
    edge = {(i, side): at({i: side * CORNER}) - centre for i in range(axes) for side in SIDES}
    rest = []
    for i, j in itertools.combinations(range(axes), 2):
        corners = {(a, b): at({i: a * CORNER, j: b * CORNER}) - centre for a in SIDES for b in SIDES}
        both = {(a, b): f - edge[i, a] - edge[j, b] for (a, b), f in corners.items()}
        xy, xxy, xyy, xxyy = (
            np.sum([a**m * b**n * f for (a, b), f in both.items()], axis=0) / (4.0 * CORNER ** (m + n))
            for m, n in ((1, 1), (2, 1), (1, 2), (2, 2))
        )
        # with x^2 = (x^2 - 1) + 1 each monomial has its part in the lower terms
        shift += xxyy
        first[i] += xyy
        first[j] += xxy
        second[i] += xxyy
        second[j] += xxyy
        rest += [xy, np.sqrt(2.0) * xxy, np.sqrt(2.0) * xyy, 2.0 * xxyy]
    for which in itertools.combinations(range(axes), 3):
        signs = list(itertools.product(SIDES, repeat=3))
        corners_of_three = [at({i: side * CORNER for i, side in zip(which, sign)}) for sign in signs]
        rest.append(np.prod(signs, axis=1) @ np.stack(corners_of_three) / (8.0 * CORNER**3))
    return shift, first, np.vstack([np.sqrt(2.0) * second, np.sqrt(6.0) * third, *rest])


def chord_update(
    belief: Belief, observed: npt.ArrayLike, function: Callable[[Array], Array], R: Array
) -> tuple[Belief, Innovation]:
    """Correct a belief by one nonlinear measurement through its chord linearisation."""
    line = chord(function, belief)
    psi = np.atleast_1d(np.asarray(observed, dtype=np.float64))
    return update(belief, psi - line.value, line.slope, R + line.residual_covariance)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Information:
    """Square-root information [R | d] of a belief: R x = d + N(0, I); rows of zeros where nothing is known."""

    triangle: Array

    @classmethod
    def nothing(cls, size: int) -> "Information":
        """No knowledge of a state of this size."""
        return cls(triangle=np.zeros((size, size + 1)))

    def belief(self) -> Belief:
        """The belief; GeometryError while the state is not determined."""
        size = len(self.triangle)
        R = self.triangle[:, :size]
        if not (np.abs(np.diag(R)) > 1e-13 * np.linalg.norm(R, axis=0)).all():
            raise GeometryError("information: the state is not determined yet")
        right = solve_upper(R, np.hstack([self.triangle[:, size:], np.eye(size)]))
        return Belief(mean=right[:, 0], factor=right[:, 1:])


def inform(information: Information, psi: npt.ArrayLike, H: Array, R: Array) -> Information:
    """Add a linear measurement psi = H x + v (p,) to square-root information; no prior is needed.

    References
    ----------
    Bierman 1977, Factorization Methods for Discrete Sequential Estimation.
    """
    size = len(information.triangle)
    try:
        L: Array = np.asarray(np.linalg.cholesky(R), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise GeometryError("inform: the measurement covariance is not positive definite") from None
    values = np.atleast_1d(np.asarray(psi, dtype=np.float64))
    rows = solve_lower(L, np.hstack([H, values[:, None]]))
    triangle = np.asarray(np.linalg.qr(np.vstack([information.triangle, rows]), mode="r"))
    return Information(triangle=triangle[:size])


def normalized_error_squared(belief: Belief, truth: Array) -> float:
    """NEES of a belief with a nonsingular square factor.

    References
    ----------
    Bar-Shalom, Li, Kirubarajan 2001, Estimation with Applications to Tracking and Navigation.
    """
    if belief.factor.shape[0] != belief.factor.shape[1]:
        raise InputError("normalized_error_squared: the belief has no error in some direction")
    return float(np.sum(solve_square(belief.factor, belief.mean - truth) ** 2))


def _cost(belief: Belief, point: Array, psi: Array, measure: Measure, R: Array) -> float:
    """Twice the negative log posterior at a point of the prior's span."""
    away = whiten(belief.factor, point - belief.mean)
    value, _ = measure(point)
    whitened = solve_lower(np.asarray(np.linalg.cholesky(R), dtype=np.float64), psi - value)
    with np.errstate(over="ignore"):
        cost = float(np.sum(away**2) + np.sum(whitened**2))
    return cost if np.isfinite(cost) else np.inf  # an overflow is no minimum
