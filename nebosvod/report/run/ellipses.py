"""Prediction ellipses: 1, 2 and 3 sigma, true and formal, and drawn orbits over them where there are any."""

import math
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.estimation.accuracy.formed import matrix_of
from nebosvod.mission.slugs import array_name
from nebosvod.report.kit import wording
from nebosvod.report.kit.chart import Chart, Panel
from nebosvod.report.kit.download import Download, csv
from nebosvod.report.kit.facts import leading, when
from nebosvod.report.kit.outline import outline
from nebosvod.report.kit.plate import BLUE, INK, VERMILION, Plate
from nebosvod.report.kit.scale import linear
from nebosvod.report.kit.wording import NBSP, TIMES, number, percent, product, quantity
from nebosvod.results.folder import Array, Item, RunFolder
from nebosvod.results.outlook import unit_of

SLENDER = 40.0  # axis ratio above which an ellipse at true scale is a line, and is drawn along its own axes instead
LEVELS = ((1, "39.3"), (2, "86.5"), (3, "98.9"))  # 1 - exp(-lambda^2/2), per cent
ROOM = 1.12  # half width of the picture in units of the 3 sigma ellipse
SIDE, LEFT = 270.0, 58.0  # of the picture, px
MOST_POINTS = 2000


def prediction_plates(run: RunFolder, estimator: Item) -> list[Plate]:
    """A figure for each two-dimensional prediction of an estimator."""
    plates = (ellipse_plate(p, drawn_orbits(run, p)) for p in leading(run, estimator))
    return [p for p in plates if p is not None]


def drawn_orbits(run: RunFolder, prediction: Item) -> Array | None:
    """Displacements (runs, d) of orbits drawn from the error of the first estimator; None where nobody asked."""
    first = run.main
    if first is None or prediction["estimator"] != first["name"]:
        return None
    points = run.array(f"clones_{array_name(prediction['name'])}_{unit_of(prediction)}")
    return None if points is None else np.asarray(points)[np.isfinite(points).all(axis=1)]


def ellipse_plate(prediction: Item, drawn: Array | None = None) -> Plate | None:
    """The ellipse of one prediction in its plane; None where it has no two-dimensional covariance."""
    unit = unit_of(prediction)
    K = _covariance(matrix_of(prediction, f"covariance_{unit}2", f"factor_{unit}"))
    if K is None:
        return None
    formal = _covariance(matrix_of(prediction, f"covariance_formal_{unit}2", f"factor_formal_{unit}"))
    eigenvalues, vectors = np.linalg.eigh(K)
    minor, major = np.sqrt(np.maximum(eigenvalues, 0.0))
    if not major > 0:
        return None
    factor, text = wording.scale_of(float(major), unit)
    slender = bool(minor * SLENDER < major)
    turn = np.stack([vectors[:, 1], vectors[:, 0]]) if slender else np.eye(2)
    if slender and np.linalg.det(turn) < 0:
        turn[1] *= -1.0
    names = wording.axis_names(prediction["plane"], 2)
    labels = ("along the long axis", "along the short axis") if slender else (f"Δ {names[0]}", f"Δ {names[1]}")
    flip = prediction["plane"] == "sky" and not slender
    chart, panel = _frame(prediction, factor * factor * turn @ K @ turn.T, (labels[0], labels[1]), text, slender, flip)
    scaled = None if formal is None else factor * factor * turn @ formal @ turn.T
    points = None if drawn is None else factor * drawn[:MOST_POINTS] @ turn.T
    _draw(panel, factor * factor * turn @ K @ turn.T, scaled, points)
    _legend(chart, scaled is not None, points is not None)
    where = wording.plane_name(prediction["plane"], prediction.get("body"))
    label = f"Prediction {prediction['name']}: 1, 2 and 3 sigma ellipses, {where}"
    caption = _caption(prediction, K, formal, unit, slender) + _clones(prediction, K, drawn, unit)
    return chart.plate(label, caption, _data(chart.key, K, formal, drawn, unit, names))


def _covariance(value: Any) -> Array | None:
    """A finite 2x2 matrix, or None."""
    K = np.asarray(value, dtype=np.float64) if value is not None else np.empty(0)
    return K if K.shape == (2, 2) and bool(np.all(np.isfinite(K))) else None


def _frame(
    prediction: Item, K: Array, names: tuple[str, str], unit: str, slender: bool, flip: bool
) -> tuple[Chart, Panel]:
    """Axes: one scale for both unless the ellipse is slender; east is left on the sky."""
    key = "ellipse-" + array_name(f"{prediction['name']} {prediction['plane']}").replace("_", "-")
    reach = 3.0 * ROOM * np.sqrt(np.diag(K))
    side = 170.0 if slender else SIDE
    if not slender:  # the longer axis fills the square
        reach = np.full(2, float(reach.max()))
    x = linear([-reach[0], reach[0]], f"{names[0]}, {unit}", pad=0.0)
    y = linear([-reach[1], reach[1]], f"{names[1]}, {unit}", pad=0.0)
    x = x.reversed() if flip else x
    chart = Chart(key, width=LEFT + SIDE + 6.0, height=side + 84.0)
    return chart, chart.panel(x, y, top=8.0, bottom=8.0 + side, left=LEFT, right=LEFT + SIDE)


