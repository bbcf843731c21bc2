"""Map-aided navigation by the combined algorithm, beside extended and iterated Kalman filters and a particle filter.

An inertial system drifts in two coordinates; an echo sounder measures the height of the bottom below it, every two
minutes one height and every ten a frame of 5 x 5, with a slowly varying error of its own. The map is relief.asc. The
Kalman filters linearise it where they believe to be. State: error of position (km), of velocity (km/h), of sounder (m).
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.interpolate import RectBivariateSpline

from nebosvod.estimation.filters import kalman
from nebosvod.estimation.filters.block_loop import Condensed, Step, follow
from nebosvod.estimation.filters.kalman import Belief

Array = npt.NDArray[np.float64]
STEP, MEASUREMENTS = 1.0 / 30.0, 60  # h
SPEED, NOISE, TAU, SOUNDER = np.array([12.0, 3.0]), 30.0, 0.5, 15.0  # km/h, m, h, m
SIGMA_V, Q_V = 0.5, 0.1  # km/h, (km/h)^2 / h
FRAME = np.stack(np.meshgrid(*[np.linspace(-0.8, 0.8, 5)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
CELL, LOST = 0.7, 1.0  # km: the map changes over so much; an error that counts as lost


def read_map(path: Path) -> RectBivariateSpline:
    """Read an ESRI ASCII grid; a smooth surface over (x, y), km."""
    lines = path.read_text("utf-8").splitlines()
    head = {word: float(value) for word, value in (line.split() for line in lines[:6])}
    rows = np.array([line.split() for line in lines[6:]], dtype=np.float64)[::-1]  # from the south
    x = head["xllcenter"] + head["cellsize"] * np.arange(head["ncols"])
    y = head["yllcenter"] + head["cellsize"] * np.arange(head["nrows"])
    return RectBivariateSpline(x, y, rows.T)


MAP = read_map(Path(__file__).with_name("relief.asc"))


@dataclass(frozen=True)
class Sail:
    """One voyage: the filter's steps, map values with their partials, the truth (n, 5), the belief at the start."""

    steps: list[Step]
    measures: list[Callable[[Array], tuple[Array, Array]]]
    truth: Array
    start: Belief


def sail(rng: np.random.Generator, prior: float) -> Sail:
    """Draw a voyage that begins with a position error of `prior` km in each coordinate."""
    decay = np.exp(-STEP / TAU)
    F = np.eye(5)
    F[0, 2] = F[1, 3] = STEP
    F[4, 4] = decay
    Q = np.diag([0.0, 0.0, Q_V * STEP, Q_V * STEP, SOUNDER**2 * (1.0 - decay**2)])
    sigma = np.array([prior, prior, SIGMA_V, SIGMA_V, SOUNDER])
    x, steps, measures, truth = sigma * rng.normal(size=5), [], [], []
    for k in range(MEASUREMENTS):
        x = F @ x + np.sqrt(np.diag(Q)) * rng.normal(size=5)
        seen = SPEED * STEP * k + (FRAME if k % 5 == 4 else np.zeros((1, 2)))
        p = len(seen)
        H = np.zeros((p, 3))
        H[:, 2] = 1.0

        def predict(nodes: Array, seen: Array = seen) -> Array:
            where = nodes[:, None] + seen
            return np.asarray(MAP.ev(where[..., 0], where[..., 1]))

        def measure(at: Array, seen: Array = seen, H: Array = H) -> tuple[Array, Array]:
            px, py = (at[:2] + seen).T
            slope = np.stack([MAP.ev(px, py, dx=1), MAP.ev(px, py, dy=1)], axis=1)
            return MAP.ev(px, py) + H @ at[2:], np.hstack([slope, H])

        observed = predict(x[None, :2])[0] + x[4] + NOISE * rng.normal(size=p)
        steps.append(Step(F=F, Q=Q, observed=observed, predict=predict, H=H, R=NOISE**2 * np.eye(p)))
        measures.append(measure)
        truth.append(x)
    return Sail(steps, measures, np.array(truth), Belief.of(np.zeros(5), np.diag(sigma**2)))


def combined(voyage: Sail) -> list[Condensed]:
    """The combined algorithm: blocks along the voyage."""
    return list(follow(voyage.start, voyage.steps, 2, cell=CELL))


def extended(voyage: Sail, iterations: int = 1) -> Belief:
    """An extended Kalman filter, iterated or not, at the end."""
    belief = voyage.start
    for step, measure in zip(voyage.steps, voyage.measures):
        belief = kalman.predict(belief, step.F, step.Q)
        if iterations > 1:
            belief, _, _ = kalman.iterated_update(belief, step.observed, measure, step.R, limit=iterations)
            continue
        value, H = measure(belief.mean)
        belief, _ = kalman.update(belief, step.observed - value, H, step.R)
    return belief


def particles(voyage: Sail, rng: np.random.Generator, count: int = 2000) -> Belief:
    """A bootstrap particle filter with systematic resampling, at the end; mean and covariance of the cloud."""
    x = voyage.start.mean + rng.normal(size=(count, 5)) @ voyage.start.factor.T
    for step in voyage.steps:
        x = x @ step.F.T + rng.normal(size=(count, 5)) * np.sqrt(np.diag(step.Q))
        miss = (step.observed - step.predict(x[:, :2]) - x[:, 4:]) / NOISE
        logs = -0.5 * np.sum(miss**2, axis=1)
        weight = np.exp(logs - logs.max())
        edges = np.cumsum(weight) / weight.sum()
        x = x[np.searchsorted(edges, (np.arange(count) + rng.uniform()) / count).clip(max=count - 1)]
    return Belief.of(x.mean(axis=0), np.cov(x.T) + 1e-12 * np.eye(5))


METHODS: dict[str, Callable[[Sail, np.random.Generator], Belief]] = {
    "combined": lambda voyage, rng: combined(voyage)[-1].belief,
    "extended": lambda voyage, rng: extended(voyage),
    "iterated": lambda voyage, rng: extended(voyage, 20),
    "particles": particles,
}


def compare(prior: float, runs: int, methods: tuple[str, ...] = tuple(METHODS)) -> dict[str, tuple[float, float, int]]:
    """For each method: rms of the position error at the end (km), mean NEES / 2, and runs lost by more than 1 km."""
    errors: dict[str, list[tuple[float, float]]] = {name: [] for name in methods}
    for seed in range(runs):
        voyage = sail(np.random.default_rng([seed, round(100 * prior)]), prior)
        for name in methods:
            found = METHODS[name](voyage, np.random.default_rng(seed))
            away = found.mean[:2] - voyage.truth[-1, :2]
            errors[name].append((float(away @ away), float(away @ np.linalg.solve(found.covariance[:2, :2], away))))
    table = {}
    for name, rows in errors.items():
        square, nees = np.array(rows).T
        table[name] = (float(np.sqrt(square.mean())), float(nees.mean() / 2.0), int(np.sum(square > LOST**2)))
    return table


def main(runs: int = 1) -> None:
    """Print the table; 100 runs take ten minutes: python examples/map_navigation.py 100."""
    print("prior   method       rms    NEES/2  lost")
    for prior in (0.15, 1.0, 2.5):
        for name, (rms, nees, lost) in compare(prior, runs).items():
            print(f"{prior:4.2f} km {name:10s} {rms:6.3f} km {nees:8.2f} {lost:4d}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
