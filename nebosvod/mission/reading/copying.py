"""A mission copied under another name, comments and all, to be changed."""

import re
from pathlib import Path

from nebosvod.errors import InputError
from nebosvod.mission.reading.builtin import builtin_names, builtin_path, quoted
from nebosvod.mission.reading.reader import load_any
from nebosvod.mission.yaml.yamlfile import read_text, shown

_NAME = re.compile(r"^name:[ \t]*(\"(?:[^\"\\\\]|\\\\.)*\"|'(?:[^']|'')*'|[^#\n]*?)[ \t]*(?=#|$)", re.MULTILINE)
_SCHEMA = re.compile(r"^# yaml-language-server:.*\n")


def copied_text(source: str, path: Path) -> str:
    """The text of a mission, named after the file it goes to.

    Parameters
    ----------
    source : a built-in name or a file; it must be right.
    path : where it goes.

    Raises
    ------
    InputError
        If there is no such mission, it is wrong, or it names files that do not stand beside the new one.
    """
    mission = load_any(source)
    built_in = source in builtin_names() and not Path(source).exists()
    text = read_text(builtin_path(source) if built_in else Path(source))
    beside = mission.path.parent.resolve() if mission.path is not None else None
    if mission.input_files and beside != path.parent.resolve():
        names = ", ".join(sorted({file.name for file in mission.input_files})[:3])
        raise InputError(
            f"--from: {shown(source)} names files beside it ({names}); put the copy there too: "
            f"{(mission.input_files[0].parent / path.name)}"
        )
    renamed, count = _NAME.subn(lambda found: f"name: {quoted(path.stem)}", _SCHEMA.sub("", text), count=1)
    if count != 1:  # a mission in one pair of braces
        raise InputError(
            f"--from: {shown(source)} has no line that begins with name:, so it cannot be renamed; copy it"
        )
    return renamed
