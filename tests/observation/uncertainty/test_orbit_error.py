"""The error of a spacecraft's orbit: how it flies on, and that all exposures share it."""

from types import SimpleNamespace

import numpy as np
import pytest

from nebosvod.dynamics import ForceModel, propagate
from nebosvod.dynamics.kepler import kepler_state
from nebosvod.errors import InputError
from nebosvod.observation import (
    Common,
    Geostationary,
    HeliocentricCompanion,
    LibrationOrbit,
    Markov,
    OrbitError,
    Telescope,
    merge,
    observe,
)
from nebosvod.observation.uncertainty.orbit_transition import transitions

DAY = 86400.0
SIGMA = np.array([1.0, 2.0, 0.5, 1e-4, 5e-5, 1e-4])
COVARIANCE = np.diag(SIGMA**2)
COVARIANCE[0, 4] = COVARIANCE[4, 0] = -0.9 * SIGMA[0] * SIGMA[4]


def relative_error(found, expected):
    """Largest deviation of a transition in units of the largest entry of its 3 x 3 block."""
    worst = 0.0
    for rows in (slice(0, 3), slice(3, 6)):
        for columns in (slice(0, 3), slice(3, 6)):
            scale = np.abs(expected[:, rows, columns]).max(axis=(1, 2), keepdims=True)
            worst = max(worst, float(np.max(np.abs(found - expected)[:, rows, columns] / scale)))
    return worst


class TestTransition:
    """Phi along the track, against orbits that are really displaced."""

    @pytest.mark.parametrize("e", [0.0, 0.3])
    def test_a_geocentric_error_grows_as_between_two_kepler_orbits(self, ephemeris, epoch, support, e):
        """Sun and Moon, which Kepler lacks, are switched off by an ephemeris where they weigh nothing."""
        t_s = np.array([0.0, 0.3, 1.0, 5.0]) * DAY
        gm = ephemeris.gm_km3_s2["earth"]
        elements = np.array([42164.0, e, 0.2, 1.0, 2.0, 3.0])
        earth_alone = SimpleNamespace(
            gm_km3_s2={**ephemeris.gm_km3_s2, "sun": 0.0, "moon": 0.0}, position_km=ephemeris.position_km
        )

        def orbit(a, e, i, node, peri, M):
            def state(ephemeris, epoch, t):
                one, earth = np.ones(t.size), ephemeris.position_km("earth", epoch, t)
                relative = kepler_state(gm, a, e, i, node * one, peri * one, M + np.sqrt(gm / a**3) * t)
                return relative + np.concatenate([earth, np.zeros_like(earth)], axis=1)

            return SimpleNamespace(state_km_km_s=state)

        steps = np.diag([20.0, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3])[[0, 2, 3, 4, 5] if e == 0.0 else range(6)]
        still = SimpleNamespace(position_km=lambda body, epoch, t: np.zeros((t.size, 3)))
        columns = [
            support.derivative(lambda h, s=s: orbit(*(elements + h * s)).state_km_km_s(still, epoch, t_s), 1.0)
            for s in steps
        ]
        moved = np.stack(columns, axis=2)
        carried = transitions(orbit(*elements), earth_alone, epoch, np.zeros(4), t_s) @ moved[0]
        for part in (slice(0, 3), slice(3, 6)):
            # Magnus of fourth order at 444 steps a revolution
            error = np.abs(carried - moved)[:, part] / np.abs(moved[:, part]).max(axis=(0, 1))
            assert np.max(error) < 1e-5

    def test_a_companions_error_grows_as_the_integrator_says(self, ephemeris, epoch):
        """The integrator's Phi along the companion's own orbit, 20 deg from the Earth, for a year."""
        companion = HeliocentricCompanion(lead_rad=0.35)
        t_s = np.array([0.0, 30.0, 180.0, 365.0]) * DAY
        start = (
            companion.state_km_km_s(ephemeris, epoch, t_s[:1])[0] - ephemeris.state_km_km_s("sun", epoch, t_s[:1])[0]
        )
        expected = propagate(start, epoch, t_s, ForceModel(ephemeris=ephemeris)).Phi
        found = transitions(companion, ephemeris, epoch, np.zeros(4), t_s)
        # the Earth's own orbit is not exactly a spacecraft's: the tracks part by 1 % of the distance in a year
        assert relative_error(found[1:], expected[1:]) < 2e-2

    def test_an_error_at_L1_grows_e_fold_in_23_days(self, ephemeris, epoch):
        """The unstable exponent of Sun-Earth L1 is 2.53 mean motions: 23 days (Gomez et al. 2001)."""
        orbit = LibrationOrbit(point="L1", elements_epoch=epoch)
        t_s = np.array([60.0, 120.0]) * DAY
        Phi = transitions(orbit, ephemeris, epoch, np.zeros(2), t_s)
        growth = np.linalg.norm(Phi[1, :3, :3]) / np.linalg.norm(Phi[0, :3, :3])
        assert 60.0 / np.log(growth) == pytest.approx(23.0, abs=1.5)

    def test_back_and_forth_is_the_identity(self, ephemeris, epoch):
        orbit = Geostationary(longitude_rad=0.0)
        there = transitions(orbit, ephemeris, epoch, np.array([0.0]), np.array([3.0 * DAY]))[0]
        back = transitions(orbit, ephemeris, epoch, np.array([3.0 * DAY]), np.array([0.0]))[0]
        scale = np.array([1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4])
        product = (back @ there) * scale / scale[:, None]
        np.testing.assert_allclose(product, np.eye(6), atol=1e-7)

    def test_any_order_of_times_gives_the_same(self, ephemeris, epoch):
        orbit = Geostationary(longitude_rad=0.0)
        t_s = np.array([2.0, -1.0, 0.5, 0.5, -3.0, 0.0]) * DAY
        together = transitions(orbit, ephemeris, epoch, np.zeros(6), t_s)
        for k, t in enumerate(t_s):
            alone = transitions(orbit, ephemeris, epoch, np.zeros(1), np.array([t]))[0]
            np.testing.assert_allclose(together[k, :3, :3], alone[:3, :3], rtol=1e-4, atol=1e-5)
        np.testing.assert_array_equal(together[5], np.eye(6))

    def test_it_keeps_phase_volume(self, ephemeris, epoch):
        Phi = transitions(Geostationary(longitude_rad=0.0), ephemeris, epoch, np.zeros(1), np.array([20.0 * DAY]))[0]
        J = np.kron(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.eye(3))
        unit = np.array([1.0, 1.0, 1.0, 7.3e-5, 7.3e-5, 7.3e-5])
        scaled = Phi * unit / unit[:, None]
        defect = scaled.T @ J @ scaled - J
        assert np.max(np.abs(defect)) < 1e-8 * np.max(np.abs(scaled)) ** 2


