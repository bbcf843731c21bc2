"""The page on estimation is a session that runs, prints what it shows, and shows what closed formulas give."""

import ast
import contextlib
import importlib.util
import io
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

PAGE = Path(__file__).resolve().parents[2] / "docs" / "estimation.md"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def blocks():
    """Language and text of each fenced block, in order."""
    return [(found[1], found[2]) for found in FENCE.finditer(PAGE.read_text("utf-8"))]


@pytest.fixture(scope="module")
def session():
    """Run the page: pairs of what was printed and what is shown, and the names it leaves."""
    names, pairs, printed = {"__name__": "__main__"}, [], ""
    for language, text in blocks():
        if language == "python":
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(text, str(PAGE), "exec"), names)
            printed = out.getvalue()
        elif language == "text":
            pairs.append((printed, text))
    return pairs, names


def test_the_session_prints_what_the_page_shows(session):
    pairs, _ = session
    assert len(pairs) >= 7
    for printed, shown in pairs:
        assert printed.split() == shown.split()


def test_the_page_needs_numpy_and_this_package_alone():
    code = "\n".join(text for language, text in blocks() if language == "python")
    modules = {node.module for node in ast.walk(ast.parse(code)) if isinstance(node, ast.ImportFrom)}
    modules |= {
        alias.name for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Import) for alias in node.names
    }
    assert {name for name in modules if not name.startswith("nebosvod.estimation")} == {"dataclasses", "numpy"}
    assert "_" not in {name.partition(".")[2][:1] for name in re.findall(r"\w+\._\w+", code)}


def test_the_modules_and_the_examples_of_the_last_section_exist():
    rest = PAGE.read_text("utf-8").partition("## Where the rest is")[2]
    rows = re.findall(r"^\| `(nebosvod[\w.]+)` \| (.+?) \|", rest, re.MULTILINE)
    named = [(package, name) for package, names in rows for name in re.findall(r"`(\w+)`", names)]
    assert len(named) > 25
    assert [name for name in named if importlib.util.find_spec(".".join(name)) is None] == []
    shown = set(re.findall(r"`(\w+\.py)`", rest))
    assert shown == {path.name for path in (PAGE.parents[1] / "examples").glob("*.py")}


def test_the_sigmas_shown_are_those_of_the_closed_formulas(session):
    """Normal equations with the offset as a third column, and without it plus what the offset does to the answer."""
    _, names = session
    H, b, sigma, offset = names["H_ramp"][:, 0], names["H_offset"][:, 0], 0.1, 0.3
    both = np.hstack([H, b])
    prior = np.diag([0.0, 0.0, offset**-2])
    estimated = np.linalg.solve(both.T @ both / sigma**2 + prior, np.eye(3))
    gain = np.linalg.solve(H.T @ H, H.T)
    formal = sigma**2 * gain @ gain.T
    effect = gain @ b
    true = formal + offset**2 * effect @ effect.T
    shown = PAGE.read_text("utf-8")
    for value in (estimated[0, 0], formal[0, 0], true[0, 0], offset**2 * effect[0, 0] ** 2):
        assert f"{np.sqrt(value):.4f}" in shown
    assert f"{100 * formal[0, 0] / true[0, 0]:.1f} %" in shown
    assert np.sqrt(true[0, 0] / formal[0, 0]) == pytest.approx(4.6, abs=0.05)  # "4.6 times more"


def test_the_two_stages_of_the_page_are_the_ignoring_and_the_full_estimate(session):
    _, names = session
    stage = names["stage"]
    ignored = names["batch"].solve(names["ramp"]("ignored"))
    # The filter begins with a sigma of 1000 instead of no prior: a relative 1e-10 of the ramp's variance.
    np.testing.assert_allclose(stage.x0, ignored.mean, atol=1e-6)
    np.testing.assert_allclose(stage.P, ignored.K_formal, rtol=1e-6)
    np.testing.assert_allclose(stage.x, names["found"].mean[:2], atol=1e-6)
    np.testing.assert_allclose(stage.P_x, names["found"].K_true[:2, :2], rtol=1e-6)


PICTURES = PAGE.parent / "pictures"


def test_every_picture_is_shown_small_and_made_by_the_script(tmp_path):
    """Drawn anew: the same marks at the same places, whatever the version of matplotlib writes around them."""
    path = PAGE.parents[1] / "tools" / "estimation_pictures.py"
    spec = importlib.util.spec_from_file_location("estimation_pictures", path)
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.main(tmp_path)
    shown = re.findall(r"!\[[^\]]{20,}\]\(pictures/(\w+\.svg)\)", PAGE.read_text("utf-8"))
    assert (
        sorted(shown)
        == sorted(one.name for one in PICTURES.glob("*.svg"))
        == sorted(one.name for one in tmp_path.iterdir())
    )
    for name in shown:
        kept, made = (folder.joinpath(name).read_text("utf-8") for folder in (PICTURES, tmp_path))
        assert len(kept) < 40_000
        assert re.findall(r">([^<>\n]+)</text>", kept) == re.findall(r">([^<>\n]+)</text>", made)


def test_the_bounds_and_the_blocks_of_the_page_are_those_of_other_ways(session):
    """The bounds by a dense programme; the factors of the noise by moments about the fit of the first ruler alone."""
    _, names = session
    H = np.hstack([names["H_ramp"][:, 0], names["H_offset"][:, 0]])
    A = np.vstack([H / 0.3, [[0.0, 0.0, 1.0 / 0.9]]])
    right = np.append(names["measured"] / 0.3, 0.0)
    ends = [
        linprog([sign, 0.0, 0.0], A_ub=np.vstack([A, -A]), b_ub=np.concatenate([1.0 + right, 1.0 - right]),
                bounds=(None, None)).x[0]
        for sign in (1.0, -1.0)
    ]  # fmt: skip
    shown = PAGE.read_text("utf-8")
    assert f"after:  {ends[0]:.3f} to {ends[1]:.3f}" in shown
    second = names["second"]
    for which, factor in ((~second, names["scales"].factors[0]), (second, names["scales"].factors[1])):
        own = np.hstack([names["H_ramp"][which, 0]])
        left = names["worse"][which] - own @ np.linalg.lstsq(own, names["worse"][which])[0]
        assert factor == pytest.approx(left @ left / (0.01 * 18), rel=0.25)  # each ruler's own line takes two
