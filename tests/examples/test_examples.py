"""The worked systems run through estimation alone and give what they claim."""

import ast
import importlib.util
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


def test_the_combined_algorithm_agrees_with_the_dense_reference():
    example = load("map_navigation")
    errors = []
    for seed in range(6):
        found = example.navigate(np.random.default_rng(seed))
        sigma = np.sqrt(np.diag(found.reference_covariance))
        assert np.max(np.abs(found.combined.mean[:2] - found.reference_mean) / sigma) < 0.15
        ratio = np.sqrt(np.diag(found.combined.covariance))[:2] / sigma
        assert np.all((ratio > 0.85) & (ratio < 1.15))
        errors.append((found.combined.mean[:2] - found.truth[:2]) / sigma)
    assert np.sqrt(np.mean(np.square(errors))) < 2.0
