"""Every kind of uncertainty a mission can say: K_true is the covariance of 300 repeated estimates, however treated."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from nebosvod.engine.assembly import linear_problem
from nebosvod.engine.montecarlo import repeat
from nebosvod.estimation.solvers import batch
from nebosvod.mission import Mission, load_mission_text
from nebosvod.scene.point import View
from nebosvod.scene.prior import STATE_NAMES, PriorTable
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]
Setting = tuple[Scene, PriorTable, View]
RUNS, SEED = 300, 20300215
LEVEL = 0.01 / 33  # 1 % for the whole family of 33 tests; Bonferroni over the components of each
WHITE = "    position: {sigma: 3 km, correlation: white, treatment: estimated}\n"
BIAS = "    bias: {sigma: 0.05 arcsec, treatment: estimated}\n"
# the block that replaces one of the smallest mission, large enough to be felt beside 0.1 arcsec of noise
KINDS = {
    "constant position": (WHITE, "position: {sigma: 30 km, correlation: constant, frame: rtn, treatment: T}"),
    "orbit error": (WHITE, "position: {sigma: 20 km, velocity_sigma: 10 mm/s, correlation: orbit_error, frame: rtn, "
                           "treatment: T}"),
    "orbit error, renewed": (WHITE, "position: {sigma: 30 km, velocity_sigma: 30 mm/s, correlation: orbit_error, "
                                    "renewal: 6 d, epoch: 2028-03-22 TDB, treatment: T}"),
    "drift": (BIAS, "bias: {sigma: 0.1 arcsec, correlation: drift, drift: 10 mas/d, epoch: 2028-04-04 TDB, "
                    "treatment: T}"),
    "bias per arc": (BIAS, "bias: {sigma: 0.1 arcsec, correlation: per_arc, gap: 36 h, treatment: T}"),
    "bias gauss_markov": (BIAS, "bias: {sigma: 0.1 arcsec, correlation: gauss_markov, time: 4 d, treatment: T}"),
    "bias per zone": (BIAS, "bias: {sigma: 0.1 arcsec, correlation: per_zone, zone: 5 deg, treatment: T}"),
    "timing": (WHITE, "timing: {sigma: 3 s, treatment: T}"),
}  # fmt: skip
SCHEDULE = "  - {start: 2028-03-20T00:00:00 TDB, end: 2028-04-19T00:00:00 TDB, cadence: 1 d}\n"
# three arcs of daily measurements with pauses of three days
ARCS = "".join(
    f"  - {{start: 2028-{start} TDB, end: 2028-{end} TDB, cadence: 1 d}}\n"
    for start, end in (("03-20", "03-28"), ("03-31", "04-08"), ("04-11", "04-19"))
)


def assert_covariance(errors: Array, factor: Array) -> None:
    """Each whitened variance and their sum inside chi-square bounds, each correlation inside normal ones."""
    y = np.linalg.solve(factor, errors.T).T
    runs, size = y.shape
    low, high = stats.chi2.ppf([LEVEL / (2 * size), 1.0 - LEVEL / (2 * size)], runs)
    assert np.all((low < np.sum(y**2, axis=0)) & (np.sum(y**2, axis=0) < high))
    assert stats.chi2.ppf(LEVEL / 2, runs * size) < np.sum(y**2) < stats.chi2.ppf(1.0 - LEVEL / 2, runs * size)
    correlation = np.abs((y.T @ y / runs)[np.triu_indices(size, 1)])
    assert correlation.max() < stats.norm.ppf(1.0 - LEVEL / (size * (size - 1))) / np.sqrt(runs)


def judged(mission: Mission, make_setting: Callable[[Mission], Setting], source: str, treatment: str) -> None:
    """Re-estimate many truths; the source must matter, or the test would prove nothing."""
    scene, priors, nominal = make_setting(mission)
    sample = repeat(scene, mission.estimators[0], nominal, priors, RUNS, SEED)
    assert_covariance(sample.errors[:, :6], sample.reference.factor(STATE_NAMES))
    whole, share = sample.reference.covariance(STATE_NAMES), sample.reference.shares[source]
    assert np.max(np.diag(share)[:6] / np.diag(whole)) > 0.02
    formal = np.diag(sample.reference.K_formal)[:6]
    if treatment == "estimated":
        assert formal == pytest.approx(np.diag(whole), rel=1e-6)
    else:
        assert np.max(np.diag(whole) / formal) > 1.02


@pytest.mark.parametrize("treatment", ["estimated", "considered", "ignored"])
@pytest.mark.parametrize("kind", KINDS)
def test_k_true_holds_for_each_kind_under_each_treatment(
    kind: str, treatment: str, minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    old, new = KINDS[kind]
    assert old in minimal.text
    text = minimal.text.replace(old, f"    {new}\n".replace("treatment: T", f"treatment: {treatment}"))
    mission = load_mission_text(text.replace(SCHEDULE, ARCS))
    group = new.split(":")[0]
    source = next(s.name for s in mission.sources if s.group == group)
    judged(mission, make_setting, source, treatment)


@pytest.mark.parametrize("treatment", ["estimated", "considered", "ignored"])
def test_k_true_holds_for_one_source_that_two_telescopes_share(
    treatment: str, minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    error = f"{{sigma: 0.1 arcsec, correlation: gauss_markov, time: 4 d, treatment: {treatment}}}"
    mission = load_mission_text(minimal.text + f"shared: [{{name: star catalogue, bias: {error}}}]\n")
    judged(mission, make_setting, "star catalogue", treatment)


@pytest.mark.parametrize("treatment", ["estimated", "considered", "ignored"])
def test_k_true_holds_for_the_photocentre_of_a_large_body(
    treatment: str, minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    """At 6 million km a radius of 10 km is 0.3 arcsec."""
    block = f"  photocentre: {{radius: 10 km, value: 0.5, sigma: 0.5, treatment: {treatment}}}\ntelescopes:"
    mission = load_mission_text(minimal.text.replace("telescopes:", block, 1))
    judged(mission, make_setting, "photocentre", treatment)


def test_a_shared_bias_is_one_draw_and_two_biases_are_two(
    minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    one = "shared: [{name: c, bias: {sigma: 1 arcsec, treatment: considered}}]\n"
    scene, _, nominal = make_setting(load_mission_text(minimal.text + one))
    terms = {term.name: term for term in nominal.terms}
    assert np.array_equal(terms["c"].H, terms["bias ahead"].H + terms["bias behind"].H)
    assert scene.sources["c"].telescopes == ("ahead", "behind")


def test_timing_jitter_tilts_the_noise_along_the_motion(
    minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    text = minimal.text.replace("noise: {sigma: 0.1 arcsec}", "noise: {sigma: 0.1 arcsec, timing: 2 s}")
    seen = make_setting(load_mission_text(text))[2].observation
    sigma = 0.1 * np.pi / 648000.0
    rate = seen.rate[:, :, None]
    assert seen.noise == pytest.approx(sigma**2 * np.eye(2) + 4.0 * rate @ np.swapaxes(rate, 1, 2), rel=1e-12)


def with_plate_scale(minimal: Mission, treatment: str) -> Mission:
    """The smallest mission with a camera whose scale is uncertain in place of the telescope's position."""
    block = f"    plate_scale: {{sigma: 3e-4, field: 10 arcmin, treatment: {treatment}}}\n"
    return load_mission_text(minimal.text.replace(WHITE, block))