@pytest.fixture(scope="module")
def observation(two_body, ephemeris):
    here = Telescope(name="A", spacecraft=Geostationary(longitude_rad=0.0), sigma_rad=1e-6)
    there = Telescope(name="B", spacecraft=HeliocentricCompanion(lead_rad=0.2), sigma_rad=1e-6)
    times = np.array([0.0, 0.4, 1.0, 1.7, 2.2, 2.3]) * DAY
    return merge([observe(two_body, here, times, ephemeris), observe(two_body, there, times[::2], ephemeris)])


def test_one_orbit_error_is_six_parameters_of_all_exposures(observation, ephemeris, epoch):
    term = OrbitError(name="orbit A", telescopes=("A",), covariance=COVARIANCE, frame="icrf").term(
        observation, ephemeris
    )
    assert isinstance(term, Common)
    rows = observation.rows(["A"])
    Phi = transitions(Geostationary(longitude_rad=0.0), ephemeris, epoch, np.zeros(6), observation.t_s[rows])
    np.testing.assert_allclose(term.H[rows], observation.H_z[rows] @ Phi[:, :3], rtol=1e-12)
    others = np.setdiff1d(np.arange(observation.t_s.size), rows)
    np.testing.assert_array_equal(term.H[others], 0.0)
    assert term.names[3:] == ("orbit A x rate", "orbit A y rate", "orbit A z rate")


