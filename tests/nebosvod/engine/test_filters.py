"""Filters named in missions: extended ones against a plain one in the current state, all against the batch."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from nebosvod.dynamics import propagate
from nebosvod.engine.assembly import nominal_view
from nebosvod.engine.fitting import Fit, fit
from nebosvod.engine.truth import Truth, draw
from nebosvod.mission import load_mission_text
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.pipeline import run
from nebosvod.report.pages import report_text
from nebosvod.results.folder import read_folder
from nebosvod.results.result import OwnedFolder
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES, PriorTable, prior_table
from nebosvod.scene.scene import Scene, build_scene
from nebosvod.units import ARCSEC

SCHEMA = Path(__file__).resolve().parents[3] / "nebosvod" / "results" / "summary.schema.json"
PRIOR = "prior: {sigma: {position: 300 km, velocity: 0.1 m/s}}\n"
FILTERS = """estimators:
  - {name: batch, method: batch_qr}
  - {name: extended, method: ekf}
  - {name: iterated, method: iterated_ekf}
  - {name: drifting, method: hsieh_chen}
  - {name: smoothed, method: smoother}
  - {name: stages, method: two_stage}
  - {name: blind batch, method: batch_qr, treatment: {radius: considered, bias NEB-2: ignored}}
  - {name: blind extended, method: ekf, treatment: {radius: considered, bias NEB-2: ignored}}
