"""The scene of a mission: its forces, reference orbit, telescopes, and the epochs that can be seen.

mission (what a file says) -> scene (objects of the stages, evaluated on the nominal orbit).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav, RadiationPressure, Trajectory
from nebosvod.dynamics.constants import RADIUS_KM
from nebosvod.dynamics.impact import carry, follow
from nebosvod.errors import CoverageError, InputError, UnseenError
from nebosvod.mission import Mission, Question, Source
from nebosvod.mission.orbit import ImpactOrbit
from nebosvod.mission.parameter import LOGARITHMS, MAGNITUDE
from nebosvod.mission.reading.places import asking, place
from nebosvod.mission.request import Prediction
from nebosvod.mission.spacecraft import OemFile, Spk, Tabulated
from nebosvod.mission.state import orbit_state
from nebosvod.mission.target import Orbit
from nebosvod.observation import Nuisance, Telescope, Visibility, ZoneBias, visibility
from nebosvod.observation.measurement.exposures import Exposures, row_order
from nebosvod.scene.declared import Declared, as_assumed
from nebosvod.scene.imaging import imaged
from nebosvod.scene.instruments import nuisance, telescopes
from nebosvod.scene.logarithmic import LogarithmicForces
from nebosvod.scene.process_noise import reached
from nebosvod.scene.seeing import nearest_words
from nebosvod.scene.sharing import ALONE, Shared, aimed, flown
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

Array = npt.NDArray[np.float64]
# The orbit is carried this far beyond the first and last epoch asked about: light time, and encounters near an epoch.
MARGIN_S = 1.0 * SECONDS_PER_DAY
ENCOUNTER_MARGIN_S = 5.0 * SECONDS_PER_DAY
HARD = ("earth", "moon", "sun")  # bodies that a trajectory of a file is held against
LOWEST = 0.99  # of their radii: the poles of the Earth lie at 0.9966


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """What a mission, or a fit, means.

    Attributes
    ----------
    mission : what is asked.
    forces : with the free parameters as columns of zeta, at their nominal values.
    state : (6,) reference state, heliocentric ICRF at the mission's reference epoch.
    telescopes : in the order of the mission.
    exposures : what is measured, in the order of time and then of telescope; only telescopes that measure anything.
    sources : what the mission says is uncertain about telescopes that measure anything, by name.
    nuisances : the same sources as observation knows them, in the same order.
    span_s : first and last time the orbit is needed, TDB seconds after the reference epoch.
    needed_s : when the last measurement is taken; an orbit may hit a body after it.
    trajectory : the reference orbit over the span, or to its impact.
    """

    mission: Question
    ephemeris: Ephemeris
    forces: ForceModel
    state: Array
    telescopes: tuple[Telescope, ...]
    exposures: Exposures
    sources: Mapping[str, Source]
    nuisances: tuple[Nuisance, ...]
    span_s: tuple[float, float]
    needed_s: float
    trajectory: Trajectory

    @property
    def epoch(self) -> Epoch:
        """The mission's reference epoch."""
        return self.mission.reference_epoch

    def propagate(self, state: Array, forces: ForceModel, *, sensitivities: bool = True) -> Trajectory:
        """The orbit from a state at the reference epoch over the span of the scene, or to its impact.

        It takes the steps of the reference orbit while each passes the error check, which saves a quarter of the time.
        """
        return follow(state, self.epoch, self.span_s, self.needed_s, forces, sensitivities, self.trajectory)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedScene(Scene):
    """The scene of a mission that is simulated: its exposures are what can be seen of a schedule.

    Attributes
    ----------
    visibilities : one for each telescope, at its scheduled epochs.
    """

    mission: Mission
    visibilities: tuple[Visibility, ...]


