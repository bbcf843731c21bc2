"""Monte Carlo and `validate` where one linear step does not do: a right covariance passes, whatever is left out."""

import itertools
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats
from scipy.integrate import solve_ivp

import nebosvod
from nebosvod.cli import main
from nebosvod.dynamics import propagate
from nebosvod.engine.montecarlo import repeat, state_nees
from nebosvod.engine.trial import LINEAR_SIGMA, Setting, generator, measured_truth, possible, second_order
from nebosvod.mission import Mission, load_mission, load_mission_text
from nebosvod.mission.reading.builtin import builtin_names
from nebosvod.observation import observe, residual
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES, PriorTable
from nebosvod.scene.scene import Scene
from nebosvod.studies.campaign import Campaign, compute_chunk, passes
from nebosvod.studies.validation import summary, validate

Array = npt.NDArray[np.float64]
SCHEMA = json.loads((Path(nebosvod.__file__).parent / "studies" / "validation.schema.json").read_text("utf-8"))
SEED = 20290413
WIDE = "prior: {sigma: {position: 1000 km, velocity: 0.2 m/s}}\n"
IGNORED = """estimators:
  - {name: full, method: batch_qr}
  - {name: bias ignored, method: batch_qr, treatment: {bias: ignored}}
"""
GROUPS = ("radius", "mass", "albedo", "bias", "position")
TREATMENTS = ("estimated", "considered", "ignored", "fixed")
LEAST_SQUARES = ("batch_qr", "batch_blocks", "batch_identity", "recursive", "two_stage", "hsieh_chen", "ekf")
OWN_GAIN = ("schmidt", "as_printed")


def judged_here(mission: Mission, runs: int, full: bool | None = None) -> dict[str, Any]:
    """A campaign inside this process, without a folder; iterated where a linear step would not do, or as told."""
    setting = Setting.of(mission)
    left_out = second_order(setting, SEED) if full is None else 0.0
    iterates = left_out > LINEAR_SIGMA if full is None else full
    campaign = Campaign.of(mission, SEED, iterates, setting.nominal.observation.t_s.size)
    return summary(setting, campaign, runs, compute_chunk(setting, passes(setting), campaign, range(runs)), left_out)


def test_a_wide_prior_passes_by_iteration_and_the_innovations_of_each_estimate(neb_text: str, tmp_path: Path) -> None:
    """One linear step made NEES/6 14.6 of it; the innovations at the reference orbit refused what was left."""
    path = tmp_path / "neb.yaml"
    path.write_text(neb_text + WIDE + IGNORED, "utf-8")
    assert main(["validate", str(path), "-n", "60", "-o", str(tmp_path / "v"), "--seed", "1"]) == 0
    found = json.loads((tmp_path / "v" / "validation.json").read_text("utf-8"))
    jsonschema.Draft202012Validator(SCHEMA).validate(found)
    assert found["mode"] == "full"
    assert found["second_order_sigma"] > 1.0
    full, ignored = found["estimators"]
    low, high = stats.chi2.ppf([0.0005, 0.9995], 60 * 6) / (60 * 6)
    for row in (full, ignored):
        assert row["n_failed"] == 0
        assert low < row["judged"]["true"]["nees"]["value"] < high
        assert [abs(nis["value"] - 1.0) < 0.1 for nis in row["judged"]["true"]["nis"]] == [True, True]
    assert not ignored["judged"]["formal"]["consistent"]


def test_the_monte_carlo_of_a_run_is_iterated_too(
    neb_text: str, make_setting: Callable[[Mission], tuple[Scene, PriorTable, View]]
) -> None:
    scene, priors, nominal = make_setting(load_mission_text(neb_text + WIDE))
    sample = repeat(scene, scene.mission.estimators[0], nominal, priors, 80, SEED)
    block = state_nees(sample)
    assert block.iterated
    assert block.second_order_sigma > 1.0
    assert block.lost == 0
    low, high = block.nees_interval_99
    assert low < block.nees_mean < high
    # in sigmas of its own covariance each error of the position is standard normal
    W = np.eye(3)
    square = sample.scatter(W, STATE_NAMES[:3], np.ones(3))
    assert np.all((stats.chi2.ppf(0.001, 80) < square) & (square < stats.chi2.ppf(0.999, 80)))


def test_a_linear_mission_stays_linear(minimal: Mission) -> None:
    found = judged_here(minimal, 20)
    assert found["mode"] == "linear"
    assert found["second_order_sigma"] < 1e-3


