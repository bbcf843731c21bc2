"""Estimators limited to some telescopes: what they say is what a mission with these telescopes alone says."""

from pathlib import Path

import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.mission import load_mission_text
from nebosvod.pipeline import run
from nebosvod.results.result import Result

HEAD = """schema_version: 1
name: limited
reference_epoch: 2028-03-20T00:00:00 TDB
object:
  name: Example
  orbit: {kind: keplerian, frame: ecliptic_j2000, epoch: 2028-03-20T00:00:00 TDB, a: 1.3 au, e: 0.2, i: 8 deg,
          node: 0 deg, peri: 180 deg, M: 0 deg}
telescopes:
  - name: A
    orbit: {kind: heliocentric, lead: 10 deg}
    noise: {sigma: 0.1 arcsec}
    bias: {sigma: 0.05 arcsec, treatment: estimated}
    position: {sigma: 3 km, correlation: white, treatment: estimated}
"""
OTHER = """  - name: B
    orbit: {kind: heliocentric, lead: -10 deg}
    noise: {sigma: 0.12 arcsec}
    bias: {treatment: estimated}
    position: {sigma: 4 km, correlation: gauss_markov, time: 5 d, treatment: estimated}
"""
TAIL = """shared:
  - {{name: frame, position: {{sigma: 5 km, correlation: constant, treatment: considered}}}}
schedule: [{{start: 2028-03-20T00:00:00 TDB, end: 2028-04-19T00:00:00 TDB, cadence: 2 d}}]
predictions: [{{name: later, plane: position, at: 2028-04-29T00:00:00 TDB}}]
estimators: [{{name: own, method: {method}{taken}}}]
"""


def nominal(text: str) -> Result:
    """The run without drawn errors."""
    return run(load_mission_text(text), nominal=True)


@pytest.mark.parametrize("method", ["batch_qr", "batch_identity", "recursive"])
def test_an_estimator_of_one_telescope_says_what_a_mission_with_it_alone_says(method: str) -> None:
    """K_true, degrees of freedom and every share; B's bias, which has no sigma, is not asked for."""
    limited = nominal(HEAD + OTHER + TAIL.format(method=method, taken=", telescopes: [A]"))
    alone = nominal(HEAD + TAIL.format(method=method, taken=""))
    mine, true = limited.summary["estimators"][0], alone.summary["estimators"][0]
    sigma = np.sqrt(np.diag(true["covariance_km_km_s"]))
    close = np.array(mine["covariance_km_km_s"]) - np.array(true["covariance_km_km_s"])
    assert np.abs(close / sigma[:, None] / sigma).max() < 1e-7
    assert mine["dof"] == true["dof"]
    budget = {row["source"]: row["share_total"] for row in limited.summary["predictions"][0]["budget"]}
    for row in alone.summary["predictions"][0]["budget"]:
        assert budget.pop(row["source"]) == pytest.approx(row["share_total"], abs=1e-8)
    assert budget == {"measurement noise B": pytest.approx(0.0, abs=1e-20)}
    assert limited.summary["n_observations"] == 2 * alone.summary["n_observations"]


@pytest.mark.parametrize(
    ("taken", "method", "words"),
    [
        (", telescopes: [C]", "batch_qr", 'estimators[0].telescopes[0]: unknown telescope (got "C"; allowed: A, B)'),
        (", telescopes: [A]", "smoother", "smoother goes through all measurements one by one"),
        (", telescopes: A", "batch_qr", "estimators[0].telescopes: "),
    ],
)
def test_telescopes_that_are_not_there_and_filters_are_refused(
    taken: str, method: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m.yaml").write_text(HEAD + OTHER + TAIL.format(method=method, taken=taken), "utf-8")
    assert main(["check", str(tmp_path / "m.yaml")]) == 2
    assert words in capsys.readouterr().err
