"""From a rough orbit of a few days to one that fits the whole arc: the arc grows around where the orbit is known.

A start from three directions may be off by degrees a year later, where no correction finds back. So the observations
near its own time are fitted first, and the span about it is widened by a factor until it holds them all.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel
from nebosvod.estimation import Status
from nebosvod.estimation.solvers.rejection import Thresholds
from nebosvod.fits.correction import Knowledge
from nebosvod.fits.selection import Selected, attempted, select
from nebosvod.observation.measurement.exposures import Sky

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
WIDER = 2.5  # each span against the one before
FIRST_S = 3.0 * 86400.0  # half of the least span fitted first
LEAST = 6  # observations fitted first, where there are so many
AT_ONCE = 0.02  # rad, rms: an orbit that is this near on the whole arc needs no growth


def grow(
    sky: Sky,
    x: Array,
    forces: ForceModel,
    thresholds: Thresholds | None,
    *,
    prior: Knowledge | None = None,
    half_s: float = FIRST_S,
) -> Selected:
    """Fit the observations about the epoch of the sky first, then ever more of them, at last all.

    Parameters
    ----------
    sky : counted from the epoch of the rough orbit.
    x : shape (6 + m,), that orbit.
    half_s : half of the span over which it is known to fit.

    Raises
    ------
    EventError, CoverageError, InputError
        If not even the observations nearest to its epoch can be reached.
    """
    distance = np.abs(sky.t_s)
    half = max(half_s, float(np.sort(distance)[min(LEAST, len(sky)) - 1]))
    last: Selected | None = None
    inside = distance <= half
    while True:
        found = attempted(sky.select(inside), x, forces, thresholds, prior)
        if found is not None and found.correction.status is Status.NOT_OBSERVABLE:
            found = None  # the orbit before it is kept
        if found is not None:
            last, x = found, found.correction.x
        if inside.all():
            break
        half = max(WIDER * half, float(distance[~inside].min()))
        inside = distance <= half
    if last is None or found is None:
        return select(sky, x, forces, thresholds, prior=prior)
    return last
