"""What `nebosvod.<Tab>` shows, and that a function and its command ask the same."""

import doctest
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import pytest

import nebosvod
from nebosvod.borders.compiled import kept
from nebosvod.cli import VERBS, app
from nebosvod.errors import InputError, NebosvodNotice
from nebosvod.notebook import given

WANTED = (
    "run", "fit", "validate", "plan", "compare", "study", "risk", "alert", "ephemeris", "approaches", "load_mission",
    "Result", "Mission", "Fit", "Study",
)  # fmt: skip
NEW_NAMES = {"with_history": "history", "with_decision": "decide", "folders": "answers", "words": "file"}
ONLY_TYPED = {  # what is for a terminal, or has a method or function of its own: .report(), .typed, fit_every
    "as_json", "ecsv", "page", "split", "suggest", "only_check",
}  # fmt: skip
NO_FUNCTION = {"check", "elements", "init", "missions", "open", "report", "schema"}


def test_names_are_listed_and_nothing_heavy_is_loaded_for_it() -> None:
    """`dir` is what Tab asks."""
    script = "import sys, nebosvod; print(' '.join(dir(nebosvod))); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    names, modules = (line.split() for line in done.stdout.splitlines())
    assert set(WANTED) <= set(names)
    assert {"numpy", "scipy", "astropy", "matplotlib", "numba", "pydantic", "click"} & set(modules) == set()
    assert [name for name in names if not name.startswith("_")] == sorted(n for n in nebosvod.__all__ if n[0] != "_")


@pytest.mark.parametrize("verb", sorted(set(VERBS) - NO_FUNCTION))
def test_a_function_has_the_parameters_and_defaults_of_its_command(verb: str) -> None:
    command = app.get_command(None, verb)  # type: ignore[arg-type]
    mine = inspect.signature(getattr(nebosvod, verb)).parameters
    for option in command.params:
        name = NEW_NAMES.get(option.name, option.name)
        if name in ONLY_TYPED or (verb, name) == ("plan", "output"):  # a file, which is Plan.save
            continue
        assert name in mine, f"{verb}: {name}"
        wanted: Any = option.get_default(click.Context(command))
        wanted = None if str(wanted) == "Sentinel.UNSET" else wanted
        got = mine[name].default
        if option.required or got is inspect.Parameter.empty:
            assert option.required or option.nargs == -1, f"{verb}: {name}"
        elif isinstance(wanted, bool) or wanted or got:
            assert got == (tuple(wanted) if isinstance(wanted, list) else wanted), f"{verb}: {name}"


def test_every_command_has_a_function_or_is_known_to_need_none() -> None:
    assert {verb for verb in VERBS if not callable(getattr(nebosvod, verb, None))} == NO_FUNCTION


@pytest.mark.parametrize("module", ["answer", "verbs", "planned"])
def test_examples_of_the_docstrings_run(module: str) -> None:
    found = doctest.testmod(
        importlib.import_module(f"nebosvod.notebook.{module}"),
        optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE,
    )
    assert found.attempted > 1
    assert found.failed == 0


@pytest.mark.parametrize("name", [name for name in nebosvod.__all__ if name != "__version__"])
def test_every_public_name_says_what_it_is(name: str) -> None:
    assert len(inspect.getdoc(getattr(nebosvod, name)) or "") > 20


@pytest.mark.parametrize("name", sorted({*VERBS, "fit_every"} - NO_FUNCTION))
def test_every_parameter_of_a_function_is_described(name: str) -> None:
    function = getattr(nebosvod, name)
    lines = (inspect.getdoc(function) or "").partition("Parameters\n----------\n")[2].partition("\n\n")[0]
    said = set(re.findall(r"[a-z_]+", " ".join(re.findall(r"((?:[a-z_]+, )*[a-z_]+) :", lines))))
    assert set(inspect.signature(function).parameters) == said


def test_a_new_installation_says_once_that_it_compiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A first run without a word takes a minute and more."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert not kept(tmp_path)
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "propagation.step-1.py311.nbi").write_bytes(b"")
    assert kept(tmp_path)


def test_the_notice_stands_where_the_kernels_are_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(given, "kept", lambda folder: False)
    given._tell_of_compiling.cache_clear()
    with pytest.warns(NebosvodNotice, match="compiles the numerical kernels, once"), pytest.raises(InputError):
        nebosvod.run("no such mission")
    with pytest.raises(InputError):
        nebosvod.run("no such mission")
