"""Long lists of stations made short: the largest by themselves, the others together, nothing lost."""

import pytest

from nebosvod.results.condensed import condensed, foremost, without

STATIONS = ["T12", "F51", "703", "J95"]
SIGMAS = {
    "bias T12": 4.0,
    "measurement noise F51": 3.0,
    "prior orbit": 2.5,
    "bias F51": 2.0,
    "measurement noise T12": 1.5,
    "bias 703": 1.0,
    "A2": 0.6,
    "bias J95": 0.5,
    "timing J95": 0.4,
    "timing 703": 0.3,
    "position J95": 0.2,
}


def rows() -> list[dict[str, object]]:
    total = sum(sigma**2 for sigma in SIGMAS.values())
    return [
        {
            "source": source,
            "telescopes": [name for name in STATIONS if source.endswith(name)],
            "sigma_position_km": sigma,
            "share_position": sigma**2 / total,
        }
        for source, sigma in SIGMAS.items()
    ]


def test_the_largest_stand_alone_and_the_others_of_a_kind_together() -> None:
    parts = condensed(rows(), STATIONS, 3)
    assert [part.source for part in parts] == [
        "bias T12",
        "measurement noise F51",
        "prior orbit",
        "bias, 3 other stations together",
        "measurement noise T12",
        "A2",
        "timing, 2 stations together",
        "position J95",
    ]
    together = parts[3]
    assert together.sigma("sigma_position_km") == pytest.approx((2.0**2 + 1.0**2 + 0.5**2) ** 0.5, rel=1e-12)


def test_nothing_is_lost_in_the_sum() -> None:
    for most in (0, 1, 4, 20):
        parts = condensed(rows(), STATIONS, most)
        assert sum(part.share("share_position") for part in parts) == pytest.approx(1.0, rel=1e-12)
        assert len([row for part in parts for row in part.members]) == len(SIGMAS)


def test_numbers_that_are_no_stations_come_first_then_the_farthest_from_zero() -> None:
    def row(estimate: float, sigma: float) -> dict[str, float]:
        return {"estimate": estimate, "sigma": sigma, "prior_sigma": 1.0}

    parameters = {
        "bias T12 RA*_arcsec": row(0.2, 0.1),
        "bias T12 Dec_arcsec": row(-0.9, 0.1),
        "timing J95_s": row(0.3, 0.1),
        "bias 703 RA*_arcsec": row(0.0, 1.0),
        "a2_au_d2": row(1e-14, 1e-13),
        "common bias RA*_arcsec": row(0.01, 0.1),
    }
    shown, others = foremost(parameters, STATIONS, 4)
    assert list(shown) == ["a2_au_d2", "common bias RA*_arcsec", "bias T12 Dec_arcsec", "timing J95_s"]
    assert set(others) == {"bias T12 RA*_arcsec", "bias 703 RA*_arcsec"}
    # what was only considered stays at zero and is never shown by itself
    assert "bias 703 RA*_arcsec" in foremost(parameters, STATIONS, 20)[1]


def test_what_remains_without_a_part_is_the_sum_of_the_others() -> None:
    every = rows()
    part = condensed(every, STATIONS, 3)[3]
    others = sum(s**2 for name, s in SIGMAS.items() if name not in ("bias F51", "bias 703", "bias J95"))
    assert without(every, part, "sigma_position_km") == pytest.approx(others**0.5, rel=1e-12)
    halved = (others + 0.25 * part.variance("sigma_position_km")) ** 0.5
    assert without(every, part, "sigma_position_km", 0.5) == pytest.approx(halved, rel=1e-12)