"""
SLOW = "bias: {correlation: gauss_markov, time: 20 d}"
Made = tuple[Scene, PriorTable, View, Truth, dict[str, Fit]]


def mission_text(neb_text: str) -> str:
    """The problem of the source with a prior, a bias that drifts and one that stands still."""
    text = neb_text.replace("{longitude: 180 deg}", "{longitude: 180 deg}, " + SLOW)
    return text.replace("cadence: 6 d", "cadence: 9 d").replace("predictions:", PRIOR + FILTERS + "predictions:")


@pytest.fixture(scope="module")
def made(neb_text: str) -> Made:
    mission = load_mission_text(mission_text(neb_text))
    scene = build_scene(mission)
    priors = prior_table(mission, scene.forces, scene.state)
    nominal = nominal_view(scene)
    truth = draw(scene, priors, np.random.default_rng(1))
    return (
        scene,
        priors,
        nominal,
        truth,
        {e.name: fit(scene, e, nominal, truth.psi, priors) for e in mission.estimators},
    )


# An extended filter linearises elsewhere than the batch: second-order terms of 300 km are some 1e-4 of a sigma here.
@pytest.mark.parametrize(
    ("name", "wanted", "tolerance"),
    [
        ("extended", "batch", 1e-3),
        ("iterated", "batch", 1e-3),
        ("blind extended", "blind batch", 1e-3),
        ("drifting", "batch", 1e-9),
        ("smoothed", "batch", 1e-9),
        ("stages", "batch", 1e-9),
    ],
)
def test_without_noise_of_the_motion_the_last_estimate_is_the_batch(
    made: Made, name: str, wanted: str, tolerance: float
) -> None:
    found, right = made[-1][name], made[-1][wanted]
    assert str(found.status) == "converged"
    names = right.estimate.names
    sigma = np.sqrt(np.diag(right.estimate.K_true))
    off = np.array([found.point.values[one] - right.point.values[one] for one in names])
    assert np.abs(off / sigma).max() < tolerance
    for one, other in (
        (found.estimate.K_formal, right.estimate.K_formal),
        (found.estimate.K_true, right.estimate.K_true),
    ):
        assert np.abs((one - other) / np.outer(sigma, sigma)).max() < tolerance
    assert set(found.estimate.sources) == set(right.estimate.sources)


def test_the_extended_filter_is_a_plain_one_of_the_current_state(made: Made) -> None:
    """x_k and P_k carried by the equations of motion and their partials, gains by the inverse, biases beside them."""
    scene, priors, nominal, truth, fits = made
    problem, found = fits["batch"].problem, fits["extended"].filtered
    assert found is not None
    chain = problem.markov[0]  # the bias of NEB-2 drifts, that of NEB-1 stands still
    parameters = [p.name for p in scene.mission.free_parameters]
    sigma = [300.0] * 3 + [1e-4] * 3 + [priors.sigma(name) for name in parameters] + [0.05 * ARCSEC] * 4
    P = np.diag(np.array(sigma, dtype=np.float64) ** 2)
    state, beside = scene.state.copy(), np.zeros(len(parameters) + 4)
    t, white = 0.0, dict(zip(("NEB-1", "NEB-2"), problem.white))
    m = len(parameters)
    for k, t_k in enumerate(scene.exposures.t_s):
        drifts = scene.exposures.telescope_index[k] == 1
        forces = scene.forces.with_values(
            {name: nominal.point.parameters[name] + d for name, d in zip(parameters, beside)}
        )
        F, Q = np.eye(10 + m), np.zeros((10 + m, 10 + m))
        if t_k != t:
            leg = propagate(state, scene.epoch + t, np.array([t_k - t]), forces)
            F[:6, :6], F[:6, 6 : 6 + m] = leg.Phi[0], leg.zeta[0]
            state, t = leg.state[0], float(t_k)
        i = int(np.flatnonzero(chain.rows == k)[0]) if drifts else 0
        if i:
            F[6 + m : 8 + m, 6 + m : 8 + m], Q[6 + m : 8 + m, 6 + m : 8 + m] = chain.F[i], chain.Q[i]
        beside = F[6:, 6:] @ beside
        P = F @ P @ F.T + Q
        here = propagate(state, scene.epoch + t, np.zeros(1), forces)
        seen = compute(here, scene.exposures.select(np.array([k])).counted_from(scene.epoch + t))
        H = np.zeros((2, 10 + m))
        H[:, :6], H[:, 6 : 6 + m] = seen.H_x0[0], seen.H_c[0]
        span = slice(6 + m, 8 + m) if drifts else slice(8 + m, 10 + m)
        H[:, span] = np.eye(2)
        z = white["NEB-2" if drifts else "NEB-1"]
        H_z = z.H[np.flatnonzero(z.rows == k)[0]]
        V = H @ P @ H.T + seen.noise[0] + H_z @ (9.0 * np.eye(3)) @ H_z.T
        v = truth.psi[k] - seen.psi[0]
        v = v * np.array([np.cos(seen.psi[0, 1]), 1.0]) - beside[span.start - 6 : span.stop - 6]
        gain = P @ H.T @ np.linalg.inv(V)  # noqa: TID251
        step = gain @ v
        state, beside = state + step[:6], beside + step[6:]
        P = P - gain @ V @ gain.T
        own = np.sqrt(np.diag(P))
        assert np.abs((found.now.state[k] - state) / own[:6]).max() < 1e-4
        np.testing.assert_allclose(np.linalg.norm(found.now.factor[k], axis=1), own[:6], rtol=1e-4)
        np.testing.assert_allclose(found.innovation_sigma[k], np.sqrt(np.diag(V)), rtol=1e-4)
        assert np.abs(found.innovation[k] / np.sqrt(np.diag(V)) - v / np.sqrt(np.diag(V))).max() < 1e-3
        if drifts:  # what stands still is compared at the end
            place = found.names.index("bias NEB-2 RA*")
            np.testing.assert_allclose(found.now.sigma[k, place : place + 2], own[6 + m : 8 + m], rtol=1e-4)
            assert np.abs(found.now.beside[k, place : place + 2] - beside[m : m + 2]).max() < 1e-3 * own[6 + m]
    place = found.names.index("bias NEB-1 RA*")
    np.testing.assert_allclose(found.now.sigma[-1, place : place + 2], own[8 + m : 10 + m], rtol=1e-4)


def test_all_filters_tell_one_history(made: Made) -> None:
    fits = made[-1]
    wanted = fits["smoothed"].filtered
    assert wanted is not None
    for name in ("extended", "iterated", "drifting", "stages"):
        found = fits[name].filtered
        assert found is not None
        sigma = np.linalg.norm(wanted.now.factor, axis=2)
        for one, other in ((found.now, wanted.now), (found.smoothed, wanted.smoothed)):
            assert np.abs((one.state - other.state) / sigma).max() < 1e-3
            order = [found.names.index(each) for each in wanted.names]
            assert np.abs((one.beside[:, order] - other.beside) / other.sigma).max() < 1e-3
            np.testing.assert_allclose(one.sigma[:, order], other.sigma, rtol=1e-3)
        assert found.nis.sum() == pytest.approx(wanted.nis.sum(), rel=1e-3)
    assert wanted.nis.sum() == pytest.approx(fits["batch"].estimate.chi2, rel=1e-6)
    last = np.array([wanted.smoothed.sigma[0], wanted.now.sigma[-1]])
    assert (last[0] <= wanted.now.sigma[0]).all()  # smoothing never loses


def test_the_two_stages_blend_into_the_state(made: Made) -> None:
    found = made[-1]["drifting"].filtered
    assert found is not None
    assert found.free_state is not None
    assert found.blend is not None
    assumed = made[2].point.values
    order = [found.names.index(name) for name in found.blended]
    off = found.now.beside[:, order] - np.array([assumed.get(name, 0.0) for name in found.blended])
    blended = found.free_state + np.einsum("nab,nb->na", found.blend, off)
    assert np.abs((blended - found.now.state) / np.linalg.norm(found.now.factor, axis=2)).max() < 1e-6


SMALL = """prior: {sigma: {position: 300 km, velocity: 0.1 m/s}}
estimators:
  - {name: extended, method: ekf}
  - {name: drifting, method: hsieh_chen}
