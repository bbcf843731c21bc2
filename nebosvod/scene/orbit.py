"""An orbit with its covariance by a path or a name: what `orbits` reads, or the prior of a mission."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.mission import Mission, load_mission
from nebosvod.mission.parameter import LOGARITHMS
from nebosvod.mission.reading.builtin import builtin_names
from nebosvod.mission.yaml.yamlfile import shown
from nebosvod.orbits.conversion import balanced_factor
from nebosvod.orbits.reading import KNOWN, read_orbit_file
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.scene.prior import STATE_NAMES, PriorTable, prior_table
from nebosvod.scene.scene import force_model, load_ephemeris, require_epochs, state_at

Array = npt.NDArray[np.float64]
WIDE = 0.1  # of the distance from the Sun: a position known no better
MISSION_NAMES = (".yaml", ".yml")


def read_orbit(path: str | Path) -> UncertainOrbit:
    """Read an orbit with its covariance, told by what is inside.

    Parameters
    ----------
    path : a folder of `nebosvod fit` or `nebosvod run` (the estimate of it), a mission file or the name of a built-in
        mission (what it knows beforehand: its orbit with its prior), an answer of JPL's SBDB (JSON, cov=mat), an orbit
        file of OrbFit or ESA's NEOCC (.ke0, .ke1, .eq0, .fel), mpc_orb.json of the MPC, or an OEM with a covariance.

    Raises
    ------
    InputError
        With file and line, if it cannot be used; of an orbit without covariance says how to give one.
    """
    if not isinstance(path, str | Path):
        raise InputError(f"an orbit is read by a path or the name of a mission (got {type(path).__name__})")
    file = Path(path)
    if isinstance(path, str) and path in builtin_names() and not file.exists():
        return mission_orbit(load_mission(path))
    orbit = read_orbit_file(file)
    if orbit is not None:
        return _cautioned(orbit)
    if file.suffix.lower() not in MISSION_NAMES:
        raise InputError(
            f"{shown(str(path))}: holds no orbit that is read; an orbit is {KNOWN}, or a mission (.yaml); "
            "observations are fitted first: nebosvod fit"
        )
    return mission_orbit(load_mission(file))


def _cautioned(orbit: UncertainOrbit) -> UncertainOrbit:
    """With a notice where the position is known to no small part of the orbit."""
    if orbit.sigma_position_km <= WIDE * float(np.linalg.norm(orbit.state[:3])):
        return orbit
    said = (
        f"the position is known to {orbit.sigma_position_km:.3g} km, no small part of the orbit: its region is not the "
        "ellipsoid that the covariance draws, and no sigma, approach or probability from it is to be believed; begin "
        "with the observations (nebosvod fit, nebosvod alert) or with an epoch amid them"
    )
    return replace(orbit, notices=(*orbit.notices, said))


def mission_orbit(mission: Mission) -> UncertainOrbit:
    """What a mission knows beforehand: its nominal orbit at the reference epoch with its prior.

    The estimate that its measurements would give is that of its run: read the folder of the run.

    Raises
    ------
    InputError
        If it has no prior orbit; if it is a file for `nebosvod fit`.
    """
    name = shown(str(mission.path or mission.name))
    ephemeris = load_ephemeris(mission)
    forces = force_model(mission, ephemeris)
    require_epochs(mission, ephemeris)
    state = state_at(mission.orbit, mission.reference_epoch, forces)
    names, factor = _joint(prior_table(mission, forces, state))
    if names[:6] != STATE_NAMES:
        raise InputError(
            f"{name}: the mission has no prior orbit, so its orbit has no covariance; give it one (prior), or take the "
            f"estimate of a run: nebosvod run {name}, and give the folder it makes"
        )
    magnitude = mission.object.magnitude
    diffuse = [p.name for p in mission.free_parameters if p.name not in names]
    return UncertainOrbit(
        name=mission.object.name,
        epoch=mission.reference_epoch,
        state=state,
        factor=_physical(mission, names, factor),
        parameter_names=tuple(LOGARITHMS.get(one, one) for one in names[6:]),
        radiation=forces.radiation,
        nongrav=forces.nongrav,
        settings=forces.settings,
        magnitude=None if magnitude is None else (magnitude.H, magnitude.G),
        origin=f"{name} (a mission: its prior)",
        notices=(f"{name}: {', '.join(diffuse)} without a prior: taken as known",) if diffuse else (),
    )


def _joint(table: PriorTable) -> tuple[tuple[str, ...], Array]:
    """Names, the state first, and a factor of the joint covariance of all priors."""
    entries = sorted(table.entries, key=lambda entry: entry[1][:6] != STATE_NAMES)
    names = tuple(name for entry in entries for name in entry[1])
    factor, start = np.zeros((len(names), len(names))), 0
    for entry in entries:
        stop = start + len(entry[1])
        factor[start:stop, start:stop] = _lower(entry[3])
        start = stop
    return names, factor


def _lower(covariance: Array) -> Array:
    """Lower factor of a covariance whose scales differ by many orders of magnitude."""
    sigma = np.sqrt(np.diag(covariance))
    lower: Array = sigma[:, None] * np.linalg.cholesky(covariance / sigma[:, None] / sigma)
    return lower


def _physical(mission: Mission, names: tuple[str, ...], factor: Array) -> Array:
    """The factor with rows of logarithms as those of their quantities, to first order: dR = R d ln R."""
    value = dict(parameter.quantity for parameter in mission.parameters)
    unit = np.array([value[LOGARITHMS[name]] if name in LOGARITHMS else 1.0 for name in names])
    return balanced_factor(unit[:, None] * factor)
