"""How loops are compiled: handed to numba, with the machine code kept on disk beside the sources."""

import functools
import inspect
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

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
    import numba  # half the time that the estimation package takes to import, and a small problem runs no loop

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
    return compiled_when_called(function, _nrt=True, error_model="python", nogil=False)


def compiled_when_called(function: Function, **options: Any) -> Function:
    """The same as `compiled`, but numba is not even loaded before the function is called, from Python or a loop."""
    return cast(Function, functools.update_wrapper(_Deferred(function, options), function))


class _Deferred:
    """A function that is handed to numba when somebody calls it or asks what it is."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self._function, self._options = function, options
        self._made: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Run it."""
        return (self._made or self._handed_over())(*arguments)

    def __getattr__(self, name: str) -> Any:
        """As of the compiled function: its type as well (`_numba_type_`), by which other loops call it."""
        if name.startswith("__") or "_function" not in self.__dict__:  # being copied
            raise AttributeError(name)
        return getattr(self._made or self._handed_over(), name)

    def _handed_over(self) -> Any:
        self._made = compiled(self._function, **self._options)
        return self._made


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
