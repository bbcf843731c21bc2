"""Words of the first hour: lengths of time and angles in units that suit them."""

import pytest

from nebosvod.results.alert_words import angle, arc, duration, span


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
