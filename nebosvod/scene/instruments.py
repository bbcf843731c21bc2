"""From the telescopes of a mission file to the objects of observation: two tables, one line a kind.

    SPACECRAFT   block of an orbit          -> where the telescope is
    NUISANCES    block of an uncertainty    -> what is uncertain, with its truth and its partials

To teach the program another kind: write it in `observation`, its block in `mission`, and add its line here.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt

from nebosvod.borders.stored import read_object
from nebosvod.errors import InputError
from nebosvod.mission import Mission, Question, Source
from nebosvod.mission import Telescope as TelescopeBlock
from nebosvod.mission import spacecraft as said
from nebosvod.mission.bias import Bias
from nebosvod.mission.covariance import checked
from nebosvod.mission.position import Position
from nebosvod.mission.reading.places import asking
from nebosvod.mission.uncertainty import Photocentre, PlateScale, ProcessNoise, Timing
from nebosvod.observation import (
    ArcBias,
    BiasDrift,
    ConstantBias,
    ConstantPosition,
    DistantRetrograde,
    GaussMarkovBias,
    GaussMarkovPosition,
    GeocentricOrbit,
    Geostationary,
    GroundSite,
    HeliocentricCompanion,
    HeliocentricOrbit,
    LibrationOrbit,
    Nuisance,
    OrbitError,
    Spacecraft,
    Telescope,
    TimingOffset,
    WhitePosition,
    ZoneBias,
    read_oem,
    read_spk,
    sun_synchronous,
)
from nebosvod.observation import Photocentre as PhotocentreOffset
from nebosvod.observation import PlateScale as PlateScaleError
from nebosvod.observation.earth import obscodes
from nebosvod.observation.measurement.telescope import NoiseTruth
from nebosvod.observation.spacecraft.orbit_table import read_orbit_table
from nebosvod.scene.declared import Declared
from nebosvod.scene.process_noise import edges_of, noise_over
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]


def telescopes(mission: Mission) -> tuple[Telescope, ...]:
    """The telescopes of a mission; those whose orbits are said alike ride on one spacecraft.

    Raises
    ------
    InputError, DataError
        If a file of an orbit cannot be used.
    """
    carriers: list[tuple[said.TelescopeOrbit, Spacecraft]] = []
    found = []
    for i, block in enumerate(mission.telescopes):
        carrier = next((ready for orbit, ready in carriers if orbit == block.orbit), None)
        if carrier is None:
            with asking(mission, "telescopes", i, "orbit"):
                carrier = SPACECRAFT[type(block.orbit)](block.orbit, mission)
            carriers.append((block.orbit, carrier))
        found.append(_telescope(block, carrier))
    return tuple(found)


def nuisance(source: Source, mission: Question, seeing: tuple[str, ...]) -> Nuisance:
    """What a source is to observation, and what it really is; `seeing` are its telescopes that measure anything."""
    make = NUISANCES[kind_of(source)]
    assumed = make(source, mission, seeing)
    if source.error.true is None:
        return assumed
    mean = source.error.true_mean
    true = make(replace(source, error=source.error.truth), mission, seeing)
    return Declared(assumed=assumed, true=true, mean=None if mean is None else np.array(mean))


def kind_of(source: Source) -> tuple[str, str]:
    """Group and correlation: the key of NUISANCES."""
    return source.group, str(getattr(source.error, "correlation", "constant"))


def _telescope(block: TelescopeBlock, carrier: Spacecraft) -> Telescope:
    sun_altitude, altitude = block.night
    return Telescope(
        name=block.name,
        spacecraft=carrier,
        sigma_rad=np.array(block.noise.sigma_rad),
        timing_sigma_s=block.noise.timing,
        exclusion_sun_rad=block.exclusion.sun,
        largest_sun_rad=block.exclusion.sun_max,
        exclusion_earth_rad=block.exclusion.earth,
        exclusion_moon_rad=block.exclusion.moon,
        sun_altitude_rad=sun_altitude,
        altitude_rad=altitude,
        limiting_magnitude=block.limiting_magnitude,
        duty=tuple((window.start, window.end) for window in block.duty),
        exposure_s=block.trailing.exposure if block.trailing is not None else 0.0,
        fwhm_rad=block.trailing.fwhm if block.trailing is not None else None,
        truth=_noise_truth(block),
    )


def _noise_truth(block: TelescopeBlock) -> NoiseTruth | None:
    """What the noise of a telescope really is; None where it is as assumed."""
    if block.noise.true is None:
        return None
    true = block.noise.truth
    return NoiseTruth(
        sigma_rad=np.array(true.sigma_rad), timing_sigma_s=true.timing, mean_rad=np.array(block.noise.mean_rad)
    )


# --- where a telescope is ---------------------------------------------------------------------------------------------


def _elements(orbit: Any, mission: Question) -> dict[str, Any]:
    """Kepler elements by observation's names."""
    return {
        "elements_epoch": _epoch(orbit, mission),
        "a_km": orbit.a,
        "e": orbit.e,
        "i_rad": orbit.i,
        "node_rad": orbit.node,
        "peri_rad": orbit.peri,
        "mean_anomaly_rad": orbit.M,
    }


