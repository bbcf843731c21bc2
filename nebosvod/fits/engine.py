"""The fit of one object from its records to its estimate.

records -> material -> start (given, or found from three directions) -> growth of the arc -> selection -> the estimator
"""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, ForceModel
from nebosvod.errors import counted, noting
from nebosvod.estimation.problem.square_root import covariance_factor
from nebosvod.estimation.solvers.rejection import Thresholds
from nebosvod.fits.correction import Correction, Knowledge
from nebosvod.fits.ending import Verdict, verdict
from nebosvod.fits.first_orbit import carried, first_orbit
from nebosvod.fits.general import General, estimate, widened
from nebosvod.fits.leading import Course, Led, convinced
from nebosvod.fits.noise_factors import CLOSE, NoiseFactor, by_record, noise_factors
from nebosvod.fits.selection import Selected, select
from nebosvod.fits.shared_errors import Records, SharedError
from nebosvod.mission import FitMission
from nebosvod.mission.reading.places import asking
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.scene.dates import dated
from nebosvod.scene.material import Material, prepare, require_few_steps
from nebosvod.scene.prior import STATE_NAMES, PriorTable, prior_table
from nebosvod.scene.scene import force_model, require_epochs
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
ROUNDS_OF_FACTORS = 6  # of the noise of stations, each a fit anew


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrbitFit:
    """Everything found about one object.

    Attributes
    ----------
    mission : resolved: object, stations, and as its reference epoch that of the fit.
    start : where the orbit came from, a sentence.
    lean : the last differential correction and its selection.
    general : the estimate with every source of error.
    verdict : how it ended, and whether it may be believed.
    found : the tests of shared errors and missing forces.
    """

    mission: FitMission
    material: Material
    start: str
    lean: Selected
    general: General
    priors: PriorTable
    verdict: Verdict
    found: Led

    @property
    def errors(self) -> tuple[SharedError, ...]:
        """Errors that the records of a station share."""
        return self.found.errors

    @property
    def epoch(self) -> Epoch:
        """At which state and covariance are meant."""
        return self.mission.reference_epoch


def fit_object(
    records: Astrometry, mission: FitMission, ephemeris: Ephemeris, say: Callable[[str], None] = lambda message: None
) -> OrbitFit:
    """Fit the orbit of one object.

    Parameters
    ----------
    records : of one object, from any number of files.
    mission : what is asked, uncertain and known beforehand; its object may be without an orbit.
    say : called with one line of text at each stage.

    Raises
    ------
    GeometryError
        If no starting orbit can be found; says what is known instead.
    InputError, CoverageError, DataError, EventError
        As the stages raise them; a lack of convergence or observability is a status of the answer.
    """
    require_epochs(mission, ephemeris)
    designation, records = records.objects[0], dated(records, mission)
    say(f"{designation}: placing {counted(len(records), 'observation')} of {counted(len(records.stations), 'station')}")
    require_few_steps(mission, records)
    material = prepare(records, mission, ephemeris)
    thresholds = thresholds_of(mission)
    with noting(material.notices):
        epoch, state, chosen, origin = first_orbit(material, mission, ephemeris, thresholds, say)
    resolved = mission.of(designation, material.names, epoch, state)
    forces = force_model(resolved, ephemeris)
    priors = prior_table(resolved, forces, _prior_mean(mission, resolved, forces, state))
    say(f"{designation}: correcting the orbit")
    solved = tuple(p.name for p in resolved.free_parameters if p.treatment == "estimated")
    lean_forces = _with_columns(forces, solved)
    sky = material.sky(epoch)
    x = np.concatenate([state, lean_forces.values])
    prior = knowledge(priors, solved)
    with nullcontext() if mission.object.orbit is None else asking(mission, "object", "orbit"):
        wide = widened(resolved, material, sky, lean_forces, state)
        lean = select(wide, x, lean_forces, thresholds, selected=chosen, prior=prior, limit=mission.fit.iterations)
    weighed = material.weighed(sky, lean.correction.seen)
    if weighed is not sky:
        sky = weighed
        wide = widened(resolved, material, sky, lean_forces, lean.correction.state)
        lean = select(
            wide, lean.correction.x, lean_forces, thresholds, selected=lean.selected, prior=prior,
            near=lean.correction, limit=mission.fit.iterations,
        )  # fmt: skip
    say(f"{designation}: asking every station for shared errors")
    course = Course(
        material=material, records=_records(material, mission), treatment=mission.fit.of_shared_errors,
        forces=lean_forces, thresholds=thresholds, prior=prior, limit=mission.fit.iterations,
        skies=_skies(resolved, epoch, lean_forces),
    )  # fmt: skip
    found = convinced(course, sky, wide, lean)
    if mission.fit.noise_scale == "by_station":
        say(f"{designation}: asking every station how large its noise is")
        found = _scaled(course, found)
    material, sky, lean = found.material, found.sky, found.lean
    say(f"{designation}: estimating")
    values = dict(zip(solved, lean.correction.x[6:].tolist()))
    general = estimate(
        resolved, material, sky, forces.with_values(values), lean.correction.state, priors, lean.selected, thresholds,
        near=lean.correction,
    )  # fmt: skip
    return OrbitFit(
        mission=resolved,
        material=material,
        start=origin,
        lean=lean,
        general=general,
        priors=priors,
        found=found,
        verdict=verdict(found, general),
    )


