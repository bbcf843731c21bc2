"""The house: package list, direction of imports, and what the lint cannot hold."""

import ast
import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from nebosvod.borders.moved import MOVED
from nebosvod.mission.yaml.yamlfile import parse_yaml

ROOT = Path(__file__).resolve().parent.parent
STAGES = ("dynamics", "observation", "estimation", "nebosvod")
LEAVES = ("nebosvod.errors", "nebosvod.units", "nebosvod.timescale", "nebosvod.version", "nebosvod.borders")
MAY_IMPORT = {
    "dynamics": {"dynamics"},
    "observation": {"dynamics", "observation"},
    "estimation": {"estimation"},
    "nebosvod": {"dynamics", "observation", "estimation", "scenarios", "nebosvod"},
}
CODE = [path for stage in STAGES for path in sorted((ROOT / stage).rglob("*.py"))]


def imported_names(path: Path) -> set[str]:
    """Every module of this project that a file imports, also inside functions and under TYPE_CHECKING."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names} | {node.module}
    return {name for name in names if name.split(".")[0] == "nebosvod"}


def stage_of(name: str) -> str:
    """The stage a module name belongs to."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 and parts[1] in (*STAGES, "scenarios") else "nebosvod"


@pytest.mark.smoke
def test_package_list_equals_the_folders_with_an_init_file() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]
    folders = {
        path.parent.relative_to(ROOT).as_posix()
        for top in (*STAGES, "scenarios")
        for path in (ROOT / top).rglob("__init__.py")
    }
    names = {f if f.split("/")[0] == "nebosvod" else f"nebosvod/{f}" for f in folders}
    assert set(settings["packages"]) == {name.replace("/", ".") for name in names}
    assert set(settings["package-dir"].values()) == folders


