"""The worked systems run through estimation alone and give what they claim."""

import ast
import importlib.util
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
NAMES = sorted(path.stem for path in EXAMPLES.glob("*.py"))


def load(name: str) -> ModuleType:
    """Import one example by its path."""
    spec = importlib.util.spec_from_file_location(f"example_{name}", EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", NAMES)
def test_every_example_runs_is_short_and_needs_estimation_only(name, capsys):
    text = (EXAMPLES / f"{name}.py").read_text()
    assert len(text.splitlines()) <= 150
    imported = {node.module for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom)}
    assert all(m.startswith("nebosvod.estimation") for m in imported if m and m.startswith("nebosvod"))
    load(name).main()
    assert capsys.readouterr().out


def test_an_ignored_offset_makes_the_line_optimistic_and_two_stage_equals_the_batch():
    example = load("line_with_bias")
    estimated, considered, ignored = example.compare()
    assert estimated.formal == pytest.approx(estimated.true, rel=1e-12)
    assert ignored.true > 3.0 * ignored.formal
    assert estimated.true < considered.true
    assert considered.true == pytest.approx(ignored.true, rel=1e-12)
    assert example.two_stage_sigma() == pytest.approx(estimated.true, rel=1e-5)  # its prior of 1e6 stands for none


def test_the_magnetometer_offset_is_found_within_its_sigma():
    example = load("magnetometer_offset")
    errors = []
    for seed in range(60):
        flight = example.fly(np.random.default_rng(seed))
        found = example.find_offset(flight)
        assert found.status == "converged"
        error = np.array([found.deviation[name] for name in example.NAMES]) - flight.offset
        errors.append(np.linalg.solve(found.estimate.S_true, error))
    # 180 whitened components: mean square within 99.9 % chi-square bounds
    assert 0.68 < np.mean(np.square(errors)) < 1.38


def test_the_energy_is_known_better_than_position_and_velocity_apart():
    example = load("energy_integral")
    state = example.injection_state()
    found = example.energy(state, example.track(state))
    assert found.sigma < 0.5 * found.sigma_independent
    assert found.semi_major_axis_km == pytest.approx(0.5 * (6578.0 + 384_400.0), rel=1e-12)
    step = 1e-3 * abs(found.value)  # the axis's sigma by a finite difference of a = -mu / 2h
    slope = (example.MU_EARTH / (2 * (found.value - step)) - example.MU_EARTH / (2 * (found.value + step))) / (2 * step)
    assert found.sigma_axis_km == pytest.approx(abs(slope) * found.sigma, rel=1e-5)


def test_the_attitude_filter_converges_and_is_consistent():
    example = load("satellite_attitude")
    flights = [example.fly(np.random.default_rng(seed)) for seed in range(8)]
    for flight in flights:
        assert flight.angle[-1] < 4.0 * flight.sigma[-1]
        assert flight.angle[0] > flight.angle[-1]
        assert np.linalg.norm(flight.drift_error) < 1e-5
    mean = np.mean([flight.nees[100:].mean() for flight in flights]) / 3.0
    assert 0.5 < mean < 1.6  # errors of one flight are correlated: a loose bound


@pytest.mark.parametrize("seed", [5, 9])  # after 20 minutes the position is one bump there
def test_blocks_over_a_map_agree_with_a_great_many_particles(seed):
    """The first 20 minutes from a prior of 1 km: moments of 50 000 particles that know nothing of blocks."""
    example = load("map_navigation")
    voyage = example.sail(np.random.default_rng(seed), 1.0)
    short = replace(voyage, steps=voyage.steps[:10], measures=voyage.measures[:10])
    *_, last = example.combined(short)
    cloud = example.particles(short, np.random.default_rng(0), 50_000)
    unit = np.sqrt(np.diag(cloud.covariance))[:2]  # what one block says of rates is lost with its mean position
    assert last.last == 9
    assert np.max(np.abs(last.belief.mean - cloud.mean)[:2] / unit) < 0.25
    ratio = np.sqrt(np.diag(last.belief.covariance))[:2] / unit
    assert np.all((ratio > 0.85) & (ratio < 1.2))


def require_table(example: ModuleType, runs: dict[float, int]) -> dict[float, dict[str, tuple[float, float, int]]]:
    """The comparison at some priors; what holds for any number of runs."""
    table = {prior: example.compare(prior, count, ("combined", "extended")) for prior, count in runs.items()}
    for prior, rows in table.items():
        rms, nees, lost = rows["combined"]
        assert lost == 0, prior
        assert rms < 0.30
        assert nees < 2.5
    return table


def test_the_combined_algorithm_loses_no_run_where_the_extended_filter_does():
    table = require_table(load("map_navigation"), {0.15: 1, 2.5: 2})
    assert table[2.5]["extended"][0] > 1.0
    assert table[2.5]["extended"][1] > 50.0


@pytest.mark.long
def test_a_hundred_voyages_at_each_prior():
    table = require_table(load("map_navigation"), dict.fromkeys((0.15, 1.0, 2.5), 100))
    for rows in table.values():
        rms, nees, _ = rows["combined"]
        assert rms < 0.205
        assert 0.70 < nees < 1.37  # 99.9 % of chi-square with 200 degrees of freedom
    assert table[1.0]["extended"][1] > 50.0