def build_scene(mission: Mission, shared: Shared = ALONE) -> PlannedScene:
    """Build the objects of the stages and find what can be seen.

    Parameters
    ----------
    shared : of missions that differ in few keys; what is made of the same is taken from an earlier one.

    Raises
    ------
    CoverageError, DataError
        If an epoch is outside the ephemeris, or it is missing or damaged.
    EventError
        If the orbit hits a body before the last measurement or state asked for.
    GeometryError
        If no telescope sees the object at any epoch; the message says which limit removed how many.
    """
    ephemeris = shared.made("ephemeris", lambda: str(mission.ephemeris_path), lambda: load_ephemeris(mission))
    forces = force_model(mission, ephemeris)
    require_epochs(mission, ephemeris)
    span, needed = _span(mission, forces)
    span = covered(span, (min(_measured(mission)), needed), forces, mission.reference_epoch)

    def orbit() -> tuple[ForceModel, Array, Trajectory]:
        with asking(mission, "object", "orbit"):
            state = state_at(mission.object.orbit, mission.reference_epoch, forces)
        with asking(mission, "schedule"):
            return forces, state, follow(state, mission.reference_epoch, span, needed, forces, True)

    forces, state, trajectory = shared.made("orbit", lambda: flown(mission, span), orbit, (ephemeris,))
    if trajectory.span_s[1] < span[1]:  # it hits something: whether too early depends on what is needed here
        forces, state, trajectory = orbit()
    with asking(mission, "schedule"):
        instruments = telescopes(mission)
        visibilities = tuple(
            shared.made(
                "visibility",
                lambda block=block: aimed(mission, block),  # type: ignore[misc]
                lambda telescope=telescope: _visibility(mission, telescope, trajectory),  # type: ignore[misc]
                (trajectory,),
            )
            for block, telescope in zip(mission.telescopes, instruments)
        )
        _require_seen(instruments, visibilities, mission)
    exposures, sources, nuisances = measured(mission, instruments, visibilities, ephemeris, shared)
    exposures = imaged(mission, exposures, trajectory)
    nuisances = tuple(reached(one, trajectory) for one in nuisances)
    return PlannedScene(
        mission=mission,
        ephemeris=ephemeris,
        forces=forces,
        state=state,
        telescopes=instruments,
        visibilities=visibilities,
        exposures=exposures,
        sources=sources,
        nuisances=nuisances,
        span_s=span,
        needed_s=needed,
        trajectory=trajectory,
    )


def seen_until(scene: PlannedScene, last_s: float, shared: Shared = ALONE) -> PlannedScene:
    """The scene of the same mission with what is measured until a time, TDB s after the reference epoch.

    Raises
    ------
    UnseenError
        If nothing is.
    """
    visibilities = tuple(replace(one, visible=one.visible & (one.t_s <= last_s)) for one in scene.visibilities)
    if not any(one.visible.any() for one in visibilities):
        raise UnseenError(f"nothing is seen until {(scene.epoch + last_s).iso(digits=0)}")
    made = measured(scene.mission, scene.telescopes, visibilities, scene.ephemeris, shared)
    return _observed(scene, visibilities, *made)


def _observed(
    scene: PlannedScene,
    visibilities: tuple[Visibility, ...],
    exposures: Exposures,
    sources: Mapping[str, Source],
    nuisances: tuple[Nuisance, ...],
) -> PlannedScene:
    """The scene with other measurements."""
    return replace(
        scene,
        visibilities=visibilities,
        exposures=imaged(scene.mission, exposures, scene.trajectory),
        sources=sources,
        nuisances=tuple(reached(one, scene.trajectory) for one in nuisances),
    )


def load_ephemeris(mission: Question) -> Ephemeris:
    """The ephemeris the mission asks for, else the one that is found."""
    if mission.ephemeris_path is None:
        return Ephemeris.load()
    with asking(mission, "force_model", "ephemeris"):
        return Ephemeris.load(mission.ephemeris_path)


def require_epochs(mission: Question, ephemeris: Ephemeris) -> None:
    """Refuse an epoch of the mission outside the ephemeris; a prediction there is a row without an answer."""
    for path, epoch in mission.epochs():
        with asking(mission, *path):
            ephemeris.require(epoch, 0.0, asteroids=mission.force_model.asteroids)


def looked(mission: Mission, most: int) -> tuple[tuple[Telescope, Visibility], ...]:
    """What each telescope sees of its schedule, without partials, at `most` of its epochs, evenly picked, or all.

    Raises
    ------
    NebosvodError
        As `build_scene`, but for a schedule of which nothing is seen.
    """
    ephemeris = load_ephemeris(mission)
    forces = force_model(mission, ephemeris)
    require_epochs(mission, ephemeris)
    times = _measured(mission)
    span = covered(
        (min(times) - MARGIN_S, max(times) + MARGIN_S), (min(times), max(times)), forces, mission.reference_epoch
    )
    with asking(mission, "object", "orbit"):
        state = state_at(mission.object.orbit, mission.reference_epoch, forces)
    with asking(mission, "schedule"):
        trajectory = follow(state, mission.reference_epoch, span, max(times), forces, False)
        return tuple(
            (telescope, _visibility(mission, telescope, trajectory, most)) for telescope in telescopes(mission)
        )


