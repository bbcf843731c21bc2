"""Write a trajectory as a CCSDS Orbit Ephemeris Message (OEM 2.0, KVN; CCSDS 502.0-B-2), with covariance.

Times are TDB, states heliocentric ICRF in km and km/s, covariances in km^2, km^2/s, km^2/s^2, as the standard has it.
`nebosvod.observation.oem.read_oem` reads it back.
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.trajectory import Trajectory
from nebosvod.errors import InputError, OutputError
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]


def write_oem(
    trajectory: Trajectory,
    path: Path,
    *,
    object_name: str,
    object_id: str,
    created: str,
    originator: str = "NEBOSVOD",
    covariance: Array | None = None,
) -> None:
    """Write the trajectory at its own times.

    Parameters
    ----------
    trajectory : its `t_s` must ascend.
    created : creation date in UTC, `2026-01-31T12:00:00`: the clock is the caller's.
    covariance : shape (6, 6), of the state at the trajectory's epoch; carried to every time by Phi, or None.

    Raises
    ------
    InputError, OutputError
        If the times do not ascend or the covariance has a wrong shape; if the file cannot be written.
    """
    if (np.diff(trajectory.t_s) <= 0.0).any():
        raise InputError("OEM: times must ascend strictly")
    if covariance is not None and np.shape(covariance) != (6, 6):
        raise InputError(f"OEM: the covariance needs shape (6, 6), got {np.shape(covariance)}")
    stamps = [_stamp(trajectory.epoch + float(t)) for t in trajectory.t_s]
    lines = ["CCSDS_OEM_VERS = 2.0", f"CREATION_DATE = {created}", f"ORIGINATOR = {originator}", "", "META_START"]
    lines += [f"OBJECT_NAME = {object_name}", f"OBJECT_ID = {object_id}", "CENTER_NAME = SUN", "REF_FRAME = ICRF"]
    lines += ["TIME_SYSTEM = TDB", f"START_TIME = {stamps[0]}", f"STOP_TIME = {stamps[-1]}", "META_STOP", ""]
    for stamp, state in zip(stamps, trajectory.state):
        lines.append(stamp + "".join(f" {value:.16e}" for value in state))
    if covariance is not None:
        lines += ["", "COVARIANCE_START"]
        for stamp, Phi in zip(stamps, trajectory.Phi):
            carried = Phi @ covariance @ Phi.T
            lines += [f"EPOCH = {stamp}", "COV_REF_FRAME = ICRF"]
            lines += [" ".join(f"{carried[i, j]:.16e}" for j in range(i + 1)) for i in range(6)]
        lines += ["COVARIANCE_STOP"]
    try:
        path.write_text("\n".join(lines) + "\n", encoding="ascii")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from None
    except UnicodeEncodeError:
        raise InputError(f"OEM: object name and id must be ASCII, got {object_name!r}, {object_id!r}") from None


def _stamp(epoch: Epoch) -> str:
    """Calendar time with nanoseconds, without the name of the scale."""
    return epoch.iso(digits=9).removesuffix(" TDB")