def test_every_file_beside_the_code_is_named_as_data_of_its_package() -> None:
    """Nothing but package-data ships them: a file of another kind would be missing from the wheel."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]
    assert not settings["include-package-data"]
    for folder in sorted(settings["package-dir"].values()):
        top = ROOT / folder
        shipped = {path for pattern in settings["package-data"]["*"] for path in top.glob(pattern)}
        beside = {path for path in (*top.glob("*"), *top.glob("data/**/*")) if path.is_file() and path.suffix != ".py"}
        assert beside <= shipped, folder


@pytest.mark.parametrize("path", CODE, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_imports_go_one_way_from_left_to_right(path: Path) -> None:
    stage = path.relative_to(ROOT).parts[0]
    for name in imported_names(path):
        leaf = any(name == known or name.startswith(known + ".") for known in LEAVES)
        assert leaf or name == "nebosvod" or stage_of(name) in MAY_IMPORT[stage], f"{path} imports {name}"


LOOSE = {"cli", "pipeline", "version", "units", "errors", "timescale", "__init__", "__main__"}
# A module imports only from its own room and from rooms above it; doors of stages and leaves are open to all.
ROOMS = (
    "nebosvod/borders",
    "nebosvod/tasks",
    "dynamics",
    "observation/earth",
    "observation/spacecraft",
    "observation/formats",
    "observation/reduction",
    "observation/measurement",
    "observation/uncertainty",
    "observation/initial",
    "estimation/problem",
    "estimation/filters",
    "estimation/solvers",
    "estimation/accuracy",
    "nebosvod/mission/yaml",
    "nebosvod/mission",
    "nebosvod/orbits",
    "nebosvod/mission/reading",
    "nebosvod/scene",
    "nebosvod/ephemerides",
    "nebosvod/engine",
    "nebosvod/findings",
    "nebosvod/impacts",
    "nebosvod/planning",
    "nebosvod/fits",
    "nebosvod/first_hour",
    "nebosvod/results",
    "nebosvod/report/kit",
    "nebosvod/report/run",
    "nebosvod/report/fit",
    "nebosvod/report/risk",
    "nebosvod/report",
    "nebosvod/pipeline",
    "nebosvod/studies",
    "nebosvod/workbench",
    "nebosvod/commands",
    "nebosvod/notebook/summaries",
    "nebosvod/notebook",
    "nebosvod/cli",
)
DOORS = ("dynamics", "observation", "estimation", "nebosvod/mission")  # what a stage or room shows to those below it
FILE_OF = {
    "nebosvod." * (path.parts[len(ROOT.parts)] != "nebosvod")
    + ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for path in CODE
}


def room_of(path: Path) -> str | None:
    """The room a module stands in; None for leaves and for doors, which all may import."""
    place = path.relative_to(ROOT)
    folder = place.parent.as_posix()
    if place.stem == "__init__" and folder in (*DOORS, "nebosvod"):
        return None
    if folder in ("nebosvod", "observation", "estimation"):
        known = {"pipeline": "nebosvod/pipeline", "cli": "nebosvod/cli", "__main__": "nebosvod/cli"}
        return known.get(place.stem)
    return folder


def targets(path: Path) -> set[Path]:
    """The modules a file imports, a name that is no module by the module that holds it."""
    return {FILE_OF[name] for name in imported_names(path) if name in FILE_OF}


@pytest.mark.parametrize("path", CODE, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_room_imports_only_from_rooms_above_it(path: Path) -> None:
    room = room_of(path)
    if room is None:
        return
    above = {one for target in targets(path) if (one := room_of(target)) is not None}
    assert not {one for one in above if ROOMS.index(one) > ROOMS.index(room)}


def run_time_targets(path: Path) -> set[Path]:
    """The modules a file imports when it runs, also inside functions; not those for types alone."""
    tree = ast.parse(path.read_text("utf-8"))
    for_types = {node for node in tree.body if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)}
    tree.body = [node for node in tree.body if node not in for_types]
    asked = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module]
    names = {name for node in asked for alias in node.names for name in (f"{node.module}.{alias.name}", node.module)}
    return {FILE_OF[name] for name in names if name in FILE_OF and FILE_OF[name].stem != "__init__"}


def test_no_files_import_each_other_in_a_circle() -> None:
    """Nor through an import inside a function, which only hides it."""
    left = {path: run_time_targets(path) for path in CODE}
    while free := [path for path, wanted in left.items() if not wanted & left.keys()]:
        for path in free:
            del left[path]
    assert not [path.relative_to(ROOT).as_posix() for path in left if path in set().union(*left.values())]


@pytest.mark.parametrize("room", [room for room in ROOMS if (ROOT / room).is_dir()])
def test_every_room_says_at_its_door_what_it_is(room: str) -> None:
    words = ast.get_docstring(ast.parse((ROOT / room / "__init__.py").read_text("utf-8"))) or ""
    assert words.splitlines()[0].rstrip().endswith((".", "one."))


def test_no_module_stands_outside_a_room() -> None:
    assert {path.stem for path in (ROOT / "nebosvod").glob("*.py")} == LOOSE
    assert {path.stem for path in (ROOT / "observation").glob("*.py")} == {"__init__", "contracts"}
    assert {path.stem for path in (ROOT / "estimation").glob("*.py")} == {"__init__"}


@pytest.mark.smoke
def test_public_verbs_stay_functions_when_every_module_is_loaded() -> None:
    """A module of a verb's name would take its place at the second access."""
    script = f"""
import importlib
for name in {sorted(FILE_OF)!r}:
    if not name.endswith("__main__"):
        importlib.import_module(name)
import nebosvod
for name in nebosvod.__all__:
    thing = getattr(nebosvod, name)
    assert name == "__version__" or callable(thing), name
"""
    subprocess.run([sys.executable, "-c", script], cwd=ROOT, check=True)


@pytest.mark.parametrize(("old", "new"), MOVED.items())
def test_names_that_version_0_1_showed_still_import_and_say_the_new_one(old: str, new: str) -> None:
    sys.modules.pop(old, None)
    with pytest.warns(DeprecationWarning, match=f"{old} is now {new}$") as said:
        there = importlib.import_module(old)
    assert there is importlib.import_module(new)
    assert len(said) == 1


# every import in README.md, docs/ and examples/ of version 0.1.0, and every name in their prose
SHOWN_BY_0_1 = """
nebosvod: Result load_mission run
nebosvod.dynamics: Ephemeris ForceModel Nongrav RadiationPressure find_encounters perigee_distance propagate
nebosvod.dynamics: propagate_many target_plane
nebosvod.dynamics.constants: AU_KM DAY_S
nebosvod.dynamics.elements: cometary_to_state keplerian_to_state
nebosvod.dynamics.forces:
nebosvod.dynamics.frames: R_icrf_from_ecliptic
nebosvod.errors: NebosvodError
nebosvod.estimation: Block Estimate IterationResult LinearProblem Prior Treatment
nebosvod.estimation: batch consistency gauss_newton kalman recursive two_stage
nebosvod.estimation.budget: if_vanished
nebosvod.estimation.combined: GridBlock adapt equivalent_measurement
nebosvod.estimation.kalman: Belief
nebosvod.mission: load_mission_text
nebosvod.observation: read_astrometry read_oem write_psv write_xml
nebosvod.observation.observers: telescopes
nebosvod.observation.weights: weigh
nebosvod.pipeline: run
nebosvod.timescale: Epoch
"""


