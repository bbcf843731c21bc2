"""Truth declared beside the assumption: gains by the one, errors by the other; dense algebra, drawn truths."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from nebosvod.cli import main
from nebosvod.engine.assembly import computed_psi, linear_problem
from nebosvod.engine.fitting import Fit, fit
from nebosvod.engine.montecarlo import repeat
from nebosvod.errors import InputError
from nebosvod.estimation import LinearProblem
from nebosvod.mission import Mission, load_mission, load_mission_text
from nebosvod.pipeline import run
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES, PriorTable
from nebosvod.scene.scene import Scene
from nebosvod.studies.validation import validate

Array = npt.NDArray[np.float64]
Setting = tuple[Scene, PriorTable, View]
ARCSEC = np.pi / 648000.0
RUNS, SEED = 300, 7
LEVEL = 0.01 / 13  # 1 % for the family of the tests below
NOISE, BIAS = "noise: {sigma: 0.1 arcsec}", "bias: {sigma: 0.05 arcsec, treatment: estimated}"
WHITE = "position: {sigma: 3 km, correlation: white, treatment: estimated}"
RADIUS = "radius: {value: 10 m, sigma: 2 m, treatment: estimated}"
END = "predictions:\n"
PRIOR = "prior: {sigma: {position: 30 km, velocity: 0.01 m/s}, true: {TWIN}}\n"
# what is replaced, by what; the sources that shift the estimate
KINDS = {
    "noise": (NOISE, "noise: {sigma: 0.1 arcsec, true: {sigma_ra: 0.3 arcsec, mean_ra: 0.05 arcsec, "
                     "mean_dec: -0.1 arcsec}}"),
    "bias": (BIAS, "bias: {sigma: 0.05 arcsec, mean_ra: 0.02 arcsec, treatment: estimated, true: {sigma: 0.2 arcsec, "
                   "mean_ra: 0.3 arcsec}}"),
    "bias left out": (BIAS, "bias: {sigma: 0.05 arcsec, treatment: considered, true: {sigma: 0.1 arcsec, "
                            "mean_dec: 0.2 arcsec}}"),
    "drifting bias": (BIAS, "bias: {sigma: 0.05 arcsec, correlation: gauss_markov, time: 4 d, treatment: estimated, "
                            "true: {sigma: 0.15 arcsec, time: 15 d, mean_ra: 0.1 arcsec}}"),
    "white position": (WHITE, "position: {sigma: 3 km, correlation: white, treatment: estimated, true: {sigma: 30 km, "
                              "mean: [10 km, -5 km, 3 km]}}"),
    "constant position": (WHITE, "position: {sigma: 3 km, correlation: constant, frame: rtn, treatment: ignored, "
                                 "true: {sigmas: [10 km, 20 km, 5 km], mean: [0 km, 30 km, 0 km]}}"),
    "clock": (WHITE, "timing: {sigma: 1 s, treatment: estimated, true: {sigma: 3 s, mean: 5 s}}"),
    "radius": (RADIUS, "radius: {value: 10 m, sigma: 2 m, treatment: estimated, true: {value: 13 m, sigma: 1 m}}"),
    "prior": (END, PRIOR.replace("TWIN", "scale: 2, mean: {position: [40 km, 0 km, -30 km], "
                                         "velocity: [0 m/s, 0.02 m/s, 0 m/s]}") + END),
    "photocentre": (RADIUS, RADIUS + "\n  photocentre: {value: 1.0, sigma: 0.1, radius: 500 km, treatment: considered, "
                                     "true: {value: 1.2, sigma: 0.3}}"),
    "bias of another kind": (BIAS, "bias: {sigma: 0.05 arcsec, treatment: estimated, true: {correlation: gauss_markov, "
                                   "time: 6 d, sigma: 0.2 arcsec, mean_ra: 0.3 arcsec}}"),
    "position of another kind": (WHITE, "position: {sigma: 3 km, correlation: white, treatment: estimated, "
                                        "true: {correlation: constant, sigma: 20 km, mean: [10 km, -5 km, 3 km]}}"),
}  # fmt: skip


@pytest.fixture(scope="module", params=KINDS)
def made(
    request: pytest.FixtureRequest, minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> tuple[str, Setting, Fit]:
    old, new = KINDS[request.param]
    assert old in minimal.text
    scene, priors, nominal = make_setting(load_mission_text(minimal.text.replace(old, new)))
    estimator = scene.mission.estimators[0]
    return request.param, (scene, priors, nominal), fit(scene, estimator, nominal, computed_psi(nominal), priors)


def test_drawn_truths_scatter_by_k_true_about_the_shift(made: tuple[str, Setting, Fit]) -> None:
    kind, (scene, priors, nominal), found = made
    sample = repeat(scene, scene.mission.estimators[0], nominal, priors, RUNS, SEED)
    names = (*STATE_NAMES, "radius_m")
    factor, size = sample.reference.factor(names), len(names)
    assert sample.factors is None
    assert sample.names[:size] == names
    off = found.mean_errors.shift(found.estimate, names)
    mean = np.linalg.solve(factor, sample.errors[:, :size].mean(axis=0) - off) * np.sqrt(RUNS)
    low, high = stats.chi2.ppf([LEVEL / 4, 1.0 - LEVEL / 4], size)
    assert low < mean @ mean < high
    y = np.linalg.solve(factor, (sample.errors[:, :size] - off).T)
    low, high = stats.chi2.ppf([LEVEL / 4, 1.0 - LEVEL / 4], size * RUNS)
    assert low < np.sum(y**2) < high
    # the test proves something: the shift is seen, and the estimator's own covariance is not it
    assert np.linalg.norm(np.linalg.solve(factor, off)) > 0.3, kind
    formal = np.sqrt(np.diag(sample.reference.K_formal)[:size])
    assert np.max(np.abs(np.log(np.sqrt(np.diag(factor @ factor.T)) / formal))) > 0.05


def test_the_shift_of_each_source_is_the_dense_gain_times_its_mean(made: tuple[str, Setting, Fit]) -> None:
    kind, (scene, priors, nominal), found = made
    problem = linear_problem(
        scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors, about=nominal.point
    )
    H, W, P = dense(problem)
    information = H.T @ W @ H + P
    size = 1.0 / np.sqrt(np.diag(information))
    scaled = np.linalg.solve(information * size[:, None] * size, np.eye(len(size)))
    K = scaled * size[:, None] * size
    gain = K @ H.T @ W
    names = problem.names("estimated")
    unit = np.sqrt(np.diag(K))
    moved = np.zeros(len(names))
    for source, what in expected(kind, problem, scene, nominal):
        shift = gain @ what[0] - K @ P @ what[1]
        moved += shift
        said = found.mean_errors.by_source(found.estimate, names)[source]
        assert said / unit == pytest.approx(shift / unit, abs=2e-3 * np.abs(shift / unit).max()), source
    assert np.abs(moved / unit).max() > 0.05


def dense(problem: LinearProblem) -> tuple[Array, Array, Array]:
    """Partials (2n, s), weights (2n, 2n) and prior information (s, s)."""
    n = problem.n
    names = problem.names("estimated")
    H = np.hstack([b.H.reshape(2 * n, -1) for b in problem.blocks if b.treatment == "estimated"])
    R = np.zeros((2 * n, 2 * n))
    for i in range(n):
        R[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = np.broadcast_to(problem.R, (n, 2, 2))[i]
    for white in (one for one in problem.white if one.treatment == "estimated"):
        for k, row in enumerate(white.rows):
            own = slice(2 * row, 2 * row + 2)
            R[own, own] += white.H[k] @ np.broadcast_to(white.Q, (len(white.rows), 3, 3))[k] @ white.H[k].T
    for chain in (one for one in problem.markov if one.treatment == "estimated"):
        C = chain.P0
        for a, row in enumerate(chain.rows):
            F = np.eye(2)
            for b in range(a, len(chain.rows)):
                F = chain.F[b] @ F if b > a else F
                cross = chain.H[a] @ C @ F.T @ chain.H[b].T
                R[2 * row : 2 * row + 2, 2 * chain.rows[b] : 2 * chain.rows[b] + 2] += cross
                if b > a:
                    R[2 * chain.rows[b] : 2 * chain.rows[b] + 2, 2 * row : 2 * row + 2] += cross.T
    P = np.zeros((len(names), len(names)))
    for prior in problem.priors:
        if set(prior.names) <= set(names):
            at = [names.index(one) for one in prior.names]
            P[np.ix_(at, at)] = np.linalg.solve(prior.covariance, np.eye(len(at)))
    return H, np.asarray(np.linalg.solve(R, np.eye(2 * n))), P


def expected(kind: str, problem: LinearProblem, scene: Scene, nominal: View) -> list[tuple[str, tuple[Array, Array]]]:
    """By source: what its mean does to the measurements beyond the model (2n,), and to the parameters (s,)."""
    n, names = problem.n, problem.names("estimated")
    label = problem.noise_label
    assert label is not None
    none, still = np.zeros(2 * n), np.zeros(len(names))
    columns = {name: b.H[:, :, k].ravel() for b in problem.blocks for k, name in enumerate(b.names)}

    def parameter(*means: tuple[str, float]) -> tuple[Array, Array]:
        caused, inside = none.copy(), still.copy()
        for name, value in means:
            if name in names:
                inside[names.index(name)] = value
            else:
                caused = caused + value * columns[name]
        return caused, inside

    def rows(number: int, values: Array) -> tuple[Array, Array]:
        return ((label == number)[:, None] * values).ravel(), still

    each = list(enumerate(("ahead", "behind")))
    if kind == "noise":
        return [(f"measurement noise {one}", rows(k, np.array([0.05, -0.1]) * ARCSEC)) for k, one in each]
    if kind == "bias":
        return [(f"bias {one}", parameter((f"bias {one} RA*", 0.28 * ARCSEC))) for _, one in each]
    if kind == "bias of another kind":
        return [(f"bias {one}", parameter((f"bias {one} RA*", 0.3 * ARCSEC))) for _, one in each]
    if kind == "bias left out":
        return [(f"bias {one}", parameter((f"bias {one} Dec", 0.2 * ARCSEC))) for _, one in each]
    if kind == "drifting bias":
        return [(f"bias {one}", rows(k, np.array([0.1, 0.0]) * ARCSEC)) for k, one in each]
    if kind in ("white position", "position of another kind"):
        moved = nominal.observation.H_z @ np.array([10.0, -5.0, 3.0])
        return [(f"telescope position {one}", rows(k, moved)) for k, one in each]
    if kind == "constant position":
        return [(f"telescope position {one}", parameter((f"telescope position {one} transverse", 30.0)))
                for _, one in each]  # fmt: skip
    if kind == "clock":
        return [(f"timing {one}", parameter((f"timing {one}", 5.0))) for _, one in each]
    if kind == "radius":
        return [("radius", parameter(("radius_m", 3.0)))]
    if kind == "photocentre":
        return [("photocentre", parameter(("photocentre amplitude", 0.2)))]
    return [("prior orbit", parameter(("x_km", 40.0), ("z_km", -30.0), ("vy_km_s", 2e-5)))]


@pytest.mark.parametrize("kind", ["bias of another kind", "position of another kind"])
def test_a_truth_of_another_kind_is_that_of_dense_algebra(
    kind: str, minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    """Gains by the assumption, the truth's covariance of all measurements beside: it fades, or it does not."""
    scene, priors, nominal = make_setting(load_mission_text(minimal.text.replace(*KINDS[kind])))
    found = fit(scene, scene.mission.estimators[0], nominal, computed_psi(nominal), priors)
    problem, seen = found.problem, nominal.observation
    H, W, P = dense(problem)
    names = problem.names("estimated")
    unit = 1.0 / np.sqrt(np.diag(H.T @ W @ H + P))
    K = np.linalg.solve((H.T @ W @ H + P) * unit[:, None] * unit, np.eye(len(unit))) * unit[:, None] * unit
    gain = K @ H.T @ W
    n, mine = problem.n, seen.telescope_index[:, None] == seen.telescope_index
    truth = (0.1 * ARCSEC) ** 2 * np.eye(2 * n)
    if kind == "bias of another kind":
        fading = np.exp(-np.abs(seen.t_s[:, None] - seen.t_s) / (6.0 * 86400.0)) * mine
        truth += (0.2 * ARCSEC) ** 2 * np.kron(fading, np.eye(2))
        truth += 9.0 * np.einsum("iak,ij,jbk->iajb", seen.H_z, np.eye(n), seen.H_z).reshape(2 * n, 2 * n)
    else:
        truth += 400.0 * np.einsum("iak,ij,jbk->iajb", seen.H_z, mine.astype(float), seen.H_z).reshape(2 * n, 2 * n)
    inside = P.copy()  # P Sigma_true P of what is estimated: the bias that was assumed is not there
    if kind == "bias of another kind":
        gone = [k for k, name in enumerate(names) if name.startswith("bias")]
        inside[gone] = 0.0
    whole = gain @ truth @ gain.T + K @ inside @ K
    sigma = np.sqrt(np.diag(whole))
    assert found.estimate.covariance(names) / sigma / sigma[:, None] == pytest.approx(
        whole / sigma / sigma[:, None], abs=1e-5
    )
    assert np.max(sigma / np.sqrt(np.diag(K))) > 1.3  # and it matters
    assert any(name.endswith(" in truth") for name in found.estimate.shares)


