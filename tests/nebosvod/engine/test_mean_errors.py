"""Errors with a mean that an estimator leaves out: the estimate moves by it, and all that is said of it holds it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.cli import main
from nebosvod.engine.assembly import nominal_view
from nebosvod.engine.fitting import fit
from nebosvod.engine.truth import draw
from nebosvod.mission import Mission, load_mission, load_mission_text
from nebosvod.pipeline import run
from nebosvod.scene.prior import STATE_NAMES, prior_table
from nebosvod.scene.scene import build_scene
from nebosvod.studies.validation import validate

Array = npt.NDArray[np.float64]
BIAS = "    bias: {sigma: 0.05 arcsec, treatment: estimated}\n"
MEANS = {
    "bias": "    bias: {sigma: 0.05 arcsec, MEAN treatment: T}\n",
    "clock": "    timing: {sigma: 0.5 s, MEAN treatment: T}\n",
}
VALUES = {"bias": "mean_ra: 0.5 arcsec, mean_dec: 0.3 arcsec,", "clock": "mean: 10 s,"}


def mission_with(minimal: Mission, kind: str, treatment: str, mean: bool, extra: str = "") -> Mission:
    """The smallest mission with one error, its mean said or not."""
    assert BIAS in minimal.text
    block = MEANS[kind].replace("MEAN", VALUES[kind] if mean else "").replace("treatment: T", f"treatment: {treatment}")
    return load_mission_text(minimal.text.replace(BIAS, block) + extra)


def first(summary: Any) -> Any:
    return summary["estimators"][0]


@pytest.mark.parametrize("treatment", ["ignored", "considered"])
@pytest.mark.parametrize("kind", MEANS)
def test_a_mean_left_out_moves_the_estimate_by_what_the_summary_says(
    kind: str, treatment: str, minimal: Mission
) -> None:
    """Two runs with one seed differ in nothing but the mean: their difference is the shift, whoever computes it."""
    off, on = (run(mission_with(minimal, kind, treatment, mean), seed=5).summary for mean in (False, True))
    said = np.array(first(on)["mean_error_km_km_s"])
    moved = np.subtract(first(on)["state_km_km_s"], first(off)["state_km_km_s"])
    sigma = np.sqrt(np.diag(first(on)["covariance_km_km_s"]))
    assert np.max(np.abs(said) / sigma) > 0.5
    np.testing.assert_allclose(moved / sigma, said / sigma, atol=0.01 * np.max(np.abs(said) / sigma))
    np.testing.assert_allclose(first(on)["max_deviation_km_km_s"], np.abs(said) + 3.0 * sigma, rtol=1e-9)
    np.testing.assert_allclose(first(off)["max_deviation_km_km_s"], 3.0 * sigma, rtol=1e-3)
    parts = first(on)["mean_error_by_source_km_km_s"]
    np.testing.assert_allclose(np.sum(list(parts.values()), axis=0), said, rtol=1e-9)
    assert any("mean error" in warning for warning in on["warnings"])
    for before, after in zip(off["predictions"], on["predictions"]):
        unit = next(key.removeprefix("semi_axes_") for key in after if key.startswith("semi_axes_"))
        shift, bend = after[f"mean_error_{unit}"], after["nonlinearity"][f"mean_shift_{unit}"]
        expected = np.abs(np.subtract(shift, bend)) + 3.0 * np.array(after[f"sigma_{unit}"])
        np.testing.assert_allclose(after[f"max_deviation_{unit}"], expected, rtol=1e-9)
        assert not np.any(before[f"mean_error_{unit}"])
        if before.get(f"mean_{unit}"):
            moved = np.subtract(after[f"mean_{unit}"], before[f"mean_{unit}"])
            np.testing.assert_allclose(moved, shift, atol=0.03 * float(np.linalg.norm(shift)))


@pytest.mark.parametrize("treatment", ["estimated", "fixed"])
@pytest.mark.parametrize("kind", MEANS)
def test_a_mean_the_estimator_knows_moves_nothing(kind: str, treatment: str, minimal: Mission) -> None:
    off, on = (run(mission_with(minimal, kind, treatment, mean), seed=5).summary for mean in (False, True))
    sigma = np.sqrt(np.diag(first(on)["covariance_km_km_s"]))
    moved = np.subtract(first(on)["state_km_km_s"], first(off)["state_km_km_s"])
    assert np.max(np.abs(moved) / sigma) < 0.02
    assert not np.any(first(on)["mean_error_km_km_s"])
    assert not any("mean error" in warning for warning in on["warnings"])


def test_the_shift_is_the_gain_of_dense_normal_equations_times_the_mean(minimal: Mission) -> None:
    """k M with k = (H^T W H + iP)^-1 H^T W, formed densely from the partials alone."""
    mission = mission_with(minimal, "bias", "ignored", True)
    scene = build_scene(mission)
    priors = prior_table(mission, scene.forces, scene.state)
    psi = draw(scene, priors, np.random.default_rng(1)).psi
    found = fit(scene, mission.estimators[0], nominal_view(scene), psi, priors)
    problem = found.problem
    n = problem.n
    noise = np.array(np.broadcast_to(problem.R, (n, 2, 2)))
    for white in problem.white:
        noise[white.rows] += white.H @ np.broadcast_to(white.Q, (len(white.rows), 3, 3)) @ white.H.transpose(0, 2, 1)
    names = [name for block in problem.blocks if block.treatment == "estimated" for name in block.names]
    H = np.concatenate([b.H for b in problem.blocks if b.treatment == "estimated"], axis=2).reshape(2 * n, -1)
    H_b = np.concatenate([b.H for b in problem.blocks if b.treatment == "ignored"], axis=2).reshape(2 * n, -1)
    mean = np.tile(np.radians([0.5 / 3600.0, 0.3 / 3600.0]), H_b.shape[1] // 2)
    information = np.zeros((len(names), len(names)))  # of the prior: diagonal here, none of the state
    for prior in problem.priors:
        for name, variance in zip(prior.names, np.diag(prior.covariance)):
            if name in names:
                information[names.index(name), names.index(name)] = 1.0 / variance
    scale = np.array([found.estimate.sigma_formal(name) for name in names])
    W = np.zeros((2 * n, 2 * n))
    for k in range(n):
        W[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = np.linalg.solve(noise[k], np.eye(2))
    U = H * scale
    wanted = scale * np.linalg.solve(U.T @ W @ U + np.outer(scale, scale) * information, U.T @ W @ (H_b @ mean))
    sigma = np.array([found.estimate.sigma(name) for name in names])
    said = found.mean_errors.shift(found.estimate, names)
    np.testing.assert_allclose(said / sigma, wanted / sigma, atol=1e-6 * float(np.max(np.abs(wanted / sigma))))
    state = found.mean_error(np.eye(6), STATE_NAMES)
    np.testing.assert_allclose(state, said[:6], rtol=1e-12)


FULL = """estimators:
  - {name: left out, method: batch_qr}
  - {name: known, method: batch_qr, treatment: {bias: estimated}}
