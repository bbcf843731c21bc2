"""Closed lines around the densest parts of a cloud of points in a plane: regions of the highest density.

The density is a sum of normal kernels, each as wide and as tilted as the points about its own lie: so a bent corridor
is not smeared by the chord of it. The level is the one above which a share of the points stand by the density of all
others (each point's own kernel is left out of what it is judged by): then a point nobody has drawn lies inside with
about that probability. So that few points do not make a region too small by chance, that share is larger than the
stated one by its standard error times 1.645: at least 68 or 95 % are inside with a confidence of 95 %.
"""

from typing import NamedTuple

import contourpy
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
SHARES = (0.68, 0.95)
CELLS = 96  # of the map of density, each way
REACH = 3.5  # sigmas, beyond which a kernel is nothing
NEIGHBOURS = 2.5  # times the root of the effective number of points: whose spread is that of a kernel
FEWEST = 8
NARROW = 0.8  # of a cell: no kernel is narrower, lest the lines break into pearls
SHRUNK = 0.7  # of the spread of the neighbours
CONFIDENCE = 1.645  # standard errors


class _Kernels(NamedTuple):
    """Places (m, 2), weights (m,), inverse covariances (m, 2, 2) and their determinants' roots (m,); widths (m, 2)."""

    points: Array
    weight: Array
    information: Array
    root: Array
    width: Array


def contours(points: Array, weight: Array | None = None) -> dict[str, list[Array]]:
    """Lines (k, 2) around the densest parts of points (m, 2), by the share of them that they hold: "68" and "95".

    References
    ----------
    Hyndman 1996, Computing and graphing highest density regions; Wilks 1941 on tolerance regions.
    """
    w = np.full(len(points), 1.0 / len(points)) if weight is None else weight / weight.sum()
    middle = w @ points
    away = np.sqrt(w)[:, None] * (points - middle)
    axes = np.linalg.svd(np.hstack([away.T, np.zeros((2, 2))]), full_matrices=False)[0]
    flat, which = np.unique((points - middle) @ axes, axis=0, return_inverse=True)
    w = np.asarray(np.bincount(which.ravel(), w, len(flat)), dtype=np.float64)
    size = np.maximum(np.ptp(flat, axis=0), 1e-3 * np.ptp(flat, axis=0).max())
    size = np.maximum(size, 1e-12)
    cell = 1.5 * size / CELLS
    kernels = _kernels(flat, w, cell)
    low, high = (flat - REACH * kernels.width).min(axis=0), (flat + REACH * kernels.width).max(axis=0)
    x, y = (np.arange(low[i] - cell[i], high[i] + 2.0 * cell[i], cell[i]) for i in range(2))
    drawn = contourpy.contour_generator(x, y, _map(kernels, x, y))
    return {
        f"{100 * share:.0f}": [np.asarray(edge) @ axes.T + middle for edge in drawn.lines(level)]
        for share, level in zip(SHARES, _levels(kernels), strict=True)
    }


def _kernels(points: Array, w: Array, cell: Array) -> _Kernels:
    """A kernel for each point, by the spread of its neighbours; in units of the cloud's own spread."""
    m = len(points)
    scale = np.maximum(np.sqrt(w @ points**2), cell)
    z = points / scale
    gap = np.sum((z[:, None] - z[None]) ** 2, axis=2)
    count = int(np.clip(NEIGHBOURS * np.sqrt(1.0 / np.sum(w**2)), min(FEWEST, m), m))
    near = np.argpartition(gap, count - 1, axis=1)[:, :count]
    share = w[near] / w[near].sum(axis=1)[:, None]
    away = z[near] - z[:, None]
    P = np.einsum("mk,mki,mkj->mij", share, away, away) * SHRUNK**2
    P = P + np.diag((NARROW * cell / scale) ** 2)
    P = P * scale[:, None] * scale
    return _Kernels(
        points=points, weight=w, information=np.linalg.solve(P, np.broadcast_to(np.eye(2), P.shape)),
        root=np.sqrt(np.linalg.det(P)), width=np.sqrt(np.einsum("mii->mi", P)),
    )  # fmt: skip


def _map(kernels: _Kernels, x: Array, y: Array) -> Array:
    """The density (len(y), len(x)): each kernel is put where it reaches."""
    density = np.zeros((len(y), len(x)))
    low, high = kernels.points - REACH * kernels.width, kernels.points + REACH * kernels.width
    left, right = np.searchsorted(x, low[:, 0]), np.searchsorted(x, high[:, 0])
    bottom, top = np.searchsorted(y, low[:, 1]), np.searchsorted(y, high[:, 1])
    for k, (point, I) in enumerate(zip(kernels.points, kernels.information, strict=True)):
        dx, dy = x[left[k] : right[k]] - point[0], y[bottom[k] : top[k]] - point[1]
        squares = I[0, 0] * dx**2 + (I[1, 1] * dy**2)[:, None] + 2.0 * I[0, 1] * dx * dy[:, None]
        density[bottom[k] : top[k], left[k] : right[k]] += kernels.weight[k] / kernels.root[k] * np.exp(-0.5 * squares)
    return density


def _levels(kernels: _Kernels) -> list[float]:
    """The density above which each share of the points stand, by the others."""
    away = kernels.points[:, None] - kernels.points[None]
    squares = np.einsum("mki,kij,mkj->mk", away, kernels.information, away)
    part = kernels.weight / kernels.root * np.exp(-0.5 * squares)
    np.fill_diagonal(part, 0.0)
    density = part.sum(axis=1)
    order = np.argsort(-density)
    held, share = np.cumsum(kernels.weight[order]), np.array(SHARES)
    share = share + CONFIDENCE * np.sqrt(share * (1.0 - share) * np.sum(kernels.weight**2))
    at = np.minimum(np.searchsorted(held, share - 1e-12), len(order) - 1)
    least = 1e-6 * float(density.max(initial=0.0)) + 1e-300
    return [max(float(density[order[k]]), least) for k in at]
