"""Every kind of uncertainty: its partials, its covariance, and draws that have that covariance."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation import (
    ConstantBias,
    ConstantPosition,
    GaussMarkovPosition,
    Geostationary,
    HeliocentricCompanion,
    Markov,
    Telescope,
    WhitePosition,
    merge,
    observe,
)

DAY = 86400.0
DRAWS = 20_000
# both p-values of every kind must exceed this; with fixed seeds and about 20 of them, 1 % at the family level
P_VALUE = 5e-4


@pytest.fixture(scope="module")
def observation(two_body, ephemeris):
    """A: days 0, 1, 2, 5; B: days 1, 3, 5."""
    A = Telescope(name="A", spacecraft=Geostationary(longitude_rad=0.0), sigma_rad=1e-6)
    B = Telescope(name="B", spacecraft=HeliocentricCompanion(lead_rad=0.3), sigma_rad=2e-6)
    return merge(
        [
            observe(two_body, A, np.array([0.0, 1.0, 2.0, 5.0]) * DAY, ephemeris),
            observe(two_body, B, np.array([1.0, 3.0, 5.0]) * DAY, ephemeris),
        ]
    )


def draws_of(term, seed):
    return term.draw(np.random.default_rng(seed), DRAWS).reshape(DRAWS, -1)


def chain_covariance(term: Markov):
    """Covariance (r q, r q) of a chain, built from its matrices by the textbook recursion."""
    r, q = term.Q.shape[:2]
    blocks = np.zeros((r, r, q, q))
    blocks[0, 0] = term.P0
    for i in range(1, r):
        for j in range(i):
            blocks[i, j] = term.F[i] @ blocks[i - 1, j]
            blocks[j, i] = blocks[i, j].T
        blocks[i, i] = term.F[i] @ blocks[i - 1, i - 1] @ term.F[i].T + term.Q[i]
    return blocks.transpose(0, 2, 1, 3).reshape(r * q, r * q)


def test_constant_bias_adds_itself_to_its_telescopes_rows_only(observation, ephemeris):
    bias = ConstantBias(name="bias B", telescopes=("B",), sigma_rad=[1e-7, 2e-7]).term(observation, ephemeris)
    touched = observation.telescope_index == 1
    np.testing.assert_array_equal(bias.H[touched], np.broadcast_to(np.eye(2), (3, 2, 2)))
    np.testing.assert_array_equal(bias.H[~touched], 0.0)
    assert bias.names == ("bias B RA*", "bias B Dec")
    np.testing.assert_allclose(bias.covariance, np.diag([1e-14, 4e-14]), rtol=1e-15)


def test_constant_bias_is_drawn_with_its_mean_and_covariance(observation, ephemeris, support):
    mean = np.array([3e-7, -1e-7])
    bias = ConstantBias(name="b", telescopes=("A",), sigma_rad=[1e-7, 2e-7], mean_rad=mean)
    drawn = draws_of(bias.term(observation, ephemeris), 1) - mean
    assert min(support.likelihood_ratio(drawn, np.diag([1e-14, 4e-14]))) > P_VALUE


def test_one_bias_may_be_shared_by_two_telescopes(observation, ephemeris):
    shared = ConstantBias(name="catalogue", telescopes=("A", "B"), sigma_rad=1e-7).term(observation, ephemeris)
    np.testing.assert_array_equal(shared.H, np.broadcast_to(np.eye(2), (7, 2, 2)))
    assert shared.covariance.shape == (2, 2)


def test_white_position_acts_through_H_z_in_icrf(observation, ephemeris):
    white = WhitePosition(name="z", telescope="B", sigma_km=[1.0, 2.0, 3.0]).term(observation, ephemeris)
    np.testing.assert_array_equal(white.rows, [2, 4, 6])
    np.testing.assert_array_equal(white.H, observation.H_z[white.rows])
    np.testing.assert_array_equal(white.Q[1], np.diag([1.0, 4.0, 9.0]))


def test_white_position_in_rtn_is_turned_in_the_partials_not_in_the_covariance(observation, ephemeris):
    white = WhitePosition(name="z", telescope="A", sigma_km=[1.0, 2.0, 3.0], frame="rtn").term(observation, ephemeris)
    np.testing.assert_array_equal(white.Q[0], np.diag([1.0, 4.0, 9.0]))
    np.testing.assert_allclose(white.H, observation.H_z[white.rows] @ white.displacement, rtol=1e-15)
    earth = ephemeris.state_km_km_s("earth", observation.epoch, observation.t_s[white.rows])
    relative = observation.telescope_state[white.rows] - earth
    radial = np.einsum("ni,ni->n", white.displacement[:, :, 0], relative[:, :3])
    np.testing.assert_allclose(radial, 42164.17, atol=0.01)
    assert white.names == ("z radial", "z transverse", "z normal")


def test_rtn_of_a_companion_is_about_the_sun(observation, ephemeris):
    white = WhitePosition(name="z", telescope="B", sigma_km=1.0, frame="rtn").term(observation, ephemeris)
    sun = ephemeris.position_km("sun", observation.epoch, observation.t_s[white.rows])
    relative = observation.telescope_state[white.rows, :3] - sun
    radial = np.einsum("ni,ni->n", white.displacement[:, :, 0], relative)
    np.testing.assert_allclose(radial, np.linalg.norm(relative, axis=1), rtol=1e-14)


def test_white_position_is_drawn_independently_at_each_exposure(observation, ephemeris, support):
    white = WhitePosition(name="z", telescope="B", sigma_km=[1.0, 2.0, 3.0]).term(observation, ephemeris)
    expected = np.kron(np.eye(3), np.diag([1.0, 4.0, 9.0]))
    assert min(support.likelihood_ratio(draws_of(white, 2), expected)) > P_VALUE


def test_constant_position_is_one_draw_for_all_exposures(observation, ephemeris, support):
    kind = ConstantPosition(name="z", telescopes=("A", "B"), sigma_km=[1.0, 2.0, 3.0], mean_km=5.0)
    constant = kind.term(observation, ephemeris)
    np.testing.assert_array_equal(constant.H, observation.H_z)
    assert min(support.likelihood_ratio(draws_of(constant, 3) - 5.0, np.diag([1.0, 4.0, 9.0]))) > P_VALUE


def test_constant_position_in_rtn_rides_along_with_the_orbit(observation, ephemeris):
    kind = ConstantPosition(name="z", telescopes=("A",), sigma_km=1.0, frame="rtn")
    axes = kind.term(observation, ephemeris).displacement
    mine = observation.telescope_index == 0
    np.testing.assert_array_equal(axes[~mine], 0.0)
    radial = axes[mine][:, :, 0]
    np.testing.assert_allclose(np.linalg.norm(radial, axis=1), 1.0, rtol=1e-14)
    # 5 sidereal days are 20 min short of 5 days: the radial axis has turned by 4.93 deg
    assert np.degrees(np.arccos(radial[0] @ radial[3])) == pytest.approx(4.93, abs=0.01)


def test_gauss_markov_covariance_falls_exponentially_with_time(observation, ephemeris):
    sigma, time = np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 4.0]) * DAY
    kind = GaussMarkovPosition(name="z", telescopes=("A",), sigma_km=sigma, time_s=time)
    chain = kind.term(observation, ephemeris)
    apart = np.abs(np.subtract.outer(*[observation.t_s[chain.rows]] * 2))
    expected = np.zeros((4, 3, 4, 3))
    for axis in range(3):
        expected[:, axis, :, axis] = sigma[axis] ** 2 * np.exp(-apart / time[axis])
    np.testing.assert_allclose(chain_covariance(chain), expected.reshape(12, 12), rtol=1e-13, atol=1e-15)


def test_gauss_markov_is_drawn_with_that_covariance(observation, ephemeris, support):
    kind = GaussMarkovPosition(name="z", telescopes=("B",), sigma_km=[1.0, 2.0, 3.0], time_s=2.0 * DAY, frame="rtn")
    chain = kind.term(observation, ephemeris)
    assert min(support.likelihood_ratio(draws_of(chain, 4), chain_covariance(chain))) > P_VALUE


def test_a_shared_gauss_markov_error_is_the_same_at_simultaneous_exposures(observation, ephemeris):
    kind = GaussMarkovPosition(name="z", telescopes=("A", "B"), sigma_km=1.0, time_s=2.0 * DAY)
    chain = kind.term(observation, ephemeris)
    np.testing.assert_array_equal(chain.rows, np.arange(7))
    drawn = chain.draw(np.random.default_rng(0), 3)
    np.testing.assert_array_equal(observation.t_s[[1, 5]], observation.t_s[[2, 6]])
    np.testing.assert_allclose(drawn[:, [1, 5]], drawn[:, [2, 6]], rtol=0.0, atol=1e-15)
    assert np.all(np.abs(drawn[:, 0] - drawn[:, 1]) > 0.0)


def test_gauss_markov_step_noise_survives_dense_exposures(two_body, ephemeris):
    telescope = Telescope(name="A", spacecraft=Geostationary(longitude_rad=0.0), sigma_rad=1e-6)
    dense = observe(two_body, telescope, np.array([0.0, 1e-5]), ephemeris)
    chain = GaussMarkovPosition(name="z", telescopes=("A",), sigma_km=1.0, time_s=1e7).term(dense, ephemeris)
    np.testing.assert_allclose(np.diag(chain.Q[1]), 2e-12, rtol=1e-9)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ConstantBias(name="b", telescopes=("A",), sigma_rad=-1.0), "numbers >= 0"),
        (lambda: ConstantBias(name="b", telescopes=("A",), sigma_rad=[1.0, 2.0, 3.0]), "one or 2"),
        (lambda: ConstantBias(name="b", telescopes=("A",), sigma_rad=1.0, treatment="guessed"), "treatment"),
        (lambda: WhitePosition(name="z", telescope="A", sigma_km=1.0, frame="lvlh"), "frame must be one of icrf, rtn"),
        (lambda: GaussMarkovPosition(name="z", telescopes=("A",), sigma_km=1.0, time_s=0.0), "must be positive"),
        (lambda: ConstantPosition(name="z", telescopes=("A",), sigma_km=np.nan), "finite"),
    ],
)
def test_wrong_descriptions_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_a_telescope_that_made_no_measurement_is_named(observation, ephemeris):
    with pytest.raises(InputError, match='"C" made no measurement'):
        ConstantBias(name="b", telescopes=("C",), sigma_rad=1.0).term(observation, ephemeris)
