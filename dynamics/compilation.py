"""How kernels are compiled: one decorator, cached on disk, and the cache knows every source that went in.

numba notices a change of the file that holds a function, not of the files its callees live in. The stamp here covers
all sources of this folder, so that an edit anywhere recompiles and a stale kernel cannot run.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

# contract: fused multiply-add; arcp: one reciprocal instead of divisions; nsz: the sign of zero is free. Nothing that
# reorders sums: compensated summation must survive.
FASTMATH = {"contract", "arcp", "nsz"}
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
    """Compile a numeric function when it is first called, and keep the machine code beside the sources."""
    return _compiled(function, fastmath=FASTMATH)


def inlined_kernel(function: Function) -> Function:
    """The same, put into its callers: for functions that take a `Work` or `Physics`.

    A call with such a tuple copies and counts references of some thirty arrays, 0.1 to 0.35 us, as much as the work.
    """
    return _compiled(function, fastmath=FASTMATH, inline="always")


def exact_kernel(function: Function) -> Function:
    """The same without any freedom of rounding: the result is bit for bit that of the plain expression."""
    return _compiled(function, fastmath=False)


def _compiled(function: Function, **options: Any) -> Function:
    """Hand the function to numba, with the stamp of all sources on its cache."""
    compiled: Any = numba.njit(cache=True, error_model="numpy", nogil=True, **options)(function)
    index: Any = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if hasattr(index, "_source_stamp"):
        index._source_stamp = (index._source_stamp, _DIGEST)
    result: Function = compiled
    return result


def is_compiled(function: Callable[..., Any]) -> bool:
    """Whether a kernel can run without compiling: used in this process, or kept on disk for these sources.

    True as well where that cannot be told (compilation switched off, another version of numba).
    """
    if getattr(function, "signatures", True):
        return True
    index: Any = getattr(getattr(function, "_cache", None), "_cache_file", None)
    return not hasattr(index, "_load_index") or bool(index._load_index())