ALIKE = [dict.fromkeys(GROUPS, treatment) for treatment in TREATMENTS]
ALONE = [{group: treatment} for group, treatment in itertools.product(GROUPS, TREATMENTS[1:])]


@pytest.mark.parametrize("method", [*LEAST_SQUARES, *OWN_GAIN])
def test_every_mix_of_treatments_comes_to_a_verdict_by_every_method(minimal_text: str, method: str) -> None:
    """Five iterated runs: enough for every array; an estimator that denies what the truth has is refused, none else."""
    mixes = ALIKE + (ALONE if method in ("batch_qr", "schmidt") else ALONE[::4])
    if method in ("two_stage", "hsieh_chen"):
        mixes = [mix for mix in mixes if mix not in ALIKE[1:]]  # there is nothing to separate
    treatments = (", ".join(f"{group}: {how}" for group, how in mix.items()) for mix in mixes)
    estimators = "".join(
        f"  - {{name: e{number}, method: {method}, treatment: {{{treatment}}}}}\n"
        for number, treatment in enumerate(treatments)
    )
    text = minimal_text.replace("predictions:", f"{WIDE}estimators:\n{estimators}predictions:")
    found = judged_here(load_mission_text(text), 5, full=True)
    for row, mix in zip(found["estimators"], mixes, strict=True):
        assert row["n_failed"] == 0, (row["name"], mix)
        assert row["judged"]["true"]["consistent"] == (mix.get("bias") != "fixed"), (row["name"], mix)


def test_a_mission_without_predictions_and_what_init_writes_come_to_a_verdict(tmp_path: Path) -> None:
    assert main(["init", str(tmp_path / "mine.yaml")]) == 0
    text = (tmp_path / "mine.yaml").read_text("utf-8")
    bare = text[: text.index("predictions:")] + "predictions: []\n"
    (tmp_path / "bare.yaml").write_text(bare, "utf-8")
    for name in ("mine", "bare"):
        path, folder = str(tmp_path / f"{name}.yaml"), str(tmp_path / name)
        assert main(["validate", path, "--full", "-n", "20", "-o", folder]) == 0
        found = json.loads((tmp_path / name / "validation.json").read_text("utf-8"))
        jsonschema.Draft202012Validator(SCHEMA).validate(found)
        assert found["passed"]


def test_a_campaign_in_which_no_run_gives_an_estimate_is_a_verdict(minimal_text: str, tmp_path: Path) -> None:
    """One iteration is never enough to be called converged."""
    path = tmp_path / "m.yaml"
    once = "estimators: [{name: once, method: batch_qr, iterations: 1}]\n"
    path.write_text(minimal_text.replace("predictions:", once + "predictions:"), "utf-8")
    assert main(["validate", str(path), "--full", "-n", "20", "-o", str(tmp_path / "v")]) == 1
    (row,) = json.loads((tmp_path / "v" / "validation.json").read_text("utf-8"))["estimators"]
    assert row["n_failed"] == 20
    assert row["reason"] == "20 of 20 runs gave no estimate"


def widened(name: str, factor: float) -> str:
    """A built-in mission with a prior so many times as wide as its result."""
    text = load_mission(name).text
    K = Setting.of(load_mission(name)).estimating[0].reference.covariance(STATE_NAMES)
    position, velocity = (factor * np.sqrt(np.trace(part)) for part in (K[:3, :3], K[3:, 3:]))
    prior = f"prior: {{sigma: {{position: {position:.6g} km, velocity: {velocity:.6g} km/s}}}}\n"
    return re.sub(r"^prior: none.*\n", "", text, flags=re.MULTILINE) + "\n" + prior


@pytest.mark.parametrize(("name", "runs", "mode"), [("minimal", 300, "linear"), ("apophis-heliocentric", 24, "full")])
def test_a_prior_a_hundred_times_as_wide_as_the_result_passes(name: str, runs: int, mode: str) -> None:
    found = judged_here(load_mission_text(widened(name, 100.0)), runs)
    assert found["passed"], found["verdict"]
    assert found["mode"] == mode


@pytest.mark.long
@pytest.mark.parametrize("factor", [1.0, 10.0, 100.0])
@pytest.mark.parametrize("name", builtin_names())
def test_built_in_missions_with_wider_priors_pass(name: str, factor: float, tmp_path: Path) -> None:
    path = tmp_path / "wide.yaml"
    path.write_text(widened(name, factor), "utf-8")
    found = validate(load_mission(str(path)), tmp_path / "v", runs=500, seed=SEED, workers=len(os.sched_getaffinity(0)))
    assert found["passed"], found["verdict"]


