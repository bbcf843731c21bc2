"""Attitude of a satellite without gyros: its equations of motion, gravity torque and wheels, in a Kalman filter.

A Sun sensor and a magnetometer see two directions; the rate is not measured but follows from them and from the torques.
TRIAD gives the start from one reading of each, wheels hold the satellite still by the estimate. State: three error
angles, three errors of the rate; the attitude matrix stands outside the filter. About the Sun's direction the field
alone tells, and the filter ends where noise R (rad^2 s) and disturbance q (rad^2/s^3) balance: variance sqrt 2 R^(3/4)
q^(1/4), 0.076 deg by one reading in ten seconds and 5e-8 N m, 0.008 deg as below; more where the field is near the Sun.
Units: rad, s, kg, m. Platonov and Ivanov 2013, pp. 188-196.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.continuous import discretise
from nebosvod.estimation.filters.kalman import Belief
from nebosvod.estimation.filters.triad import triad

Array = npt.NDArray[np.float64]
J = np.diag([1.4, 1.1, 0.8])  # kg m^2
ORBIT = 2.0 * np.pi / 5600.0  # rad/s
STEP = 10.0
SUN, SIGMA_SUN, SIGMA_FIELD = np.array([0.0, 0.6, 0.8]), np.radians(0.01), np.radians(0.4)  # of one reading
READINGS = 200  # of the magnetometer in a step, whose mean is used; of the Sun sensor one
TORQUE = 2e-8  # N m on each axis, what disturbs beside gravity; white, constant over a step
SIGMA_RATE = 2e-4  # rad/s, of the rate at the start


@dataclass(frozen=True)
class Flight:
    """Error angle at the start and (n,), its sigma (n,), NEES (n,) of angles and rates, momentum of wheels (n, 3)."""

    start: float
    angle: Array
    sigma: Array
    nees: Array
    wheels: Array


def skew(a: Array) -> Array:
    """Cross-product matrix of a vector."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def rotation(angles: Array) -> Array:
    """Rotation matrix of a rotation vector (Rodrigues)."""
    size = float(np.linalg.norm(angles)) + 1e-300
    axis = skew(angles / size)
    return np.eye(3) + np.sin(size) * axis + (1.0 - np.cos(size)) * axis @ axis


def up(t: float) -> Array:
    """Direction from the Earth's centre, inertial axes."""
    return np.array([np.cos(ORBIT * t), np.sin(ORBIT * t), 0.0])


def field(t: float) -> Array:
    """Direction of a dipole's field along the orbit, inertial axes."""
    dipole = np.array([0.2, 0.1, -0.97])
    out = 3.0 * (dipole @ up(t)) * up(t) - dipole
    return out / np.linalg.norm(out)


def acceleration(A: Array, w: Array, h: Array, t: float, u: Array) -> Array:
    """Euler's equations: gravity torque, wheels of momentum h, torque u from them."""
    r = A @ up(t)
    torque = 3.0 * ORBIT**2 * np.cross(r, J @ r) - np.cross(w, J @ w + h) + u
    return np.linalg.solve(J, torque)


def turn(A: Array, w: Array, h: Array, t: float, u: Array) -> tuple[Array, Array]:
    """Attitude and rate a step later, by ten midpoint steps."""
    dt = STEP / 10.0
    for k in range(10):
        middle = w + 0.5 * dt * acceleration(A, w, h - u * k * dt, t + k * dt, u)
        A_middle = rotation(-0.5 * dt * w) @ A
        w = w + dt * acceleration(A_middle, middle, h - u * (k + 0.5) * dt, t + (k + 0.5) * dt, u)
        A = rotation(-dt * middle) @ A
    return A, w


def partials(A: Array, w: Array, h: Array, t: float) -> Array:
    """Rates of the errors: angles turn with the body and grow with the rate error, which the torques change."""
    r = A @ up(t)
    gravity = 3.0 * ORBIT**2 * (skew(r) @ J - skew(J @ r)) @ skew(r)
    gyroscopic = skew(J @ w + h) - skew(w) @ J
    return np.block([[-skew(w), np.eye(3)], [np.linalg.solve(J, gravity), np.linalg.solve(J, gyroscopic)]])


