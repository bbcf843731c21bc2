"""The right to write at one place: a locked file `.NAME.lock` beside it, freed by the system when the process ends.

The file is opened without following a link and never emptied; one that somebody else left there is not touched.
"""

import fcntl
import os
import stat
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from nebosvod.borders.wholefile import reason
from nebosvod.errors import OutputError

TEXT = b"nebosvod is writing here\n"
ATTEMPTS = 20
FLAGS = os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK


class Lock:
    """Holds the lock of one folder from `with` to its end.

    Parameters
    ----------
    folder : the place, absolute; the lock lies beside it.
    shown : how messages call it.
    writer : what the holder is, as "another run".

    Raises
    ------
    OutputError
        If another process holds it, what is in the way is no lock of ours, or the system refuses.
    """

    def __init__(self, folder: Path, shown: Path, writer: str) -> None:
        if not folder.name:
            raise OutputError(f"{shown}: is no place for a folder of results; choose another with -o")
        self._folder, self._shown, self._writer = folder, shown, writer
        self._path = folder.with_name(f".{folder.name}.lock")
        self._descriptor: int | None = None
        self._own_file = True

    def __enter__(self) -> "Lock":
        try:
            for _ in range(ATTEMPTS):
                if self._attempt():
                    return self
        except BlockingIOError:
            raise self._busy() from None
        except (OSError, ValueError) as error:
            raise OutputError(f"{self._shown}: cannot write here: {reason(error)}; choose another place") from None
        raise self._busy()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._descriptor is not None:
            if self._own_file:
                with suppress(OSError):
                    self._path.unlink()
            os.close(self._descriptor)
            self._descriptor = None

    def _busy(self) -> OutputError:
        return OutputError(f"{self._shown}: {self._writer} is writing here; wait for it or choose another folder")

    def _attempt(self) -> bool:
        """Lock the file; False if its holder took it away meanwhile, so that the lock would guard nothing."""
        descriptor = self._open()
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if self._own_file:
                if not self._still_there(descriptor):
                    os.close(descriptor)
                    return False
                self._sign(descriptor)
        except BaseException:
            os.close(descriptor)
            raise
        self._descriptor = descriptor
        return True

    def _sign(self, descriptor: int) -> None:
        """Write whose file it is; where the disk is full it is not left behind."""
        try:
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, TEXT, 0)
        except OSError:
            with suppress(OSError):
                self._path.unlink()
            raise

    def _open(self) -> int:
        """The lock file; where nobody may make one, a folder that stands can be locked itself."""
        if self._path.is_symlink():
            raise OutputError(f"{self._path}: is a symbolic link where the lock of {self._shown} belongs; take it away")
        try:
            descriptor = os.open(self._path, FLAGS | os.O_CREAT, 0o666)
        except PermissionError:
            if os.access(self._folder.parent, os.W_OK) or not self._folder.is_dir():
                raise
            self._own_file = False
            return os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
        regular = stat.S_ISREG(os.fstat(descriptor).st_mode)
        if not regular or os.pread(descriptor, len(TEXT) + 1, 0) not in (b"", TEXT):
            os.close(descriptor)
            raise OutputError(
                f"{self._path}: was not written by this program, but is where the lock of {self._shown} belongs; "
                "rename it, or choose another folder"
            )
        return descriptor

    def _still_there(self, descriptor: int) -> bool:
        try:
            return os.path.samestat(os.fstat(descriptor), self._path.lstat())
        except FileNotFoundError:
            return False
