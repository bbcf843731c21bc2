"""Whether an arc tells how far the object is: an ellipse as long as the distance itself is no answer."""

import numpy as np

from nebosvod.engine.fitting import Fit
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.scene.scene import Scene
from nebosvod.units import AU_KM

KNOWN = 0.3  # sigma of the distance over the distance, beyond which the arc does not tell how far the object is


def unknown_distance(scene: Scene, fit: Fit) -> str:
    """What an arc leaves open, as half a sentence ("1.2 +- 0.9 au from the observer"); empty where it is known.

    The distance is that from the observer of the measurement nearest to the reference epoch, its sigma that of the
    estimate's true covariance along the line of sight.
    """
    estimate, seen = fit.estimate, fit.observation
    if estimate.solution is None or not seen.t_s.size:
        return ""
    place = int(np.argmin(np.abs(seen.t_s)))
    when = np.array([seen.t_s[place]])
    sun = scene.ephemeris.position_km("sun", scene.epoch, when)[0]
    at = fit.trajectory.at(when)
    line = at.state[0, :3] + sun - seen.telescope_state[place, :3]
    distance = float(np.linalg.norm(line))
    sigma = float(np.linalg.norm((line / distance) @ at.Phi[0, :3] @ estimate.factor(STATE_NAMES)))
    if sigma <= KNOWN * distance:
        return ""
    return f"{distance / AU_KM:.3g} +- {sigma / AU_KM:.2g} au from the observer"
