"""Attitude of a small satellite from a Sun sensor and a magnetometer: an extended Kalman filter on the error angles.

The attitude matrix is carried outside the filter; the filter estimates three small rotation angles and three gyro
drifts, and its correction is moved into the matrix after each measurement. rad, rad/s, s.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.kalman import Belief

Array = npt.NDArray[np.float64]
SUN = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True)
class Flight:
    """Errors over time: rotation angle of estimate against truth (n,), its sigma (n,), drift error (3,), NEES (n,)."""

    angle: Array
    sigma: Array
    drift_error: Array
    nees: Array


def skew(a: Array) -> Array:
    """Cross-product matrix of a vector."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def rotation(angles: Array) -> Array:
    """Rotation matrix of a rotation vector (Rodrigues)."""
    size = float(np.linalg.norm(angles))
    if size < 1e-12:
        return np.eye(3) + skew(angles)
    axis = skew(angles / size)
    return np.eye(3) + np.sin(size) * axis + (1.0 - np.cos(size)) * axis @ axis


def field(t: float) -> Array:
    """Direction of the magnetic field along a low orbit, inertial axes."""
    u = 2.0 * np.pi * t / 5600.0
    out = np.array([np.cos(u), 0.4 * np.sin(u), -2.0 * np.sin(u) + 0.3])
    return out / np.linalg.norm(out)


def fly(rng: np.random.Generator, n: int = 400, step: float = 10.0) -> Flight:
    """Simulate and estimate; the Sun is eclipsed for a third of the orbit."""
    sigma_sun, sigma_field, gyro_noise = np.radians(0.2), np.radians(2.0), 1e-5
    rate = np.array([0.0, 0.0011, 0.0003])
    drift = 1e-4 * rng.normal(size=3)
    truth = rotation(rng.normal(size=3))
    start = np.radians(4.0)  # wider, and the first precise Sun vector is beyond linearisation
    attitude = rotation(start * rng.normal(size=3)) @ truth
    belief = Belief.of(np.zeros(6), np.diag([start**2] * 3 + [1e-8] * 3))
    estimate_drift = np.zeros(3)
    F = np.eye(6)
    F[:3, 3:] = -step * np.eye(3)
    Q = np.diag([(gyro_noise * step) ** 2] * 3 + [1e-16] * 3)
    angle, sigma, nees = np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        t = k * step
        measured = rate + drift + gyro_noise * rng.normal(size=3)
        truth = rotation(-rate * step) @ truth
        attitude = rotation(-(measured - estimate_drift) * step) @ attitude
        belief = kalman.predict(belief, _transition(F, measured - estimate_drift, step), Q)
        for seen, reference, noise in ((t % 5600.0 < 3700.0, SUN, sigma_sun), (True, field(t), sigma_field)):
            if not seen:
                continue
            observed = truth @ reference + noise * rng.normal(size=3)
            computed = attitude @ reference
            H = np.hstack([skew(computed), np.zeros((3, 3))])
            belief, _ = kalman.update(belief, observed - computed, H, noise**2 * np.eye(3))
            attitude = rotation(-belief.mean[:3]) @ attitude
            estimate_drift = estimate_drift + belief.mean[3:]
            belief = Belief(mean=np.zeros(6), factor=belief.factor)
        angle[k], sigma[k], nees[k] = _errors(truth, attitude, belief)
    return Flight(angle=angle, sigma=sigma, drift_error=estimate_drift - drift, nees=nees)


def _transition(F: Array, rate: Array, step: float) -> Array:
    """The error angles turn with the body."""
    out = F.copy()
    out[:3, :3] = rotation(-rate * step)
    return out


def _errors(truth: Array, attitude: Array, belief: Belief) -> tuple[float, float, float]:
    """Angle between estimate and truth, its sigma, and the normalised squared error of the three angles."""
    difference = attitude @ truth.T
    cosine = np.clip(0.5 * (np.trace(difference) - 1.0), -1.0, 1.0)
    vector = 0.5 * np.array(
        [difference[2, 1] - difference[1, 2], difference[0, 2] - difference[2, 0], difference[1, 0] - difference[0, 1]]
    )
    K = belief.covariance[:3, :3]
    return float(np.arccos(cosine)), float(np.sqrt(np.trace(K))), float(vector @ np.linalg.solve(K, vector))


def main() -> None:
    """Print the attitude error along the flight."""
    flight = fly(np.random.default_rng(3))
    for k in (0, 10, 100, 399):
        print(
            f"step {k:3d}: error {np.degrees(flight.angle[k]):6.3f} deg, sigma {np.degrees(flight.sigma[k]):6.3f} deg"
        )
    print(f"drift error {np.linalg.norm(flight.drift_error):.1e} rad/s; mean NEES/3 {flight.nees[50:].mean() / 3:.2f}")


if __name__ == "__main__":
    main()
