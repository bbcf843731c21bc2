"""An uncertain radius moves the image: the light of a partly lit body lies off its centre by a part of its radius.

The offset is amplitude times radius times a function of the phase. Where the radius is a parameter of the orbit, and
the photocentre has no radius of its own, the offset belongs to the partials by the radius as its light pressure does.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nebosvod.observation import Common, Nuisance, Observation, Photocentre, Term
from nebosvod.scene.declared import Declared, as_assumed
from nebosvod.scene.point import Point
from nebosvod.scene.scene import Scene

M_PER_KM = 1000.0
RADII = ("radius_m", "ln_radius")  # how a radius may be named among the parameters


def at_radius(scene: Scene, point: Point) -> tuple[Nuisance, ...]:
    """The nuisances of a scene, the photocentre with the radius of a point where it is that of the object."""
    name = _radius(scene)
    if name is None:
        return scene.nuisances
    value = point.parameters[name]
    radius_km = (value if name == "radius_m" else math.exp(value)) / M_PER_KM
    return tuple(_of_radius(one, radius_km) for one in scene.nuisances)


def _of_radius(one: Nuisance, radius_km: float) -> Nuisance:
    if isinstance(one, Declared):
        return replace(one, assumed=_of_radius(one.assumed, radius_km), true=_of_radius(one.true, radius_km))
    return replace(one, radius_km=radius_km) if isinstance(one, Photocentre) else one


def moved_by_radius(scene: Scene, point: Point, observation: Observation, terms: Sequence[Term]) -> Observation:
    """The measurements with the offset of the light in their partials by the radius; as they are where it has none.

    Notes
    -----
    The light moves by -d a with d the displacement of the photocentre's term (km for an amplitude of 1) and a the
    amplitude at the point, in proportion to the radius R: by -d a / R for each metre, -d a by the logarithm of R.
    """
    name = _radius(scene)
    if name is None:
        return observation
    light = next(one.name for one in scene.nuisances if isinstance(as_assumed(one), Photocentre))
    term = next(term for term in terms if term.name == light)
    if not isinstance(term, Common) or term.displacement is None:
        return observation
    amplitude = point.nuisances[term.names[0]]
    per_unit = amplitude / (point.parameters[name] if name == "radius_m" else 1.0)
    column = observation.parameter_names.index(name)
    H = np.array(observation.H)
    H[:, :, 6 + column] += per_unit * term.H[:, :, 0]
    zeta = np.array(observation.zeta_emission)
    if len(zeta):  # empty where nothing will be simulated
        zeta[:, :, column] -= per_unit * term.displacement[:, :, 0]
    return replace(observation, H=H, zeta_emission=zeta)


def _radius(scene: Scene) -> str | None:
    """The parameter that is the radius of the photocentre; None where that is known, or there is no photocentre."""
    light = scene.mission.object.photocentre
    if light is None or light.radius is not None:
        return None
    if not any(isinstance(as_assumed(one), Photocentre) for one in scene.nuisances):
        return None
    return next((name for name in scene.forces.parameters if name in RADII), None)
