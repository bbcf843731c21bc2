"""Synthetic measurements: the truth drawn for every source of uncertainty, then seen through the nonlinear geometry.

The target moves linearly about its reference orbit (by Phi and zeta); direction and light time are computed in full.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from nebosvod.borders.quantities import STATE, bordered
from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array
from nebosvod.observation.measurement.astrometry import Observation
from nebosvod.observation.measurement.direction import offset, ra_dec
from nebosvod.observation.uncertainty.term import Common, Term

LIGHT_TIME_SWEEPS = 5


def draw_truth(terms: Sequence[Term], rng: np.random.Generator) -> dict[str, Array]:
    """Draw one truth for each term: by name, (k,) for common parameters and (r, q) for white and Markov ones.

    A term treated as fixed has no error: its truth is its mean.

    Raises
    ------
    InputError
        If two terms have one name.
    """
    truth: dict[str, Array] = {}
    for term in terms:
        if term.name in truth:
            raise InputError(f'two sources of uncertainty are named "{term.name}"')
        truth[term.name] = term.draw(rng)[0]
        if term.treatment == "fixed":
            truth[term.name] = term.mean if isinstance(term, Common) else np.zeros_like(truth[term.name])
    return truth


@bordered(R="rad2")
def draw_noise(R: Array, rng: np.random.Generator) -> Array:
    """Measurement noise (n, 2) of covariances R (n, 2, 2)."""
    noise: Array = (np.linalg.cholesky(R) @ rng.standard_normal((R.shape[0], 2, 1)))[:, :, 0]
    return noise


@bordered(state_deviation=STATE, noise="rad")
def measure(
    observation: Observation,
    terms: Sequence[Term] = (),
    truth: Mapping[str, Array] | None = None,
    state_deviation: Array | None = None,
    parameters_deviation: Array | None = None,
    noise: Array | None = None,
) -> Array:
    """Measured directions psi (n, 2), rad, when the truth differs from the reference as given.

    Parameters
    ----------
    observation : the computed measurements about which the truth deviates.
    terms, truth : the sources of uncertainty and their true values (from `draw_truth`).
    state_deviation : shape (6,), true minus reference state at the epoch, km and km/s.
    parameters_deviation : shape (m,), true minus reference dynamic parameters.
    noise : shape (n, 2), rad in RA cos Dec and Dec (from `draw_noise`).

    Notes
    -----
    Sources that move the telescope act through the geometry; the others, and the noise, are angles added on the sky.
    The light time is re-solved with the target's reference velocity: its deviation times the change of light time
    (1 m/s x 0.3 s for 1e5 km) is left out.
    """
    shift = np.zeros((observation.t_s.size, 3))
    angle = np.zeros((observation.t_s.size, 2))
    for term in terms:
        value = (truth or {})[term.name]
        rows = slice(None) if isinstance(term, Common) else term.rows
        if term.displacement is None:
            angle[rows] += (term.H @ value[..., None])[..., 0]
        else:
            shift[rows] -= (term.displacement @ value[..., None])[..., 0]
    if state_deviation is not None:
        shift += observation.Phi_emission @ state_deviation
    if parameters_deviation is not None:
        shift += observation.zeta_emission @ parameters_deviation
    psi = ra_dec(_line_of_sight(observation, shift))
    return offset(psi, angle if noise is None else angle + noise)


def _line_of_sight(observation: Observation, shift: Array) -> Array:
    """Lines of sight (n, 3), km, when target less telescope is shifted by `shift`, with the light time re-solved."""
    V = observation.target_state[:, 3:]
    later = np.zeros(observation.t_s.size)
    for _ in range(LIGHT_TIME_SWEEPS):  # each sweep gains a factor |V|/c, 1e-4
        rho = observation.u * observation.distance_km[:, None] + shift - V * later[:, None]
        later = np.linalg.norm(rho, axis=1) / SPEED_OF_LIGHT_KM_S - observation.light_time_s
    return rho
