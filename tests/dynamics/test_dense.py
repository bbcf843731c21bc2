"""Dense output: the polynomial of a step integrated once and twice, and the table of steps of both legs."""

import numpy as np
import pytest

from nebosvod.dynamics import ForceModel, propagate
from nebosvod.dynamics.collocation import NODES, POSITION_WEIGHTS, WEIGHTS
from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.dense import step_of, step_weights
from nebosvod.timescale import Epoch

Array = np.ndarray


def weights_at(s: float, h: float) -> tuple[Array, Array]:
    weights = np.empty(16)
    step_weights(8, s, h, weights)
    return weights[:8], weights[8:]


@pytest.mark.parametrize("h", [2.0, -0.5])
@pytest.mark.parametrize("s", [0.0, 0.1, 0.5, 0.93, 1.0, 1.2])
def test_weights_integrate_every_polynomial_through_the_nodes(s: float, h: float) -> None:
    """1e-14 of h and h^2: degrees 0 to 7, once and twice, from the start of the step to the fraction s."""
    once, twice = weights_at(s, h)
    for degree in range(8):
        acceleration = NODES**degree
        wanted = h * s ** (degree + 1) / (degree + 1)
        assert once @ acceleration == pytest.approx(wanted, abs=1e-14 * abs(h) * max(1.0, s**8))
        wanted = h * h * s ** (degree + 2) / ((degree + 1) * (degree + 2))
        assert twice @ acceleration == pytest.approx(wanted, abs=1e-14 * h * h * max(1.0, s**9))


def test_weights_at_the_end_of_a_step_are_those_of_the_integrator() -> None:
    once, twice = weights_at(1.0, 1.0)
    assert np.abs(once - WEIGHTS).max() < 1e-15
    assert np.abs(twice - POSITION_WEIGHTS).max() < 1e-15


def test_a_time_belongs_to_the_step_that_begins_before_it() -> None:
    """An edge opens the later step; what is outside goes to the outermost steps."""
    edges = np.array([-3.0, -1.0, 0.0, 2.0, 7.0])
    found = [step_of(t, edges) for t in (-4.0, -3.0, -1.5, -1.0, -0.1, 0.0, 1.9, 2.0, 6.9, 7.0, 8.0)]
    assert found == [0, 0, 0, 1, 1, 2, 2, 3, 3, 3, 3]


@pytest.mark.parametrize("days", [[-40.0, 60.0], [-40.0], [60.0]])
def test_steps_of_both_legs_fill_the_span_without_gap(
    full_forces: ForceModel, neo: tuple[Epoch, Array], days: list[float]
) -> None:
    """Edges ascend from the first to the last time, the epoch among them, and each step is continued by the next."""
    epoch, start = neo
    arc = propagate(start, epoch, np.array(days) * DAY_S, full_forces, margin_s=0.0)
    edges = arc.step_edges_s
    assert (np.diff(edges) > 0.0).all()
    assert arc.span_s == (min(0.0, days[0]) * DAY_S, max(0.0, days[-1]) * DAY_S)
    assert 0.0 in edges
    inner = edges[1:-1]
    for t in inner:
        k = step_of(t, edges)
        width = np.nextafter(t, -np.inf)
        before, after = arc.at([width]), arc.at([t])
        assert step_of(width, edges) == k - 1
        assert np.abs(before.state - after.state)[:, :3].max() < 1e-6  # km: 60 ns at 30 km/s, and rounding
        assert np.abs(before.Phi - after.Phi)[:, :3, :3].max() < 1e-12
        size = np.abs(arc.zeta[-1]).max(axis=0)
        assert (np.abs(before.zeta - after.zeta)[0].max(axis=0) <= 1e-12 * size).all()
