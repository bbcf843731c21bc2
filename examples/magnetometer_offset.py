"""Zero offset of a satellite's magnetometer by least squares from (simulated) flight data.

The modulus of the field does not depend on attitude, so |B_measured - offset| must equal the model's |B| along the
orbit: a nonlinear problem for three offsets, solved by Gauss-Newton. Fields in nT.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.estimation import Block, IterationResult, LinearProblem, gauss_newton

Array = npt.NDArray[np.float64]
NAMES = ("offset x", "offset y", "offset z")


@dataclass(frozen=True)
class Flight:
    """Simulated flight data: measured field in body axes (n, 3), model modulus (n,), true offset (3,), noise."""

    measured: Array
    modulus: Array
    offset: Array
    sigma: float


def fly(rng: np.random.Generator, n: int = 300, sigma: float = 50.0) -> Flight:
    """Fly a tumbling satellite through a dipole field on a polar orbit."""
    latitude = np.linspace(0.0, 4.0 * np.pi, n)
    modulus = 25_000.0 * np.sqrt(1.0 + 3.0 * np.sin(latitude) ** 2)
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    offset = np.array([900.0, -1500.0, 400.0])
    measured = modulus[:, None] * direction + offset + sigma * rng.normal(size=(n, 3))
    return Flight(measured, modulus, offset, sigma)


def find_offset(flight: Flight) -> IterationResult:
    """Estimate the offset from the moduli; no prior is needed."""

    def linearise(deviation: Mapping[str, float]) -> LinearProblem:
        offset = np.array([deviation.get(name, 0.0) for name in NAMES])
        left = flight.measured - offset
        length = np.linalg.norm(left, axis=1)
        # the modulus of a noisy vector is longer by sigma^2 / |B| on the average: two noisy components across
        computed = flight.modulus + flight.sigma**2 / flight.modulus
        return LinearProblem(
            residual=(length - computed)[:, None],
            R=[[flight.sigma**2]],
            blocks=(Block(name="offset", names=NAMES, H=(left / length[:, None])[:, None, :]),),
        )

    return gauss_newton(linearise)


def main() -> None:
    """Print the offset found, its sigma and its error."""
    flight = fly(np.random.default_rng(1))
    found = find_offset(flight)
    print(found.message)
    for name, truth in zip(NAMES, flight.offset):
        value, sigma = found.deviation[name], found.estimate.sigma(name)
        print(f"{name}: {value:9.1f} nT +- {sigma:.1f}, error {value - truth:+.1f}")


if __name__ == "__main__":
    main()
