"""Nuisances that a filter does not estimate: the considered and the Schmidt filter, and audits of wrong models.

CONSIDERED: the gain comes from the formal covariance and does not know the nuisance; its effect is carried along.
With no process noise it equals the batch consider covariance. SCHMIDT: the gain knows the nuisance: honest but
greedy, it depends on the order of the data and equals no batch. Both keep P (s, s) of the state's error,
C (s, r) = cov(state error, nuisance) and S (r, r) of the nuisance.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from nebosvod.estimation.problem.square_root import solve_positive

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConsiderBelief:
    """A belief with a nuisance that is not estimated.

    Attributes
    ----------
    mean : shape (s,). P : shape (s, s), true covariance of estimate - truth.
    C : shape (s, r), covariance of (estimate - truth) with (truth - assumed) of the nuisance, times -1, so that
        [[P, C], [C^T, S]] is the covariance of (estimate - truth, assumed - truth).
    S : shape (r, r), covariance of the nuisance.
    P_formal : shape (s, s), what a filter that does not know the nuisance believes (considered form only).
    """

    mean: Array
    P: Array
    C: Array
    S: Array
    P_formal: Array

    @classmethod
    def start(cls, mean: Array, P: Array, S: Array, C: Array | None = None) -> "ConsiderBelief":
        """Begin with a prior P and a nuisance S, uncorrelated unless C is given."""
        cross = np.zeros((len(P), len(S))) if C is None else C
        return cls(mean=np.asarray(mean, dtype=np.float64), P=P, C=cross, S=S, P_formal=P)


def predict(
    belief: ConsiderBelief,
    Phi: Array,
    zeta: Array,
    Q_x: Array | None = None,
    F: Array | None = None,
    Q_c: Array | None = None,
) -> ConsiderBelief:
    """Move to the next epoch: x' = Phi x + zeta c + w_x, c' = F c + w_c (F = I: a constant nuisance).

    P' = Phi P Phi^T + Phi C zeta^T + zeta C^T Phi^T + zeta S zeta^T + Q_x; C' = (Phi C + zeta S) F^T.

    References
    ----------
    Tapley, Schutz, Born 2004, Statistical Orbit Determination, chapter 6.
    """
    s, r = len(belief.P), len(belief.S)
    noise = np.zeros((s, s)) if Q_x is None else Q_x
    step = np.eye(r) if F is None else F
    cross = Phi @ belief.C @ zeta.T
    P = Phi @ belief.P @ Phi.T + cross + cross.T + zeta @ belief.S @ zeta.T + noise
    S = step @ belief.S @ step.T + (np.zeros((r, r)) if Q_c is None else Q_c)
    C = (Phi @ belief.C + zeta @ belief.S) @ step.T
    return ConsiderBelief(
        mean=Phi @ belief.mean, P=_even(P), C=C, S=_even(S), P_formal=_even(Phi @ belief.P_formal @ Phi.T + noise)
    )


def update(
    belief: ConsiderBelief,
    residual: Array,
    H_x: Array,
    H_c: Array,
    R: Array,
    gain: Literal["considered", "schmidt"] = "schmidt",
) -> tuple[ConsiderBelief, Array]:
    """Correct by one measurement psi = H_x x + H_c c + v; returns the belief and the gain (s, p).

    Parameters
    ----------
    residual : shape (p,), observed minus predicted at the mean (nuisance at its assumed value).
    gain : "considered" ignores the nuisance in the gain, "schmidt" knows it.

    Notes
    -----
    P = (I - K H_x) P (I - K H_x)^T - (I - K H_x) C H_c^T K^T - K H_c C^T (I - K H_x)^T + K (H_c S H_c^T + R) K^T.
    The plain Joseph form without the cross terms is wrong here.

    References
    ----------
    Tapley, Schutz, Born 2004, Statistical Orbit Determination, chapter 6.
    """
    across = belief.C @ H_c.T
    if gain == "schmidt":
        cross = H_x @ across
        V = H_x @ belief.P @ H_x.T + cross + cross.T + H_c @ belief.S @ H_c.T + R
        K = solve_positive(V, (belief.P @ H_x.T + across).T).T
    else:
        V = H_x @ belief.P_formal @ H_x.T + R
        K = solve_positive(V, H_x @ belief.P_formal).T
    keep = np.eye(len(belief.P)) - K @ H_x
    mixed = keep @ across @ K.T
    P = keep @ belief.P @ keep.T - mixed - mixed.T + K @ (H_c @ belief.S @ H_c.T + R) @ K.T
    after = replace(
        belief,
        mean=belief.mean + K @ residual,
        P=_even(P),
        C=keep @ belief.C - K @ (H_c @ belief.S),
        P_formal=_even(keep @ belief.P_formal @ keep.T + K @ R @ K.T),
    )
    return after, K


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Audit:
    """Covariance of a filter's error by source, under a truth the filter may not know.

    `parts` maps a source to the covariance (s, s) it contributes to estimate - truth; all the states of the truth
    are here, those the filter does not estimate with gain zero.
    """

    parts: Mapping[str, Array]

    @property
    def total(self) -> Array:
        """True covariance: the sum of the parts."""
        size = len(next(iter(self.parts.values())))
        return sum(self.parts.values(), np.zeros((size, size)))

    def predict(self, F: Array, noise: Mapping[str, Array] | None = None) -> "Audit":
        """Move all parts by the error's transition F (s, s); add process noise to its source."""
        added = noise or {}
        return Audit(
            parts={name: _even(F @ part @ F.T + added.get(name, 0.0)) for name, part in self._with(added).items()}
        )

    def update(self, gain: Array, H: Array, noise: Mapping[str, Array]) -> "Audit":
        """Apply a gain (s, p) that came from anywhere to a measurement H (p, s) with true noises by source."""
        keep = np.eye(H.shape[1]) - gain @ H
        kept = {name: keep @ part @ keep.T for name, part in self._with(noise).items()}
        for name, R in noise.items():
            kept[name] = kept[name] + gain @ R @ gain.T
        return Audit(parts={name: _even(part) for name, part in kept.items()})

    def _with(self, added: Mapping[str, Array]) -> dict[str, Array]:
        zero = np.zeros_like(next(iter(self.parts.values())))
        return dict(self.parts) | {name: zero for name in added if name not in self.parts}


def _even(P: Array) -> Array:
    """Remove the asymmetry of round-off."""
    even: Array = 0.5 * (P + P.T)
    return even
