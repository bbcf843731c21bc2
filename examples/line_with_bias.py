"""A line through noisy points with a common bias: formal against honest sigma, and the two-stage filter.

Two rulers measure the height of a ramp, a + b t. The second ruler has an unknown offset. What happens to the
error of the height when the offset is estimated, considered, or ignored?
"""

from dataclasses import dataclass

import numpy as np

from nebosvod.estimation import Block, LinearProblem, Prior, Treatment
from nebosvod.estimation.filters import two_stage
from nebosvod.estimation.solvers import batch


@dataclass(frozen=True)
class Row:
    """One treatment: sigma of the height that the estimator believes, and the one it has."""

    treatment: str
    formal: float
    true: float
    share_of_offset: float


def ramp(treatment: Treatment, n: int = 40, sigma: float = 0.1, offset: float = 0.3) -> LinearProblem:
    """The ramp measured by both rulers in turn; the offset of the second has a known sigma."""
    t = np.linspace(0.0, 1.0, n)
    H = np.stack([np.ones(n), t], axis=1)[:, None, :]
    second = (np.arange(n) % 2 == 1).astype(float)[:, None, None]
    return LinearProblem(
        residual=np.zeros((n, 1)),
        R=[[sigma**2]],
        blocks=(
            Block(name="ramp", names=("height", "slope"), H=H),
            Block(name="offset", names=("offset",), H=second, treatment=treatment),
        ),
        priors=(Prior(name="offset", names=("offset",), covariance=[[offset**2]]),),
    )


def compare() -> tuple[Row, ...]:
    """Solve the ramp under each treatment of the offset."""
    rows = []
    for treatment in ("estimated", "considered", "ignored"):
        estimate = batch.solve(ramp(treatment))
        share = estimate.shares["offset"][0, 0] / estimate.K_true[0, 0]
        rows.append(Row(treatment, estimate.sigma_formal("height"), estimate.sigma("height"), float(share)))
    return tuple(rows)


def two_stage_sigma(n: int = 40, sigma: float = 0.1, offset: float = 0.3) -> float:
    """Sigma of the height by the two-stage filter: a filter that knows no offset, corrected by one that does."""
    case = ramp("estimated", n, sigma, offset)
    stage = two_stage.TwoStage.start(np.zeros(2), np.zeros(1), 1e6 * np.eye(2), np.array([[offset**2]]))
    for k in range(n):
        C, G = case.blocks[0].H[k], case.blocks[1].H[k]
        stage, _ = two_stage.update(stage, np.zeros(1), C, G, np.array([[sigma**2]]))
    return float(np.sqrt(stage.P_x[0, 0]))


def main() -> None:
    """Print the comparison."""
    print(f"{'offset is':12s} {'believed':>9s} {'true':>9s}  share of the offset")
    for row in compare():
        print(f"{row.treatment:12s} {row.formal:9.4f} {row.true:9.4f}  {100 * row.share_of_offset:5.1f} %")
    print(f"two-stage filter, offset estimated: {two_stage_sigma():.4f}")


if __name__ == "__main__":
    main()
