"""nebosvod: orbit determination of asteroids watched by space telescopes.

    result = nebosvod.run("soda-like")  # or a file; list_missions() names what is built in
    result                              # in a notebook: the verdict, the key figures and a picture
    result.plot.target_plane()          # `result.plot.` and Tab: every figure
    result.typed, result.tables         # numbers with units and moments
    result.save(); result.report()      # the run folder; its page

Each command has its function here: run, fit, validate, plan, compare, study, risk, alert, ephemeris, approaches.

Importing this package loads nothing heavy; each name comes when first used.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nebosvod.borders.moved import listen
from nebosvod.version import __version__

if TYPE_CHECKING:
    from nebosvod.mission import Mission, list_missions, load_mission, load_mission_text
    from nebosvod.notebook.answer import Alert, Approaches, Fit, Result, Risk, Sky
    from nebosvod.notebook.campaigns import Comparison, Decision, Plan, Study, Validation
    from nebosvod.notebook.verbs import (
        alert,
        approaches,
        compare,
        ephemeris,
        fit,
        fit_every,
        plan,
        risk,
        run,
        study,
        validate,
    )
    from nebosvod.orbits.uncertain import UncertainOrbit
    from nebosvod.scene.orbit import read_orbit

# At the root of a checkout this folder goes before an installed package, and its stages stand beside it, not inside.
_CHECKOUT = Path(__file__).resolve().parent.parent
if (_CHECKOUT / "pyproject.toml").is_file() and (_CHECKOUT / "dynamics" / "__init__.py").is_file():
    __path__.append(str(_CHECKOUT))

listen()
__all__ = [
    "Alert",
    "Approaches",
    "Comparison",
    "Decision",
    "Fit",
    "Mission",
    "Plan",
    "Result",
    "Risk",
    "Sky",
    "Study",
    "UncertainOrbit",
    "Validation",
    "__version__",
    "alert",
    "approaches",
    "compare",
    "ephemeris",
    "fit",
    "fit_every",
    "list_missions",
    "load_mission",
    "load_mission_text",
    "plan",
    "read_orbit",
    "risk",
    "run",
    "study",
    "validate",
]

_HOME = {
    **dict.fromkeys(("Mission", "list_missions", "load_mission", "load_mission_text"), "nebosvod.mission"),
    **dict.fromkeys(("Alert", "Approaches", "Fit", "Result", "Risk", "Sky"), "nebosvod.notebook.answer"),
    **dict.fromkeys(("Comparison", "Decision", "Plan", "Study", "Validation"), "nebosvod.notebook.campaigns"),
    **dict.fromkeys(
        ("alert", "approaches", "compare", "ephemeris", "fit", "fit_every", "plan", "risk", "run", "study", "validate"),
        "nebosvod.notebook.verbs",
    ),
    "UncertainOrbit": "nebosvod.orbits.uncertain",
    "read_orbit": "nebosvod.scene.orbit",
}


def __dir__() -> list[str]:
    """What there is to call: the names of `__all__`, and what every module has."""
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'nebosvod' has no attribute {name!r}")
