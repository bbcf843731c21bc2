"""Biases, the clock and the photocentre: partials, covariances and draws."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation import (
    ArcBias,
    BiasDrift,
    GaussMarkovBias,
    Geostationary,
    Photocentre,
    Telescope,
    TimingOffset,
    ZoneBias,
    measure,
    observe,
    residual,
    sight,
)
from nebosvod.observation.measurement.direction import ra_dec
from nebosvod.observation.uncertainty.photocentre import lambert_offset

DAY = 86400.0
DRAWS = 20_000
P_VALUE = 5e-4
HERE = Geostationary(longitude_rad=0.0)


@pytest.fixture(scope="module")
def observation(two_body, ephemeris):
    telescope = Telescope(name="A", spacecraft=HERE, sigma_rad=1e-6)
    return observe(two_body, telescope, np.array([0.0, 0.1, 0.2, 3.0, 3.1, 40.0]) * DAY, ephemeris)


def draws_of(term, seed):
    return term.draw(np.random.default_rng(seed), DRAWS)


def test_a_drifting_bias_grows_linearly_from_its_epoch(observation, ephemeris, support):
    kind = BiasDrift(name="b", telescopes=("A",), sigma_rad=[1e-7, 2e-7], drift_sigma_rad_s=[1e-13, 2e-13], at_s=DAY)
    term = kind.term(observation, ephemeris)
    value = np.array([1.0, 2.0, 3.0, 4.0])
    expected = np.stack([1.0 + 3.0 * (observation.t_s - DAY), 2.0 + 4.0 * (observation.t_s - DAY)], axis=1)
    np.testing.assert_allclose(term.H @ value, expected, rtol=1e-12)
    drawn = draws_of(term, 21)
    assert min(support.likelihood_ratio(drawn, np.diag([1e-14, 4e-14, 1e-26, 4e-26]))) > P_VALUE
    assert term.names == ("b RA*", "b Dec", "b RA* drift", "b Dec drift")


def test_a_gauss_markov_bias_falls_off_exponentially(observation, ephemeris, support):
    kind = GaussMarkovBias(name="b", telescopes=("A",), sigma_rad=[1.0, 2.0], time_s=[2.0 * DAY, 5.0 * DAY])
    term = kind.term(observation, ephemeris)
    apart = np.abs(np.subtract.outer(observation.t_s, observation.t_s)) / DAY
    expected = np.zeros((6, 2, 6, 2))
    expected[:, 0, :, 0], expected[:, 1, :, 1] = np.exp(-apart / 2.0), 4.0 * np.exp(-apart / 5.0)
    drawn = draws_of(term, 22).reshape(DRAWS, 12)
    assert min(support.likelihood_ratio(drawn, expected.reshape(12, 12))) > P_VALUE


def test_a_bias_per_arc_is_constant_inside_an_arc_and_independent_between_arcs(observation, ephemeris, support):
    term = ArcBias(name="b", telescopes=("A",), sigma_rad=[1.0, 2.0], gap_s=DAY).term(observation, ephemeris)
    drawn = draws_of(term, 23)
    for first, second in ((0, 1), (1, 2), (3, 4)):
        np.testing.assert_array_equal(drawn[:, first], drawn[:, second])
    arcs = drawn[:, [0, 3, 5]].reshape(DRAWS, 6)
    assert min(support.likelihood_ratio(arcs, np.kron(np.eye(3), np.diag([1.0, 4.0])))) > P_VALUE


def test_a_zone_bias_is_one_draw_in_each_zone_of_the_sky(observation, ephemeris, support):
    kind = ZoneBias(name="b", telescopes=("A",), sigma_rad=[1.0, 2.0], zone_rad=np.radians(6.0))
    term = kind.term(observation, ephemeris)
    zones = len(term.names) // 2
    assert 1 < zones < 6
    np.testing.assert_array_equal(term.H.sum(axis=2), 1.0)
    np.testing.assert_array_equal(term.H[0], term.H[1])  # 2 h apart: the same zone
    assert not np.array_equal(term.H[0], term.H[5])  # 40 days apart: another
    drawn = draws_of(term, 24)
    assert min(support.likelihood_ratio(drawn, np.kron(np.eye(zones), np.diag([1.0, 4.0])))) > P_VALUE


def test_a_target_that_comes_back_to_a_zone_finds_the_same_bias(observation, ephemeris):
    loop = replace(observation, psi=observation.psi[[0, 5, 0, 5, 0, 5]])
    term = ZoneBias(name="b", telescopes=("A",), sigma_rad=1.0, zone_rad=np.radians(6.0)).term(loop, ephemeris)
    assert len(term.names) == 4
    np.testing.assert_array_equal(term.H[0], term.H[2])


@pytest.mark.parametrize("dec_deg", [-90.0, 90.0, 89.9])
def test_zones_hold_at_the_poles(observation, ephemeris, dec_deg):
    polar = replace(observation, psi=np.stack([np.linspace(0.0, 6.28, 6), np.full(6, np.radians(dec_deg))], axis=1))
    term = ZoneBias(name="b", telescopes=("A",), sigma_rad=1.0, zone_rad=np.radians(6.0)).term(polar, ephemeris)
    np.testing.assert_array_equal(term.H.sum(axis=2), 1.0)


def test_a_wrong_clock_shifts_the_measurement_as_exposing_later_does(observation, two_body, ephemeris, support):
    term = TimingOffset(name="clock A", telescopes=("A",), sigma_s=2.0).term(observation, ephemeris)
    later = sight(two_body, HERE, observation.t_s + 2.0, ephemeris).psi
    seen = measure(observation, [term], {"clock A": np.array([2.0])})
    # the apparent acceleration over 2 s: 1e-6 rad/s x 7e-5 /s x 2 s
    np.testing.assert_allclose(residual(seen, later), 0.0, atol=1e-11)
    assert np.abs(residual(later, observation.psi)).max() > 1e-8
    assert min(support.likelihood_ratio(draws_of(term, 25), np.array([[4.0]]))) > P_VALUE


class TestPhotocentre:
    """The light of a partly lit sphere."""

    @pytest.mark.parametrize("phase_deg", [0.0, 20.0, 90.0, 150.0])
    def test_the_law_is_the_first_moment_of_a_lambert_sphere(self, phase_deg):
        """Summed over a fine grid of the sphere, observer along z, Sun in the x, z plane."""
        phase = np.radians(phase_deg)
        theta, phi = np.meshgrid((np.arange(1500) + 0.5) * np.pi / 1500, (np.arange(1500) + 0.5) * np.pi / 750)
        x, z = np.sin(theta) * np.cos(phi), np.cos(theta)
        light = np.maximum(z, 0.0) * np.maximum(x * np.sin(phase) + z * np.cos(phase), 0.0) * np.sin(theta)
        expected = np.sum(light * x) / np.sum(light)
        assert lambert_offset(np.array([phase]))[0] == pytest.approx(expected, abs=2e-5)

    def test_the_law_is_smooth_to_the_thinnest_crescent(self):
        value = lambert_offset(np.array([np.pi - 2e-3, np.pi - 1.001e-3, np.pi - 1e-4, np.pi]))
        np.testing.assert_allclose(value, 9.0 * np.pi / 32.0, rtol=1e-5)

    def test_the_partial_is_the_displacement_towards_the_sun(self, observation, two_body, ephemeris):
        kind = Photocentre(name="light", telescopes=("A",), radius_km=1e4, sigma_amplitude=0.3)
        term = kind.term(observation, ephemeris)
        target = observation.target_state[:, :3]
        sun = ephemeris.position_km("sun", observation.epoch, observation.t_s - observation.light_time_s)
        to_sun = (sun - target) / np.linalg.norm(sun - target, axis=1, keepdims=True)
        sky = to_sun - observation.u * np.sum(to_sun * observation.u, axis=1, keepdims=True)
        phase = np.arccos(np.sum(-observation.u * to_sun, axis=1))
        shift = 1e4 * lambert_offset(phase)[:, None] * sky / np.linalg.norm(sky, axis=1, keepdims=True)
        moved = ra_dec(target + shift - observation.telescope_state[:, :3])
        # the light-time factor treats the shift like a displacement of the target: V/c = 1e-4 of it
        np.testing.assert_allclose(term.H[:, :, 0], residual(moved, observation.psi), rtol=0.0, atol=3e-8)
        assert np.abs(term.H).max() > 1e-5

    def test_it_has_one_amplitude(self, observation, ephemeris, support):
        kind = Photocentre(name="light", telescopes=("A",), radius_km=0.2, sigma_amplitude=0.3, mean_amplitude=1.0)
        term = kind.term(observation, ephemeris)
        assert term.names == ("light amplitude",)
        assert min(support.likelihood_ratio(draws_of(term, 26) - 1.0, np.array([[0.09]]))) > P_VALUE


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: BiasDrift(name="b", telescopes=("A",), sigma_rad=1.0, drift_sigma_rad_s=-1.0), "drift: needs"),
        (lambda: GaussMarkovBias(name="b", telescopes=("A",), sigma_rad=1.0, time_s=0.0), "must be positive"),
        (lambda: ArcBias(name="b", telescopes=("A",), sigma_rad=1.0, gap_s=np.nan), "must be positive"),
        (lambda: ZoneBias(name="b", telescopes=("A",), sigma_rad=1.0, zone_rad=0.0), "side of a zone"),
        (lambda: TimingOffset(name="b", telescopes=("A",), sigma_s=-1.0), "numbers >= 0"),
        (lambda: Photocentre(name="b", telescopes=("A",), radius_km=0.0, sigma_amplitude=1.0), "radius"),
    ],
)
def test_wrong_descriptions_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
