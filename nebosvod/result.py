"""What a run leaves behind: `Result` in memory, the run folder on disk, one becoming the other whole or not at all.

A run folder is written beside its place under a hidden name and renamed when complete, under a lock that the
operating system drops if the process dies: a killed run leaves the last whole result untouched.
"""

import errno
import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO, StringIO
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError, OutputError
from nebosvod.recognise import not_a_run

FAILED_STATUSES = ("iteration_limit", "not_observable", "diverged")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Table:
    """One table of a run: columns of equal length, a unit and a description for each."""

    columns: Mapping[str, npt.NDArray[Any]]
    units: Mapping[str, str]
    description: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """Everything a run found: the summary, the arrays behind it, tables, further files, and where it all came from."""

    summary: Mapping[str, Any]
    manifest: Mapping[str, Any]
    arrays: Mapping[str, npt.NDArray[Any]]
    tables: Mapping[str, Table]
    files: Mapping[str, bytes] = field(default_factory=dict)

    @property
    def failed(self) -> bool:
        """True if any estimator did not converge or could not observe the state."""
        return any(row["status"] in FAILED_STATUSES for row in self.summary["estimators"])

    def summary_text(self) -> str:
        """summary.json as text: sorted as built, no NaN, newline at the end."""
        return json_text(self.summary)

    @classmethod
    def load(cls, folder: str | Path) -> "Result":
        """Read a run folder back (tables as ECSV).

        Raises
        ------
        InputError
            If `folder` is not a run folder; names what is missing.
        """
        from astropy.table import Table as AstropyTable

        path = Path(folder)
        require_run_folder(path)
        with np.load(path / "arrays.npz", allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        tables = {}
        for file in sorted((path / "tables").glob("*.ecsv")):
            read = AstropyTable.read(file, format="ascii.ecsv")
            tables[file.stem] = Table(
                columns={name: np.asarray(read[name]) for name in read.colnames},
                units={name: str(read[name].unit or "") for name in read.colnames},
                description=str(read.meta.get("description", "")),
            )
        summary, manifest = (json.loads((path / name).read_text("utf-8")) for name in ("summary.json", "manifest.json"))
        return cls(summary=summary, manifest=manifest, arrays=arrays, tables=tables)


def json_text(value: Mapping[str, Any]) -> str:
    """Deterministic JSON text; a NaN or infinity in it is an error of the program, never written."""
    return json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def default_folder(mission_slug: str) -> Path:
    """`./<mission name>-run`."""
    return Path(f"{mission_slug}-run")


def require_run_folder(path: Path) -> None:
    """Raise InputError unless `path` holds a whole run; says what it holds instead, and what that is for."""
    why = not_a_run(path)
    if why:
        raise InputError(f"{path}: {why}")


def sha256_of(path: Path) -> str:
    """Hex digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_new_text(path: Path, text: str) -> None:
    """Create `path` with `text`; an existing file is never touched."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise OutputError(f"{path}: exists already; choose another name") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot write: {error.strerror}") from error


