"""Dense output: any time, any order, without integrating again."""

import dataclasses

import numpy as np
import pytest

from nebosvod.dynamics import ForceModel, integrator, propagate
from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.trajectory import Trajectory
from nebosvod.errors import CoverageError, InputError
from nebosvod.timescale import Epoch

WEIGHT = np.array([1.0, 1.0, 1.0, 1e7, 1e7, 1e7])


@pytest.fixture(scope="module")
def arc(full_forces: ForceModel) -> Trajectory:
    start = np.array([-83626000.0, 128056000.0, 45477000.0, -23.93, -10.4, -4.47])
    return propagate(start, Epoch.parse("2025-03-01T00:00:00 TDB"), [-200 * DAY_S, 300 * DAY_S], full_forces)


def test_between_the_steps_it_is_as_good_as_an_integration_that_ends_there(arc: Trajectory) -> None:
    """1 cm, 0.1 um/s (the polynomial of a step misses the acceleration by 3e-10 of it), 1e-9 of partials; both legs."""
    times = np.random.default_rng(5).uniform(-200.0, 300.0, 40) * DAY_S
    dense = arc.at(times)
    start = arc.at([0.0]).state[0]
    for k, t in enumerate(times):
        direct = propagate(start, arc.epoch, [t], arc.forces, margin_s=0.0)
        gap_km, gap_km_s = np.abs(dense.state[k] - direct.state[0]).reshape(2, 3).max(axis=1)
        assert gap_km < 1e-5
        assert gap_km_s < 1e-10
        error = np.abs((dense.Phi[k] - direct.Phi[0]) * WEIGHT[:, None] / WEIGHT).max()
        assert error < 1e-9 * np.abs(direct.Phi[0] * WEIGHT[:, None] / WEIGHT).max()
        gap = np.abs((dense.zeta[k] - direct.zeta[0]) * WEIGHT[:, None]).max(axis=0)
        assert (gap <= 1e-9 * np.abs(arc.zeta[1] * WEIGHT[:, None]).max(axis=0)).all()


@pytest.mark.parametrize("start_km", [(-83626000.0, 128056000.0, 45477000.0), (-133626000.0, 28056000.0, 15477000.0)])
def test_before_the_epoch_the_first_step_reaches_back_over_a_margin(
    full_forces: ForceModel, start_km: tuple[float, ...]
) -> None:
    """0.1 mm, 1e-8 mm/s: the same six hours integrated backward, for the same orbit as one that needs them."""
    start, epoch = np.array([*start_km, -23.93, -10.4, -4.47]), Epoch.parse("2025-03-01T00:00:00 TDB")
    ahead = propagate(start, epoch, [0.0, 300 * DAY_S], full_forces)
    assert ahead.span_s[0] == -21600.0
    assert len(ahead.step_edges_s) == len(
        propagate(start, epoch, [300 * DAY_S], full_forces, margin_s=0.0).step_edges_s
    )
    times = np.linspace(-21600.0, -1.0, 7)
    back = propagate(start, epoch, times, full_forces, margin_s=0.0)
    state, partials = ahead.variations_at(times)
    assert np.abs(state - back.state)[:, :3].max() < 1e-7
    assert np.abs(state - back.state)[:, 3:].max() < 1e-11
    error = np.abs((partials[:, :, :6] - back.Phi) * WEIGHT[:, None] / WEIGHT).max()
    assert error < 1e-9 * np.abs(back.Phi * WEIGHT[:, None] / WEIGHT).max()


def test_before_an_epoch_of_short_steps_the_margin_is_integrated(full_forces: ForceModel) -> None:
    """1 cm: an orbit 60,000 km from the Earth at its epoch, whose steps are hours, six hours before it."""
    epoch = Epoch.parse("2025-03-01T00:00:00 TDB")
    earth = full_forces.ephemeris.state_km_km_s("earth", epoch, np.zeros(1))[0] - full_forces.ephemeris.sun_at(epoch)
    start = earth + np.array([60000.0, 0.0, 0.0, 3.0, 5.0, 1.0])
    ahead = propagate(start, epoch, [0.0, 30 * DAY_S], full_forces)
    back = propagate(start, epoch, [-21600.0], full_forces, margin_s=0.0)
    assert np.abs(ahead.state_at([-21600.0])[0] - back.state[0])[:3].max() < 1e-5


