"""The flag of a bent target plane: the second order of a parabola, and of a circle by its closed form."""

import numpy as np
import pytest

from nebosvod.impacts.bend import bend_of

SIGMAS = np.linspace(-5.0, 5.0, 401)


def test_a_straight_line_is_not_bent() -> None:
    points = np.outer(SIGMAS, [300.0, 4000.0]) + np.array([7000.0, -2000.0])
    one = bend_of(SIGMAS, points, 10_000.0, 2.0)
    assert one is not None
    assert one.aside_km == pytest.approx(0.0, abs=1e-6)
    assert one.along_sigmas == pytest.approx(0.0, abs=1e-9)
    assert not one.matters


@pytest.mark.parametrize(("hits", "nu"), [(3.0, 3.0), (-3.0, 3.0), (0.2, 1.0)])
def test_a_parabola_has_its_own_second_order(hits: float, nu: float) -> None:
    """5000 s + 10 s^2 along the line and 60 s^2 aside of it, on turned axes."""
    along, aside = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    points = np.outer(5000.0 * SIGMAS + 10.0 * SIGMAS**2, along) + np.outer(60.0 * SIGMAS**2, aside)
    one = bend_of(SIGMAS, points, 10_000.0, hits)
    assert one is not None
    assert one.aside_km == pytest.approx(60.0 * nu**2, rel=1e-6)
    assert one.along_sigmas == pytest.approx(10.0 * nu**2 / 5000.0, rel=1e-6)
    assert not one.matters
    assert bend_of(SIGMAS, points, 300.0, 3.0).matters  # type: ignore[union-attr]


def test_a_circle_is_bent() -> None:
    """Of radius R, one sigma an angle of a tenth: R s^2/200 aside."""
    angle = 0.1 * SIGMAS
    one = bend_of(SIGMAS, 1e6 * np.stack([np.cos(angle), np.sin(angle)], axis=1), 10_000.0, 1.0)
    assert one is not None
    assert one.aside_km == pytest.approx(5000.0, rel=2e-3)
    assert one.matters
    assert "no probability is made of it" in one.said


def test_without_an_encounter_about_the_estimate_there_is_no_flag() -> None:
    points = np.full((401, 2), np.nan)
    points[300:] = 1.0
    assert bend_of(SIGMAS, points, 1e4, 3.0) is None
