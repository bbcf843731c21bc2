"""The compiled loops against the same equations in plain array algebra, and against each other."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.dynamics import ForceModel, RadiationPressure, propagate
from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.errors import CoverageError, InputError
from nebosvod.observation import (
    GeocentricOrbit,
    Geostationary,
    HeliocentricCompanion,
    HeliocentricOrbit,
    Telescope,
    merge,
    observe,
)
from nebosvod.observation.measurement import astrometry, rows
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.observation.measurement.sight import lines_of_sight

T_S = np.linspace(0.5, 60.0, 40) * 86400.0
PARTIALS = ("H_x", "H_x0", "H_z", "H_c", "rate", "noise", "Phi_emission", "zeta_emission")
# a direction carries 2e-16 of a turn and 3e-8 km of 1e8 km; a partial is a sum of a few products
PSI_RAD, RELATIVE = 1e-14, 1e-13


@pytest.fixture(scope="module")
def flight(ephemeris, epoch, two_body):
    forces = ForceModel(
        ephemeris=ephemeris,
        radiation=RadiationPressure(radius_m=170.0, mass_kg=6.1e10, albedo=0.16),
        parameters=("radius_m", "mass_kg", "albedo"),
    )
    return propagate(two_body.start, epoch, np.array([-1.0, 61.0]) * 86400.0, forces)


@pytest.fixture(params=["geostationary", "geocentric", "companion", "heliocentric"])
def telescope(request, epoch):
    spacecraft = {
        "geostationary": Geostationary(longitude_rad=0.3),
        "geocentric": GeocentricOrbit(elements_epoch=epoch, a_km=7000.0, e=0.01, i_rad=1.7, node_rad=0.4),
        "companion": HeliocentricCompanion(lead_rad=-0.17),
        "heliocentric": HeliocentricOrbit(elements_epoch=epoch, a_km=1.05e8, e=0.1, i_rad=0.02),
    }[request.param]
    return Telescope(name="A", spacecraft=spacecraft, sigma_rad=np.array([5e-7, 4e-7]), timing_sigma_s=1.0)


class Plain:
    """A trajectory of unknown make: the same answers, without the dense output in sight."""

    def __init__(self, flight):
        self.flight, self.epoch, self.parameter_names = flight, flight.epoch, flight.parameter_names

    def at(self, t_s):
        return self.flight.at(t_s)

    def state_at(self, t_s):
        # read-only and with gaps, as a view of somebody's table may be
        states = np.repeat(self.flight.state_at(t_s), 2, axis=0)[::2]
        states.flags.writeable = False
        return states


def close(got, wanted, name=""):
    """Agreement to 1e-13 of the largest entry of each row."""
    got, wanted = got.reshape(len(got), -1), wanted.reshape(len(wanted), -1)
    scale = np.abs(wanted).max(axis=1, keepdims=True)
    assert np.max(np.abs(got - wanted) / scale) < RELATIVE, name


def test_rows_are_those_of_plain_array_algebra(flight, telescope, ephemeris, epoch):
    """Light time by fixed-point iteration, then D L and its products, all with numpy."""
    seen = observe(flight, telescope, T_S, ephemeris)
    carrier = telescope.spacecraft.state_km_km_s(ephemeris, epoch, T_S)
    tau = np.zeros_like(T_S)
    for _ in range(8):
        target = flight.state_at(T_S - tau) + ephemeris.state_km_km_s("sun", epoch, T_S - tau)
        rho = target[:, :3] - carrier[:, :3]
        tau = np.linalg.norm(rho, axis=1) / SPEED_OF_LIGHT_KM_S
    d = np.linalg.norm(rho, axis=1)
    u, V = rho / d[:, None], target[:, 3:]
    ra, dec = np.mod(np.arctan2(rho[:, 1], rho[:, 0]), 2.0 * np.pi), np.arctan2(rho[:, 2], np.hypot(*rho.T[:2]))
    assert np.abs(seen.psi - np.stack([ra, dec], axis=1)).max() < PSI_RAD
    np.testing.assert_allclose(seen.light_time_s, tau, rtol=0.0, atol=1e-9)

    east = np.stack([-np.sin(ra), np.cos(ra), 0.0 * ra], axis=1)
    north = np.stack([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)], axis=1)
    L = np.eye(3) - V[:, :, None] * (u / (SPEED_OF_LIGHT_KM_S + np.sum(u * V, axis=1))[:, None])[:, None]
    DL = np.stack([east, north], axis=1) / d[:, None, None] @ L
    emitted = flight.at(T_S - tau)
    r = emitted.state[:, :3]
    r2 = np.sum(r * r, axis=1)[:, None, None]
    G = ephemeris.gm_km3_s2["sun"] / r2**1.5 * (3.0 * r[:, :, None] * r[:, None] / r2 - np.eye(3))
    t = tau[:, None, None]
    back = np.concatenate([np.eye(3) + t**2 / 2.0 * G, -t * np.eye(3) - t**3 / 6.0 * G], axis=2)
    rate = (DL @ (V - carrier[:, 3:])[:, :, None])[:, :, 0]
    wanted = {
        "Phi_emission": emitted.Phi[:, :3], "zeta_emission": emitted.zeta[:, :3], "rate": rate, "H_z": -DL,
        "H_x": DL @ back, "H_x0": DL @ emitted.Phi[:, :3], "H_c": DL @ emitted.zeta[:, :3],
        "noise": np.diag([25e-14, 16e-14]) + rate[:, :, None] * rate[:, None],
    }  # fmt: skip
    for name in PARTIALS:
        # the two light times differ by 1e-9 s, in which Phi and zeta move by 1e-14 of themselves
        close(getattr(seen, name)[:, ..., :3], wanted[name][:, ..., :3], name)
        if wanted[name].shape[-1] == 6:
            close(getattr(seen, name)[:, ..., 3:], wanted[name][:, ..., 3:], name)


def test_any_trajectory_gives_the_rows_of_the_integrated_one(flight, telescope, ephemeris):
    fast, slow = (observe(orbit, telescope, T_S, ephemeris) for orbit in (flight, Plain(flight)))
    assert np.abs(fast.psi - slow.psi).max() < PSI_RAD
    for name in PARTIALS:
        close(getattr(fast, name), getattr(slow, name), name)


def test_rows_do_not_depend_on_the_pieces_they_are_computed_in(flight, telescope, ephemeris, monkeypatch):
    monkeypatch.setattr(astrometry, "CHUNK", 30)  # the Earth's table of few epochs is not interpolated: 2e-7 km
    whole = observe(flight, telescope, T_S[:30], ephemeris)
    pieces = observe(flight, telescope, T_S, ephemeris)
    for name in ("psi", *PARTIALS):
        np.testing.assert_array_equal(getattr(pieces, name)[:30], getattr(whole, name), err_msg=name)


def test_times_may_be_read_only_reversed_or_integers(flight, telescope, ephemeris):
    days = np.arange(1, 9) * 86400
    ahead = observe(flight, telescope, days.astype(float), ephemeris)
    still = days.astype(float)
    still.flags.writeable = False
    for times in (days, still):
        np.testing.assert_array_equal(observe(flight, telescope, times, ephemeris).psi, ahead.psi)
    back = observe(flight, telescope, still[::-1], ephemeris)
    np.testing.assert_array_equal(back.psi[::-1], ahead.psi)


@pytest.mark.parametrize("times", [np.array([]), np.zeros((2, 2)), np.float64(3.0), np.array([0.0, np.inf])])
def test_times_that_are_no_vector_of_numbers_are_refused(flight, telescope, ephemeris, times):
    with pytest.raises(InputError, match="reception times"):
        observe(flight, telescope, times, ephemeris)


def test_light_that_left_before_the_trajectory_began_is_refused(flight, telescope, ephemeris):
    with pytest.raises(CoverageError, match="outside the integrated span"):
        observe(flight, telescope, np.array([flight.span_s[0] + 1.0]), ephemeris)


def test_a_trajectory_without_parameters_has_no_columns_for_them(flight, telescope, ephemeris, epoch, two_body):
    bare = propagate(two_body.start, epoch, T_S[[-1]], ForceModel(ephemeris=ephemeris, asteroids=False))
    seen = observe(bare, telescope, T_S, ephemeris)
    assert seen.H_c.shape == (T_S.size, 2, 0)
    assert seen.zeta_emission.shape == (T_S.size, 3, 0)
    assert np.all(np.isfinite(seen.H_x0))


def test_one_observation_in_order_of_time_is_merged_without_a_copy(flight, telescope, ephemeris):
    seen = observe(flight, telescope, T_S, ephemeris)
    assert merge([seen]) is seen
    turned = observe(flight, telescope, T_S[::-1], ephemeris)
    np.testing.assert_array_equal(merge([turned]).psi, seen.psi)
    np.testing.assert_array_equal(merge([turned]).t_s, T_S)


def test_merging_moves_every_row_of_every_field(flight, telescope, ephemeris):
    even = observe(flight, telescope, T_S[::2], ephemeris)
    odd = observe(flight, replace(telescope, name="B"), T_S[1::2], ephemeris)
    both = merge([odd, even])
    for name in astrometry.ROW_FIELDS:
        np.testing.assert_array_equal(getattr(both, name)[::2], getattr(even, name), err_msg=name)
        np.testing.assert_array_equal(getattr(both, name)[1::2], getattr(odd, name), err_msg=name)
    np.testing.assert_array_equal(both.telescope_index, np.arange(T_S.size) % 2 == 0)


def test_one_state_that_is_no_number_keeps_all_light_times_from_settling():
    heliocentric = np.full((3, 6), 1e8)
    heliocentric[0] = np.nan
    sun, pull, telescope = np.zeros((3, 6)), np.zeros((3, 3)), np.zeros((3, 6))
    target, u, distance, light_time, psi = (np.empty(shape) for shape in ((3, 6), (3, 3), 3, 3, (3, 2)))
    largest = rows.lines_of_sight(
        np.zeros(3), heliocentric, sun, pull, telescope, 0.1, 1e-9, target, u, distance, light_time, psi
    )
    assert np.isnan(largest)


def test_the_first_light_time_is_confirmed_by_one_evaluation(flight, telescope, ephemeris, epoch):
    """The Sun's pull in the first step is worth it: without, every epoch is evaluated once more."""
    calls = []

    def emitted(t_s):
        calls.append(t_s.size)
        return flight.state_at(t_s)

    lines_of_sight(flight, Exposures.of(epoch, [(telescope, T_S)], ephemeris), emitted=emitted)
    assert calls == [T_S.size]


def test_exposures_of_several_telescopes_are_those_of_each_joined(flight, telescope, ephemeris, epoch):
    other = Telescope(name="B", spacecraft=Geostationary(longitude_rad=1.0), sigma_rad=1e-6)
    both = compute(flight, Exposures.of(epoch, [(telescope, T_S), (other, T_S[::3])], ephemeris))
    joined = merge([observe(flight, telescope, T_S, ephemeris), observe(flight, other, T_S[::3], ephemeris)])
    np.testing.assert_array_equal(both.telescope_index, joined.telescope_index)
    for name in astrometry.ROW_FIELDS:
        close(getattr(both, name), getattr(joined, name), name)
    np.testing.assert_array_equal(both.t_s[both.rows(["B"])], T_S[::3])
