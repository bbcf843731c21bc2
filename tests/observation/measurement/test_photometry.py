"""Apparent magnitude in the H, G system."""

import numpy as np
import pytest

from nebosvod.dynamics.constants import AU_KM
from nebosvod.errors import InputError
from nebosvod.observation import apparent_magnitude
from nebosvod.observation.measurement.photometry import trailing_loss


def magnitude(H, G, r_au, d_au, phase_deg):
    one = np.atleast_1d
    return apparent_magnitude(H, G, one(r_au) * AU_KM, one(d_au) * AU_KM, np.radians(one(phase_deg)))


def test_absolute_magnitude_is_that_at_one_au_and_no_phase():
    assert magnitude(15.3, 0.15, 1.0, 1.0, 0.0)[0] == 15.3


def test_brightness_falls_with_the_square_of_both_distances():
    assert magnitude(15.0, 0.15, 2.0, 5.0, 0.0)[0] == pytest.approx(15.0 + 5.0)


def test_apparent_magnitudes_agree_with_horizons():
    # Horizons, observer X05: r, delta in au, phase in deg, V (rounded to 1 mmag), with its H and G
    table = [(16.2, 0.15, 0.459371473566, 1.19157635254166, 56.7174, 16.944)]
    for H, G, r, d, phase, V in table:
        assert magnitude(H, G, r, d, phase)[0] == pytest.approx(V, abs=1e-3)


def test_magnitude_grows_with_phase_and_stays_defined_to_180_degrees():
    V = magnitude(20.0, 0.24, 1.0, 1.0, np.linspace(0.0, 180.0, 181))
    assert np.all(np.diff(V) > 0.0)
    assert np.all(np.isfinite(V[:-1]))


def test_a_negative_slope_parameter_ends_in_darkness_not_in_an_error():
    V = magnitude(20.0, -0.5, 1.0, 1.0, np.array([0.0, 20.0, 90.0]))
    assert V[0] == 20.0
    assert np.isfinite(V[1])
    assert V[2] == np.inf


@pytest.mark.parametrize(("H", "G"), [(np.nan, 0.15), (15.0, 1.1), (15.0, -0.6), (15.0, np.nan)])
def test_H_and_G_out_of_range_are_refused(H, G):
    with pytest.raises(InputError, match="magnitude"):
        magnitude(H, G, 1.0, 1.0, 0.0)


def test_trailing_costs_what_the_survey_formula_says():
    # Jones et al. 2018: a trail as long as the image is wide, x = 1: 1.25 lg(1 + 0.67 / 2.16); none without motion
    loss = trailing_loss(np.array([0.0, 1e-7, 1e-5]), 10.0, 1e-6)
    np.testing.assert_allclose(loss[:2], [0.0, 1.25 * np.log10(1.0 + 0.67 / 2.16)], rtol=1e-12)
    # long trails lose as the square root of their length, in signal to noise
    assert loss[2] == pytest.approx(1.25 * np.log10(100.0 * 0.67 / 1.16), abs=0.02)
