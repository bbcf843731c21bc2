"""The documentation says what is so: links lead somewhere, commands run, outputs and examples are real."""

import contextlib
import io
import json
import os
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType, ModuleType

import numpy as np
import pytest

import nebosvod.dynamics
import nebosvod.estimation
import nebosvod.mission
import nebosvod.observation
from nebosvod import load_mission
from nebosvod.cli import main
from nebosvod.mission import mission_schema
from nebosvod.notebook.plots import FitPlots
from nebosvod.results.result import Result

ROOT = Path(__file__).parent.parent
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SAVE_AS = re.compile(r"[Ss]ave (?:it|this) as\s+`([\w.-]+)`")
COMMANDS = (
    "alert",
    "approaches",
    "elements",
    "ephemeris",
    "run",
    "fit",
    "check",
    "init",
    "missions",
    "open",
    "report",
    "risk",
    "schema",
    "study",
    "validate",
    "plan",
    "compare",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fence:
    """A fenced block of a page: its language, its text, and the prose since the block before it."""

    language: str
    text: str
    prose: str


def fences(page: Path) -> Iterator[Fence]:
    """All fenced blocks of a page in order."""
    text = page.read_text("utf-8")
    end = 0
    for found in FENCE.finditer(text):
        yield Fence(language=found[1], text=found[2], prose=text[end : found.start()])
        end = found.end()


def dialogue(text: str) -> list[tuple[str, list[str]]]:
    """The commands of a console block, each with the output shown for it."""
    steps: list[tuple[str, list[str]]] = []
    for line in text.splitlines():
        if line.startswith("$ "):
            steps.append((line[2:], []))
        elif steps:
            steps[-1][1].append(line)
    return steps


def words(lines: list[str]) -> list[list[str]]:
    """Lines as words: neither blank lines nor the width of columns matter, nor which keys a message allows."""
    return [re.sub(r"\(allowed here: [^)]*\)", "", line).split() for line in lines if line.strip()]


def said(command: str) -> tuple[int, list[str]]:
    """Exit code and everything printed by a `nebosvod` command, run inside this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(shlex.split(command)[1:])
    return code, (out.getvalue() + err.getvalue()).splitlines()


def slip(mission: Path) -> None:
    """Make the two slips that the quick start speaks of."""
    text = mission.read_text("utf-8")
    mission.write_text(text.replace("0.1 arcsec", "0.1").replace("cadence", "cadance"), "utf-8")


def follow(page: Path) -> list[str]:
    """Do what a page says, in the current folder: save files, run commands and Python; returns what differs."""
    differences, saved, printed = [], "", ""
    names = {"__name__": "__main__"}  # one for the page: a later example goes on from an earlier one
    for fence in fences(page):
        name = SAVE_AS.search(fence.prose)
        if fence.language == "yaml" and name:
            saved = fence.text
            Path(name[1]).write_text(saved, "utf-8")
        elif fence.language == "console":
            misspelt = "misspelt" in fence.prose
            for command, shown in dialogue(fence.text):
                if misspelt:
                    slip(Path(shlex.split(command)[-1]))
                code, lines = said(command)
                if code != (2 if misspelt else 0):
                    differences.append(f"{command}: exit code {code}: {lines[-1:]}")
                if shown and words(lines) != words(shown):
                    new = [line for line in lines if words([line]) and words([line])[0] not in words(shown)]
                    differences.append(f"{command}: prints otherwise:\n" + "\n".join(new))
                if misspelt:
                    Path(shlex.split(command)[-1]).write_text(saved, "utf-8")
        elif fence.language == "python":
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(fence.text, str(page), "exec"), names)
            printed = out.getvalue()
        elif fence.language == "text" and printed:
            if words(printed.splitlines()) != words(fence.text.splitlines()):
                differences.append(f"Python prints otherwise:\n{printed}")
            printed = ""
    return differences


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty current folder, and a terminal of the width that the pages show."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    return tmp_path


@pytest.fixture(scope="module")
def minimal_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run folder of `minimal`, under its default name."""
    folder = tmp_path_factory.mktemp("pages") / "minimal-run"
    code, lines = said(f"nebosvod run minimal -o {folder}")
    assert code == 0, lines
    return folder


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_relative_link_leads_to_a_file(page: Path) -> None:
    targets = [target for target in LINK.findall(page.read_text("utf-8")) if "://" not in target]
    targets = [target for target in targets if not target.startswith("made/")]  # by code of the page, see below
    missing = [target for target in targets if not (page.parent / target.partition("#")[0]).exists()]
    assert missing == []


def test_every_page_stands_in_the_table_of_contents() -> None:
    listed = LINK.findall((ROOT / "docs" / "index.md").read_text("utf-8"))
    assert {page.name for page in (ROOT / "docs").glob("*.md")} - {"index.md"} <= set(listed)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_shown_is_a_command_of_the_program(page: Path) -> None:
    shown = re.findall(r"^(?:\$ |    )nebosvod (\w+)", page.read_text("utf-8"), re.MULTILINE)
    assert [command for command in shown if command not in COMMANDS] == []


def test_following_the_readme_gives_what_the_readme_shows(elsewhere: Path) -> None:
    assert follow(ROOT / "README.md") == []
    assert load_mission("first.yaml").name == "first"


def test_following_the_page_on_small_sigmas_gives_what_it_shows(elsewhere: Path) -> None:
    assert follow(ROOT / "docs" / "why-your-sigma-is-too-small.md") == []


def test_the_worked_exercise_of_an_impact_gives_what_it_says(elsewhere: Path) -> None:
    """From two days of observations to the decision to go on, and what a week says."""
    assert follow(ROOT / "docs" / "impact.md") == []
    for name, said in (("found-risk", 0.0214), ("week-risk", 0.53)):
        summary = json.loads((Path(name) / "summary.json").read_text("utf-8"))
        (one,) = summary["virtual_impactors"]
        assert one["probability"] == pytest.approx(said, rel=0.15)
        assert "disagrees" not in one["reason"]


def test_the_reference_of_keys_is_the_one_the_schema_gives() -> None:
    tool = runpy.run_path(str(ROOT / "tools" / "mission_reference.py"))
    assert tool["page"](mission_schema()) == tool["PAGE"].read_text("utf-8"), "run `make schema`"


PICTURES = runpy.run_path(str(ROOT / "tools" / "pictures.py"))


@pytest.mark.parametrize("name", PICTURES["PAGES"])
def test_the_code_of_a_page_with_pictures_runs_prints_what_it_shows_and_draws_them(name: str, tmp_path: Path) -> None:
    page = ROOT / "docs" / f"{name}.md"
    PICTURES["follow"](page, tmp_path)
    wanted = PICTURES["pictures_of"](page)
    assert wanted
    assert [picture for picture in wanted if not (tmp_path / picture).read_bytes().startswith(b"\x89PNG")] == []


def test_every_page_with_made_pictures_is_run_for_them() -> None:
    shown = {page.stem for page in (ROOT / "docs").glob("*.md") if PICTURES["pictures_of"](page)}
    assert shown == set(PICTURES["PAGES"])


def test_every_kind_of_figure_stands_in_the_gallery() -> None:
    """Those of a run and a fit by the method that draws them, wherever in gallery and cookbook."""
    code = "".join((ROOT / "docs" / f"{name}.md").read_text("utf-8") for name in ("gallery", "cookbook"))
    names = {name for name in dir(FitPlots) if not name.startswith("_")} - {"names", "every"}
    assert {name for name in names if f".plot.{name}()" not in code} == set()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The documentation as a site, made without a warning; its pictures are made by the tests above."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", folder / "cache"]
    environment = {**os.environ, "NEBOSVOD_PICTURES": "none"}
    command += [ROOT / "docs", folder]
    made = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert made.returncode == 0, made.stderr
    return folder