def test_a_short_arc_is_condensed_as_a_dense_grid_has_it_and_honestly():
    example = load("short_arc")
    truth, observed = example.observe(np.random.default_rng(1))
    found = example.solve(np.random.default_rng(1))
    np.testing.assert_array_equal(found.truth, truth)
    sigma = np.diag(example.PRIOR.factor)[:2]
    axis = np.linspace(-4.5, 4.5, 161)
    nodes = example.PRIOR.mean[:2] + np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2) * sigma
    dense = example.block_of(nodes, observed).moments()
    unit = np.sqrt(np.diag(dense.covariance))
    assert np.max(np.abs(found.grid.mean - dense.mean) / unit) < 0.01
    assert np.max(np.abs(found.grid.covariance - dense.covariance) / np.outer(unit, unit)) < 0.02
    # the equivalent measurement carries the filter there, a direction that taught nothing apart
    assert np.max(np.abs(found.filtered.mean - found.grid.mean) / unit) < 0.02
    assert abs(dense.covariance[0, 1]) > 0.9 * unit[0] * unit[1]  # a ridge: range and rate are felt together
    arcs = [example.solve(np.random.default_rng(seed)) for seed in range(20)]
    nees = [np.sum(np.linalg.solve(arc.grid.factor, arc.grid.mean - arc.truth) ** 2) for arc in arcs]
    low, high = 0.64, 1.45  # 99 % of chi-square with 80 degrees of freedom, over 80
    assert low < np.mean(nees) / 4.0 < high


def test_the_attitude_with_dynamics_and_wheels_is_found_and_a_small_q_shows():
    """From half a degree by TRIAD to about 0.012 deg, honestly; torques believed ten times too small show at once."""
    example = load("satellite_wheels")
    flights = [example.fly(np.random.default_rng(seed)) for seed in range(3)]
    believed = example.fly(np.random.default_rng(2), q=0.01)  # torques ten times too small
    nees = np.mean([flight.nees.mean() for flight in flights]) / 6.0
    assert 0.66 < nees < 1.3  # errors of one flight are correlated: a loose bound
    assert 30.0 < believed.nees[50:].mean() / 6.0 < 80.0
    assert np.degrees(np.sqrt(np.mean([flight.start**2 for flight in flights]))) > 0.3
    ends = np.concatenate([flight.angle[200:] for flight in flights])
    assert 0.009 < np.degrees(np.sqrt(np.mean(ends**2))) < 0.016
    # the balance of noise and disturbance about the Sun's direction, by hand; the field is at times not across it
    noise = (np.radians(0.4) / np.sqrt(200)) ** 2 * 10.0
    disturbance = (2e-8 / 1.1) ** 2 * 10.0
    balance = np.sqrt(np.sqrt(2.0) * noise**0.75 * disturbance**0.25)
    assert np.degrees(balance) == pytest.approx(0.008, abs=0.0005)
    for flight in flights:
        assert balance < flight.sigma[-1] < 2.0 * balance
        assert flight.angle[-1] < 3.5 * flight.sigma[-1]
        assert np.abs(flight.wheels[-1]).max() > 1e-6  # they have taken up the torques


def test_the_equations_of_motion_of_the_satellite_keep_their_integrals():
    """Far from gravity: energy and inertial momentum of body and wheels stay; and partials are differences."""
    example = load("satellite_wheels")
    A, w, h = example.rotation(np.array([0.3, -0.2, 0.5])), np.array([2e-3, -1e-3, 3e-3]), np.array([1e-3, 2e-3, -1e-3])
    vars(example)["ORBIT"] = 0.0
    B, v = A, w
    for k in range(20):
        B, v = example.turn(B, v, h, k * example.STEP, np.zeros(3))
    np.testing.assert_allclose(B.T @ (example.J @ v + h), A.T @ (example.J @ w + h), rtol=1e-5)
    assert v @ example.J @ v == pytest.approx(w @ example.J @ w, rel=1e-5)
    vars(example)["ORBIT"] = 2.0 * np.pi / 5600.0
    D, e = example.partials(A, w, h, 50.0), 1e-6
    for k in range(3):
        tilt = e * np.eye(3)[k]
        sides = [example.acceleration(example.rotation(-sign * tilt) @ A, w, h, 50.0, np.zeros(3)) for sign in (1, -1)]
        np.testing.assert_allclose((sides[0] - sides[1]) / (2 * e), D[3:, k], rtol=1e-5, atol=1e-12)
        sides = [example.acceleration(A, w + sign * tilt, h, 50.0, np.zeros(3)) for sign in (1, -1)]
        np.testing.assert_allclose((sides[0] - sides[1]) / (2 * e), D[3:, 3 + k], rtol=1e-5, atol=1e-12)


def test_the_magnetometers_zero_is_found_in_flight_from_a_start_by_triad():
    example = load("magnetometer_dynamics")
    flights = [example.fly(np.random.default_rng(seed), 60) for seed in range(6)]
    whitened = np.array([flight.offset_error[-1] / flight.offset_sigma[-1] for flight in flights])
    assert 0.3 < np.mean(whitened**2) < 2.2  # 99.9 % of chi-square with 18 degrees of freedom: 0.27 to 2.35
    for flight in flights:
        assert np.all(flight.offset_sigma[-1] < 0.1 * example.OFFSET)
        assert flight.angle[-1] < np.radians(0.5)
    assert np.degrees(np.mean([flight.start_angle for flight in flights])) > 1.0  # TRIAD alone
