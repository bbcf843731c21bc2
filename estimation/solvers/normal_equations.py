"""The two classical ways: block elimination of the normal matrix, and low-rank updates of the inverse noise.

Kept because the source derives everything in them and because three ways that agree are worth more than one.
Both lose the square of the condition number; past about 1e7 they report that instead of an answer.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.borders.compiled import plain_loop
from nebosvod.errors import InputError
from nebosvod.estimation.problem.markov import Chain, merge
from nebosvod.estimation.problem.partition import Partition
from nebosvod.estimation.problem.problem import LinearProblem
from nebosvod.estimation.problem.sources import Solved
from nebosvod.estimation.problem.square_root import Conditioning, cholesky_rows, multiply_rows, solve_lower, solve_rows
from nebosvod.estimation.problem.whitening import chunks, raw_rows

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
RESOLVED_CONDITION = 5e7  # of the rows: normal equations square it, and 2.5e15 leaves no digit
UNRESOLVED = "The normal equations cannot resolve this problem; the QR way keeps twice the digits."


def solve_identity(
    problem: LinearProblem, partition: Partition, rows: Array
) -> tuple[Solved | None, Conditioning, str]:
    """Way 2: products with iRz from whitened rows, then iRzu and K by the matrix identity, in unknowns y.

    K_x0 = (iP0 + H_x0^T iRzu H_x0)^-1 and its gain, Guo and Ivashkin (2.93)-(2.97); u has unit prior in y, so
    singular priors are no exception.
    """
    size = partition.n_unknowns
    gram = sum((_gram(rows[start:stop]) for start, stop in chunks(len(rows))), np.zeros((rows.shape[2],) * 2))
    normal = gram[:size, :size].copy()
    normal[np.arange(partition.n_free, size), np.arange(partition.n_free, size)] += 1.0
    state, rest = _state_and_rest(problem, partition)
    factor, condition = _eliminated(normal, state, rest)
    if factor is None:
        return None, condition, UNRESOLVED
    right = factor @ (factor.T @ gram[:size, size:])
    y = right[:, 0]
    misfit = rows[:, :, size] - rows[:, :, :size] @ y
    chi2 = float(np.sum(misfit**2) + np.sum(y[partition.n_free :] ** 2))
    return Solved(y=y, M=right[:, 1:], S=factor, chi2=chi2), condition, ""


def solve_blocks(problem: LinearProblem, partition: Partition, rows: Array) -> tuple[Solved | None, Conditioning, str]:
    """Way 1: the normal matrix of all parameters, nuisances z eliminated per epoch, then u, then the state.

    Frobenius' formula on [[lam, bu, bz], [., lam_u, buz], [., ., lam_z]], Guo and Ivashkin section 2.1.

    Raises
    ------
    InputError
        If a noise, nuisance or prior covariance is singular: this way needs its inverse.
    """
    inverse_T = _inverse_spread(partition)
    size = len(partition.estimated)
    weights = _weights(problem)
    raw = raw_rows(problem, partition)
    gram = sum(
        (_weighted_gram(raw[start:stop], _stack(weights, start, stop)) for start, stop in chunks(problem.n)),
        np.zeros((raw.shape[2],) * 2),
    )
    for chain in merge([markov for markov in problem.markov if markov.treatment == "estimated"]):
        gram -= _chain_elimination(chain, weights, raw)
    normal = gram[:size, :size].copy()
    prior = inverse_T[partition.n_free :]
    normal += prior.T @ prior
    state = np.array([i for i, name in enumerate(partition.estimated) if name in _state_names(problem)])
    rest = np.setdiff1d(np.arange(size), state)
    factor, condition = _eliminated(normal, state, rest)
    condition = Conditioning(number=condition.number, rank=condition.rank, direction=inverse_T @ condition.direction)
    if factor is None:
        return None, condition, UNRESOLVED
    right = inverse_T @ (factor @ (factor.T @ gram[:size, size:]))
    y = right[:, 0]
    unknowns = partition.n_unknowns
    misfit = rows[:, :, unknowns] - rows[:, :, :unknowns] @ y
    chi2 = float(np.sum(misfit**2) + np.sum(y[partition.n_free :] ** 2))
    return Solved(y=y, M=right[:, 1:], S=inverse_T @ factor, chi2=chi2), condition, ""


def _eliminated(normal: Array, state: IntArray, rest: IntArray) -> tuple[Array | None, Conditioning]:
    """Factor of normal^-1 by eliminating `rest` first: K_x from the Schur complement, then the blocks of u."""
    if not normal.size:  # priors hold everything exactly
        return normal, Conditioning(number=1.0, rank=0, direction=np.zeros(0))
    lengths = np.sqrt(np.diag(normal))
    unit = np.where(lengths > 0.0, lengths, 1.0)
    scaled = normal / unit[:, None] / unit[None, :]
    values, vectors = np.linalg.eigh(scaled)
    number = float(np.sqrt(values[-1] / values[0])) if values[0] > 0.0 else np.inf
    rank = int((values > values[-1] / RESOLVED_CONDITION**2).sum())
    condition = Conditioning(number=number, rank=rank, direction=vectors[:, 0] / unit)
    if number > RESOLVED_CONDITION:
        return None, condition
    across = scaled[np.ix_(state, rest)]
    try:
        inner: Array = np.asarray(np.linalg.cholesky(scaled[np.ix_(rest, rest)]), dtype=np.float64)
        lean = solve_lower(inner, across.T)  # iL_u b_u^T
        outer: Array = np.asarray(np.linalg.cholesky(scaled[np.ix_(state, state)] - lean.T @ lean), dtype=np.float64)
    except np.linalg.LinAlgError:
        # At the very limit the smallest eigenvalue is round-off and may have been above zero by chance.
        return None, condition
    factor = np.zeros(normal.shape)
    root = solve_lower(outer, np.eye(len(state))).T
    inner_root = solve_lower(inner, np.eye(len(rest))).T
    factor[np.ix_(state, np.arange(len(state)))] = root
    factor[np.ix_(rest, np.arange(len(state)))] = -inner_root @ (lean @ root)
    factor[np.ix_(rest, np.arange(len(state), len(normal)))] = inner_root
    return factor / unit[:, None], condition


def _state_names(problem: LinearProblem) -> set[str]:
    """Names of the first estimated block and of what its prior ties to it: the `x0` of the formulas."""
    first = next(block for block in problem.blocks if block.treatment == "estimated")
    names = set(first.names)
    estimated = set(problem.names("estimated"))
    for prior in problem.priors:
        if names & set(prior.names):
            names |= set(prior.names) & estimated
    return names


def _state_and_rest(problem: LinearProblem, partition: Partition) -> tuple[IntArray, IntArray]:
    """Unknowns y of the state and of u."""
    names = _state_names(problem)
    spread = partition.T[[name in names for name in partition.estimated]]
    mine = spread.any(axis=0)
    return np.flatnonzero(mine), np.flatnonzero(~mine)


def _inverse_spread(partition: Partition) -> Array:
    """T^-1 from the inverse factors of the priors."""
    inverse = np.zeros(partition.T.T.shape)
    if partition.T.shape[0] != partition.T.shape[1]:
        raise InputError("way blocks needs the inverse of every prior and one is singular; use way qr or identity")
    free = partition.T[:, : partition.n_free]
    inverse[: partition.n_free] = free.T
    place = {name: index for index, name in enumerate(partition.estimated)}
    for source in partition.sources:
        index = [place[name] for name in source.names[: source.inverse.shape[1]]]
        inverse[source.unknowns, index] = source.inverse
    return inverse


def _weights(problem: LinearProblem) -> Array:
    """Inverse noise (n or 1, p, p) with the white nuisances eliminated epoch by epoch."""
    weights = _inverse_rows(problem.R, "R")
    for white in problem.white:
        if white.treatment != "estimated":
            continue
        weights = np.array(np.broadcast_to(weights, (problem.n, problem.p, problem.p)))
        inverse_Q = _inverse_rows(white.Q, white.name)
        W = weights[white.rows]
        WH = multiply_rows(W, white.H)
        lam_z = inverse_Q + np.einsum("npq,npr->nqr", white.H, WH)
        half = np.ascontiguousarray(WH.transpose(0, 2, 1))
        solve_rows(cholesky_rows(lam_z, white.name), half)
        weights[white.rows] = W - np.einsum("nqp,nqr->npr", half, half)
    return weights


def _inverse_rows(stack: Array, what: str) -> Array:
    """Inverses of a stack of covariances through their Cholesky factors."""
    try:
        L = cholesky_rows(stack, what)
    except InputError as error:
        raise InputError(f"way blocks needs the inverse of every covariance; {error}; use way qr or identity") from None
    half = np.array(np.broadcast_to(np.eye(stack.shape[1]), stack.shape))
    solve_rows(L, half)
    inverse: Array = np.einsum("nki,nkj->nij", half, half)
    return inverse


def _stack(weights: Array, start: int, stop: int) -> Array:
    return weights if len(weights) == 1 else weights[start:stop]


def _gram(rows: Array) -> Array:
    flat = rows.reshape(-1, rows.shape[2])
    product: Array = flat.T @ flat
    return product


def _weighted_gram(rows: Array, weights: Array) -> Array:
    width = rows.shape[2]
    product: Array = rows.reshape(-1, width).T @ multiply_rows(weights, rows).reshape(-1, width)
    return product


def _chain_elimination(chain: Chain, weights: Array, raw: Array) -> Array:
    """What eliminating a chain's z takes from the normal matrix: g^T ilam_z g, lam_z block tridiagonal."""
    W = np.ascontiguousarray(np.broadcast_to(weights, (len(raw), *weights.shape[1:]))[chain.rows])
    step = np.array(chain.Q)
    step[0] = chain.P0
    inverse_Q = _inverse_rows(step, "Gauss-Markov step noise")
    WH = multiply_rows(W, chain.H)
    lam = np.einsum("npq,npr->nqr", chain.H, WH)
    right = np.einsum("npq,npw->nqw", WH, raw[chain.rows])
    F, right = np.ascontiguousarray(chain.F), np.ascontiguousarray(right)
    taken: Array = _tridiagonal(np.ascontiguousarray(lam), np.ascontiguousarray(inverse_Q), F, right)
    return taken


@plain_loop
def _tridiagonal(lam, inverse_Q, F, right):  # type: ignore[no-untyped-def]
    """Forward block elimination of z_0, z_1, ...; returns sum of g_k^T (Schur complement)^-1 g_k."""
    n, _, width = right.shape
    taken = np.zeros((width, width))
    current = lam[0] + inverse_Q[0]
    g = right[0].copy()
    for k in range(n):
        if k < n - 1:
            link = inverse_Q[k + 1] @ F[k + 1]
            current = current + np.ascontiguousarray(F[k + 1].T) @ link
        solved = np.linalg.solve(current, g)
        taken += np.ascontiguousarray(g.T) @ solved
        if k < n - 1:
            back = np.linalg.solve(current, np.ascontiguousarray(link.T))
            g = right[k + 1] + link @ solved
            current = lam[k + 1] + inverse_Q[k + 1] - link @ back
    return taken
