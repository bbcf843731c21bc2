"""Zero offset of a magnetometer in flight, with the attitude: equations of motion, a Sun sensor, a start by TRIAD.

The satellite tumbles slowly under the gravity torque. TRIAD with the uncorrected field gives a start that is wrong by
degrees; as the body turns, what turns with it is told from what does not. State: three error angles, three of the rate,
three offsets. Units: rad, s, kg, m, uT. Platonov and Ivanov 2013, pp. 201-213.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.continuous import discretise
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.filters.triad import triad

Array = npt.NDArray[np.float64]
J = np.diag([1.4, 1.1, 0.8])  # kg m^2
ORBIT = 2.0 * np.pi / 5600.0  # rad/s
STEP = 10.0
SUN, SIGMA_SUN, SIGMA_FIELD = np.array([0.0, 0.6, 0.8]), np.radians(0.3), 0.1  # rad, uT
OFFSET, TORQUE, SIGMA_RATE = 1.5, 1e-7, 5e-4  # uT, N m, rad/s


@dataclass(frozen=True)
class Flight:
    """Angle of the start's error, offset error (n, 3) and sigma (n, 3), angle (n,), NEES (n,) of all nine."""

    start_angle: float
    offset_error: Array
    offset_sigma: Array
    angle: Array
    nees: Array


def skew(a: Array) -> Array:
    """Cross-product matrix of a vector."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def rotation(angles: Array) -> Array:
    """Rotation matrix of a rotation vector (Rodrigues)."""
    size = float(np.linalg.norm(angles)) + 1e-300
    axis = skew(angles / size)
    return np.eye(3) + np.sin(size) * axis + (1.0 - np.cos(size)) * axis @ axis


def between(truth: Array, A: Array) -> Array:
    """Rotation vector (3,) that takes the found attitude to the true one, as the filter's error angles."""
    D = truth @ A.T
    angle = np.arccos(np.clip(0.5 * (np.trace(D) - 1.0), -1.0, 1.0))
    vector: Array = 0.5 * np.array([D[1, 2] - D[2, 1], D[2, 0] - D[0, 2], D[0, 1] - D[1, 0]])
    return vector / np.sinc(angle / np.pi)


def up(t: float) -> Array:
    """Direction from the Earth's centre, inertial axes."""
    return np.array([np.cos(ORBIT * t), 0.3 * np.sin(ORBIT * t), np.sqrt(0.91) * np.sin(ORBIT * t)])


def field(t: float) -> Array:
    """A dipole's field along a polar orbit, uT, inertial axes."""
    dipole = np.array([0.2, 0.1, -0.97])
    return 25.0 * (3.0 * (dipole @ up(t)) * up(t) - dipole)


def acceleration(A: Array, w: Array, t: float, torque: Array) -> Array:
    """Euler's equations with the gravity torque."""
    r = A @ up(t)
    return np.linalg.solve(J, 3.0 * ORBIT**2 * np.cross(r, J @ r) - np.cross(w, J @ w) + torque)


def turn(A: Array, w: Array, t: float, torque: Array) -> tuple[Array, Array]:
    """Attitude and rate a step later, by ten midpoint steps."""
    dt = STEP / 10.0
    for k in range(10):
        middle = w + 0.5 * dt * acceleration(A, w, t + k * dt, torque)
        A_middle = rotation(-0.5 * dt * w) @ A
        w = w + dt * acceleration(A_middle, middle, t + (k + 0.5) * dt, torque)
        A = rotation(-dt * middle) @ A
    return A, w


