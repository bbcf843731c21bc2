"""Write a trajectory as an SPK file (NAIF DAF/SPK, type 3) that jplephem and SPICE read.

The span is halved until Chebyshev series of 16 coefficients hold position and velocity; neighbours of equal length form
one segment. Type 3 keeps a series of its own for the velocity: the derivative of a position series over the minutes of
an encounter would amplify the rounding of 1e8 km to 0.4 mm/s. Centre: Sun (10); frame: ICRF axes (J2000, 1).

A segment of type 3 has records of one length, so a file has many segments, 52 for ten years with an encounter. SPICE
finds the right one; of jplephem `kernel[10, target]` gives only the last: choose the one of `kernel.segments` whose
`start_jd` and `end_jd` hold the time (docs/propagation.md).
"""

import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
from jplephem.daf import DAF

from nebosvod.dynamics.constants import DAY_S, J2000_JD
from nebosvod.dynamics.trajectory import Trajectory
from nebosvod.errors import InputError, OutputError

Array = npt.NDArray[np.float64]
COEFFICIENTS = 16
POSITION_TOLERANCE_KM = 1e-4
VELOCITY_TOLERANCE_KM_S = 1e-9
SHORTEST_S = 60.0
SUN, J2000, TYPE = 10, 1, 3


def write_spk(trajectory: Trajectory, path: Path, target: int, name: str) -> int:
    """Write the span of the trajectory and return the number of segments; see above how to read many with jplephem.

    Parameters
    ----------
    trajectory : its whole span is written, heliocentric.
    path : the file; replaced if it exists.
    target : NAIF number of the object, e.g. 20099942.
    name : segment name, at most 40 ASCII characters.

    Raises
    ------
    InputError, OutputError
        If the name does not fit; if the file cannot be written.
    """
    if not name.isascii() or len(name) > 40:
        raise InputError(f'SPK segment name "{name}": needs at most 40 ASCII characters')
    first, last = trajectory.span_s
    offset = (trajectory.epoch.day - J2000_JD + trajectory.epoch.fraction) * DAY_S
    pieces = _pieces(trajectory, first, last)
    try:
        with path.open("w+b") as file:
            file.write(_empty_file(name))
            file.seek(0)
            daf = DAF(file)
            count = 0
            for start, length, records in _runs(pieces):
                begin, end = offset + start, offset + start + length * len(records)
                rows = [_record(begin + k * length, length, row) for k, row in enumerate(records)]
                directory = np.array([begin, length, float(len(rows[0])), float(len(rows))])
                summary = (begin, end, target, SUN, J2000, TYPE)
                daf.add_array(name.encode("ascii").ljust(40), summary, np.concatenate([*rows, directory]))
                count += 1
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from None
    return count


def _pieces(trajectory: Trajectory, first: float, last: float) -> list[tuple[float, float, Array]]:
    """(start, length, coefficients (6, 16)) of the halved span, in time order."""
    waiting, done = [(first, last - first)], []
    nodes = np.cos(np.pi * (np.arange(COEFFICIENTS) + 0.5) / COEFFICIENTS)
    basis = np.polynomial.chebyshev.chebvander(nodes, COEFFICIENTS - 1)
    between = np.linspace(-0.999, 0.999, 41)
    while waiting:
        start, length = waiting.pop()
        middle, radius = start + 0.5 * length, 0.5 * length
        series = basis.T @ trajectory.state_at(middle + radius * nodes) * (2.0 / COEFFICIENTS)
        series[0] *= 0.5
        error = np.polynomial.chebyshev.chebval(between, series).T - trajectory.state_at(middle + radius * between)
        worst = np.abs(error).max(axis=0)
        good = worst[:3].max() < POSITION_TOLERANCE_KM and worst[3:].max() < VELOCITY_TOLERANCE_KM_S
        if good or length < SHORTEST_S:
            done.append((start, length, np.ascontiguousarray(series.T)))
        else:
            waiting += [(start + radius, radius), (start, radius)]
    return done


def _runs(pieces: list[tuple[float, float, Array]]) -> list[tuple[float, float, list[Array]]]:
    """Neighbours of equal length put together."""
    runs: list[tuple[float, float, list[Array]]] = []
    for start, length, series in pieces:
        if runs and runs[-1][1] == length:
            runs[-1][2].append(series)
        else:
            runs.append((start, length, [series]))
    return runs


def _record(begin: float, length: float, series: Array) -> Array:
    """Midpoint, radius, coefficients of x, y, z and of their rates."""
    return np.concatenate([[begin + 0.5 * length, 0.5 * length], series.ravel()])


def _empty_file(name: str) -> bytes:
    """A DAF/SPK file without segments: file record, an empty summary record, an empty name record."""
    check = b"FTPSTR:\r:\n:\r\n:\r\x00:\x81:\x10\xce:ENDFTP"
    head = struct.pack(
        "<8sii60siii8s603s28s297s",
        b"DAF/SPK ", 2, 6, name.encode("ascii").ljust(60), 2, 2, 3 * 128 + 1, b"LTL-IEEE", b"", check, b"",
    )  # fmt: skip
    return head + b"\0" * 1024 + b" " * 1024