@pytest.mark.parametrize("treatment", ["estimated", "considered", "ignored"])
def test_k_true_holds_for_the_plate_scale(
    treatment: str, minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    """Estimated, it is found three times better than known before, and its own errors keep what is promised."""
    mission = with_plate_scale(minimal, treatment)
    name = next(s.name for s in mission.sources if s.group == "plate_scale")
    if treatment != "estimated":
        judged(mission, make_setting, name, treatment)
        return
    scene, priors, nominal = make_setting(mission)
    sample = repeat(scene, mission.estimators[0], nominal, priors, RUNS, SEED)
    names = (*STATE_NAMES, name)
    errors = sample.errors[:, [sample.names.index(one) for one in names]]
    assert_covariance(errors, sample.reference.factor(names))
    assert sample.reference.sigma(name) < 1e-4


def test_a_considered_plate_scale_is_that_of_dense_algebra(
    minimal: Mission, make_setting: Callable[[Mission], Setting]
) -> None:
    """1e-6: K_true = N^-1 + G h h^T G^T s^2, G = N^-1 A^T R^-1, the places h counted by the plastic number here."""
    mission = with_plate_scale(minimal, "considered")
    scene, priors, nominal = make_setting(mission)
    psi = nominal.observation.psi
    problem = linear_problem(scene, mission.estimators[0], nominal, psi, priors, about=nominal.point)
    h = np.zeros((2, len(psi), 2))  # of each telescope
    for number in range(2):
        rows = np.flatnonzero(nominal.observation.telescope_index == number)
        k = 1.0 + np.arange(rows.size)[:, None]
        h[number, rows] = np.radians(10.0 / 60.0) * ((k / 1.324717957244746 ** np.array([1.0, 2.0])) % 1.0 - 0.5)
    blocks = [block for block in problem.blocks if not block.name.startswith("plate scale")]
    names = [name for block in blocks for name in block.names]
    A = np.concatenate([block.H for block in blocks], axis=2)
    R_inverse = np.linalg.solve(problem.R, np.broadcast_to(np.eye(2), problem.R.shape))
    N = np.einsum("nia,nij,njb->ab", A, R_inverse, A)
    for prior in problem.priors:
        if set(prior.names) <= set(names):
            at = [names.index(name) for name in prior.names]
            N[np.ix_(at, at)] += np.linalg.solve(prior.covariance, np.eye(len(at)))
    scale = 1.0 / np.sqrt(np.diag(N))
    unit = N * scale[:, None] * scale
    K = np.linalg.solve(unit, np.eye(len(names))) * scale[:, None] * scale
    shift = K @ np.einsum("nia,nij,knj->ak", A, R_inverse, h) * 3e-4
    at = [names.index(name) for name in STATE_NAMES]
    wanted = (K + shift @ shift.T)[np.ix_(at, at)]
    found = batch.solve(problem).covariance(STATE_NAMES)
    sigma = np.sqrt(np.diag(wanted))
    assert np.abs((found - wanted) / np.outer(sigma, sigma)).max() < 1e-6
