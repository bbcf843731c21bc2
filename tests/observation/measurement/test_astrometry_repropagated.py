"""The partials through the integrator: the orbit is propagated anew for every step of a difference."""

import numpy as np
import pytest

from nebosvod.dynamics import ForceModel, Nongrav, RadiationPressure, propagate
from nebosvod.errors import InputError
from nebosvod.observation import Geostationary, Telescope, observe, residual, sight

HERE = Geostationary(longitude_rad=0.3)
T_S = np.linspace(0.0, 120.0, 13) * 86400.0


def telescope(spacecraft):
    return Telescope(name="A", spacecraft=spacecraft, sigma_rad=5e-7)


def agree(partial, difference):
    """Largest deviation in units of the largest entry of the same row and block."""
    scale = np.abs(difference).max(axis=-1, keepdims=True)
    return float(np.max(np.abs(partial - difference) / scale))


@pytest.fixture(scope="module")
def reference(two_body, ephemeris):
    forces = ForceModel(
        ephemeris=ephemeris,
        radiation=RadiationPressure(radius_m=170.0, mass_kg=6.1e6, albedo=0.16),
        nongrav=Nongrav(a1_au_d2=0.0, a2_au_d2=-2.9e-14, a3_au_d2=0.0),
        parameters=("radius_m", "mass_kg", "albedo", "a2_au_d2"),
    )
    return two_body.start, two_body.epoch, forces


def seen(start, epoch, forces, ephemeris):
    return sight(propagate(start, epoch, T_S, forces, sensitivities=False), HERE, T_S, ephemeris).psi


def test_H_x0_by_repropagation(reference, ephemeris, support):
    start, epoch, forces = reference
    observation = observe(propagate(start, epoch, T_S, forces), telescope(HERE), T_S, ephemeris)
    columns = [
        support.derivative(
            lambda h, axis=axis: residual(seen(start + h * axis, epoch, forces, ephemeris), observation.psi),
            h,
        )
        for axis, h in zip(np.eye(6), [1e4] * 3 + [1e-3] * 3)
    ]
    numeric = np.stack(columns, axis=2)
    # the force model's gradient leaves out the sensitivity of the smallest terms (relativity, J2): 1e-8
    assert agree(observation.H_x0[:, :, :3], numeric[:, :, :3]) < 3e-8
    assert agree(observation.H_x0[1:, :, 3:], numeric[1:, :, 3:]) < 3e-8


@pytest.mark.parametrize(("name", "h"), [("radius_m", 10.0), ("mass_kg", 3e4), ("albedo", 0.05), ("a2_au_d2", 1e-10)])
def test_H_c_by_repropagation(reference, ephemeris, support, name, h):
    """A body as light as a balloon: radiation pressure moves it by thousands of km, so that differences tell."""
    start, epoch, forces = reference
    observation = observe(propagate(start, epoch, T_S, forces), telescope(HERE), T_S, ephemeris)
    column = observation.parameter_names.index(name)
    value = forces.values[column]
    numeric = support.derivative(
        lambda h: residual(seen(start, epoch, forces.with_values({name: value + h}), ephemeris), observation.psi),
        h,
    )
    error = np.max(np.abs(observation.H_c[:, :, column] - numeric))
    assert error < 1e-6 * np.max(np.abs(numeric))


def test_a_trajectory_without_partials_is_refused(reference, ephemeris):
    start, epoch, forces = reference
    bare = propagate(start, epoch, T_S, forces, sensitivities=False)
    with pytest.raises(InputError, match="sensitivities=True"):
        observe(bare, telescope(HERE), T_S, ephemeris)
