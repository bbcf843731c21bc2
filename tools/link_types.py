"""Make build/types/nebosvod/, links to the five folders, so that type checkers see the installed names.

mypy and pyright cannot follow the package-dir map of pyproject.toml; this view of the tree is what they read.
"""

from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VIEW = ROOT / "build" / "types" / "nebosvod"
STAGES = ("dynamics", "observation", "estimation", "scenarios")


def main() -> None:
    """Rebuild the view; existing links are replaced."""
    VIEW.mkdir(parents=True, exist_ok=True)
    for old in VIEW.iterdir():
        old.unlink()
    for stage in STAGES:
        (VIEW / stage).symlink_to(ROOT / stage, target_is_directory=True)
    for path in (ROOT / "nebosvod").iterdir():
        if path.name != "__pycache__":
            (VIEW / path.name).symlink_to(path, target_is_directory=path.is_dir())


if __name__ == "__main__":
    main()
