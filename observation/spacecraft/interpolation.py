"""Compiled interpolation in tables of states: polynomials through the points of a window that moves along the table."""

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.compilation import allocating_kernel, kernel
from nebosvod.observation.contracts import Array


@allocating_kernel
def hermite(nodes: Array, states: Array, first: npt.NDArray[np.int64], window: int, t_s: Array, found: Array) -> None:
    """Osculating interpolation: position polynomial through w positions and velocities; velocity its derivative.

    Parameters
    ----------
    nodes : shape (k,), ascending; states : shape (k, 6) at them.
    first : shape (n,), where the window of each time begins; window : how many points w it has.
    t_s : shape (n,); found : shape (n, 6), filled.

    Notes
    -----
    Newton's divided differences on doubled nodes, in units of the window, so that degree 20 stays well scaled. They do
    not depend on the time: neighbours in one window share them.
    """
    coefficients = np.empty((2 * window, 3))
    base, scale = -1, 1.0
    for e in range(t_s.shape[0]):
        if first[e] != base:
            base = first[e]
            scale = nodes[base + window - 1] - nodes[base]
            _divided_differences(nodes, states, base, scale, coefficients)
        for axis in range(3):
            value, rate = coefficients[2 * window - 1, axis], 0.0
            for order in range(2 * window - 2, -1, -1):
                x = (t_s[e] - nodes[base + order // 2]) / scale
                rate = value + x * rate
                value = coefficients[order, axis] + x * value
            found[e, axis], found[e, 3 + axis] = value, rate / scale


@kernel
def _divided_differences(nodes: Array, states: Array, base: int, scale: float, coefficients: Array) -> None:
    """Newton coefficients (2w, 3) of positions through the window that begins at `base`, each point counted twice."""
    size = coefficients.shape[0]
    for row in range(size):
        for axis in range(3):
            coefficients[row, axis] = states[base + row // 2, axis]
    for order in range(1, size):
        for row in range(size - 1, order - 1, -1):  # upwards, so that the lower order is still there
            right, left = base + row // 2, base + (row - order) // 2
            for axis in range(3):
                if right == left:
                    coefficients[row, axis] = states[right, 3 + axis] * scale
                else:
                    rise = coefficients[row, axis] - coefficients[row - 1, axis]
                    coefficients[row, axis] = rise / ((nodes[right] - nodes[left]) / scale)


@allocating_kernel
def lagrange(nodes: Array, states: Array, first: npt.NDArray[np.int64], window: int, t_s: Array, found: Array) -> None:
    """Polynomials through the w values of each of the six components (Neville); arguments as in `hermite`."""
    values = np.empty((window, 6))
    for e in range(t_s.shape[0]):
        base = first[e]
        values[:] = states[base : base + window]
        for order in range(1, window):
            for row in range(window - order):
                left, right = nodes[base + row], nodes[base + row + order]
                part = (t_s[e] - left) / (right - left)
                for i in range(6):
                    values[row, i] += part * (values[row + 1, i] - values[row, i])
        found[e] = values[0]
