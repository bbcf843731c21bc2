"""The missions that come with the program, and the one to start from."""

from functools import cache
from importlib.resources import files
from pathlib import Path

from nebosvod.mission.yaml.yamlfile import parse_yaml


@cache
def _folder() -> Path:
    """Where the missions are installed (the package is always a plain folder)."""
    return Path(str(files("nebosvod.scenarios")))


@cache
def builtin_names() -> tuple[str, ...]:
    """Names of the built-in missions, sorted."""
    return tuple(sorted(path.stem for path in _folder().glob("*.yaml") if not path.stem.startswith("_")))


def builtin_path(name: str) -> Path:
    """The file of a built-in mission."""
    return _folder() / f"{name}.yaml"


def list_missions() -> list[tuple[str, str]]:
    """Name and title of each built-in mission."""
    rows = []
    for name in builtin_names():
        tree = parse_yaml(builtin_path(name).read_text("utf-8"), name).tree
        title = tree.get("title") if isinstance(tree, dict) else None
        rows.append((name, str(title or "")))
    return rows


def template_text(name: str) -> str:
    """A commented mission called `name`, to start one's own from."""
    text = (_folder() / "_template.yaml").read_text("utf-8")
    return text.replace("name: my-mission", f"name: {quoted(name)}", 1)


def quoted(name: str) -> str:
    """The name as a YAML scalar."""
    plain = name.isascii() and name.replace("-", "").replace("_", "").isalnum() and name[0].isalpha()
    return name if plain and name.lower() not in ("true", "false", "null") else f'"{_escaped(name)}"'


def _escaped(name: str) -> str:
    return "".join(
        letter if letter.isprintable() and letter not in '"\\' else f"\\U{ord(letter):08x}" for letter in name
    )