def _visibility(mission: Mission, telescope: Telescope, trajectory: Trajectory, most: int | None = None) -> Visibility:
    """What a telescope sees of its scheduled epochs, or of `most` of them."""
    magnitude, ephemeris = mission.object.magnitude, trajectory.forces.ephemeris
    law = (magnitude.H, magnitude.G) if magnitude is not None else None
    try:
        _require_outside(mission, telescope, ephemeris)
        t_s = mission.times_s(telescope.name)
        if most is not None and t_s.size > most:
            t_s = t_s[np.linspace(0, t_s.size - 1, most).round().astype(np.int64)]
        return visibility(telescope, trajectory, t_s, ephemeris, law)
    except CoverageError as error:
        error.say_place(place(mission, ("schedule", _asking_too_much(mission, telescope, ephemeris))))
        error.args = (f"{error} (telescope {telescope.name})",)
        raise


def _require_outside(mission: Mission, telescope: Telescope, ephemeris: Ephemeris) -> None:
    """Refuse a trajectory from a file that leads through a body; the other kinds of orbits cannot."""
    number = next(i for i, block in enumerate(mission.telescopes) if block.name == telescope.name)
    t_s, epoch = mission.times_s(telescope.name), mission.reference_epoch
    if not isinstance(mission.telescopes[number].orbit, Tabulated | Spk | OemFile) or not t_s.size:
        return
    place_km = telescope.spacecraft.state_km_km_s(ephemeris, epoch, t_s)[:, :3]
    for body in HARD:
        gap = np.linalg.norm(place_km - ephemeris.position_km(body, epoch, t_s), axis=1)
        k = int(np.argmin(gap))
        if gap[k] < LOWEST * RADIUS_KM[body]:
            with asking(mission, "telescopes", number, "orbit"):
                at = (epoch + float(t_s[k])).iso(digits=0)
                raise InputError(f"{telescope.name} is inside the {body}: {gap[k]:.0f} km from its centre at {at}")


def _asking_too_much(mission: Mission, telescope: Telescope, ephemeris: Ephemeris) -> int:
    """Number of the first arc for whose times a telescope has no place."""
    for i in range(len(mission.schedule)):
        t_s = mission.times_s(telescope.name, i)
        try:
            telescope.spacecraft.state_km_km_s(ephemeris, mission.reference_epoch, t_s)
        except CoverageError:
            return i
    return 0


def _require_seen(instruments: Sequence[Telescope], visibilities: Sequence[Visibility], mission: Mission) -> None:
    """Refuse a schedule of which nothing is seen, and say which limit is to blame and by how much."""
    if any(seen.visible.any() for seen in visibilities):
        return
    lines = [
        f"{telescope.name}: {seen.explain()}{nearest_words(telescope, seen, mission)}"
        for telescope, seen in zip(instruments, visibilities)
    ]
    raise UnseenError(
        f"no epoch is visible; nothing to estimate from ({'; '.join(lines)}); loosen that limit or move the schedule"
    )


def measured(
    mission: Mission,
    instruments: Sequence[Telescope],
    visibilities: Sequence[Visibility],
    ephemeris: Ephemeris,
    shared: Shared = ALONE,
) -> tuple[Exposures, dict[str, Source], tuple[Nuisance, ...]]:
    """What is seen as exposures, and what is uncertain about it: sources by name, and as observation knows them."""
    pairs = [(t, seen) for t, seen in zip(instruments, visibilities) if seen.visible.any()]
    planned = [(telescope, seen.t_s[seen.visible]) for telescope, seen in pairs]
    exposures = shared.made(
        "exposures",
        lambda: None,
        lambda: Exposures.of(mission.reference_epoch, planned, ephemeris),
        (ephemeris, *(seen for _, seen in pairs)),
    ).by([telescope for telescope, _ in pairs])
    seeing = {telescope.name for telescope, _ in pairs}
    active = {s.name: s for s in mission.sources if seeing & set(s.telescopes)}
    found: list[Nuisance] = []
    for source in active.values():
        names = tuple(name for name in source.telescopes if name in seeing)
        with asking(mission, *source.path):
            one = nuisance(source, mission, names)
        if isinstance(as_assumed(one), ZoneBias):
            one = _in_zones(one, _sky([seen for t, seen in pairs if t.name in names]))
        found.append(one)
    return exposures, active, tuple(found)