def test_a_run_shows_the_shift_by_each_source(
    minimal: Mission, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Summary, terminal and page; with a truth declared that is the assumption, nothing differs and nothing is told."""
    old, new = KINDS["bias left out"]
    text = minimal.text.replace(old, new)
    (tmp_path / "off.yaml").write_text(text)
    assert main(["run", str(tmp_path / "off.yaml"), "-o", str(tmp_path / "off")]) == 0
    assert "Shift of batch by each source" in capsys.readouterr().out
    summary = json.loads((tmp_path / "off" / "summary.json").read_text())
    rows, first = summary["shifts"], summary["estimators"][0]
    assert {row["source"] for row in rows} == {"bias ahead", "bias behind"}
    together = np.sum([row["shift_position_km"] for row in rows], axis=0)
    assert together == pytest.approx(first["mean_error_km_km_s"][:3])
    asked = summary["predictions"][0]
    moved = np.sum([row["predictions"][0]["shift_km"] for row in rows], axis=0)
    assert moved == pytest.approx(asked["mean_error_km"])
    assert "table-shifts" in (tmp_path / "off" / "report.html").read_text()
    same = minimal.text.replace(BIAS, "bias: {sigma: 0.05 arcsec, treatment: estimated, true: {sigma: 0.05 arcsec}}")
    before, after = run(minimal, seed=3).summary, run(load_mission_text(same), seed=3).summary
    assert before["estimators"] == after["estimators"]
    assert "shifts" not in after


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (BIAS, "bias: {sigma: 0.05 arcsec, treatment: fixed, true: {sigma: 1 arcsec}}", "fixed"),
        (BIAS, "bias: {sigma: 0.05 arcsec, treatment: estimated, true: {}}", "says nothing"),
        (BIAS, "bias: {sigma: 0.05 arcsec, treatment: estimated, true: {drift: 1 arcsec/d}}", "drift only"),
        (BIAS, "bias: {sigma: 0.05 arcsec, treatment: estimated, true: {correlation: per_arc}}", "gap: is missing"),
        (
            BIAS,
            "bias: {sigma: 0.05 arcsec, treatment: estimated, true: {correlation: constant, zone: 5 deg}}",
            "true.zone: belongs to",
        ),
        (
            WHITE,
            "position: {sigma: 3 km, correlation: white, treatment: estimated, "
            "true: {correlation: orbit_error, sigma: 1 km}}",
            "true.velocity_sigma: is missing",
        ),
        (BIAS, "bias: {treatment: estimated, true: {sigma: 1 arcsec}}", "needs a sigma beside it"),
        (WHITE, "position: {sigma: 3 km, correlation: white, treatment: estimated, true: {time: 1 d}}", "gauss_markov"),
        (RADIUS, "radius: {value: 10 m, true: {value: 12 m}}", "fixed"),
        (NOISE, "noise: {sigma: 0.1 arcsec, true: {sigma: 0 arcsec}}", "out of range"),
        (NOISE, "noise: {sigma: 0.1 arcsec, true: {sigma: 1 arcsec, sigma_ra: 2 arcsec}}", "keep either"),
    ],
)
def test_a_twin_that_means_nothing_is_refused_at_its_line(old: str, new: str, said: str, minimal: Mission) -> None:
    with pytest.raises(InputError, match=said) as caught:
        load_mission_text(minimal.text.replace(old, new))
    assert "true" in str(caught.value)


def test_a_fit_has_no_declared_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = """schema_version: 1
name: fit
fit:
  observations: [made.obs80]
  uncertainty: [{stations: all, bias: {sigma: 0.1 arcsec, treatment: considered, true: {sigma: 1 arcsec}}}]
"""
    (tmp_path / "made.obs80").write_text("")
    (tmp_path / "fit.yaml").write_text(settings)
    assert main(["check", str(tmp_path / "fit.yaml")]) == 2
    assert "not declared" in capsys.readouterr().err


def test_a_campaign_does_not_claim_what_the_estimator_believes(minimal: Mission, tmp_path: Path) -> None:
    """All is estimated, and a position error is larger than assumed: K_true is honest, K_formal is not claimed."""
    old, new = KINDS["white position"]
    path = tmp_path / "m.yaml"
    path.write_text(minimal.text.replace(old, new), "utf-8")
    found = validate(load_mission(path), tmp_path / "v", runs=60)
    (one,) = found["estimators"]
    assert one["passed"], found["verdict"]
    assert one["judged"]["true"]["consistent"]
    assert not one["judged"]["formal"]["consistent"]
