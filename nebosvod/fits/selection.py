"""Correct, judge each observation, select anew: until the selection stands."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel
from nebosvod.errors import CoverageError, EventError, InputError
from nebosvod.estimation import Status
from nebosvod.estimation.solvers.rejection import Thresholds, chi_squared, reselect, settled, turning
from nebosvod.fits.correction import LIMIT, Correction, Knowledge, correct
from nebosvod.observation.measurement.exposures import Sky

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
ROUNDS = 30


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Selected:
    """A correction and the observations it was made from.

    Attributes
    ----------
    chi2 : (n,) chi squared of each observation by the covariance of its own residual; nan where not observable.
    stands : whether another round would select the same; without, the rounds went in a circle or to their limit.
    """

    correction: Correction
    selected: Flags
    chi2: Array
    rounds: int
    stands: bool


def select(
    sky: Sky,
    x: Array,
    forces: ForceModel,
    thresholds: Thresholds | None,
    *,
    selected: Flags | None = None,
    prior: Knowledge | None = None,
    near: Correction | None = None,
    keep: Flags | None = None,
    limit: int = LIMIT,
) -> Selected:
    """Fit with rejection and recovery of observations.

    Parameters
    ----------
    x : shape (6 + m,), start.
    thresholds : None keeps every observation.
    selected : shape (n,), which count at first; all by default.
    near : an earlier correction of the same directions and forces, to be used again.
    keep : shape (n,), which are never left out.

    Notes
    -----
    Never fewer stay than determine the parameters with one observation to spare. Observations that go to and fro agree
    with the fit of the others, so they are kept; where the rounds still go in a circle, the selection does not stand.

    References
    ----------
    Carpino, Milani, Chesley 2003, Icarus 166, 248, section 5.
    """
    chosen = np.ones(len(sky), dtype=bool) if selected is None else selected
    least = min(len(sky), len(x) // 2 + 1)
    history: list[Flags] = []
    held = np.zeros(len(sky), dtype=bool)
    kept = held if keep is None else keep
    found = correct(sky, x, forces, selected=chosen, prior=prior, near=near, limit=limit)
    chi2 = judged(sky, found, chosen)
    while thresholds is not None and found.S is not None and len(history) < ROUNDS:
        latest = reselect(chi2, chosen, thresholds, least, held | kept)
        if np.array_equal(latest, chosen):
            break
        if settled(history, latest) and not held.any():
            held = turning([*history, chosen], latest)
            latest = latest | held
            history = []
        if settled(history, latest) or found.status is Status.DIVERGED:
            return Selected(correction=found, selected=chosen, chi2=chi2, rounds=len(history), stands=False)
        history.append(chosen)
        chosen = latest
        found = correct(sky, found.x, forces, selected=chosen, prior=prior, near=found, limit=limit)
        chi2 = judged(sky, found, chosen)
    stands = len(history) < ROUNDS
    return Selected(correction=found, selected=chosen, chi2=chi2, rounds=len(history), stands=stands)


def attempted(
    sky: Sky, x: Array, forces: ForceModel, thresholds: Thresholds | None, prior: Knowledge | None
) -> Selected | None:
    """A fit of part of a sky by `select`; None where it comes to no orbit."""
    try:
        return select(sky, x, forces, thresholds, prior=prior)
    except (EventError, CoverageError, InputError):
        return None


def judged(sky: Sky, found: Correction, chosen: Flags) -> Array:
    """Chi squared (n,) of every observation; nan where the correction has no covariance."""
    if found.S is None:
        return np.full(len(sky), np.nan)
    return chi_squared(found.residual, sky.R, found.seen.H, found.S, chosen)
