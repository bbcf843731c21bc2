"""The orbit a file gives, as a heliocentric state. Loads the stages; the rest of the room does not."""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import RADIUS_KM
from nebosvod.dynamics.elements import cometary_to_state, equinoctial_to_state, keplerian_to_state
from nebosvod.dynamics.ephemeris import Ephemeris
from nebosvod.dynamics.frames import R_icrf_from_ecliptic
from nebosvod.errors import CoverageError, DataError
from nebosvod.mission.target import Orbit
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]


def orbit_state(orbit: Orbit, gm_sun_km3_s2: float) -> Array:
    """Heliocentric ICRF state (6,) at the epoch of an orbit."""
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


def body_around_start(orbit: Orbit) -> tuple[str, float] | None:
    """The Sun, planet or Moon inside of which an orbit starts, and how far from its centre, km; None if in none.

    Of the ephemeris that is found; one that does not open or reach so far finds none: whoever flies the orbit says why.
    """
    try:
        ephemeris, epoch = Ephemeris.load(), orbit.epoch
        start = orbit_state(orbit, ephemeris.gm_km3_s2["sun"])[:3] + ephemeris.position_km("sun", epoch, 0.0)[0]
        gaps = {body: start - ephemeris.position_km(body, epoch, 0.0)[0] for body in RADIUS_KM}
    except (CoverageError, DataError, OSError):
        return None
    for body, gap in gaps.items():
        distance = float(np.linalg.norm(gap))
        if distance < RADIUS_KM[body] and _below(body, gap, epoch):
            return body, distance
    return None


def _below(body: str, gap_km: Array, epoch: Epoch) -> bool:
    """Whether a place from the centre of a body is below its surface, which loads the compiler."""
    from nebosvod.dynamics.surface import height_km

    return bool(height_km(body, gap_km[None], epoch, np.zeros(1))[0] < 0.0)
