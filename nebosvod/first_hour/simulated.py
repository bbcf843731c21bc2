"""The measurements of a simulated mission as a tracklet, with what was true."""

from collections.abc import Sequence

import numpy as np

from nebosvod.engine.truth import Truth
from nebosvod.first_hour.conditional import Conditional
from nebosvod.first_hour.region import faintness
from nebosvod.first_hour.tracklet import Columns, Tracklet
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.direction import angle_between
from nebosvod.scene.scene import PlannedScene


def simulated(scene: PlannedScene, truth: Truth, by: Sequence[str] = ()) -> tuple[Tracklet, dict[str, float]]:
    """The tracklet of what was measured of a drawn truth, and its true range and range rate at the reference time.

    Parameters
    ----------
    by : the telescopes whose measurements count; all where empty.

    Raises
    ------
    InputError
        If a telescope made none.

    Notes
    -----
    The magnitude is that of the truth, as far as the mission knows H: it limits the sizes that count.
    """
    seen = compute(scene.trajectory, scene.exposures)
    columns = Columns.of(scene.nuisances, seen, scene.ephemeris)
    mission = scene.mission
    rows = scene.exposures.rows(by) if by else np.arange(len(scene.exposures))
    tracklet = Tracklet.of(mission.object.name, scene.exposures, truth.psi, scene.forces, columns).select(rows)
    forces = scene.forces
    at = np.array([tracklet.epoch - scene.epoch])
    state = scene.propagate(truth.point.state, forces).state_at(at)
    x = Conditional(tracklet).coordinates(state)[0]
    magnitude = None
    if mission.object.magnitude is not None:
        r, away = state[0, :3], state[0, :3] - tracklet.place[:3]
        phase = angle_between(-r[None], -away[None])
        H = mission.object.magnitude.H
        lengths = np.array([np.linalg.norm(r)]), np.array([np.linalg.norm(away)])
        magnitude = H + float(faintness(*lengths, phase)[0])
    made = Tracklet.of(mission.object.name, scene.exposures, truth.psi, scene.forces, columns, magnitude)
    made = made.select(rows)
    return made, {"range_au": float(np.exp(x[0])), "rate_km_s": float(x[1])}
