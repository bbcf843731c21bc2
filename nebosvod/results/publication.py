"""A finished folder takes its place in one step, and what the user keeps there stays.

Notes
-----
Linux (`renameat2`) and macOS (`renamex_np`) exchange two folders in one step: at every moment either the earlier
result or the new one stands whole at its place. File systems that cannot (some network ones) get two renames; if the
process is killed just between them, `recover` puts the earlier result back before anything else is done there.

Every step can be repeated: what a killed process leaves is a hidden folder whose name begins with the digest of the
place's name, with a marked record in it, and the next writer or reader of the place clears it by `_clear`.
"""

import ctypes
import errno
import hashlib
import os
import secrets
import shutil
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from nebosvod.borders.wholefile import FRESH
from nebosvod.results.ownership import RECORD, files_in, hashes_of
from nebosvod.results.recognise import read_json

AT_FDCWD, EXCHANGE = (-2 if sys.platform == "darwin" else -100), 2
CANNOT = (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EPERM)
LATE = "report.html"  # made from the other files, after the list of a stage was first written
PARTIAL, OLD = "partial", "old"


def new_stage(folder: Path) -> Path:
    """A new hidden folder beside `folder`, to be filled and published."""
    stage = _beside(folder, PARTIAL)
    stage.mkdir()
    return stage


def publish(stage: Path, folder: Path) -> None:
    """Put `stage` at `folder`; files there that the record of the earlier result does not list move along.

    Raises
    ------
    OSError
        If the system refuses; the earlier result is at its place then.
    """
    if not folder.exists():
        stage.rename(folder)
        return
    _carry(folder, stage)
    if exchange(stage, folder):
        _clear(stage, folder)
        return
    old = _beside(folder, OLD)
    folder.rename(old)
    try:
        stage.rename(folder)
    except OSError:
        old.rename(folder)
        raise
    _clear(old, folder)


def recover(folder: Path) -> None:
    """Finish or undo what a killed process began at a place."""
    left = list(_left(folder))
    if not os.path.lexists(folder):
        for old in left:
            if old.suffix == f".{OLD}" and hashes_of(read_json(old / RECORD)) is not None:
                old.rename(folder)
                break
    for one in left:
        if one.exists():
            _clear(one, folder)


def discard(stage: Path, folder: Path) -> None:
    """Remove a stage that was not published; without a word if the system refuses."""
    if stage.exists():
        _clear(stage, folder)


def exchange(one: Path, two: Path) -> bool:
    """Swap two folders in one step; False where this system or file system cannot."""
    name = "renamex_np" if sys.platform == "darwin" else "renameat2"
    call = getattr(ctypes.CDLL(None, use_errno=True), name, None)
    if call is None:
        return False
    first, second = os.fsencode(one), os.fsencode(two)
    done = call(first, second, EXCHANGE) if sys.platform == "darwin" else call(
        AT_FDCWD, first, AT_FDCWD, second, EXCHANGE
    )  # fmt: skip
    if done == 0:
        return True
    code = ctypes.get_errno()
    if code in CANNOT:
        return False
    raise OSError(code, os.strerror(code), str(two))


def _beside(folder: Path, kind: str) -> Path:
    return folder.with_name(f"{_prefix(folder)}{secrets.token_hex(4)}.{kind}")


def _prefix(folder: Path) -> str:
    """What the names of hidden folders of a place begin with: of constant length, however long its own name is."""
    return f".nebosvod-{hashlib.sha256(os.fsencode(folder.name)).hexdigest()[:12]}-"


def _left(folder: Path) -> Iterator[Path]:
    """Hidden folders of a place."""
    with suppress(OSError):
        for entry in os.scandir(folder.parent):
            kind = entry.name.rpartition(".")[2]
            if (
                entry.name.startswith(_prefix(folder))
                and kind in (PARTIAL, OLD)
                and entry.is_dir(follow_symlinks=False)
            ):
                yield folder.parent / entry.name


def _carry(folder: Path, stage: Path) -> None:
    """Give the stage a second name of every file of the user, so that no moment is without it.

    Where the file system has no hard links, `_clear` moves the file after the exchange.
    """
    listed = {*(hashes_of(read_json(folder / RECORD)) or ()), RECORD}
    for name, path in files_in(folder):
        if name not in listed and not os.path.lexists(stage / name):
            with suppress(OSError):
                _folders(folder, stage, name)
                os.link(path, stage / name, follow_symlinks=False)


def _folders(source: Path, target: Path, name: str) -> None:
    """The folders that hold a file, with the permissions they have."""
    for parent in reversed(Path(name).parents[:-1]):
        if (target / parent).is_symlink():
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(target / parent))
        if not (target / parent).is_dir():
            (target / parent).mkdir()
            shutil.copystat(source / parent, target / parent)


def _clear(left: Path, folder: Path) -> None:
    """Remove the files of ours from a hidden folder, the record last; a user's file goes to its place or stays."""
    listed = {*(hashes_of(read_json(left / RECORD)) or ()), LATE}
    with suppress(OSError):
        for name, path in files_in(left):
            if name == RECORD:
                continue
            with suppress(OSError):
                if name in listed or FRESH.fullmatch(path.name) or _has(folder, name, path):
                    path.unlink()
                elif folder.is_dir() and not os.path.lexists(folder / name):
                    _folders(left, folder, name)
                    path.rename(folder / name)
        _remove_empty(left, folder, {parent for name in listed for parent in map(str, Path(name).parents)})
        if {name for name, _ in files_in(left)} <= {RECORD}:
            (left / RECORD).unlink(missing_ok=True)
            left.rmdir()


def _has(folder: Path, name: str, path: Path) -> bool:
    """Whether the place has this very file, by the other name `_carry` gave it."""
    with suppress(OSError):
        return os.path.samestat((folder / name).lstat(), path.lstat())
    return False


def _remove_empty(left: Path, folder: Path, ours: set[str], inside: str = "") -> None:
    """Remove the folders without a file; one that the user made keeps its place."""
    for entry in list(os.scandir(left / inside)):
        if entry.is_dir(follow_symlinks=False):
            name = f"{inside}{entry.name}"
            _remove_empty(left, folder, ours, f"{name}/")
            with suppress(OSError):
                if name not in ours and folder.is_dir() and not os.path.lexists(folder / name):
                    _folders(left, folder, f"{name}/*")
                (left / name).rmdir()
