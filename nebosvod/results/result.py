"""What a run leaves behind: `Result` in memory, the run folder on disk, one becoming the other whole or not at all.

A run folder is written beside its place under a hidden name and exchanged with the earlier one when complete
(publication.py), under a lock that the operating system drops if the process dies (lock.py); what is replaced is what
the program wrote (ownership.py).
"""

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from io import BytesIO, StringIO
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.borders.stored import held_together, read_arrays, read_object
from nebosvod.borders.wholefile import reason, refuse_link, require_place, write_whole
from nebosvod.errors import InputError, OutputError, listed
from nebosvod.results.lock import Lock
from nebosvod.results.outlook import without_answer
from nebosvod.results.ownership import OURS, RECORD, Ownership, changed_said, hashes_of, marked, ownership, sha256_of
from nebosvod.results.publication import discard, new_stage, publish, recover
from nebosvod.results.recognise import not_a_run, read_json

Page = Callable[[Path], str]  # the text of report.html, from the folder of a run
Printer = Callable[[Path, Path], None]  # a page to a PDF
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
        """True if any estimator did not converge or could not observe the state, or something asked has no answer."""
        if "estimators" not in self.summary:  # of an orbit that is given
            return bool(self.summary["ended"])
        return any(row["status"] in FAILED_STATUSES for row in self.summary["estimators"]) or bool(
            without_answer([*self.summary["predictions"], *self.summary.get("further", ())])
        )

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
        arrays = read_arrays(path / "arrays.npz")
        tables = {}
        for file in sorted((path / "tables").glob("*.ecsv")):
            read = AstropyTable.read(file, format="ascii.ecsv")
            tables[file.stem] = Table(
                columns={name: np.asarray(read[name]) for name in read.colnames},
                units={name: str(read[name].unit or "") for name in read.colnames},
                description=str(read.meta.get("description", "")),
            )
        summary, manifest = (read_object(path / name) for name in ("summary.json", "manifest.json"))
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


class OwnedFolder:
    """Owner of one run folder while a run is made: takes the lock, publishes whole results.

    Parameters
    ----------
    folder : where the run shall stand.
    page : makes the report of what is published.
    overwrite : replace an earlier *run* there, by its list of files; anything else in the way is refused or stays.

    Raises
    ------
    OutputError
        When another run holds the folder, it exists, it is a symbolic link, or the place cannot be written.
    """

    def __init__(self, folder: Path, page: Page, *, overwrite: bool = False) -> None:
        self.folder, self.shown, self._overwrite = Path(os.path.abspath(folder)), folder, overwrite
        self._page = page
        self._lock = Lock(self.folder, folder, "another run")

    def __enter__(self) -> "OwnedFolder":
        try:
            if self.folder.is_symlink():
                refuse_link(self.shown, self.folder.lstat().st_mode)
            self.folder.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._unwritable(error) from None
        with ExitStack() as held:
            held.enter_context(self._lock)
            try:
                recover(self.folder)
                if os.path.lexists(self.folder):
                    self._refuse_what_is_in_the_way()
            except OSError as error:
                raise self._unwritable(error) from None
            held.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.__exit__(kind, error, trace)

    def publish(self, result: Result) -> None:
        """Write `result` and its report to a folder beside, then put it in place in one step."""
        stage = None
        try:
            stage = new_stage(self.folder)
            write_files(stage, result, self._page)
            if os.path.lexists(self.folder):  # it may have changed while the run was made
                self._refuse_what_is_in_the_way()
            publish(stage, self.folder)
        except OSError as error:
            raise OutputError(f"{self.shown}: cannot write the result: {reason(error)}; nothing was changed") from None
        finally:
            if stage is not None:
                discard(stage, self.folder)

    def _refuse_what_is_in_the_way(self) -> None:
        refuse_link(self.shown, self.folder.lstat().st_mode)
        owned = ownership(self.folder) if self.folder.is_dir() else None
        if owned is None:
            raise OutputError(
                f"{self.shown}: exists already and is not a run folder of this program, which alone is replaced; "
                "use -o for another folder"
            )
        if not self._overwrite:
            raise OutputError(
                f"{self.shown}: exists already; use --overwrite to replace that run, or -o for another folder"
            )
        if not os.access(self.folder, os.W_OK | os.X_OK):
            raise OutputError(f"{self.shown}: cannot write here: it is read-only; choose another folder with -o")
        refuse_foreign(self.shown, owned)

    def _unwritable(self, error: OSError) -> OutputError:
        return OutputError(f"{self.shown}: cannot write here: {reason(error)}; choose another folder with -o")