def _epoch(block: Any, mission: Question) -> Epoch:
    """The epoch a block says, or the reference epoch."""
    return mission.reference_epoch if block.epoch is None else block.epoch


def _libration(orbit: said.Libration, mission: Question) -> Spacecraft:
    return LibrationOrbit(
        point=orbit.point,
        elements_epoch=_epoch(orbit, mission),
        amplitude_km=orbit.amplitude,
        amplitude_z_km=orbit.amplitude_z,
        phase_rad=orbit.phase,
        phase_z_rad=orbit.phase_z,
    )


def _distant_retrograde(orbit: said.DistantRetrograde, mission: Question) -> Spacecraft:
    return DistantRetrograde(elements_epoch=_epoch(orbit, mission), size_km=orbit.size, phase_rad=orbit.phase)


def _sun_synchronous(orbit: said.SunSynchronous, mission: Question) -> Spacecraft:
    return sun_synchronous(
        elements_epoch=_epoch(orbit, mission),
        altitude_km=orbit.altitude,
        local_time_h=orbit.local_time / 3600.0,
        mean_anomaly_rad=orbit.M,
    )


def _ground(orbit: said.Ground, mission: Question) -> Spacecraft:
    if orbit.code is None:
        constants = (orbit.longitude or 0.0, orbit.rho_cos_phi or 0.0, orbit.rho_sin_phi or 0.0)
        return GroundSite.from_parallax(*constants, extrapolate=orbit.extrapolate)
    try:
        codes = obscodes.codes()
        if orbit.file is not None:
            codes = read_object(mission.beside(orbit.file), LARGEST_CODES)
        row = codes[orbit.code]
        constants = (np.radians(float(row["Longitude"])), float(row["cos"]), float(row["sin"]))
    except InputError as error:
        raise InputError(f"{error}; needs the MPC's obscodes_extended.json") from None
    except (OSError, ValueError, TypeError, KeyError) as error:
        text = f"has no usable entry {orbit.code} ({type(error).__name__}: {error})"
        raise InputError(f"{orbit.file or 'ground'}: {text}; needs the MPC's obscodes_extended.json") from None
    if orbit.code not in said.GEOCENTRES and (text := said.underground(*constants[1:])):
        raise InputError(f"{orbit.file or 'ground'}: {orbit.code}: {text}")
    return GroundSite.from_parallax(*constants, extrapolate=orbit.extrapolate)


SPACECRAFT: Mapping[type, Callable[[Any, Question], Spacecraft]] = {
    said.Geostationary: lambda orbit, mission: Geostationary(longitude_rad=orbit.longitude),
    said.Heliocentric: lambda orbit, mission: HeliocentricCompanion(lead_rad=orbit.lead),
    said.Geocentric: lambda orbit, mission: GeocentricOrbit(**_elements(orbit, mission), j2=orbit.j2),
    said.SunSynchronous: _sun_synchronous,
    said.HeliocentricKepler: lambda orbit, mission: HeliocentricOrbit(**_elements(orbit, mission)),
    said.Libration: _libration,
    said.DistantRetrograde: _distant_retrograde,
    said.Tabulated: lambda orbit, mission: read_orbit_table(mission.beside(orbit.file), orbit.origin),
    said.Spk: lambda orbit, mission: read_spk(mission.beside(orbit.file), orbit.target),
    said.OemFile: lambda orbit, mission: read_oem(mission.beside(orbit.file)).orbit,
    said.Ground: _ground,
}


# --- what is uncertain ------------------------------------------------------------------------------------------------

Seeing = tuple[str, ...]
LARGEST_CODES = 5_000_000  # bytes of a list of observatories; the MPC's has 0.3 million
# axes of a covariance in an OEM file; RSW is another name of RTN
OEM_AXES: Mapping[str, Literal["icrf", "rtn"]] = {
    "EME2000": "icrf",
    "ICRF": "icrf",
    "GCRF": "icrf",
    "RTN": "rtn",
    "RSW": "rtn",
}
Kind = TypeVar("Kind")


def _bias(source: Source, mission: Question, seeing: Seeing) -> Nuisance:
    error = _of(Bias, source)
    known: dict[str, Any] = {
        "name": source.name,
        "telescopes": seeing,
        "sigma_rad": np.array(error.sigma_rad or (0.0, 0.0)),
        "treatment": error.treatment,
    }
    if error.correlation == "drift":
        at_s = _epoch(error, mission) - mission.reference_epoch
        return BiasDrift(**known, drift_sigma_rad_s=error.drift or 0.0, at_s=at_s)
    if error.correlation == "per_arc":
        return ArcBias(**known, gap_s=error.gap or 0.0)
    if error.correlation == "gauss_markov":
        return GaussMarkovBias(**known, time_s=error.time or 0.0)
    if error.correlation == "per_zone":
        return ZoneBias(**known, zone_rad=min(error.zone or 0.0, np.pi))
    return ConstantBias(**known, mean_rad=np.array(error.mean_rad))


