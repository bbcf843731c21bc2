"""ADES records as text with separators: PSV (vertical bars, header blocks) and CSV (commas) with ADES names."""

import csv
import re
from dataclasses import dataclass, field

import numpy as np

from nebosvod.observation.formats.ades_cells import Cells
from nebosvod.observation.formats.ades_names import BY_LOWER_CASE, NAMES, VERSIONS, about_version, suggestion
from nebosvod.observation.formats.header_stations import unlike
from nebosvod.observation.formats.source_file import SourceFile, printable

NAME = re.compile(r"[A-Za-z_]\w*")
HEADER_STATION = re.compile(r"!\s*mpcCode\s+(\w{3,4})", re.ASCII)
VERSION = re.compile(r"#\s*version\s*=\s*(.*?)\s*")


@dataclass(slots=True)
class _Tables:
    """Rows gathered so far, from one or several tables of a file."""

    source: SourceFile
    line: list[int] = field(default_factory=list)
    columns: dict[str, list[str]] = field(default_factory=dict)
    header_station: list[str] = field(default_factory=list)

    def header(self, number: int, cells: list[str]) -> list[str]:
        """The names of a header line, noting what is wrong with them."""
        for place, name in enumerate(cells, start=1):
            if not name:
                self.source.problem(number, f"column {place} has no name; delete it or name it")
            elif name not in NAMES:
                self.source.problem(number, f'column "{printable(name, 60)}" is no ADES name; {suggestion(name)}')
            elif cells.index(name) != place - 1:
                self.source.problem(number, f'column "{name}" occurs twice ({cells.index(name) + 1} and {place})')
        self.source.refuse_problems()
        for lacking in missing(set(cells)):
            self.source.problem(number, lacking)
        self.source.refuse_problems()
        return cells

    def row(self, number: int, names: list[str], cells: list[str], station: str = "") -> None:
        """Take one record, below a header that names an observatory or none."""
        if len(cells) != len(names):
            self.source.problem(
                number,
                f"the row has {len(cells)} cells, its header {len(names)}; is it cut, or is a separator missing or in "
                "excess?",
            )
            return
        n = len(self.line)
        self.line.append(number)
        self.header_station.append(station)
        for name, text in zip(names, cells):
            if name not in self.columns:
                self.columns[name] = [""] * n
            self.columns[name].append(text)
        if len(self.columns) > len(names):
            for texts in self.columns.values():
                if len(texts) == n:
                    texts.append("")

    def cells(self, notices: tuple[str, ...] = ()) -> Cells:
        self.source.refuse_problems()
        if not self.line:
            raise self.source.error(1, "no observations in this file")
        stations = unlike(self.source.name, self.line, self.header_station, self.columns.get("stn", []))
        return Cells(
            source=self.source,
            line=np.array(self.line, dtype=np.int64),
            columns=self.columns,
            notices=(*notices, *stations),
        )


def missing(names: set[str]) -> list[str]:
    """What a set of columns (or of elements) lacks to be observations, one sentence each."""
    lacking = []
    if "obsTime" not in names:
        lacking.append('column "obsTime" is missing')
    if not names & {"permID", "provID", "artSat", "trkSub"}:
        lacking.append('no column tells the object: one of "permID", "provID", "trkSub" is needed')
    if "trx" in names or "obsCenter" in names:
        return lacking
    if "stn" not in names:
        lacking.append('column "stn" (observatory code) is missing')
    star = {"raStar", "decStar"} <= names
    if not star:
        lacking += [f'column "{name}" is missing' for name in ("ra", "dec") if name not in names]
    return lacking


def psv_cells(source: SourceFile) -> Cells:
    """The records of a PSV file as columns of text.

    Raises
    ------
    InputError
        With file and line: unknown version, missing, unknown or repeated columns, rows of another length.
    """
    tables = _Tables(source)
    names: list[str] | None = None
    version = station = ""
    for number, line in enumerate(source.text.split("\n"), start=1):
        text = line.strip()
        if text.startswith("#"):
            names = None
            if text[1:].strip() == "observatory":
                station = ""
            if stated := VERSION.fullmatch(text):
                version = stated[1]
                if version not in VERSIONS:
                    told = printable(version, 20)
                    raise source.error(number, f'version "{told}" of ADES; allowed: {" and ".join(VERSIONS)}')
        elif code := HEADER_STATION.fullmatch(text):
            station = code[1]
        elif text and not text.startswith("!"):
            cells = [cell.strip() for cell in text.split("|")]
            if names is None or ("obsTime" in cells and all(NAME.fullmatch(cell) for cell in cells)):
                names = tables.header(number, cells)
            else:
                tables.row(number, names, cells, station)
    return tables.cells(about_version(source.name, version))


def csv_cells(source: SourceFile) -> Cells:
    """The records of a comma-separated file with ADES names (in any case of letters) as columns of text.

    Raises
    ------
    InputError
        With file and line: missing, unknown or repeated columns, rows of another length, a quote left open.
    """
    tables = _Tables(source)
    names: list[str] | None = None
    reader = csv.reader(source.text.split("\n"), strict=True)
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if not any(cells) or cells[0].startswith("#"):
                continue
            if names is None:
                names = tables.header(reader.line_num, _ades_names(cells))
            else:
                tables.row(reader.line_num, names, cells)
    except csv.Error as error:
        raise source.error(reader.line_num, f"not comma-separated text: {error}") from None
    return tables.cells()


def _ades_names(cells: list[str]) -> list[str]:
    """Names in any case of letters as ADES writes them.

    Some tools keep a number in provID and the provisional designation in actualProvID: these become permID and provID.
    """
    names = [BY_LOWER_CASE.get(cell.lower(), cell) for cell in cells]
    lower = [cell.lower() for cell in cells]
    if "actualprovid" in lower and "provID" in names and "permID" not in names:
        names[names.index("provID")] = "permID"
        names[lower.index("actualprovid")] = "provID"
    return names
