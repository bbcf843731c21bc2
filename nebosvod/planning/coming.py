"""Measurements that could come: what each orbit of a cloud predicts of a visit, and how well that would be measured.

The errors of the orbit and of the telescopes are one vector. What past and coming measurements have in common (a bias,
a clock) is a linear function of the unit draws u behind the orbit and of draws v of its own: the part by u moves what a
member of the cloud predicts, the part by v joins the noise of the visit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, Trajectory, propagate_many
from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.mission import Question
from nebosvod.observation import Common, Observation, Telescope, Term, observe, visibility
from nebosvod.observation import Markov as Chain
from nebosvod.observation.measurement.direction import unit_vector
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.scene.instruments import nuisance

Array = npt.NDArray[np.float64]
LIGHT_ROUNDS = 4  # of the light time of a member from that of the estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Watch:
    """A telescope, and the file that says what is uncertain about it; None for an observer without any."""

    telescope: Telescope
    question: Question | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Visit:
    """One visit of a telescope.

    Attributes
    ----------
    telescope : its name. t_s : (e,) exposures, TDB seconds after the epoch of the orbit.
    observation : what the estimate would show.
    noise : (2e, 2e) covariance of what is measured, given orbit and shared errors of the past; rad^2.
    by_draws : (2e, 6 + m) how the unit draws behind the orbit move it through shared errors, rad.
    chained : names of time-correlated errors, which are taken as drawn anew.
    """

    telescope: str
    t_s: Array
    observation: Observation
    noise: Array
    by_draws: Array
    chained: tuple[str, ...]

    @property
    def factor(self) -> Array:
        """Lower factor (2e, 2e) of the noise."""
        return np.asarray(np.linalg.cholesky(self.noise), dtype=np.float64)


def seen(
    watch: Watch, trajectory: Trajectory, t_s: Array, orbit: UncertainOrbit, bodies: Ephemeris
) -> npt.NDArray[np.bool_]:
    """At which times (n,) a telescope sees the estimate."""
    return visibility(watch.telescope, trajectory, t_s, bodies, orbit.magnitude).visible


def visit(watch: Watch, trajectory: Trajectory, t_s: Array, orbit: UncertainOrbit, bodies: Ephemeris) -> Visit:
    """What a visit with these exposures (e,) would measure of the estimate, and with which errors."""
    observation = observe(trajectory, watch.telescope, t_s, bodies)
    size, draws = 2 * len(t_s), len(orbit.factor)
    noise, by_draws = np.zeros((size, size)), np.zeros((size, draws))
    for k in range(len(t_s)):
        noise[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = observation.noise[k]
    own = np.zeros((size, len(orbit.shared)))  # by the draws of shared errors beyond those of the orbit
    chained = []
    for term in _terms(watch, observation, orbit, bodies):
        if isinstance(term, Common):
            H = term.H.reshape(size, -1)
            if all(name in orbit.shared for name in term.names):
                rows = np.array([orbit.shared[name] for name in term.names])
                by_draws += H @ rows[:, :draws]
                own += H @ rows[:, draws:]
            else:
                noise += H @ term.covariance @ H.T
        else:
            noise += _of_rows(term, size)
            if isinstance(term, Chain):
                chained.append(term.name)
    return Visit(
        telescope=watch.telescope.name, t_s=t_s, observation=observation, noise=noise + own @ own.T, by_draws=by_draws,
        chained=tuple(chained),
    )  # fmt: skip


def predictions(
    visits: Sequence[Visit], orbit: UncertainOrbit, u: Array, bodies: Ephemeris, tolerance: float
) -> list[Array]:
    """What each member (n,) of a cloud predicts of each visit, (n, 2e) in units of the visit's noise.

    Parameters
    ----------
    u : (n, 6 + m) unit draws behind the members.

    Notes
    -----
    Directions are taken on the plane that touches the sky where the estimate is. Members are flown to the emission of
    the light of the estimate and moved on from there by their velocity and the pull of the Sun.
    """
    deviations = u @ orbit.factor.T
    values = np.array([orbit.parameters[name] for name in orbit.parameter_names]) + deviations[:, 6:]
    at = [(one.t_s - one.observation.light_time_s) for one in visits]
    emitted = np.concatenate(at)
    flown = propagate_many(
        orbit.state + deviations[:, :6], orbit.epoch, emitted, orbit.forces(bodies),
        values if values.shape[1] else None, tolerance=tolerance,
    )  # fmt: skip
    found, start = [], 0
    for one in visits:
        moved = np.empty((len(u), 2 * len(one.t_s)))
        for k in range(len(one.t_s)):
            moved[:, 2 * k : 2 * k + 2] = _directions(flown.state[:, start + k], one.observation, k, orbit, bodies)
        moved += u @ one.by_draws.T
        found.append(np.asarray(np.linalg.solve(one.factor, moved.T).T, dtype=np.float64))
        start += len(one.t_s)
    return found


def _terms(watch: Watch, observation: Observation, orbit: UncertainOrbit, bodies: Ephemeris) -> list[Term]:
    """What is uncertain about the telescope in some exposures."""
    question, name, found = watch.question, watch.telescope.name, list[Term]()
    if question is None:
        return found
    for source in question.sources:
        if name in source.telescopes and getattr(source.error, "treatment", "") != "fixed":
            one: Any = nuisance(source, question, (name,))
            if hasattr(one, "at_s"):  # it counts from the epoch of its own file
                one = replace(one, at_s=one.at_s + (question.reference_epoch - orbit.epoch))
            found.append(one.term(observation, bodies))
    return found


def _of_rows(term: Term, size: int) -> Array:
    """Covariance (size, size) of the measurements by a term that is drawn along its rows."""
    if isinstance(term, Common):
        raise TypeError(f"{term.name}: is common to all rows")
    found, count = np.zeros((size, size)), len(term.rows)
    marginals = term.marginals
    for i in range(count):
        carried = marginals[i]
        for j in range(i, count if isinstance(term, Chain) else i + 1):
            if j > i and isinstance(term, Chain):
                carried = carried @ term.F[j].T
            part = term.H[i] @ carried @ term.H[j].T
            a, b = slice(2 * term.rows[i], 2 * term.rows[i] + 2), slice(2 * term.rows[j], 2 * term.rows[j] + 2)
            found[a, b] += part
            if j > i:
                found[b, a] += part.T
    return found


def _directions(states: Array, seen_: Observation, k: int, orbit: UncertainOrbit, bodies: Ephemeris) -> Array:
    """Directions (n, 2) of orbits by heliocentric states (n, 6) at the emission of row k, on its tangent plane, rad."""
    left = np.array([seen_.t_s[k] - seen_.light_time_s[k]])
    sun = bodies.state_km_km_s("sun", orbit.epoch, left)[0]
    r, v = states[:, :3], states[:, 3:]
    a = -bodies.gm_km3_s2["sun"] * r / np.linalg.norm(r, axis=1)[:, None] ** 3
    gap, speed = r + sun[:3] - seen_.telescope_state[k, :3], v + sun[3:]
    dt = np.zeros(len(states))
    for _ in range(LIGHT_ROUNDS):
        now = gap + speed * dt[:, None] + 0.5 * a * dt[:, None] ** 2
        dt = seen_.light_time_s[k] - np.linalg.norm(now, axis=1) / SPEED_OF_LIGHT_KM_S
    now = gap + speed * dt[:, None] + 0.5 * a * dt[:, None] ** 2
    axis = unit_vector(seen_.psi[k : k + 1])[0]
    east = np.array([-np.sin(seen_.psi[k, 0]), np.cos(seen_.psi[k, 0]), 0.0])
    north = np.cross(axis, east)
    return np.asarray(np.stack([now @ east, now @ north], axis=1) / (now @ axis)[:, None])