def motion(A: Array, w: Array, t: float) -> tuple[Array, Array]:
    """Transition and process noise of the errors over a step."""
    r, rates, density = A @ up(t), np.zeros((9, 9)), np.zeros((9, 9))
    rates[:3, :3], rates[:3, 3:6] = -skew(w), np.eye(3)
    rates[3:6, :3] = np.linalg.solve(J, 3.0 * ORBIT**2 * (skew(r) @ J - skew(J @ r)) @ skew(r))
    rates[3:6, 3:6] = np.linalg.solve(J, skew(J @ w) - skew(w) @ J)
    density[3:6, 3:6] = TORQUE**2 * STEP * np.linalg.solve(J @ J, np.eye(3))
    return discretise(rates, density, STEP)


def fly(rng: np.random.Generator, n: int = 200) -> Flight:
    """Simulate and estimate."""
    truth, w = rotation(rng.normal(size=3)), np.array([2e-3, -1e-3, 3e-3])
    offset, guess = OFFSET * rng.normal(size=3), w + SIGMA_RATE * rng.normal(size=3)
    seen = truth @ field(0.0) + offset + SIGMA_FIELD * rng.normal(size=3)
    first = np.stack([truth @ SUN + SIGMA_SUN * rng.normal(size=3), seen])
    sigma = np.hypot(OFFSET, SIGMA_FIELD) / float(np.linalg.norm(seen))
    start = triad(first, np.stack([SUN, field(0.0)]), (SIGMA_SUN, sigma))
    A, found = start.R_body_from_reference, np.zeros(3)
    start_angle = float(np.linalg.norm(between(truth, A)))
    P = np.zeros((9, 9))
    P[:3, :3], P[3:6, 3:6], P[6:, 6:] = start.covariance, SIGMA_RATE**2 * np.eye(3), OFFSET**2 * np.eye(3)
    # TRIAD turns about the Sun by what the offset does to the field across it: angle and offset are correlated
    sun = first[0] / np.linalg.norm(first[0])
    across = np.cross(sun, seen)
    P[:3, 6:] = np.outer(sun, across) / (across @ across) * OFFSET**2
    P[6:, :3] = P[:3, 6:].T
    belief = Belief.of(np.zeros(9), P)
    errors, sigmas, angle, nees = np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.empty(n)
    for k in range(n):
        t = k * STEP
        F, Q = motion(A, guess, t)
        truth, w = turn(truth, w, t, TORQUE * rng.normal(size=3))
        A, guess = turn(A, guess, t, np.zeros(3))
        belief = kalman.predict(belief, F, Q)
        B, sun = truth @ field(t + STEP) + offset, truth @ SUN
        for observed, reference, noise, biased in ((sun, SUN, SIGMA_SUN, 0.0), (B, field(t + STEP), SIGMA_FIELD, 1.0)):
            computed = A @ reference
            H = np.hstack([skew(computed), np.zeros((3, 3)), biased * np.eye(3)])
            residual = observed + noise * rng.normal(size=3) - computed - biased * found
            belief, _ = kalman.update(belief, residual, H, noise**2 * np.eye(3))
            A, guess = rotation(-belief.mean[:3]) @ A, guess + belief.mean[3:6]
            found = found + belief.mean[6:]
            belief = Belief(mean=np.zeros(9), factor=belief.factor)
        error = np.concatenate([between(truth, A), w - guess, offset - found])
        errors[k], sigmas[k] = error[6:], np.sqrt(np.diag(belief.covariance))[6:]
        angle[k], nees[k] = np.linalg.norm(error[:3]), kalman.normalized_error_squared(belief, error)
    return Flight(start_angle, errors, sigmas, angle, nees)


def main() -> None:
    """Print the offset's error along the flight."""
    flight = fly(np.random.default_rng(2))
    print(f"TRIAD {np.degrees(flight.start_angle):.2f} deg, at the end {np.degrees(flight.angle[-1]):.3f} deg")
    for k in (0, 20, 199):
        print(f"step {k:3d}: offset error {flight.offset_error[k].round(3)} uT +- {flight.offset_sigma[k].round(3)}")
    print(f"mean NEES/9 {flight.nees[20:].mean() / 9.0:.2f}")


if __name__ == "__main__":
    main()
