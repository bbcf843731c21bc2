"""The inside of an estimate, where a mission asks to see it: information, gains, refined nuisances, smallness, boxes.

Names are those of Guo and Ivashkin 2018: D0, k_x0, k_c, k_z, z-hat_k, K_z and the smallness check (2.7).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.engine.assembly import computed_psi, view
from nebosvod.engine.fitting import Fit
from nebosvod.engine.quantity import Quantity
from nebosvod.errors import CoverageError, EventError, InputError
from nebosvod.estimation import LinearProblem, Markov, White
from nebosvod.estimation.accuracy.refined import refine, response
from nebosvod.estimation.problem.sources import measurement_gain
from nebosvod.estimation.problem.square_root import cholesky_rows, solve_rows, solve_rows_transposed
from nebosvod.estimation.problem.whitening import add_white
from nebosvod.estimation.solvers import batch
from nebosvod.estimation.solvers.iteration import recentred
from nebosvod.findings.boxes import Imitation, Realised, imitations, realised
from nebosvod.mission.slugs import array_name
from nebosvod.observation import residual
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.scene.scene import Scene
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
SMALL = 0.3  # of the noise: second-order terms below this add less than a tenth to a variance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Information:
    """What one measurement tells of the state on average.

    Attributes
    ----------
    D0 : (6, 6) sigma^2 / N times sum H^T iR H, so that noise alone gives K = sigma^2 / N D0^-1.
    sigma_arcsec : root mean square of the noise of one component; count : N, components counted one by one.
    sigma_position_km : of that K, root trace; infinite where D0 is singular.
    """

    D0: Array
    sigma_arcsec: float
    count: int
    sigma_position_km: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Smallness:
    """Second-order terms of the measurements one sigma from the estimate, over the noise.

    Attributes
    ----------
    largest, rms : over measurements, components and the axes of the error ellipsoid; infinite where one is no orbit.
    small : whether the largest is below SMALL.
    """

    largest: float
    rms: float

    @property
    def small(self) -> bool:
        """Whether linearisation does."""
        return self.largest < SMALL


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inside:
    """What was asked for of one estimate; None and empty where it was not."""

    estimator: str
    information: Information | None
    smallness: Smallness | None
    bounds: tuple[Realised, ...] | None
    imitations: tuple[Imitation, ...] | None
    arrays: Mapping[str, Array]


def inside(scene: Scene, fit: Fit, predicted: Sequence[Quantity], wanted: tuple[str, ...]) -> Inside:
    """Show what a mission asks for, by the words of `nebosvod.mission.request.Shown`."""
    arrays: dict[str, Array] = {}
    told = information(fit.problem) if "information" in wanted else None
    if told is not None:
        arrays["D0"] = told.D0
    if "gains" in wanted:
        arrays |= gains(fit)
    if "full_gains" in wanted:
        arrays |= full_gains(fit)
    if "nuisances" in wanted:
        arrays |= nuisances(fit)
    return Inside(
        estimator=fit.estimator.name,
        information=told,
        smallness=smallness(scene, fit) if "smallness" in wanted else None,
        bounds=realised(fit, predicted) if "bounds" in wanted else None,
        imitations=imitations(fit) if "imitation" in wanted else None,
        arrays=arrays,
    )


def information(problem: LinearProblem) -> Information:
    """D0 of the state from the measurement noise alone."""
    n, p = problem.n, problem.p
    R = np.broadcast_to(problem.R, (n, p, p))
    rows = np.array(problem.blocks[0].H)
    solve_rows(cholesky_rows(np.ascontiguousarray(R), "noise"), rows)
    flat = rows.reshape(n * p, -1)
    count, sigma = n * p, float(np.sqrt(np.einsum("npp->", R) / (n * p)))
    D0 = sigma**2 / count * flat.T @ flat
    unit = np.sqrt(np.diag(D0))
    scaled = D0 / unit[:, None] / unit
    known = np.linalg.cond(scaled) < 1e13
    K = np.linalg.solve(scaled, np.eye(len(unit))) / unit[:, None] / unit if known else np.full_like(D0, np.inf)
    position = sigma * np.sqrt(np.trace(K[:3, :3]) / count)
    return Information(D0=D0, sigma_arcsec=sigma / ARCSEC, count=count, sigma_position_km=float(position))


def gains(fit: Fit) -> dict[str, Array]:
    """k_x0 (6, n, p), k_c (m, n, p), and k_z (n_r, q, p) of each estimated fresh nuisance by its own measurement.

    Notes
    -----
    z-hat_k = Q_k H_zk^T iRz_k (v_k - H_k s-hat), so its gain by its own measurement is Q_k H_zk^T iRz_k (I - H_k k_k).
    """
    problem, names = fit.problem, fit.estimate.names
    M = measurement_gain(problem)  # (n, p, s)
    place = {name: index for index, name in enumerate(names)}
    state = [place[name] for name in STATE_NAMES]
    common = [place[name] for name in fit.observation.parameter_names if name in place]
    found = {"gain_x0": np.moveaxis(M[:, :, state], 2, 0), "gain_c": np.moveaxis(M[:, :, common], 2, 0)}
    H = np.concatenate([block.H for block in problem.blocks if block.treatment == "estimated"], axis=2)
    order = [place[name] for block in problem.blocks if block.treatment == "estimated" for name in block.names]
    left = np.eye(problem.p) - np.einsum("npk,nqk->npq", H, M[:, :, order])
    total = np.array(np.broadcast_to(problem.R, (problem.n, problem.p, problem.p)))
    mine = [white for white in problem.white if white.treatment == "estimated"]
    for white in mine:
        add_white(total, white, white.Q)
    L = cholesky_rows(total, "noise")
    for white in mine:
        rows = np.ascontiguousarray(left[white.rows])
        own = np.ascontiguousarray(L[white.rows])
        solve_rows(own, rows)
        solve_rows_transposed(own, rows)
        Q = np.broadcast_to(white.Q, (len(white.rows), *white.Q.shape[1:]))
        found[f"gain_z_{array_name(white.name)}"] = np.einsum("nqr,npr,npo->nqo", Q, white.H, rows)
    return found


def full_gains(fit: Fit) -> dict[str, Array]:
    """k_z (n_r, q, n, p) of every estimated nuisance that is fresh or correlated in time, by every measurement."""
    M = measurement_gain(fit.problem)
    groups: tuple[White | Markov, ...] = (*fit.problem.white, *fit.problem.markov)
    return {
        f"gain_z_full_{array_name(group.name)}": response(fit.problem, group.name, M)
        for group in groups
        if group.treatment == "estimated"
    }


def nuisances(fit: Fit) -> dict[str, Array]:
    """z-hat_k (n_r, q) and K_z (n_r, q, q) of every estimated nuisance that is fresh or correlated in time."""
    found: dict[str, Array] = {}
    problem = recentred(fit.problem, fit.deviation)
    estimate = batch.solve(problem)
    groups: tuple[White | Markov, ...] = (*problem.white, *problem.markov)
    for group in groups:
        if group.treatment == "estimated":
            one = refine(problem, estimate, group.name)
            found[f"z_{array_name(group.name)}"] = one.mean
            found[f"K_z_{array_name(group.name)}"] = one.covariance
    return found


def smallness(scene: Scene, fit: Fit) -> Smallness:
    """Second-order terms of the measurements over the noise: orbits one sigma along the axes of the error ellipsoid.

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, (2.7).
    """
    names = tuple(name for name in fit.estimate.names if name in {*STATE_NAMES, *fit.observation.parameter_names})
    S = fit.estimate.factor(names)
    here = computed_psi(fit.seen)
    noise = np.sqrt(np.einsum("npp->np", np.broadcast_to(fit.problem.R, (fit.problem.n, 2, 2))))
    ratios = []
    for column in S.T:
        try:
            ends = [
                computed_psi(view(scene, fit.point.moved(dict(zip(names, sign * column))), simulates=False))
                for sign in (-1.0, 1.0)
            ]
        except (InputError, CoverageError, EventError):
            return Smallness(largest=float("inf"), rms=float("inf"))
        ratios.append(0.5 * (residual(ends[0], here) + residual(ends[1], here)) / noise)
    every = np.abs(np.array(ratios))
    return Smallness(largest=float(every.max()), rms=float(np.sqrt(np.mean(every**2))))
