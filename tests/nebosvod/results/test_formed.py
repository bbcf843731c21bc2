"""Covariances in summary.json: positive definite as read back from the file, or left out with a reason."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.estimation.accuracy.formed import definite, formed
from nebosvod.fits.orbit import OrbitAt
from nebosvod.results.fit_summary import orbit_block
from nebosvod.results.fit_tables import orbit_table
from nebosvod.results.outlook import answered
from nebosvod.timescale import Epoch

WEAK = "prior: {sigma: {position: POSITION, velocity: 1 km/s}}\n"
SCHEDULE = "  - {start: 2028-03-20T00:00:00 TDB, end: 2028-04-19T00:00:00 TDB, cadence: 1 d}\n"


BEHIND = "  - {name: behind, like: ahead, orbit: {lead: -10 deg}}\n"


def arc(end: str, cadence: str) -> str:
    """A schedule from the reference epoch on."""
    return f"  - {{start: 2028-03-20T00:00:00 TDB, end: 2028-{end} TDB, cadence: {cadence}}}\n"


# one telescope whose range of the object comes from the curvature of a short arc, or from a weak prior
CASES = {
    "a day": (arc("03-21T00:00:00", "2 h"), ""),
    "an hour": (arc("03-20T01:00:00", "10 min"), ""),
    "a minute": (arc("03-20T00:01:00", "10 s"), ""),
    "a second": (arc("03-20T00:00:01", "0.25 s"), ""),
    "a second and a weak prior": (arc("03-20T00:00:01", "0.25 s"), WEAK.replace("POSITION", "1e7 km")),
    "a month and a weaker prior": (SCHEDULE, WEAK.replace("POSITION", "1e8 km")),
}


def blocks(node: Any) -> Iterator[Mapping[str, Any]]:
    """Every mapping of a summary that has a covariance."""
    if isinstance(node, dict):
        if any(key.startswith("covariance") and key != "covariance_reason" for key in node):
            yield node
        for value in node.values():
            yield from blocks(value)
    elif isinstance(node, list):
        for value in node:
            yield from blocks(value)


def judge(summary: Any) -> tuple[int, int]:
    """Check every covariance; how many stand and how many were left out."""
    stand = lost = 0
    for block in blocks(summary):
        for key, value in block.items():
            if not key.startswith("covariance") or key == "covariance_reason":
                continue
            if value is None:
                assert key in block["covariance_reason"] or "determine" in block["covariance_reason"]
                factor = "factor" + key.removeprefix("covariance").removesuffix("2")
                S = block[factor]
                assert S is None or (np.isfinite(S).all() and np.linalg.matrix_rank(S / np.linalg.norm(S, axis=1)) > 0)
                lost += 1
            else:
                K = np.array(value)
                assert (K == K.T).all()
                np.linalg.cholesky(K)
                np.linalg.cholesky(K[::-1, ::-1])
                np.linalg.cholesky(K / np.sqrt(np.outer(np.diag(K), np.diag(K))))
                stand += 1
    return stand, lost


@pytest.mark.parametrize("case", CASES)
def test_every_covariance_of_a_run_is_positive_definite_or_left_out_with_a_reason(
    case: str, minimal_text: str, tmp_path: Path
) -> None:
    schedule, prior = CASES[case]
    text = minimal_text.replace(BEHIND, "").replace(SCHEDULE, schedule) + prior
    text += (
        "estimators:\n  - {name: a, method: batch_qr}\n  - {name: b, method: batch_qr, treatment: {bias: ignored}}\n"
    )
    path = tmp_path / "weak.yaml"
    path.write_text(text, "utf-8")
    code = main(["run", str(path), "-o", str(tmp_path / "run")])
    assert code in (0, 1)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    stand, lost = judge(summary)
    assert lost > 0 if case in ("an hour", "a minute", "a second") else lost == 0 < stand
    for block in blocks(summary):
        assert (block["covariance_reason"] is None) == all(
            value is not None for key, value in block.items() if key.startswith("covariance_") and "reason" not in key
        )
    assert main(["report", str(tmp_path / "run")]) == 0
    for row in answered(summary["predictions"]):
        S = np.array(row["factor_km"])
        np.testing.assert_allclose(np.linalg.norm(S, axis=1), row["sigma_km"], rtol=1e-9)


def test_a_matrix_is_formed_while_its_axes_differ_by_less_than_round_off_shows() -> None:
    """Rotated axes of lengths 1 and r: the condition number of the matrix is r^2 times that of round-off's reach."""
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    for ratio, stands in ((1.0, True), (1e3, True), (1e6, True), (1e8, False), (1e12, False)):
        K = formed(turn @ np.diag([ratio, 1.0]))
        assert (K is not None) == stands
        if K is not None:
            np.linalg.cholesky(json.loads(json.dumps(K)))
    assert formed(np.diag([1e12, 1e-12])) is not None  # scales alone cost nothing
    assert formed(np.zeros((1, 1))) is None
    assert not definite(np.array([[1.0, np.nan], [np.nan, 1.0]]))


@pytest.mark.parametrize("ratio", [1e2, 1e13])
def test_a_fitted_orbit_and_its_elements_keep_the_same_promise(ratio: float) -> None:
    """An orbit whose range is known `ratio` times worse than the rest, as of a very short arc."""
    state = np.array([1.5e8, 3.0e7, 1.0e7, -8.0, 29.0, 3.0])
    scale = np.array([1.0, 1.0, 1.0, 1e-6, 1e-6, 1e-6])
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(6, 6)))[0]
    S = scale[:, None] * (turn * np.array([ratio, ratio**0.5, 1.0, 1.0, 1.0, 1.0]))
    one = OrbitAt(epoch=Epoch.parse("2028-03-20 TDB"), state=state, S=S, S_formal=S, gm_sun_km3_s2=1.32712440041e11)
    block = orbit_block(one)
    stand, lost = judge(block)
    assert (stand, lost) == ((2, 0) if ratio < 1e6 else (0, 2))
    held = np.array([orbit_table([one]).columns["covariance_00"][0]])
    assert np.isfinite(held).all() == (ratio < 1e6)
    elements = np.array(block["elements"]["factor"])
    sigma = [block["elements"][name]["sigma"] for name in block["elements"]["names"]]
    np.testing.assert_allclose(np.linalg.norm(elements, axis=1), sigma, rtol=1e-9)


def test_compare_takes_runs_without_a_formed_covariance(minimal_text: str, tmp_path: Path) -> None:
    folders = []
    for name in ("a day", "an hour"):
        path = tmp_path / f"{name}.yaml"
        path.write_text(minimal_text.replace(BEHIND, "").replace(SCHEDULE, CASES[name][0]), "utf-8")
        assert main(["run", str(path), "-o", str(tmp_path / name)]) in (0, 1)
        folders.append(str(tmp_path / name))
    assert main(["compare", *folders, "--page", str(tmp_path / "page.html")]) == 0
