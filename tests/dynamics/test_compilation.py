"""Kernels compile once, and again when any of their sources changes."""

from typing import Any

import numpy as np

from nebosvod.dynamics import compilation, integrator, propagate
from nebosvod.timescale import Epoch


def test_stamp_of_the_cache_covers_all_sources() -> None:
    function: Any = integrator.integrate
    stamp = function._cache._cache_file._source_stamp
    assert stamp[1] == compilation._source_digest()


def test_cache_is_present_after_the_first_run(full_forces: Any, neo: tuple[Epoch, np.ndarray]) -> None:
    propagate(neo[1], neo[0], [86400.0], full_forces)
    assert integrator.is_compiled_cache_present()


def test_kernel_never_used_and_never_kept_is_not_compiled() -> None:
    @compilation.kernel
    def unused(x: float) -> float:
        return x

    assert not compilation.is_compiled(unused)
    unused(1.0)
    assert compilation.is_compiled(unused)
