"""What is read off a table, against closed forms and brute force."""

import numpy as np
import pytest
from scipy.stats import qmc

from nebosvod.studies.finding import front, indices


def test_indices_of_ishigamis_function_are_those_of_its_closed_form() -> None:
    """Homma, Saltelli 1996, Reliability Engineering and System Safety 52, 1: a = 7, b = 0.1."""
    a, b, n = 7.0, 0.1, 2**15

    def of(x: np.ndarray) -> np.ndarray:
        return np.sin(x[..., 0]) + a * np.sin(x[..., 1]) ** 2 + b * x[..., 2] ** 4 * np.sin(x[..., 0])

    both = np.pi * (2.0 * qmc.Sobol(6, seed=np.random.default_rng(1)).random(n) - 1.0)
    first, second = both[:, :3], both[:, 3:]
    values = [of(first), of(second)]
    for column in range(3):
        mixed = first.copy()
        mixed[:, column] = second[:, column]
        values.append(of(mixed))
    variance = a**2 / 8 + b * np.pi**4 / 5 + b**2 * np.pi**8 / 18 + 0.5
    v1, v2 = 0.5 * (1 + b * np.pi**4 / 5) ** 2, a**2 / 8
    v13 = b**2 * np.pi**8 * (1 / 18 - 1 / 50)
    one, total = indices(np.stack(values, axis=1))
    assert one == pytest.approx([v1 / variance, v2 / variance, 0.0], abs=0.01)
    assert total == pytest.approx([(v1 + v13) / variance, v2 / variance, v13 / variance], abs=0.01)


def test_the_front_holds_what_no_other_point_beats() -> None:
    rng = np.random.default_rng(5)
    x, y = np.round(rng.random((2, 200)), 2)  # with equal numbers
    x[7], y[8] = np.nan, np.nan
    rows = front(x, y)
    pairs = {(x[k], y[k]) for k in range(200) if np.isfinite(x[k] + y[k])}
    beaten = {p for p in pairs for q in pairs if q != p and q[0] <= p[0] and q[1] <= p[1]}
    assert {(x[k], y[k]) for k in rows} == pairs - beaten
    assert len(rows) == len(pairs - beaten)
