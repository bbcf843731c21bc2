"""The drawn orbits that tell most of a virtual impactor: its own weighed ones where there are, else the plain draws."""

from collections.abc import Mapping
from typing import Any

import numpy.typing as npt

Arrays = Mapping[str, npt.NDArray[Any]]
OF_ALL = ("weights", "hit_body", "hit_t_s", "longitude_deg", "latitude_deg", "speed_km_s", "elevation_deg")
OF_ONE = ("hits", "grazes", "xi_zeta_km")


def draws_of(number: int, arrays: Arrays) -> dict[str, npt.NDArray[Any]]:
    """Arrays by names without the number; those that a folder does not have are absent."""
    own = f"weighed_{number}_"
    if f"{own}weights" in arrays:
        return {name: arrays[f"{own}{name}"] for name in (*OF_ALL, *OF_ONE) if f"{own}{name}" in arrays}
    return {name: arrays[name] for name in OF_ALL if name in arrays} | {
        name: arrays[f"{name}_{number}"] for name in OF_ONE if f"{name}_{number}" in arrays
    }
