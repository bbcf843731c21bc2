"""Synthetic measurements."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation import (
    ConstantBias,
    ConstantPosition,
    GaussMarkovPosition,
    Geostationary,
    Telescope,
    WhitePosition,
    draw_noise,
    draw_truth,
    measure,
    observe,
    residual,
    sight,
)

T_S = np.linspace(0.0, 60.0, 7) * 86400.0
SPACECRAFT = Geostationary(longitude_rad=0.0)


@pytest.fixture(scope="module")
def observation(two_body, ephemeris):
    telescope = Telescope(name="A", spacecraft=SPACECRAFT, sigma_rad=[1e-6, 2e-6], timing_sigma_s=20.0)
    return observe(two_body, telescope, T_S, ephemeris)


@pytest.fixture(scope="module")
def terms(observation, ephemeris):
    kinds: list[Any] = [
        ConstantBias(name="bias", telescopes=("A",), sigma_rad=1e-7),
        WhitePosition(name="white", telescope="A", sigma_km=3.0, frame="rtn"),
        ConstantPosition(name="constant", telescopes=("A",), sigma_km=3.0),
        GaussMarkovPosition(name="markov", telescopes=("A",), sigma_km=3.0, time_s=1e6),
    ]
    return [kind.term(observation, ephemeris) for kind in kinds]


def test_without_deviations_the_measurement_is_the_computed_one(observation):
    np.testing.assert_allclose(residual(measure(observation), observation.psi), 0.0, atol=2e-15)


def test_a_truth_off_the_reference_is_seen_as_if_it_had_been_propagated(observation, two_body, ephemeris):
    """The linear motion of the target is the only approximation: 1e3 km off, 1e-5 of second order."""
    deviation = np.array([800.0, -500.0, 300.0, 0.0, 0.0, 0.0])
    exact = sight(replace(two_body, start=two_body.start + deviation), SPACECRAFT, T_S, ephemeris).psi
    seen = measure(observation, state_deviation=deviation)
    size = np.abs(residual(exact, observation.psi)).max()
    assert np.abs(residual(seen, exact)).max() < 1e-4 * size


def test_a_displaced_telescope_is_seen_as_if_it_had_stood_there(observation, two_body, ephemeris, support):
    kind = ConstantPosition(name="z", telescopes=("A",), sigma_km=1.0).term(observation, ephemeris)
    there = np.array([3e5, -2e5, 1e5])
    exact = sight(two_body, support.Shifted(spacecraft=SPACECRAFT, by_km=there), T_S, ephemeris).psi
    seen = measure(observation, [kind], {"z": there})
    # what is left is the target's acceleration over a light time changed by 1 s: 3e-6 km of 1e8, 3e-14 rad
    np.testing.assert_allclose(residual(seen, exact), 0.0, atol=1e-13)


def test_a_parameter_off_its_reference_moves_the_target(observation, two_body, ephemeris):
    exact = sight(replace(two_body, kick=two_body.kick + 0.5), SPACECRAFT, T_S, ephemeris).psi
    seen = measure(observation, parameters_deviation=np.array([0.5]))
    # the parameter is linear in position; its velocity, 1e-2 km/s, acts on a light time changed by 0.1 s
    np.testing.assert_allclose(residual(seen, exact), 0.0, atol=5e-11)


def test_small_deviations_add_up_as_the_partials_say(observation, terms):
    rng = np.random.default_rng(8)
    truth = draw_truth(terms, rng)
    dx = rng.normal(size=6) * [1.0, 1.0, 1.0, 1e-6, 1e-6, 1e-6]
    linear = observation.H_x0 @ dx + observation.H_c @ np.array([1e-4])
    linear = linear + np.einsum("npk,k->np", terms[0].H, truth["bias"])
    linear = linear + np.einsum("npk,nk->np", terms[1].H, truth["white"])
    linear = linear + np.einsum("npk,k->np", terms[2].H, truth["constant"])
    linear = linear + np.einsum("npk,nk->np", terms[3].H, truth["markov"])
    seen = residual(measure(observation, terms, truth, dx, np.array([1e-4])), observation.psi)
    # 30 km of 1e8, squared
    np.testing.assert_allclose(seen, linear, rtol=0.0, atol=3e-13)
    assert np.abs(seen).max() > 1e-8


def test_noise_has_the_tilted_covariance_of_each_measurement(observation, support):
    rng = np.random.default_rng(6)
    drawn = np.stack([draw_noise(observation.noise, rng) for _ in range(20_000)])
    for k in range(T_S.size):
        assert min(support.likelihood_ratio(drawn[:, k], observation.noise[k])) > 5e-4
    assert abs(observation.noise[3, 0, 1]) > 0.05 * observation.noise[3, 0, 0]


def test_the_same_seed_draws_the_same_truth(terms):
    first, second = (draw_truth(terms, np.random.default_rng(5)) for _ in range(2))
    assert all(np.array_equal(first[name], second[name]) for name in first)


def test_what_is_fixed_has_no_error(observation, ephemeris):
    kinds: list[Any] = [
        ConstantBias(name="bias", telescopes=("A",), sigma_rad=1e-7, mean_rad=[1e-7, 2e-7], treatment="fixed"),
        WhitePosition(name="white", telescope="A", sigma_km=3.0, treatment="fixed"),
    ]
    truth = draw_truth([kind.term(observation, ephemeris) for kind in kinds], np.random.default_rng(0))
    np.testing.assert_array_equal(truth["bias"], [1e-7, 2e-7])
    np.testing.assert_array_equal(truth["white"], 0.0)


def test_two_sources_of_one_name_are_refused(terms):
    with pytest.raises(InputError, match='named "bias"'):
        draw_truth([terms[0], terms[0]], np.random.default_rng(0))
