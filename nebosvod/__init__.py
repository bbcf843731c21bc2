"""nebosvod: orbit determination of asteroids watched by space telescopes.

Importing this package loads nothing heavy; `load_mission`, `run`, `read_orbit` and the rest come when first used.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nebosvod.borders.moved import listen
from nebosvod.version import __version__

if TYPE_CHECKING:
    from nebosvod.mission import load_mission
    from nebosvod.orbits.uncertain import UncertainOrbit
    from nebosvod.pipeline import run
    from nebosvod.results.result import Result
    from nebosvod.scene.orbit import read_orbit

# At the root of a checkout this folder goes before an installed package, and its stages stand beside it, not inside.
_CHECKOUT = Path(__file__).resolve().parent.parent
if (_CHECKOUT / "pyproject.toml").is_file() and (_CHECKOUT / "dynamics" / "__init__.py").is_file():
    __path__.append(str(_CHECKOUT))

listen()
__all__ = ["Result", "UncertainOrbit", "__version__", "load_mission", "read_orbit", "run"]

_HOME = {
    "load_mission": "nebosvod.mission",
    "read_orbit": "nebosvod.scene.orbit",
    "run": "nebosvod.pipeline",
    "Result": "nebosvod.results.result",
    "UncertainOrbit": "nebosvod.orbits.uncertain",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'nebosvod' has no attribute {name!r}")
