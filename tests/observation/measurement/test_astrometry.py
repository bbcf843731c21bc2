"""RA, Dec and every partial, against differences of the measurement itself."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation import Geostationary, HeliocentricCompanion, Telescope, merge, observe, residual, sight
from nebosvod.observation.measurement import astrometry

HERE = Geostationary(longitude_rad=0.3)
T_S = np.linspace(0.0, 120.0, 25) * 86400.0
SPACECRAFT = {
    "geostationary": HERE,
    "behind the Earth": HeliocentricCompanion(lead_rad=-0.17),
    "across the Sun": HeliocentricCompanion(lead_rad=3.0),
}
# Partials agree to 1e-9 of the largest entry of their row: fourth-order differences with a step of 1e-3 of the scale
# leave 1e-12 of truncation and 1e-12 of round-off, what remains is the formula.
RELATIVE = 1e-9


def telescope(spacecraft, name="A", **options):
    return Telescope(name=name, spacecraft=spacecraft, sigma_rad=5e-7, **options)


def agree(partial, difference):
    """Largest deviation in units of the largest entry of the same row and block."""
    scale = np.abs(difference).max(axis=-1, keepdims=True)
    return float(np.max(np.abs(partial - difference) / scale))


@pytest.fixture(scope="module", params=SPACECRAFT)
def spacecraft(request):
    return SPACECRAFT[request.param]


@pytest.fixture(scope="module")
def observation(two_body, spacecraft, ephemeris):
    return observe(two_body, telescope(spacecraft), T_S, ephemeris)


def test_H_z_is_the_partial_by_the_telescopes_position(observation, two_body, spacecraft, ephemeris, support):
    h = 1e-3 * observation.distance_km.min()
    columns = [
        support.derivative(
            lambda h, axis=axis: residual(
                sight(two_body, support.Shifted(spacecraft=spacecraft, by_km=h * axis), T_S, ephemeris).psi,
                observation.psi,
            ),
            h,
        )
        for axis in np.eye(3)
    ]
    assert agree(observation.H_z, np.stack(columns, axis=2)) < RELATIVE


def test_H_x0_is_the_partial_by_the_state_at_the_epoch(observation, two_body, spacecraft, ephemeris, support):
    columns = []
    for axis, h in zip(np.eye(6), [1e4] * 3 + [1e-3] * 3):
        columns.append(
            support.derivative(
                lambda h, axis=axis: residual(
                    sight(replace(two_body, start=two_body.start + h * axis), spacecraft, T_S, ephemeris).psi,
                    observation.psi,
                ),
                h,
            )
        )
    numeric = np.stack(columns, axis=2)
    assert agree(observation.H_x0[:, :, :3], numeric[:, :, :3]) < RELATIVE
    # at the epoch itself the velocity step moves the target by its light time only: too little for differences there
    assert agree(observation.H_x0[1:, :, 3:], numeric[1:, :, 3:]) < RELATIVE


def test_H_x_is_the_partial_by_the_state_at_reception(observation, two_body, spacecraft, ephemeris, support):
    """Each exposure anew, with the orbit's epoch put at its own reception time."""
    states = two_body.at(T_S).state
    for k in (0, 7, 24):
        here = replace(two_body, epoch=two_body.epoch + T_S[k], start=states[k], kick=0.0)
        zero = np.zeros(1)
        centre = sight(here, spacecraft, zero, ephemeris).psi
        columns = []
        for axis, h in zip(np.eye(6), [3e4] * 3 + [1.0] * 3):
            columns.append(
                support.derivative(
                    lambda h, axis=axis, here=here, centre=centre, zero=zero: residual(
                        sight(replace(here, start=here.start + h * axis), spacecraft, zero, ephemeris).psi, centre
                    ),
                    h,
                )
            )
        numeric = np.stack(columns, axis=2)[0]
        assert agree(observation.H_x[k, :, :3], numeric[:, :3]) < RELATIVE
        # the velocity acts through the light time alone (5e2 s): 1 km/s moves the target 5e2 km of 1e8
        assert agree(observation.H_x[k, :, 3:], numeric[:, 3:]) < RELATIVE


