"""The drawn orbits that tell most of a virtual impactor: its own weighed ones where there are, else the plain draws."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

Arrays = Mapping[str, npt.NDArray[Any]]
ENOUGH = 200  # plain draws that hit, to be seen as what they are
OF_ALL = ("weights", "hit_body", "hit_t_s", "longitude_deg", "latitude_deg", "speed_km_s", "elevation_deg")
OF_ONE = ("hits", "grazes", "xi_zeta_km")


def is_weighed(number: int, arrays: Arrays) -> bool:
    """Whether a virtual impactor is shown by draws of its own: where it has some, and plain ones seldom hit."""
    plain = arrays.get(f"hits_{number}")
    return f"weighed_{number}_weights" in arrays and (plain is None or int(np.count_nonzero(plain)) < ENOUGH)


def draws_of(number: int, arrays: Arrays) -> dict[str, npt.NDArray[Any]]:
    """Arrays by names without the number; those that a folder does not have are absent."""
    own = f"weighed_{number}_"
    if is_weighed(number, arrays):
        return {name: arrays[f"{own}{name}"] for name in (*OF_ALL, *OF_ONE) if f"{own}{name}" in arrays}
    return {name: arrays[name] for name in OF_ALL if name in arrays} | {
        name: arrays[f"{name}_{number}"] for name in OF_ONE if f"{name}_{number}" in arrays
    }
