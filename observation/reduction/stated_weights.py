"""Weights that came with the records and are final, such as OrbFit's: no rule, floor or thinning touches them."""

from dataclasses import replace

import numpy as np

from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.reduction.weights import Weights

RULE = "weight of the file"


def kept(found: Weights, astrometry: Astrometry) -> Weights:
    """The same weights, but those that the records state as final as they stand."""
    mine = astrometry.weighed
    if not mine.any():
        return found
    return replace(
        found,
        sigma_rad=np.where(mine[:, None], astrometry.sigma_rad, found.sigma_rad),
        correlation=np.where(mine, astrometry.correlation, found.correlation),
        rule=np.where(mine, RULE, found.rule),
        thinning=np.where(mine, 1.0, found.thinning),
    )
