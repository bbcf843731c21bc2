"""What faintness, trails and the size of the body add to the noise of each exposure, on the reference orbit."""

from dataclasses import replace

import numpy as np

from nebosvod.dynamics import Trajectory
from nebosvod.mission import Mission
from nebosvod.mission.reading.places import asking
from nebosvod.observation import apparent_magnitude
from nebosvod.observation.measurement.direction import angle_between
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.observation.measurement.image_noise import image_covariance
from nebosvod.observation.measurement.sight import lines_of_sight


def imaged(mission: Mission, exposures: Exposures, trajectory: Trajectory) -> Exposures:
    """Exposures with the noise of their images; as they are where no telescope says how it depends on them."""
    magnitude = mission.object.magnitude
    asked = {i: block for i, block in enumerate(mission.telescopes) if block.noise.image is not None}
    if not asked or magnitude is None:
        return exposures
    line = lines_of_sight(trajectory, exposures)
    rate = line.rate(line.sky_partials())
    sun = line.heliocentric_state[:, :3]
    V = apparent_magnitude(
        magnitude.H, magnitude.G, np.linalg.norm(sun, axis=1), line.distance_km, angle_between(-sun, -line.u)
    )
    radius_km = mission.object.photocentre_radius_km if mission.object.has_radiation else 0.0
    image = np.zeros((len(exposures), 2, 2))
    names = [telescope.name for telescope in exposures.telescopes]
    for i, block in asked.items():
        if block.name not in names or block.noise.image is None or block.trailing is None:
            continue
        mine = exposures.telescope_index == names.index(block.name)
        with asking(mission, "telescopes", i, "noise", "image"):
            image[mine] = image_covariance(
                V[mine],
                rate[mine],
                radius_km / line.distance_km[mine],
                exposure_s=block.trailing.exposure,
                fwhm_rad=block.trailing.fwhm,
                magnitude=block.noise.image.magnitude,
                snr=block.noise.image.snr,
                limited_by=block.noise.image.limited_by,
            )
    return replace(exposures, image=image)