def _in_zones(one: Nuisance, sky: Array) -> Nuisance:
    """A bias by zones of the sky with the directions by which measurements are given to them."""
    if isinstance(one, Declared):
        return replace(one, assumed=_in_zones(one.assumed, sky), true=_in_zones(one.true, sky))
    return replace(one, sky=sky) if isinstance(one, ZoneBias) else one


def _sky(visibilities: Sequence[Visibility]) -> Array:
    """Directions (r, 2) of the exposures of some telescopes on the reference orbit, in the order of rows."""
    t_s = np.concatenate([seen.t_s[seen.visible] for seen in visibilities])
    index = np.repeat(np.arange(len(visibilities)), [np.count_nonzero(seen.visible) for seen in visibilities])
    psi: Array = np.concatenate([seen.psi[seen.visible] for seen in visibilities])[row_order(t_s, index)]
    return psi


def force_model(mission: Question, ephemeris: Ephemeris) -> ForceModel:
    """The mission's forces at nominal values; the columns of zeta are its free parameters."""
    value = dict(parameter.quantity for parameter in mission.parameters)
    nongrav = {name: value[name] for name in ("a1_au_d2", "a2_au_d2", "a3_au_d2") if name in value}
    radiation = None
    if mission.object.radiation_parameters:
        names = ("radius_m", "mass_kg", "albedo", "thermal_emission")
        radiation = RadiationPressure(**{name: value[name] for name in names})
    free = tuple(parameter.name for parameter in mission.free_parameters)
    special = set(free) & {*LOGARITHMS, MAGNITUDE}
    model = partial(LogarithmicForces, magnitude=value.get(MAGNITUDE, 0.0)) if special else ForceModel
    return model(
        ephemeris=ephemeris,
        **mission.force_model.settings,
        radiation=radiation,
        nongrav=Nongrav(**nongrav, **mission.object.nongrav_law) if nongrav else None,
        parameters=free,
    )


def state_at(orbit: Orbit, epoch: Epoch, forces: ForceModel) -> Array:
    """The nominal state (6,) of an orbit carried from its own epoch to another."""
    if isinstance(orbit, ImpactOrbit):  # over a place of the Earth, wherever this ephemeris has it
        state = orbit.state(forces.ephemeris)
    else:
        state = orbit_state(orbit, forces.ephemeris.gm_km3_s2["sun"])
    if epoch == orbit.epoch:
        return state
    carried: Array = carry(state, orbit.epoch, epoch, forces).state[0]
    return carried


def _span(mission: Mission, forces: ForceModel) -> tuple[tuple[float, float], float]:
    """First and last time the orbit is needed, TDB s after the reference epoch, with margins; the last measurement."""
    times = _measured(mission)
    needed = max(times)
    times += times_of(mission.predictions, mission.reference_epoch, forces)
    return (min(times) - MARGIN_S, max(times) + MARGIN_S), needed


def _measured(mission: Mission) -> list[float]:
    """The reference epoch, first and last scheduled measurements, TDB s after it."""
    times = [0.0]
    for telescope in mission.telescopes:
        scheduled = mission.times_s(telescope.name)
        if scheduled.size:
            times += [float(scheduled[0]), float(scheduled[-1])]
    return times


def times_of(predictions: Sequence[Prediction], epoch: Epoch, forces: ForceModel) -> list[float]:
    """Times the orbit should reach for some predictions, TDB s after an epoch; they need not exist on it.

    Those outside the ephemeris have no answer, however far the orbit is flown.
    """
    times: list[float] = []
    first, last = forces.ephemeris.coverage(asteroids=forces.asteroids)
    for prediction in predictions:
        if not first <= prediction.when <= last:
            continue
        around = ENCOUNTER_MARGIN_S if hasattr(prediction, "near") else 0.0
        when = prediction.when - epoch
        times += [when - around, when + around]
    return times


def covered(
    span_s: tuple[float, float], needed_s: tuple[float, float], forces: ForceModel, epoch: Epoch
) -> tuple[float, float]:
    """The part of a span inside the ephemeris, which must hold what is needed: of predictions, some may lie outside."""
    first, last = (end - epoch for end in forces.ephemeris.coverage(asteroids=forces.asteroids))
    return min(max(span_s[0], first), needed_s[0]), max(min(span_s[1], last), needed_s[1])
