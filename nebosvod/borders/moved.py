"""Old names of modules that version 0.1 showed: they import still, and warn with the new name."""

import importlib
import sys
import warnings
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

MOVED = {
    "nebosvod.estimation.batch": "nebosvod.estimation.solvers.batch",
    "nebosvod.estimation.budget": "nebosvod.estimation.accuracy.budget",
    "nebosvod.estimation.combined": "nebosvod.estimation.filters.combined",
    "nebosvod.estimation.consider": "nebosvod.estimation.filters.consider",
    "nebosvod.estimation.consistency": "nebosvod.estimation.accuracy.consistency",
    "nebosvod.estimation.current_state": "nebosvod.estimation.filters.current_state",
    "nebosvod.estimation.ellipse": "nebosvod.estimation.accuracy.ellipse",
    "nebosvod.estimation.extended": "nebosvod.estimation.accuracy.extended",
    "nebosvod.estimation.guaranteed": "nebosvod.estimation.accuracy.guaranteed",
    "nebosvod.estimation.iteration": "nebosvod.estimation.solvers.iteration",
    "nebosvod.estimation.kalman": "nebosvod.estimation.filters.kalman",
    "nebosvod.estimation.normal_places": "nebosvod.estimation.filters.normal_places",
    "nebosvod.estimation.nuisance": "nebosvod.estimation.accuracy.refined",
    "nebosvod.estimation.recursive": "nebosvod.estimation.solvers.recursive",
    "nebosvod.estimation.rejection": "nebosvod.estimation.solvers.rejection",
    "nebosvod.estimation.separated": "nebosvod.estimation.solvers.separated",
    "nebosvod.estimation.sequential": "nebosvod.estimation.solvers.sequential",
    "nebosvod.estimation.smoother": "nebosvod.estimation.filters.smoother",
    "nebosvod.estimation.two_stage": "nebosvod.estimation.filters.two_stage",
    "nebosvod.observation.observers": "nebosvod.observation.reduction.observers",
    "nebosvod.observation.weights": "nebosvod.observation.reduction.weights",
    "nebosvod.result": "nebosvod.results.result",
}


class Moved(MetaPathFinder, Loader):
    """Finds a module under its old name: it is the new one itself, so that its classes stay one."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec of an old name; None for any other."""
        return ModuleSpec(fullname, self) if fullname in MOVED else None

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """An empty module, as by default."""
        return None

    def exec_module(self, module: ModuleType) -> None:
        """Warn, and put the new module in the place of the empty one."""
        new = MOVED[module.__name__]
        warnings.warn(f"{module.__name__} is now {new}", DeprecationWarning, stacklevel=2)
        sys.modules[module.__name__] = importlib.import_module(new)


def listen() -> None:
    """Let old names be found, after everything else was asked."""
    if not any(isinstance(finder, Moved) for finder in sys.meta_path):
        sys.meta_path.append(Moved())
