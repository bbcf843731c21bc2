"""What the program wrote in a folder, by a list with hashes; only that is ever replaced or removed.

The record of a folder (manifest.json) carries a mark, which no other program writes: the version of this contract and
the sha256 of the record but for times and hashes. `outputs_sha256` in it lists every other file. A file that is not
listed is the user's and stays; one that is listed and has another hash was changed by somebody, and stops an overwrite.
"""

import hashlib
import json
import os
import re
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nebosvod.results.recognise import read_json

MARK = "nebosvod_folder"
FORMAT = 1
RECORD = "manifest.json"
# what version 0.1.0, whose folders have no mark, can have written; its list named the user's files, too
OURS = re.compile(r"manifest\.json|summary\.json|arrays\.npz|report\.(html|pdf)|orbit\.(oem|bsp)|tables/[^/]+\.ecsv")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ownership:
    """Whose files a folder holds, each by its path in it with `/`.

    Parameters
    ----------
    listed : files that the record lists, whether they are there or not.
    changed : files of the list with other contents than were written, the record itself with them.
    foreign : everything else, symbolic links too; folders are not counted, only what is in them.
    """

    listed: frozenset[str]
    changed: tuple[str, ...]
    foreign: tuple[str, ...]


def marked(record: Mapping[str, Any]) -> dict[str, Any]:
    """The record with the mark of this program."""
    return {**record, MARK: {"format": FORMAT, "sha256": _digest(record)}}


def intact(record: Mapping[str, Any]) -> bool:
    """Whether a record has the mark and is as it was written."""
    mark = record.get(MARK)
    return isinstance(mark, dict) and mark.get("sha256") == _digest(record)


def _digest(record: Mapping[str, Any]) -> str:
    """Of what two runs with one seed have in common; the list proves itself."""
    rest = {key: value for key, value in record.items() if key not in (MARK, "times", "outputs_sha256")}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode("ascii")).hexdigest()


def hashes_of(record: Mapping[str, Any]) -> dict[str, str] | None:
    """The list of a record, sha256 by path; None if the record is not of this program."""
    found = record.get("outputs_sha256")
    hashes = {str(name): str(value) for name, value in found.items()} if isinstance(found, dict) else {}
    if MARK in record:
        return hashes
    versions = record.get("versions")
    of_010 = isinstance(versions, dict) and "nebosvod" in versions and {"summary.json", "arrays.npz"} <= hashes.keys()
    return {name: value for name, value in hashes.items() if OURS.fullmatch(name)} if of_010 else None


def ownership(folder: Path) -> Ownership | None:
    """Whose files the folder holds; None if it was not written by this program."""
    record = read_json(folder / RECORD)
    hashes = hashes_of(record)
    if hashes is None:
        return None
    changed, foreign = [], []
    for name, path in files_in(folder):
        if name == RECORD:
            if MARK in record and not intact(record):
                changed.append(name)
        elif name not in hashes:
            foreign.append(name)
        elif not is_regular(path) or sha256_of(path) != hashes[name]:
            changed.append(name)
    return Ownership(listed=frozenset({*hashes, RECORD}), changed=tuple(changed), foreign=tuple(foreign))


def files_in(folder: Path) -> Iterator[tuple[str, Path]]:
    """Every entry below a folder that is no folder itself, sorted; links are entries and never followed."""
    for entry in sorted(os.scandir(folder), key=lambda one: one.name):
        path = folder / entry.name
        if entry.is_dir(follow_symlinks=False):
            yield from ((f"{entry.name}/{name}", below) for name, below in files_in(path))
        else:
            yield entry.name, path


def is_regular(path: Path) -> bool:
    """Whether a path is a regular file itself, no link to one."""
    return stat.S_ISREG(path.lstat().st_mode)


def sha256_of(path: Path) -> str:
    """Hex digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def changed_said(folder: Path) -> list[str]:
    """A sentence for each file of a run that is not as the program wrote it."""
    owned = ownership(folder)
    if owned is None:
        return [f"{folder}: manifest.json lists no files, so a change of them would not be seen"]
    return [f"{folder / name}: changed since the program wrote it (another sha256)" for name in owned.changed]