@pytest.mark.parametrize("line", SHOWN_BY_0_1.split("\n")[1:-1])
@pytest.mark.filterwarnings("ignore:.* is now:DeprecationWarning")
def test_everything_that_the_documentation_of_0_1_imported_is_there(line: str) -> None:
    name, _, shown = line.partition(":")
    module = importlib.import_module(name)
    assert [one for one in shown.split() if not hasattr(module, one)] == []


@pytest.mark.parametrize("leaf", ["errors", "timescale", "units", "version"])
def test_leaves_import_no_stage(leaf: str) -> None:
    known = {name for name in imported_names(ROOT / "nebosvod" / f"{leaf}.py") if name.split(".")[1] != leaf}
    assert {".".join(name.split(".")[:2]) for name in known} <= {*LEAVES}


def test_loops_are_compiled_at_one_border_only() -> None:
    """It goes on without a cache where there is no place for one; a bare `numba.njit(cache=True)` does not."""
    importing = {
        path.relative_to(ROOT).as_posix()
        for path in CODE
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if (isinstance(node, ast.Import) and any(alias.name.split(".")[0] == "numba" for alias in node.names))
        or (isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "numba")
    }
    assert importing == {"nebosvod/borders/compiled.py", "dynamics/compilation.py"}  # the latter for the type's name


def test_no_module_is_longer_than_600_lines() -> None:
    long = {path.name: count for path in CODE if (count := len(path.read_text("utf-8").splitlines())) > 600}
    assert not long


TESTS = sorted((ROOT / "tests").rglob("*.py"))
# beside the rooms: the stages as wholes, tests of what stands outside the code, real objects, inputs
OTHER_TESTS = {"tests", "nebosvod", "observation", "estimation", "benchmarks", "examples", "nebosvod/fits/real"}


def test_tests_stand_in_the_rooms_of_their_subjects() -> None:
    folders = {path.parent.relative_to(ROOT / "tests").as_posix() for path in TESTS if path.parent != ROOT / "tests"}
    assert folders - OTHER_TESTS <= {room for room in ROOMS if (ROOT / room).is_dir()}


def test_no_test_module_is_much_longer_than_600_lines() -> None:
    assert {path.name: n for path in TESTS if (n := len(path.read_text("utf-8").splitlines())) > 620} == {}


def test_no_function_is_longer_than_60_lines_of_code() -> None:
    long = []
    for path in CODE:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.FunctionDef):
                body = node.body[1:] if ast.get_docstring(node) else node.body
                length = body[-1].end_lineno - body[0].lineno + 1 if body else 0  # type: ignore[operator]
                if length > 60:
                    long.append(f"{path.relative_to(ROOT)}:{node.name} {length}")
    assert not long


@pytest.mark.smoke
def test_import_at_the_root_of_a_checkout_finds_every_stage() -> None:
    """Nothing of nebosvod is installed there (-S: no .pth of an editable installation), or it is elsewhere."""
    packages = [path for path in sys.path if path.endswith("site-packages")]
    script = f"import sys; sys.path += {packages!r}; import nebosvod.dynamics, nebosvod.estimation, nebosvod.scenarios"
    script += "; import nebosvod.observation; print(nebosvod.dynamics.__file__)"
    done = subprocess.run([sys.executable, "-S", "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == str(ROOT / "dynamics" / "__init__.py"), done.stderr


@pytest.mark.parametrize("name", ["Makefile", ".pre-commit-config.yaml", "CONTRIBUTING.md", ".ci/run"])
def test_files_that_the_tools_and_the_guide_name_are_there(name: str) -> None:
    named = re.findall(
        r"(?:tests|tools|benchmarks|docs|nebosvod|dynamics)/[\w/.-]*\w", (ROOT / name).read_text("utf-8")
    )
    assert [one for one in named if not (ROOT / one).exists()] == []


def test_hooks_run_from_the_environment_and_fetch_nothing() -> None:
    """Each is local, of this machine, from .venv, and at a stage that is installed."""
    settings: Any = parse_yaml((ROOT / ".pre-commit-config.yaml").read_text("utf-8"), "hooks").tree
    (repository,) = settings["repos"]
    assert repository["repo"] == "local"
    for hook in repository["hooks"]:
        assert hook["language"] == "system", hook["id"]
        assert ".venv/bin/" in hook["entry"], hook["id"]
        assert set(hook["stages"]) <= set(settings["default_install_hook_types"]), hook["id"]
