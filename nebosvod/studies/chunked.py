"""A folder that is filled chunk by chunk: its lock, its record, what is missing, and what may be replaced.

The chunk is the unit of work and of safety: its values and its size do not depend on who computes it, so what was
interrupted continues to the same bytes, with any number of workers.
"""

import json
import math
import os
import re
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from nebosvod.borders.wholefile import FRESH, reason, refuse_link, require_place, write_whole
from nebosvod.errors import OutputError, listed
from nebosvod.results.lock import Lock
from nebosvod.results.ownership import MARK, files_in, is_regular, marked, sha256_of
from nebosvod.results.recognise import read_json
from nebosvod.studies.chunk import CHUNKS, KEPT, chunk_path, read_chunk, write_chunk

Arrays = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """What a folder is filled with.

    Attributes
    ----------
    noun, campaign : "validation", and what a chunk belongs to, in messages; unit : what a chunk has several of.
    record, result : names of two files; ours : names of further files it may write, a pattern.
    keys : what the record of such a folder has; labels : those that may change without another value.
    """

    noun: str
    campaign: str
    record: str
    result: str
    ours: str
    keys: tuple[str, ...]
    labels: tuple[str, ...]
    unit: str

    def fixed(self, record: Mapping[str, Any]) -> dict[str, Any]:
        """What fixes the values of a stored record."""
        return {name: record.get(name) for name in self.keys if name not in self.labels}

    def writes(self, name: str) -> bool:
        """Whether such a folder has files of this name, beside its record."""
        return name != self.record and re.fullmatch(rf"{self.ours}|chunks/\d{{6,}}\.npz", name) is not None

    def is_record(self, record: Mapping[str, Any]) -> bool:
        """Whether a record is one of these; version 0.1.0 wrote no mark."""
        return {*self.keys} <= record.keys() and record.keys() <= {*self.keys, MARK, "outputs_sha256"}


