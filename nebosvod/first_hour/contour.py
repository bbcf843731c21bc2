"""Closed lines around the densest parts of a cloud of points in a plane."""

import contourpy
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
SHARES = (0.68, 0.95)
CELLS, REACH = 64, 0.15  # of the map of density, and how far it goes beyond the points


def contours(points: Array, weight: Array | None = None) -> dict[str, list[Array]]:
    """Lines (k, 2) around the densest parts of points (m, 2), by the share of them that they hold: "68" and "95".

    Notes
    -----
    The density is that of normal kernels on the principal axes, with Scott's width.
    """
    w = np.full(len(points), 1.0 / len(points)) if weight is None else weight / weight.sum()
    middle = w @ points
    away = np.sqrt(w)[:, None] * (points - middle)
    axes = np.linalg.svd(np.hstack([away.T, np.zeros((2, 2))]), full_matrices=False)[0]
    flat = (points - middle) @ axes
    size = np.maximum(np.ptp(flat, axis=0), 1e-12)
    sigma = np.sqrt(w @ flat**2)
    width = np.maximum(sigma * float(1.0 / np.sum(w**2)) ** (-1.0 / 6.0), 1e-3 * size)
    low, high = flat.min(axis=0) - 3.0 * width - REACH * size, flat.max(axis=0) + 3.0 * width + REACH * size
    x, y = (np.linspace(low[i], high[i], CELLS) for i in range(2))
    kernels = [np.exp(-0.5 * ((axis[:, None] - flat[:, i]) / width[i]) ** 2) for i, axis in enumerate((x, y))]
    density = (kernels[1] * w) @ kernels[0].T
    ordered = np.sort(density.ravel())[::-1]
    held = np.cumsum(ordered) / ordered.sum()
    drawn = contourpy.contour_generator(x, y, density)
    return {
        f"{100 * share:.0f}": [
            np.asarray(edge) @ axes.T + middle for edge in drawn.lines(float(ordered[np.searchsorted(held, share)]))
        ]
        for share in SHARES
    }