def _position(source: Source, mission: Question, seeing: Seeing) -> Nuisance:
    error = _of(Position, source)
    known: dict[str, Any] = {
        "name": source.name,
        "sigma_km": np.array(error.sigma_km),
        "frame": error.frame,
        "treatment": error.treatment,
    }
    if error.correlation == "white":
        return WhitePosition(**known, telescope=seeing[0])
    if error.correlation == "gauss_markov":
        return GaussMarkovPosition(**known, telescopes=seeing, time_s=error.time or 0.0)
    return ConstantPosition(**known, telescopes=seeing)


def _orbit_error(source: Source, mission: Question, seeing: Seeing) -> Nuisance:
    error = _of(Position, source)
    frame, at = error.frame, _epoch(error, mission)
    if isinstance(error.covariance, str):
        covariance, frame, at = _covariance_of_orbit(source, mission, at)
    elif error.covariance is not None:
        covariance = error.covariance
    else:
        covariance = np.diag(np.square([*error.sigma_km, *error.sigma_km_s]))
    return OrbitError(
        name=source.name,
        telescopes=seeing,
        covariance=covariance,
        frame=frame,
        at_s=at - mission.reference_epoch,
        renewal_s=error.renewal,
        treatment=error.treatment,
    )


def _covariance_of_orbit(source: Source, mission: Question, near: Epoch) -> tuple[Array, Literal["icrf", "rtn"], Epoch]:
    """The covariance in the telescope's OEM file whose epoch is nearest to one asked for, its frame and its epoch."""
    name = source.telescopes[0]
    orbit = mission.carrier(name)
    if not isinstance(orbit, said.OemFile):
        raise TypeError(f"{source.name}: its orbit is not from a file")
    held = read_oem(mission.beside(orbit.file)).covariances
    if not held:
        raise InputError(f"{orbit.file}: has no covariance, and {source.name} asks for it; give sigmas or a matrix")
    found = min(held, key=lambda one: abs(one.epoch - near))
    axes = OEM_AXES.get(found.frame.upper())
    if axes is None:
        known = ", ".join(OEM_AXES)
        raise InputError(f"{orbit.file}: a covariance on the axes {found.frame} cannot be used (allowed: {known})")
    try:
        return checked(found.covariance), axes, found.epoch
    except InputError as error:
        raise InputError(f"{orbit.file}: the covariance of {found.epoch} {error}") from None


def _timing(source: Source, mission: Question, seeing: Seeing) -> Nuisance:
    error = _of(Timing, source)
    return TimingOffset(
        name=source.name,
        telescopes=seeing,
        sigma_s=error.sigma or 0.0,
        mean_s=error.mean,
        treatment=error.treatment,
    )


def _plate_scale(source: Source, mission: Question, seeing: Seeing) -> Nuisance:
    error = _of(PlateScale, source)
    return PlateScaleError(
        name=source.name, telescopes=seeing, sigma=error.sigma, field_rad=error.field, treatment=error.treatment
    )


def _photocentre(source: Source, mission: Question, seeing: Seeing) -> Nuisance:
    error = _of(Photocentre, source)
    return PhotocentreOffset(
        name=source.name,
        telescopes=seeing,
        radius_km=mission.object.photocentre_radius_km,
        sigma_amplitude=error.sigma or 0.0,
        mean_amplitude=error.value,
        treatment=error.treatment,
    )


def _process_noise(source: Source, mission: Question, seeing: Seeing) -> Nuisance:
    error = _of(ProcessNoise, source)
    if not isinstance(mission, Mission):
        raise TypeError(f"{source.name}: of a schedule; that of records is made where their times are known")
    return noise_over(source.name, error, seeing, edges_of(mission, error.intervals))


def _of(kind: type[Kind], source: Source) -> Kind:
    """The block of a source as the kind its group promises."""
    if not isinstance(source.error, kind):
        raise TypeError(f"{source.name}: {source.group} is described by a {type(source.error).__name__}")
    return source.error


NUISANCES: Mapping[tuple[str, str], Callable[[Source, Question, Seeing], Nuisance]] = {
    ("bias", "constant"): _bias,
    ("bias", "drift"): _bias,
    ("bias", "per_arc"): _bias,
    ("bias", "gauss_markov"): _bias,
    ("bias", "per_zone"): _bias,
    ("position", "white"): _position,
    ("position", "constant"): _position,
    ("position", "gauss_markov"): _position,
    ("position", "orbit_error"): _orbit_error,
    ("timing", "constant"): _timing,
    ("plate_scale", "constant"): _plate_scale,
    ("photocentre", "constant"): _photocentre,
    ("process_noise", "constant"): _process_noise,
}
