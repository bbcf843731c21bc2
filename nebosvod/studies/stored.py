"""The table of a study that was run, read back."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from nebosvod.borders.shape import require_shape, schema_file
from nebosvod.borders.stored import read_object, require_version
from nebosvod.borders.wholefile import require_place, write_whole
from nebosvod.errors import DataError, InputError, OutputError
from nebosvod.results.lock import Lock
from nebosvod.results.ownership import marked, sha256_of
from nebosvod.results.recognise import read_json

RECORD, RESULT, PAGE = "record.json", "study.json", "study.html"
SCHEMA = Path(__file__).with_name("study.schema.json")
PARQUET_ROWS = 100_000  # from here on ECSV takes minutes


def require_parquet(rows: int) -> None:
    """Refuse so many rows where Parquet cannot be written."""
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        raise DataError(
            f"{rows:,} rows are written as Parquet, which needs pyarrow: pip install 'nebosvod[parquet]'; "
            f"ECSV is for less than {PARQUET_ROWS:,}"
        ) from None


def load_table(folder: str | Path) -> Any:
    """The table of a study as an astropy Table with units; the text of the study in `meta`.

    Raises
    ------
    InputError
        If the folder holds no table of a study.
    """
    from astropy.table import Table as AstropyTable

    path = Path(folder)
    if (path / "results.ecsv").is_file():
        return AstropyTable.read(path / "results.ecsv", format="ascii.ecsv", fill_values=None)
    if not (path / "results.parquet").is_file():
        raise InputError(f"{path}: holds no results.ecsv or results.parquet; make them with: nebosvod study STUDY.yaml")
    require_parquet(PARQUET_ROWS)
    from pyarrow import parquet

    read = parquet.read_table(path / "results.parquet")
    said = {key.decode(): value.decode() for key, value in (read.schema.metadata or {}).items()}
    table = AstropyTable({name: read[name].to_numpy() for name in read.column_names})
    for name, unit in json.loads(said.get("units", "{}")).items():
        table[name].unit = unit or None
    table.meta["description"] = said.get("description", "")
    return table


def is_study(folder: Path) -> bool:
    """Whether a folder holds a study that came to its end."""
    return read_json(folder / RESULT).get("kind") == "study" and (folder / RECORD).is_file()


def read_study(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """What study.json of a folder holds, and the columns of its table.

    Raises
    ------
    InputError
        If a file is missing, damaged, or does not go with the other; the message names it.
    """
    path = folder / RESULT
    found = read_object(path)
    require_version(path, found, 1)
    require_shape(path, found, schema_file(SCHEMA))
    try:
        table = load_table(folder)
        columns = {name: np.asarray(table[name]) for name in table.colnames}
    except (InputError, DataError):
        raise
    except (ValueError, TypeError, KeyError, OSError, IndexError) as error:
        raise InputError(f"{folder}: its table cannot be read ({str(error)[:200]}); make the study again") from None
    named = [one["name"] for one in (*found["vary"], *(a for a in found["answers"] if not a["shares"]))]
    missing = [name for name in ("point", "status", *named) if name not in columns]
    if missing or len(columns["point"]) != found["n_rows"]:
        raise InputError(f"{folder}: its table is not that of its {RESULT}; make the study again")
    return found, columns


def rewrite_page(
    folder: Path, page: Callable[[Mapping[str, Any], Mapping[str, Any]], str], say: Callable[[str], None]
) -> Path:
    """Make study.html anew from the files of a study; returns its path.

    Raises
    ------
    InputError
        If a file of the study cannot be used.
    OutputError
        If a page that the program did not write is in the way, or the place cannot be written.
    """
    place = Path(folder).resolve()
    with Lock(place, folder, "another study"):
        record = read_json(place / RECORD)
        hashes = record.get("outputs_sha256")
        hashes = dict(hashes) if isinstance(hashes, dict) else {}
        require_place(place / PAGE)
        if (place / PAGE).exists() and PAGE not in hashes:
            raise OutputError(f"{folder / PAGE}: was not written by this program; move it away")
        for name, written in hashes.items():
            path = place / str(name)
            if name != PAGE and path.is_file() and sha256_of(path) != written:
                say(f"{folder / str(name)}: changed since the program wrote it (another sha256)")
        found, columns = read_study(folder)
        write_whole(place / PAGE, page(found, columns).encode("utf-8"))
        hashes[PAGE] = sha256_of(place / PAGE)
        rest = {key: value for key, value in record.items() if key not in ("nebosvod_folder", "outputs_sha256")}
        content = marked({**rest, "outputs_sha256": dict(sorted(hashes.items()))})
        write_whole(place / RECORD, (json.dumps(content, indent=1) + "\n").encode("utf-8"))
    return folder / PAGE
