"""What the integrator works in: the memory of a step, and the table of accepted steps.

Python provides the memory; the kernels allocate nothing. Every array starts on a cache line, for vectors of 8 lanes
that lie across two cost twice the time.
"""

import threading
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import LANES, inlined_kernel
from nebosvod.dynamics.constants import MOST_ORDERS
from nebosvod.dynamics.relativity import MAJOR

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

ROW, BLOCK, LINE = 3 * LANES, MOST_ORDERS * LANES, 8  # numbers in a row (x, y, z), in a block, in a cache line
ROWS, BLOCKS, WIDE = 23, 8, 5  # how many of each `laid_out` gives names to, beside the bodies


class Memory(NamedTuple):
    """The memory of one integration."""

    rows: Array  # (ROWS, 24)
    moving: Array  # (bodies + 3 MAJOR, 24)
    blocks: Array  # (BLOCKS, 128)
    wide: Array  # (WIDE, 24 * columns)


class _Kept(threading.local):
    """The memories of one thread, by bodies and columns."""

    def __init__(self) -> None:
        self.memories: dict[tuple[int, int], Memory] = {}


_KEPT = _Kept()


class Work(NamedTuple):
    """The same memory by names; rows of 8 lanes, flat (see compilation.py). Rows may be longer than what is used."""

    strength: Array  # (4,) of radiation pressure, A1, A2, A3 for the orbit in hand; starts as that of the physics
    law: Array  # (16,) Marsden's g(r) at the nodes (see nongrav.py)
    t: Array  # (8,) node times
    u: Array  # (8,) their places in the records of an ephemeris, and in
    record: Array  # (8,) the numbers of these
    VS: Array  # (24,) velocity of the Sun
    pole: Array  # (3,) Earth's pole of date
    X: Array  # (24,) positions at the nodes
    V: Array  # (24,)
    A: Array  # (24,) accelerations
    B: Array  # (24,) accelerations of the next sweep
    tide: Array  # (8,) largest GM/r^3
    bend: Array  # (8,) largest GM/r^4 of the bodies but the Sun
    X0: Array  # (24,) where the field of the bodies but the Sun was expanded (see expansion.py)
    R0: Array  # (24,) that field there
    change: Array  # (24,) largest change, size and shift of each lane in a sweep
    before: Array  # (24,) accelerations of the last step, less those of the guide
    known: Array  # (24,) accelerations of the guide in this step; zero without one
    x: Array  # (3,) the state of the orbit in hand
    v: Array  # (3,)
    lost: Array  # (6,) the rounding that position and velocity have lost (see integrator.add_compensated)
    P: Array  # (bodies, 24) positions of the bodies at the nodes
    W: Array  # (11, 24) velocities of the major bodies (EIH only)
    WA: Array  # (11, 24) their accelerations
    U: Array  # (11, 8) the potentials they move in
    T: Array  # (8 * MOST_ORDERS,) Chebyshev polynomials at the nodes, or their derivatives (see chebyshev.py)
    Q: Array  # (32,) scratch of EIH
    S0: Array  # (48,) symmetric part of the gradient of R0
    S: Array  # (48,) symmetric part of dA/dX
    G: Array  # (72,) dA/dX
    K: Array  # (72,) dA/dV
    F: Array  # (4 * 24,) dA/d(kappa, A1, A2, A3)
    extrapolation: Array  # (64,) last nodes -> new nodes
    D: Array  # (columns * 24,) accelerations of the variations
    D_before: Array  # those of the last step, less those of the guide
    D_known: Array  # those of the guide
    px: Array  # (3 * columns,) positions of the variations at the start of the step
    pv: Array  # and velocities
    DX: Array  # (24,) positions of one column at the nodes
    DV: Array  # and velocities


def memory(bodies: int, columns: int) -> Memory:
    """Memory for so many bodies and columns of Phi and zeta; of each kind a thread has one, which it uses again."""
    kept = _KEPT.memories
    if (bodies, columns) not in kept:
        kept[bodies, columns] = new_memory(bodies, columns)
    return kept[bodies, columns]


