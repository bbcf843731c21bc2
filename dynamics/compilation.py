"""How kernels are compiled: one decorator, cached on disk, and the cache knows every source that went in.

numba notices a change of the file that holds a function, not of the files its callees live in. The stamp here covers
all sources of this folder, so that an edit anywhere recompiles and a stale kernel cannot run.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
from numba.core.registry import CPUDispatcher

from nebosvod.borders.compiled import FASTMATH, Function, compiled

# Numbers given to kernels as arguments: a plain constant would be another type, and the kernel compiled for it as well
SUN, EARTH, STATE_ROWS = cast(int, np.int64(0)), cast(int, np.int64(3)), cast(int, np.int64(3))
LANES = 8  # nodes of one collocation step; vectors at n <= 8 moments are flat: x at [l], y at [8 + l], z at [16 + l]


def _source_digest() -> str:
    """Digest of all sources of this folder that hold kernels or the tables frozen into them."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        source = path.read_bytes()
        if b"kernel\ndef " in source or path.stem in ("collocation", "model"):
            digest.update(path.name.encode() + b"\0" + source)
    return digest.hexdigest()


_DIGEST = _source_digest()


def kernel(function: Function) -> Function:
    """Compile a numeric function when it is first called, and keep the machine code beside the sources.

    Kernels make no arrays, so numba need not count references to them (`_nrt`): that took half the time of a step.
    """
    return _compiled(function, fastmath=FASTMATH)


def inlined_kernel(function: Function) -> Function:
    """The same for a function that only kernels call: it is put into its callers, and runs as plain Python elsewhere.

    A call that hands over a `Work` copies forty arrays, 0.1 us, as much as the work; and translating arguments from
    Python for fifty functions would be a fifth of the time of compilation.
    """
    made: Any = _compiled(
        function, cache=False, fastmath=FASTMATH, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True
    )
    if isinstance(made, CPUDispatcher):
        made.__class__ = _Inlined  # else a call from Python would end the process
    result: Function = made
    return result


class _Inlined(CPUDispatcher):
    """A kernel without an entry from Python: called from there, the plain function runs."""

    def __call__(self, *arguments: Any) -> Any:
        """Run the plain function."""
        return self.py_func(*arguments)


def allocating_kernel(function: Function) -> Function:
    """The same as `kernel` for a function that makes arrays; no good inside another kernel's loop."""
    return _compiled(function, _nrt=True, fastmath=FASTMATH)


def exact_kernel(function: Function) -> Function:
    """The same without any freedom of rounding: the result is bit for bit that of the plain expression."""
    return _compiled(function, fastmath=False)


def straight(function: Function) -> Function:
    """The only version there is of a kernel, entered without looking which one fits: 5 us of a call with forty arrays.

    Nothing checks what is handed over then: for callers whose arrays are float64 or int64 in C order, always.
    """
    versions: Any = getattr(function, "overloads", ())
    if len(versions) != 1:  # not used yet, or compiled for other types too
        return function
    (version,) = dict.values(versions)  # those of an OrderedDict hash every type of the signature: 29 us
    entered: Function = version.entry_point
    return entered


def _compiled(function: Function, cache: bool = True, **options: Any) -> Function:
    """Hand the function to numba, with the stamp of all sources on its cache."""
    return compiled(function, stamp=_DIGEST, cache=cache, **options)


def is_compiled(function: Callable[..., Any]) -> bool:
    """Whether a kernel can run without compiling: used in this process, or kept on disk for these sources.

    True as well where that cannot be told (compilation switched off, another version of numba).
    """
    if getattr(function, "signatures", True):
        return True
    index: Any = getattr(getattr(function, "_cache", None), "_cache_file", None)
    return not hasattr(index, "_load_index") or bool(index._load_index())
