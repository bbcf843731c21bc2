"""The studies that come with the program, beside the missions that they vary."""

from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from pathlib import Path

from nebosvod.errors import InputError
from nebosvod.mission.yaml.yamlfile import shown


@cache
def _folder() -> Path:
    """Where they are installed (the package is always a plain folder)."""
    return Path(str(files("nebosvod.scenarios.studies")))


@cache
def builtin_studies() -> tuple[str, ...]:
    """Names of the built-in studies, sorted."""
    texts = {path.stem: path.read_text("utf-8") for path in _folder().glob("*.yaml")}
    return tuple(sorted(name for name, text in texts.items() if "\nstudy:" in text))


def study_path(path: str | Path) -> Path:
    """The file of a study, or of a built-in one by its name; a file of that name comes first.

    Raises
    ------
    InputError
        If it looks like a name, and there is no such study; or if it is neither text nor a path.
    """
    if not isinstance(path, str | Path):
        raise InputError(f"a study is loaded by a path or a built-in name (got {type(path).__name__})")
    file, name = Path(path), str(path)
    if file.exists() or file.suffix or len(file.parts) != 1:
        return file
    if name in builtin_studies():
        return _folder() / f"{name}.yaml"
    near = get_close_matches(name, builtin_studies(), 1)
    hint = f'; did you mean "{near[0]}"?' if near else ""
    known = ", ".join(builtin_studies())
    raise InputError(f"{shown(name)}: no file of that name, and no built-in study ({known}){hint}")


def mission_path(name: str) -> Path | None:
    """The mission file of a built-in study, by its name; None where there is no such one."""
    if name != Path(name).name:
        return None
    file = _folder() / f"{name.removesuffix('.yaml')}.yaml"
    return file if file.is_file() and file.stem not in builtin_studies() else None