"""


@pytest.mark.parametrize("full", [False, True])
def test_validation_draws_the_mean_and_passes_by_k_true_but_not_by_k_formal(
    full: bool, minimal: Mission, tmp_path: Path
) -> None:
    path = tmp_path / "off.yaml"
    path.write_text(mission_with(minimal, "bias", "ignored", True, FULL).text, "utf-8")
    found = validate(load_mission(path), tmp_path / "v", runs=30 if full else 200, full=full)
    left_out, known = found["estimators"]
    assert left_out["passed"], found["verdict"]
    assert known["passed"], found["verdict"]
    assert not left_out["judged"]["formal"]["consistent"]
    assert left_out["judged"]["formal"]["nees"]["value"] > 2.0


def test_monte_carlo_of_a_run_holds_the_mean_and_the_terminal_says_it(
    minimal: Mission, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mission = mission_with(minimal, "bias", "considered", True, "monte_carlo: {runs: 200}\n")
    path = tmp_path / "off.yaml"
    path.write_text(mission.text, "utf-8")
    assert main(["run", str(path), "-o", str(tmp_path / "run"), "--seed", "2"]) == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    low, high = summary["consistency"]["nees_interval_99"]
    assert low < summary["consistency"]["nees_mean"] < high
    for row in summary["predictions"]:
        unit = next(key.removeprefix("semi_axes_") for key in row if key.startswith("semi_axes_"))
        drawn, sigma = row["monte_carlo"], np.array(row[f"sigma_{unit}"])
        mean = np.add(row[f"mean_error_{unit}"], drawn[f"mean_shift_{unit}"])  # truth is the estimate less its error
        assert np.all(np.abs(mean) < 4.0 * sigma / np.sqrt(200) + 0.2 * sigma)
        assert not drawn["misleads"]
    printed = capsys.readouterr().out
    assert "off on average by" in printed
    assert "off on average" in (tmp_path / "run" / "report.html").read_text("utf-8")


def test_the_guaranteed_bound_reaches_as_far_as_the_mean_and_its_sigmas(minimal: Mission) -> None:
    """A bias of mean m and sigma s stays within |m| + 3 s: the bound is that of a larger sigma about zero."""
    prior = "prior: {sigma: {position: 100 km, velocity: 0.01 m/s}}\n"
    left_out = BIAS.replace("treatment: estimated", "treatment: ignored")
    text = minimal.text.replace(BIAS, left_out) + prior
    mean = text.replace("sigma: 0.05 arcsec, ", "sigma: 0.05 arcsec, mean_ra: 0.3 arcsec, ")
    wide = text.replace("sigma: 0.05 arcsec, ", "sigma_ra: 0.15 arcsec, sigma_dec: 0.05 arcsec, ")
    found, wanted, small = (
        [row["guaranteed"] for row in run(load_mission_text(one), seed=1).summary["accuracy_comparison"]["rows"]]
        for one in (mean, wide, text)
    )
    # partials at estimates that the draws have moved differently
    np.testing.assert_allclose(found, wanted, rtol=2e-3)
    assert np.max(np.divide(found, small)) > 1.3
    rows = run(load_mission_text(mean), seed=1).summary["accuracy_comparison"]["rows"]
    assert any("On average it is off by" in row["statement"] for row in rows)
