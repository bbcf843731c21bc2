"""CCSDS Orbit Ephemeris Messages with a covariance: the state and the covariance where it is best known."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.errors import CoverageError, DataError, InputError
from nebosvod.observation.spacecraft.oem import FRAMES, Oem, OemCovariance, read_oem
from nebosvod.observation.spacecraft.tabulated import BARYCENTRE, Segment
from nebosvod.orbits.conversion import Given, factor_of
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
GRAIN_S = 1e-4  # within which an epoch is that of a state: 3 m
LOCAL = ("RTN", "RSW", "RIC")


def read_oem_orbit(path: Path) -> Given:
    """The orbit of a message at the epoch of its smallest covariance of position.

    Raises
    ------
    InputError
        If it is no message, has no covariance, or one of axes that are not read.
    """
    try:
        message = read_oem(path)
    except DataError as error:
        raise InputError(str(error)) from None
    if not message.covariances:
        raise InputError(
            f"{path.name}: has no covariance (COVARIANCE_START ... COVARIANCE_STOP); ask who made it for one, or fit "
            "the orbit from its observations: nebosvod fit"
        )
    best, state, relative = _best(message, path.name)
    factor, notices = factor_of(best.covariance, f"{path.name}: the covariance at {best.epoch.iso(digits=0)}")
    return Given(
        name=message.object_name,
        epoch=best.epoch,
        kind="state",
        values=state,
        factor=_axes(best, relative, path.name) @ factor,
        gm_km3_s2=float("nan"),  # a state needs none
        frame="icrf",
        notices=notices,
    )


def _best(message: Oem, name: str) -> tuple[OemCovariance, Array, Array]:
    """The smallest covariance of position at whose epoch there is a state; that state, heliocentric and as written."""
    ephemeris, reason = Ephemeris.load(), ""
    for one in sorted(message.covariances, key=lambda one: float(np.trace(one.covariance[:3, :3]))):
        try:
            return one, *_states(message, one.epoch, ephemeris)
        except (CoverageError, DataError) as error:
            reason = reason or str(error)
    raise InputError(f"{name}: no state at the epoch of a covariance: {reason}")


def _states(message: Oem, epoch: Epoch, ephemeris: Ephemeris) -> tuple[Array, Array]:
    """Heliocentric state (6,), and that relative to the centre of the message; of a state written there, as it is."""
    orbit, now = message.orbit, np.zeros(1)
    written = _written(message, epoch)
    centre = np.zeros(6) if orbit.origin == BARYCENTRE else ephemeris.state_km_km_s(orbit.origin, epoch, now)[0]
    relative = written if written is not None else orbit.state_km_km_s(ephemeris, epoch, now)[0] - centre
    return relative + centre - ephemeris.state_km_km_s("sun", epoch, now)[0], relative


def _written(message: Oem, epoch: Epoch) -> Array | None:
    """The state (6,) that stands in the message at an epoch, also outside of the span it calls usable."""
    if message.orbit.origins:
        return None
    t = epoch - message.orbit.epoch
    for segment in message.orbit.segments:
        k = int(np.argmin(np.abs(segment.t_s - t))) if isinstance(segment, Segment) else -1
        if isinstance(segment, Segment) and abs(segment.t_s[k] - t) < GRAIN_S:
            return np.asarray(segment.states[k])
    return None


def _axes(covariance: OemCovariance, relative: Array, name: str) -> Array:
    """ICRF from the axes of the covariance, (6, 6)."""
    frame = covariance.frame.upper()
    if frame in FRAMES:
        return np.eye(6)
    if frame not in LOCAL:
        allowed = ", ".join((*FRAMES, *LOCAL))
        raise InputError(f"{name}: COV_REF_FRAME {covariance.frame}: one of {allowed} is read")
    radial = relative[:3] / np.linalg.norm(relative[:3])
    normal = np.cross(relative[:3], relative[3:])
    normal /= np.linalg.norm(normal)
    rotation = np.stack([radial, np.cross(normal, radial), normal], axis=1)
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = rotation
    return both
