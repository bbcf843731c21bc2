"""The orbit a fit found, at any epoch: state and elements with covariance, and how far from another orbit it is."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel, Nongrav, Trajectory
from nebosvod.dynamics.elements import cometary_to_state, state_to_cometary, state_to_keplerian
from nebosvod.dynamics.impact import carry
from nebosvod.errors import CoverageError, EventError, GeometryError
from nebosvod.estimation import Estimate, lower_factor
from nebosvod.mission.fit import Reference
from nebosvod.mission.state import orbit_state, to_icrf
from nebosvod.mission.target import WITH_COVARIANCE
from nebosvod.observation import ProcessNoise
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.timescale import SECONDS_PER_DAY, Epoch
from nebosvod.units import AU_KM, DEG

Array = npt.NDArray[np.float64]
ELEMENTS = ("e", "q_au", "tp_jd_tdb", "node_deg", "peri_deg", "i_deg")
KEPLERIAN = ("a_au", "e", "i_deg", "node_deg", "peri_deg", "mean_anomaly_deg")
TO_PRINT = np.array([1.0, 1.0 / AU_KM, 1.0 / SECONDS_PER_DAY, 1.0 / DEG, 1.0 / DEG, 1.0 / DEG])
TO_PRINT_KEPLERIAN = np.array([1.0 / AU_KM, 1.0, 1.0 / DEG, 1.0 / DEG, 1.0 / DEG, 1.0 / DEG])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrbitAt:
    """State and its error at one epoch, heliocentric ICRF, km and km/s.

    Attributes
    ----------
    S : (6, 6) lower factor of the true covariance; S_formal : of what the estimator believes.
    gm_sun_km3_s2 : for the elements.
    """

    epoch: Epoch
    state: Array
    S: Array
    S_formal: Array
    gm_sun_km3_s2: float

    @property
    def covariance(self) -> Array:
        """True covariance (6, 6)."""
        return self.S @ self.S.T

    def cometary(self) -> tuple[Array, Array] | None:
        """`ELEMENTS` on the ecliptic of J2000, and the factor (6, 6) of their covariance; None where undefined."""
        found = self._elements(state_to_cometary, TO_PRINT)
        if found is None:
            return None
        values, factor = found
        values[2] += self.epoch.day + self.epoch.fraction
        values[3:5] = np.mod(values[3:5], 360.0)
        return values, factor

    def keplerian(self) -> tuple[Array, Array] | None:
        """`KEPLERIAN` on the ecliptic of J2000, and the factor (6, 6) of their covariance; None where undefined."""
        found = self._elements(state_to_keplerian, TO_PRINT_KEPLERIAN)
        if found is None:
            return None
        values, factor = found
        values[3:5] = np.mod(values[3:5], 360.0)
        if values[1] < 1.0:
            values[5] = np.mod(values[5], 360.0)
        return values, factor

    def _elements(self, convert: Any, scale: Array) -> tuple[Array, Array] | None:
        rotation = to_icrf(np.eye(6)).T
        try:
            values, jacobian = convert(rotation @ self.state, self.gm_sun_km3_s2)
        except GeometryError:
            return None
        return scale * values, scale[:, None] * (jacobian @ rotation @ self.S)


def orbit_at(estimate: Estimate, trajectory: Trajectory, t_s: float, noise: ProcessNoise | None = None) -> OrbitAt:
    """The state of a fitted trajectory at a time, with the error that the estimate gives it.

    Parameters
    ----------
    estimate : of the state at the trajectory's epoch; its true covariance is carried, shares of every source included.
    noise : process noise of the object, with its reach: what it does until then is counted.
    """
    at = trajectory.at([t_s])
    every = (*estimate.names, *estimate.left_out)
    known = [name for name in trajectory.parameter_names if name in every]
    columns = [trajectory.parameter_names.index(name) for name in known]
    W = [at.Phi[0], at.zeta[0][:, columns]]
    if noise is not None and set(noise.names) <= set(every):
        known += noise.names
        W.append(at.Phi[0] @ noise.moved_by(np.array([t_s]))[0])
    found = estimate.predict(np.hstack(W), (*STATE_NAMES, *known))
    return OrbitAt(
        epoch=trajectory.epoch + t_s,
        state=np.array(at.state[0]),
        S=found.factor,
        S_formal=found.factor_formal,
        gm_sun_km3_s2=trajectory.forces.ephemeris.gm_km3_s2["sun"],
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """How far a fitted orbit is from a reference orbit, at one epoch.

    Attributes
    ----------
    difference : (6,) heliocentric ICRF, km and km/s, fitted minus reference.
    chi2 : d^T K^-1 d by the fitted covariance, `dof` degrees of freedom; sigmas : (6,) |d| in the fitted sigmas.
    chi2_by_reference, sigma_ratio : by the reference's covariance, and fitted sigma over its (6,); None where it has
        none.
    """

    name: str
    epoch: Epoch
    difference: Array
    chi2: float
    sigmas: Array
    chi2_by_reference: float | None
    sigma_ratio: Array | None
    dof: int = 6


def compared(
    reference: Reference, estimate: Estimate, fitted: OrbitAt, forces: ForceModel, noise: ProcessNoise | None = None
) -> Comparison:
    """How far a fitted orbit is from a reference orbit, in sigmas, at the epoch of the reference.

    Each orbit is carried by its own forces alone: the fitted one, with its covariance, to the epoch of the reference,
    whose numbers stand as they are. Where the fitted orbit does not reach so far (an impact, the end of the ephemeris)
    the reference is carried to the epoch of the fit by the forces that came with it.

    Parameters
    ----------
    fitted : the fitted orbit at its epoch; forces : of the fit, at the values it found; noise : as of `orbit_at`.

    Notes
    -----
    chi^2 = d^T K^-1 d with the difference d of the states, 6 degrees of freedom. The two orbits rest on the same
    observations as a rule, so their difference should be well below the sigma of either: chi^2 far below 6.
    """
    at = reference.orbit.epoch
    try:
        along = carry(fitted.state, fitted.epoch, at, forces, sensitivities=True)
        orbit = orbit_at(estimate, along, at - fitted.epoch, noise)
    except (EventError, CoverageError):
        orbit = fitted
    theirs, carried = _reference_state(reference, orbit, forces)
    difference = orbit.state - theirs
    whitened = np.linalg.solve(orbit.S, difference)
    by_reference, ratio = None, None
    if carried is not None:
        own = np.linalg.solve(carried, difference)
        by_reference = float(own @ own)
        ratio = np.linalg.norm(orbit.S, axis=1) / np.linalg.norm(carried, axis=1)
    return Comparison(
        name=reference.name,
        epoch=orbit.epoch,
        difference=difference,
        chi2=float(whitened @ whitened),
        sigmas=np.abs(difference) / np.linalg.norm(orbit.S, axis=1),
        chi2_by_reference=by_reference,
        sigma_ratio=ratio,
    )


def _reference_state(reference: Reference, orbit: OrbitAt, forces: ForceModel) -> tuple[Array, Array | None]:
    """State (6,) of the reference at the epoch of an orbit, and the factor (6, 6) of its covariance, if it has one."""
    gm = orbit.gm_sun_km3_s2
    start = orbit_state(reference.orbit, gm)
    own = _own_forces(reference, forces)
    along = carry(start, reference.orbit.epoch, orbit.epoch, own, sensitivities=True)
    joint = reference.joint
    if joint is None:
        return np.array(along.state[0]), None
    jacobian = np.eye(6)
    if joint.representation == "cometary":
        back = to_icrf(np.eye(6)).T @ start if joint.frame == "ecliptic_j2000" else start
        jacobian = cometary_to_state(state_to_cometary(back, gm)[0], gm)[1]
    if joint.frame == "ecliptic_j2000":
        jacobian = to_icrf(jacobian)
    order = (
        ("e", "q", "tp", "node", "peri", "i")
        if joint.representation == "cometary"
        else ("x", "y", "z", "vx", "vy", "vz")
    )
    index = [joint.names.index(name) for name in order]
    scale = np.sqrt(np.diag(joint.covariance))[index]
    correlation = joint.covariance[np.ix_(index, index)] / scale[:, None] / scale
    values, vectors = np.linalg.eigh(correlation)
    factor = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return np.array(along.state[0]), lower_factor(along.Phi[0] @ jacobian @ factor)


def _own_forces(reference: Reference, forces: ForceModel) -> ForceModel:
    """The forces of the fit with the non-gravitational values that came with the reference orbit, and no others."""
    if not isinstance(reference.orbit, WITH_COVARIANCE):
        return replace(forces, parameters=(), nongrav=None)
    values: Mapping[str, float] = {
        f"{label.lower()}_au_d2": reference.orbit.nongrav_value(label) or 0.0 for label in ("A1", "A2", "A3")
    }
    return replace(forces, parameters=(), nongrav=Nongrav(**values) if any(values.values()) else None)
