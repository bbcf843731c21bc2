"""Two-stage filter: the state as if there were no bias, the bias beside it, and their blend.

x' = A x + D b + w_x, b' = B b + w_b, y = C x + G b + v (letters of this module only). `friedland` (Friedland 1969,
Ignagni 1990) is optimal iff the bias has no process noise and B is invertible; `hsieh_chen` (Hsieh, Chen 1999) is
optimal for any. Both equal the augmented filter. The conclusion printed in Volovik et al. 2017 feeds P_x back into
the bias-free stage, has C iR C^T for C^T iR C and drops iB: wrong by 20 % even for B = I.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincinv

from nebosvod.errors import GeometryError
from nebosvod.estimation.problem.square_root import solve_covariance, solve_positive, solve_square

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TwoStage:
    """Both stages: bias-free x0 (s,), P (s, s); bias b (r,), P_b (r, r); blend V (s, r), x = x0 + V b."""

    x0: Array
    P: Array
    b: Array
    P_b: Array
    V: Array

    @classmethod
    def start(cls, x: Array, b: Array, P_xx: Array, P_b: Array, P_xb: Array | None = None) -> "TwoStage":
        """Split a joint prior: V0 = P_xb iP_b, x0 = x - V0 b, P = P_xx - V0 P_b V0^T."""
        cross = np.zeros((len(P_xx), len(P_b))) if P_xb is None else P_xb
        V = solve_covariance(P_b, cross.T).T
        return cls(x0=x - V @ b, P=P_xx - V @ P_b @ V.T, b=np.asarray(b, dtype=np.float64), P_b=P_b, V=V)

    @property
    def x(self) -> Array:
        """State estimate (s,)."""
        return self.x0 + self.V @ self.b

    @property
    def P_x(self) -> Array:
        """Covariance (s, s) of the state estimate."""
        return self.P + self.V @ self.P_b @ self.V.T

    @property
    def P_xb(self) -> Array:
        """Covariance (s, r) of state and bias."""
        return self.V @ self.P_b


def restart(stage: TwoStage, P_b: Array) -> TwoStage:
    """Begin the bias stage anew with a bias that owes nothing to the one before, P_b (r, r) its covariance.

    What the bias has done so far stays in the state. The same as a step with B = 0 and Q_b = P_b.
    """
    return TwoStage(x0=stage.x, P=_even(stage.P_x), b=np.zeros_like(stage.b), P_b=P_b, V=np.zeros_like(stage.V))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class System:
    """One step of the system: transitions A (s, s), D (s, r), B (r, r), noises Q_x, Q_b, Q_xb."""

    A: Array
    D: Array
    B: Array
    Q_x: Array
    Q_b: Array | None = None
    Q_xb: Array | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BiasInnovation:
    """What a measurement tells both stages.

    Attributes
    ----------
    r, M, S : innovation of the bias-free stage (p,), its covariance (p, p), and the bias's partials (p, r).
    told, total : what is new to both together (p,), r less what the bias was believed to do, and its covariance (p, p).
    square : normalised square of `told`; the squares of all measurements add up to chi2.
    """

    r: Array
    M: Array
    S: Array
    told: Array
    total: Array
    square: float


def predict_friedland(stage: TwoStage, system: System) -> TwoStage:
    """Time update, optimal iff Q_b = 0; needs B invertible (U = (A V + D) iB).

    Raises
    ------
    GeometryError
        If B is singular or the bias has process noise; use `predict_hsieh_chen`.

    References
    ----------
    Friedland 1969, IEEE Trans. Automatic Control 14, 359; Ignagni 1990.
    """
    if system.Q_b is not None and np.any(system.Q_b):
        raise GeometryError("Friedland's two-stage filter is not optimal for a bias with process noise; use Hsieh-Chen")
    try:
        U = solve_square(system.B.T, (system.A @ stage.V + system.D).T).T
    except np.linalg.LinAlgError:
        raise GeometryError("Friedland's two-stage filter needs an invertible B; use Hsieh-Chen") from None
    return TwoStage(
        x0=system.A @ stage.x0,
        P=_even(system.A @ stage.P @ system.A.T + system.Q_x),
        b=system.B @ stage.b,
        P_b=_even(system.B @ stage.P_b @ system.B.T),
        V=U,
    )


def predict_hsieh_chen(stage: TwoStage, system: System) -> TwoStage:
    """Time update for any bias noise, and for a singular B.

    Components of the bias that have no error yet, and begin to err later, are left alone until then.

    References
    ----------
    Hsieh, Chen 1999, IEEE Trans. Automatic Control 44, 194.
    """
    A, B = system.A, system.B
    Ub = A @ stage.V + system.D
    Q_b = np.zeros_like(stage.P_b) if system.Q_b is None else system.Q_b
    Q_xb = np.zeros_like(stage.V) if system.Q_xb is None else system.Q_xb
    P_b = _even(B @ stage.P_b @ B.T + Q_b)
    cross = Ub @ stage.P_b @ B.T + Q_xb
    try:
        U = solve_square(P_b, cross.T).T
    except np.linalg.LinAlgError:  # what has no error has no covariance with the state either
        U = solve_covariance(P_b, cross.T).T
    Q = system.Q_x + Ub @ stage.P_b @ Ub.T - U @ P_b @ U.T
    return TwoStage(
        x0=A @ stage.x0 + (Ub - U @ B) @ stage.b,
        P=_even(A @ stage.P @ A.T + Q),
        b=B @ stage.b,
        P_b=P_b,
        V=U,
    )


def update(stage: TwoStage, y: Array, C: Array, G: Array, R: Array) -> tuple[TwoStage, BiasInnovation]:
    """Measurement update of both stages for y = C x + G b + v.

    References
    ----------
    Friedland 1969, IEEE Trans. Automatic Control 14, 359.
    """
    CP = C @ stage.P
    M = CP @ C.T + R
    K = solve_positive(M, CP).T
    keep = _less(K @ C)
    r = y - C @ stage.x0
    S = C @ stage.V + G
    told = r - S @ stage.b
    SP_b = S @ stage.P_b
    total = M + SP_b @ S.T
    weighed = solve_positive(total, np.column_stack([SP_b, told]))
    K_b = weighed[:, :-1].T
    keep_b = _less(K_b @ S)
    after = TwoStage(
        x0=stage.x0 + K @ r,
        P=_even(keep @ stage.P @ keep.T + K @ R @ K.T),
        b=stage.b + K_b @ told,
        P_b=_even(keep_b @ stage.P_b @ keep_b.T + K_b @ M @ K_b.T),
        V=stage.V - K @ S,
    )
    return after, BiasInnovation(r=r, M=M, S=S, told=told, total=total, square=float(told @ weighed[:, -1]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BiasTest:
    """Is there a bias at all? Accumulates the two costs of the bias stage's innovations.

    H0 (no bias): sum |r|^2_M. H1 (a constant bias estimated without prior): the same minus what the best bias
    explains. Their difference is chi-square with r degrees of freedom when there is none.
    """

    normal: Array
    right: Array
    cost: float

    @classmethod
    def start(cls, size: int) -> "BiasTest":
        """Begin for a bias of this size."""
        return cls(normal=np.zeros((size, size)), right=np.zeros(size), cost=0.0)

    def add(self, innovation: BiasInnovation) -> "BiasTest":
        """Take in one innovation of a filter that runs from a bias of zero with B = I."""
        weighed = solve_positive(innovation.M, np.column_stack([innovation.S, innovation.r]))
        return replace(
            self,
            normal=self.normal + innovation.S.T @ weighed[:, :-1],
            right=self.right + innovation.S.T @ weighed[:, -1],
            cost=self.cost + float(innovation.r @ weighed[:, -1]),
        )

    @property
    def statistic(self) -> float:
        """Drop of the cost from H0 to H1."""
        return float(self.right @ solve_covariance(self.normal, self.right))

    def verdict(self, false_alarm: float = 0.01) -> Literal["no bias", "bias"]:
        """Decide at a probability of false alarm."""
        limit = 2.0 * float(gammaincinv(0.5 * len(self.right), 1.0 - false_alarm))
        return "bias" if self.statistic > limit else "no bias"


def _less(KH: Array) -> Array:
    """I - K H, in the place of K H."""
    np.negative(KH, out=KH)
    KH.flat[:: len(KH) + 1] += 1.0
    return KH


def _even(P: Array) -> Array:
    """Remove the asymmetry of round-off."""
    even: Array = P + P.T
    even *= 0.5
    return even
