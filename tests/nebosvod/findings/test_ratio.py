"""Noise against nuisance of a mission: the numbers of the source, whatever the form and the epoch of the prior."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.mission import load_mission_text
from nebosvod.pipeline import run
from nebosvod.results.result import Result

ARCSEC = np.pi / 648000.0
SIGMAS = "prior: {sigma: {position: 1000 km, velocity: 0.2 m/s}}\n"
SMALL = {
    "170 m, sigma: 20 m": "1 m, sigma: 0.1 m",
    "6.1e10 kg, sigma: 1.5e10 kg": "1.2e4 kg, sigma: 3e3 kg",
    "0.05 arcsec": "0.0001 arcsec",
    "3 km, correlation": "0.01 km, correlation",
}


def small(text: str) -> str:
    """A body light enough to feel the radiation, and telescopes without errors of their own."""
    for old, new in SMALL.items():
        assert old in text
        text = text.replace(old, new)
    return text


def covariance(epoch: str) -> str:
    rows = ", ".join(str([v if i == j else 0 for j in range(6)]) for i, v in enumerate([1e6] * 3 + [4e-8] * 3))
    return f"prior: {{names: [x, y, z, vx, vy, vz], epoch: {epoch}, frame: icrf, covariance: [{rows}]}}\n"


@pytest.fixture(scope="module")
def large(neb_text: str) -> Result:
    return run(load_mission_text(neb_text + SIGMAS))


def block(result: Result) -> Any:
    return result.summary["noise_to_nuisance"]


def test_the_mean_ratios_of_the_source_are_ratios_of_sums(large: Result) -> None:
    """5.81 dB with c and z, 2.90 dB with biases too: from an audit, by dense algebra of its own."""
    assert block(large)["eta_db_mean"] == pytest.approx(5.81, abs=0.01)
    assert block(large)["eta_all_db_mean"] == pytest.approx(2.90, abs=0.01)


def test_every_number_is_that_of_sums_over_single_measurements(large: Result) -> None:
    """H_c S H_c^T + H_z Q H_z^T written out from the partials of the run."""
    H_c, H_z = large.arrays["H_c"], large.arrays["H_z"]
    names = [str(name) for name in large.arrays["parameter_names"]]
    S = np.diag([{"radius_m": 20.0, "mass_kg": 1.5e10, "albedo": 0.05}[name] ** 2 for name in names])
    place = np.array([np.trace(9.0 * h @ h.T) for h in H_z])
    nuisance = np.array([np.trace(h @ S @ h.T) for h in H_c]) + place
    noise = 2.0 * (0.1 * ARCSEC) ** 2
    found = block(large)
    np.testing.assert_allclose(found["eta_db"], 10.0 * np.log10(noise / nuisance), atol=1e-9)
    assert found["eta_db_mean"] == pytest.approx(10.0 * np.log10(noise / nuisance.mean()), abs=1e-9)
    bias = 2.0 * (0.05 * ARCSEC) ** 2
    assert found["eta_all_db_mean"] == pytest.approx(10.0 * np.log10(noise / (nuisance + bias).mean()), abs=1e-9)
    assert found["sigma_nuisance_arcsec"] == pytest.approx(np.sqrt(nuisance.mean() / 2.0) / ARCSEC, rel=1e-9)
    total = 0.1 * np.sqrt(1.0 + 10.0 ** (-found["eta_db_mean"] / 10.0))
    assert found["sigma_equivalent_arcsec"] == pytest.approx(total, rel=1e-9)
    alone = np.sqrt(np.mean(nuisance / place)) * 3.0
    assert found["sigma_z_equivalent_km"] == pytest.approx(alone, rel=1e-9)
    assert found["n_below_eta_min"] == np.count_nonzero(np.array(found["eta_db"]) < 20.0)
    first = np.asarray(large.arrays["telescope_index"]) == 0
    row = found["by_telescope"][0]
    assert row["eta_db_mean"] == pytest.approx(10.0 * np.log10(noise / nuisance[first].mean()), abs=1e-9)


def test_a_prior_at_another_epoch_or_as_a_matrix_changes_no_ratio(neb_text: str) -> None:
    """Given at t0 as sigmas, as a covariance, or 45 d earlier: the dynamic parameters are as uncertain in all three."""
    texts = (SIGMAS, covariance("2028-11-15T00:00:00 TDB"), covariance("2028-10-01T00:00:00 TDB"))
    sigmas, now, earlier = (block(run(load_mission_text(small(neb_text) + text))) for text in texts)
    assert sigmas["eta_db"][-1] == pytest.approx(-25.8, abs=0.1)
    for other in (now, earlier):
        np.testing.assert_allclose(other["eta_db"], sigmas["eta_db"], atol=1e-6)
        for key in ("eta_db_mean", "eta_effective_db_mean", "eta_all_db_mean", "sigma_equivalent_arcsec"):
            assert other[key] == pytest.approx(sigmas[key], abs=1e-6)


def test_the_mission_says_what_counts_and_how_large_the_ratio_should_be(large: Result, neb_text: str) -> None:
    text = neb_text + SIGMAS + "noise_to_nuisance: {eta_min: 10 dB, nuisances: [bias]}\n"
    chosen = block(run(load_mission_text(text)))
    assert chosen["eta_db_mean"] == pytest.approx(20.0 * np.log10(2.0), abs=1e-9)
    assert chosen["eta_all_db_mean"] == pytest.approx(block(large)["eta_all_db_mean"], abs=1e-9)
    limits, critical = chosen["sigma_z_limit_km"], np.median(chosen["sigma_z_critical_km"])
    assert limits["10_dB"] == pytest.approx(critical / np.sqrt(10.0), rel=1e-9)
    assert chosen["n_below_eta_min"] == len(chosen["eta_db"])


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("{eta_min: 20}", "needs a ratio with a unit"),
        ("{eta_min: 1e9 dB}", "out of range"),
        ("{nuisances: []}", "at least 1"),
        ("{nuisances: [orbit]}", "parameters"),
    ],
)
def test_what_it_cannot_count_is_refused_where_it_stands(
    entry: str, words: str, neb_text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text(f"{neb_text}noise_to_nuisance: {entry}\n", "utf-8")
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert "noise_to_nuisance" in said
    assert words in said
