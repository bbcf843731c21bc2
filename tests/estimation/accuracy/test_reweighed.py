"""What an estimate answers to the size of a source, weights solved anew: against normal equations solved densely."""

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import norm

from nebosvod.errors import InputError
from nebosvod.estimation import Block, LinearProblem, Prior, White
from nebosvod.estimation.accuracy.elasticity import probability_budget
from nebosvod.estimation.accuracy.reweighed import responses, scaled
from nebosvod.estimation.solvers import batch

Array = npt.NDArray[np.float64]
N, LABEL = 30, np.arange(30) % 3
SIGMA = np.array([0.5, 1.0, 2.0])  # of the noise of three telescopes
BIAS, WHITE = 0.7, 0.4
STEP = 1e-3


class Case:
    """Three parameters, one with a prior; a bias of T0 considered, a fresh error of T1 in the weights."""

    def __init__(self) -> None:
        rng = np.random.default_rng(11)
        self.A = rng.normal(size=(N, 3))
        self.bias = (LABEL == 0).astype(float)
        self.y = rng.normal(size=N) * 2.0
        self.prior, self.mean = 1.5, 0.8

    def problem(self) -> LinearProblem:
        rows = np.flatnonzero(LABEL == 1)
        return LinearProblem(
            residual=self.y[:, None],
            R=(SIGMA[LABEL] ** 2)[:, None, None],
            blocks=(
                Block(name="x", names=("a", "b", "c"), H=self.A[:, None, :]),
                Block(name="bias", names=("bias",), H=self.bias[:, None, None], treatment="considered"),
            ),
            priors=(
                Prior(name="on c", names=("c",), covariance=np.array([[self.prior**2]]), mean=np.array([self.mean])),
                Prior(name="bias", names=("bias",), covariance=np.array([[BIAS**2]])),
            ),
            white=(White(name="jitter", H=np.ones((len(rows), 1, 1)), Q=np.array([[WHITE**2]]), rows=rows),),
            noise_label=LABEL,
            noise_names=("T0", "T1", "T2"),
        )

    def dense(self, source: str = "", factor: float = 1.0) -> tuple[Array, Array]:
        """Estimate (3,) and true covariance (3, 3) with the sigma of one source times a factor."""
        f = {name: factor if name == source else 1.0 for name in ("T0", "T1", "T2", "on c", "bias", "jitter")}
        variance = np.array([(SIGMA[k] * f[f"T{k}"]) ** 2 for k in LABEL]) + (LABEL == 1) * (WHITE * f["jitter"]) ** 2
        W = np.diag(1.0 / variance)
        P = np.diag([0.0, 0.0, 1.0 / (self.prior * f["on c"]) ** 2])
        K = np.linalg.inv(self.A.T @ W @ self.A + P)  # noqa: TID251  the point of a dense answer
        moved = K @ self.A.T @ W @ self.bias
        x = K @ (self.A.T @ W @ self.y + P @ np.array([0.0, 0.0, self.mean]))
        return x, K + np.outer(moved, moved) * (BIAS * f["bias"]) ** 2


@pytest.fixture(scope="module")
def case() -> Case:
    return Case()


@pytest.mark.parametrize("source", ["T0", "T1", "T2", "on c", "bias", "jitter"])
def test_shift_and_growth_are_those_of_normal_equations_solved_anew(case: Case, source: str) -> None:
    problem = case.problem()
    estimate = batch.solve(problem)
    x, K = case.dense()
    assert estimate.mean == pytest.approx(x, rel=1e-10)
    one = responses(problem, estimate, ("a", "b", "c"), batch.solve)[source]
    (high, K_high), (low, K_low) = (case.dense(source, float(np.exp(sign * STEP))) for sign in (1.0, -1.0))
    S = np.linalg.cholesky(K)
    assert S @ one.shift == pytest.approx((high - low) / (2.0 * STEP), abs=2e-3 * np.abs(S @ one.shift).max() + 1e-12)
    wanted = (K_high - K_low) / (2.0 * STEP)
    assert S @ one.growth @ S.T == pytest.approx(wanted, abs=2e-3 * np.abs(wanted).max())
    if source == "bias":  # not in the weights
        assert one.shift == pytest.approx(0.0, abs=1e-9)


def test_the_elasticity_of_a_half_space_is_that_of_its_closed_form(case: Case) -> None:
    """P = Phi((a x - level)/sigma): held, and with the weights solved anew."""
    problem = case.problem()
    estimate = batch.solve(problem)
    names, a = ("a", "b", "c"), np.array([1.0, -0.5, 0.3])
    x, K = case.dense()
    level = float(a @ x + 1.2 * np.sqrt(a @ K @ a))

    def chance(source: str, factor: float) -> float:
        x, K = case.dense(source, factor)
        return float(norm.sf((level - a @ x) / np.sqrt(a @ K @ a)))

    S = np.linalg.cholesky(K)
    d = np.random.default_rng(2).normal(size=(400_000, 3)) @ S.T
    found = probability_budget(
        d, (x + d) @ a > level, {s: estimate.predict(np.eye(3), names).factors[s] for s in estimate.sources},
        responses=responses(problem, estimate, names, batch.solve), factor=S,
    )  # fmt: skip
    assert len(found.rows) == 6
    apart = []
    for row in found.rows:
        slope = np.log(chance(row.source, np.exp(STEP)) / chance(row.source, np.exp(-STEP))) / (2.0 * STEP)
        assert row.reoptimised is not None
        assert row.reoptimised_error is not None
        assert row.reoptimised == pytest.approx(slope, abs=4.0 * row.reoptimised_error + 1e-3)
        apart.append(abs(row.reoptimised - row.value) / row.reoptimised_error)
    assert max(apart) > 20.0  # the estimate does move


def test_a_source_that_is_not_there_is_refused(case: Case) -> None:
    with pytest.raises(InputError, match="no source 'T7'; there are T0, T1, T2, on c, bias, jitter"):
        scaled(case.problem(), "T7", 2.0)