class RunFolder:
    """Owner of one run folder while a run is made: takes the lock, publishes whole results.

    Parameters
    ----------
    folder : where the run shall stand.
    overwrite : replace an earlier *run* there; anything else in the way is refused.

    Raises
    ------
    OutputError
        When another run holds the folder, it exists, or the place cannot be written.
    """

    def __init__(self, folder: Path, *, overwrite: bool = False) -> None:
        absolute = Path(os.path.abspath(folder))
        self.folder, self.shown, self._overwrite = absolute, folder, overwrite
        self._lock = absolute.with_name(f".{absolute.name}.lock")
        self._partial = absolute.with_name(f".{absolute.name}.partial")
        self._old = absolute.with_name(f".{absolute.name}.old")
        self._handle: IO[str] | None = None

    def __enter__(self) -> "RunFolder":
        try:
            self.folder.parent.mkdir(parents=True, exist_ok=True)
            self._take_lock()
            self._recover()
            self._refuse_what_is_in_the_way()
            self._partial.mkdir()
        except OSError as error:
            self._release()
            raise OutputError(
                f"{self.shown}: cannot write here: {error.strerror}; choose another folder with -o"
            ) from None
        except OutputError:
            self._release()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        shutil.rmtree(self._partial, ignore_errors=True)
        self._release()

    def publish(self, result: Result) -> None:
        """Write `result` and its report, then put the folder in place in one step."""
        try:
            write_files(self._partial, result)
            if self.folder.exists():
                self.folder.rename(self._old)
            self._partial.rename(self.folder)
        except OSError as error:
            self._recover()
            reason = "the disk is full" if error.errno == errno.ENOSPC else error.strerror
            raise OutputError(f"{self.shown}: cannot write the result: {reason}; nothing was changed") from None
        shutil.rmtree(self._old, ignore_errors=True)

    def _take_lock(self) -> None:
        """Lock against a second run in the same folder; the lock dies with the process."""
        self._handle = self._lock.open("w", encoding="ascii")
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._handle.close()
            self._handle = None
            raise OutputError(
                f"{self.shown}: another run is writing here; wait for it or choose another folder"
            ) from None

    def _recover(self) -> None:
        """Bring back the last whole result and clear what a killed run left."""
        if self._old.exists() and not self.folder.exists():
            self._old.rename(self.folder)
        shutil.rmtree(self._old, ignore_errors=True)
        shutil.rmtree(self._partial, ignore_errors=True)

    def _refuse_what_is_in_the_way(self) -> None:
        if not self.folder.exists():
            return
        if not self._overwrite:
            raise OutputError(
                f"{self.shown}: exists already; use --overwrite to replace that run, or -o for another folder"
            )
        if self.folder.is_symlink() or not (self.folder / "manifest.json").is_file():
            raise OutputError(f"{self.shown}: exists and is not a run folder; --overwrite replaces runs only")

    def _release(self) -> None:
        if self._handle is not None:
            self._lock.unlink(missing_ok=True)
            self._handle.close()
            self._handle = None


def write_files(folder: Path, result: Result) -> None:
    """Write every file of a run into `folder`: the report from the files, the manifest last, with their hashes."""
    (folder / "tables").mkdir()
    for name, table in result.tables.items():
        (folder / "tables" / f"{name}.ecsv").write_text(ecsv_text(table), "utf-8")
    (folder / "summary.json").write_text(result.summary_text(), "utf-8")
    (folder / "arrays.npz").write_bytes(npz_bytes(result.arrays))
    for name, content in result.files.items():
        (folder / name).write_bytes(content)
    (folder / "manifest.json").write_text(json_text(result.manifest), "utf-8")
    (folder / "report.html").write_text(report_text(folder), "utf-8")
    _write_manifest(folder, result.manifest)


def report_text(folder: Path) -> str:
    """The report of a run folder, by what kind of run it is."""
    if json.loads((folder / "summary.json").read_text("utf-8")).get("kind") == "fit":
        from nebosvod.report.fit_page import make_fit_report

        return make_fit_report(folder)
    from nebosvod.report.page import make_report

    return make_report(folder)


def rewrite_report(folder: Path, *, pdf: bool = False) -> Path:
    """Make report.html (and report.pdf) anew from the files of a run; returns the path of the page."""
    require_run_folder(folder)
    fresh = folder / ".report.html.partial"
    try:
        fresh.write_text(report_text(folder), "utf-8")
        fresh.replace(folder / "report.html")
        if pdf:
            from nebosvod.report.pdf import print_pdf

            print_pdf(folder / "report.html", folder / "report.pdf")
        _write_manifest(folder, json.loads((folder / "manifest.json").read_text("utf-8")))
    except OSError as error:
        fresh.unlink(missing_ok=True)
        raise OutputError(f"{folder}: cannot write the report: {error.strerror}") from None
    return folder / "report.html"


def _write_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Write manifest.json with the sha256 of every other file of the run."""
    outputs = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "manifest.json")
    hashes = {path.relative_to(folder).as_posix(): sha256_of(path) for path in outputs}
    fresh = folder / ".manifest.json.partial"
    fresh.write_text(json_text({**manifest, "outputs_sha256": hashes}), "utf-8")
    fresh.replace(folder / "manifest.json")


def npz_bytes(arrays: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """An .npz file with the same bytes for the same arrays (numpy stamps no time into it)."""
    buffer = BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **dict(arrays))
    return buffer.getvalue()


def ecsv_text(table: Table) -> str:
    """A table as ECSV text with units."""
    from astropy.table import Table as AstropyTable

    made = AstropyTable(dict(table.columns), meta={"description": table.description})
    for name, unit in table.units.items():
        made[name].unit = unit or None
    buffer = StringIO()
    made.write(buffer, format="ascii.ecsv")
    return buffer.getvalue()
