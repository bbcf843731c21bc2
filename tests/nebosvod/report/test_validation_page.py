"""The page of a campaign: says what the judge says, draws every direction, and carries exact numbers."""

import html
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.report.validation_page import make_validation_report, write_validation_report
from nebosvod.studies.outcomes import Direction
from nebosvod.studies.trust import Claim, judge
from nebosvod.studies.verdict_rows import judgement

AXES = ("radially", "along the track", "normal to the orbit plane")


def campaign(size: float) -> dict[str, Any]:
    """What validation.json holds of 500 runs whose along-track error is `size` times what the covariance says."""
    rng = np.random.default_rng(4)
    errors = rng.normal(size=(500, 6))
    errors[:, 1] *= size
    axes = np.eye(6)
    directions = [Direction(group="position", name=AXES[k], unit="km", weights=axes[k]) for k in range(3)]
    nis = rng.chisquare(50, (500, 1)) / 50
    claim = Claim(factor=axes, nis=nis, nis_components=np.array([50.0]), independent=True)
    judged = {"claimed": True, **judgement(judge(errors, claim, directions, axes, ["<A>"], 0.01))}
    passed = judged["consistent"]
    reason = "" if passed else "its sigma is wrong"
    row = {"name": "batch", "n_failed": 0, "reason": reason, "judged": {"true": judged}}
    return {
        "mission": "m", "title": "A mission", "object": "Example", "reference_epoch_tdb": "2028-03-20T00:00:00.000 TDB",
        "n_observations": 62, "telescopes": ["<A>"], "versions": {"nebosvod": "0.1.0"}, "mission_sha256": "ab" * 32,
        "seed": 0, "n_runs": 500, "mode": "linear", "method": "truths linear", "family_level": 0.01, "passed": passed,
        "verdict": "every estimator keeps its word" if passed else "batch is wrong", "estimators": [row],
    }  # fmt: skip


@pytest.mark.parametrize(("size", "tone"), [(1.0, "good"), (1.3, "bad")])
def test_page_says_what_the_judge_says_and_draws_every_direction(size: float, tone: str) -> None:
    found = campaign(size)
    judged = found["estimators"][0]["judged"]["true"]
    page = make_validation_report(found)
    assert f'<section id="verdict" class="{tone}"' in page
    assert html.escape(judged["verdict"]) in page
    assert ("1 of 3 directions rejected" in page) is (tone == "bad")
    shown = {float(v) for v in re.findall(r'<data value="([^"]+)"', page)}
    for row in judged["directions"]:
        assert {row["sigma_claimed"], row["sigma_sample"], row["mean_error"], row["p"]} <= shown
    for level in judged["coverage"]:
        assert {level["value"], *level["value_interval_99"]} <= shown
    assert judged["nis"][0]["value"] in shown
    assert page.count("<figure") == 2
    assert page.count("download=") == 2
    assert "&lt;A&gt;" in page
    assert page.count("<script") == 1


def test_page_stands_beside_the_numbers_and_is_the_same_each_time(tmp_path: Path) -> None:
    found = campaign(1.0)
    path = write_validation_report(tmp_path, found)
    assert path.name == "validation.html"
    assert [p.name for p in tmp_path.iterdir()] == ["validation.html"]
    assert path.read_text("utf-8") == make_validation_report(found)


def test_campaign_without_a_judged_estimator_still_has_its_page() -> None:
    found = campaign(1.0)
    found["estimators"][0]["judged"] = {}
    page = make_validation_report({**found, "passed": False, "verdict": "nothing could be judged"})
    assert "Nothing could be judged" in page
    assert "<figure" not in page