DENSE = """schema_version: 1
name: dense
reference_epoch: 2028-03-20T00:00:00 TDB
object:
  name: Example
  orbit: {kind: keplerian, frame: ecliptic_j2000, epoch: 2028-03-20T00:00:00 TDB, a: 1.3 au, e: 0.2, i: 8 deg,
          node: 0 deg, peri: 180 deg, M: 0 deg}
  radius: {value: 10 m, sigma: 1 m, distribution: lognormal, treatment: considered}
  mass: {value: 8e5 kg, sigma: 1e3 kg, treatment: ignored}
  albedo: {value: 0.15, treatment: fixed}
  nongrav: {A2: {value: 0 au/d^2, treatment: estimated}}
telescopes:
  - name: ahead
    orbit: {kind: heliocentric, lead: 10 deg}
    noise: {sigma: 0.05 arcsec}
    bias: {sigma: 0.2 arcsec, mean_ra: 0.7 arcsec, mean_dec: -0.4 arcsec, treatment: ignored}
    position: {sigma: 40 km, velocity_sigma: 30 mm/s, correlation: orbit_error, treatment: considered}
  - {name: behind, like: ahead, orbit: {lead: -10 deg}, bias: {sigma: 0.1 arcsec, mean_ra: 0 arcsec,
                                                                   mean_dec: 0 arcsec, treatment: considered}}
shared:
  - {name: catalogue, telescopes: all, bias: {sigma: 0.15 arcsec, mean_ra: 0.1 arcsec, treatment: ignored}}
schedule: [{start: 2028-03-20T00:00:00 TDB, end: 2028-04-19T00:00:00 TDB, cadence: 5 d}]
prior:
  covariance: [[900, 300, 0, 0, 0, 0, 0], [300, 400, 0, 0, 0, 0, 0], [0, 0, 100, 0, 0, 0, 0],
               [0, 0, 0, 4e-10, 0, 0, 2e-18], [0, 0, 0, 0, 4e-10, 0, 0], [0, 0, 0, 0, 0, 4e-10, 0],
               [0, 0, 0, 2e-18, 0, 0, 4e-26]]
  names: [x, y, z, vx, vy, vz, A2]
  frame: icrf
  epoch: 2028-02-19T00:00:00 TDB
"""
EARLIER_S = -30 * 86400.0
ARCSEC = np.pi / 648000.0


