"""Watching many orbits while they fly: steps in which one comes near to a body, enters its gate, or comes low.

A step is written down with what its dense output needs, and looked at afterwards (passages.py). Closest approaches show
in the distances at the nodes: steps are so short near a body that attracts that none is passed over between two.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import inlined_kernel
from nebosvod.dynamics.stages import largest
from nebosvod.dynamics.workspace import Samples, Watch, Work

Array = npt.NDArray[np.float64]
LEFT, DOWN = 1.0, 2.0  # why an orbit does not fly on: the steps do not suit it; it came down
NEAREST, GATE, LOW = 0.0, 1.0, 2.0  # kinds of records
RECORD = (
    36  # orbit, kind, row of the body, start and length of the step, time of a node, state (6,), accelerations (24,)
)
STEEP = 5e-8  # s^-2: GM/r^3 at a tenth above the surface of every body is larger


@inlined_kernel
def leave(o: int, why: float, t: float, w: Work, samples: Samples) -> None:
    """Take an orbit off these steps, and write down from where it must go on."""
    samples.tide[o], watch = np.inf, samples.watch
    if o < watch.left.shape[0]:
        watch.left[o, 0], watch.left[o, 1] = why, t
        for i in range(3):
            watch.left[o, 2 + i], watch.left[o, 5 + i] = w.x[i], w.v[i]


@inlined_kernel
def keep(o: int, kind: float, body: int, t: float, h: float, at: float, w: Work, watch: Watch) -> None:
    """Write down the step in hand."""
    k = watch.written[0]
    watch.written[0] = k + 1
    if k < watch.records.shape[0]:
        row = watch.records[k]
        row[0], row[1], row[2], row[3], row[4], row[5] = o, kind, body, t, h, at
        for i in range(3):
            row[6 + i], row[9 + i] = w.x[i], w.v[i]
        for i in range(24):
            row[12 + i] = w.A[i]


@inlined_kernel
def smallest(values: Array) -> float:
    """Smallest of eight lanes."""
    a, b = min(values[0], values[1]), min(values[2], values[3])
    c, d = min(values[4], values[5]), min(values[6], values[7])
    return float(min(min(a, b), min(c, d)))


@inlined_kernel
def squared_distances(n: int, w: Work, body: int) -> float:
    """Squares of the distances at the nodes into w.u; the smallest is returned."""
    for i in range(n):
        x, y, z = w.X[i] - w.P[body, i], w.X[8 + i] - w.P[body, 8 + i], w.X[16 + i] - w.P[body, 16 + i]
        w.u[i] = x * x + y * y + z * z
    return smallest(w.u)


@inlined_kernel
def watched(n: int, o: int, t: float, h: float, w: Work, watch: Watch) -> bool:
    """Look at the step of orbit o from t to t + h; True if it has come down."""
    for k in range(watch.bodies.shape[0]):
        body = watch.bodies[k]
        lowest = squared_distances(n, w, body)
        before, last = watch.last2[o, 2 * k], watch.last2[o, 2 * k + 1]
        if lowest < watch.reach2[k] or (last >= 0.0 and last < watch.reach2[k]):
            for j in range(8):  # is the node before this one, or before that, the lowest of three?
                if j == 0:
                    a, b = before, last
                elif j == 1:
                    a, b = last, w.u[0]
                else:
                    a, b = w.u[j - 2], w.u[j - 1]
                if a > b and b <= w.u[j] and b < watch.reach2[k]:
                    keep(o, NEAREST, body, t, h, w.t[max(j - 1, 0)], w, watch)
            inside = last >= 0.0 and last < watch.gate2[k]
            if lowest < watch.gate2[k] and not inside:
                j = 0
                while w.u[j] >= watch.gate2[k]:
                    j += 1
                if j > 0 or last >= 0.0:
                    keep(o, GATE, body, t, h, w.t[j], w, watch)
        watch.last2[o, 2 * k], watch.last2[o, 2 * k + 1] = w.u[6], w.u[7]
    down = False
    if watch.low2.shape[0] > 0 and largest(w.tide) > STEEP:
        for body in range(watch.low2.shape[0]):
            lowest = squared_distances(n, w, body)
            if lowest < watch.low2[body]:
                j = 0
                while w.u[j] > lowest:
                    j += 1
                keep(o, LOW, body, t, h, w.t[j], w, watch)
                down = down or lowest < watch.stop2[body]
    return down
