"""The compiled integrator: X, Phi and zeta in one march by 8-stage Gauss-Legendre collocation (order 16).

Here is the march from step to step: their length, which follows the last Legendre coefficient of the acceleration,
relative to the acceleration; the sums over steps, with the rounding they lose kept; and what is written of each step.
What happens inside a step is in stages.py, the ephemeris at its nodes in nodes.py.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.collocation import LAST_ROW, STEP_WEIGHTS
from nebosvod.dynamics.compilation import LANES, STATE_ROWS, inlined_kernel, kernel, straight
from nebosvod.dynamics.model import Arc, Physics
from nebosvod.dynamics.nodes import follow_guide, read_ephemeris
from nebosvod.dynamics.stages import (
    extrapolation,
    largest,
    remember,
    solve_state,
    solve_variations,
    weighed,
)
from nebosvod.dynamics.watch import DOWN, LEFT, leave, watched
from nebosvod.dynamics.workspace import (
    ACCELERATION,
    LENGTH,
    START,
    STATE,
    TIDE,
    VARIATION,
    Memory,
    Samples,
    Steps,
    Work,
    clear,
    enlarged,
    first_steps,
    laid_out,
    make_steps,
    memory,
)

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

OK, STALLED, TOO_MANY_STEPS, OFF_GRID, FULL, LOW = 0, 1, 2, 3, 4, 5
FIRST_PART = 0.15  # of the free-fall time, at a tolerance of 1e-11: a first step that is seldom in vain
LARGEST_STEP_S = 20.0 * 86400.0  # the Moon goes round in 27 days; seen by longer steps, it would be another Moon
SMALLEST_STEP_S = 1e-3
# By how much the error of a step may exceed the tolerance; on a grid, chosen for another orbit, by more
EXCESS, EXCESS_ON_A_GRID = 3.0, 10.0
MOST_STEPS = 2_000_000
USUAL_STEP_S = 5.0 * 86400.0  # of a near-Earth asteroid: how many steps room is made for


@inlined_kernel
def add_compensated(x: Array, lost: Array, k: int, term: float) -> None:
    """x[k] += term, with the rounding error kept in lost[k] (Kahan)."""
    y = term + lost[k]
    z = x[k] + y
    lost[k] = y - (z - x[k])
    x[k] = z


@inlined_kernel
def advance(n: int, w: Work, h: float) -> None:
    """Move the state and the variations to the end of the step."""
    for k in range(3):
        q, s = weighed(STEP_WEIGHTS, w.A, 8 * k)
        add_compensated(w.x, w.lost, k, h * w.v[k] + h * h * s + h * w.lost[3 + k])
        add_compensated(w.v, w.lost[3:], k, h * q)
    remember(n, w.A, w.known, STATE_ROWS, w.before)
    rows = w.D.shape[0] // 8
    for r in range(rows):
        q, s = weighed(STEP_WEIGHTS, w.D, 8 * r)
        w.px[r] += h * w.pv[r] + h * h * s
        w.pv[r] += h * q
    remember(n, w.D, w.D_known, rows, w.D_before)


@inlined_kernel
def last_coefficient(A: Array) -> float:
    """Largest component of the degree 7 Legendre coefficient of the acceleration; infinite if one is not a number."""
    largest, total = 0.0, 0.0
    for k in range(0, 24, 8):
        s = 0.0
        for i in range(8):
            s += LAST_ROW[i] * A[k + i]
        largest = max(largest, abs(s))
        total += s
    return float(largest) if np.isfinite(total) else np.inf


@inlined_kernel
def first_step(w: Work, p: Physics, tolerance: float, least_fall_s: float) -> float:
    """Part of the shortest free-fall time to any body, w.P being the bodies at the start; 0 where that is too short."""
    shortest = 1e300
    for b in range(p.gm.shape[0]):
        r2 = (w.x[0] - w.P[b, 0]) ** 2 + (w.x[1] - w.P[b, 8]) ** 2 + (w.x[2] - w.P[b, 16]) ** 2
        shortest = min(shortest, np.sqrt(r2 * np.sqrt(r2) / p.gm[b]))
    part = FIRST_PART * (tolerance / 1e-11) ** (1.0 / 7.0)
    return 0.0 if shortest < least_fall_s else float(min(LARGEST_STEP_S, part * shortest))


@inlined_kernel
def shorter_step(h: float, error: float, limit: float) -> float:
    """The length after a step in vain."""
    return float(h * max(0.2, 0.9 * (limit / error) ** (1.0 / 7.0)))


@inlined_kernel
def next_step(h: float, error: float, limit: float) -> float:
    """The length after an accepted step: the error goes with the seventh power."""
    growth = 2.0 if error == 0.0 else (limit / error) ** (1.0 / 7.0)
    return float(np.copysign(min(LARGEST_STEP_S, abs(h) * min(2.0, max(0.3, growth))), h))


@inlined_kernel
def store(n: int, s: Steps, k: int, t: float, h: float, w: Work) -> float:
    """Write step k; returns the largest tide in it."""
    row, tide = s.rows[k], largest(w.tide)
    row[START], row[LENGTH], row[TIDE] = t, h, tide
    for i in range(3):
        row[STATE + i], row[STATE + 3 + i] = w.x[i], w.v[i]
    for i in range(3 * n):
        row[ACCELERATION + i] = w.A[i]
    rows = w.D.shape[0] // 8
    for i in range(rows):
        row[VARIATION + i], row[VARIATION + rows + i] = w.px[i], w.pv[i]
    for i in range(n * rows):
        row[VARIATION + 2 * rows + i] = w.D[i]
    return tide


@inlined_kernel
def take_up(n: int, w: Work, orbit: Array, strength: Array) -> None:
    """Put what is known of one orbit, a row of `orbits`, where a step works."""
    for i in range(4):
        w.strength[i] = strength[i]
    for i in range(3):
        w.x[i], w.v[i], w.lost[i], w.lost[3 + i] = orbit[i], orbit[3 + i], orbit[6 + i], orbit[9 + i]
    for i in range(3 * n):
        w.before[i] = orbit[12 + i]


@inlined_kernel
def begin(n: int, m: Memory, w: Work, orbit: Array, strength: Array) -> None:
    """Forget the integration before, put one orbit where a step works, and Phi = I, zeta = 0."""
    clear(n, m)
    take_up(n, w, orbit, strength)
    for i in range(min(3, w.px.shape[0])):
        w.px[4 * i], w.pv[9 + 4 * i] = 1.0, 1.0


@inlined_kernel
def put_down(n: int, w: Work, orbit: Array) -> None:
    """The other way round, after the step."""
    for i in range(3):
        orbit[i], orbit[3 + i], orbit[6 + i], orbit[9 + i] = w.x[i], w.v[i], w.lost[i], w.lost[3 + i]
    for i in range(3 * n):
        orbit[12 + i] = w.before[i]


@inlined_kernel
def sample(o: int, taken: int, first: int, w: Work, samples: Samples) -> int:
    """States of orbit o at the times, from the first, that lie in the step in hand; returns the first that does not."""
    while first < samples.chosen.shape[0] and samples.step[samples.chosen[first]] == taken:
        e = samples.chosen[first]
        for i in range(3):
            q, r = weighed(samples.weights[e], w.A, 8 * i)
            samples.states[o, e, i] = w.x[i] + (samples.weights[e, 16] * w.v[i] + r) - samples.sun[e, i]
            samples.states[o, e, 3 + i] = w.v[i] + q - samples.sun[e, 3 + i]
        first += 1
    samples.tide[o] = max(samples.tide[o], largest(w.tide))
    return first


@kernel
def march(
    n: int, orbits: Array, strengths: Array, end_s: float, coefficients: Array, layout: Integers, timing: Array,
    physics: tuple[Any, ...], columns: Integers, tolerance: float, guide: Steps, nodes: Array, samples: Samples,
    m: Memory, clock: Array, steps: Steps,
) -> int:  # fmt: skip
    """Go on from where `clock` (6,) stands: time, length of the next step and of the last one, steps taken, the
    largest tide met in them, and the free-fall time below which an orbit of its own is not begun.

    n is the number of lanes, 8: a run-time number on purpose, for a constant is unrolled before it can be vectorised.
    The other arguments are those of `integrate`, `arc` in its parts; `orbits` (k, 36) holds what is known of each, `m`
    what lasts of a step, and `steps` what has been taken.
    Returns a status, FULL when there is no more room for steps.
    """
    p = Physics(*physics)  # handed over as a bare tuple, which costs 2 us less
    w, sampled, guided = laid_out(m, layout.shape[0]), samples.tide.shape[0] > 0, guide.rows.shape[0] > 0
    t, h, h_before, taken = clock[0], clock[1], clock[2], int(clock[3])
    shown, following, sign, status = 0, 0, 1.0 if end_s > 0.0 else -1.0, OK
    converged, down, error, limit, excess = True, False, 0.0, 0.0, EXCESS_ON_A_GRID if guided else EXCESS
    if taken == 0:
        begin(n, m, w, orbits[0], strengths[0])
    while sign * (end_s - t) > 0.0 and taken < MOST_STEPS and (guided or not down):
        if not sampled and taken == steps.rows.shape[0]:
            status = FULL
            break
        if guided:
            h = follow_guide(n, w, p, guide, nodes, taken)
            t_next = end_s if taken == guide.rows.shape[0] - 1 else t + h
        else:
            first = h == 0.0
            t_next = end_s if not first and sign * (t + h - end_s) >= -1e-9 * abs(h) else t + h
            if not first and abs(t_next - t) < SMALLEST_STEP_S and t_next != end_s:
                status = STALLED
                break
            h = t_next - t
            read_ephemeris(n, t, h, w, p, coefficients, layout, timing)
            if first:  # how long it may be, the bodies tell
                h = sign * first_step(w, p, tolerance, clock[5])
                if h == 0.0:
                    status = LOW if clock[5] > 0.0 else STALLED
                    break
                continue
        extrapolation(n, h, h_before, w.extrapolation)
        for o in range(orbits.shape[0]):  # orbits inside steps: the bodies of a step are fetched once for all
            if sampled:
                if samples.tide[o] == np.inf:
                    continue
                take_up(n, w, orbits[o], strengths[o])
            converged, noise, size = solve_state(n, w, p, h)
            error, limit = last_coefficient(w.A) / size, max(tolerance, noise)
            if not converged or error > excess * limit:
                if sampled and guided:
                    leave(o, LEFT, t, w, samples)
                continue
            solve_variations(n, w, p, columns, h)
            if sampled:
                following, down = sample(o, taken, shown, w, samples), watched(n, o, t, h, w, samples.watch)
            else:
                clock[4] = max(clock[4], store(n, steps, taken, t, h, w))
            advance(n, w, h)
            if sampled:
                put_down(n, w, orbits[o])
            if down:
                leave(o, DOWN, t_next, w, samples)
        shown = following
        if not (sampled and guided) and (not converged or error > excess * limit):
            if guided:
                status = OFF_GRID
                break
            h, h_before = (shorter_step(h, error, limit), h_before) if converged else (0.4 * h, 0.0)
            continue
        t, h_before, h, taken = t_next, h, next_step(h, error, limit), taken + 1
    clock[0], clock[1], clock[2], clock[3] = t, h, h_before, taken
    return TOO_MANY_STEPS if taken >= MOST_STEPS and sign * (end_s - t) > 0.0 else status


def integrate(
    arc: Arc, starts: Array, strengths: Array, end_s: float, columns: Integers, variations: bool, tolerance: float,
    guide: Steps, nodes: Array, samples: Samples, most: int = MOST_STEPS, least_fall_s: float = 0.0,
) -> tuple[int, Steps, float]:  # fmt: skip
    """Integrate one orbit, or many on the grid of a guide, from t = 0 to end_s (either sign).

    Parameters
    ----------
    arc : the ephemeris over it, the Sun at t = 0, the forces.
    starts : shape (k, 6), heliocentric position and velocity at t = 0, km, km/s.
    strengths : shape (k, 4), of radiation pressure, A1, A2 and A3, as in `Physics.strength`.
    end_s : TDB seconds after the epoch.
    columns, variations : which of kappa, A1, A2, A3 (q,) are integrated; whether they and Phi are at all.
    tolerance : at which the last Legendre coefficient of the acceleration, relative, is held. A step is made anew where
        it is EXCESS times as large, on a grid EXCESS_ON_A_GRID times.
    guide, nodes : steps of a near orbit over the same span and the ephemeris at their nodes: the orbits take the same
        steps, and iterate their difference from the guide; no steps if there is none.
    samples : empty where one orbit's steps are wanted. Else none are given and no variations are integrated: many
        orbits on a guide are evaluated at times, and watched; one without a guide is watched on steps of its own. What
        is left of `samples.watch.left` at the end is where those are that fly on.
    most : how many steps of one orbit there may be, up to MOST_STEPS; each keeps 0.3 to 3 kB.
    least_fall_s : no step is made, without a guide, where the free-fall time to a body is shorter at the start.

    Returns a status (OK, STALLED, TOO_MANY_STEPS, OFF_GRID if the guide's steps do not suit, or LOW if none was made),
    the accepted steps and the largest GM/r^3 met in them, s^-2.
    """
    count = 6 + len(columns) if variations else 0
    window = arc.window
    lasting, clock, orbits = memory(len(window.layout), count), np.zeros(6), np.zeros((len(starts), 36))
    np.add(starts, arc.sun, out=orbits[:, :6])
    clock[5] = least_fall_s
    expected = len(guide.rows) or min(int(abs(end_s) / USUAL_STEP_S) + 16, most)
    steps, status = make_steps(0 if len(samples.tide) else expected, count), FULL
    forces, one = tuple(arc.physics), not len(guide.rows) and not len(samples.tide)
    while status == FULL:
        status = (straight(march) if one else march)(
            LANES, orbits, strengths, end_s, window.coefficients, window.layout, window.timing, forces, columns,
            tolerance, guide, nodes, samples, lasting, clock, steps,
        )  # fmt: skip
        if status == FULL and len(steps.rows) >= most:
            status = TOO_MANY_STEPS
        elif status == FULL:
            steps = enlarged(steps, count, most)
    if len(samples.watch.left):
        flying = samples.watch.left[:, 0] == 0.0
        samples.watch.left[flying, 1], samples.watch.left[flying, 2:] = clock[0], orbits[flying, :6]
    taken = 0 if len(samples.tide) else int(clock[3])
    return status, steps if taken == len(steps.rows) else first_steps(steps, taken), clock.item(4)