def test_in_rtn_the_covariance_is_given_along_the_orbit(observation, ephemeris):
    term = OrbitError(name="orbit A", telescopes=("A",), covariance=COVARIANCE).term(observation, ephemeris)
    first = observation.rows(["A"])[0]
    earth = ephemeris.state_km_km_s("earth", observation.epoch, observation.t_s[first : first + 1])[0]
    state = observation.telescope_state[first] - earth
    np.testing.assert_allclose(term.displacement[first, :, 0], state[:3] / np.linalg.norm(state[:3]), atol=1e-12)
    np.testing.assert_allclose(term.displacement[first, :, 1], state[3:] / np.linalg.norm(state[3:]), atol=1e-6)
    np.testing.assert_array_equal(term.displacement[first, :, 3:], 0.0)


def test_a_renewed_orbit_error_is_constant_in_its_interval_and_new_in_the_next(observation, ephemeris, support):
    kind = OrbitError(name="orbit A", telescopes=("A",), covariance=COVARIANCE, renewal_s=DAY, at_s=-0.1 * DAY)
    term = kind.term(observation, ephemeris)
    assert isinstance(term, Markov)
    drawn = term.draw(np.random.default_rng(12), 20_000)
    interval = np.floor((observation.t_s[term.rows] + 0.1 * DAY) / DAY)
    np.testing.assert_array_equal(interval, [0, 0, 1, 1, 2, 2])
    np.testing.assert_array_equal(drawn[:, 0], drawn[:, 1])
    np.testing.assert_array_equal(drawn[:, 4], drawn[:, 5])
    independent = drawn[:, [0, 2, 4]].reshape(20_000, 18)
    expected = np.kron(np.eye(3), COVARIANCE)
    assert min(support.likelihood_ratio(independent, expected)) > 5e-4


def test_a_renewed_orbit_error_starts_afresh_at_each_interval(observation, ephemeris, epoch):
    kind = OrbitError(name="o", telescopes=("A",), covariance=COVARIANCE, frame="icrf", renewal_s=DAY, at_s=-0.1 * DAY)
    term = kind.term(observation, ephemeris)
    start_s = np.array([-0.1, -0.1, 0.9, 0.9, 1.9, 1.9]) * DAY
    Phi = transitions(Geostationary(longitude_rad=0.0), ephemeris, epoch, start_s, observation.t_s[term.rows])
    np.testing.assert_allclose(term.displacement, Phi[:, :3], rtol=1e-9, atol=1e-9)


def test_a_renewed_orbit_error_acts_as_one_error_inside_an_interval(observation, ephemeris):
    whole = OrbitError(name="o", telescopes=("A",), covariance=COVARIANCE).term(observation, ephemeris)
    pieces = OrbitError(name="o", telescopes=("A",), covariance=COVARIANCE, renewal_s=10 * DAY).term(
        observation, ephemeris
    )
    np.testing.assert_allclose(pieces.H, whole.H[pieces.rows], rtol=1e-12)
    np.testing.assert_array_equal(pieces.F[1:], np.broadcast_to(np.eye(6), (5, 6, 6)))
    np.testing.assert_array_equal(pieces.Q[1:], 0.0)


def test_one_draw_has_the_covariance_given(observation, ephemeris, support):
    term = OrbitError(name="o", telescopes=("A",), covariance=COVARIANCE).term(observation, ephemeris)
    drawn = term.draw(np.random.default_rng(13), 20_000)
    assert min(support.likelihood_ratio(drawn, COVARIANCE)) > 5e-4


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"covariance": np.eye(5)}, "6 x 6"),
        ({"covariance": np.eye(6) + np.eye(6, k=1)}, "not symmetric"),
        ({"covariance": np.diag([1.0] * 5 + [-1.0])}, "not positive"),
        ({"covariance": COVARIANCE, "renewal_s": 0.0}, "renewal must be positive"),
        ({"covariance": COVARIANCE, "frame": "tnw"}, "frame must be"),
    ],
)
def test_wrong_descriptions_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        OrbitError(name="o", telescopes=("A",), **options)


def test_telescopes_on_different_spacecraft_cannot_share_an_orbit_error(observation, ephemeris):
    with pytest.raises(InputError, match="different spacecraft"):
        OrbitError(name="o", telescopes=("A", "B"), covariance=COVARIANCE).term(observation, ephemeris)
