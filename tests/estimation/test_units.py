"""Units change nothing: each component's unit times 1e-12 ... 1e12, in everything that is public in this folder.

A case computes numbers from a problem written in some units and returns them in the units of the reference, where all
sizes are about one. Two problems in different units must then agree to 1e-9. The last test holds the list complete.
"""

import inspect
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from nebosvod.estimation.solvers import batch

sys.path.insert(0, str(Path(__file__).resolve().parent))
import units_of_accuracy  # type: ignore[import-not-found]
import units_of_filters  # type: ignore[import-not-found]
import units_of_solvers  # type: ignore[import-not-found]
from turned_units import CASES, COVERED, EXPONENTS, FIXED, MAKE, NONE, Array, Units, drawn  # type: ignore[import-not-found]

MODULES = (units_of_accuracy, units_of_filters, units_of_solvers)  # each registers its cases when it is loaded


@pytest.fixture(scope="module", autouse=True)
def _builder(make_problem):
    MAKE["problem"] = make_problem


def agree(name: str, units: Units) -> None:
    """The case in these units gives the numbers of the reference."""
    wanted, found = CASES[name](NONE), CASES[name](units)
    for key, value in wanted.items():
        for first, second in zip(flat(value), flat(found[key]), strict=True):
            np.testing.assert_allclose(second, first, rtol=1e-9, atol=1e-9, err_msg=f"{name}: {key}")


def flat(value: object) -> list[Array]:
    if isinstance(value, (list, tuple)):
        return [one_array for part in value for one_array in flat(part)]
    return [np.asarray(value, dtype=np.float64)]


@pytest.mark.parametrize("units", FIXED, ids=["a", "b", "c", "d", "all times 1e12", "all times 1e-12"])
@pytest.mark.parametrize("name", CASES)
def test_units_change_nothing(name: str, units: Units) -> None:
    agree(name, units)


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(exponents=EXPONENTS)
def test_any_units_change_nothing(name: str, exponents: list[int]) -> None:
    agree(name, drawn(exponents))


# What has no numbers of its own to turn: descriptions of a problem, words, and helpers that a covered function calls.
WITHOUT = {
    "problem.Block", "problem.Prior", "problem.White", "problem.Markov", "problem.LinearProblem", "problem.readonly",
    "estimate.Status", "partition.CommonSource", "sources.Solved", "sources.residual_after", "sources.prior_draws",
    "rejection.turning", "recursive.mismatched", "score_loops.loop",
    "formed.formed", "formed.definite", "formed.matrices", "formed.matrix_of", "score.among", "score.alone",
    "batch.prior_rows", "batch.solved_triangle", "whitening.chunks", "whitening.add_white", "whitening.projected",
    "whitening.whitened_rows", "whitening.raw_rows", "descent.Step", "descent.Trial", "descent.Descent",
    "descent.descend", "descent.shortened", "square_root.products", "consistency.chi_square_interval",
    "iteration.Linearised", "mean_error.caused", "budget.marginals", "markov.joined_with",
}  # fmt: skip


def test_every_public_name_of_the_folder_is_covered() -> None:
    public = set()
    stage = Path(batch.__file__).parent.parent
    for path in sorted(stage.rglob("*.py")):
        if path.stem == "__init__":
            continue
        module = import_module(f"nebosvod.estimation.{path.parent.name}.{path.stem}")
        for name, thing in vars(module).items():
            own = getattr(thing, "__module__", None) == module.__name__
            if own and not name.startswith("_") and (inspect.isfunction(thing) or inspect.isclass(thing)):
                public.add(f"{path.stem}.{name}")
    assert public - COVERED - WITHOUT == set()
    assert COVERED - public == set()
