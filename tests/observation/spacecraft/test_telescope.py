"""What a telescope may be."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation import Geostationary, Telescope
from nebosvod.timescale import Epoch

HERE = Geostationary(longitude_rad=0.0)


def test_one_sigma_stands_for_both_axes_and_is_read_only():
    telescope = Telescope(name="A", spacecraft=HERE, sigma_rad=1e-6)
    np.testing.assert_array_equal(telescope.sigma_rad, [1e-6, 1e-6])
    with pytest.raises(ValueError, match="read-only"):
        telescope.sigma_rad[0] = 2.0  # type: ignore[index]


def test_noise_is_diagonal_for_a_still_target():
    telescope = Telescope(name="A", spacecraft=HERE, sigma_rad=[1e-6, 2e-6], timing_sigma_s=5.0)
    np.testing.assert_array_equal(telescope.noise(np.zeros((1, 2)))[0], np.diag([1e-6**2, 2e-6**2]))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("sigma_rad", 0.0),
        ("sigma_rad", [1e-6, np.nan]),
        ("timing_sigma_s", -1.0),
        ("exclusion_sun_rad", 4.0),
        ("exclusion_earth_rad", -0.1),
        ("exclusion_moon_rad", np.nan),
        ("limiting_magnitude", np.inf),
        ("largest_sun_rad", 3.2),
        ("exposure_s", -1.0),
        ("fwhm_rad", 0.0),
        ("duty", ((Epoch.from_jd(2462000.5), Epoch.from_jd(2461999.5)),)),
    ],
)
def test_numbers_out_of_range_are_refused_with_the_telescopes_name(field, value):
    arguments = {"name": "NEB-1", "spacecraft": HERE, "sigma_rad": 1e-6, field: value}
    with pytest.raises(InputError, match="NEB-1"):
        Telescope(**arguments)
