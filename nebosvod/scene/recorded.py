"""A fit as the program's scene: forces, stations as telescopes, sources of error, the time its orbit is needed.

Everything that a simulated run says of its estimate (budget, predictions, treatment of every source) is then said of
a fit by the same code.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.borders.treatment import Treatment
from nebosvod.dynamics import ForceModel, Trajectory
from nebosvod.dynamics.impact import follow
from nebosvod.errors import InputError, StepLimitError
from nebosvod.mission import FitMission, Position, SkyPrediction, Source
from nebosvod.mission.uncertainty import ProcessNoise
from nebosvod.observation import Nuisance, Observation, Telescope, ZoneBias
from nebosvod.observation.contracts import Ephemeris as AnyEphemeris
from nebosvod.observation.earth import obscodes
from nebosvod.observation.earth.sites import GroundSite
from nebosvod.observation.uncertainty.term import White
from nebosvod.scene.instruments import nuisance
from nebosvod.scene.material import Material, carrier_of
from nebosvod.scene.process_noise import edges, noise_over, reached
from nebosvod.scene.scene import MARGIN_S, Scene, covered, times_of

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
STATED = "telescope position as stated"
NEARLY = 0.95  # of the way to where the steps came to their end: near orbits, flown as far, take a few more


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StatedPosition:
    """Errors of the observers' places as the records state them: fresh at each record, with its own covariance.

    Parameters
    ----------
    rows, covariance_km2 : (r,) and (r, 3, 3) ICRF, of the observation it is asked about.
    """

    name: str
    rows: Rows
    covariance_km2: Array
    treatment: Treatment = "estimated"

    def term(self, observation: Observation, ephemeris: AnyEphemeris) -> White:
        """H = H_z on the records that state a covariance."""
        return White(
            name=self.name,
            names=tuple(f"{self.name} {axis}" for axis in "xyz"),
            rows=self.rows,
            H=observation.H_z[self.rows],
            displacement=np.broadcast_to(np.eye(3), (self.rows.size, 3, 3)),
            Q=self.covariance_km2,
            treatment=self.treatment,
        )


def scene_of(mission: FitMission, material: Material, forces: ForceModel, trajectory: Trajectory, rows: Rows) -> Scene:
    """The scene of a fit to some of the observations.

    Parameters
    ----------
    mission : resolved (`FitMission.of`): its reference epoch and orbit are those of the fit.
    trajectory : the orbit of the fit, over the observations.
    rows : (k,) the selected observations, ascending.

    Notes
    -----
    Zones of the sky are those of the observed directions, whatever the orbit says.
    """
    exposures = material.exposures.select(rows).counted_from(mission.reference_epoch).seeing()
    seeing = {telescope.name for telescope in exposures.telescopes}
    sources = {source.name: source for source in mission.sources if seeing & set(source.telescopes)}
    every_s = material.exposures.counted_from(mission.reference_epoch).t_s
    nuisances: list[Nuisance] = []
    for source in sources.values():
        names = tuple(name for name in source.telescopes if name in seeing)
        if isinstance(source.error, ProcessNoise):
            edges_s = edges(every_s, _asked_s(mission, forces), source.error.intervals)
            nuisances.append(reached(noise_over(source.name, source.error, names, edges_s), trajectory))
            continue
        one = nuisance(source, mission, names)
        if isinstance(one, ZoneBias):
            one = replace(one, sky=material.observed[rows][exposures.rows(names)])
        nuisances.append(one)
    stated = np.flatnonzero(np.isin(rows, material.position_rows))
    span = float(every_s.min()), float(every_s.max())
    if stated.size:
        block = Position.model_construct(correlation="white", sigma=1.0, treatment="estimated")
        source = Source(name=STATED, group="position", keys=(STATED,), telescopes=(), error=block, path=("fit",))
        sources[STATED] = source
        covariance = material.astrometry.position_covariance_km2[rows[stated]]
        nuisances.append(StatedPosition(name=STATED, rows=stated, covariance_km2=covariance))
    return Scene(
        mission=mission,
        ephemeris=material.ephemeris,
        forces=forces,
        state=np.array(trajectory.at([0.0]).state[0]),
        telescopes=(*material.exposures.telescopes, *_lookouts(mission, material)),
        exposures=exposures,
        sources=sources,
        nuisances=tuple(nuisances),
        span_s=span,
        needed_s=span[1],
        trajectory=trajectory,
    )


def _lookouts(mission: FitMission, material: Material) -> tuple[Telescope, ...]:
    """Places that predictions are made for and that have not observed: spacecraft by their files, sites on the ground.

    A site is placed beyond the Earth-rotation table too, as those that observed are; `beyond_tables` says so.
    """
    asked = {item.telescope for item in mission.predictions if isinstance(item, SkyPrediction)}
    found = []
    for code in sorted(asked - set(material.names)):
        place = carrier_of(mission, code) or _site(code)
        found.append(Telescope(name=code, spacecraft=place, sigma_rad=1.0))
    return tuple(found)


def _site(code: str) -> GroundSite:
    """A station on the ground, by the constants of the Minor Planet Center.

    Raises
    ------
    InputError
        If it has no fixed place.
    """
    site = obscodes.codes()[code]
    if obscodes.needs_position(code):
        raise InputError(f"{obscodes.described(code)} has no fixed place; give its trajectory under fit.spacecraft")
    constants = (np.radians(float(site["Longitude"])), float(site["cos"]), float(site["sin"]))
    return GroundSite.from_parallax(*constants, extrapolate=True)


def beyond_tables(scene: Scene) -> tuple[str, ...]:
    """What stands in for the Earth-rotation table where a prediction is asked of a site beyond its end."""
    told = []
    for item in scene.mission.predictions:
        if isinstance(item, SkyPrediction):
            telescope = next(one for one in scene.telescopes if one.name == item.telescope)
            site = getattr(telescope.spacecraft, "carrier", telescope.spacecraft)
            if isinstance(site, GroundSite):
                notices = site.notices(scene.epoch, np.array([item.at - scene.epoch]))
                told += [f"prediction {item.name} from {item.telescope}: {text}" for text in notices]
    return tuple(told)


def long_span(
    mission: FitMission, forces: ForceModel, span_s: tuple[float, float]
) -> tuple[tuple[float, float], float]:
    """First and last time the answer needs the orbit, inside the ephemeris, and the last that must be reached."""
    epoch = mission.reference_epoch
    needed = [*span_s, 0.0]
    times = needed + _asked_s(mission, forces)
    whole = min(times) - MARGIN_S, max(times) + (MARGIN_S if max(times) > max(span_s) else 0.0)
    return covered(whole, (min(*span_s, 0.0), max(needed)), forces, epoch), max(needed)


def _asked_s(mission: FitMission, forces: ForceModel) -> list[float]:
    """Times, s after the epoch of the fit, at which its file asks for the orbit."""
    epoch = mission.reference_epoch
    asked = [when - epoch for when in (*mission.fit.epochs, *([mission.fit.epoch] if mission.fit.epoch else []))]
    return asked + times_of(mission.predictions, epoch, forces)


def long_trajectory(mission: FitMission, state: Array, forces: ForceModel, span_s: tuple[float, float]) -> Trajectory:
    """The orbit over everything the answer needs, or to its impact, or as far as its steps last.

    Raises
    ------
    EventError, CoverageError
        If it hits a body, the ephemeris ends, or its steps do, before the last observation.
    """
    epoch, (span, needed) = mission.reference_epoch, long_span(mission, forces, span_s)
    try:
        return follow(state, epoch, span, needed, forces, True)
    except StepLimitError as limit:
        if limit.t_s < needed:
            raise
        return follow(state, epoch, (span[0], needed + NEARLY * (limit.t_s - needed)), needed, forces, True)
