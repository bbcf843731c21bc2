"""What an A2 of the usual size would do to predictions years past the arc of a fit that holds it at zero.

Sunlight that is radiated off in the afternoon (Yarkovsky) moves a small body along its orbit by the square of the time.
A fit of a few years may not see it and a prediction decades ahead may rest on it.

References
----------
Chesley et al. 2014, Icarus 235, 5: (101955) Bennu, 0.49 km, da/dt = -19.0e-4 au/Myr, which is A2 = -4.6e-14 au/d^2.
Farnocchia et al. 2013, Icarus 224, 1: the drift goes as 1/D.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel, Nongrav
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.quantity import Quantity
from nebosvod.errors import NebosvodError
from nebosvod.findings.prediction import Answered
from nebosvod.fits.engine import OrbitFit
from nebosvod.observation.measurement.photometry import apparent_magnitude
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.scene.recorded import long_trajectory
from nebosvod.scene.scene import Scene
from nebosvod.timescale import SECONDS_PER_DAY

Array = npt.NDArray[np.float64]
NAME = "a2_au_d2"
A2_KM_AU_D2 = 4.6e-14 * 0.49  # A2 times diameter, of Bennu: that of a body which spins upright
YEARS = 2.0  # beyond the arc
ALBEDO, G = 0.14, 0.15  # of an asteroid nobody has measured
SMALL = 0.1  # of a sigma: not worth a caution


def cautions(found: OrbitFit, scene: Scene, predictions: Sequence[Answered]) -> list[str]:
    """A sentence for each prediction that such an A2 would move.

    Parameters
    ----------
    scene : of the answer.
    """
    t_s = found.general.fit.observation.t_s
    force = next((one for one in found.found.forces if one.name == NAME), None)
    far = [one for one in predictions if _years(one.quantity, found, t_s) >= YEARS]
    if force is None or not far:
        return []
    size_km, how = diameter_km(found)
    a2 = A2_KM_AU_D2 / size_km
    model = _with_a2(scene.forces)
    try:
        span = (float(t_s.min()), float(t_s.max()))
        trajectory = long_trajectory(found.mission, found.general.fit.point.state, model, span)
        moved = [quantity(replace(scene, trajectory=trajectory, forces=model), trajectory, one.request) for one in far]
    except NebosvodError:
        return []
    said = []
    for one, there in zip(far, moved):
        column = there.names.index(NAME)
        state = [there.names.index(name) for name in STATE_NAMES]
        shift = a2 * float(np.linalg.norm(there.partials[:, column] - there.partials[:, state] @ force.pull[:6]))
        known = float(one.semi_axes[0])
        if not known or shift < SMALL * known:
            continue
        unit = {"m_s": "m/s", "1": ""}.get(one.quantity.unit, one.quantity.unit)
        said.append(
            f"{one.request.name} lies {_years(one.quantity, found, t_s):.3g} years past the arc and A2 is held at 0: "
            f"one of the usual size, {a2:.2g} au/d^2 for a diameter of {size_km:.2g} km ({how}), would move it by "
            f"{shift:.2g} {unit}, {shift / known:.2g} of its sigmas; give object.nongrav.A2 with that sigma"
        )
    return said


def diameter_km(found: OrbitFit) -> tuple[float, str]:
    """The diameter as given, else by the magnitudes that the records state, else one kilometre; and how it is known."""
    target = found.mission.object
    radius = next((p.value for p in target.parameters if p.name == "radius_m"), None)
    if radius is not None:
        return 2e-3 * radius, "as given"
    absolute = target.magnitude.H if target.magnitude is not None else _absolute(found)
    if absolute is None:
        return 1.0, "no magnitude is known"
    return 1329.0 / np.sqrt(ALBEDO) * 10.0 ** (-absolute / 5.0), f"H {absolute:.1f}, albedo {ALBEDO:g}"


def _absolute(found: OrbitFit) -> float | None:
    """The absolute magnitude by the median of the stated ones; None where no record states any."""
    magnitude, seen = found.material.astrometry.magnitude, found.general.seen
    stated = np.isfinite(magnitude)
    if not stated.any():
        return None
    sight = seen.target_state[stated, :3] - seen.telescope_state[stated, :3]
    sun = found.material.exposures.sun[stated, :3]
    helio = seen.target_state[stated, :3] - sun
    r, distance = np.linalg.norm(helio, axis=1), np.linalg.norm(sight, axis=1)
    phase = np.arccos(np.clip(np.einsum("ni,ni->n", helio, sight) / (r * distance), -1.0, 1.0))
    at_zero = apparent_magnitude(0.0, G, r, distance, phase)
    value = float(np.median(magnitude[stated] - at_zero))
    return value if np.isfinite(value) else None


def _years(one: Quantity, found: OrbitFit, t_s: Array) -> float:
    """How many years a prediction lies outside the arc."""
    when = one.epoch - found.epoch
    return max(when - float(t_s.max()), float(t_s.min()) - when) / (365.25 * SECONDS_PER_DAY)


def _with_a2(forces: ForceModel) -> ForceModel:
    """The same forces with a column for A2 at zero."""
    return replace(forces, nongrav=forces.nongrav or Nongrav(), parameters=(*forces.parameters, NAME))
