"""Directions on the sky, their tangent axes and differences."""

import erfa
import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation.measurement.direction import angle_between, offset, ra_dec, residual, unit_vector, wrap
from nebosvod.observation.measurement.rows import sky_partials

ARCSEC = np.pi / 180.0 / 3600.0


@pytest.fixture
def psi():
    rng = np.random.default_rng(11)
    return np.stack([rng.uniform(0.0, 2.0 * np.pi, 1000), np.arcsin(rng.uniform(-1.0, 1.0, 1000))], axis=1)


def test_ra_and_dec_agree_with_erfa(psi):
    vectors = unit_vector(psi) * 1e8
    ra, dec = erfa.c2s(vectors)
    # two independent atan2 of the same vector: a few units in the last place of 2 pi
    np.testing.assert_allclose(ra_dec(vectors), np.stack([erfa.anp(ra), dec], axis=1), rtol=0.0, atol=2e-15)
    np.testing.assert_allclose(unit_vector(psi), erfa.s2c(psi[:, 0], psi[:, 1]), rtol=0.0, atol=1e-15)


def test_right_ascension_lies_in_zero_to_a_turn_even_when_it_rounds():
    vectors = np.array([[1.0, -1e-20, 0.0], [1.0, 0.0, 0.0], [1.0, -1e-9, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    ra = ra_dec(vectors)[:, 0]
    assert np.all((ra >= 0.0) & (ra < 2.0 * np.pi))
    np.testing.assert_array_equal(ra[[0, 1, 4]], 0.0)
    assert ra[2] == pytest.approx(2.0 * np.pi - 1e-9, abs=1e-15)


def test_declination_keeps_its_precision_at_the_pole():
    co_declination = 1e-10  # asin of z would return 0 for it
    dec = ra_dec(np.array([[co_declination, 0.0, 1.0]]))[0, 1]
    assert np.pi / 2 - dec == pytest.approx(co_declination, rel=2e-6)  # pi/2 itself has 1e-16


def tangent_axes(psi):
    """East and north (n, 2, 3): the sky partials of a target at rest, a unit away."""
    axes = np.empty((len(psi), 2, 3))
    sky_partials(np.zeros((len(psi), 6)), unit_vector(psi), np.ones(len(psi)), axes)
    return axes


def test_tangent_axes_are_orthonormal_at_the_poles_too():
    poles = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1e-200, 0.0, 1.0], [1e-17, -1e-17, -1.0]])
    axes = np.empty((4, 2, 3))
    sky_partials(np.zeros((4, 6)), poles, np.ones(4), axes)
    frame = np.concatenate([poles[:, None], axes], axis=1)
    np.testing.assert_allclose(frame @ np.swapaxes(frame, 1, 2), np.broadcast_to(np.eye(3), (4, 3, 3)), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(frame), 1.0, rtol=1e-15)


def test_tangent_axes_are_the_derivatives_of_the_direction(psi):
    axes = tangent_axes(psi)
    h = 1e-6
    for column, scale in ((0, np.cos(psi[:, 1])), (1, 1.0)):
        step = np.zeros(2)
        step[column] = h
        slope = (unit_vector(psi + step) - unit_vector(psi - step)) / (2.0 * h)
        # second-order differences of unit vectors: truncation 2e-13, round-off 1e-10
        np.testing.assert_allclose(axes[:, column] * np.reshape(scale, (-1, 1)), slope, atol=3e-10)


def test_residual_passes_from_0_to_360_degrees():
    computed = np.array([[1e-7, 0.5], [2.0 * np.pi - 1e-7, 0.5]])
    observed = computed[::-1].copy()
    observed[:, 1] += 3e-7
    expected = np.array([[-2e-7 * np.cos(0.5), 3e-7], [2e-7 * np.cos(0.5), 3e-7]])
    np.testing.assert_allclose(residual(observed, computed), expected, rtol=0.0, atol=1e-15)


def test_residual_freezes_the_computed_declination():
    computed, observed = np.array([[1.0, 1.2]]), np.array([[1.001, 1.1]])
    assert residual(observed, computed)[0, 0] == pytest.approx(0.001 * np.cos(1.2), rel=1e-12)


@pytest.mark.parametrize("dec_deg", [0.0, 60.0, 89.0, -89.99])
def test_residual_near_a_pole_is_the_tangent_plane_offset_to_second_order(dec_deg):
    computed = np.array([[0.1, np.radians(dec_deg)]])
    v = np.array([[0.3, -0.2]]) * ARCSEC
    moved = unit_vector(computed) + np.einsum("nij,ni->nj", tangent_axes(computed), v)
    second_order = np.sum(v**2) * abs(np.tan(computed[0, 1]))
    np.testing.assert_allclose(residual(ra_dec(moved), computed), v, rtol=0.0, atol=second_order + 1e-15)


def test_offset_undoes_residual(psi):
    psi = psi[np.abs(psi[:, 1]) < 1.5]
    v = np.random.default_rng(3).normal(0.0, 1e-6, psi.shape)
    shifted = offset(psi, v)
    assert np.all((shifted[:, 0] >= 0.0) & (shifted[:, 0] < 2.0 * np.pi))
    np.testing.assert_allclose(residual(shifted, psi), v, rtol=0.0, atol=2e-15)


def test_offset_refuses_to_pass_a_pole():
    with pytest.raises(InputError, match="passes a pole"):
        offset(np.array([[0.0, np.pi / 2 - 1e-8]]), np.array([[0.0, 1e-7]]))


def test_residual_refuses_shapes_that_differ():
    with pytest.raises(InputError, match="must both be"):
        residual(np.zeros((3, 2)), np.zeros((2, 2)))


def test_wrap_brings_angles_to_half_a_turn():
    np.testing.assert_allclose(
        wrap(np.array([0.0, 3.5, -3.5, 7.0])), [0.0, 3.5 - 2 * np.pi, 2 * np.pi - 3.5, 7 - 2 * np.pi]
    )


def test_angle_between_is_precise_when_tiny_and_when_straight():
    a = np.array([[1.0, 0.0, 0.0]] * 3)
    b = np.array([[1.0, 1e-12, 0.0], [-5.0, 5e-12, 0.0], [0.0, 2.0, 0.0]])
    angle = angle_between(a, b)
    assert angle[0] == pytest.approx(1e-12, rel=1e-9)
    assert np.pi - angle[1] == pytest.approx(1e-12, abs=5e-16)
    assert angle[2] == pytest.approx(np.pi / 2, rel=1e-15)
