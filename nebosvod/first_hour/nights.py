"""Records of another night beside a tracklet: an orbit of all is sought among those that fit the tracklet.

Between two nights an object may pass the Earth. Then the directions of all of them lie on no curve that an orbit could
be begun from, and at most ranges no range rate leads to the other night at all. But the tracklet about the reference
time has a posterior of its own, and its orbits come near what was seen in the other night: least squares with nothing
held goes on from the nearest.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from nebosvod.errors import GeometryError
from nebosvod.first_hour.conditional import Conditional
from nebosvod.first_hour.grid import HEADLINE, Grid, grid_of
from nebosvod.first_hour.region import Region
from nebosvod.first_hour.tracklet import Tracklet

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
FAR_AWAY = 8.0  # times as far from the reference time as the records about it: those of another night
CLOSE_S = 60.0  # records nearer than this are of one time
LEAST = 3  # records about the reference time, of which there are orbits
DEEP = 12.0  # below the largest mass of the tracklet's nodes, in logs, where none is tried
TRIED = 12  # orbits of the tracklet that least squares begins at
POOR = 12.0  # chi squared for each record, above which a better orbit is sought


def grid_of_all(conditional: Conditional, region: Region) -> Grid:
    """The posterior of range and range rate of records of one night or more.

    Raises
    ------
    GeometryError
        If no orbit of the region can be followed over the measurements.
    """
    found, none = None, None
    try:
        found = grid_of(conditional, region)
    except GeometryError as error:
        none = error
    if found is not None and found.best_chi2 < POOR * len(conditional.tracklet):
        return found
    orbit = orbit_of_nights(conditional, region)
    if orbit is not None:
        known = conditional.solve(orbit, 0)
        if found is None or known.chi2[0] < found.best_chi2 - 1.0:
            return grid_of(conditional, region, known)
    if found is None:
        raise none or GeometryError(conditional.tracklet.name)
    return found


def orbit_of_nights(conditional: Conditional, region: Region) -> Array | None:
    """Coordinates (1, 6) of the best orbit that is found from those of the records about the reference time.

    None where the other records are not far from them, or no orbit comes near what they saw.
    """
    tracklet = conditional.tracklet
    rows = about_the_reference(tracklet)
    if len(rows) == len(tracklet):
        return None
    try:
        near = grid_of(Conditional(_part(tracklet, rows)), region)
    except GeometryError:
        return None
    log = near.log_mass[HEADLINE]
    nodes = near.nodes.coordinates[log > log.max() - DEEP]
    misses = conditional.misses(nodes)
    chosen = np.argsort(misses, kind="stable")[:TRIED]
    chosen = chosen[np.isfinite(misses[chosen])]
    if not chosen.size:
        return None
    found = conditional.solve(nodes[chosen], 0)
    low, high = replace(region, bound=False).rates(conditional, found.coordinates)
    within = (found.coordinates[:, 1] >= low) & (found.coordinates[:, 1] <= high) & region.allows(found.above_km)
    chi2 = np.where(within, found.chi2, np.inf)
    best = int(np.argmin(chi2))
    return found.coordinates[best : best + 1] if np.isfinite(chi2[best]) else None


def about_the_reference(tracklet: Tracklet) -> Rows:
    """Rows of the records about the reference time that the others are many times as far from; all without such."""
    away = np.maximum(np.abs(tracklet.exposures.t_s), CLOSE_S)
    order = np.argsort(away, kind="stable")
    steps = away[order]
    far = np.flatnonzero(steps[LEAST:] > FAR_AWAY * steps[LEAST - 1 : -1])
    rows: Rows = np.sort(order[: LEAST + int(far[0])] if far.size else order)
    return rows


def _part(tracklet: Tracklet, rows: Rows) -> Tracklet:
    """Some of the records, the reference among them, which stays."""
    return replace(
        tracklet, exposures=tracklet.exposures.select(rows), observed=tracklet.observed[rows],
        columns=tracklet.columns.select(rows), reference=int(np.flatnonzero(rows == tracklet.reference)[0]), left=0.0,
    )  # fmt: skip
