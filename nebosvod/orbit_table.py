"""A spacecraft's orbit as a table of text: one state a line, the columns named in the first line.

epoch,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s
2028-11-15T00:00:00 TDB,42164.2,0,0,0,3.0747,0
"""

import csv
import math
from pathlib import Path

import numpy as np

from nebosvod.errors import DataError, InputError
from nebosvod.observation import table
from nebosvod.observation.tabulated import TabulatedOrbit
from nebosvod.timescale import Epoch

COLUMNS = ("epoch", "x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s")
LARGEST_BYTES = 200_000_000


def read_orbit_table(path: Path, origin: str) -> TabulatedOrbit:
    """Read a table of states, ICRF axes, relative to `origin`.

    Parameters
    ----------
    path : lines that begin with # and empty ones are left out; epochs as in a mission file, ascending.
    origin : "sun", "earth", "moon", "emb" or "barycentre".

    Raises
    ------
    DataError
        If the file cannot be read.
    InputError
        With file and line, if a row cannot be used or times do not ascend.
    """
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise InputError(f"{path.name}: larger than {LARGEST_BYTES} bytes")
        lines = path.read_text("utf-8").splitlines()
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path.name}: not UTF-8 at byte {error.start}") from None
    rows = [(n, line) for n, line in enumerate(lines, start=1) if line.strip() and not line.lstrip().startswith("#")]
    head = [word.strip() for word in rows[0][1].split(",")] if rows else []
    if tuple(head) != COLUMNS:
        line = rows[0][0] if rows else 1
        raise InputError(f'{path.name}:{line}: the first line must be "{",".join(COLUMNS)}"')
    epochs, states = [], []
    for number, row in rows[1:]:
        words = next(csv.reader([row]))
        try:
            if len(words) != len(COLUMNS):
                raise InputError(f"needs {len(COLUMNS)} columns (got {len(words)})")
            epochs.append(Epoch.parse(words[0].strip()))
            states.append([_finite(word) for word in words[1:]])
        except ValueError as error:
            raise InputError(f"{path.name}:{number}: {error}") from None
    if len(epochs) < 2:
        raise InputError(f"{path.name}: needs at least two states (got {len(epochs)})")
    t_s = np.array([epoch - epochs[0] for epoch in epochs])
    if np.any(np.diff(t_s) <= 0.0):
        number = rows[1 + int(np.argmax(np.diff(t_s) <= 0.0)) + 1][0]
        raise InputError(f"{path.name}:{number}: epochs must ascend")
    return table(epochs[0], t_s, np.array(states), origin, path.name)


def _finite(word: str) -> float:
    value = float(word)
    if not math.isfinite(value):
        raise InputError(f"needs finite numbers (got {word.strip()[:40]})")
    return value
