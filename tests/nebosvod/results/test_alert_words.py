"""Words of the first hour: lengths of time and angles in units that suit them."""

from typing import Any

import pytest

from nebosvod.results.alert_words import angle, arc, duration, hits_words, prior_decides, span


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.26, "0.26 s"), (59.0, "59 s"), (660.0, "11 min"), (3953.0, "1.1 h"), (86400.0, "1 d"), (1.2e7, "139 d")],
)
def test_a_length_of_time_has_its_unit(seconds: float, words: str) -> None:
    assert duration(seconds) == words


@pytest.mark.parametrize(
    ("arcsec", "words"),
    [(0.284, "0.28 arcsec"), (99.0, "99 arcsec"), (120.0, "2 arcmin"), (6493.0, "1.8 deg"), (412000.0, "114 deg")],
)
def test_an_angle_has_its_unit(arcsec: float, words: str) -> None:
    assert angle(arcsec) == words
    assert angle(arcsec, "°") == words.replace(" deg", "°")


def test_arcs_and_the_time_in_which_an_impact_counts() -> None:
    assert [arc(hours) for hours in (7e-5, 0.38, 6.0, 72.0)] == ["0.25 s", "23 min", "6.0 h", "3.0 d"]
    assert [span(days) for days in (100.0, 2.0, 1.0, 1.0 / 24.0)] == ["100 days", "2 days", "24 h", "1 h"]


def chances(*values: float, below: float | None = None) -> dict[str, dict[str, Any]]:
    """Rows of a summary by prior, and one that is a bound."""
    rows: list[dict[str, Any]] = [{"probability": p, "low": p, "high": p, "bound": False} for p in values]
    if below is not None:
        rows.append({"probability": None, "low": 0.0, "high": below, "bound": True})
    return {str(k): row for k, row in enumerate(rows)}


@pytest.mark.parametrize(
    ("by_prior", "decides"),
    [
        (chances(0.00732, 0.000847, 0.112), True),
        (chances(0.31, 0.30, 0.52), True),
        (chances(0.30, 0.35, 0.28), False),
        (chances(0.9999, 0.9998, 1.0), False),
        (chances(1e-4, 1e-6, 1e-8), False),
        (chances(0.52, 0.46, below=1.1e-4), True),
        (chances(0.003, below=0.004), False),
        (chances(below=0.004), False),
    ],
)
def test_a_prior_decides_by_difference_or_ratio(by_prior: dict[str, dict[str, Any]], decides: bool) -> None:
    assert prior_decides(by_prior) is decides


def test_one_drawn_orbit_hits_and_two_hit() -> None:
    assert hits_words(0) == "no drawn orbit hits"
    assert hits_words(1) == "1 drawn orbit hits, and weighs next to nothing"
    assert hits_words(2) == "2 drawn orbits hit, and weigh next to nothing"
