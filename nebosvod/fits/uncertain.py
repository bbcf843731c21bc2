"""The orbit of a fit with its covariance, as what comes next reads it from the folder of the fit."""

import numpy as np

from nebosvod.fits.engine import OrbitFit
from nebosvod.orbits.conversion import balanced_factor
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.scene.prior import STATE_NAMES


def orbit_of(found: OrbitFit) -> UncertainOrbit:
    """State and uncertain parameters of the forces at the epoch of a fit, with the true covariance and its sources.

    Raises
    ------
    InputError
        If the fit has no covariance.
    """
    fit = found.general.fit
    known = {*fit.estimate.names, *fit.estimate.left_out}
    names = tuple(p.name for p in found.mission.free_parameters if p.name in known)
    forces = found.general.scene.forces.with_values(fit.point.parameters)
    joint = fit.estimate.predict(np.eye(6 + len(names)), (*STATE_NAMES, *names))
    return UncertainOrbit(
        name=found.mission.object.name,
        epoch=found.epoch,
        state=fit.point.state,
        factor=balanced_factor(joint.factor),
        parameter_names=names,
        radiation=forces.radiation,
        nongrav=forces.nongrav,
        settings=forces.settings,
        sources=joint.factors,
        origin=f"a fit of {len(fit.observation.t_s)} observations",
    )
