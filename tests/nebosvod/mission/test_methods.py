"""What methods of estimation ask of a mission: a prior, errors that they can carry, something beside the orbit."""

from pathlib import Path

import pytest

from nebosvod.errors import InputError
from nebosvod.mission import Mission, load_mission_text

BASE = (Path(__file__).resolve().parents[3] / "scenarios" / "apophis-2029.yaml").read_text("utf-8")


def mission(*edits: tuple[str, str]) -> Mission:
    """The flagship mission with some edits."""
    text = BASE
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    return load_mission_text(text, "m.yaml")


def refusal(*edits: tuple[str, str]) -> str:
    """The message of an edited mission that must be refused."""
    with pytest.raises(InputError) as caught:
        mission(*edits)
    return str(caught.value)


PRIOR_SIGMA = ("prior: none  ", "prior: {sigma: {position: 1000 km, velocity: 1 m/s}}  ")


@pytest.mark.parametrize("method", ["two_stage", "hsieh_chen", "ekf", "smoother", "schmidt", "as_printed"])
def test_filters_that_start_from_a_prior_say_what_of_it_is_missing(method: str) -> None:
    edit = ("method: recursive", f"method: {method}")
    assert f"estimators[3].method: {method} starts from a prior orbit, and the mission has none" in refusal(edit)
    assert mission(edit, PRIOR_SIGMA).estimators[3].method == method
    bias = ("bias: {sigma: 0.05 arcsec, treatment: estimated}", "bias: {treatment: estimated}")
    found = refusal(edit, PRIOR_SIGMA, bias)
    assert f"{method} needs a sigma of bias NEB-1, bias NEB-2; give it one, or use recursive" in found
    assert "A2" not in found  # it is fixed


def test_errors_correlated_in_time_are_for_filters_that_carry_them() -> None:
    slow = ("correlation: white", "correlation: gauss_markov, time: 6 h")
    said = "cannot carry an error correlated in time (telescope position NEB-1, telescope position NEB-2)"
    held = ("treatment: estimated}   # assumption: each axis", "treatment: fixed}   # assumption: each axis")
    for method in ("schmidt", "as_printed"):
        edits = (("method: recursive", f"method: {method}"), PRIOR_SIGMA)
        assert said in refusal(*edits, slow)
        assert mission(*edits, slow, held).estimators[3].method == method
    assert mission(("method: recursive", "method: two_stage"), PRIOR_SIGMA, slow).estimators[3].method == "two_stage"


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ("bias: {sigma: 0.05 arcsec, treatment", "bias: {sigma: 0.05 arcsec, correlation: per_arc, gap: 5 d, treatment",
         "bias NEB-1"),
        ("correlation: white", "correlation: orbit_error, velocity_sigma: 1 mm/s, renewal: 5 d", "orbit error NEB-1"),
    ],
)  # fmt: skip
def test_errors_that_stay_and_are_drawn_anew_are_for_methods_that_carry_them(old: str, new: str, name: str) -> None:
    """They were met in the middle of a run, by a sentence about covariances that named no place in the file."""
    said = refusal((old, new))
    assert f"estimators[1].method: batch_blocks inverts every covariance, and {name}" in said
    batch = ("method: batch_blocks", "method: batch_qr")
    for method in ("schmidt", "as_printed"):
        edits = (("method: recursive", f"method: {method}"), PRIOR_SIGMA, batch, (old, new))
        assert f"{method} cannot carry an error correlated in time ({name}, " in refusal(*edits)


def test_two_stages_need_something_beside_the_orbit() -> None:
    alone = "method: two_stage, treatment: {radius: fixed, mass: fixed, albedo: fixed, bias: considered}"
    assert "two_stage separates the orbit from what else is estimated, and nothing else is" in refusal(
        ("method: recursive", alone), PRIOR_SIGMA
    )
    drifting = (
        "bias: {sigma: 0.05 arcsec, treatment",
        "bias: {sigma: 0.05 arcsec, correlation: gauss_markov, time: 9 d, treatment",
    )
    drifts = ("method: recursive", "method: hsieh_chen, treatment: {radius: fixed, mass: fixed, albedo: fixed}")
    assert mission(drifts, PRIOR_SIGMA, drifting).estimators[3].method == "hsieh_chen"


def test_the_inside_of_an_estimate_is_refused_where_it_cannot_be_shown() -> None:
    asks = ("prior: none", "prior: none\nreport: {show: [full_gains]}")
    assert "report.show: full_gains grows with the square of the measurements" in refusal(("12 h", "1 h"), asks)
    prior = "prior: {sigma: {position: 100 km, velocity: 1 m/s}}\nreport: {show: [gains]}"
    only = BASE[BASE.index("  - {name: blocks, method") : BASE.index("predictions:")]
    message = refusal(("prior: none", prior), ("method: batch_qr", "method: schmidt"), (only, "\n"))
    assert "report.show: shows the inside of an estimate by least squares" in message
    assert "(got schmidt); add an estimator of method batch_qr" in message
