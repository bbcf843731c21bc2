"""How loops are compiled: handed to numba, with the machine code kept on disk beside the sources."""

import inspect
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba

from nebosvod.errors import NebosvodNotice

Function = TypeVar("Function", bound=Callable[..., Any])

# contract: fused multiply-add; arcp: one reciprocal instead of divisions; nsz: the sign of zero is free. Nothing that
# reorders sums: compensated summation must survive.
FASTMATH = {"contract", "arcp", "nsz"}


def compiled(function: Function, stamp: str = "", cache: bool = True, **options: Any) -> Function:
    """Compile a numeric function when it is first called.

    Parameters
    ----------
    stamp : of sources beyond the function's own file: machine code made with another stamp is not used.
    options : of numba, beside division as numpy's, no lock, and no arrays made in the function.
    """
    options = {"_nrt": False, "error_model": "numpy", "nogil": True, **options}
    try:
        made: Any = numba.njit(cache=cache, **options)(function)
    except RuntimeError:  # numba found no folder for its cache: neither beside the sources nor in the user's
        made = numba.njit(cache=False, **options)(function)
        _tell_without_cache(str(Path(inspect.getfile(function)).parent))
    index: Any = getattr(getattr(made, "_cache", None), "_cache_file", None)
    if stamp and hasattr(index, "_source_stamp"):
        index._source_stamp = (index._source_stamp, stamp)
    result: Function = made
    return result


def plain_loop(function: Callable[..., Any]) -> Any:
    """Compile a loop over small matrices, as plain Python would compute it: it may make arrays."""
    return compiled(function, _nrt=True, error_model="python", nogil=False)


def kept(folder: Path) -> bool:
    """Whether machine code of functions in a folder is kept already, beside them or where NUMBA_CACHE_DIR says."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    places = [folder / "__pycache__", *([Path(named)] if named else [])]
    return any(True for place in places for _ in place.rglob("*.nbi"))


_told: list[str] = []


def _tell_without_cache(folder: str) -> None:
    """Say once why every start takes long."""
    if _told:
        return
    _told.append(folder)
    warnings.warn(
        f"{folder} is read-only and there is no cache folder, so compiled kernels cannot be kept: "
        "every start compiles them anew, half a minute; name a folder in NUMBA_CACHE_DIR",
        NebosvodNotice,
        stacklevel=2,
    )
