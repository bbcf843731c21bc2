"""The scene of a mission: its forces, reference orbit, telescopes, and the epochs that can be seen.

mission (what a file says) -> scene (objects of the stages, evaluated on the nominal orbit).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav, RadiationPressure, Trajectory, propagate
from nebosvod.dynamics.elements import cometary_to_state, equinoctial_to_state, keplerian_to_state
from nebosvod.dynamics.frames import R_icrf_from_ecliptic
from nebosvod.errors import GeometryError
from nebosvod.mission import Mission
from nebosvod.observation import (
    ConstantBias,
    ConstantPosition,
    GaussMarkovPosition,
    Geostationary,
    HeliocentricCompanion,
    Nuisance,
    Spacecraft,
    Telescope,
    Visibility,
    WhitePosition,
    visibility,
)
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

Array = npt.NDArray[np.float64]
# The orbit is carried this far beyond the first and last epoch asked about: light time, and encounters near an epoch.
MARGIN_S = 1.0 * SECONDS_PER_DAY
ENCOUNTER_MARGIN_S = 5.0 * SECONDS_PER_DAY


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """What a mission means.

    Attributes
    ----------
    forces : with the free parameters as columns of zeta, at their nominal values.
    state : (6,) reference state, heliocentric ICRF at the mission's reference epoch.
    telescopes : in the order of the mission.
    visibilities : one for each telescope, at its scheduled epochs.
    nuisances : what is uncertain about the telescopes, with the mission's own treatment.
    span_s : first and last time the orbit is needed, TDB seconds after the reference epoch.
    trajectory : the reference orbit over the span.
    """

    mission: Mission
    ephemeris: Ephemeris
    forces: ForceModel
    state: Array
    telescopes: tuple[Telescope, ...]
    visibilities: tuple[Visibility, ...]
    nuisances: tuple[Nuisance, ...]
    span_s: tuple[float, float]
    trajectory: Trajectory

    @property
    def epoch(self) -> Epoch:
        """The mission's reference epoch."""
        return self.mission.reference_epoch

    def exposures_s(self, number: int) -> Array:
        """Times (n,) at which telescope `number` measures."""
        seen = self.visibilities[number]
        return seen.t_s[seen.visible]

    def propagate(self, state: Array, forces: ForceModel, *, sensitivities: bool = True) -> Trajectory:
        """The orbit from a state at the reference epoch over the span of the scene."""
        return propagate(state, self.epoch, np.array(self.span_s), forces, sensitivities=sensitivities)


def build_scene(mission: Mission) -> Scene:
    """Build the objects of the stages and find what can be seen.

    Raises
    ------
    CoverageError, DataError
        If an epoch is outside the ephemeris, or it is missing or damaged.
    GeometryError
        If no telescope sees the object at any epoch; the message says which limit removed how many.
    """
    ephemeris = Ephemeris.load(_ephemeris_path(mission))
    forces = force_model(mission, ephemeris)
    span = _span(mission)
    ephemeris.require(mission.reference_epoch, np.array(span), asteroids=mission.force_model.asteroids)
    state = reference_state(mission, forces)
    trajectory = propagate(state, mission.reference_epoch, np.array(span), forces)
    telescopes = tuple(_telescope(mission, number) for number in range(len(mission.telescopes)))
    magnitude = mission.object.magnitude
    law = (magnitude.H, magnitude.G) if magnitude is not None else None
    visibilities = tuple(
        visibility(telescope, trajectory, mission.times_s(telescope.name), ephemeris, law) for telescope in telescopes
    )
    if not any(seen.visible.any() for seen in visibilities):
        lines = [f"{telescope.name}: {seen.explain()}" for telescope, seen in zip(telescopes, visibilities)]
        raise GeometryError(
            f"{mission.name}: no epoch is visible; nothing to estimate from ("
            + "; ".join(lines)
            + "); loosen that limit or move the schedule"
        )
    return Scene(
        mission=mission,
        ephemeris=ephemeris,
        forces=forces,
        state=state,
        telescopes=telescopes,
        visibilities=visibilities,
        nuisances=_nuisances(mission, visibilities),
        span_s=span,
        trajectory=trajectory,
    )


def force_model(mission: Mission, ephemeris: Ephemeris) -> ForceModel:
    """The mission's forces at nominal values; the columns of zeta are its free parameters."""
    value = {parameter.name: parameter.value for parameter in mission.parameters}
    nongrav = {name: value[name] for name in ("a1_au_d2", "a2_au_d2", "a3_au_d2") if name in value}
    radiation = None
    if mission.object.has_radiation:
        names = ("radius_m", "mass_kg", "albedo", "thermal_emission")
        radiation = RadiationPressure(**{name: value[name] for name in names})
    return ForceModel(
        ephemeris=ephemeris,
        asteroids=mission.force_model.asteroids,
        relativity=mission.force_model.relativity,
        earth_oblateness=mission.force_model.earth_oblateness,
        radiation=radiation,
        nongrav=Nongrav(**nongrav) if nongrav else None,
        parameters=tuple(parameter.name for parameter in mission.free_parameters),
    )


