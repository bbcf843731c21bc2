"""The house: package list, direction of imports, and what the lint cannot hold."""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
STAGES = ("dynamics", "observation", "estimation", "nebosvod")
LEAVES = ("nebosvod.errors", "nebosvod.timescale", "nebosvod.borders.quantities", "nebosvod.borders.wholefile")
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


@pytest.mark.parametrize("leaf", ["errors", "timescale", "quantities", "wholefile"])
def test_leaves_import_no_stage(leaf: str) -> None:
    known = {name for name in imported_names(ROOT / "nebosvod" / f"{leaf}.py") if name.split(".")[1] != leaf}
    assert {".".join(name.split(".")[:2]) for name in known} <= {*LEAVES}


def test_no_module_is_longer_than_600_lines() -> None:
    long = {path.name: count for path in CODE if (count := len(path.read_text("utf-8").splitlines())) > 600}
    assert not long


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