def test_every_page_is_reached_from_the_first_of_the_site(site: Path) -> None:
    page = (site / "index.html").read_text("utf-8")
    assert [name for name in PAGES[1:] if f'href="{name.stem}.html"' not in page and name.stem != "index"] == []
    assert page.count('class="caption"') == 4


def test_a_notebook_can_be_taken_from_the_site(site: Path) -> None:
    (link,) = re.findall(r'href="(_downloads/[^"]+\.ipynb)"', (site / "python.html").read_text("utf-8"))
    assert (site / link).read_bytes() == (ROOT / "examples" / "impactor_at_l1.ipynb").read_bytes()


def test_following_the_quick_start_gives_what_it_shows(elsewhere: Path) -> None:
    assert follow(ROOT / "docs" / "quickstart.md") == []


def test_the_mission_of_the_readme_has_twelve_lines(elsewhere: Path) -> None:
    (mission,) = (fence for fence in fences(ROOT / "README.md") if fence.language == "yaml")
    assert len(mission.text.splitlines()) == 12


def test_python_examples_of_the_report_page_run(minimal_run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(minimal_run.parent)
    assert follow(ROOT / "docs" / "report.md") == []


def test_the_report_page_names_every_key_array_and_table_of_a_run(minimal_run: Path) -> None:
    page = (ROOT / "docs" / "report.md").read_text("utf-8")
    result = Result.load(minimal_run)
    keys = set(result.summary) | set(result.manifest)
    for block in ("estimators", "predictions", "budget", "visibility"):
        keys |= set(result.summary[block][0])
    numbered = {re.sub(r"^(what_if_(?:shares|partials))_\d+", r"\1_K", name) for name in result.arrays}
    numbered = {re.sub(r"^(what_if_(?:white|markov))_\d+", r"\1_I", name) for name in numbered}
    keys |= {name.removesuffix("_batch") for name in numbered}
    keys |= {f"tables/{name}.ecsv" for name in result.tables if not name.endswith("_batch")}
    assert sorted(key for key in keys if f"`{key}" not in page) == []


def test_pictures_of_front_pages_are_small() -> None:
    for name in ("report.png", "pictures/overview.png"):
        assert 10_000 < (ROOT / "docs" / name).stat().st_size < 300_000


def test_shapes_said_of_the_arrays_are_theirs(minimal_run: Path) -> None:
    page = (ROOT / "docs" / "report.md").read_text("utf-8")
    arrays = Result.load(minimal_run).arrays
    sizes = {"n": len(arrays["epoch_s"]), "m": len(arrays["parameter_names"]), "b": len(arrays["bias_names"])}
    rows = re.findall(r"^\| `(\w+)` \| \(([^)]*)\)", page, re.MULTILINE)
    assert len(rows) > 10
    for name, shape in rows:
        wanted = [int(sizes.get(part, part)) for part in shape.split(", ")]
        assert wanted == list(np.shape(arrays[name])), name


def test_following_the_page_on_propagation_gives_what_it_shows(elsewhere: Path) -> None:
    assert follow(ROOT / "docs" / "propagation.md") == []
    assert {path.name for path in elsewhere.iterdir()} == {"apophis.bsp", "apophis.oem"}


def test_the_api_reference_describes_every_public_name(site: Path) -> None:
    """Each class, function and module that a door shows, at a place of its own."""
    page = "".join(path.read_text("utf-8") for path in site.glob("api*.html"))
    doors = (nebosvod, nebosvod.dynamics, nebosvod.observation, nebosvod.estimation, nebosvod.mission)
    wanted: list[set[str]] = []  # places, of which one is enough
    for door in doors:
        for name in door.__all__:
            thing = getattr(door, name)
            if isinstance(thing, ModuleType):
                wanted.append({f"module-{thing.__name__}"})
            elif isinstance(thing, type | FunctionType):
                wanted.append({f"{one.__name__}.{name}" for one in doors if getattr(one, name, None) is thing})
    assert len(wanted) > 130
    assert [places for places in wanted if not any(f'id="{place}"' in page for place in places)] == []


def test_the_api_reference_describes_the_typed_summary_of_every_command(site: Path) -> None:
    page = (site / "api-summaries.html").read_text("utf-8")
    made = [path.stem for path in (ROOT / "nebosvod" / "notebook" / "summaries").glob("*.py")]
    whole = {name for name in made if f'id="module-nebosvod.notebook.summaries.{name}"' in page}
    assert whole == set(made) - {"__init__", "reading", "shape", "typed"}
    assert 'id="nebosvod.notebook.summaries.risk.RiskSummary"' in page
