"""Elements, energy and formulas of users as predictions: values and partials against numpy, sigmas against draws."""

import json
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.cli import main
from nebosvod.dynamics import propagate
from nebosvod.engine.assembly import computed_psi, nominal_view
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.fitting import fit
from nebosvod.engine.quantity import known_partials
from nebosvod.errors import InputError
from nebosvod.mission import Mission, load_mission_text
from nebosvod.mission.formula import ELEMENTS
from nebosvod.scene.prior import STATE_NAMES, prior_table
from nebosvod.scene.scene import PlannedScene, build_scene

Array = npt.NDArray[np.float64]
AT = "2028-04-29T00:00:00 TDB"
FORMULA = "hypot(x - earth.x, y - earth.y, z - earth.z) / au"
PRESSURE = "radius^2 / mass * (1 + 4 * albedo / 9) + 0 * x"
ASKED = "".join(f"  - {{name: {name} then, plane: element, element: {name}, at: {AT}}}\n" for name in ELEMENTS) + (
    f"  - {{name: energy, plane: energy, at: {AT}}}\n"
    f'  - {{name: from Earth, plane: formula, formula: "{FORMULA}", unit: au, at: {AT}}}\n'
    f'  - {{name: pressure, plane: formula, formula: "{PRESSURE}", unit: m2kg, at: {AT}}}\n'
)
TILT = np.radians(84381.448 / 3600.0)
AU = 149597870.7


@pytest.fixture(scope="module")
def scene(minimal: Mission) -> PlannedScene:
    return build_scene(load_mission_text(minimal.text.replace("predictions:\n", "predictions:\n" + ASKED)))


def elements(state: Array, gm: float) -> dict[str, float]:
    """From the vectors of a state by the textbook, angles by arccos and signs; degrees, au, days."""
    c, s = np.cos(TILT), np.sin(TILT)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    r, v = turn @ state[:3], turn @ state[3:]
    far, h = np.linalg.norm(r), np.cross(r, v)
    e_vector = np.cross(v, h) / gm - r / far
    e, a = np.linalg.norm(e_vector), 1.0 / (2.0 / far - v @ v / gm)
    line = np.array([-h[1], h[0], 0.0])
    node = np.degrees(np.arctan2(line[1], line[0])) % 360.0
    peri = np.degrees(np.arccos(line @ e_vector / np.linalg.norm(line) / e))
    peri = 360.0 - peri if e_vector[2] < 0.0 else peri
    E = np.arctan2(r @ v / np.sqrt(gm * a), 1.0 - far / a)
    n = np.sqrt(gm / a**3)
    M = E - e * np.sin(E)
    return {
        "a": a / AU, "e": e, "q": a * (1 - e) / AU, "Q": a * (1 + e) / AU,
        "i": np.degrees(np.arccos(h[2] / np.linalg.norm(h))),
        "node": node, "peri": peri, "M": np.degrees(M), "tp": -M / n / 86400.0, "period": 2 * np.pi / n / 86400.0,
        "n": np.degrees(n) * 86400.0,
    }  # fmt: skip


def by_hand(scene: PlannedScene, name: str, state: Array, parameters: dict[str, float]) -> float:
    t = scene.mission.predictions[0].when - scene.epoch
    forces = scene.forces.with_values(parameters)
    there = propagate(state, scene.epoch, np.array([0.0, t]), forces, sensitivities=False).state_at(np.array([t]))[0]
    gm = scene.ephemeris.gm_km3_s2["sun"]
    if name.endswith(" then"):
        return float(elements(there, gm)[name.removesuffix(" then")])
    if name == "energy":
        return float(there[3:] @ there[3:] / 2.0 - gm / np.linalg.norm(there[:3]))
    if name == "pressure":
        return parameters["radius_m"] ** 2 / parameters["mass_kg"] * (1.0 + 4.0 * parameters["albedo"] / 9.0)
    earth, sun = (scene.ephemeris.position_km(body, scene.epoch, np.array([t]))[0] for body in ("earth", "sun"))
    return float(np.linalg.norm(there[:3] - (earth - sun)) / AU)


