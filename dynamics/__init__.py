"""Dynamics: the trajectory X(t), its transition matrix Phi(t, t0) and its parameter sensitivities zeta(t, t0).

The names below load their module when first used, so that constants and the ephemeris do not pull in the compiler.
"""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nebosvod.dynamics.clones import Clones, propagate_many
    from nebosvod.dynamics.encounter import Encounter, TargetPlane, find_encounters, perigee_distance, target_plane
    from nebosvod.dynamics.ephemeris import Ephemeris
    from nebosvod.dynamics.fates import Fates
    from nebosvod.dynamics.model import ForceModel
    from nebosvod.dynamics.nongrav import Nongrav
    from nebosvod.dynamics.propagator import propagate
    from nebosvod.dynamics.radiation import RadiationPressure
    from nebosvod.dynamics.trajectory import Trajectory

__all__ = [
    "Clones",
    "Encounter",
    "Ephemeris",
    "Fates",
    "ForceModel",
    "Nongrav",
    "RadiationPressure",
    "TargetPlane",
    "Trajectory",
    "find_encounters",
    "perigee_distance",
    "propagate",
    "propagate_many",
    "target_plane",
]

_HOME = {
    "Clones": "clones",
    "Encounter": "encounter",
    "Ephemeris": "ephemeris",
    "Fates": "fates",
    "ForceModel": "model",
    "Nongrav": "nongrav",
    "RadiationPressure": "radiation",
    "TargetPlane": "encounter",
    "Trajectory": "trajectory",
    "find_encounters": "encounter",
    "perigee_distance": "encounter",
    "propagate": "propagator",
    "propagate_many": "clones",
    "target_plane": "encounter",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"nebosvod.dynamics.{_HOME[name]}"), name)
    raise AttributeError(f"module 'nebosvod.dynamics' has no attribute {name!r}")


def __dir__() -> list[str]:
    """What tab completion shows: the public names, loaded or not yet, and the modules in use."""
    mine = (name for name, value in globals().items() if name.startswith("__") or isinstance(value, ModuleType))
    return sorted({*__all__, *mine})
