"""The orbit a mission gives, as a heliocentric state. Loads the stages; the rest of the room does not."""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.elements import cometary_to_state, equinoctial_to_state, keplerian_to_state
from nebosvod.dynamics.frames import R_icrf_from_ecliptic
from nebosvod.mission.model import Mission

Array = npt.NDArray[np.float64]


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
