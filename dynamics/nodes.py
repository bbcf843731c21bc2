"""The ephemeris at the nodes of a step: read once for all sweeps, or recalled from the table of a guide.

The perturbers do not depend on the state, so where they are at the eight nodes serves every sweep, every column of Phi
and zeta, and every orbit that takes the same steps.
"""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.chebyshev import bodies_at, major_velocities_at
from nebosvod.dynamics.collocation import DERIVATIVES_FLAT as D
from nebosvod.dynamics.collocation import NODES
from nebosvod.dynamics.compilation import SUN, inlined_kernel, kernel
from nebosvod.dynamics.forces import earth_pole
from nebosvod.dynamics.model import Physics
from nebosvod.dynamics.relativity import MAJOR, major_fields
from nebosvod.dynamics.workspace import ACCELERATION, LENGTH, START, VARIATION, Memory, Steps, Work, laid_out

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


@inlined_kernel
def read_ephemeris(
    n: int, t: float, h: float, w: Work, p: Physics, coefficients: Array, layout: Integers, timing: Array
) -> None:
    """Bodies and the Sun's velocity at the nodes of the step from t to t + h, the Earth's pole amid it.

    For the relativity of all bodies their velocities, accelerations and potentials as well.
    """
    for i in range(8):
        w.t[i] = t + h * NODES[i]
    bodies_at(n, w.t, coefficients, layout, timing, p.mass_ratio, w.T, w.u, w.record, w.P)
    differentiate(n, h, w.P[SUN], w.VS)
    if p.relativity == 2:
        major_velocities_at(n, w.t, coefficients, layout, timing, p.mass_ratio, w.T, w.u, w.record, w.W)
        major_fields(n, w.P, p.gm, w.WA, w.U)
    earth_pole(p.earth_pole_of_date, p.century + (t + 0.5 * h) / 3155760000.0, w.pole)


@inlined_kernel
def differentiate(n: int, h: float, X: Array, V: Array) -> None:
    """Velocities V (24,) at the nodes from the positions X (24,) there, by the polynomial through them.

    Of the Sun, for the forces that ask how fast an orbit moves about it: good to 1e-8 km/s from a minute to twenty
    days, where 1e-5 would do. The derivative of its series takes three times as long.
    """
    scale = 1.0 / h if abs(h) > 1e-3 else 0.0  # in less, nothing moves; and there would be nothing but rounding
    for k in range(0, 24, 8):
        a0, a1, a2, a3, a4, a5, a6, a7 = X[k], X[k + 1], X[k + 2], X[k + 3], X[k + 4], X[k + 5], X[k + 6], X[k + 7]
        for i in range(n):
            V[k + i] = scale * (
                (a0 * D[i] + a1 * D[8 + i] + a2 * D[16 + i] + a3 * D[24 + i])
                + (a4 * D[32 + i] + a5 * D[40 + i] + a6 * D[48 + i] + a7 * D[56 + i])
            )


def nodes_width(bodies: int) -> int:
    """Numbers of one row of a table of nodes."""
    return 24 * bodies + 27 + MAJOR * 56


@inlined_kernel
def keep_nodes(w: Work, row: Array) -> None:
    """Write what `read_ephemeris` has found into a row of a table of nodes."""
    bodies, k = w.P.shape[0], 0
    for b in range(bodies):
        for i in range(24):
            row[k + i] = w.P[b, i]
        k += 24
    for i in range(24):
        row[k + i] = w.VS[i]
    for i in range(3):
        row[k + 24 + i] = w.pole[i]
    k += 27
    for j in range(MAJOR):
        for i in range(24):
            row[k + i], row[k + 24 + i] = w.W[j, i], w.WA[j, i]
        for i in range(8):
            row[k + 48 + i] = w.U[j, i]
        k += 56


@inlined_kernel
def recall_nodes(n: int, w: Work, row: Array, velocities: bool) -> None:
    """The other way round; the velocities and fields of the major bodies only if they are needed (EIH).

    The trip count 3 n and not 24: a constant is unrolled into single moves (0.3 us a step).
    """
    bodies, k = w.P.shape[0], np.uint64(0)
    for b in range(bodies):
        for i in range(3 * n):
            w.P[b, i] = row[k + np.uint64(i)]
        k += np.uint64(24)
    for i in range(3 * n):
        w.VS[i] = row[k + np.uint64(i)]
    for i in range(3):
        w.pole[i] = row[k + np.uint64(24 + i)]
    k += np.uint64(27)
    if velocities:
        for j in range(MAJOR):
            for i in range(24):
                w.W[j, i], w.WA[j, i] = row[k + np.uint64(i)], row[k + np.uint64(24 + i)]
            for i in range(8):
                w.U[j, i] = row[k + np.uint64(48 + i)]
            k += np.uint64(56)


@kernel
def tabulate_nodes(
    n: int, guide: Steps, p: Physics, coefficients: Array, layout: Integers, timing: Array, m: Memory, nodes: Array
) -> None:
    """Read the ephemeris at the nodes of all steps of a guide into `nodes` (steps, nodes_width)."""
    w = laid_out(m, layout.shape[0])
    for k in range(guide.rows.shape[0]):
        read_ephemeris(n, guide.rows[k, START], guide.rows[k, LENGTH], w, p, coefficients, layout, timing)
        keep_nodes(w, nodes[k])


@inlined_kernel
def follow_guide(n: int, w: Work, p: Physics, guide: Steps, nodes: Array, k: int) -> float:
    """Set up step k of a guide: bodies at its nodes, its accelerations as the first guess; returns its length."""
    for i in range(8):
        w.t[i] = guide.rows[k, START] + guide.rows[k, LENGTH] * NODES[i]
    recall_nodes(n, w, nodes[k], p.relativity == 2)
    for i in range(3 * n):
        w.known[i] = guide.rows[k, ACCELERATION + i]
    width = w.D.shape[0]
    if guide.rows.shape[1] == VARIATION + width // 4 + width:
        for i in range(width):
            w.D_known[i] = guide.rows[k, VARIATION + width // 4 + i]
    return float(guide.rows[k, LENGTH])