def new_memory(bodies: int, columns: int) -> Memory:
    """Memory of its own."""
    shapes = ((ROWS, ROW), (bodies + 3 * MAJOR, ROW), (BLOCKS, BLOCK), (WIDE, ROW * columns))
    sizes = [rows * width for rows, width in shapes]
    whole = np.zeros(sum(sizes) + LINE)
    at, parts = -(whole.__array_interface__["data"][0] // whole.itemsize) % LINE, []
    for shape, size in zip(shapes, sizes):
        parts.append(whole[at : at + size].reshape(shape))
        at += size
    return Memory(*parts)


@inlined_kernel
def clear(n: int, m: Memory) -> None:
    """Forget the integration before."""
    for r in range(m.rows.shape[0]):
        for i in range(3 * n):
            m.rows[r, i] = 0.0
    for r in range(m.wide.shape[0]):
        for i in range(m.wide.shape[1]):
            m.wide[r, i] = 0.0


@inlined_kernel
def laid_out(m: Memory, bodies: int) -> Work:
    """Give names to the memory."""
    r, b, c, w = m.rows, m.moving, m.blocks, m.wide
    return Work(
        r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11], r[12], r[13], r[14], r[15], r[16],
        r[17], r[18], r[19], r[20], b[:bodies], b[bodies : bodies + MAJOR],
        b[bodies + MAJOR : bodies + 2 * MAJOR], b[bodies + 2 * MAJOR :], c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7],
        w[0], w[1], w[2], w[3], w[4], r[21], r[22],
    )  # fmt: skip


# Where a row of the table of steps holds what
START, LENGTH, TIDE, STATE, ACCELERATION, VARIATION = 0, 1, 2, 3, 9, 33


class Steps(NamedTuple):
    """All accepted steps: with the nodal accelerations they are the dense output.

    One table and not seven arrays, each of which costs a quarter of a microsecond wherever steps are made, cut or
    handed to a kernel. A row: start, length, tide, state (6), accelerations (24), then of the variations position parts
    of all columns, velocity parts (together 6 * columns) and accelerations (24 * columns).
    """

    rows: Array  # (n, 33 + 30 * columns)

    @property
    def start(self) -> Array:
        """Seconds after the epoch, shape (n,)."""
        return self.rows[:, START]

    @property
    def length(self) -> Array:
        """Seconds, signed, shape (n,)."""
        return self.rows[:, LENGTH]

    @property
    def tide(self) -> Array:
        """Largest GM/r^3 met in each step, shape (n,), s^-2."""
        return self.rows[:, TIDE]

    @property
    def state(self) -> Array:
        """Barycentric states at the starts, shape (n, 6), km, km/s."""
        return self.rows[:, STATE:ACCELERATION]


class Watch(NamedTuple):
    """Which bodies many orbits are watched near, and what was seen; empty where nobody watches."""

    bodies: Integers  # (b,) their rows among the bodies
    reach2: Array  # (b,) km^2: closest approaches within it are written down
    gate2: Array  # (b,) km^2: so is the step in which an orbit comes within this
    low2: Array  # (bodies,) km^2 of every body: and each step with a node below this, a little above its surface
    stop2: Array  # (bodies,) km^2: an orbit below this has come down for certain, and ends
    last2: Array  # (orbits, 2 b) squared distances at the last two nodes; negative where there are none yet
    records: Array  # (room, RECORD) see `watch.keep`
    written: Integers  # (1,) how many there are, or would be with more room
    left: Array  # (orbits, 8): LEFT, DOWN or 0, and the time and barycentric state from which an orbit goes on


class Samples(NamedTuple):
    """Where many orbits on one grid are wanted, and what they were there; empty for one orbit."""

    chosen: Integers  # (c,) which of the times lie on this leg, in the order of its steps
    step: Integers  # (times,) the step that holds each
    weights: Array  # (times, 17) of its nodes: see `dense.step_weights`, then seconds from its start
    sun: Array  # (times, 6) barycentric
    states: Array  # (orbits, times, 6) heliocentric: the result
    tide: Array  # (orbits,) largest GM/r^3 met; infinite where an orbit left the grid
    watch: Watch


def make_steps(capacity: int, columns: int) -> Steps:
    """Room for `capacity` steps."""
    return Steps(np.empty((capacity, VARIATION + 30 * columns)))


def first_steps(steps: Steps, count: int) -> Steps:
    """The first `count` steps."""
    return Steps(steps.rows[:count])


def enlarged(steps: Steps, columns: int, most: int) -> Steps:
    """Room for twice as many steps, but not for more than `most`, with those there are."""
    count = len(steps.rows)
    new = make_steps(min(2 * count, most), columns)
    new.rows[:count] = steps.rows
    return new


# What stands for "no guide"
NO_STEPS = make_steps(0, 0)
NO_NODES: Array = np.empty((0, 0))
# and for "no samples"
NO_WATCH = Watch(
    np.empty(0, np.int64), np.empty(0), np.empty(0), np.empty(0), np.empty(0), np.empty((0, 0)), np.empty((0, 0)),
    np.zeros(1, np.int64), np.empty((0, 8)),
)  # fmt: skip
NO_SAMPLES = Samples(
    np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 17)), np.empty((0, 6)), np.empty((0, 0, 6)), np.empty(0),
    NO_WATCH,
)  # fmt: skip
