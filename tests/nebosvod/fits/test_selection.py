"""Rejection inside a fit, and growth of the arc from a rough orbit."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.estimation import Status
from nebosvod.estimation.solvers.rejection import Thresholds
from nebosvod.fits.correction import correct
from nebosvod.fits.growth import grow
from nebosvod.fits.selection import select

ARCSEC = np.pi / 648000.0


def spoilt(sky, rows, arcsec):
    observed = sky.observed.copy()
    observed[rows] += arcsec * ARCSEC
    return replace(sky, observed=observed)


def test_gross_errors_are_found_and_the_rest_gives_the_orbit(made_sky, ephemeris):
    made = made_sky()
    rows = [3, 40, 41, 99]
    sky = spoilt(made.sky, rows, 5.0)
    found = select(sky, made.state, made.forces, Thresholds())
    assert not found.selected[rows].any()
    assert found.selected.sum() >= 110  # of 116 good ones: 2 % lie beyond the thresholds by chance
    clean = correct(made.sky, made.state, made.forces, selected=found.selected)
    assert np.abs(np.linalg.solve(clean.S, found.correction.x - clean.x)).max() < 1e-2
    assert found.stands


def test_without_thresholds_everything_stays(made_sky, ephemeris):
    made = made_sky()
    sky = spoilt(made.sky, [3], 5.0)
    found = select(sky, made.state, made.forces, None)
    assert found.selected.all()
    assert found.chi2[3] > 100.0


def test_never_so_many_go_that_the_rest_determines_nothing(made_sky, ephemeris):
    made = made_sky(n=6)
    sky = spoilt(made.sky, [0, 2, 4], 600.0)
    found = select(sky, made.state, made.forces, Thresholds(fudge=0.0))
    assert found.selected.sum() >= 4


@pytest.mark.parametrize("days", [60.0, 1500.0])
def test_a_rough_orbit_grows_to_the_whole_arc(made_sky, days):
    """A start as Gauss's method leaves it, 40,000 km off now and degrees off at the ends of four years."""
    made = made_sky(n=150, days=days)
    rough = made.state * (1.0 + 2e-4 * np.array([1, -1, 1, -1, 1, 1]))
    found = grow(made.sky, rough, made.forces, Thresholds())
    assert found.correction.status is Status.CONVERGED
    assert np.sum(np.linalg.solve(found.correction.S, found.correction.x - made.state) ** 2) < 25.0
    assert found.selected.mean() > 0.95
