"""The mission or the fit that a folder was made from, read again from what the folder keeps of it."""

import hashlib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from nebosvod.borders.stored import held_together, read_object
from nebosvod.errors import InputError
from nebosvod.mission.fit import FitMission
from nebosvod.mission.model import Mission
from nebosvod.mission.reading.reader import load_text_beside
from nebosvod.mission.yaml.yamlfile import parse_yaml, shown


def made_from(folder: Path) -> Mission | FitMission:
    """What a folder of `nebosvod run` or `nebosvod fit` was made from.

    Raises
    ------
    InputError
        If the folder is damaged, or files it was made from are not where they were, or have changed since.
    """
    manifest = read_object(folder / "manifest.json")
    with held_together(str(folder)):
        text, name = str(manifest["mission"]["text"]), str(manifest["mission"]["name"])
        inputs = {str(path): str(digest) for path, digest in manifest.get("inputs_sha256", {}).items()}
    _require_unchanged(folder, inputs)
    said = f"{shown(str(folder))}, made from {shown(name)}"
    tree: Any = parse_yaml(text, said).tree
    plan = tree.get("fit") if isinstance(tree, dict) else None
    files = plan.get("observations") if isinstance(plan, dict) else None
    if isinstance(files, list) and files and all(str(file) in inputs for file in files):
        try:  # of a command line: no file of settings lay beside the observations
            return FitMission.model_validate(tree)
        except ValidationError as error:
            raise InputError(f"{said}: {error}") from None
    return load_text_beside(text, said, _home(files, inputs))


def _home(files: Any, inputs: dict[str, str]) -> Path:
    """The folder that names in the text are relative to, by where the first of them was."""
    first = str(files[0]) if isinstance(files, list) and files else None
    for path in inputs:
        if first is not None and Path(path).parts[-len(Path(first).parts) :] == Path(first).parts:
            return Path(*Path(path).parts[: -len(Path(first).parts)])
    return Path(next(iter(inputs))).parent if inputs else Path()


def _require_unchanged(folder: Path, inputs: dict[str, str]) -> None:
    """Raise InputError unless every file is as it was."""
    for name, digest in inputs.items():
        path = Path(name)
        said = f"{shown(str(folder))}: was made from {shown(name)}"
        if not path.is_file():
            raise InputError(f"{said}, which is not there; put it back, or call this where the folder was made")
        with path.open("rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != digest:
                raise InputError(f"{said}, which has changed since; make the folder again")
