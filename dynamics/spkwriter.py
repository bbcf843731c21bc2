"""Write a trajectory as an SPK file (NAIF DAF/SPK, type 3) that jplephem and SPICE read.

The span is halved until Chebyshev series of 16 coefficients hold position and velocity; neighbours of equal length form
one segment. Type 3 keeps a series of its own for the velocity: the derivative of a position series over the minutes of
an encounter would amplify the rounding of 1e8 km to 0.4 mm/s. Centre: Sun (10); frame: ICRF axes (J2000, 1).

SPK time is one float64 of seconds since J2000, whose grain of 0.1 us is 3 mm of a planet's way. Edges and middles of
records therefore lie on a coarser binary grid, where they are exact, and the trajectory is evaluated at just these
moments: what SPICE reads at a moment that a float64 holds is the trajectory to a millimetre.

A segment of type 3 has records of one length, so a file has many segments, about a hundred for ten years. SPICE finds
the right one; of jplephem `kernel[10, target]` gives only the last: choose the one of `kernel.segments` whose
`start_jd` and `end_jd` hold the time (docs/propagation.md). The file is padded to whole records of 1024 bytes, without
which SPICE cannot read the last one.
"""

import math
import struct
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from jplephem.daf import DAF
from numpy.polynomial.chebyshev import chebval, chebvander

from nebosvod.borders.wholefile import whole_file
from nebosvod.dynamics.constants import DAY_S, J2000_JD
from nebosvod.errors import InputError

if TYPE_CHECKING:  # it imports this file where it is asked to write
    from nebosvod.dynamics.trajectory import Trajectory

Array = npt.NDArray[np.float64]
Piece = tuple[float, float, Array]  # begin and length in TDB seconds since J2000, coefficients (6, 16)
COEFFICIENTS = 16
POSITION_TOLERANCE_KM = 3e-7
POSITION_ROUNDING = 3e-15  # of the distance: what sums of sixteen terms leave, 0.45 mm at 1 au
VELOCITY_TOLERANCE_KM_S = 1e-9
SHORTEST_S = 60.0
EDGE_GRAIN_S = 2.0**-20  # exact in float64 for 270 years around J2000
SPAN_GRAIN_S = 2.0**-4  # a span of whole such grains can be halved sixteen times on the grid of edges
RECORD_BYTES = 1024
SUN, J2000, TYPE = 10, 1, 3


def write_spk(trajectory: "Trajectory", path: Path, target: int, name: str) -> int:
    """Write the span of the trajectory and return the number of segments; see above how to read many with jplephem.

    Parameters
    ----------
    trajectory : its whole span is written, heliocentric.
    path : the file, which appears whole or not at all; a regular file there is replaced, a link refused.
    target : NAIF number of the object, e.g. 20099942.
    name : segment name, at most 40 ASCII characters.

    Raises
    ------
    InputError, OutputError
        If the name does not fit; if the file cannot be written.
    """
    if not name.isascii() or len(name) > 40:
        raise InputError(f'SPK segment name "{name}": needs at most 40 ASCII characters')
    pieces = _pieces(trajectory)
    end_of_span = _j2000_s(trajectory) + trajectory.span_s[1]
    with whole_file(path) as file:
        file.write(_empty_file(name))
        file.seek(0)
        daf = DAF(file)
        runs = _runs(pieces)
        for start, length, records in runs:
            rows = [_record(start + k * length, length, row) for k, row in enumerate(records)]
            directory = np.array([start, length, float(len(rows[0])), float(len(rows))])
            end = end_of_span if records is runs[-1][2] else start + length * len(records)
            summary = (start, end, target, SUN, J2000, TYPE)
            daf.add_array(name.encode("ascii").ljust(40), summary, np.concatenate([*rows, directory]))
        file.seek(0, 2)
        file.write(b"\0" * (-file.tell() % RECORD_BYTES))
    return len(runs)


def _j2000_s(trajectory: "Trajectory") -> float:
    """The trajectory's epoch in TDB seconds since J2000, rounded to float64."""
    return (trajectory.epoch.day - J2000_JD + trajectory.epoch.fraction) * DAY_S


def _pieces(trajectory: "Trajectory") -> list[Piece]:
    """The halved span in time order, edges on the exact grid; the last piece may end 2^-4 s before the span does."""
    first, last = trajectory.span_s
    begin = math.floor((_j2000_s(trajectory) + first) / EDGE_GRAIN_S) * EDGE_GRAIN_S
    whole = math.floor((_j2000_s(trajectory) + last - begin) / SPAN_GRAIN_S) * SPAN_GRAIN_S
    if not whole:
        raise InputError(f"an SPK file needs a span of time, got {last - first:.9g} s; propagate further")
    waiting, done = [(begin, whole)], []
    nodes = np.cos(np.pi * (np.arange(COEFFICIENTS) + 0.5) / COEFFICIENTS)
    between = np.linspace(-0.999, 0.999, 41)
    while waiting:
        start, length = waiting.pop()
        radius = 0.5 * length
        series = _series(nodes, _states(trajectory, start + radius, radius * nodes))
        wanted = _states(trajectory, start + radius, radius * between)
        worst = np.abs(chebval(between, series).T - wanted).max(axis=0)
        allowed = max(POSITION_TOLERANCE_KM, POSITION_ROUNDING * float(np.abs(wanted[:, :3]).max()))
        good = worst[:3].max() < allowed and worst[3:].max() < VELOCITY_TOLERANCE_KM_S
        if good or length < SHORTEST_S or radius % EDGE_GRAIN_S:
            done.append((start, length, np.ascontiguousarray(series.T)))
        else:
            waiting += [(start + radius, radius), (start, radius)]
    return done


def _states(trajectory: "Trajectory", middle: float, offsets: Array) -> Array:
    """States (n, 6) at offsets in seconds from a moment in seconds since J2000.

    Seconds after an epoch years away have a grain, too: the state goes along its velocity from the time that
    float64 holds to the one asked for (1e-15 s^2 of acceleration are left out).
    """
    since_day = middle - (trajectory.epoch.day - J2000_JD) * DAY_S  # exact
    fraction_s = trajectory.epoch.fraction * DAY_S
    held = since_day + (offsets - fraction_s)
    states = trajectory.state_at(held)
    states[:, :3] += states[:, 3:] * ((since_day - held) + (offsets - fraction_s))[:, None]
    return states


def _series(nodes: Array, values: Array) -> Array:
    """Coefficients (16, c) of values (16, c) at the Chebyshev nodes; a second pass takes back the rounding of one."""
    basis = chebvander(nodes, COEFFICIENTS - 1).T * (2.0 / COEFFICIENTS)
    basis[0] *= 0.5
    series = basis @ values
    return series + basis @ (values - chebval(nodes, series).T)


def _runs(pieces: list[Piece]) -> list[tuple[float, float, list[Array]]]:
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
