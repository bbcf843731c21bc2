"""The file on the desk: what it says, and saving it only where it still says what was read."""

import hashlib
import os
import stat
from pathlib import Path

from nebosvod.borders.wholefile import whole_file
from nebosvod.errors import OutputError
from nebosvod.mission.reading.builtin import builtin_path
from nebosvod.mission.reading.reader import mission_file
from nebosvod.mission.yaml.yamlfile import read_text, shown


class ChangedError(OutputError):
    """The file says something else than what was read."""


class Desk:
    """A mission file, or a built-in mission that becomes a file when it is saved.

    Parameters
    ----------
    mission : as on the command line.

    Attributes
    ----------
    path : where it is saved.
    name : what messages call it.

    Raises
    ------
    InputError, DataError
        If it cannot be read as text.
    """

    def __init__(self, mission: str) -> None:
        source = mission_file(mission)
        builtin = not os.path.lexists(mission) and source == builtin_path(mission)
        self._source: Path | None = source if builtin else None
        self.path = Path(os.path.abspath(f"{mission}.yaml" if builtin else mission))
        self.name = self.path.name
        self.argument = mission if builtin else str(self.path)
        self.read()

    @property
    def folder(self) -> Path:
        """What files the mission names are relative to."""
        return self.path.parent if self._source is None else self._source.parent

    @property
    def saved(self) -> bool:
        """Whether it is a file of the user's."""
        return self._source is None

    def read(self) -> tuple[str, str]:
        """The text, and the mark of what is on disk now."""
        text = read_text(self._source or self.path)
        return text, self.mark()

    def mark(self) -> str:
        """A hash of the bytes on disk; empty where there is no file."""
        try:
            return hashlib.sha256(self.path.read_bytes()).hexdigest() if os.path.lexists(self.path) else ""
        except OSError as error:
            raise OutputError(f"{shown(str(self.path))}: cannot be read: {error.strerror}") from None

    def save(self, text: str, mark: str) -> str:
        """Write the text, whole or not at all; returns the mark of what is on disk then.

        Parameters
        ----------
        mark : of what the text was made from.

        Raises
        ------
        ChangedError
            If the file has another mark; it is left alone.
        OutputError
            If it cannot be written.
        """
        if self.mark() != mark:
            gone = not os.path.lexists(self.path)
            changed = f"{'is gone from disk' if gone else 'has changed on disk'} since it was read here"
            what = changed if mark else "exists already"
            raise ChangedError(f"{self.name}: {what}; nothing was written")
        new = not os.path.lexists(self.path)
        mode = None if new else stat.S_IMODE(self.path.lstat().st_mode)
        returns = not new and b"\r\n" in self.path.read_bytes()
        data = (text.replace("\n", "\r\n") if returns else text).encode("utf-8")
        with whole_file(self.path, new=new) as file:
            if mode is not None:
                os.fchmod(file.fileno(), mode)
            file.write(data)
        self._source, self.argument = None, str(self.path)
        return hashlib.sha256(data).hexdigest()
