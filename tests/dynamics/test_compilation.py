"""Kernels compile once, and again when any of their sources changes."""

import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, compilation, integrator, propagate
from nebosvod.timescale import Epoch


def test_stamp_of_the_cache_covers_all_sources() -> None:
    function: Any = integrator.march
    stamp = function._cache._cache_file._source_stamp
    assert stamp[1] == compilation._source_digest()


def test_cache_is_present_after_the_first_run(full_forces: Any, neo: tuple[Epoch, np.ndarray]) -> None:
    propagate(neo[1], neo[0], [86400.0], full_forces)
    assert compilation.is_compiled(integrator.march)


@pytest.mark.parametrize(("used", "kept", "wanted"), [((), {}, False), ((), {"a": 1}, True), (("a",), {}, True)])
def test_kernel_is_ready_when_used_here_or_kept_on_disk(used: Any, kept: Any, wanted: bool) -> None:
    index = SimpleNamespace(_load_index=lambda: kept)
    function: Any = SimpleNamespace(signatures=used, _cache=SimpleNamespace(_cache_file=index))
    assert compilation.is_compiled(function) is wanted


@pytest.mark.parametrize("name", ["constants", "ephemeris", "elements", "frames", "twobody"])
def test_modules_without_kernels_do_not_load_the_compiler(name: str) -> None:
    code = f"import sys, nebosvod.dynamics.{name}; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("body", ["sun", "earth", "moon", "jupiter", "pluto", "ceres", "emb"])
def test_compiled_ephemeris_is_the_plain_one_bit_for_bit(body: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that an answer does not depend on whether something has loaded the compiler."""
    loaded = Ephemeris.load()
    epoch = Epoch.parse("2025-03-01T03:04:05.678 TDB")
    first, last = loaded.span
    times = np.append(
        np.random.default_rng(1).uniform(first - epoch, last - epoch, 2000), [first - epoch, last - epoch]
    )
    assert "nebosvod.dynamics.chebyshev" in sys.modules
    compiled = loaded.state_km_km_s(body, epoch, times)
    monkeypatch.delitem(sys.modules, "nebosvod.dynamics.chebyshev")
    plain = loaded.state_km_km_s(body, epoch, times)
    assert np.array_equal(compiled, plain)
    assert compiled.flags.c_contiguous


def test_few_times_do_not_load_the_compiler_and_very_many_do() -> None:
    code = (
        "import sys, numpy as np; from nebosvod.dynamics import ephemeris; from nebosvod.timescale import Epoch;"
        "e, t = ephemeris.Ephemeris.load(), Epoch.parse('2025-03-01 TDB'); e.position_km('earth', t, np.zeros(100));"
        "few = 'numba' in sys.modules; ephemeris.COMPILE_ABOVE = 99; e.position_km('earth', t, np.zeros(100));"
        "sys.exit(int(few or 'numba' not in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