def orbit_state(mission: Mission, gm_sun_km3_s2: float) -> Array:
    """Heliocentric ICRF state (6,) at the epoch of the orbit."""
    orbit = mission.object.orbit
    elements = np.array(orbit.elements)
    if orbit.representation == "state":
        state = elements
    else:
        convert = {
            "cometary": cometary_to_state,
            "keplerian": keplerian_to_state,
            "equinoctial": equinoctial_to_state,
        }[orbit.representation]
        state = convert(elements, gm_sun_km3_s2)[0]
    return to_icrf(state) if orbit.frame == "ecliptic_j2000" else state


def to_icrf(state: Array) -> Array:
    """A state, or the columns (6, k) of its partials, from the ecliptic of J2000 to ICRF axes."""
    return np.concatenate([R_icrf_from_ecliptic @ state[:3], R_icrf_from_ecliptic @ state[3:]])


def reference_state(mission: Mission, forces: ForceModel) -> Array:
    """The nominal state (6,) at the reference epoch, carried there from the epoch of the orbit."""
    orbit = mission.object.orbit
    state = orbit_state(mission, forces.ephemeris.gm_km3_s2["sun"])
    gap = mission.reference_epoch - orbit.epoch
    if gap == 0.0:
        return state
    carried: Array = propagate(state, orbit.epoch, np.array([gap]), forces, sensitivities=False).state[0]
    return carried


def _ephemeris_path(mission: Mission) -> Path | None:
    """The planetary ephemeris the mission names, beside its file; None to take the one found."""
    said = mission.force_model.ephemeris
    if said is None or mission.path is None:
        return None
    return mission.path.parent / said


def _span(mission: Mission) -> tuple[float, float]:
    """First and last time the orbit is needed, TDB seconds after the reference epoch, with margins."""
    times = [0.0]
    for telescope in mission.telescopes:
        scheduled = mission.times_s(telescope.name)
        if scheduled.size:
            times += [float(scheduled[0]), float(scheduled[-1])]
    for prediction in mission.predictions:
        when = prediction.when - mission.reference_epoch
        margin = ENCOUNTER_MARGIN_S if hasattr(prediction, "near") else 0.0
        times += [when - margin, when + margin]
    return min(times) - MARGIN_S, max(times) + MARGIN_S


def _spacecraft(mission: Mission, number: int) -> Spacecraft:
    orbit = mission.telescopes[number].orbit
    if orbit.kind == "geostationary":
        return Geostationary(longitude_rad=orbit.longitude)
    return HeliocentricCompanion(lead_rad=orbit.lead)


def _telescope(mission: Mission, number: int) -> Telescope:
    said = mission.telescopes[number]
    return Telescope(
        name=said.name,
        spacecraft=_spacecraft(mission, number),
        sigma_rad=np.array(said.noise.sigma_rad),
        timing_sigma_s=said.noise.timing,
        exclusion_sun_rad=said.exclusion.sun,
        exclusion_earth_rad=said.exclusion.earth,
        exclusion_moon_rad=said.exclusion.moon,
        limiting_magnitude=said.limiting_magnitude,
    )


def _nuisances(mission: Mission, visibilities: tuple[Visibility, ...]) -> tuple[Nuisance, ...]:
    """Bias and position error of each telescope that measures anything."""
    found: list[Nuisance] = []
    for said, seen in zip(mission.telescopes, visibilities):
        if not seen.visible.any():
            continue
        if said.bias is not None:
            found.append(
                ConstantBias(
                    name=f"bias {said.name}",
                    telescopes=(said.name,),
                    sigma_rad=np.array(said.bias.sigma_rad or (0.0, 0.0)),
                    mean_rad=np.array(said.bias.mean_rad),
                    treatment=said.bias.treatment,
                )
            )
        if said.position is not None:
            found.append(_position_error(said.name, mission))
    return tuple(found)


def _position_error(telescope: str, mission: Mission) -> Nuisance:
    said = mission.telescope(telescope).position
    if said is None:
        raise ValueError(f"{telescope} has no position error")
    name, sigma = f"telescope position {telescope}", np.array(said.sigma_km)
    if said.correlation == "white":
        return WhitePosition(name=name, telescope=telescope, sigma_km=sigma, frame=said.frame, treatment=said.treatment)
    if said.correlation == "constant":
        return ConstantPosition(
            name=name, telescopes=(telescope,), sigma_km=sigma, frame=said.frame, treatment=said.treatment
        )
    return GaussMarkovPosition(
        name=name,
        telescopes=(telescope,),
        sigma_km=sigma,
        time_s=said.time or 0.0,
        frame=said.frame,
        treatment=said.treatment,
    )
