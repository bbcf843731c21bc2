"""The plate scale: partials against the projection of a camera, places that fill the field, draws."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation import Geostationary, PlateScale, Telescope, merge, observe
from nebosvod.observation.uncertainty.plate_scale import places

ARCMIN = np.radians(1.0 / 60.0)


@pytest.fixture(scope="module")
def observation(two_body, ephemeris):
    telescope = Telescope(name="A", spacecraft=Geostationary(longitude_rad=0.0), sigma_rad=1e-6)
    return observe(two_body, telescope, np.arange(40) * 86400.0, ephemeris)


def camera(direction, centre):
    """Standard coordinates (2,) of a direction on the tangent plane at `centre`, both RA and Dec, rad."""
    ra, d0, dec = direction[0] - centre[0], centre[1], direction[1]
    depth = np.sin(dec) * np.sin(d0) + np.cos(dec) * np.cos(d0) * np.cos(ra)
    across = np.cos(dec) * np.sin(ra) / depth
    return np.array([across, (np.sin(dec) * np.cos(d0) - np.cos(dec) * np.sin(d0) * np.cos(ra)) / depth])


def sky(place, centre):
    """The way back: RA and Dec of a place on the tangent plane."""
    a0, d0 = centre
    depth = np.cos(d0) - place[1] * np.sin(d0)
    ra = np.arctan2(place[0], depth)
    return np.array([a0 + ra, np.arctan2(np.sin(d0) + place[1] * np.cos(d0), np.hypot(depth, place[0]))])


def test_the_error_is_that_of_a_camera_whose_scale_is_wrong(observation, ephemeris):
    """1 % of the largest: a gnomonic projection about the centre that each place implies, its scale wrong by 1e-4."""
    kind = PlateScale(name="scale", telescopes=("A",), sigma=1e-4, field_rad=10.0 * ARCMIN)
    error = kind.term(observation, ephemeris).H[:, :, 0] * 1e-4
    assert np.abs(error).max() > 1e-4 * 4.0 * ARCMIN
    for true, place, found in zip(observation.psi, places(40, 10.0 * ARCMIN), error, strict=True):
        centre = true - place * np.array([1.0 / np.cos(true[1]), 1.0])
        for _ in range(20):  # the pointing that puts the object at its place
            centre += (camera(true, centre) - place) * np.array([1.0 / np.cos(true[1]), 1.0])
        seen = sky((1.0 + 1e-4) * camera(true, centre), centre)
        wanted = (seen - true) * np.array([np.cos(true[1]), 1.0])
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=0.01 * 1e-4 * 5.0 * ARCMIN)


@pytest.mark.parametrize("count", [60, 1000])
def test_exposures_fill_the_field_evenly(count):
    """Mean 0 and variance side^2/12 on each axis, axes uncorrelated, every quarter with its share; within 10 %."""
    place = places(count, 2.0)
    assert np.abs(place).max() <= 1.0
    assert np.abs(place.mean(axis=0)).max() < 0.1
    np.testing.assert_allclose(np.cov(place.T), np.eye(2) / 3.0, atol=0.04)
    for x, y in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        assert np.mean((x * place[:, 0] > 0) & (y * place[:, 1] > 0)) == pytest.approx(0.25, abs=0.025)


def test_two_telescopes_have_places_of_their_own_and_one_number(two_body, ephemeris):
    """Each counts its own exposures; a telescope that has no part in it has no error."""
    each = [
        observe(
            two_body, Telescope(name=name, spacecraft=Geostationary(longitude_rad=0.0), sigma_rad=1e-6), t_s, ephemeris
        )
        for name, t_s in (("A", np.arange(5) * 86400.0), ("B", np.arange(3) * 86400.0 + 9.0))
    ]
    both = merge(each)
    term = PlateScale(name="scale", telescopes=("B",), sigma=1e-4, field_rad=1e-3).term(both, ephemeris)
    assert term.names == ("scale",)
    np.testing.assert_array_equal(term.H[both.rows(("B",)), :, 0], places(3, 1e-3))
    assert not term.H[both.rows(("A",))].any()


def test_its_truth_is_drawn_with_its_sigma(observation, ephemeris, support):
    term = PlateScale(name="scale", telescopes=("A",), sigma=3e-4, field_rad=1e-3).term(observation, ephemeris)
    drawn = term.draw(np.random.default_rng(31), 20_000)
    assert min(support.likelihood_ratio(drawn, np.array([[9e-8]]))) > 5e-4


@pytest.mark.parametrize(
    ("size", "words"),
    [({"sigma": -1.0, "field_rad": 1e-3}, "numbers >= 0"), ({"sigma": 1e-5, "field_rad": 0.0}, r"field must be in \(0"),
     ({"sigma": 1e-5, "field_rad": 0.3}, r"0\.2\] rad"), ({"sigma": 1e-5, "field_rad": np.nan}, "field must be")],
)  # fmt: skip
def test_wrong_descriptions_are_refused(size, words):
    with pytest.raises(InputError, match=words):
        PlateScale(name="scale", telescopes=("A",), **size)