"""


def test_a_run_keeps_the_histories_of_its_filters(minimal_text: str, tmp_path: Path) -> None:
    text = minimal_text.replace("{lead: -10 deg}", "{lead: -10 deg}, " + SLOW).replace("cadence: 1 d", "cadence: 3 d")
    result = run(load_mission_text(text[: text.index("predictions:")] + SMALL))
    jsonschema.validate(json.loads(result.summary_text()), json.loads(SCHEMA.read_text("utf-8")))
    arrays, n = result.arrays, result.summary["n_observations"]
    assert arrays["filter_factor_extended"].shape == (n, 6, 6)
    names = arrays["filter_names_drifting"].tolist()
    assert "bias behind RA*_arcsec" in names
    column = names.index("bias behind RA*_arcsec")
    table = result.tables["filter_drifting"].columns
    np.testing.assert_array_equal(table["bias behind RA*_arcsec"], arrays["filter_beside_drifting"][:, column])
    assert 0.01 < arrays["filter_beside_sigma_drifting"][-1, column] < 0.05  # arcsec
    np.testing.assert_array_equal(table["x_km"], arrays["filter_state_drifting"][:, 0])
    assert arrays["blend_drifting"].shape == (n, 6, len(arrays["blend_names_drifting"]))
    assert "filter_extended" in result.tables
    assert "sigma_history_extended" in result.tables
    freedom = 2 * n
    mean = arrays["nis_drifting"].sum() / freedom
    told = next(one for one in result.summary["estimators"] if one["name"] == "drifting")["innovations"]
    assert told["nis_mean"] == pytest.approx(mean)
    assert told["nis_interval_99"][0] < 1.0 < told["nis_interval_99"][1]
    folder = tmp_path / "run"
    with OwnedFolder(folder, report_text) as owned:
        owned.publish(result)
    assert "after each measurement: position sigma, the bias it follows" in report_text(folder)
    assert read_folder(folder).array("filter_t_s", "extended") is not None


def test_an_extended_filter_that_loses_the_orbit_says_so(minimal_text: str) -> None:
    wide = SMALL.replace("position: 300 km, velocity: 0.1 m/s", "position: 3e7 km, velocity: 3 km/s")
    mission = load_mission_text(minimal_text.replace("predictions:", wide + "predictions:"))
    scene = build_scene(mission)
    priors, nominal = prior_table(mission, scene.forces, scene.state), nominal_view(scene)
    psi = draw(scene, priors, np.random.default_rng(1)).psi + 0.5  # half a radian from where the orbit may be
    found = fit(scene, mission.estimators[0], nominal, psi, priors)
    assert str(found.status) == "diverged"
    assert "lost the orbit" in found.message or "sigmas from the minimum" in found.message


def test_where_an_orbit_is_little_known_the_extended_filter_says_that_it_failed_and_the_iterated_one_does_not(
    minimal_text: str,
) -> None:
    """From 0.007 au and 300 m/s: one linearisation of each measurement ends 61 sigmas off; iterated it is the batch."""
    wide = SMALL.replace("position: 300 km, velocity: 0.1 m/s", "position: 1e6 km, velocity: 300 m/s")
    wide = wide.replace("{name: drifting, method: hsieh_chen}", "{name: iterated, method: iterated_ekf}")
    wide += "  - {name: batch, method: batch_qr}\n"
    mission = load_mission_text(minimal_text.replace("predictions:", wide + "predictions:"))
    scene = build_scene(mission)
    priors, nominal = prior_table(mission, scene.forces, scene.state), nominal_view(scene)
    truth = draw(scene, priors, np.random.default_rng(1))
    extended, iterated, right = (fit(scene, e, nominal, truth.psi, truth.priors) for e in mission.estimators)
    assert str(extended.status) == "diverged"
    assert "sigmas from the minimum of the cost" in extended.message
    assert str(iterated.status) == "converged"
    sigma = np.array([right.estimate.sigma(name) for name in STATE_NAMES])
    assert np.abs((iterated.point.state - right.point.state) / sigma).max() < 0.5
    assert np.abs((extended.point.state - right.point.state) / sigma).max() > 10.0
