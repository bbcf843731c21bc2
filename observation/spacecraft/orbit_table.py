"""A spacecraft's orbit as a table of text: one state a line, the columns named in the first line.

epoch,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s
2028-11-15T00:00:00 TDB,42164.2,0,0,0,3.0747,0
"""

import csv
import math
from array import array
from pathlib import Path

import numpy as np

from nebosvod.borders.text_lines import text_lines
from nebosvod.errors import InputError
from nebosvod.observation.spacecraft.tabulated import TabulatedOrbit, table
from nebosvod.timescale import Epoch

COLUMNS = ("epoch", "x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s")


def read_orbit_table(path: Path, origin: str) -> TabulatedOrbit:
    """Read a table of states, ICRF axes, relative to `origin`.

    Parameters
    ----------
    path : lines that begin with # and empty ones are left out; epochs as in a mission file, ascending.
    origin : "sun", "earth", "moon", "emb" or "barycentre".

    Raises
    ------
    DataError
        If the file cannot be read, or is no text.
    InputError
        With file and line, if a row cannot be used or times do not ascend.
    """
    with text_lines(path) as lines:
        rows = ((n, line) for n, line in lines if line.strip() and not line.lstrip().startswith("#"))
        number, head = next(rows, (1, ""))
        if tuple(word.strip() for word in head.split(",")) != COLUMNS:
            raise InputError(f'{path.name}:{number}: the first line must be "{",".join(COLUMNS)}"')
        first, numbers, before = None, array("d"), -math.inf
        for number, row in rows:
            try:
                epoch, state = _state(row)
            except ValueError as error:
                raise InputError(f"{path.name}:{number}: {error}") from None
            first = first or epoch
            after = epoch - first
            if after <= before:
                raise InputError(f"{path.name}:{number}: epochs must ascend")
            before = after
            numbers.extend((after, *state))
    states = np.array(numbers).reshape(-1, len(COLUMNS))
    if first is None or len(states) < 2:
        raise InputError(f"{path.name}: needs at least two states (got {len(states)})")
    return table(first, states[:, 0].copy(), states[:, 1:].copy(), origin, path.name)


def _state(row: str) -> tuple[Epoch, list[float]]:
    """Epoch and state of a line."""
    words = next(csv.reader([row]))
    if len(words) != len(COLUMNS):
        raise InputError(f"needs {len(COLUMNS)} columns (got {len(words)})")
    return Epoch.parse(words[0].strip()), [_finite(word) for word in words[1:]]


def _finite(word: str) -> float:
    value = float(word)
    if not math.isfinite(value):
        raise InputError(f"needs finite numbers (got {word.strip()[:40]})")
    return value
