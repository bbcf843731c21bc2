"""What the integrator works in: scratch arrays of a step, and the table of accepted steps."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import kernel
from nebosvod.dynamics.relativity import MAJOR

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


class Work(NamedTuple):
    """Scratch arrays of one integration; rows of 8 lanes, flat (see compilation.py)."""

    strength: Array  # (4,) of radiation pressure, A1, A2, A3 for the orbit in hand; starts as that of the physics
    law: Array  # (16,) Marsden's g(r) at the nodes (see nongrav.py)
    t: Array  # (8,) node times
    P: Array  # (bodies, 24) positions of the bodies at the nodes
    VS: Array  # (24,) velocity of the Sun
    W: Array  # (11, 24) velocities of the major bodies (EIH only)
    WA: Array  # (11, 24) their accelerations
    U: Array  # (11, 8) the potentials they move in
    Q: Array  # (32,) scratch of EIH
    pole: Array  # (3,) Earth's pole of date
    X: Array  # (24,) positions at the nodes
    V: Array  # (24,)
    A: Array  # (24,) accelerations
    B: Array  # (24,) accelerations of the next sweep
    tide: Array  # (8,) largest GM/r^3
    bend: Array  # (8,) largest GM/r^4 of the bodies but the Sun
    X0: Array  # (24,) where the field of the bodies but the Sun was expanded (see expansion.py)
    R0: Array  # (24,) that field there
    S0: Array  # (48,) and the symmetric part of its gradient
    before: Array  # (24,) accelerations of the last step, less those of the guide
    known: Array  # (24,) accelerations of the guide in this step; zero without one
    extrapolation: Array  # (64,) last nodes -> new nodes
    S: Array  # (48,) symmetric part of dA/dX
    G: Array  # (72,) dA/dX
    K: Array  # (72,) dA/dV
    F: Array  # (4 * 24,) dA/d(kappa, A1, A2, A3)
    D: Array  # (columns * 24,) accelerations of the variations
    E: Array  # the same of the next sweep
    DX: Array  # their positions
    DV: Array  # and velocities
    D_before: Array  # accelerations of the variations of the last step, less those of the guide
    D_known: Array  # those of the guide


class Steps(NamedTuple):
    """All accepted steps: with the nodal accelerations they are the dense output."""

    start: Array  # (n,) seconds after the epoch
    length: Array  # (n,) signed
    state: Array  # (n, 6) barycentric at the start
    acceleration: Array  # (n, 24)
    variation: Array  # (n, 6 * columns) position parts of all columns, then velocity parts
    variation_acceleration: Array  # (n, 24 * columns)
    tide: Array  # (n,) largest GM/r^3 met in the step, s^-2


class Samples(NamedTuple):
    """Where many orbits on one grid are wanted, and what they were there; empty for one orbit."""

    chosen: Integers  # (c,) which of the times lie on this leg, in the order of its steps
    step: Integers  # (times,) the step that holds each
    weights: Array  # (times, 17) of its nodes: see `dense.step_weights`, then seconds from its start
    sun: Array  # (times, 6) barycentric
    states: Array  # (k, times, 6) heliocentric: filled
    tide: Array  # (k,) largest GM/r^3 met by each orbit: raised; infinite where its integration stopped


@kernel
def make_work(bodies: int, columns: int) -> Work:
    """Allocate the scratch arrays."""
    wide = 24 * columns
    return Work(
        np.zeros(4), np.zeros(16), np.zeros(8), np.zeros((bodies, 24)), np.zeros(24), np.zeros((MAJOR, 24)),
        np.zeros((MAJOR, 24)), np.zeros((MAJOR, 8)), np.zeros(32), np.zeros(3), np.zeros(24), np.zeros(24),
        np.zeros(24), np.zeros(24), np.zeros(8), np.zeros(8), np.zeros(24), np.zeros(24), np.zeros(48),
        np.zeros(24), np.zeros(24), np.zeros(64), np.zeros(48), np.zeros(72), np.zeros(72), np.zeros(96),
        np.zeros(wide), np.zeros(wide), np.zeros(wide), np.zeros(wide), np.zeros(wide), np.zeros(wide),
    )  # fmt: skip


@kernel
def make_steps(capacity: int, columns: int) -> Steps:
    """Allocate room for `capacity` steps."""
    return Steps(
        np.empty(capacity), np.empty(capacity), np.empty((capacity, 6)), np.empty((capacity, 24)),
        np.empty((capacity, 6 * columns)), np.empty((capacity, 24 * columns)), np.empty(capacity),
    )  # fmt: skip


@kernel
def resized(old: Steps, count: int, capacity: int, columns: int) -> Steps:
    """Copy the first `count` steps into room for `capacity`."""
    new = make_steps(capacity, columns)
    for k in range(count):  # loops, not slices: a slice assignment brings 4 s of compilation with it
        new.start[k], new.length[k], new.tide[k] = old.start[k], old.length[k], old.tide[k]
        for i in range(6):
            new.state[k, i] = old.state[k, i]
        for i in range(24):
            new.acceleration[k, i] = old.acceleration[k, i]
        for i in range(6 * columns):
            new.variation[k, i] = old.variation[k, i]
        for i in range(24 * columns):
            new.variation_acceleration[k, i] = old.variation_acceleration[k, i]
    return new


# What stands for "no guide"
NO_STEPS = Steps(
    np.empty(0), np.empty(0), np.empty((0, 6)), np.empty((0, 24)), np.empty((0, 0)), np.empty((0, 0)), np.empty(0)
)
NO_NODES: Array = np.empty((0, 0))
# and for "no samples"
NO_SAMPLES = Samples(
    np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 17)), np.empty((0, 6)), np.empty((0, 0, 6)), np.empty(0)
)