def test_H_c_is_the_partial_by_the_dynamic_parameter(observation, two_body, spacecraft, ephemeris, support):
    numeric = support.derivative(
        lambda h: residual(
            sight(replace(two_body, kick=two_body.kick + h), spacecraft, T_S, ephemeris).psi, observation.psi
        ),
        0.1,
    )
    scale = np.abs(numeric).max()
    assert np.max(np.abs(observation.H_c[:, :, 0] - numeric)) < RELATIVE * scale
    assert observation.parameter_names == ("kick",)


def test_rate_is_the_derivative_by_time(observation, two_body, spacecraft, ephemeris, support):
    inner = T_S[1:]
    numeric = support.derivative(
        lambda h: residual(sight(two_body, spacecraft, inner + h, ephemeris).psi, observation.psi[1:]), 120.0
    )
    # the velocity of the geostationary ring leaves precession out: 4e-7 km/s of 40
    assert agree(observation.rate[1:], numeric) < 1e-8


def test_noise_is_tilted_along_the_motion_by_the_clock_error(two_body, ephemeris):
    quiet = observe(two_body, telescope(Geostationary(longitude_rad=0.0)), T_S, ephemeris)
    jitter = observe(two_body, telescope(Geostationary(longitude_rad=0.0), timing_sigma_s=2.0), T_S, ephemeris)
    extra = jitter.noise - quiet.noise
    np.testing.assert_allclose(quiet.noise, np.broadcast_to(np.eye(2) * 2.5e-13, (25, 2, 2)), rtol=1e-12)
    np.testing.assert_allclose(np.trace(extra, axis1=1, axis2=2), 4.0 * np.sum(quiet.rate**2, axis=1), rtol=1e-9)
    across = np.stack([-quiet.rate[:, 1], quiet.rate[:, 0]], axis=1)
    leak = np.einsum("ni,nij,nj->n", across, extra, across)
    assert np.max(np.abs(leak)) < 1e-12 * np.max(np.sum(quiet.rate**2, axis=1)) ** 2


def test_merged_rows_are_ordered_by_time_then_telescope(two_body, ephemeris):
    first = observe(two_body, telescope(SPACECRAFT["geostationary"], "A"), T_S[:4], ephemeris)
    second = observe(two_body, telescope(SPACECRAFT["behind the Earth"], "B"), T_S[2:6], ephemeris)
    both = merge([first, second])
    np.testing.assert_array_equal(both.t_s, np.sort(np.concatenate([T_S[:4], T_S[2:6]])))
    np.testing.assert_array_equal(both.telescope_index, [0, 0, 0, 1, 0, 1, 1, 1])
    np.testing.assert_array_equal(both.H_x0[both.rows(["A"])], first.H_x0)
    np.testing.assert_array_equal(both.psi[both.rows(["B"])], second.psi)
    np.testing.assert_array_equal(both.rows(["A", "B"]), np.arange(8))


def test_merge_refuses_what_does_not_belong_together(two_body, ephemeris, epoch):
    one = observe(two_body, telescope(SPACECRAFT["geostationary"]), T_S[:2], ephemeris)
    with pytest.raises(InputError, match="one name"):
        merge([one, one])
    other = observe(
        replace(two_body, epoch=epoch + 1.0), telescope(SPACECRAFT["geostationary"], "B"), T_S[:2], ephemeris
    )
    with pytest.raises(InputError, match="different trajectories"):
        merge([one, other])
    with pytest.raises(InputError, match="no observations"):
        merge([])
    with pytest.raises(InputError, match=r'telescope "C" made no measurement here .there are: A'):
        one.rows(["C"])


def test_many_epochs_are_computed_in_pieces_with_the_same_result(two_body, ephemeris, monkeypatch):
    whole = observe(two_body, telescope(HERE), T_S, ephemeris)
    monkeypatch.setattr(astrometry, "CHUNK", 7)
    pieces = observe(two_body, telescope(HERE), T_S, ephemeris)
    for name in ("telescope_index", *astrometry.ROW_FIELDS):
        # a table of few epochs is interpolated elsewhere: precession-nutation to 2e-7 km
        np.testing.assert_allclose(getattr(pieces, name), getattr(whole, name), rtol=1e-9, atol=1e-14, err_msg=name)