class Dense:
    """The same world without priors at the reference epoch, terms or Phi: orbits propagated from the prior's epoch."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.gm = scene, scene.ephemeris.gm_km3_s2["sun"]
        epoch = scene.epoch
        self.earlier = epoch + EARLIER_S
        back = propagate(scene.state, epoch, np.array([EARLIER_S]), scene.forces, sensitivities=False)
        self.start = back.state[0]
        self.t_s = [scene.exposures.t_s[scene.exposures.telescope_index == number] for number in range(2)]
        assert all(np.array_equal(times, np.arange(7) * 5 * 86400.0) for times in self.t_s)

    def sky(self, moved: Array, A2: float = 0.0, ln_radius: float = 0.0, mass_kg: float = 0.0) -> Array:
        """Directions (7, 2, 2) by time and telescope of an orbit that deviates at the prior's epoch."""
        forces = self.scene.forces.with_values(
            {"a2_au_d2": A2, "ln_radius": np.log(10.0) + ln_radius, "mass_kg": 8e5 + mass_kg}
        )
        end = np.array([-86400.0, -EARLIER_S + 32 * 86400.0])
        orbit = propagate(self.start + moved, self.earlier, end, forces)
        seen = [
            observe(orbit, telescope, times - EARLIER_S, self.scene.ephemeris).psi
            for telescope, times in zip(self.scene.telescopes, self.t_s)
        ]
        return np.stack(seen, axis=1)

    def telescope_moved(self, number: int, moved: Array) -> Array:
        """Change of the direction (7, 2), cos Dec dRA and dDec, by an error of a telescope's state at the start."""
        seen = observe(self.scene.trajectory, self.scene.telescopes[number], self.t_s[number], self.scene.ephemeris)
        sun = self.scene.ephemeris.state_km_km_s("sun", self.scene.epoch, np.zeros(1))[0]
        start = seen.telescope_state[0] - sun

        def fall(_: float, x: Array) -> Array:
            return np.concatenate([x[3:], -self.gm * x[:3] / np.linalg.norm(x[:3]) ** 3])

        span, rule = (0.0, self.t_s[number][-1]), {"t_eval": self.t_s[number], "rtol": 1e-12, "atol": 1e-9}
        paths = [solve_ivp(fall, span, start + sign * moved, **rule).y[:3].T for sign in (1.0, -1.0)]
        line = seen.u * seen.distance_km[:, None]
        angles = [np.stack([np.arctan2(r[:, 1], r[:, 0]), np.arcsin(r[:, 2] / np.linalg.norm(r, axis=1))], axis=1)
                  for r in (line - 0.5 * (paths[0] - paths[1]), line)]  # fmt: skip
        change = angles[0] - angles[1]
        return change * np.stack([np.cos(angles[1][:, 1]), np.ones(7)], axis=1)

    def moments(self) -> tuple[Array, Array]:
        """Mean (28,) and covariance (28, 28) of what is measured less what the nominal orbit would show."""
        nominal, columns = self.sky(np.zeros(6)), []
        dec = np.cos(nominal[..., 1])

        def column(sigma: float, at: Callable[[float], Array]) -> Array:
            change = 0.5 * (at(sigma) - at(-sigma))
            change[..., 0] = (change[..., 0] + np.pi) % (2.0 * np.pi) - np.pi
            return np.stack([change[..., 0] * dec, change[..., 1]], axis=-1).ravel()

        prior = np.diag([900.0, 400.0, 100.0, 4e-10, 4e-10, 4e-10, 4e-26])
        prior[0, 1] = prior[1, 0] = 300.0
        prior[3, 6] = prior[6, 3] = 2e-18
        sigma = np.sqrt(np.diag(prior))
        correlation = np.linalg.cholesky(prior / np.outer(sigma, sigma))
        unit = [column(sigma[k], lambda s, k=k: self.sky(s * np.eye(6)[k])) for k in range(6)]  # type: ignore[misc]
        unit.append(column(sigma[6], lambda s: self.sky(np.zeros(6), A2=s)))
        columns += list((np.array(unit).T @ correlation).T)
        columns.append(column(0.1, lambda s: self.sky(np.zeros(6), ln_radius=s)))
        columns.append(column(1e3, lambda s: self.sky(np.zeros(6), mass_kg=s)))
        mean = np.zeros((7, 2, 2))
        for number, spread in enumerate((0.2, 0.1)):
            for axis in range(2):
                one = np.zeros((7, 2, 2))
                one[:, number, axis] = spread * ARCSEC
                columns.append(one.ravel())
            for k in range(6):
                one = np.zeros((7, 2, 2))
                one[:, number] = self.telescope_moved(number, np.eye(6)[k] * (40.0 if k < 3 else 30e-6))
                columns.append(one.ravel())
        for axis in range(2):
            one = np.zeros((7, 2, 2))
            one[..., axis] = 0.15 * ARCSEC
            columns.append(one.ravel())
        mean[:, 0] += np.array([0.7, -0.4]) * ARCSEC
        mean[..., 0] += 0.1 * ARCSEC
        J = np.array(columns).T
        return mean.ravel(), J @ J.T + (0.05 * ARCSEC) ** 2 * np.eye(28)


def test_drawn_truths_hold_means_lognormal_joint_orbit_and_shared_errors_as_a_dense_simulation_has_them() -> None:
    """Mean and covariance of 400 drawn skies against one made from the mission's own numbers, by both ways to draw."""
    setting = Setting.of(load_mission_text(DENSE))
    dense = Dense(setting.scene)
    mean, covariance = dense.moments()
    runs, factor, nominal = 400, np.linalg.cholesky(covariance), dense.sky(np.zeros(6)).reshape(14, 2)
    for linear in (True, False):
        skies = []
        for i in range(runs):
            if linear:
                skies.append(measured_truth(setting, nominal, generator(SEED, i))[0])
            else:
                truth = possible(setting, generator(SEED, i))
                assert truth is not None
                skies.append(residual(truth.psi, nominal))
        residuals = np.array([one.ravel() for one in skies])
        white = np.linalg.solve(factor, (residuals - mean).T)
        assert np.abs(white.mean(axis=1)).max() < stats.norm.ppf(1.0 - 0.001 / 56) / np.sqrt(runs)
        low, high = stats.chi2.ppf([0.001 / 56, 1.0 - 0.001 / 56], runs)
        square = np.sum(white**2, axis=1)
        assert np.all((low < square) & (square < high))
        total = stats.chi2.ppf([0.001, 0.999], 28 * runs)
        assert total[0] < square.sum() < total[1]
        assert np.abs((white @ white.T / runs)[np.triu_indices(28, 1)]).max() < 5.0 / np.sqrt(runs)