def see(A: Array, t: float, rng: np.random.Generator, readings: int = 1) -> Array:
    """Directions of Sun and field in body axes, with noise: one reading, or the mean of some of the field."""
    noise = np.array([SIGMA_SUN, SIGMA_FIELD / np.sqrt(readings)])[:, None] * rng.normal(size=(2, 3))
    return np.stack([A @ SUN, A @ field(t)]) + noise


def apart(truth: Array, A: Array) -> Array:
    """Small rotation vector from one attitude to another."""
    D = truth @ A.T
    return 0.5 * np.array([D[1, 2] - D[2, 1], D[2, 0] - D[0, 2], D[0, 1] - D[1, 0]])


def fly(rng: np.random.Generator, n: int = 300, q: float = 1.0) -> Flight:
    """Simulate and estimate; `q` is a factor on the torque's variance that the filter believes."""
    truth, w = rotation(0.3 * rng.normal(size=3)), SIGMA_RATE * rng.normal(size=3)
    start = triad(see(truth, 0.0, rng), np.stack([SUN, field(0.0)]), (SIGMA_SUN, SIGMA_FIELD))
    A, w_found, h = start.R_body_from_reference, np.zeros(3), np.zeros(3)
    first = float(np.linalg.norm(apart(truth, A)))
    belief = Belief.of(np.zeros(6), block_diag(start.covariance, SIGMA_RATE**2 * np.eye(3)))
    density = np.zeros((6, 6))
    density[3:, 3:] = np.linalg.solve(J, np.linalg.solve(J, q * TORQUE**2 * STEP * np.eye(3)).T)
    angle, sigma, nees, wheels = np.empty(n), np.empty(n), np.empty(n), np.empty((n, 3))
    for k in range(n):
        t = k * STEP
        u = -J @ (4e-5 * apart(A, np.eye(3)) + 1e-2 * w_found)  # back to A = I
        F, Q = discretise(partials(A, w_found, h, t), density, STEP)
        truth, w = turn(truth, w, h, t, u + TORQUE * rng.normal(size=3))
        A, w_found, h = *turn(A, w_found, h, t, u), h - u * STEP
        belief = kalman.predict(belief, F, Q)
        seen = see(truth, t + STEP, rng, READINGS)
        sigmas = (SIGMA_SUN, SIGMA_FIELD / np.sqrt(READINGS))
        for i, (reference, noise) in enumerate(zip((SUN, field(t + STEP)), sigmas)):
            if i == 0 and (t % 5600.0) > 3700.0:
                continue  # in the shadow
            computed = A @ reference
            H = np.hstack([skew(computed), np.zeros((3, 3))])
            belief, _ = kalman.update(belief, seen[i] - computed, H, noise**2 * np.eye(3))
            A, w_found = rotation(-belief.mean[:3]) @ A, w_found + belief.mean[3:]
            belief = Belief(mean=np.zeros(6), factor=belief.factor)
        error = np.append(apart(truth, A), w - w_found)
        angle[k], nees[k] = np.linalg.norm(error[:3]), kalman.normalized_error_squared(belief, error)
        sigma[k], wheels[k] = np.sqrt(np.trace(belief.covariance[:3, :3])), h
    return Flight(first, angle, sigma, nees, wheels)


def main() -> None:
    """Print the error along the flight, and what a wrong process noise does."""
    flight = fly(np.random.default_rng(3))
    print(f"start by TRIAD: error {np.degrees(flight.start):.3f} deg")
    for k in (0, 10, 100, 299):
        print(f"step {k:3d}: error {np.degrees(flight.angle[k]):.3f} deg, sigma {np.degrees(flight.sigma[k]):.3f} deg")
    print(f"mean NEES/6 {flight.nees[50:].mean() / 6.0:.2f}")
    believed = fly(np.random.default_rng(3), q=0.01)
    print(f"with torques believed ten times too small {believed.nees[50:].mean() / 6.0:.2f}")


if __name__ == "__main__":
    main()
