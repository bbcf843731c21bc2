"""What the page needs to say what if: how every prediction answers to each source's size and treatment.

Least squares with another size of a source, or another treatment, is another weighing of the same measurements. What
they say of all common parameters together is therefore kept, in two parts. Measurements whose only fresh error is noise
are kept as one triangle for each noise source: a noise k times as large weighs its triangle 1/k times as much, and
nothing else changes. The others, which a fresh or time-correlated nuisance touches, do not weigh so simply (the sum of
two covariances has no common factor), and are kept row by row. With the covariances of the priors and the partials of
the predictions that is the whole linear problem: whoever solves it again has the numbers of a run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.engine.quantity import Quantity, known_partials, spread
from nebosvod.estimation import Block, LinearProblem, Markov, White
from nebosvod.estimation.problem.square_root import append_rows, cholesky_rows, solve_rows
from nebosvod.estimation.problem.whitening import projected

Array = npt.NDArray[np.float64]
MOST_NUMBERS = 140_000  # of measurements kept row by row: 1.5 MB of a page
MOST_PARAMETERS = 120  # beyond, a page would not answer at once
Kind = Literal["noise", "prior", "white", "markov"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WhatIf:
    """The linear problem behind the predictions of one estimator, compact.

    Attributes
    ----------
    estimator : whose problem it is.
    reason : why it cannot be solved again; empty where it can, and then `blocks` and `parameters` say how.
    parameters : names of all common parameters, columns of the arrays.
    blocks : groups of parameters that share one treatment: name, first and last column, treatment.
    sources : name and kind of each source of the budget, and the parameters it is a prior of.
    predictions : names, in the order of the arrays.
    arrays : by name (docs/report.md).
    """

    estimator: str
    reason: str
    parameters: tuple[str, ...]
    blocks: tuple[dict[str, Any], ...]
    sources: tuple[dict[str, Any], ...]
    predictions: tuple[str, ...]
    arrays: Mapping[str, Array]


def what_if(fit: Fit, asked: Sequence[Quantity]) -> WhatIf:
    """Keep what the predictions of an estimator hang on."""
    arrays = {f"what_if_shares_{k}": _shares(fit, one) for k, one in enumerate(asked)}
    problem, names = fit.problem, fit.estimate.sources
    kinds = _kinds(problem)
    blocks = [block for block in problem.blocks if block.treatment != "fixed" or _has_prior(problem, block)]
    parameters = tuple(name for block in blocks for name in block.names)
    reason = _reason(fit, problem, parameters)
    if not reason:
        arrays |= _information(problem, blocks) | _priors(problem, parameters)
        arrays |= {f"what_if_partials_{k}": spread(one.partials, one.names, parameters) for k, one in enumerate(asked)}
    return WhatIf(
        estimator=fit.estimator.name,
        reason=reason,
        parameters=() if reason else parameters,
        blocks=() if reason else tuple(_block_rows(problem, blocks)),
        sources=tuple(_source_rows(problem, kinds, names, blocks, bool(reason))),
        predictions=tuple(one.request.name for one in asked),
        arrays=arrays,
    )


def _reason(fit: Fit, problem: LinearProblem, parameters: Sequence[str]) -> str:
    """Why the problem cannot be solved again by a page; empty where it can."""
    if fit.own_gain:
        return f"{fit.estimator.method} weighs otherwise than least squares"
    if len(parameters) > MOST_PARAMETERS:
        return f"{len(parameters)} common parameters are more than a page solves at once ({MOST_PARAMETERS})"
    kept = int(_touched(problem).sum()) * (2 * len(parameters) + 1 + 4 * (1 + len(problem.white)))
    kept += sum(len(chain.rows) * _numbers(chain) for chain in problem.markov)
    if kept > MOST_NUMBERS:
        return (
            f"{int(_touched(problem).sum())} measurements with errors that are fresh or correlated in time take more "
            "room than a page has"
        )
    return ""


def _numbers(chain: Markov) -> int:
    """How many numbers one row of a chain takes."""
    q = len(chain.P0)
    return 2 * q + 2 * q * q


def _kinds(problem: LinearProblem) -> dict[str, Kind]:
    """The kind of every source, fixed ones included."""
    kinds: dict[str, Kind] = dict.fromkeys(problem.noise_names, "noise")
    kinds |= dict.fromkeys((prior.name for prior in problem.priors), "prior")
    kinds |= dict.fromkeys((white.name for white in problem.white), "white")
    return kinds | dict.fromkeys((chain.name for chain in problem.markov), "markov")


def _has_prior(problem: LinearProblem, block: Block) -> bool:
    """Whether anything is known of a block beforehand."""
    return any(set(prior.names) & set(block.names) for prior in problem.priors)


def _touched(problem: LinearProblem) -> npt.NDArray[np.bool_]:
    """Which measurements (n,) a fresh or time-correlated nuisance touches, whatever its treatment."""
    touched = np.zeros(problem.n, dtype=np.bool_)
    groups: tuple[White | Markov, ...] = (*problem.white, *problem.markov)
    for group in groups:
        touched[group.rows] = True
    return touched


def _shares(fit: Fit, asked: Quantity) -> Array:
    """Covariance (g, d, d) that each source contributes to a prediction with the estimator's own gain."""
    found = fit.estimate.predict(*known_partials(asked, fit.estimate)).shares
    return np.array([found[name] for name in fit.estimate.sources])


