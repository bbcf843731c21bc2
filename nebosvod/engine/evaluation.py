"""Predictions evaluated on a trajectory: on the sky, as a state, or of an encounter."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Trajectory
from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.dynamics.impact import BELOW_S, MOST_STEPS, what_it_hits
from nebosvod.engine.approach import encounter_quantity
from nebosvod.engine.facts import ImpactFacts, NoEventError, SkyFacts, StateFacts
from nebosvod.engine.quantity import M_PER_KM, Quantity, make_quantity
from nebosvod.engine.values import value_quantity
from nebosvod.errors import CoverageError, NoAnswerError
from nebosvod.mission.request import EncounterPrediction, Prediction, SkyPrediction, StatePrediction, ValuePrediction
from nebosvod.observation import observe
from nebosvod.scene.process_noise import process_noise_of
from nebosvod.scene.scene import Scene
from nebosvod.timescale import Epoch, Scale
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]


def quantity(scene: Scene, trajectory: Trajectory, request: Prediction, about: Epoch | None = None) -> Quantity:
    """Evaluate a requested prediction on a trajectory.

    Parameters
    ----------
    about : where a near orbit has the encounter, which is then taken however far it is from the time asked about.

    Raises
    ------
    NoAnswerError
        If it does not exist for this orbit; says why.
    """
    return with_process_noise(scene, _quantity(scene, trajectory, request, about))


def with_process_noise(scene: Scene, one: Quantity) -> Quantity:
    """A quantity with its partials by the process noise of the object until its time; as it is where there is none."""
    noise = process_noise_of(scene.nuisances)
    if noise is None:
        return one
    B = noise.moved_by(np.array([one.epoch - scene.epoch]))[0]

    def wider(rows: Array | None) -> Array | None:
        return None if rows is None else np.concatenate([rows, rows[..., :6] @ B], axis=-1)

    disc = None if one.disc is None else replace(one.disc, partials=_some(wider(one.disc.partials)))
    return replace(
        one,
        partials=_some(wider(one.partials)),
        names=(*one.names, *noise.names),
        time_partials=wider(one.time_partials),
        ground_partials=wider(one.ground_partials),
        disc=disc,
    )


def _some(rows: Array | None) -> Array:
    """Partials that are there."""
    return np.zeros((0, 0)) if rows is None else rows


def _quantity(scene: Scene, trajectory: Trajectory, request: Prediction, about: Epoch | None) -> Quantity:
    """The same by the state and the parameters alone."""
    try:
        if isinstance(request, EncounterPrediction):
            _require_covered(scene, trajectory, request)
            _require_reached(scene, trajectory, request)
            return encounter_quantity(scene, trajectory, request, about)
        _require_alive(scene, trajectory, request)
        _require_covered(scene, trajectory, request)
        _require_reached(scene, trajectory, request)
        if isinstance(request, SkyPrediction):
            return _seen(scene, trajectory, request)
        if isinstance(request, ValuePrediction):
            return value_quantity(scene, trajectory, request)
        return _state(scene, trajectory, request)
    except CoverageError as error:
        raise NoAnswerError(str(error), status="not_covered") from None


def _require_covered(scene: Scene, trajectory: Trajectory, request: Prediction) -> None:
    """Refuse a time outside the ephemeris."""
    first, last = scene.ephemeris.coverage(asteroids=trajectory.forces.asteroids)
    if not first <= request.when <= last:
        scale = request.when.scale
        raise NoAnswerError(
            f"{request.when.iso(scale, 0)} is outside the ephemeris, {first.iso(scale, 0)} to {last.iso(scale, 0)}",
            status="not_covered",
        )


def _require_reached(scene: Scene, trajectory: Trajectory, request: Prediction) -> None:
    """Refuse a time to which the orbit has not been flown, because its steps had come to their end."""
    if request.when - scene.epoch > trajectory.span_s[1] and what_it_hits(trajectory) is None:
        raise NoAnswerError(out_of_steps(trajectory, request.when.scale), status="not_reached")


def out_of_steps(trajectory: Trajectory, scale: Scale) -> str:
    """Why an orbit that hits nothing ends before something asked for."""
    end = (trajectory.epoch + trajectory.span_s[1]).iso(scale, 0)
    return f"the orbit is known to {end}: there the {MOST_STEPS:,} steps of a flight end; ask for an earlier time"


def _require_alive(
    scene: Scene, trajectory: Trajectory, request: SkyPrediction | StatePrediction | ValuePrediction
) -> None:
    """Refuse a time after the impact that ends the orbit."""
    if request.at - scene.epoch <= trajectory.span_s[1]:
        hit = None if request.at - scene.epoch < trajectory.span_s[1] - 2.0 * BELOW_S else what_it_hits(trajectory)
    else:
        hit = what_it_hits(trajectory)
    if hit is not None and request.at - hit.epoch >= 0.0:
        raise NoEventError(
            f"the orbit hits {hit.body} on {hit.epoch.iso(request.at.scale, 0)} and ends there, before "
            f"{request.at.iso(request.at.scale, 0)}",
            status="after_impact",
            facts=ImpactFacts(body=hit.body, epoch=hit.epoch),
        )


def _seen(scene: Scene, trajectory: Trajectory, request: SkyPrediction) -> Quantity:
    """Offsets in RA* and Dec, arcsec, as a telescope sees them (astrometric); or the distance its light came, km.

    Notes
    -----
    rho = |r(t - tau) - r_telescope(t)| with c tau = rho, so d rho (1 + u.V / c) = u.dr, V the velocity at emission.
    """
    telescope = next(t for t in scene.telescopes if t.name == request.telescope)
    seen = observe(trajectory, telescope, np.array([request.at - scene.epoch]), scene.ephemeris)
    facts = SkyFacts(
        telescope=telescope.name,
        ra_deg=float(np.degrees(seen.psi[0, 0])),
        dec_deg=float(np.degrees(seen.psi[0, 1])),
        distance_km=float(seen.distance_km[0]),
    )
    if request.plane == "distance":
        u, V = seen.u[0], seen.target_state[0, 3:]
        along = u[None] / (1.0 + u @ V / SPEED_OF_LIGHT_KM_S)
        by_state, by_parameters = along @ seen.Phi_emission[0], along @ seen.zeta_emission[0]
        return make_quantity(
            request, request.at, "km", seen.distance_km.copy(), by_state, by_parameters, trajectory, facts
        )
    return make_quantity(
        request, request.at, "arcsec", None, seen.H_x0[0] / ARCSEC, seen.H_c[0] / ARCSEC, trajectory, facts
    )


def _state(scene: Scene, trajectory: Trajectory, request: StatePrediction) -> Quantity:
    """Heliocentric position on ICRF or RTN axes, km, or velocity on RTN axes, m/s."""
    at = trajectory.at(np.array([request.at - scene.epoch]))
    x, Phi, zeta = at.state[0], at.Phi[0], at.zeta[0]
    rows = slice(3, 6) if request.plane == "rtn_velocity" else slice(0, 3)
    axes = np.eye(3)
    if request.plane != "position":
        radial = x[:3] / np.linalg.norm(x[:3])
        normal = np.cross(x[:3], x[3:])
        normal /= np.linalg.norm(normal)
        axes = np.stack([radial, np.cross(normal, radial), normal])
    scale, unit = (M_PER_KM, "m_s") if request.plane == "rtn_velocity" else (1.0, "km")
    facts = StateFacts(position_km=x[:3], velocity_km_s=x[3:])
    return make_quantity(
        request, request.at, unit, None, scale * axes @ Phi[rows], scale * axes @ zeta[rows], trajectory, facts, axes
    )
