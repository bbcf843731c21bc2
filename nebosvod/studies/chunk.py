"""One chunk of a validation campaign on disk: the arrays of some runs under a seal.

The seal is the sha256 of what fixes the runs, the chunk's number and every array: a chunk that was cut, changed, moved
or made by another campaign has no valid one, and its runs are computed again.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.borders.stored import read_arrays
from nebosvod.borders.wholefile import write_whole
from nebosvod.errors import InputError
from nebosvod.results.result import npz_bytes

CHUNKS, SEAL = "chunks", "seal"
KEPT = "; finished chunks are kept"
Arrays = Mapping[str, npt.NDArray[Any]]


def chunk_path(folder: Path, number: int) -> Path:
    """Where a chunk lies."""
    return folder / CHUNKS / f"{number:06d}.npz"


def write_chunk(folder: Path, number: int, campaign: Mapping[str, Any], arrays: Arrays) -> Path:
    """Write a chunk in one step; `campaign` is what fixes the runs."""
    sealed = {**arrays, SEAL: np.array(_seal(number, campaign, arrays))}
    return write_whole(chunk_path(folder, number), npz_bytes(sealed), KEPT)


def read_chunk(folder: Path, number: int, campaign: Mapping[str, Any]) -> dict[str, npt.NDArray[Any]] | None:
    """The arrays of a chunk; None where it is absent, damaged, or not of this campaign: to be computed again."""
    try:
        arrays = read_arrays(chunk_path(folder, number))
    except (FileNotFoundError, InputError):
        return None
    seal = arrays.pop(SEAL, None)
    return arrays if seal is not None and str(seal) == _seal(number, campaign, arrays) else None


def _seal(number: int, campaign: Mapping[str, Any], arrays: Arrays) -> str:
    digest = hashlib.sha256(json.dumps([number, campaign], sort_keys=True).encode("ascii"))
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(json.dumps([name, array.dtype.str, array.shape]).encode("ascii"))
        digest.update(array.tobytes())
    return digest.hexdigest()
