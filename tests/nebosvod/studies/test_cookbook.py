"""The questions of docs/studies.md, in small: each is read, and its first and last points have an answer."""

import re
from pathlib import Path

import pytest

from nebosvod.studies.reading import load_study_text
from nebosvod.studies.study import evaluate_row, requirement_of

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "studies.md").read_text("utf-8")
STUDIES = re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
(CATALOGUE,) = re.findall(r"^```text\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)


def test_there_are_five_questions_beside_the_first_example() -> None:
    assert len(STUDIES) == 6
    assert sum("require:" in text for text in STUDIES) == sum("sobol:" in text for text in STUDIES) == 1


@pytest.mark.parametrize("text", STUDIES, ids=lambda text: re.search(r"study: (.*)", text)[1])
def test_each_is_read_and_answers(text: str, tmp_path: Path) -> None:
    (tmp_path / "objects.csv").write_text(CATALOGUE, "utf-8")
    study = load_study_text(text, path=tmp_path / "study.yaml")
    for number in (0, study.rows - 1):
        status, message, found = evaluate_row(study, number)
        assert status in ("ok", "not_seen"), message
        assert status == "not_seen" or all(value is not None for value in found)


def test_what_the_page_says_is_required_is_what_comes_out() -> None:
    """With fewer halvings than the command makes: the numbers of the page have two digits."""
    found = requirement_of(load_study_text(next(text for text in STUDIES if "require:" in text)))
    assert found is not None
    rows = {row["name"]: row for row in found["each"]}
    assert f"{rows['noise']['needed']:.3f}" == "0.057"
    assert f"{rows['cadence']['needed']:.2f}" == "0.33"
    assert f"{rows['bias']['floor']:.1f}" == "11.7"
    assert found["together"]["answer"] == pytest.approx(9.0, rel=1e-3)
    assert found["together"]["cost"] < found["together"]["cost_equally"]