def test_it_is_continuous_over_the_edges_of_steps(arc: Trajectory) -> None:
    """1e-5 km: rounding of 1e8 km, over 1 ms of motion."""
    edges = arc.step_edges_s[1:-1]
    left, right = arc.state_at(edges - 5e-4), arc.state_at(edges + 5e-4)
    assert np.abs((right - left)[:, :3] - 1e-3 * right[:, 3:]).max() < 1e-5


def test_velocity_is_the_derivative_of_position(arc: Trajectory) -> None:
    times = np.linspace(-199.0, 299.0, 50) * DAY_S
    ahead, behind = arc.state_at(times + 30.0), arc.state_at(times - 30.0)
    assert np.abs((ahead - behind)[:, :3] / 60.0 - arc.state_at(times)[:, 3:]).max() < 2e-8  # km/s


def test_order_and_shape_follow_the_request(arc: Trajectory) -> None:
    times = np.array([3.0, -5.0, 3.0, 0.0]) * DAY_S
    asked = arc.at(times)
    assert np.array_equal(asked.t_s, times)
    assert asked.state.shape == (4, 6)
    assert asked.Phi.shape == (4, 6, 6)
    assert asked.zeta.shape == (4, 6, 7)
    assert asked.parameter_names == arc.forces.parameters
    assert np.array_equal(asked.state[0], asked.state[2])
    assert asked.span_s == arc.span_s
    assert np.array_equal(arc.state_at(times), asked.state)


def test_results_are_read_only(arc: Trajectory) -> None:
    for array in (arc.t_s, arc.state, arc.Phi, arc.zeta):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_trajectory_is_frozen(arc: Trajectory) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        arc.epoch = arc.epoch + 1.0  # type: ignore[misc]


def test_what_is_handed_out_is_a_copy(arc: Trajectory) -> None:
    """The caller's times stay writable; edges and chain may be changed without a change of the trajectory."""
    times = np.array([0.0, 1.0])
    asked = arc.at(times)
    times[0] = 5.0
    assert asked.t_s[0] == 0.0
    for name in ("step_edges_s", "chain"):
        handed = getattr(arc, name)
        kept = handed.copy()
        handed[:] = 7.0
        assert np.array_equal(getattr(arc, name), kept)


def test_dense_output_integrates_nothing(arc: Trajectory, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("integrated again")

    monkeypatch.setattr(integrator, "integrate", refuse)
    assert arc.at(np.linspace(*arc.span_s, 50)).zeta.shape == (50, 6, 7)


def test_integrated_columns_and_chain_give_phi_and_zeta(arc: Trajectory) -> None:
    """The same bytes: `at` is made of them."""
    times = np.array([-20.0, 50.0]) * DAY_S
    state, columns = arc.variations_at(times)
    asked = arc.at(times)
    assert np.array_equal(state, asked.state)
    assert np.array_equal(columns[:, :, :6], asked.Phi)
    assert np.array_equal(columns[:, :, 6:] @ arc.chain, asked.zeta)


def test_states_alone_have_no_partials_and_no_names(full_forces: ForceModel, arc: Trajectory) -> None:
    bare = propagate(arc.at([0.0]).state[0], arc.epoch, [DAY_S], full_forces, False)
    assert bare.parameter_names == ()
    for ask in (lambda: bare.Phi, lambda: bare.zeta, lambda: bare.variations_at([0.0])):
        with pytest.raises(InputError, match="without sensitivities"):
            ask()


@pytest.mark.parametrize("t", [-201.0 * DAY_S, 300.1 * DAY_S, np.nan])
def test_times_outside_are_refused(arc: Trajectory, t: float) -> None:
    for ask in (arc.at, arc.state_at, arc.variations_at):
        with pytest.raises(CoverageError, match="integrated span"):
            ask([0.0, t])


def test_ends_of_the_span_are_sharp_to_a_microsecond(arc: Trajectory) -> None:
    """Seconds over a decade have a grain of 60 ns, and a span is sums of them."""
    first, last = arc.span_s
    assert arc.at([first - 5e-7, last + 5e-7]).state.shape == (2, 6)
    for t in (first - 2e-6, last + 2e-6):
        with pytest.raises(CoverageError, match="propagate further"):
            arc.at([t])


def test_times_need_one_axis(arc: Trajectory) -> None:
    with pytest.raises(InputError, match="shape"):
        arc.at(np.zeros((2, 2)))
