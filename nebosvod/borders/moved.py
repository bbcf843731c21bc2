"""Old names of modules that the documentation of 0.1 showed: they import still, and warn with the new name."""

import importlib
import sys
import warnings
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

MOVED = {
    "nebosvod.estimation.batch": "nebosvod.estimation.solvers.batch",
    "nebosvod.estimation.combined": "nebosvod.estimation.filters.combined",
    "nebosvod.estimation.consistency": "nebosvod.estimation.accuracy.consistency",
    "nebosvod.estimation.kalman": "nebosvod.estimation.filters.kalman",
    "nebosvod.estimation.recursive": "nebosvod.estimation.solvers.recursive",
    "nebosvod.estimation.two_stage": "nebosvod.estimation.filters.two_stage",
    "nebosvod.observation.observers": "nebosvod.observation.reduction.observers",
    "nebosvod.observation.weights": "nebosvod.observation.reduction.weights",
    "nebosvod.result": "nebosvod.results.result",
}


class Moved(MetaPathFinder, Loader):
    """Finds a module under its old name and fills it with what the new one has."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec of an old name; None for any other."""
        return ModuleSpec(fullname, self) if fullname in MOVED else None

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """An empty module, as by default."""
        return None

    def exec_module(self, module: ModuleType) -> None:
        """Warn, load the new module, and show its names here."""
        new = MOVED[module.__name__]
        warnings.warn(f"{module.__name__} is now {new}", DeprecationWarning, stacklevel=2)
        there = vars(importlib.import_module(new))
        vars(module).update({name: thing for name, thing in there.items() if not name.startswith("__")})


def listen() -> None:
    """Let old names be found, after everything else was asked."""
    if not any(isinstance(finder, Moved) for finder in sys.meta_path):
        sys.meta_path.append(Moved())
