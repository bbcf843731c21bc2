"""The table of a study that was run, read back."""

import json
from pathlib import Path
from typing import Any

from nebosvod.errors import DataError, InputError

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
