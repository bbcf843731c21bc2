"""An uncertain radius moves the image: partials against a photocentre integrated by numpy, and the budget."""

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.engine.assembly import computed_psi, nominal_view, view
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.fitting import fit
from nebosvod.engine.montecarlo import repeat
from nebosvod.engine.quantity import known_partials
from nebosvod.estimation.accuracy.budget import prediction_shares
from nebosvod.estimation.problem.square_root import solve_square
from nebosvod.mission import Mission, load_mission_text
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES, PriorTable, prior_table
from nebosvod.scene.scene import PlannedScene, build_scene

Array = npt.NDArray[np.float64]
Setting = tuple[PlannedScene, PriorTable, View]
# a large Apophis: 5 km of radius are 0.05" at 0.14 au
SPHERE = {
    "radius: {value: 170 m, sigma: 20 m,": "radius: {value: 17 km, sigma: 5 km,",
    "mass: {value: 6.1e10 kg, sigma: 1.5e10 kg,": "mass: {value: 6.1e16 kg, sigma: 1.5e16 kg,",
    "  albedo: {": "  photocentre: {value: 1.0, sigma: 0.01, treatment: considered}\n  albedo: {",
    "predictions:": "prior: {sigma: {position: 100 km, velocity: 0.02 m/s}}\npredictions:",
}
STEP_M = 100.0


def made(text: str, *more: tuple[str, str]) -> Mission:
    for old, new in (*SPHERE.items(), *more):
        assert old in text
        text = text.replace(old, new)
    return load_mission_text(text)


@pytest.fixture(scope="module")
def setting(neb_text: str) -> Setting:
    mission = made(neb_text)
    scene = build_scene(mission)
    return scene, prior_table(mission, scene.forces, scene.state), nominal_view(scene)


def light_psi(seen: View, scene: PlannedScene, radius_km: float) -> Array:
    """Directions (n, 2) to the light of a Lambert sphere: its first moment, integrated over the lit visible part."""
    found = seen.observation
    sun = scene.ephemeris.position_km("sun", found.epoch, found.t_s - found.light_time_s)
    to_sun = sun - found.target_state[:, :3]
    to_sun /= np.linalg.norm(to_sun, axis=1, keepdims=True)
    psi = []
    theta, phi = np.meshgrid((np.arange(400) + 0.5) * np.pi / 400, (np.arange(800) + 0.5) * np.pi / 400, indexing="ij")
    normal = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    for u, s, far in zip(found.u, to_sun, found.distance_km):
        weight = np.maximum(normal @ s, 0.0) * np.maximum(normal @ -u, 0.0) * np.sin(theta)
        centre = (weight[..., None] * normal).sum(axis=(0, 1)) / weight.sum()
        line = far * u + radius_km * (centre - u * (centre @ u))
        psi.append([np.arctan2(line[1], line[0]), np.arcsin(line[2] / np.linalg.norm(line))])
    return np.array(psi)


def test_the_partial_by_the_radius_holds_what_the_light_of_a_larger_sphere_does(
    setting: Setting, neb_text: str
) -> None:
    scene, _, nominal = setting
    column = nominal.observation.parameter_names.index("radius_m")
    here = nominal.observation
    small, large = (light_psi(nominal, scene, 17.0 + step) for step in (-1.0, 1.0))
    quotient = (large - small) / 2000.0 * np.stack([np.cos(here.dec_rad), np.ones_like(here.dec_rad)], axis=1)
    # light pressure alone: the same partials of an orbit that is seen by the centre
    centre = nominal_view(build_scene(made(neb_text, ("photocentre: {value: 1.0", "photocentre: {value: 0.0"))))
    moved = here.H_c[:, :, column] - centre.observation.H_c[:, :, column]
    assert np.abs(moved).max() * 5000.0 == pytest.approx(0.05 / 206264.8, rel=0.5)
    assert moved == pytest.approx(quotient, abs=1e-3 * np.abs(quotient).max())
    assert np.abs(moved).max() > 100.0 * np.abs(centre.observation.H_c[:, :, column]).max()


def test_directions_at_another_radius_agree_with_the_partials(setting: Setting) -> None:
    scene, _, nominal = setting
    column = nominal.observation.parameter_names.index("radius_m")
    psi = [computed_psi(view(scene, nominal.point.moved({"radius_m": sign * STEP_M}))) for sign in (-1.0, 1.0)]
    quotient = (psi[1] - psi[0]) / (2.0 * STEP_M)
    quotient[:, 0] *= np.cos(nominal.observation.dec_rad)
    H = nominal.observation.H_c[:, :, column]
    assert quotient == pytest.approx(H, abs=1e-4 * np.abs(H).max())


def test_the_radius_is_to_blame_and_errors_of_drawn_truths_agree(setting: Setting) -> None:
    scene, priors, nominal = setting
    found = fit(scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors, history=False).estimate
    asked = quantity(scene, scene.trajectory, scene.mission.predictions[1])
    shares = {one.source: one.share for one in prediction_shares(found.predict(*known_partials(asked, found)))}
    assert 0.02 < shares["radius"] < 0.1  # of the target plane; without the image 1e-8
    sample = repeat(scene, scene.mission.estimators[0], nominal, priors, 200, 18)
    place = [sample.names.index(name) for name in (*STATE_NAMES, "radius_m")]
    names = tuple(sample.names[k] for k in place)
    if sample.factors is None:
        y = solve_square(found.factor(names), sample.spread[:, place].T)
        assert 0.9 < np.mean(y**2) < 1.1  # 1400 numbers: 0.90 to 1.10 is 99 %
    else:
        assert 0.9 < np.mean(sample.nees) / 6 < 1.1


def test_a_photocentre_with_a_radius_of_its_own_leaves_the_partials_alone(neb_text: str) -> None:
    own = nominal_view(
        build_scene(made(neb_text, ("photocentre: {value: 1.0,", "photocentre: {value: 1.0, radius: 17 km,")))
    )
    none = nominal_view(build_scene(made(neb_text, ("photocentre: {value: 1.0", "photocentre: {value: 0.0"))))
    assert own.observation.H_c == pytest.approx(none.observation.H_c)
