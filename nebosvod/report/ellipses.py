"""Prediction ellipses: 1, 2 and 3 sigma, true and formal."""

import math
import re
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.report import wording
from nebosvod.report.folder import Array, Item, RunFolder, slug
from nebosvod.report.plate import BLUE, GREY, INK, VERMILION, Plate, figure, plate
from nebosvod.report.verdict import leading, unit_of
from nebosvod.report.wording import NBSP, TIMES, number, percent, product, quantity

SLENDER = 12.0  # axis ratio above which an ellipse at true scale is a line, and is drawn along its own axes instead
NARROW, FLAT = 2.5, 4.5  # axis ratio above which names inside the ellipses would cross the outer ones
LEVELS = ((1, "39.3"), (2, "86.5"), (3, "98.9"))  # 1 - exp(-lambda^2/2), per cent
ANGLES = np.linspace(0.0, 2.0 * np.pi, 181)


def prediction_plates(run: RunFolder, estimator: Item) -> list[Plate]:
    """A figure for each two-dimensional prediction of an estimator."""
    plates = (ellipse_plate(p) for p in leading(run, estimator))
    return [p for p in plates if p is not None]


def ellipse_plate(prediction: Item) -> Plate | None:
    """The ellipse of one prediction in its plane; None where it has no two-dimensional covariance."""
    unit = unit_of(prediction)
    K = _covariance(prediction.get(f"covariance_{unit}2"))
    if K is None:
        return None
    formal = _covariance(prediction.get(f"covariance_formal_{unit}2"))
    eigenvalues, vectors = np.linalg.eigh(K)
    minor, major = np.sqrt(np.maximum(eigenvalues, 0.0))
    if not major > 0:
        return None
    factor, text = wording.scale_of(float(major), unit)
    sky = prediction["plane"] == "sky"
    slender = bool(minor * SLENDER < major)
    upright = bool(K[1, 1] >= K[0, 0])
    leaders = not slender and bool(minor * (NARROW if upright else FLAT) < major)
    turn = np.stack([vectors[:, 1], vectors[:, 0]]) if slender else np.eye(2)
    if slender and np.linalg.det(turn) < 0:
        turn[1] *= -1.0
    fig = figure(4.5, 3.2) if slender else figure(3.7, 3.5)
    axes = fig.subplots()
    size = factor * factor
    rotated = None if formal is None else size * turn @ formal @ turn.T
    _draw(axes, size * turn @ K @ turn.T, rotated, leaders)
    _name_axes(axes, prediction, slender, text)
    if sky and not slender:
        axes.invert_xaxis()
    where = wording.plane_name(prediction["plane"], prediction.get("body"))
    label = f"Prediction {prediction['name']}: 1, 2 and 3 sigma ellipses, {where}"
    key = "ellipse-" + re.sub("_", "-", slug(f"{prediction['name']} {prediction['plane']}"))
    return plate(fig, key, label, _caption(prediction, K, formal, unit, slender))


def _covariance(value: Any) -> Array | None:
    """A finite 2x2 matrix, or None."""
    K = np.asarray(value, dtype=np.float64) if value is not None else np.empty(0)
    return K if K.shape == (2, 2) and bool(np.all(np.isfinite(K))) else None


def outline(K: Array, level: float) -> Array:
    """Points (181, 2) of the ellipse x^T K^-1 x = level^2, through the symmetric square root (K may be singular)."""
    values, vectors = np.linalg.eigh(K)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    points: Array = level * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1) @ root.T
    return points


def _draw(axes: Any, K: Array, formal: Array | None, leaders: bool) -> None:
    """Three true ellipses, filled ever lighter, and the formal ones dashed."""
    for level, inside in reversed(LEVELS):
        line = outline(K, level)
        axes.fill(*line.T, color=BLUE, alpha=0.12, lw=0)
        axes.plot(*line.T, color=BLUE, lw=1.5)
        _label(axes, line, f"{level}σ, {inside}{NBSP}%", leaders)
        if formal is not None:
            axes.plot(*outline(formal, level).T, color=VERMILION, lw=1.1, ls=(0, (4, 2)))
    axes.plot(0, 0, "+", color=INK, ms=7, mew=1.0)
    axes.margins(0.08, 0.12)


