"""Write a trajectory as a CCSDS Orbit Ephemeris Message (OEM 2.0, KVN; CCSDS 502.0-B-2), with covariance.

Times are TDB, states heliocentric ICRF in km and km/s, covariances in km^2, km^2/s, km^2/s^2, as the standard has it.
`nebosvod.observation.spacecraft.oem.read_oem` reads it back.
"""

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from nebosvod.borders.wholefile import write_whole
from nebosvod.errors import InputError
from nebosvod.timescale import Epoch

if TYPE_CHECKING:  # it imports this file where it is asked to write
    from nebosvod.dynamics.trajectory import Trajectory

Array = npt.NDArray[np.float64]
_CREATED = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}(\.[0-9]+)?")
# Asymmetry and negative eigenvalues of the correlations below this are the rounding of a matrix kept to ten digits
ROUNDING = 1e-9


def write_oem(
    trajectory: "Trajectory",
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
    object_name, object_id, originator : one line of printable ASCII each, not empty.
    created : creation date in UTC, `2026-01-31T12:00:00`: the clock is the caller's.
    covariance : shape (6, 6), of the state at the trajectory's epoch; carried to every time by Phi, or None.

    Raises
    ------
    InputError, OutputError
        If the times do not ascend, a text is not one line or the date none, or the covariance is not finite, symmetric
        and positive semidefinite of shape (6, 6); if the file cannot be written.
    """
    if not len(trajectory.t_s) or (np.diff(trajectory.t_s) <= 0.0).any():
        raise InputError("OEM: times must ascend strictly, and there must be one")
    _require_texts({"object_name": object_name, "object_id": object_id, "originator": originator}, created)
    if covariance is not None:
        covariance = _checked(covariance)
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
    write_whole(path, ("\n".join(lines) + "\n").encode("ascii"))


def _require_texts(lines: dict[str, str], created: str) -> None:
    """Refuse what would break the lines of the file: it is one keyword and one value a line."""
    for name, text in lines.items():
        if not (text.isascii() and text.isprintable() and text.strip()):
            raise InputError(f"OEM: {name} {text!r} is not allowed (one line of printable ASCII, not empty)")
    allowed = "a date in UTC like 2026-01-31T12:00:00"
    if not _CREATED.fullmatch(created):
        raise InputError(f"OEM: created {created!r} is not allowed ({allowed})")
    try:
        Epoch.parse(f"{created} UTC")
    except InputError as error:
        raise InputError(f"OEM: created {created!r} is not allowed ({allowed}): {error}") from None


def _checked(covariance: npt.ArrayLike) -> Array:
    """The covariance (6, 6) as an array, refused if it is none; never repaired."""
    matrix = np.asarray(covariance, dtype=np.float64)
    if matrix.shape != (6, 6):
        raise InputError(f"OEM: the covariance needs shape (6, 6), got {matrix.shape}")
    if not np.isfinite(matrix).all():
        i, j = np.argwhere(~np.isfinite(matrix))[0]
        raise InputError(f"OEM: the covariance needs finite numbers, got {matrix[i, j]} in row {i}, column {j}")
    variances = np.diag(matrix)
    if (variances < 0.0).any():
        raise InputError(f"OEM: the covariance needs variances of 0 or more, got {variances.min():.6g}")
    # Correlations have no units, so that km^2 and km^2/s^2 may stand in one test
    unit = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    correlation = matrix / unit[:, None] / unit[None, :]
    gap = np.abs(correlation - correlation.T)
    if gap.max() > ROUNDING:
        i, j = np.unravel_index(int(gap.argmax()), gap.shape)
        raise InputError(
            f"OEM: the covariance must be symmetric, got {matrix[i, j]:.9g} in row {i}, column {j} and "
            f"{matrix[j, i]:.9g} in row {j}, column {i}"
        )
    smallest = float(np.linalg.eigvalsh(correlation)[0])
    if smallest < -ROUNDING:
        raise InputError(
            "OEM: the covariance must be positive semidefinite, got a smallest eigenvalue of the correlations of "
            f"{smallest:.6g}; give one that is, it is never repaired"
        )
    return matrix


def _stamp(epoch: Epoch) -> str:
    """Calendar time with nanoseconds, without the name of the scale."""
    return epoch.iso(digits=9).removesuffix(" TDB")