def refuse_foreign(shown: Path, owned: Ownership) -> None:
    """Raise OutputError if replacing a run would lose what somebody else wrote: a changed file, a name of ours."""
    taken = [name for name in owned.foreign if _taken(name)]
    said = [f"{name} was changed after it was written" for name in owned.changed]
    said += [f"{name} was not written by this program" for name in taken]
    if said:
        raise OutputError(f"{shown}: {listed(said)}; nothing was changed; move it away, or choose another folder")


def _taken(name: str) -> bool:
    """Whether a result may have a file of this name, or one where this needs a folder; a PDF only comes on request."""
    parts = Path(name).parts
    paths = ("/".join(parts[: count + 1]) for count in range(len(parts)))
    return (name != "report.pdf" and any(OURS.fullmatch(path) for path in paths)) or name == "tables"


def write_files(folder: Path, result: Result, page: Page) -> None:
    """Write every file of a run into an empty folder: their list first, the report from the files, the list again."""
    files = {f"tables/{name}.ecsv": ecsv_text(table).encode("utf-8") for name, table in result.tables.items()}
    files |= {"summary.json": result.summary_text().encode("utf-8"), "arrays.npz": npz_bytes(result.arrays)}
    files |= result.files
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    _write_manifest(folder, result.manifest, hashes)
    (folder / "tables").mkdir()
    for name, data in files.items():
        (folder / name).write_bytes(data)
    report = page(folder).encode("utf-8")
    (folder / "report.html").write_bytes(report)
    _write_manifest(folder, result.manifest, {**hashes, "report.html": hashlib.sha256(report).hexdigest()})


def rewrite_report(
    folder: Path, page: Page, *, printer: Printer | None = None, say: Callable[[str], None] = lambda message: None
) -> Path:
    """Make report.html (and with a printer report.pdf) anew from the files of a run; returns the path of the page.

    Parameters
    ----------
    page : the text of report.html from the folder.
    printer : makes report.pdf from report.html.
    say : called with a sentence for each file that was changed since it was written.

    Raises
    ------
    InputError
        If a file of the run is cut or changed so that it cannot be used; names file and key.
    OutputError
        If a page that the program did not write is in the way, or the place cannot be written.
    """
    from nebosvod.results.folder import require_sound_summary

    require_run_folder(folder)
    if not isinstance(read_object(folder / RECORD).get("outputs_sha256"), dict):
        raise InputError(f"{folder / RECORD}: outputs_sha256: the file lacks its list of files; make the run again")
    place = Path(os.path.realpath(folder))
    with Lock(place, folder, "another run"):
        owned = ownership(place)
        pages = ["report.html", *(["report.pdf"] if printer else [])]
        for name in pages:
            require_place(place / name)
            if os.path.lexists(place / name) and (owned is None or name not in owned.listed):
                raise OutputError(f"{folder / name}: was not written by this program; move it away")
        require_place(place / RECORD)
        for sentence in changed_said(folder):
            say(sentence)
        require_sound_summary(folder)
        with held_together(str(folder)):
            text = page(folder).encode("utf-8")
        write_whole(place / "report.html", text)
        if printer:
            printer(place / "report.html", place / "report.pdf")
        record = read_json(place / RECORD)
        if owned is not None:
            made = {name: sha256_of(place / name) for name in pages}
            _write_manifest(place, record, {**(hashes_of(record) or {}), **made}, changed=RECORD in owned.changed)
    return folder / "report.html"


def _write_manifest(
    folder: Path, manifest: Mapping[str, Any], hashes: Mapping[str, str], *, changed: bool = False
) -> None:
    """Write manifest.json with the list of the other files; a mark that a change broke stays broken."""
    record = {**manifest, "outputs_sha256": dict(sorted(hashes.items()))}
    record = record if changed else marked(record)
    write_whole(folder / RECORD, json_text(record).encode("utf-8"))


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
