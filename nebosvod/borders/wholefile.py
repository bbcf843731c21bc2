"""One way to write a file: whole or not at all, never through a symbolic link.

The contents go to a new file beside the place, made with O_EXCL and O_NOFOLLOW under a name nobody can foresee, and
one rename puts it there. A file that must not be replaced is linked into place instead, which fails where one stands.
"""

import errno
import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from nebosvod.errors import OutputError

FRESH = re.compile(r"\.nebosvod-[0-9a-f]{16}\.partial")
NO_HARD_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK)


@contextmanager
def whole_file(path: Path, *, new: bool = False, found: str = "") -> Iterator[BinaryIO]:
    """A file to fill; it appears at `path` whole when the block ends, or not at all.

    Parameters
    ----------
    new : refuse what stands at `path`; else a regular file there is replaced.
    found : what to add to the message of a failure.

    Raises
    ------
    OutputError
        If a symbolic link or anything but a regular file is in the way, or the system refuses.
    """
    require_place(path, new=new)
    fresh = path.with_name(f".nebosvod-{secrets.token_hex(8)}.partial")
    try:
        try:
            flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
            with open(os.open(fresh, flags, 0o666), "w+b") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            require_place(path, new=new)
            _put(fresh, path, new)
        finally:
            with suppress(OSError):
                fresh.unlink()
    except OSError as error:
        raise OutputError(f"{path}: cannot write: {reason(error)}{found}") from None


def write_whole(path: Path, data: bytes, found: str = "") -> Path:
    """Write `data` to `path` in one step, replacing a regular file; returns the path."""
    with whole_file(path, found=found) as file:
        file.write(data)
    return path


def write_new_text(path: Path, text: str) -> None:
    """Create `path` with `text`; what stands there already is never touched."""
    with whole_file(path, new=True) as file:
        file.write(text.encode("utf-8"))


def require_place(path: Path, *, new: bool = False) -> None:
    """Refuse a place that cannot be written, before any work is done for it.

    Raises
    ------
    OutputError
        If `path` is a symbolic link, no regular file, exists although it must be `new`, or its folder is missing or
        read-only.
    """
    try:
        kind = path.lstat().st_mode
    except FileNotFoundError:
        folder = path.parent
        if not folder.is_dir():
            raise OutputError(f"{path}: cannot write: there is no folder {folder}") from None
        if not os.access(folder, os.W_OK | os.X_OK):
            raise OutputError(f"{path}: cannot write: {folder} is read-only") from None
        return
    except (OSError, ValueError) as error:
        raise OutputError(f"{path}: cannot write: {reason(error)}") from None
    refuse_link(path, kind)
    if new:
        raise OutputError(f"{path}: exists already; choose another name")
    if not stat.S_ISREG(kind):
        raise OutputError(f"{path}: cannot write: a folder or a device is in the way")


def require_places(*paths: Path | None) -> None:
    """Refuse new files that cannot be written, or two that would be one, before any work is done for them."""
    wanted = [path for path in paths if path is not None]
    for path in wanted:
        require_place(path, new=True)
    if len({os.path.abspath(path) for path in wanted}) < len(wanted):
        raise OutputError(f"{wanted[0]}: is named for two files; choose another name for one of them")


def refuse_link(path: Path, kind: int) -> None:
    """Raise OutputError if a file of this mode is a symbolic link."""
    if stat.S_ISLNK(kind):
        raise OutputError(f"{path}: is a symbolic link, and nothing is written through links; name the place itself")


def reason(error: OSError | ValueError) -> str:
    """Why the system refused, in words."""
    if isinstance(error, FileExistsError | NotADirectoryError):
        return "a file stands where a folder is needed"
    if isinstance(error, OSError):
        return "the disk is full" if error.errno == errno.ENOSPC else error.strerror or str(error)
    return str(error)


def _put(fresh: Path, path: Path, new: bool) -> None:
    """Give the finished file its name."""
    if not new:
        fresh.replace(path)
        return
    try:
        os.link(fresh, path, follow_symlinks=False)
    except FileExistsError:
        raise OutputError(f"{path}: exists already; choose another name") from None
    except OSError as error:
        if error.errno not in NO_HARD_LINKS:
            raise
        fresh.rename(path)  # a moment ago nothing stood there
