"""What a shell offers after the tabulator key: missions, predictions, run folders, orbits.

Nothing is computed and nothing is refused here: a file that cannot be read offers nothing.
"""

import os
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from click import Context, Parameter
from click.shell_completion import CompletionItem

Offer = Callable[[Context, Parameter, str], list[CompletionItem]]
MISSIONS = (".yaml", ".yml")
_SPECIAL = re.compile(r"([\s\\'\"`$&|;<>()\[\]{}*?!#~^])")


def missions(ctx: Context, parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    """Built-in missions and mission files."""
    return _items(incomplete, [*_built_in(), *_beside(incomplete, _is_mission)])


def studies(ctx: Context, parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    """Study files."""
    return _items(incomplete, _beside(incomplete, _is_mission))


def run_folders(ctx: Context, parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    """Folders that a command of this program wrote, but for those named already."""
    given = {str(one).rstrip("/") for value in ctx.params.values() for one in _several(value)}
    return _items(incomplete, (name for name in _beside(incomplete, _is_run) if name not in given))


def orbits(ctx: Context, parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    """What has an orbit: folders of runs and fits, missions, and else any file."""
    return _items(incomplete, [*_built_in(), *_beside(incomplete, lambda path: _is_run(path) or path.is_file())])


def files(ctx: Context, parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    """Any file, as the shell finds them."""
    return [CompletionItem(incomplete, type="file")]


def named(part: str) -> Offer:
    """Names of a part of the mission on the line: its predictions, estimators or telescopes."""

    def offer(ctx: Context, parameter: Parameter, incomplete: str) -> list[CompletionItem]:
        said = ctx.params.get("mission") or next(iter(ctx.args), None)  # an option without its value ends the reading
        found = list(_names(str(said), part)) if said else []
        return [CompletionItem(_quoted(name)) for name in found if name.startswith(incomplete)]

    return offer


def _several(value: object) -> Iterable[object]:
    """The values of one parameter."""
    return value if isinstance(value, list | tuple) else (value,)


def _built_in() -> tuple[str, ...]:
    from nebosvod.mission.reading.builtin import builtin_names

    return builtin_names()


def _is_mission(path: Path) -> bool:
    return path.suffix in MISSIONS and path.is_file()


def _is_run(path: Path) -> bool:
    return (path / "manifest.json").is_file() and (path / "summary.json").is_file()


def _beside(incomplete: str, wanted: Callable[[Path], bool]) -> Iterator[str]:
    """Paths that begin as what is typed does and are wanted, as they would be typed."""
    folder, start = os.path.split(incomplete)
    try:
        for path in sorted(Path(folder or ".").iterdir()):
            if path.name.startswith(start) and (start or not path.name.startswith(".")) and wanted(path):
                yield os.path.join(folder, path.name)
    except OSError:
        return


def _items(incomplete: str, names: Iterable[str]) -> list[CompletionItem]:
    """What begins as typed; where that is nothing, files as the shell finds them, so that folders can be entered."""
    found = [CompletionItem(_quoted(name)) for name in dict.fromkeys(names) if name.startswith(incomplete)]
    return found or [CompletionItem(incomplete, type="file")]


def _names(mission: str, part: str) -> Iterator[str]:
    """Names in a part of a mission file, which need not be right otherwise."""
    from nebosvod.errors import NebosvodError
    from nebosvod.mission.reading.builtin import builtin_path
    from nebosvod.mission.yaml.yamlfile import parse_yaml, read_text

    path = Path(mission) if os.path.lexists(mission) or mission not in _built_in() else builtin_path(mission)
    try:
        tree = parse_yaml(read_text(path), mission).tree
    except NebosvodError:
        return
    rows = tree.get(part) if isinstance(tree, dict) else None
    for row in rows if isinstance(rows, list) else []:
        name = row.get("name") if isinstance(row, dict) else None
        if isinstance(name, str) and name.isprintable():
            yield name


def _quoted(name: str) -> str:
    """A name as bash needs it typed, marked twice, for its script reads it once; other shells quote by themselves."""
    bash = os.environ.get("_NEBOSVOD_COMPLETE", "").startswith("bash")
    return _SPECIAL.sub(r"\\\\\1", name) if bash else name
