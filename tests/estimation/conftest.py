"""Random problems and a dense reference that inverts everything, shared by the tests of this folder."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.estimation import Block, LinearProblem, Markov, Prior, White

Array = npt.NDArray[np.float64]
MakeProblem = Callable[..., LinearProblem]


def spd(rng: np.random.Generator, size: int, floor: float = 0.3) -> Array:
    """A random covariance."""
    A = rng.normal(size=(size, size))
    return A @ A.T / size + floor * np.eye(size)


def build(
    seed: int = 0,
    n: int = 24,
    p: int = 2,
    q: int = 3,
    z: str = "white",
    treatments: dict[str, str] | None = None,
    state_prior: str = "none",
    truth: bool = False,
    spread: float = 1.0,
    R_scale: float = 1.0,
) -> LinearProblem:
    """A problem with state (4), parameter c (2), biases of two instruments and a nuisance z for each instrument.

    `spread` ruins the scaling of the state's columns by that factor each; `truth` makes true differ from assumed.
    """
    rng = np.random.default_rng(seed)
    treat = treatments or {}
    label = np.arange(n) % 2
    state = ("x", "y", "vx", "vy")
    H_x = rng.normal(size=(n, p, 4)) * spread ** np.arange(4)
    H_c = rng.normal(size=(n, p, 2))
    H_b = np.zeros((n, p, 2 * p))
    for component in range(p):
        H_b[label == 0, component, component] = 1.0
        H_b[label == 1, component, p + component] = 1.0
    blocks = [Block(name="state", names=state, H=H_x)]
    blocks += [Block(name="c", names=("c1", "c2"), H=H_c, treatment=treat.get("c", "estimated"))]  # type: ignore[arg-type]
    biases = [("bias A", H_b[:, :, :p]), ("bias B", H_b[:, :, p:])]
    for name, H in biases:
        names = tuple(f"{name} {i}" for i in range(p))
        blocks.append(Block(name=name, names=names, H=H, treatment=treat.get("bias", "estimated")))  # type: ignore[arg-type]
    priors = []
    if state_prior == "joint":
        size = np.concatenate([spread ** -np.arange(4.0), np.ones(2)])
        covariance = size[:, None] * spd(rng, 6) * size
        priors.append(Prior(name="state and c", names=(*state, "c1", "c2"), covariance=covariance, mean=0.1 * size))
    else:
        true_c = spd(rng, 2) if truth else None
        priors.append(Prior(name="c", names=("c1", "c2"), covariance=spd(rng, 2), true_covariance=true_c))
        if state_prior == "own":
            priors.append(Prior(name="state", names=state, covariance=np.diag(spread ** (-2.0 * np.arange(4)))))
    for block in blocks[2:]:
        true_b = spd(rng, p) if truth else None
        priors.append(Prior(name=block.name, names=block.names, covariance=spd(rng, p), true_covariance=true_b))
    white, markov = [], []
    for index, name in enumerate(("z A", "z B")):
        rows = np.flatnonzero(label == index)
        H = rng.normal(size=(len(rows), p, q))
        treatment = treat.get("z", "estimated")
        if z in ("white", "both"):
            true_Q = spd(rng, q) if truth else None
            white.append(White(name=name, H=H, Q=spd(rng, q), rows=rows, treatment=treatment, true_Q=true_Q))  # type: ignore[arg-type]
        if z in ("markov", "both"):
            P0 = spd(rng, q)
            decay = rng.uniform(0.3, 0.95, size=len(rows))
            F = decay[:, None, None] * np.eye(q)
            Q = (1.0 - decay**2)[:, None, None] * P0
            markov.append(Markov(name=f"{name} slow", H=H, F=F, Q=Q, P0=P0, rows=rows, treatment=treatment))  # type: ignore[arg-type]
    R = R_scale * np.stack([spd(rng, p) for _ in range(n)])
    return LinearProblem(
        residual=rng.normal(size=(n, p)) * 2.0,
        R=R,
        true_R=np.stack([spd(rng, p) for _ in range(n)]) if truth else None,
        blocks=tuple(blocks),
        priors=tuple(priors),
        white=tuple(white),
        markov=tuple(markov),
        noise_label=label,
        noise_names=("noise A", "noise B"),
    )


@dataclass
class Dense:
    """Estimate by forming and inverting every matrix: the definitions of the error budget, literally."""

    names: list[str]
    left_out: list[str]
    mean: Array
    K_formal: Array
    K_true: Array
    M_v: Array
    chi2: float
    shares: dict[str, Array]
    gains: dict[str, Array]


def inverse(matrix: Array) -> Array:
    """Inverse by solving, scaled, for references only."""
    d = 1.0 / np.sqrt(np.diag(matrix))
    out: Array = d[:, None] * np.linalg.solve(d[:, None] * matrix * d, np.eye(len(matrix))) * d
    return out


def chain_covariance(markov: Markov) -> Array:
    """Dense covariance (r, r, q, q) of a chain between each two of its rows."""
    count, _, q = markov.H.shape
    P = np.zeros((count, count, q, q))
    P[0, 0] = markov.P0
    for i in range(1, count):
        P[i, i] = markov.F[i] @ P[i - 1, i - 1] @ markov.F[i].T + markov.Q[i]
        for j in range(i):
            P[i, j] = markov.F[i] @ P[i - 1, j]
            P[j, i] = P[i, j].T
    return P


def fresh_covariance(problem: LinearProblem, source: str) -> Array:
    """Dense (np, np) true covariance of a noise, white or time-correlated source."""
    n, p = problem.n, problem.p
    total = np.zeros((n, p, n, p))
    if source in problem.noise_names:
        assert problem.noise_label is not None
        R = np.broadcast_to(problem.truth, (n, p, p))
        for k in np.flatnonzero(problem.noise_label == problem.noise_names.index(source)):
            total[k, :, k, :] = R[k]
    for white in problem.white:
        if white.name == source:
            Q = np.broadcast_to(white.truth, (len(white.rows), *white.truth.shape[1:]))
            for i, k in enumerate(white.rows):
                total[k, :, k, :] += white.H[i] @ Q[i] @ white.H[i].T
    for markov in problem.markov:
        if markov.name == source:
            P = chain_covariance(markov)
            for i, k in enumerate(markov.rows):
                for j, m in enumerate(markov.rows):
                    total[k, :, m, :] += markov.H[i] @ P[i, j] @ markov.H[j].T
    return total.reshape(n * p, n * p)


def assumed_noise(problem: LinearProblem) -> Array:
    """Dense assumed covariance of noise and estimated white and time-correlated nuisances."""
    n, p = problem.n, problem.p
    total = np.zeros((n, p, n, p))
    total[np.arange(n), :, np.arange(n), :] = problem.R
    out = total.reshape(n * p, n * p)
    bare = LinearProblem(
        residual=problem.residual,
        R=problem.R,
        blocks=problem.blocks,
        priors=problem.priors,
        white=tuple(
            White(name=w.name, H=w.H, Q=w.Q if len(w.Q) > 1 else w.Q[0], rows=w.rows)
            for w in problem.white
            if w.treatment == "estimated"
        ),
        markov=tuple(m for m in problem.markov if m.treatment == "estimated"),
    )
    nuisances: tuple[Any, ...] = (*bare.white, *bare.markov)
    for nuisance in nuisances:
        out = out + fresh_covariance(bare, nuisance.name)
    return out


def solve_dense(problem: LinearProblem) -> Dense:
    """Sections 2 and 3 of the method notes with dense matrices; every prior must be invertible."""
    names = list(problem.names("estimated"))
    left_out = list(problem.names("considered", "ignored"))
    columns = {name: block.H[:, :, i].reshape(-1) for block in problem.blocks for i, name in enumerate(block.names)}
    H = np.stack([columns[name] for name in names], axis=1)
    H_all = np.stack([columns[name] for name in names + left_out], axis=1)
    W = inverse(assumed_noise(problem))
    size, total = len(names), len(names) + len(left_out)
    Pi, linear, offset = np.zeros((size, size)), np.zeros(size), np.zeros(total)
    for prior in problem.priors:
        assert prior.mean is not None
        index = [(names + left_out).index(name) for name in prior.names]
        offset[index] = prior.mean
        inside = [i for i, name in enumerate(prior.names) if name in names]
        if inside:
            where = [names.index(prior.names[i]) for i in inside]
            information = inverse(prior.covariance[np.ix_(inside, inside)])
            Pi[np.ix_(where, where)] += information
            linear[where] += information @ prior.mean[inside]
    v = problem.residual.reshape(-1) - H_all[:, size:] @ offset[size:]
    K = inverse(H.T @ W @ H + Pi)
    M_v = K @ H.T @ W
    mean = M_v @ v + K @ linear
    rest = v - H @ mean
    chi2 = rest @ W @ rest + (mean - offset[:size]) @ Pi @ (mean - offset[:size])
    live = [*problem.noise_names]
    live += [g.name for g in (*problem.white, *problem.markov) if g.treatment != "fixed"]  # type: ignore[attr-defined]
    shares = {source: M_v @ fresh_covariance(problem, source) @ M_v.T for source in live}
    gains = {}
    for prior in problem.priors:
        M = np.zeros((size, len(prior.names)))
        for i, name in enumerate(prior.names):
            M[:, i] = -(K @ Pi)[:, names.index(name)] if name in names else M_v @ columns[name]
        gains[prior.name] = M
        shares[prior.name] = M @ prior.truth @ M.T
    return Dense(
        names=names,
        left_out=left_out,
        mean=mean,
        K_formal=K,
        K_true=sum(shares.values(), np.zeros((size, size))),
        M_v=M_v,
        chi2=float(chi2),
        shares=shares,
        gains=gains,
    )


def scaled_error(found: Array, wanted: Array) -> float:
    """Largest |dK_ij| / (sigma_i sigma_j)."""
    sigma = np.sqrt(np.diag(wanted))
    return float(np.max(np.abs(found - wanted) / np.outer(sigma, sigma)))


@pytest.fixture(scope="session")
def make_problem() -> MakeProblem:
    """Builder of random problems."""
    return build


@pytest.fixture(scope="session")
def dense() -> Callable[[LinearProblem], Dense]:
    """The dense reference."""
    return solve_dense


@pytest.fixture(scope="session")
def dense_noise() -> Callable[[LinearProblem], Array]:
    """Dense assumed covariance of everything fresh."""
    return assumed_noise


@pytest.fixture(scope="session")
def dense_chain() -> Callable[[Markov], Array]:
    """Dense covariance of a chain."""
    return chain_covariance


@pytest.fixture(scope="session")
def covariance_error() -> Callable[[Array, Array], float]:
    """Error of a covariance in units of the sigmas."""
    return scaled_error
