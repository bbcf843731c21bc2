"""The built-in mission of Guo and Ivashkin 2018: special cases and what it shows, against dense formulas in numpy."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.cli import main
from nebosvod.engine.assembly import computed_psi, nominal_view, view
from nebosvod.engine.fitting import Fit, fit
from nebosvod.engine.truth import draw
from nebosvod.findings.inside import full_gains, gains, information, nuisances, smallness
from nebosvod.mission import Mission, load_mission
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES, PriorTable, prior_table
from nebosvod.scene.scene import PlannedScene, build_scene

Array = npt.NDArray[np.float64]


class Made(NamedTuple):
    scene: PlannedScene
    priors: PriorTable
    nominal: View
    fits: dict[str, Fit]


class Dense(NamedTuple):
    """H of state, parameters, biases; R, H_z Q H_z^T, R_b, P0, S."""

    H: Array
    H_c: Array
    H_b: Array
    R: Array
    Z: Array
    R_b: Array
    P0: Array
    S: Array


def inverse(matrix: Array) -> Array:
    """By a scaled solve: the matrices join km and km/s."""
    unit = 1.0 / np.sqrt(np.diag(matrix))
    scaled = np.linalg.solve(matrix * unit[:, None] * unit, np.eye(len(unit)))
    return np.asarray(scaled * unit[:, None] * unit)


@pytest.fixture(scope="module")
def mission() -> Mission:
    return load_mission("kiam-2018")


@pytest.fixture(scope="module")
def made(mission: Mission) -> Made:
    scene = build_scene(mission)
    priors, nominal = prior_table(mission, scene.forces, scene.state), nominal_view(scene)
    psi = computed_psi(nominal)
    fits = {one.name: fit(scene, one, nominal, psi, priors, history=False) for one in mission.estimators}
    return Made(scene, priors, nominal, fits)


@pytest.fixture(scope="module")
def dense(made: Made) -> Dense:
    seen, n = made.nominal.observation, made.nominal.observation.t_s.size
    R, Z = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    arcsec = np.pi / 648000.0
    H_b = np.zeros((2 * n, 4))
    for k in range(n):
        own = slice(2 * k, 2 * k + 2)
        R[own, own] = (0.1 * arcsec) ** 2 * np.eye(2)
        Z[own, own] = 9.0 * seen.H_z[k] @ seen.H_z[k].T
        H_b[own, 2 * seen.telescope_index[k] : 2 * seen.telescope_index[k] + 2] = np.eye(2)
    P0 = np.diag(np.repeat([100.0**2, 2e-5**2], 3))
    S = np.diag(np.square([20.0, 1.5e10, 0.05]))
    H, H_c = seen.H_x0.reshape(2 * n, 6), seen.H_c.reshape(2 * n, 3)
    return Dense(H, H_c, H_b, R, Z, (0.05 * arcsec) ** 2 * np.eye(4), P0, S)


def state(m: Dense, weights: Array) -> tuple[Array, Array]:
    """K and gain of the state by some weights."""
    K = inverse(inverse(m.P0) + m.H.T @ weights @ m.H)
    return K, K @ m.H.T @ weights


def closed(case: str, m: Dense) -> tuple[Array, Array]:
    """Believed and true covariance of the state in a special case of the preprint."""
    bias = m.H_b @ m.R_b @ m.H_b.T
    if case == "2.3.3 noise only":
        K, _ = state(m, inverse(m.R))
        return K, K
    if case == "2.3.4 telescope orbits not refined":
        K, k = state(m, inverse(m.R))
        return K, K + k @ m.Z @ k.T
    if case == "2.4 bias estimated":
        K, _ = state(m, inverse(m.R + m.Z + bias))
        return K, K
    if case == "2.5 bias estimated telescope orbits ignored":
        K, k = state(m, inverse(m.R + bias))
        return K, K + k @ m.Z @ k.T
    K, k = state(m, inverse(m.R + m.Z))
    return K, K + k @ bias @ k.T


CASES = (
    "2.3.3 noise only", "2.3.4 telescope orbits not refined", "2.4 bias estimated",
    "2.5 bias estimated telescope orbits ignored", "2.6 bias ignored",
)  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_special_case_is_its_closed_formula(case: str, made: Made, dense: Dense) -> None:
    found = made.fits[case].estimate
    index = [found.names.index(name) for name in STATE_NAMES]
    formal, true = closed(case, dense)
    unit = np.sqrt(np.diag(true))
    assert found.K_formal[np.ix_(index, index)] / unit / unit[:, None] == pytest.approx(
        formal / unit / unit[:, None], abs=1e-6
    )
    assert found.covariance(STATE_NAMES) / unit / unit[:, None] == pytest.approx(true / unit / unit[:, None], abs=1e-6)


@pytest.mark.parametrize("name", ["way 1", "way 2", "recursive (2.7)"])
def test_the_three_ways_and_the_filter_agree(name: str, made: Made) -> None:
    one, other = (made.fits[key].estimate.covariance(STATE_NAMES) for key in ("way 3", name))
    unit = np.sqrt(np.diag(one))
    assert np.abs((one - other) / unit / unit[:, None]).max() < 1e-6


def whole(m: Dense, made: Made) -> tuple[Array, Array, Array]:
    """With everything estimated or considered as way 3 does: H, weights, prior information (photocentre left out)."""
    H = np.hstack([m.H, m.H_c, m.H_b])
    prior = np.zeros((13, 13))
    for first, block in ((0, m.P0), (6, m.S), (9, m.R_b)):
        prior[first : first + len(block), first : first + len(block)] = inverse(block)
    return H, inverse(m.R + m.Z), prior


def test_gains_and_information_are_those_of_dense_matrices(made: Made, dense: Dense) -> None:
    H, W, prior = whole(dense, made)
    K = inverse(H.T @ W @ H + prior)
    k = (K @ H.T @ W).reshape(13, -1, 2)
    found = gains(made.fits["way 3"])
    for name, rows in (("gain_x0", k[:6]), ("gain_c", k[6:9])):
        size = np.abs(rows).max(axis=(1, 2))
        assert np.abs((found[name] - rows) / size[:, None, None]).max() < 1e-6, name
    told = information(made.fits["way 3"].problem)
    n = len(dense.R) // 2
    D0 = dense.H.T @ dense.H / (2 * n)  # all noise is alike: sigma^2 iR = I
    unit = np.sqrt(np.diag(D0))
    assert told.D0 / unit / unit[:, None] == pytest.approx(D0 / unit / unit[:, None], abs=1e-9)
    assert told.sigma_arcsec == pytest.approx(0.1)
    K0 = (0.1 * np.pi / 648000.0) ** 2 / (2 * n) * inverse(D0)
    assert told.sigma_position_km == pytest.approx(np.sqrt(np.trace(K0[:3, :3])), rel=1e-6)


def test_refined_telescope_positions_are_those_of_one_dense_solution(made: Made, dense: Dense) -> None:
    """z of every exposure as unknowns of one least squares, with a measurement that was drawn."""
    scene, priors, nominal, _ = made
    psi = draw(scene, priors, np.random.default_rng(2), nominal.point).psi
    found = fit(scene, scene.mission.estimators[0], nominal, psi, priors, history=False)
    problem, index = found.problem, found.observation.telescope_index
    n = problem.n
    columns = {name: b.H[:, :, i].reshape(-1) for b in problem.blocks for i, name in enumerate(b.names)}
    names = problem.names("estimated")
    H = np.hstack([np.stack([columns[name] for name in names], axis=1), np.zeros((2 * n, 3 * n))])
    prior, mean = np.zeros((H.shape[1], H.shape[1])), np.zeros(H.shape[1])
    for k in range(n):
        H[2 * k : 2 * k + 2, len(names) + 3 * k : len(names) + 3 * k + 3] = found.observation.H_z[k]
        at = slice(len(names) + 3 * k, len(names) + 3 * k + 3)
        prior[at, at] = np.eye(3) / 9.0
    for one in problem.priors:
        if set(one.names) <= set(names):
            at_ = [names.index(name) for name in one.names]
            prior[np.ix_(at_, at_)] = inverse(one.covariance)
            about = np.array([found.deviation[name] for name in one.names])
            mean[at_] = -about if one.mean is None else one.mean - about
    W = inverse(dense.R)
    v = problem.residual.reshape(-1)
    K = inverse(H.T @ W @ H + prior)
    best = K @ (H.T @ W @ v + prior @ mean)
    shown, response, full = nuisances(found), gains(found), full_gains(found)
    for number, telescope in enumerate(("neb_1", "neb_2")):
        key = next(
            name for name in shown if name.startswith("z_") and name.lower().replace("-", "_").endswith(telescope)
        )
        rows = np.flatnonzero(index == number)
        place = [len(names) + 3 * k + i for k in rows for i in range(3)]
        assert shown[key].reshape(-1) == pytest.approx(best[place], abs=1e-4 * 3.0)
        for j, k in enumerate(rows.tolist()):
            own = slice(len(names) + 3 * k, len(names) + 3 * k + 3)
            assert shown[f"K_{key}"][j] == pytest.approx(K[own, own], abs=1e-5 * 9.0)
            by_own = (K @ H.T @ W)[own, 2 * k : 2 * k + 2]
            assert response[f"gain_{key}"][j] == pytest.approx(by_own, abs=1e-5 * np.abs(by_own).max())
            whole_row = (K @ H.T @ W)[own].reshape(3, n, 2)
            assert full[f"gain_z_full_{key.removeprefix('z_')}"][j] == pytest.approx(
                whole_row, abs=1e-5 * np.abs(whole_row).max()
            )


def test_smallness_is_the_bend_of_the_measurements_one_sigma_away(made: Made) -> None:
    one = made.fits["2.4 bias estimated"]
    found = smallness(made.scene, one)
    S = one.estimate.factor(STATE_NAMES)
    here = computed_psi(made.nominal)
    worst = 0.0
    for column in S.T:
        ends = [
            computed_psi(view(made.scene, made.nominal.point.moved(dict(zip(STATE_NAMES, sign * column)))))
            for sign in (-1.0, 1.0)
        ]
        bend = 0.5 * (ends[0] + ends[1]) - here
        bend[:, 0] *= np.cos(here[:, 1])
        worst = max(worst, float(np.abs(bend).max() / (0.1 * np.pi / 648000.0)))
    assert found.largest == pytest.approx(worst, rel=1e-3)
    assert found.small


def test_a_run_shows_all_that_the_preprint_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "kiam-2018", "-o", str(tmp_path / "kiam")]) == 0
    assert "2.6 bias ignored reports" in capsys.readouterr().out
    summary = json.loads((tmp_path / "kiam" / "summary.json").read_text())
    with np.load(tmp_path / "kiam" / "arrays.npz") as arrays:
        assert set(summary["inside"]["arrays"]) <= set(arrays)
        assert arrays["gain_x0"].shape == (6, 98, 2)
    assert {"D0", "gain_x0", "gain_c"} <= set(summary["inside"]["arrays"])
    assert summary["inside"]["smallness"]["small"]
    counted = summary["curves"][0]["measurements"]
    assert {"noise_only_km", "noise_and_prior_km", "all_km", "prior_only_km"} <= set(counted)
    assert "20_dB" in summary["noise_to_nuisance"]["sigma_z_limit_km"]
    assert "table-inside" in (tmp_path / "kiam" / "report.html").read_text()
