"""The program in unfriendly places: files named like modules, closed streams, readers that leave, no cache."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PROGRAM = [sys.executable, "-m", "nebosvod"]
TRAP = "import os\nopen(os.path.join(os.path.dirname(__file__), 'executed'), 'a').write(__name__)\n"
TRAPPED = (
    "numpy",
    "scipy",
    "click",
    "yaml",
    "numba",
    "erfa",
    "jinja2",
    "rich",
    "pydantic",
    "sitecustomize",
    "dynamics",
)


@pytest.fixture
def trapped(tmp_path: Path) -> Path:
    """A working directory full of files named like modules; each says when it is executed."""
    for name in TRAPPED:
        (tmp_path / f"{name}.py").write_text(TRAP, "utf-8")
    return tmp_path


@pytest.mark.parametrize("pythonpath", [None, ""])
def test_nothing_is_imported_from_the_working_directory(trapped: Path, pythonpath: str | None) -> None:
    command = [*PROGRAM, "validate", "minimal", "--runs", "60", "--workers", "2"]
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    if pythonpath is not None:
        environment["PYTHONPATH"] = pythonpath
    done = subprocess.run(
        command, cwd=trapped, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (trapped / "minimal-validation" / "validation.json").is_file()
    assert not (trapped / "executed").exists()
    assert not (trapped / "__pycache__").exists()


def test_paths_on_the_command_line_and_in_the_environment_mean_the_parents_folder(tmp_path: Path) -> None:
    """Workers start elsewhere: a relative mission, output folder and ephemeris are still those of the user."""
    shutil.copyfile(ROOT / "scenarios" / "minimal.yaml", tmp_path / "mine.yaml")
    shutil.copyfile(next((ROOT / "dynamics" / "data").glob("de440*.bsp")), tmp_path / "planets.bsp")
    command = [*PROGRAM, "validate", "mine.yaml", "--runs", "60", "--workers", "1", "-o", "out"]
    environment = os.environ | {"NEBOSVOD_EPHEMERIS": "planets.bsp"}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "out" / "chunks").iterdir())) == 2


def shell(line: str, cwd: Path) -> "subprocess.CompletedProcess[str]":
    """A line of bash, in which NEBOSVOD stands for the program; its own exit code is the program's."""
    program = f"{sys.executable} -m nebosvod"
    script = f"set -o pipefail\n{line.replace('NEBOSVOD', program)}"
    return subprocess.run(["bash", "-c", script], cwd=cwd, capture_output=True, text=True, timeout=120, check=False)


STREAMS = ("<&- >&- 2>&-", "2>&-", "| head -1", "2>&1 >&- | true")


@pytest.mark.parametrize("streams", STREAMS)
def test_closed_streams_and_readers_that_leave_change_neither_result_nor_exit_code(
    streams: str, tmp_path: Path
) -> None:
    done = shell(f"NEBOSVOD run minimal -o run {streams}", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    assert json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))["n_observations"] == 62


@pytest.mark.parametrize("streams", [">&-", "2>&-", "2>&1 | true"])
def test_an_error_has_its_exit_code_though_nobody_hears_it(streams: str, tmp_path: Path) -> None:
    done = shell(f"NEBOSVOD check nowhere.yaml {streams}", tmp_path)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("command", ["missions", "schema", "check apophis-2029", "--help", "run --help"])
def test_a_reader_that_leaves_at_once_ends_nothing_badly(command: str, tmp_path: Path) -> None:
    done = shell(f"NEBOSVOD {command} | head -c 1", tmp_path)
    assert done.returncode == 0
    assert done.stderr == ""


def test_all_objects_of_a_fit_are_written_though_nobody_reads_the_lines(tmp_path: Path) -> None:
    shutil.copyfile(ROOT.parent / "shared" / "cases" / "73P_two_fragments.obs", tmp_path / "two.obs")
    whole = shell("NEBOSVOD fit two.obs --split -o whole", tmp_path)
    cut = shell("NEBOSVOD fit two.obs --split -o cut | true", tmp_path)
    assert cut.returncode == whole.returncode
    assert sorted(p.name for p in (tmp_path / "cut").iterdir()) == sorted(
        p.name for p in (tmp_path / "whole").iterdir()
    )


CACHELESS = """
import sys, warnings
sys.meta_path = [finder for finder in sys.meta_path if "Editable" not in getattr(finder, "__name__", "")]
with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    import nebosvod.dynamics.compilation as compilation
    from nebosvod.errors import NebosvodNotice
    @compilation.kernel
    def twice(x):
        return x + x
    import nebosvod.cli, nebosvod.commands.run, nebosvod.commands.validate
    import nebosvod.commands.fit_work, nebosvod.commands.plan, nebosvod.engine.montecarlo, nebosvod.dynamics.clones
    import nebosvod.estimation, nebosvod.estimation.filters, nebosvod.observation, nebosvod.studies.chunk
    assert twice(2.0) == 4.0
print(compilation.__file__)
print([str(one.message) for one in said if issubclass(one.category, NebosvodNotice)])
"""


def test_kernels_work_without_a_place_for_their_cache_and_one_notice_says_so(tmp_path: Path) -> None:
    """Files where folders would be made refuse even root."""
    ignored = shutil.ignore_patterns("__pycache__", "*.bsp")
    shutil.copytree(ROOT / "nebosvod", tmp_path / "nebosvod", ignore=ignored)
    for stage in ("dynamics", "observation", "estimation", "scenarios"):
        shutil.copytree(ROOT / stage, tmp_path / "nebosvod" / stage, ignore=ignored)
    for folder in [path for path in tmp_path.rglob("*") if path.is_dir()]:
        (folder / "__pycache__").touch()
    environment = {"PATH": os.environ["PATH"], "HOME": "/dev/null"}
    command = [sys.executable, "-c", CACHELESS]  # its path begins with the working directory
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    place, notices = done.stdout.splitlines()
    assert place.startswith(str(tmp_path))
    assert notices.count("NUMBA_CACHE_DIR") == 1


def test_a_matplotlibrc_of_the_working_directory_changes_no_figure(tmp_path: Path) -> None:
    pages = []
    for name in ("plain", "odd"):
        folder = tmp_path / name
        folder.mkdir()
        if name == "odd":
            (folder / "matplotlibrc").write_text(
                "path.sketch: 10, 100, 2\nlines.linewidth: 20\nbackend: module://evil\n"
            )
        command = [sys.executable, "-m", "nebosvod", "run", "minimal", "-o", "run"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        pages.append(re.findall(r"<path[^>]*>", (folder / "run" / "report.html").read_text("utf-8")))
    assert len(pages[0]) > 20
    assert pages[0] == pages[1]
