"""Where the rooms meet: trajectory + telescopes + nuisances -> the matrices of estimation's LinearProblem.

Data flow, for one linearisation at a `Point` (a value for every uncertain parameter):

    Point --propagate--> Trajectory --compute--> Observation (psi, H_x0, H_c, H_z)
    nuisances --term--> what each does to the measurements (H, covariance)
    residual = observed - computed; blocks = state | each dynamic parameter | each common nuisance
    priors   = what is known of each beforehand, as a deviation from the start of the iteration

Cost and memory are linear in the number of measurements.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from nebosvod.borders.treatment import Treatment
from nebosvod.estimation import Block, LinearProblem, Markov, Prior, White
from nebosvod.mission import Estimator
from nebosvod.observation import Common, Nuisance, Observation, Term, draw_noise, residual
from nebosvod.observation import Markov as MarkovTerm
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.direction import offset
from nebosvod.scene.image import at_radius, moved_by_radius
from nebosvod.scene.point import Point, View
from nebosvod.scene.prior import STATE_NAMES, PriorTable
from nebosvod.scene.scene import Scene
from nebosvod.scene.sharing import ALONE, Shared

Array = npt.NDArray[np.float64]
# of the noise of measurements that an estimator does not take: their weight is below the last digit of all others, and
# every array keeps its rows
WEIGHTLESS = 1e34


def nominal_view(scene: Scene, near: Array | None = None, *, simulates: bool = True, shared: Shared = ALONE) -> View:
    """The reference orbit seen, with every parameter at its nominal value and every nuisance at its mean.

    Parameters
    ----------
    near, simulates : as of `view`.
    shared : of missions that differ in few keys; what was computed for the same orbit, times and places is taken.
    """
    exposures = scene.exposures
    computed = shared.made(
        "observation",
        lambda: simulates,
        lambda: compute(scene.trajectory, exposures, near, simulates=simulates),
        (scene.trajectory, exposures.observer),
    )
    observation = replace(computed, telescopes=exposures.telescopes, noise=exposures.noise(computed.rate))
    values = dict(zip(scene.forces.parameters, scene.forces.values.tolist()))
    terms = _terms(scene, scene.nuisances, observation)
    means = {
        name: float(value) for term in terms if isinstance(term, Common) for name, value in zip(term.names, term.mean)
    }
    point = Point(state=scene.state, parameters=values, nuisances=means)
    observation = moved_by_radius(scene, point, observation, terms)
    return View(point=point, trajectory=scene.trajectory, observation=observation, terms=terms)


def view(scene: Scene, point: Point, near: Array | None = None, *, simulates: bool = True) -> View:
    """Propagate and observe at a point.

    Parameters
    ----------
    near : light times (n,) of a near orbit, such as those of the last iteration.
    simulates : whether measurements will be drawn about this point. Without, the partials that only simulation needs
        are left empty: a fifth of the memory.
    """
    trajectory = scene.propagate(point.state, scene.forces.with_values(point.parameters))
    observation = compute(trajectory, scene.exposures, near, simulates=simulates)
    terms = _terms(scene, at_radius(scene, point), observation)
    observation = moved_by_radius(scene, point, observation, terms)
    return View(point=point, trajectory=trajectory, observation=observation, terms=terms)


def computed_psi(seen: View) -> Array:
    """Computed directions (n, 2) with the common nuisances at the values of the point."""
    shift = np.zeros((seen.observation.t_s.size, 2))
    for term in seen.terms:
        if isinstance(term, Common):
            shift += term.H @ np.array([seen.point.nuisances[name] for name in term.names])
    return offset(seen.observation.psi, shift)


def linear_problem(
    scene: Scene, estimator: Estimator, seen: View, observed_psi: Array, priors: PriorTable, about: Point
) -> LinearProblem:
    """The estimation problem of one estimator, linearised at the point of `seen`.

    Parameters
    ----------
    observed_psi : shape (n, 2), rad, rows as in `seen.observation`.
    priors : what is known beforehand (`nebosvod.scene.prior.prior_table`).
    about : the point from which the prior means count, the start of an iteration.
    """
    mission, observation = scene.mission, seen.observation
    blocks = [Block(name="state", names=STATE_NAMES, H=observation.H_x0, treatment="estimated")]
    for column, parameter in enumerate(mission.free_parameters):
        treatment = mission.treatment(estimator, parameter.group)
        H = observation.H_c[:, :, column : column + 1]
        blocks.append(Block(name=parameter.group, names=(parameter.name,), H=H, treatment=treatment))
    own: list[Prior] = []
    white: list[White] = []
    markov: list[Markov] = []
    for term in seen.terms:
        treatment = nuisance_treatment(scene, estimator, term.name)
        if isinstance(term, Common):
            blocks.append(Block(name=term.name, names=term.names, H=term.H, treatment=treatment))
            if term.covariance.any():
                assumed = assumed_mean(scene, term, treatment)
                mean = assumed - np.array([about.nuisances[name] for name in term.names])
                own.append(
                    Prior(
                        name=term.name, names=term.names, covariance=term.covariance, mean=mean,
                        true_covariance=term.true_covariance,
                    )
                )  # fmt: skip
        elif isinstance(term, MarkovTerm):
            markov.append(
                Markov(
                    name=term.name, H=term.H, F=term.F, Q=term.Q, P0=term.P0, rows=term.rows, treatment=treatment,
                    true_F=term.true_F, true_Q=term.true_Q, true_P0=term.true_P0,
                )
            )  # fmt: skip
        else:
            white.append(
                White(name=term.name, H=term.H, Q=term.Q, rows=term.rows, treatment=treatment, true_Q=term.true_Q)
            )
    unused = left_aside(estimator, observation)
    R, true_R = observation.noise, scene.exposures.true_noise(observation.rate)
    if unused.any():
        true_R = R if true_R is None else true_R
        R = np.where(unused[:, None, None], WEIGHTLESS * R, R)
    return LinearProblem(
        residual=residual(observed_psi, computed_psi(seen)),
        R=R,
        true_R=true_R,
        weightless=int(np.count_nonzero(unused)),
        blocks=tuple(blocks),
        priors=(*priors.at(about.values), *own),
        white=tuple(white),
        markov=tuple(markov),
        noise_label=observation.telescope_index,
        noise_names=tuple(f"measurement noise {telescope.name}" for telescope in observation.telescopes),
        scale=_typical_sizes(scene),
    )


def left_aside(estimator: Estimator, observation: Observation) -> npt.NDArray[np.bool_]:
    """Measurements (n,) of telescopes that an estimator does not take."""
    takes = [estimator.takes(telescope.name) for telescope in observation.telescopes]
    aside: npt.NDArray[np.bool_] = ~np.array(takes, dtype=np.bool_)[observation.telescope_index]
    return aside


def nuisance_treatment(scene: Scene, estimator: Estimator, name: str) -> Treatment:
    """What an estimator does with the source of this name; nothing where it takes no telescope that has it."""
    source = scene.sources[name]
    if source.telescopes and not any(estimator.takes(telescope) for telescope in source.telescopes):
        return "fixed"
    return scene.mission.source_treatment(estimator, source)


def assumed_mean(scene: Scene, term: Common, treatment: Treatment) -> Array:
    """What an estimator takes a common nuisance to be beforehand (k,).

    Its mean where the estimator has it in its model; zero for a bias or a clock offset that it leaves out, whose mean
    is then an error. The amplitude of the photocentre is a value of the model, as the radius is: always taken.
    """
    left_out = treatment in ("considered", "ignored") and scene.sources[term.name].group != "photocentre"
    return np.zeros(len(term.names)) if left_out else term.mean


def _terms(scene: Scene, nuisances: Sequence[Nuisance], observation: Observation) -> tuple[Term, ...]:
    return tuple(nuisance.term(observation, scene.ephemeris) for nuisance in nuisances)


def drawn_noise(scene: Scene, observation: Observation, rng: np.random.Generator) -> Array:
    """Measurement noise (n, 2) as it really is."""
    true, mean = scene.exposures.true_noise(observation.rate), scene.exposures.noise_mean
    noise = draw_noise(observation.noise if true is None else true, rng)
    return noise if mean is None else noise + mean


def _typical_sizes(scene: Scene) -> dict[str, float]:
    """Sizes that make parameters comparable where a weak direction is named: 1 km, 1 km over the arc, sigmas."""
    arc = max(scene.span_s[1] - scene.span_s[0], 1.0)
    sizes = dict(zip(STATE_NAMES, (1.0, 1.0, 1.0, 1.0 / arc, 1.0 / arc, 1.0 / arc)))
    for parameter in scene.mission.free_parameters:
        sizes[parameter.name] = parameter.sigma or abs(parameter.value) or 1.0
    return sizes