class ChunkedFolder:
    """Owner of a folder while it is filled: lock, record, chunks, the result.

    Parameters
    ----------
    record : the keys of the kind; what is not a label fixes every value.
    size : how many runs or points a chunk has.

    Raises
    ------
    OutputError
        When another process holds the folder, it holds something else, or the place cannot be written.
    """

    def __init__(
        self, folder: Path, kind: Kind, record: Mapping[str, Any], size: int, *, overwrite: bool = False
    ) -> None:
        self.folder, self.kind, self.size = folder, kind, size
        self._content: dict[str, Any] = json.loads(json.dumps(dict(record)))
        self.overwrite = overwrite
        self._absolute = Path(os.path.abspath(folder))
        self._lock = Lock(self._absolute, folder, f"another {kind.noun}")

    def __enter__(self) -> Self:
        try:
            if self._absolute.is_symlink():
                refuse_link(self.folder, self._absolute.lstat().st_mode)
            self._absolute.parent.mkdir(parents=True, exist_ok=True)
            with ExitStack() as held:
                held.enter_context(self._lock)
                self._open()
                held.pop_all()
        except OSError as error:
            raise OutputError(f"{self.folder}: cannot write here: {reason(error)}; choose another with -o") from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.__exit__(kind, error, trace)

    @property
    def fixed(self) -> dict[str, Any]:
        """What fixes every value, as JSON keeps it."""
        return self.kind.fixed(self._content)

    def missing(self, count: int) -> list[int]:
        """Numbers of the chunks of `count` runs or points that are not on disk whole."""
        return [i for i in range(self.chunks(count)) if read_chunk(self.folder, i, self.fixed) is None]

    def changed(self, missing: Iterable[int]) -> list[str]:
        """A sentence for each file that is there, and not as this program wrote it."""
        said = [
            f"{path}: is damaged, was changed, or belongs to another {self.kind.campaign}: its {self.kind.unit} are "
            "computed again"
            for path in (chunk_path(self.folder, number) for number in missing)
            if os.path.lexists(path)
        ]
        result = self.folder / self.kind.result
        written = hashes_listed(read_json(self.folder / self.kind.record)).get(self.kind.result)
        if written is not None and result.exists() and sha256_of(result) != written:
            said.append(f"{result}: changed since the program wrote it (another sha256); it is made again")
        return said

    def chunks(self, count: int) -> int:
        """How many chunks hold so many; the last one may have more than are asked for."""
        return math.ceil(count / self.size)

    def collected(self, count: int) -> dict[str, npt.NDArray[Any]]:
        """The arrays of the first `count`, joined along the first axis."""
        parts = [read_chunk(self.folder, i, self.fixed) for i in range(self.chunks(count))]
        whole = [part for part in parts if part is not None]
        return {name: np.concatenate([part[name] for part in whole])[:count] for name in whole[0]}

    def keep(self, number: int, arrays: Arrays) -> None:
        """Write a chunk that was computed."""
        write_chunk(self.folder, number, self.fixed, arrays)

    def publish(self, files: Mapping[str, bytes]) -> None:
        """Write results, each in one step, and what is here with its hashes."""
        for name, data in files.items():
            write_whole(self.folder / name, data, KEPT)
        self._record()

    def _record(self) -> None:
        """Write the record: what fixes the values, and the list of the files that are there."""
        files = {name: sha256_of(path) for name, path in files_in(self.folder) if self.kind.writes(name)}
        record = marked({**self._content, "outputs_sha256": files})
        write_whole(self.folder / self.kind.record, (json.dumps(record, indent=1) + "\n").encode("utf-8"), KEPT)

    def _open(self) -> None:
        record: dict[str, Any] = {}
        if self.folder.exists() and any(self.folder.iterdir()):
            record = read_json(self.folder / self.kind.record)
            if not self.kind.is_record(record):
                raise OutputError(f"{self.folder}: exists and is not a {self.kind.noun} folder; choose another with -o")
            self._refuse_strangers()
            if self.kind.fixed(record) != self.fixed:
                self._begin_anew(record)
        (self.folder / CHUNKS).mkdir(parents=True, exist_ok=True)
        for left in (self.folder / CHUNKS).iterdir():
            if FRESH.fullmatch(left.name) and is_regular(left):
                left.unlink()
        if self.kind.fixed(record) != self.fixed:
            self._record()

    def _refuse_strangers(self) -> None:
        """Nothing with the name of a file of ours may be a link, a folder or a device."""
        chunks = self.folder / CHUNKS
        if chunks.is_symlink() or (chunks.exists() and not chunks.is_dir()):
            raise OutputError(f"{chunks}: is no folder of its own; take it away, or choose another folder with -o")
        for name, path in files_in(self.folder):
            if self.kind.writes(name) or name == self.kind.record:
                require_place(path)

    def _begin_anew(self, record: Mapping[str, Any]) -> None:
        """Remove what another one wrote, if it is to be replaced: whole chunks and what is listed, nothing else."""
        if not self.overwrite:
            raise OutputError(
                f"{self.folder}: holds {self.kind.unit} of another mission, seed, mode or program version; "
                "use --overwrite to begin anew, or -o for another folder"
            )
        ours = [name for name, _ in files_in(self.folder) if self.kind.writes(name)]
        said = [name for name in ours if not self._wrote(name, record)]
        if said:
            raise OutputError(
                f"{self.folder}: {listed(said)}: not as this program wrote it; nothing was changed; move it away, or "
                "choose another folder with -o"
            )
        for name in ours:
            (self.folder / name).unlink()

    def _wrote(self, name: str, record: Mapping[str, Any]) -> bool:
        """Whether a file is one of this program: by its hash, or where it is not listed (yet), by what is in it."""
        path, hashes = self.folder / name, hashes_listed(record)
        if name in hashes:
            return sha256_of(path) == hashes[name]
        if path.suffix == ".npz":
            return read_chunk(self.folder, int(path.stem), self.kind.fixed(record)) is not None
        return self.recognised(path)

    def recognised(self, path: Path) -> bool:
        """Whether a file that no record lists is one of this kind's results, by what is in it."""
        return False


def hashes_listed(record: Mapping[str, Any]) -> dict[str, str]:
    """The list of a record; empty where the work has not come to its end."""
    found = record.get("outputs_sha256")
    return {str(name): str(value) for name, value in found.items()} if isinstance(found, dict) else {}
