"""Tables of a result as tables of astropy: columns with units, moments as Time."""

import re
import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from astropy import units as u
from astropy.table import Column, MaskedColumn, QTable
from astropy.time import Time

from nebosvod.borders.quantities import ENDINGS
from nebosvod.results.result import Table

MOMENT = re.compile(r"^\d{4}-\d{2}-\d{2}T[\d:.]+( (TDB|UTC))?$")
VECTORS = ("semi_axes", "sigma", "sigma_formal")  # columns of predictions that hold one number for each axis


class Tables(Mapping[str, QTable]):
    """The tables of a result by name, each made when it is asked for."""

    def __init__(self, tables: Mapping[str, Table]) -> None:
        self._tables, self._made = tables, dict[str, QTable]()

    def __getitem__(self, name: str) -> QTable:
        if name not in self._made:
            if name not in self._tables:
                raise KeyError(f"{name} (there are: {', '.join(self._tables) or 'none'})")
            self._made[name] = astropy_table(self._tables[name])
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._tables)

    def __len__(self) -> int:
        return len(self._tables)

    def __repr__(self) -> str:
        return f"<tables: {', '.join(f'{name} ({len(self[name])} rows)' for name in self)}>"

    def _ipython_key_completions_(self) -> list[str]:
        return list(self)


def unit_of(name: str) -> str:
    """The unit a column's name ends with; empty where with none."""
    return next((ENDINGS[end] for end in sorted(ENDINGS, key=len, reverse=True) if name.endswith(f"_{end}")), "")


def astropy_table(table: Table) -> QTable:
    """A table of a result as QTable: the unit of each column, `Time` where it holds moments, its words in `meta`."""
    made = QTable(meta={"description": table.description})
    units = table.columns.get("unit")
    one_unit = _one(units)
    for name, column in table.columns.items():
        unit = table.units.get(name) or unit_of(name)
        if name in VECTORS and units is not None:
            made[name] = _vectors(column, one_unit)
        elif name.startswith("if_") and not unit:
            made[name] = _column(name, np.asarray(column), one_unit)
        else:
            made[name] = _column(name, np.asarray(column), unit)
    return made


def _column(name: str, values: npt.NDArray[Any], unit: str) -> Any:
    """One column."""
    if values.dtype.kind in "UO" and len(values) and all(MOMENT.match(str(value)) for value in values.tolist()):
        return _moments(name, [str(value) for value in values.tolist()])
    if values.dtype.kind == "O":
        values, blank = _plain(values)
        if blank.any():
            return MaskedColumn(values, mask=blank, unit=unit or None)
    if values.dtype.kind in "fiu" and unit:
        return u.Quantity(values, unit)
    return Column(values)


def _plain(values: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_]]:
    """Values that may be missing, as an array of their own kind, and where they are."""
    blank = np.array([value is None for value in values.tolist()])
    held = [value for value in values.tolist() if value is not None]
    none: Any = "" if any(isinstance(value, str) for value in held) else False
    if not held or all(isinstance(value, int | float) and not isinstance(value, bool) for value in held):
        none = np.nan
    return np.array([none if value is None else value for value in values.tolist()]), blank


def _moments(name: str, texts: list[str]) -> Time:
    """Moments, in the scale that stands behind them or that the name ends with."""
    scale = texts[0][-3:].lower() if " " in texts[0] else "utc" if name.endswith("utc") else "tdb"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # erfa calls every UTC date to come dubious
        return Time([text.partition(" ")[0] for text in texts], format="isot", scale=scale)


def _one(units: npt.NDArray[Any] | None) -> str:
    """The unit of all rows; empty where they have several or none."""
    names = set() if units is None else set(units.tolist())
    name = names.pop() if len(names) == 1 else ""
    return ENDINGS.get(name, name)


def _vectors(column: npt.NDArray[Any], unit: str) -> Any:
    """Numbers written one beside the other, as an array (rows, axes), undefined beyond the last axis of a row."""
    rows = [[float(word) for word in str(text).split()] for text in column.tolist()]
    wide = max((len(row) for row in rows), default=0)
    values = np.array([[*row, *[np.nan] * (wide - len(row))] for row in rows]).reshape(len(rows), wide)
    values = values[:, 0] if wide == 1 else values
    return u.Quantity(values, unit) if unit else Column(values)