def _block_rows(problem: LinearProblem, blocks: Sequence[Block]) -> list[dict[str, Any]]:
    """What may be treated otherwise: blocks of parameters, and nuisances that are fresh or correlated in time."""
    rows, first = [], 0
    for block in blocks:
        last = first + len(block.names)
        known = _has_prior(problem, block)
        rows.append({"name": block.name, "first": first, "last": last, "treatment": block.treatment, "prior": known})
        first = last
    return rows


def _source_rows(
    problem: LinearProblem, kinds: Mapping[str, Kind], order: Sequence[str], blocks: Sequence[Block], held: bool
) -> list[dict[str, Any]]:
    """Every source: those of the estimate (`order`) where the gain is held, all of the problem otherwise."""
    rows = []
    treatments = {one.name: one.treatment for one in problem.white} | {
        one.name: one.treatment for one in problem.markov
    }
    for name, kind in kinds.items():
        if held and name not in order:
            continue
        share = order.index(name) if name in order else None
        row: dict[str, Any] = {"name": name, "kind": kind, "treatment": None, "blocks": [], "share": share}
        if kind == "prior":
            own = next(set(prior.names) for prior in problem.priors if prior.name == name)
            row["blocks"] = [block.name for block in blocks if own & set(block.names)]
            row["columns"] = [k for k, one in enumerate(one for b in blocks for one in b.names) if one in own]
            if not row["blocks"]:
                continue
        elif kind != "noise":
            row["treatment"] = treatments[name]
        rows.append(row)
    return rows


def _information(problem: LinearProblem, blocks: Sequence[Block]) -> dict[str, Array]:
    """Triangles of the plain measurements by noise source, and the others row by row."""
    H = np.concatenate([block.H for block in blocks], axis=2)
    touched, label = _touched(problem), problem.noise_label
    R = np.broadcast_to(problem.R, (problem.n, problem.p, problem.p))
    true = np.broadcast_to(problem.truth, R.shape)
    size = H.shape[2]
    triangles, truths = [], []
    for number in range(len(problem.noise_names)):
        mine = ~touched & (label == number)
        white = np.array(H[mine])
        L = cholesky_rows(np.ascontiguousarray(R[mine]), "noise") if mine.any() else np.zeros((0, 2, 2))
        if mine.any():
            solve_rows(L, white)
        triangles.append(_triangle(white.reshape(-1, size)))
        if problem.true_R is not None and mine.any():
            spreading = cholesky_rows(np.ascontiguousarray(true[mine]), "true noise")
            solve_rows(L, spreading)
            truths.append(_triangle(np.einsum("nqp,nqs->nps", spreading, white).reshape(-1, size)))
        else:
            truths.append(triangles[-1])
    arrays = {"what_if_information": np.array(triangles), "what_if_information_true": np.array(truths)}
    if not touched.any():
        return arrays
    rows = np.flatnonzero(touched)
    place = np.full(problem.n, -1)
    place[rows] = np.arange(rows.size)
    arrays |= {
        "what_if_rows": H[rows],
        "what_if_rows_source": np.asarray(label)[rows].astype(np.float64),
        "what_if_rows_noise": R[rows],
        "what_if_rows_noise_true": true[rows],
    }
    for k, white_one in enumerate(problem.white):
        at = place[white_one.rows]
        for suffix, Q in (("", white_one.Q), ("_true", white_one.truth)):
            spread_out = np.zeros((rows.size, problem.p, problem.p))
            spread_out[at] = projected(white_one.H, Q)
            arrays[f"what_if_white_{k}{suffix}"] = spread_out
    for k, chain in enumerate(problem.markov):
        arrays |= _chain(f"what_if_markov_{k}", chain, place)
    return arrays


def _chain(key: str, chain: Markov, place: npt.NDArray[np.int64]) -> dict[str, Array]:
    """One time-correlated nuisance as assumed and as it is; rows count those kept."""
    true = chain.truth
    return {
        f"{key}_rows": place[chain.rows].astype(np.float64),
        f"{key}_H": chain.H,
        f"{key}_F": chain.F,
        f"{key}_Q": chain.Q,
        f"{key}_P0": chain.P0,
        **({f"{key}_true_F": true.F, f"{key}_true_Q": true.Q, f"{key}_true_P0": true.P0} if chain.differs else {}),
    }


def _triangle(rows: Array) -> Array:
    """Upper triangle (s, s) with the same inner products as some rows (., s)."""
    size = rows.shape[1]
    out = np.zeros((size, size))
    if len(rows):
        found = append_rows(np.zeros((0, size)), rows)
        out[: len(found)] = found[:size]
    return out


def _priors(problem: LinearProblem, parameters: Sequence[str]) -> dict[str, Array]:
    """Covariances (s, s) of all priors together, assumed and true; zero where nothing is known."""
    place = {name: k for k, name in enumerate(parameters)}
    size = len(parameters)
    assumed, true = np.zeros((size, size)), np.zeros((size, size))
    for prior in problem.priors:
        inside = [k for k, name in enumerate(prior.names) if name in place]
        at = [place[prior.names[k]] for k in inside]
        assumed[np.ix_(at, at)] = prior.covariance[np.ix_(inside, inside)]
        true[np.ix_(at, at)] = prior.truth[np.ix_(inside, inside)]
    return {"what_if_prior": assumed, "what_if_prior_true": true}
