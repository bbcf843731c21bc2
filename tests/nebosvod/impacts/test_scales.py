"""Palermo and Torino scales against published ratings."""

import pytest

from nebosvod.impacts.scales import palermo, torino

PUBLISHED = {
    # NASA's list on that day, P and Mt, as press, Wikipedia and planetarydefense.blogspot.com tell them
    "2004 MN4 on 2004-12-27": (0.027, 1430.0, 4),
    "Apophis in May 2005, 1 in 5560": (1.8e-4, 880.0, 1),
    "Apophis since August 2006, 1 in 45000": (2.2e-5, 510.0, 0),
    "Apophis in 2009": (4e-6, 510.0, 0),
    "2004 VD17 until February 2006, 1 in 3000": (3.3e-4, 1.47e4, 1),
    "2004 VD17 on 2006-02-27, 2.7e11 kg, 1 in 1850": (5.4e-4, 1.47e4, 2),
    "2007 VK184, 1 in 2940": (3.4e-4, 150.0, 1),
    "2011 AG5, 1 in 625": (1.6e-3, 105.0, 1),
    "2013 TV135, 1 in 63000": (1.6e-5, 3200.0, 1),
    "2010 RF12": (0.1, 0.01, 0),
    "2023 DW": (1.8e-3, 4.5, 1),
    "2024 YR4 in December 2024": (3e-3, 7.8, 1),
    "2024 YR4 on 2025-02-18": (0.031, 7.8, 3),
    "2024 YR4 on 2025-02-24": (4e-5, 7.8, 0),
    # the corners of the diagram: the parallel lines at 1 %, at 1e-8 and at 1
    "0|1 at 1e-8, below": (0.99e-8, 1e8, 0),
    "0|1 at 1e-8, above": (1.01e-8, 1e8, 1),
    "1|2 at 1e-6, below": (0.99e-6, 1e8, 1),
    "1|2 at 1e-6, above": (1.01e-6, 1e8, 2),
    "2|6 at 1e-4, below": (0.99e-4, 1e8, 2),
    "2|6 at 1e-4, above": (1.01e-4, 1e8, 6),
    "2|3": (0.0101, 99.0, 3),
    "2|4": (0.0101, 101.0, 4),
    "4|5 at 10 %, below": (0.1, 0.99 * 10.0**3.5, 4),
    "4|5 at 10 %, above": (0.1, 1.01 * 10.0**3.5, 5),
    "6|7": (0.0101, 1.01e5, 7),
    "certain and local": (1.0, 50.0, 8),
    "certain and regional": (0.995, 5000.0, 9),
    "certain and global": (0.995, 2e5, 10),
    "too small to come down": (1.0, 0.9, 0),
}


@pytest.mark.parametrize(("probability", "energy", "wanted"), PUBLISHED.values(), ids=list(PUBLISHED))
def test_the_torino_scale_is_that_of_published_cases(probability: float, energy: float, wanted: int) -> None:
    assert torino(probability, energy, 20.0) == wanted
    assert torino(probability, energy, 101.0) is None


@pytest.mark.parametrize(
    ("probability", "energy", "years", "wanted"),
    [
        (1.0 / 2700.0, 1421.0, 161.0, -1.59),  # Bennu 2182-09-24, CNEOS in 2021
        (5.4e-4, 1.47e4, 96.2, -0.40),  # 2004 VD17 in 2102, CNEOS on 2006-02-27 (planetarydefense.blogspot.com)
        (0.027, 1430.0, 24.3, 1.10),  # 2004 MN4 in 2029, CNEOS on 2004-12-27
        (0.031, 7.8, 7.8, -0.18),  # 2024 YR4 in 2032, CNEOS on 2025-02-18
    ],
    ids=["Bennu", "2004 VD17", "2004 MN4", "2024 YR4"],
)
def test_the_palermo_scale_is_that_of_published_cases(
    probability: float, energy: float, years: float, wanted: float
) -> None:
    assert palermo(probability, energy, years) == pytest.approx(wanted, abs=0.03)
