"""Importing the estimation package alone is quick and loads nothing that it does not compute with."""

import resource
import subprocess
import sys

CHEAPEST = "import numpy, scipy.linalg"
OTHERS = (
    "astropy",
    "matplotlib",
    "pydantic",
    "jplephem",
    "jinja2",
    "scipy.stats",
    "scipy.optimize",
    "scipy.sparse",
    "numba",
)


def cpu_s(code: str) -> float:
    """CPU seconds of a fresh interpreter that runs some code, the lesser of two: what others do counts not."""
    times = []
    for _ in range(2):
        begin = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", code], check=True)
        end = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(end.ru_utime + end.ru_stime - begin.ru_utime - begin.ru_stime)
    return min(times)


def modules(name: str) -> set[str]:
    """What is loaded with a package."""
    code = f"import sys, {name}; print(*sys.modules)"
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    return set(told.split())


def test_it_takes_less_than_twice_numpy_and_its_linear_algebra() -> None:
    """0.4 s where these take 0.28 s; the ratio is the same on a slower machine. The first loop loads the compiler."""
    assert cpu_s("import nebosvod.estimation") < 2.0 * cpu_s(CHEAPEST)


def test_it_loads_neither_astronomy_nor_pictures_nor_forms() -> None:
    loaded = modules("nebosvod.estimation")
    assert "nebosvod.estimation" in loaded
    assert not set(OTHERS) & (loaded - modules("scipy.linalg"))  # which once had the sparse matrices with it
    rooms = {name.split(".")[1] for name in loaded if name.startswith("nebosvod.")}
    assert not rooms & {"dynamics", "observation", "mission", "scene", "engine"}
