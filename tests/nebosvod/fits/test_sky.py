"""A table of exposures by many stations and what an orbit says of it, against each station observed by itself."""

import numpy as np
import pytest

from nebosvod.dynamics import ForceModel, Nongrav, propagate
from nebosvod.errors import CoverageError, InputError
from nebosvod.observation import residual
from nebosvod.observation.measurement.astrometry import compute


def test_directions_and_partials_are_those_of_the_observation_stage(made_sky):
    made = made_sky()
    seen = compute(made.trajectory, made.sky.exposures)
    assert np.abs(seen.psi - made.seen.psi).max() < 1e-11  # rad: 2 microarcsec, 1.5 m at 1 au
    size = np.abs(made.seen.H_x0).max(axis=(0, 1))
    np.testing.assert_allclose(seen.H / size, made.seen.H_x0 / size, atol=1e-7)
    # the velocity is left at the first light time: a pull of 6e-6 km/s^2 over 0.05 s, 1e-8 of 30 km/s
    np.testing.assert_allclose(seen.rate, made.seen.rate, rtol=1e-7)
    size = np.abs(made.seen.H_z).max(axis=(0, 1))
    np.testing.assert_allclose(seen.H_z / size, made.seen.H_z / size, atol=1e-7)


def test_light_times_of_a_near_orbit_lead_to_the_same_directions(made_sky):
    """The first-order correction of a light time 0.05 s off must not leave a trace."""
    made = made_sky()
    fresh = compute(made.trajectory, made.sky.exposures)
    guided = compute(made.trajectory, made.sky.exposures, fresh.light_time_s + 0.05)
    far = compute(made.trajectory, made.sky.exposures, np.zeros(len(made.sky)))
    assert np.abs(guided.psi - fresh.psi).max() < 1e-12
    assert np.abs(far.psi - fresh.psi).max() < 1e-12


def test_the_column_of_a_parameter_is_its_difference_quotient(made_sky, ephemeris):
    forces = ForceModel(ephemeris=ephemeris, nongrav=Nongrav(a2_au_d2=1e-10), parameters=("a2_au_d2",))
    made = made_sky(forces=forces)
    seen = compute(made.trajectory, made.sky.exposures)
    step = 1e-11
    there = [
        compute(
            propagate(made.state, made.sky.epoch, made.sky.t_s, forces.with_values({"a2_au_d2": 1e-10 + d})),
            made.sky.exposures,
        )
        for d in (-step, step)
    ]
    quotient = residual(there[1].psi, there[0].psi) / (2.0 * step)
    assert np.abs(seen.H[:, :, 6] - quotient).max() < 1e-5 * np.abs(quotient).max()


def test_an_observation_beyond_the_orbit_is_refused(made_sky):
    made = made_sky()
    short = propagate(made.state, made.sky.epoch, [0.0, 86400.0], made.forces)
    with pytest.raises(CoverageError):
        compute(short, made.sky.exposures)


def test_a_noise_covariance_that_is_none_is_refused(made_sky):
    sky = made_sky().sky
    R = sky.R.copy()
    R[7] = [[1.0, 2.0], [2.0, 1.0]]
    with pytest.raises(InputError, match="observation 7"):
        sky.weighed(R)


def test_the_whitener_makes_tilted_noise_white(made_sky):
    sky = made_sky().sky
    tilted = sky.R + 1e-13 * np.array([[1.0, 0.8], [0.8, 2.0]])
    W = sky.weighed(tilted).whitener
    np.testing.assert_allclose(W @ tilted @ W.transpose(0, 2, 1), np.tile(np.eye(2), (len(sky), 1, 1)), atol=1e-12)