def _label(axes: Any, line: Array, text: str, leaders: bool) -> None:
    """Name one ellipse: above it, or, where the ellipses lie too close for that, beside the picture with a leader."""
    look = {"fontsize": 8, "color": INK, "bbox": {"facecolor": "white", "alpha": 0.65, "lw": 0, "pad": 0.6}}
    top, right = line[np.argmax(line[:, 1])], line[np.argmax(line[:, 0])]
    if not leaders:
        axes.annotate(text, top, xytext=(0, 2), textcoords="offset points", ha="center", va="bottom", **look)
        return
    arrow = {"arrowstyle": "-", "lw": 0.5, "color": GREY, "shrinkA": 2.0, "shrinkB": 0.0}
    if top[1] >= right[0]:
        axes.annotate(text, top, xytext=(0.99, top[1]), textcoords=("axes fraction", "data"), ha="right", va="center",
                      arrowprops=arrow, **look)  # fmt: skip
    else:
        axes.annotate(text, right, xytext=(right[0], 0.97), textcoords=("data", "axes fraction"), ha="right", va="top",
                      rotation=90, arrowprops=arrow, **look)  # fmt: skip


def _name_axes(axes: Any, prediction: Item, slender: bool, unit: str) -> None:
    """Axis names with units; true scale unless the ellipse is slender."""
    first, second = wording.axis_names(prediction["plane"], 2)
    if slender:
        axes.set_xlabel(f"along the long axis, {unit}")
        axes.set_ylabel(f"along the short axis, {unit}")
        return
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"Δ {first}, {unit}")
    axes.set_ylabel(f"Δ {second}, {unit}")


def _caption(p: Item, K: Array, formal: Array | None, unit: str, slender: bool) -> Markup:
    """Semi-axes, orientation, centre, formal against true."""
    first, second = wording.axis_names(p["plane"], 2)
    axes = p[f"semi_axes_{unit}"]
    text = Markup("<b>{}</b>: {}, {}. Semi-axes {} (1σ, 39.3{}%) and {} (3σ, 98.9{}%)").format(
        p["name"],
        wording.plane_name(p["plane"], p.get("body")),
        wording.moment(p["epoch_tdb"]),
        product(axes, unit),
        NBSP,
        product([3 * a for a in axes], unit, like=max(axes)),
        NBSP,
    )
    if p.get("angle_deg") is not None:
        text += Markup(", the long one {} from +{} towards +{}").format(quantity(p["angle_deg"], "deg"), first, second)
    text += Markup("; east is left." if p["plane"] == "sky" and not slender else ".")
    if p["plane"] == "sky":
        text += Markup(" The error of the orbit alone: the telescope's own position and bias are taken as known.")
    mean = p.get(f"mean_{unit}")
    if mean and any(mean):
        centre = join_values(mean, unit, (first, second))
        text += Markup(" The centre lies at {}.").format(centre)
    if slender:
        text += Markup(
            " Drawn along its own axes, each with its own scale: at one scale it would be a line (1{}:{}{})."
        ).format(NBSP, NBSP, number(axes[0] / axes[1]) if axes[1] else "∞")
    if formal is not None:
        text += Markup(" {}").format(_formal(K, formal))
    return text


def join_values(values: list[float], unit: str, names: tuple[str, ...]) -> Markup:
    """`ξ = −12 644 km, ζ = 47 115 km`."""
    parts = [Markup("{} = {}").format(name, quantity(v, unit, 6)) for name, v in zip(names, values)]
    return Markup(", ").join(parts)


def _formal(K: Array, formal: Array) -> Markup:
    """How the dashed ellipse compares: area, and the largest ratio of sigmas over all directions."""
    det, believed = float(np.linalg.det(K)), float(np.linalg.det(formal))
    if not (det > 0 and believed > 0):
        return Markup("The dashed ellipses are what the estimator believes (formal covariance).")
    L = np.linalg.cholesky(formal)
    whitened = np.linalg.solve(L, np.linalg.solve(L, K).T)
    worst = math.sqrt(float(np.linalg.eigvalsh(0.5 * (whitened + whitened.T))[-1]))
    if abs(worst - 1.0) < 0.01 and abs(math.sqrt(believed / det) - 1.0) < 0.01:
        return Markup("The formal ellipse (dashed) coincides with the true one.")
    return Markup(
        "The formal ellipse (dashed) has {} of the true area; in the worst direction the true "
        "sigma is {}{} the formal one."
    ).format(percent(math.sqrt(believed / det)), quantity(worst), f"{NBSP}{TIMES}")
