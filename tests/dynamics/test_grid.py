"""Grids: the steps and nodes of one orbit serve near ones; the expansion of the far field loses nothing."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel, Trajectory, propagate, propagator
from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.ephemeris import PLANETS
from nebosvod.errors import StepLimitError
from nebosvod.timescale import Epoch

Array = np.ndarray
Neo = tuple[Epoch, Array]
NEAR = np.array([300.0, -200.0, 100.0, 1e-5, 2e-5, -1e-5])
WEIGHT = np.array([1.0, 1.0, 1.0, 1e7, 1e7, 1e7])
TIMES = np.array([-80.0, 10.0, 365.25]) * DAY_S


@pytest.mark.parametrize("sensitivities", [True, False])
@pytest.mark.parametrize("relativity", ["sun", "eih"])
def test_an_orbit_on_the_grid_of_another_is_the_same_orbit(
    full_forces: ForceModel, neo: Neo, sensitivities: bool, relativity: Any
) -> None:
    """1 mm at a year, 1e-10 of the partials: both are converged."""
    epoch, start = neo
    forces = ForceModel(
        ephemeris=full_forces.ephemeris,
        relativity=relativity,
        radiation=full_forces.radiation,
        nongrav=full_forces.nongrav,
        parameters=full_forces.parameters,
    )
    grid = propagate(start, epoch, TIMES, forces, sensitivities)
    changed = forces.with_values({"radius_m": 190.0, "a2_au_d2": 5e-14})
    own = propagate(start + NEAR, epoch, TIMES, changed, sensitivities)
    on_grid = propagate(start + NEAR, epoch, TIMES, changed, sensitivities, grid=grid)
    assert np.array_equal(on_grid.step_edges_s, grid.step_edges_s)
    assert not np.array_equal(on_grid.step_edges_s, own.step_edges_s)
    assert np.abs((on_grid.state - own.state) * WEIGHT).max() < 1e-6
    if sensitivities:
        scale = np.abs(own.Phi[2] * WEIGHT[:, None] / WEIGHT).max()
        assert np.abs((on_grid.Phi - own.Phi) * WEIGHT[:, None] / WEIGHT).max() < 1e-10 * scale
        size = np.abs(own.zeta * WEIGHT[:, None]).max(axis=(0, 1))
        assert (np.abs((on_grid.zeta - own.zeta) * WEIGHT[:, None]).max(axis=(0, 1)) < 1e-9 * size).all()


def test_a_grid_of_states_serves_an_orbit_with_partials(full_forces: ForceModel, neo: Neo) -> None:
    epoch, start = neo
    grid = propagate(start, epoch, TIMES, full_forces, False)
    on_grid = propagate(start, epoch, TIMES, full_forces, grid=grid)
    own = propagate(start, epoch, TIMES, full_forces)
    assert np.array_equal(on_grid.step_edges_s, own.step_edges_s)
    assert np.abs((on_grid.Phi - own.Phi) * WEIGHT[:, None] / WEIGHT).max() < 1e-9


def exchanged(ephemeris: Ephemeris) -> Ephemeris:
    """A solar system in which Venus and Mars have changed places but not their masses."""
    series = list(ephemeris._series)
    venus, mars = PLANETS.index("venus"), PLANETS.index("mars")
    series[venus], series[mars] = series[mars], series[venus]
    return dataclasses.replace(ephemeris, _series=tuple(series), _windows={}, _coverage={}, _suns={})


def test_a_grid_that_does_not_fit_is_not_used(full_forces: ForceModel, neo: Neo) -> None:
    epoch, start = neo
    own = propagate(start, epoch, TIMES, full_forces, False)
    other_span = propagate(start, epoch, TIMES * 0.5, full_forces, False)
    other_epoch = propagate(start, epoch + 5 * DAY_S, TIMES, full_forces, False)
    bare = ForceModel(ephemeris=full_forces.ephemeris, asteroids=False)
    other_bodies = propagate(start, epoch, TIMES, bare, False)
    flat = ForceModel(ephemeris=full_forces.ephemeris, relativity="none")
    other_relativity = propagate(start, epoch, TIMES, flat, False)
    other_system = propagate(start, epoch, TIMES, ForceModel(ephemeris=exchanged(full_forces.ephemeris)), False)
    for grid in (other_span, other_epoch, other_bodies, other_relativity, other_system):
        again = propagate(start, epoch, TIMES, full_forces, False, grid=grid)
        assert np.array_equal(again.state, own.state)


def test_an_orbit_that_the_grid_is_too_coarse_for_gets_its_own_steps(full_forces: ForceModel, neo: Neo) -> None:
    epoch, start = neo
    sunward = start * np.array([0.5, 0.5, 0.5, 1.2, 1.2, 1.2])
    grid = propagate(start, epoch, TIMES, full_forces, False)
    own = propagate(sunward, epoch, TIMES, full_forces, False)
    again = propagate(sunward, epoch, TIMES, full_forces, False, grid=grid)
    assert np.array_equal(again.step_edges_s, own.step_edges_s)
    assert np.array_equal(again.state, own.state)


def test_expanded_field_is_the_full_one_to_rounding(
    full_forces: ForceModel, neo: Neo, summed_forces: Any, inside: Any
) -> None:
    """1e-15 of the acceleration (27 terms in another order) and 1e-13 of the gradient, 100 m from the expansion."""
    epoch, start = neo
    physics = full_forces.physics(epoch)
    window = full_forces.ephemeris.window(epoch, 0.0, 10 * DAY_S, asteroids=True)
    w = inside.make_work(window.layout.shape[0], 0)
    inside.read_ephemeris(8, 0.0, 5 * DAY_S, w, physics, window.coefficients, window.layout, window.timing)
    sun = full_forces.ephemeris.state_km_km_s("sun", epoch, w.t)
    path = start + sun
    path[:, :3] += np.outer(w.t, start[3:])
    w.X[:], w.V[:] = path[:, :3].T.ravel(), path[:, 3:].T.ravel()
    inside.expand_here(8, w, physics)
    w.X[:] += np.random.default_rng(2).uniform(-0.1, 0.1, 24)
    expanded = np.zeros(24)
    full, gradient = summed_forces(8, w, physics)
    inside.expanded_field(8, w.X, w.X0, w.R0, w.S0, w.P, physics.gm[0], expanded)
    inside.add_small_forces(8, w, physics, expanded)
    assert np.abs(expanded - full).max() < 1e-15 * np.abs(full).max()
    inside.shifts(8, w.X, w.X0, w.change[16:])
    inside.expanded_jacobian(8, w, physics)
    assert np.abs(gradient - w.G).max() < 1e-13 * np.abs(gradient).max()


def test_a_repeated_window_of_times_costs_one_table_of_nodes(full_forces: ForceModel, neo: Neo) -> None:
    epoch, start = neo
    grid = propagate(start, epoch, TIMES, full_forces, False)
    second = propagate(start + NEAR, epoch, TIMES, full_forces, False, grid=grid)
    third = propagate(start - NEAR, epoch, TIMES, full_forces, False, grid=second)
    assert second._table.nodes is grid._table.nodes
    assert third._table.nodes is grid._table.nodes
    assert propagator.NO_GUIDES[0][0].start.size == 0


@pytest.mark.parametrize("model", ["sun", "eih"])
def test_grid_of_the_sun_alone_does_not_serve_all_planets(full_forces: ForceModel, neo: Neo, model: Any) -> None:
    """1 mm: nodes kept for one kind of relativity hold no velocities for another."""
    epoch, start = neo
    first, second = (
        ForceModel(ephemeris=full_forces.ephemeris, relativity=kind)
        for kind in (model, "eih" if model == "sun" else "sun")
    )
    grid = propagate(start, epoch, TIMES, first, False)
    propagate(start, epoch, TIMES, first, False, grid=grid)
    own, again = (propagate(start + NEAR, epoch, TIMES, second, False, grid=g) for g in (None, grid))
    assert np.abs((again.state - own.state) * WEIGHT).max() < 1e-6


def test_threads_may_share_a_grid_that_has_no_nodes_yet(full_forces: ForceModel, neo: Neo) -> None:
    """Both legs, eight at once, ten grids: each orbit is bit by bit the one of a single thread."""
    epoch, start = neo
    wanted = propagate(start + NEAR, epoch, TIMES, full_forces, False, grid=grid_of(start, epoch, full_forces)).state
    with ThreadPoolExecutor(8) as pool:
        for _ in range(10):
            grid = grid_of(start, epoch, full_forces)
            found = pool.map(
                lambda _, g=grid: propagate(start + NEAR, epoch, TIMES, full_forces, False, grid=g), range(8)
            )
            assert all(np.array_equal(orbit.state, wanted) for orbit in found)
            assert len(grid._table.nodes) == 2


def grid_of(start: Array, epoch: Epoch, forces: ForceModel) -> Trajectory:
    return propagate(start, epoch, TIMES, forces, False)


def test_an_encounter_long_after_the_epoch_keeps_its_grid(ephemeris: Ephemeris) -> None:
    """The rounding of time grows with it and is part of the floor, on a grid as without one."""
    far = Epoch.parse("2029-03-01T00:00:00 TDB")
    earth, sun = (ephemeris.state_km_km_s(body, far, 0.0)[0] for body in ("earth", "sun"))
    forces = ForceModel(ephemeris=ephemeris)
    near = propagate(earth - sun + np.array([4e4, 0.0, 0.0, 0.0, 9.0, 3.0]), far, [-20.0 * DAY_S], forces, False)
    epoch = far + -25.0 * 365.25 * DAY_S
    start = propagate(near.state[0], far + -20.0 * DAY_S, [epoch - (far + -20.0 * DAY_S)], forces, False).state[0]
    times = [far - epoch + 20.0 * DAY_S]
    grid = propagate(start, epoch, times, forces, False)
    again = propagate(start, epoch, times, forces, False, grid=grid)
    assert again._table.nodes is grid._table.nodes
    assert np.array_equal(again.step_edges_s, grid.step_edges_s)


def test_a_grid_has_no_more_steps_than_are_allowed(full_forces: ForceModel, neo: Neo) -> None:
    epoch, start = neo
    grid = grid_of(start, epoch, full_forces)
    with pytest.raises(StepLimitError, match="the 2 steps it may take"):
        propagate(start + NEAR, epoch, TIMES, full_forces, False, grid=grid, most_steps=2)
