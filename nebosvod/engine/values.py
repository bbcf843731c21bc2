"""Predictions that are one number: an osculating element, the specific energy, or a formula that the mission writes.

Partials are exact: of elements by their Jacobian, of formulas by the complex step through the state and the parameters.
"""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from nebosvod.borders.expression import Expression, read_expression
from nebosvod.dynamics import Trajectory
from nebosvod.dynamics.elements import state_to_cometary, state_to_keplerian
from nebosvod.engine.facts import ValueFacts
from nebosvod.engine.quantity import Quantity, make_quantity
from nebosvod.errors import GeometryError, NoAnswerError
from nebosvod.mission.formula import ENERGY, PARAMETERS, STATE, formula_names
from nebosvod.mission.parameter import LOGARITHMS
from nebosvod.mission.request import ValuePrediction
from nebosvod.mission.state import to_icrf
from nebosvod.scene.scene import Scene
from nebosvod.units import AU_KM, DAY_S

Array = npt.NDArray[np.float64]
DEGREES = 180.0 / np.pi


def value_quantity(scene: Scene, trajectory: Trajectory, request: ValuePrediction) -> Quantity:
    """Value, unit and partials of a prediction that is one number, of the heliocentric state at its time.

    Raises
    ------
    NoAnswerError
        If it is not defined for this orbit: the node of an orbit in the ecliptic, a root of something negative.
    """
    t_s = request.at - scene.epoch
    at = trajectory.at(np.array([t_s]))
    x, Phi, zeta = at.state[0], at.Phi[0], at.zeta[0]
    if request.element is not None:
        said: str = request.element
        value, by_state = element(said, x, scene.ephemeris.gm_km3_s2["sun"])
        by_parameters = np.zeros(len(trajectory.parameter_names))
    else:
        said = ENERGY if request.formula is None else request.formula
        formula = read_expression(said, formula_names())
        value, by_state, by_parameters = _of_formula(formula, _values(scene, trajectory, x, t_s), trajectory)
    if not (np.isfinite(value) and np.isfinite(by_state).all() and np.isfinite(by_parameters).all()):
        raise NoAnswerError(f"{said} has no value for this orbit", status="undefined")
    return make_quantity(
        request,
        request.at,
        request.in_unit,
        np.array([value]),
        by_state[None] @ Phi,
        by_state[None] @ zeta + by_parameters[None],
        trajectory,
        ValueFacts(formula=said),
    )


def element(name: str, state: Array, gm_km3_s2: float) -> tuple[float, Array]:
    """An osculating heliocentric element on the ecliptic of J2000 in the unit of `mission.formula`; its partials (6,).

    Parameters
    ----------
    name : a e q Q i node peri M tp period n; au, deg, d, deg/d. tp: perihelion passage after the time of the state.
    state : (6,) ICRF, km and km/s.
    """
    rotation = to_icrf(np.eye(6)).T
    try:
        if name in ("e", "q", "tp", "node", "peri", "i"):
            values, J = state_to_cometary(rotation @ state, gm_km3_s2)
            row = ("e", "q", "tp", "node", "peri", "i").index(name)
            scale = {"q": 1.0 / AU_KM, "tp": 1.0 / DAY_S, "e": 1.0}.get(name, DEGREES)
            return float(scale * values[row]), np.asarray(scale * J[row] @ rotation)
        values, J = state_to_keplerian(rotation @ state, gm_km3_s2)
    except GeometryError as error:
        raise NoAnswerError(str(error), status="undefined") from None
    a, e = float(values[0]), float(values[1])
    if name == "a":
        found, by_elements = a / AU_KM, J[0] / AU_KM
    elif name == "Q":
        found, by_elements = a * (1.0 + e) / AU_KM, ((1.0 + e) * J[0] + a * J[1]) / AU_KM
    elif name == "M":
        found, by_elements = DEGREES * float(values[5]), DEGREES * J[5]
    else:
        motion = np.sqrt(gm_km3_s2 / abs(a) ** 3)  # rad/s, falls as |a|^-3/2
        if name == "n":
            found = DEGREES * DAY_S * motion
            by_elements = -1.5 * found / a * J[0]
        else:
            found = 2.0 * np.pi / motion / DAY_S if a > 0.0 else np.nan
            by_elements = 1.5 * found / a * J[0]
    return float(found), np.asarray(by_elements @ rotation)


def _values(scene: Scene, trajectory: Trajectory, x: Array, t_s: float) -> dict[str, float]:
    """The names a formula may have with their values; a parameter that the mission does not have is left out."""
    values = dict(zip(STATE, x.tolist()))
    sun, earth = (scene.ephemeris.state_km_km_s(body, scene.epoch, np.array([t_s]))[0] for body in ("sun", "earth"))
    values |= {f"earth.{name}": float(value) for name, value in zip(STATE, earth - sun)}
    values |= {"gm_sun": scene.ephemeris.gm_km3_s2["sun"], "gm_earth": scene.ephemeris.gm_km3_s2["earth"], "au": AU_KM}
    known = {p.name: p.quantity for p in scene.mission.parameters}
    here = dict(zip(trajectory.forces.parameters, np.asarray(trajectory.forces.values).tolist()))
    for name, (physical, value) in known.items():
        word = next((word for word, of in PARAMETERS.items() if of == physical), None)
        if word is not None:
            moved = here.get(name, value)
            values[word] = float(np.exp(moved)) if name in here and name in LOGARITHMS else float(moved)
    return values


def _of_formula(formula: Expression, values: Mapping[str, float], trajectory: Trajectory) -> tuple[float, Array, Array]:
    """Value, partials (6,) by the state at the time, and (m,) by the parameters themselves."""
    missing = [name for name in formula.names if name not in values]
    if missing:
        raise NoAnswerError(f"{missing[0]} is nothing that this object has", status="undefined")
    found, partials = float(formula(values)), formula.partials(values)
    by_state = np.array([partials.get(name, 0.0) for name in STATE])
    by_parameters = np.zeros(len(trajectory.parameter_names))
    for column, name in enumerate(trajectory.parameter_names):
        physical = LOGARITHMS.get(name, name)
        word = next((word for word, of in PARAMETERS.items() if of == physical), None)
        if word in partials:
            by_parameters[column] = partials[word] * (values[word] if name in LOGARITHMS else 1.0)
    return found, by_state, by_parameters
