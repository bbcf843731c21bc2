"""Radius, mass, albedo and H with one joint covariance: the prior, what is learnt of H through it, and refusals."""

import numpy as np
import pytest

from nebosvod.engine.assembly import computed_psi, linear_problem, nominal_view
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.fitting import fit
from nebosvod.engine.montecarlo import repeat
from nebosvod.errors import InputError
from nebosvod.mission import load_mission_text
from nebosvod.pipeline import run
from nebosvod.scene.prior import STATE_NAMES, prior_table
from nebosvod.scene.scene import build_scene

SIGMAS = np.array([5000.0, 1.5e16, 0.05, 0.3])  # m, kg, 1, mag
CORRELATION = np.array([[1.0, 0.8, -0.4, -0.7], [0.8, 1.0, -0.3, -0.5], [-0.4, -0.3, 1.0, 0.0], [-0.7, -0.5, 0.0, 1.0]])
GROUPS = ("radius", "mass", "albedo", "H")
NAMES = ("radius_m", "mass_kg", "albedo", "H_mag")
SAID = "  correlations: [" + ", ".join(
    f"{{between: [{GROUPS[i]}, {GROUPS[j]}], value: {CORRELATION[i, j]}}}"
    for i in range(4) for j in range(i) if CORRELATION[i, j]
) + "]\n"  # fmt: skip
LARGE = {
    "radius: {value: 170 m, sigma: 20 m,": "radius: {value: 17 km, sigma: 5 km,",
    "mass: {value: 6.1e10 kg, sigma: 1.5e10 kg,": "mass: {value: 6.1e16 kg, sigma: 1.5e16 kg,",
    "  albedo: {": "  photocentre: {value: 1.0, sigma: 0.01, treatment: considered}\n"
    "  magnitude: {H: 10, sigma: 0.3, treatment: estimated}\n" + SAID + "  albedo: {",
    "sigma: 0.1 arcsec": "sigma: 0.02 arcsec",
    "predictions:": "prior: {sigma: {position: 100 km, velocity: 0.02 m/s}}\npredictions:\n"
    "  - {name: brightness, plane: formula, formula: H, at: 2029-04-06 TDB}",
}


def made(neb_text: str, *more: tuple[str, str]) -> str:
    for old, new in (*LARGE.items(), *more):
        assert old in neb_text
        neb_text = neb_text.replace(old, new)
    return neb_text


def test_the_prior_is_joint_and_what_is_seen_of_the_radius_tells_of_h(neb_text: str) -> None:
    mission = load_mission_text(made(neb_text))
    scene = build_scene(mission)
    priors, nominal = prior_table(mission, scene.forces, scene.state), nominal_view(scene)
    covariance = CORRELATION * SIGMAS[:, None] * SIGMAS
    ((_, names, _, said),) = [entry for entry in priors.entries if "H_mag" in entry[1]]
    assert names == NAMES
    assert said / SIGMAS / SIGMAS[:, None] == pytest.approx(CORRELATION)
    draws = [priors.draw(rng) for rng in map(np.random.default_rng, range(2000))]
    drawn = np.array([[one[name] for name in NAMES] for one in draws])
    assert np.corrcoef(drawn.T) == pytest.approx(CORRELATION, abs=0.06)
    assert not nominal.observation.H_c[:, :, 3].any()  # nothing that is measured depends on H
    found = fit(scene, mission.estimators[0], nominal, computed_psi(nominal), priors, history=False).estimate
    problem = linear_problem(scene, mission.estimators[0], nominal, computed_psi(nominal), priors, about=nominal.point)
    # dense: everything but the four by its prior and the noise, then the four by theirs
    n = problem.n
    R = np.zeros((2 * n, 2 * n))
    for k in range(n):
        R[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = np.broadcast_to(problem.R, (n, 2, 2))[k]
    for white in problem.white:
        for k, row in enumerate(white.rows):
            own = slice(2 * row, 2 * row + 2)
            R[own, own] += white.H[k] @ np.broadcast_to(white.Q, (len(white.rows), 3, 3))[k] @ white.H[k].T
    columns = {name: b.H[:, :, i].ravel() for b in problem.blocks for i, name in enumerate(b.names)}
    estimated = problem.names("estimated")
    H = np.stack([columns[name] for name in estimated], axis=1)
    P = np.zeros((len(estimated), len(estimated)))
    place = [estimated.index(name) for name in NAMES]
    for prior in problem.priors:
        at = [estimated.index(name) for name in prior.names if name in estimated]
        if at:
            own_block = covariance if set(prior.names) == set(NAMES) else prior.covariance
            P[np.ix_(at, at)] = own_block
    unit = np.sqrt(np.diag(P))
    U = H * unit  # whitened prior: K = P - P H^T (R + H P H^T)^-1 H P, well scaled
    inner = P / unit / unit[:, None]
    K = inner - inner @ U.T @ np.linalg.solve(R + U @ inner @ U.T, U @ inner)
    size = unit[place]
    assert found.covariance(NAMES) / size / size[:, None] == pytest.approx(K[np.ix_(place, place)], abs=1e-4)
    assert found.sigma("H_mag") < 0.999 * 0.3


def test_drawn_truths_agree_and_a_formula_may_have_h(neb_text: str) -> None:
    mission = load_mission_text(made(neb_text))
    scene = build_scene(mission)
    priors, nominal = prior_table(mission, scene.forces, scene.state), nominal_view(scene)
    asked = quantity(scene, scene.trajectory, mission.predictions[0])
    assert asked.value == pytest.approx([10.0])
    assert asked.partials[0, asked.names.index("H_mag")] == 1.0
    sample = repeat(scene, mission.estimators[0], nominal, priors, 200, 4)
    names = (*STATE_NAMES, *NAMES)
    place = [sample.names.index(name) for name in names]
    y = np.linalg.solve(sample.reference.factor(names), sample.spread[:, place].T)
    if sample.factors is None:
        assert 0.9 < np.mean(y**2) < 1.1  # 2000 numbers: 0.92 to 1.08 is 99 %


def test_a_run_names_the_source_and_shows_h(neb_text: str) -> None:
    summary = run(load_mission_text(made(neb_text)), seed=2).summary
    assert any("H" in row["source"].split(" and ") for row in summary["budget"])
    assert summary["estimators"][0]["parameters"]["H_mag"]["prior_sigma"] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("value: 0.8}", "value: 1.0}", "less than 1"),
        ("value: 0.8}", "value: -0.8}", "no covariance"),
        ("between: [mass, radius]", "between: [radius, radius]", "twice"),
        ("between: [mass, radius]", "between: [A2, radius]", "no error"),
        ("sigma: 0.3, treatment: estimated}", "sigma: 0.3}", "treatment"),
        ("predictions:", "estimators: [{name: odd, method: batch_qr, treatment: {H: fixed}}]\npredictions:", "fixed"),
    ],
)
def test_what_cannot_be_is_refused(old: str, new: str, said: str, neb_text: str) -> None:
    with pytest.raises(InputError, match=said):
        load_mission_text(made(neb_text, (old, new)))
