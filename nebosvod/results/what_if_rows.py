"""The block `what_if` of a summary: sources with their sizes as the mission says them, and what may be changed."""

from typing import Any

from nebosvod.findings.what_if import WhatIf
from nebosvod.mission import Mission
from nebosvod.mission.bias import Bias
from nebosvod.mission.position import Position
from nebosvod.mission.uncertainty import Timing
from nebosvod.units import ARCSEC

UNITS = {"radius_m": "m", "mass_kg": "kg", "density_kg_m3": "kg/m^3", "albedo": "", "thermal_emission": ""}


def what_if_block(found: WhatIf | None, mission: Mission) -> dict[str, Any]:
    """The block, or nothing where there is nothing to ask."""
    if found is None:
        return {}
    sizes = _sizes(mission)
    return {
        "what_if": {
            "estimator": found.estimator,
            "reason": found.reason or None,
            "parameters": list(found.parameters),
            "blocks": [dict(block) for block in found.blocks],
            "sources": [{**source, "size": sizes.get(source["name"])} for source in found.sources],
            "predictions": list(found.predictions),
        }
    }


def _sizes(mission: Mission) -> dict[str, dict[str, Any]]:
    """Sigma and unit of every source that one number describes."""
    found: dict[str, tuple[float, str] | None] = {}
    for telescope in mission.telescopes:
        noise = telescope.noise
        ra, dec = noise.sigma_rad
        alone = ra == dec and not noise.timing and noise.image is None
        found[f"measurement noise {telescope.name}"] = (ra / ARCSEC, "arcsec") if alone else None
    for source in mission.sources:
        found[source.name] = _size(source.error)
    for parameter in mission.free_parameters:
        if parameter.sigma is not None:
            unit = UNITS.get(parameter.name, "au/d^2" if parameter.name.endswith("au_d2") else "")
            found[parameter.group] = found[parameter.name] = (parameter.sigma, unit)
    return {name: {"sigma": size[0], "unit": size[1]} for name, size in found.items() if size is not None}


def _size(error: object) -> tuple[float, str] | None:
    """The one sigma of a source; None where it has several."""
    if isinstance(error, Bias):
        pair = error.sigma_rad
        alone = pair is not None and pair[0] == pair[1] and len(error.sizes) == 1
        return (pair[0] / ARCSEC, "arcsec") if pair is not None and alone else None
    if isinstance(error, Position):
        alone = len(error.sizes) == 1 and error.covariance is None and len(set(error.sigma_km)) == 1
        return (error.sigma_km[0], "km") if alone else None
    if isinstance(error, Timing) and error.sigma is not None and len(error.sizes) == 1:
        return error.sigma, "s"
    return None
