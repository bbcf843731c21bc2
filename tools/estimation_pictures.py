"""Draw the pictures of docs/estimation.md from the session of that page itself.

Usage: python tools/estimation_pictures.py [folder, default docs/pictures]
"""

import contextlib
import io
import re
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parent.parent
BLUE, RED, GREY, GREEN = "#0072b2", "#d55e00", "#8a8a8a", "#009e73"


def session(page: Path = ROOT / "docs" / "estimation.md") -> dict[str, Any]:
    """Run the blocks of the page; the names they leave, and those of each section that later ones overwrite."""
    names: dict[str, Any] = {}
    blocks = re.findall(r"^```python\n(.*?)^```$", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    with contextlib.redirect_stdout(io.StringIO()):
        for block in blocks:
            exec(compile(block, str(page), "exec"), names)
    return names


def figure(width: float = 6.4, height: float = 2.7) -> tuple[Figure, Axes]:
    """An empty picture."""
    drawn = Figure(figsize=(width, height), layout="constrained")
    axes = drawn.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    return drawn, axes


def line(names: dict[str, Any]) -> Figure:
    """Measurements, the ramp, and the lines found."""
    drawn, axes = figure()
    t, measured, second = names["t"], names["measured"], names["second"]
    axes.plot(t[~second], measured[~second], "o", ms=3.5, color=BLUE, label="first ruler")
    axes.plot(t[second], measured[second], "s", ms=3.5, color=RED, label="second ruler")
    axes.plot(t, names["truth"][0] + names["truth"][1] * t, color="black", lw=1.5, label="ramp")
    for treatment, color in (("estimated", GREEN), ("ignored", GREY)):
        found = names["batch"].solve(names["ramp"](treatment))
        axes.plot(t, found.value("height") + found.value("slope") * t, "--", color=color, label=f"offset {treatment}")
    axes.set(xlabel="along", ylabel="height")
    axes.legend(frameon=False, fontsize=8, ncols=2)
    return drawn


def honest(names: dict[str, Any]) -> Figure:
    """Errors over the sigma believed and over the true one."""
    drawn, axes = figure()
    found, errors = names["ignored"], names["errors"][:, 0]
    bins = np.linspace(-14.0, 14.0, 57)
    for sigma, color, label in (
        (found.sigma_formal("height"), RED, "over the sigma believed"),
        (found.sigma("height"), BLUE, "over the true sigma"),
    ):
        axes.hist(errors / sigma, bins, histtype="step", density=True, color=color, lw=1.5, label=label)
    axes.plot(bins, np.exp(-0.5 * bins**2) / np.sqrt(2.0 * np.pi), color="black", lw=1.0, label="normal")
    axes.set(xlabel="error of the height, sigmas (offset ignored)", ylabel="density")
    axes.legend(frameon=False, fontsize=8)
    return drawn


def stages(names: dict[str, Any]) -> Figure:
    """First stage and blend, measurement by measurement."""
    drawn, axes = figure()
    two_stage, n = names["two_stage"], names["n"]
    stage = two_stage.TwoStage.start(np.zeros(2), np.zeros(1), 1e6 * np.eye(2), np.array([[0.09]]))
    rows = []
    for k in range(n):
        arguments = (names["measured"][k : k + 1], names["H_ramp"][k], names["H_offset"][k], np.array([[0.01]]))
        stage, _ = two_stage.update(stage, *arguments)
        rows.append((stage.x0[0], np.sqrt(stage.P[0, 0]), stage.x[0], np.sqrt(stage.P_x[0, 0])))
    first, s_first, blend, s_blend = np.array(rows[3:]).T
    k = np.arange(4, n + 1)
    for value, sigma, color, label in ((first, s_first, RED, "first stage"), (blend, s_blend, BLUE, "blend")):
        axes.fill_between(k, value - sigma, value + sigma, color=color, alpha=0.2, lw=0)
        axes.plot(k, value, color=color, label=label)
    axes.axhline(names["truth"][0], color="black", lw=1.0, label="truth")
    axes.set(xlabel="measurements", ylabel="height", ylim=(0.6, 1.3))
    axes.legend(frameon=False, fontsize=8, ncols=3)
    return drawn


def bounds(names: dict[str, Any]) -> Figure:
    """The polygon that no box contradicts, by its extremes in many directions, and the ellipse of three sigmas."""
    from nebosvod.estimation import Ellipse

    drawn, axes = figure(4.4, 3.2)
    problem = names["ramp"]("estimated")
    turn = np.linspace(0.0, 2.0 * np.pi, 91)
    W = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    reach = names["guaranteed"].bound(problem, W, ("height", "slope")).upper
    sides = [np.linalg.solve(W[[i, i + 1]], reach[[i, i + 1]]) for i in range(len(W) - 1)]
    axes.fill(*np.array(sides).T, color=RED, alpha=0.3, lw=0, label="contradicts no box")
    found = names["batch"].solve(problem)
    outline = found.mean[:2] + Ellipse.of_covariance(found.K_true[:2, :2], 3.0).points()
    axes.plot(*outline.T, color=BLUE, label="3 sigma of least squares")
    axes.plot(*names["truth"], "k+", ms=9, label="truth")
    axes.set(xlabel="height", ylabel="slope")
    axes.legend(frameon=False, fontsize=8)
    return drawn


def blocks(names: dict[str, Any]) -> Figure:
    """The position error by blocks and by the extended filter."""
    drawn, axes = figure()
    k = np.arange(len(names["states"]))
    path = np.array(names["path"])
    axes.plot(k, [state[0] for state in names["states"]], color="black", lw=1.5, label="truth")
    axes.fill_between(k, path[:, 0] - path[:, 1], path[:, 0] + path[:, 1], color=RED, alpha=0.3, lw=0)
    axes.plot(k, path[:, 0], color=RED, label="extended Kalman filter")
    at = [block.last for block in names["blocks"]]
    value = [block.belief.mean[0] for block in names["blocks"]]
    sigma = [np.sqrt(block.belief.covariance[0, 0]) for block in names["blocks"]]
    axes.errorbar(at, value, sigma, fmt="o", ms=4, color=BLUE, capsize=3, label="after each block")
    axes.set(xlabel="soundings", ylabel="error of the position, km")
    axes.legend(frameon=False, fontsize=8)
    return drawn


PICTURES = {"line": line, "honest": honest, "stages": stages, "bounds": bounds, "blocks": blocks}


def main(folder: Path = ROOT / "docs" / "pictures") -> None:
    """Draw all pictures."""
    mpl.rcParams.update({"svg.hashsalt": "nebosvod", "svg.fonttype": "none", "font.size": 9, "path.simplify": True})
    folder.mkdir(parents=True, exist_ok=True)
    names = session()
    for name, draw in PICTURES.items():
        draw(names).savefig(folder / f"{name}.svg", metadata={"Date": None, "Creator": None})


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