def _draw(panel: Panel, K: Array, formal: Array | None, points: Array | None) -> None:
    """Three true ellipses, filled ever lighter, the formal ones dashed, drawn orbits as dots; in a view that zooms."""
    box = (panel.left, panel.top, panel.right - panel.left, panel.bottom - panel.top)
    inverse = np.linalg.solve(K, np.eye(2)) if np.linalg.cond(K) < 1e12 else None
    told = {} if inverse is None else {"data_k": " ".join(repr(v) for v in inverse[[0, 0, 1], [0, 1, 1]].tolist())}
    panel.open(**told)
    panel.chart.raw(
        f'<svg class="view" x="{box[0]:g}" y="{box[1]:g}" width="{box[2]:g}" height="{box[3]:g}" '
        f'viewBox="{box[0]:g} {box[1]:g} {box[2]:g} {box[3]:g}" preserveAspectRatio="none">'
    )
    panel.chart.view = box
    for level, _ in reversed(LEVELS):
        panel.outline(*outline(K, level).T, fill=BLUE, fill_opacity=0.1, stroke=BLUE, stroke_width=2.0)
    if points is not None:
        panel.dots(points[:, 0], points[:, 1], "o", color=INK, size=1.8, opacity=0.45)
    for level, _ in LEVELS if formal is not None else ():
        panel.line(*outline(np.asarray(formal), level).T, stroke=VERMILION, stroke_width=1.1, stroke_dasharray="3 5")
    panel.dots([0.0], [0.0], "P", color=INK)
    panel.chart.view = None
    panel.chart.raw("</svg>")
    for level, _ in LEVELS:
        line = outline(K, level)
        px, py = panel.at(*line[np.argmax(line[:, 1])])
        panel.chart.text(
            float(px),
            max(float(py) + 10.0, panel.top + 10.0),
            f"{level}σ",
            anchor="middle",
            class_="halo",
        )
    panel.close()


def _legend(chart: Chart, formal: bool, points: bool) -> None:
    """What the lines and dots are."""
    entries: list[tuple[str, str, dict[str, Any]]] = [
        ("line", "realistic 1, 2, 3σ", {"stroke": BLUE, "stroke_width": 2.0})
    ]
    if formal:
        entries.append(("line", "reported", {"stroke": VERMILION, "stroke_width": 1.1, "stroke_dasharray": "3 5"}))
    if points:
        entries.append(("o", "drawn orbits", {"color": INK, "size": 3.0}))
    chart.height = chart.legend(entries, chart.height - 34.0, LEFT - 4.0) - 4.0


def _data(
    key: str, K: Array, formal: Array | None, drawn: Array | None, unit: str, names: tuple[str, ...]
) -> list[Download]:
    """The outlines, and the drawn orbits."""
    columns: dict[str, Any] = {}
    for kind, matrix in (("true", K), ("formal", formal)):
        for level, _ in LEVELS if matrix is not None else ():
            for name, values in zip(names, outline(np.asarray(matrix), level).T):
                columns[f"{name}_{kind}_{level}sigma_{unit}"] = values[::2].tolist()
    files = [csv(key, columns)]
    if drawn is not None:
        points = {f"{name}_{unit}": column.tolist() for name, column in zip(names, drawn[:MOST_POINTS].T)}
        files.append(csv(f"{key}-drawn", points))
    return files


def _caption(p: Item, K: Array, formal: Array | None, unit: str, slender: bool) -> Markup:
    """Semi-axes, orientation, centre, formal against true."""
    first, second = wording.axis_names(p["plane"], 2)
    axes = p[f"semi_axes_{unit}"]
    text = Markup("<b>{}</b>: {}, {}. Semi-axes {} (1σ, holding 39.3{}%) and {} (3σ, 98.9{}%)").format(
        p["name"],
        wording.plane_name(p["plane"], p.get("body")),
        wording.moment(when(p)),
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
        text += Markup(" The centre lies at {}.").format(join_values(mean, unit, (first, second)))
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
        return Markup("The reported (formal) ellipse, dashed, coincides with the realistic one.")
    return Markup(
        "The reported (formal) ellipse, dashed, has {} of the realistic area; in the worst direction the realistic "
        "sigma is {}{} the reported one."
    ).format(percent(math.sqrt(believed / det)), quantity(worst), f"{NBSP}{TIMES}")


def _clones(p: Item, K: Array, drawn: Array | None, unit: str) -> Markup:
    """How many of the drawn orbits the linear ellipse holds, and their own spread."""
    if drawn is None or len(drawn) < 2 or not float(np.linalg.det(K)) > 0.0:
        return Markup("")
    squares = np.sum(drawn * np.linalg.solve(K, drawn.T).T, axis=1)
    said = (p.get("monte_carlo") or {}).get(f"sigma_{unit}")
    sigma = Markup("; their own sigmas are {}").format(wording.series(said, unit)) if said else ""
    return Markup(
        " Of {} orbits drawn from the error and propagated in full, {} lie inside the "
        "linear 1σ ellipse and {} inside the 3σ one{}."
    ).format(len(drawn), percent(float(np.mean(squares <= 1.0))), percent(float(np.mean(squares <= 9.0))), sigma)
