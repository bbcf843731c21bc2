"""How far a prediction is from linear: the orbit re-propagated from points of the error ellipsoid.

The error of the estimate is factored as K = S S^T with the columns of S ordered by how much they move the predictions.
Along each column the orbit is propagated anew from +-sqrt(3) sigma (the chord of a Gaussian's fourth moment) and every
prediction evaluated on it: the even part is the second-order term C_i of that direction, w = w_0 + sum D_i eta_i +
1/2 C_i eta_i^2. Its mean shift is 1/2 sum C_i, exactly the trace of the second-order term; its spread, without the
cross terms, 1/2 sum C_i C_i^T. In sigmas of the linear ellipse the two make one measure. An error with a mean m of its
own adds 1/2 m^T C m to the shift, by a pair of orbits displaced by +-m.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.engine.quantity import Quantity, known_partials
from nebosvod.estimation import Estimate
from nebosvod.findings.displacement import moved_quantities, uncertain
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]
CHORD = float(np.sqrt(3.0))
MISLEADS = 0.3  # rms departure in sigmas: it adds a tenth to the variance of that direction
MOST_HALVINGS = 5  # of a chord whose ends have no such prediction: down to 0.05 sigma


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curvature:
    """Second-order behaviour of one prediction.

    Attributes
    ----------
    shift : (d,) mean of the second-order term, in the unit of the prediction.
    spread : (d,) its standard deviation, without cross terms.
    measure : rms departure in sigmas of the linear ellipse, over all directions.
    """

    shift: Array
    spread: Array
    measure: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nonlinearity:
    """How far one prediction, d components in its unit, is from linear.

    Attributes
    ----------
    orbits : how many were propagated.
    shortest_chord_sigma : where an orbit +-sqrt(3) sigma away has no such prediction, the nearest that was taken.
    mean_shift, second_order_sigma : (d,) mean and standard deviation of the second-order term.
    measure : rms departure in sigmas of the linear ellipse; misleads : whether that is too much.
    reason : why the four above are None; None where they are not.
    """

    method: str = "orbits propagated from +-sqrt(3) sigma"
    orbits: int
    shortest_chord_sigma: float | None = None
    mean_shift: Array | None = None
    second_order_sigma: Array | None = None
    measure: float | None = None
    misleads: bool | None = None
    reason: str | None = None


def curvature(second: Array, factor: Array) -> Curvature:
    """From second-order terms C_i (r, d) of unit draws and the linear factor (d, .) of the prediction."""
    shift = 0.5 * second.sum(axis=0)
    left, lengths, _ = np.linalg.svd(np.hstack([factor, np.zeros((len(factor),) * 2)]), full_matrices=False)
    kept = lengths > 1e-12 * lengths[0]
    white = (np.vstack([shift, second]) @ left[:, kept]) / lengths[kept]
    return Curvature(
        shift=shift,
        spread=np.sqrt(0.5 * np.sum(second**2, axis=0)),
        measure=float(np.sqrt(np.sum(white[0] ** 2) + 0.5 * np.sum(white[1:] ** 2))),
    )


def ordered_factor(estimate: Estimate, names: Sequence[str], asked: Sequence[Quantity]) -> Array:
    """Factor S (k, r) of the error of the named parameters, columns ordered by their effect on the predictions."""
    S = np.asarray(estimate.factor(names))
    rows = []
    for one in asked:
        moved = one.partials_by(names) @ S
        sigma = np.linalg.norm(moved, axis=1)
        rows.append(moved[sigma > 0.0] / sigma[sigma > 0.0, None])
    _, _, turn = np.linalg.svd(np.vstack([*rows, np.zeros((1, S.shape[1]))]), full_matrices=True)
    factor: Array = S @ turn.T
    return factor


def nonlinearity(scene: Scene, fit: Fit, asked: Sequence[Quantity]) -> list[Nonlinearity]:
    """How far each prediction of one estimator is from linear.

    Notes
    -----
    An entry may not exist on an orbit 1.7 sigma away: the chord of that direction is then halved until it does on both
    ends, and the entry says how short the shortest is.
    """
    estimate, names = fit.estimate, uncertain(fit)
    S, mean = ordered_factor(estimate, names, asked), fit.mean_errors.shift(estimate, names)
    columns = [*S.T, *([mean / CHORD] if mean.any() else [])]
    flights: dict[tuple[int, float], list[Array | None]] = {}

    def ends(direction: int, index: int, chord: float) -> list[Array | None]:
        found = []
        for signed in (chord, -chord):
            if (direction, signed) not in flights:
                deviation = dict(zip(names, (signed * columns[direction]).tolist()))
                flights[direction, signed] = moved_quantities(scene, fit, asked, deviation)
            found.append(flights[direction, signed][index])
        return found

    rows = []
    for index, one in enumerate(asked):
        bends, shortest = [], CHORD
        for direction in range(len(columns)):
            bend, chord = _second_order(partial(ends, direction, index))
            bends.append(bend)
            shortest = min(shortest, chord)
        rows.append(_bent(one, estimate, bends, S.shape[1], shortest))
    return rows


def _second_order(ends: Callable[[float], list[Array | None]]) -> tuple[Array | None, float]:
    """C_i of one direction and the chord it was taken over; None where even the shortest has an end without a value."""
    chord = CHORD
    for _ in range(MOST_HALVINGS + 1):
        up, down = ends(chord)
        if up is not None and down is not None:
            bend: Array = (up + down) / chord**2
            return bend, chord
        chord *= 0.5
    return None, 2.0 * chord


def _bent(
    one: Quantity, estimate: Estimate, bends: Sequence[Array | None], count: int, shortest: float
) -> Nonlinearity:
    """What the second-order terms of the `count` unit draws, and of a mean of the error after them, say."""
    found = [bend for bend in bends if bend is not None]
    orbits, chord = 2 * len(bends), shortest if shortest < CHORD else None
    if len(found) < len(bends):
        reason = f"an orbit at {shortest:.2g} sigma has no such prediction"
        return Nonlinearity(orbits=orbits, shortest_chord_sigma=chord, reason=reason)
    bent = curvature(np.array(found[:count]), estimate.predict(*known_partials(one, estimate)).factor)
    return Nonlinearity(
        orbits=orbits,
        shortest_chord_sigma=chord,
        mean_shift=bent.shift + 0.5 * CHORD**2 * np.sum(found[count:], axis=0),
        second_order_sigma=bent.spread,
        measure=bent.measure,
        # where the prediction ends within 1.7 sigma the ellipse holds places that no orbit comes to
        misleads=bent.measure > MISLEADS or chord is not None,
    )