NAMES = [f"{name} then" for name in ELEMENTS] + ["energy", "from Earth", "pressure"]
STEPS = {
    **dict(zip(STATE_NAMES, (100.0, 100.0, 100.0, 1e-4, 1e-4, 1e-4))), "radius_m": 0.05, "mass_kg": 1e4, "albedo": 1e-3,
}  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_value_and_partials_are_those_of_vectors_and_difference_quotients(name: str, scene: PlannedScene) -> None:
    request = next(one for one in scene.mission.predictions if one.name == name)
    found = quantity(scene, scene.trajectory, request)
    parameters = dict(zip(scene.forces.parameters, scene.forces.values.tolist()))
    assert found.value == pytest.approx([by_hand(scene, name, scene.state, parameters)], rel=1e-9, abs=1e-9)
    size = max(np.abs(found.partials[0] * np.array([STEPS[one] for one in found.names])))
    for column, one in enumerate(found.names):
        ends = []
        for sign in (-1.0, 1.0):
            state, moved = scene.state.copy(), dict(parameters)
            if one in STATE_NAMES:
                state[column] += sign * STEPS[one]
            else:
                moved[one] += sign * STEPS[one]
            ends.append(by_hand(scene, name, state, moved))
        assert found.partials[0, column] * STEPS[one] == pytest.approx((ends[1] - ends[0]) / 2.0, abs=1e-5 * size), one


def test_sigma_is_that_of_drawn_errors(scene: PlannedScene) -> None:
    """600 states and parameters from K_true, each carried and asked by hand."""
    nominal = nominal_view(scene)
    priors = prior_table(scene.mission, scene.forces, scene.state)
    found = fit(scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors, history=False).estimate
    names = (*STATE_NAMES, "radius_m", "mass_kg", "albedo")
    factor, rng = found.factor(names), np.random.default_rng(5)
    parameters = dict(zip(scene.forces.parameters, scene.forces.values.tolist()))
    drawn: dict[str, list[float]] = {name: [] for name in ("a then", "node then", "from Earth")}
    for _ in range(150):
        error = 0.2 * factor @ rng.standard_normal(len(names))  # a fifth: the mass stays positive
        moved = {name: parameters[name] + off for name, off in zip(names[6:], error[6:])}
        for name, values in drawn.items():
            values.append(by_hand(scene, name, scene.state + error[:6], moved))
    for name, values in drawn.items():
        request = next(one for one in scene.mission.predictions if one.name == name)
        asked = quantity(scene, scene.trajectory, request)
        sigma = float(found.predict(*known_partials(asked, found)).sigma[0])
        assert np.std(values) / 0.2 == pytest.approx(sigma, rel=0.2), name  # 150 draws: 3.5 sigma of a sigma


def test_a_run_has_them_with_budget_and_page(minimal: Mission, tmp_path: Path) -> None:
    text = minimal.text.replace("predictions:\n", "predictions:\n" + ASKED) + "monte_carlo: {runs: 20}\n"
    (tmp_path / "m.yaml").write_text(text)
    assert main(["run", str(tmp_path / "m.yaml"), "-o", str(tmp_path / "run")]) == 0
    rows = {row["name"]: row for row in json.loads((tmp_path / "run" / "summary.json").read_text())["predictions"]}
    assert rows["a then"]["sigma_au"][0] > 0.0
    assert rows["energy"]["mean_km2_s2"][0] < 0.0
    assert sum(share["share_total"] for share in rows["from Earth"]["budget"]) == pytest.approx(1.0)
    relative = np.hypot(np.hypot(2 * 0.2, 0.25), 4 / 9 * 0.05 / (1 + 4 * 0.15 / 9))  # nothing is learnt of them
    value = rows["pressure"]["mean_m2kg"][0]
    assert rows["pressure"]["sigma_m2kg"][0] == pytest.approx(relative * value, rel=0.02)
    page = (tmp_path / "run" / "report.html").read_text()
    assert "osculating element" in page
    assert main(["report", str(tmp_path / "run")]) == 0


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("plane: element, element: b", "element"),
        ("plane: element", "element"),
        ("plane: energy, element: a", "element"),
        ("plane: formula", "formula"),
        ('plane: formula, formula: "x + size"', "size"),
        ('plane: formula, formula: "__import__(1)"', "__import__"),
        ('plane: formula, formula: "x", unit: "km / s"', "unit"),
        ('plane: formula, formula: "(x"', "no formula"),
    ],
)
def test_what_is_no_prediction_is_refused_at_its_place(line: str, said: str, minimal: Mission) -> None:
    text = minimal.text.replace("predictions:\n", f"predictions:\n  - {{name: odd, {line}, at: {AT}}}\n")
    with pytest.raises(InputError, match="predictions") as caught:
        load_mission_text(text)
    assert said in str(caught.value)
