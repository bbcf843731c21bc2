"""Sigma of the energy integral of a lunar trajectory, by projecting a state covariance.

The energy h = v^2/2 - mu/r decides how far from the Moon a spacecraft arrives. Its error is not the sum of the
errors of position and velocity: they are correlated along the orbit and cancel for the most part. km, km/s.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.estimation import Block, Estimate, LinearProblem
from nebosvod.estimation.solvers import batch

Array = npt.NDArray[np.float64]
MU_EARTH = 398600.4418  # km3/s2, EGM2008
NAMES = ("x", "y", "z", "vx", "vy", "vz")


@dataclass(frozen=True)
class Energy:
    """Energy of a state with its sigma, the sigma if position and velocity errors were independent, the axis's."""

    value: float
    sigma: float
    sigma_independent: float
    semi_major_axis_km: float
    sigma_axis_km: float


def track(state: Array, sigma_km: float = 0.05, n: int = 60, step_s: float = 60.0) -> Estimate:
    """Estimate the state from positions measured along the first hour, with the transition of a two-body arc."""
    Phi = np.eye(6)
    rows = []
    x = state.copy()
    for _ in range(n):
        rows.append(Phi[:3].copy())
        x, Phi = _step(x, Phi, step_s)
    problem = LinearProblem(
        residual=np.zeros((n, 3)),
        R=sigma_km**2 * np.eye(3),
        blocks=(Block(name="state", names=NAMES, H=np.stack(rows)),),
    )
    return batch.solve(problem)


def _step(x: Array, Phi: Array, step: float) -> tuple[Array, Array]:
    """One Runge-Kutta step of the state and its transition matrix."""

    def rate(y: Array) -> Array:
        r = float(np.linalg.norm(y[:3]))
        gradient = MU_EARTH * (3.0 * np.outer(y[:3], y[:3]) / r**5 - np.eye(3) / r**3)
        P = y[6:].reshape(6, 6)
        out = np.concatenate([y[3:6], -MU_EARTH * y[:3] / r**3, np.vstack([P[3:], gradient @ P[:3]]).reshape(-1)])
        return out

    y = np.concatenate([x, Phi.reshape(-1)])
    a = rate(y)
    b = rate(y + 0.5 * step * a)
    c = rate(y + 0.5 * step * b)
    d = rate(y + step * c)
    y = y + step / 6.0 * (a + 2 * b + 2 * c + d)
    return y[:6], y[6:].reshape(6, 6)


def energy(state: Array, estimate: Estimate) -> Energy:
    """Project the covariance of the state on the energy."""
    r, v = float(np.linalg.norm(state[:3])), float(np.linalg.norm(state[3:]))
    value = 0.5 * v**2 - MU_EARTH / r
    gradient = np.concatenate([MU_EARTH * state[:3] / r**3, state[3:]])
    sigma = float(estimate.predict(gradient[None], NAMES).sigma[0])
    K = estimate.K_true.copy()
    K[:3, 3:] = K[3:, :3] = 0.0
    axis = -0.5 * MU_EARTH / value
    return Energy(
        value=value,
        sigma=sigma,
        sigma_independent=float(np.sqrt(gradient @ K @ gradient)),
        semi_major_axis_km=axis,
        sigma_axis_km=float(abs(axis / value) * sigma),
    )


def injection_state() -> Array:
    """A translunar injection: perigee at 200 km, apogee at the Moon's distance."""
    perigee, apogee = 6578.0, 384_400.0
    speed = np.sqrt(2.0 * MU_EARTH * apogee / (perigee * (perigee + apogee)))
    return np.array([perigee, 0.0, 0.0, 0.0, speed * np.cos(0.5), speed * np.sin(0.5)])


def main() -> None:
    """Print the energy and its error."""
    state = injection_state()
    found = energy(state, track(state))
    print(f"energy {found.value:.5f} km2/s2, sigma {found.sigma:.3e}")
    print(f"  if position and velocity errors were independent: {found.sigma_independent:.3e}")
    print(f"semi-major axis {found.semi_major_axis_km:.0f} km +- {found.sigma_axis_km:.1f} km")


if __name__ == "__main__":
    main()