def _scaled(course: Course, found: Led) -> Led:
    """The fit with the noise of each station as its residuals have it: factors and orbit in turn until they stand."""
    base, station = found.material, found.material.astrometry.station
    whole, total = np.ones(len(station)), dict[str, float]()
    told: list[NoiseFactor] = []
    for _ in range(ROUNDS_OF_FACTORS):
        told = noise_factors(found.sky, found.lean, station, course.prior)
        step = by_record(told, station)
        if np.abs(step - 1.0).max(initial=0.0) <= CLOSE:
            break
        whole = whole * step
        total |= {one.station: total.get(one.station, 1.0) * one.factor for one in told}
        material = base.scaled(whole)
        sky, wide = course.skies(material, found.lean.correction)
        lean = select(
            wide, found.lean.correction.x, course.forces, course.thresholds, selected=found.lean.selected,
            prior=course.prior, near=found.lean.correction, limit=course.limit,
        )  # fmt: skip
        found = replace(found, material=material, sky=sky, wide=wide, lean=lean)
    notices = []
    for one in told:
        factor = total.get(one.station, 1.0)
        text = f"sigmas times {factor:.3g} +- {factor * one.sigma:.2g}"
        notices.append(f"{one.station}: {text}, as the residuals of {counted(one.records, 'record')} have it")
    return replace(found, material=replace(found.material, notices=(*found.material.notices, *notices)))


def _records(material: Material, mission: FitMission) -> Records:
    """The records as tests of shared errors need them: what the settings say of a station is the user's affair."""
    station = material.astrometry.station
    named = [entry.stations for entry in mission.fit.uncertainty]
    asked = np.array([not any(codes == "all" or code in codes for codes in named) for code in station.tolist()])
    return Records(station=station, night=material.night, asked=asked)


def _skies(mission: FitMission, epoch: Epoch, forces: ForceModel) -> Callable[[Material, Correction], tuple[Sky, Sky]]:
    """A function that gives the sky of a material, and the same widened by what will be estimated."""

    def skies(material: Material, near: Correction) -> tuple[Sky, Sky]:
        sky = material.weighed(material.sky(epoch), near.seen)
        return sky, widened(mission, material, sky, forces, near.state)

    return skies


def thresholds_of(mission: FitMission) -> Thresholds | None:
    """The thresholds of a file; None where it rejects nothing."""
    said = mission.fit.rejection
    if not said.enabled:
        return None
    return Thresholds(reject=said.reject, recover=said.recover, fraction=said.fraction, fudge=said.fudge)


def knowledge(priors: PriorTable, parameters: tuple[str, ...]) -> Knowledge | None:
    """Priors of state and solved parameters as rows for the lean correction; None where nothing is known.

    A prior that also holds parameters which are not solved for counts with its marginal covariance of those that are.
    """
    names = (*STATE_NAMES, *parameters)
    rows, mean = [], np.zeros(len(names))
    for _, known, centre, covariance in priors.entries:
        inside = [place for place, name in enumerate(known) if name in names]
        if not inside:
            continue
        columns = [names.index(known[place]) for place in inside]
        L = covariance_factor(covariance[np.ix_(inside, inside)], "prior")
        U = np.zeros((len(inside), len(names)))
        U[:, columns] = np.linalg.solve(L, np.eye(len(inside)))
        rows.append(U)
        mean[columns] = centre[inside]
    return Knowledge(U=np.vstack(rows), mean=mean) if rows else None


def _with_columns(forces: ForceModel, parameters: tuple[str, ...]) -> ForceModel:
    """The same forces with other columns of zeta."""
    return replace(forces, parameters=parameters)


def _prior_mean(mission: FitMission, resolved: FitMission, forces: ForceModel, state: Array) -> Array:
    """The state a prior orbit is about: the orbit that was given, carried to the epoch of the fit."""
    if mission.prior == "none" or mission.object.orbit is None:
        return state
    return carried(mission, resolved.reference_epoch, forces)
