"""ADES records as XML, read by expat as a stream; a DOCTYPE ends the reading before anything in it is expanded."""

from typing import NoReturn
from xml.parsers import expat

import numpy as np

from nebosvod.observation.formats.ades_cells import Cells
from nebosvod.observation.formats.ades_names import NAMES, RECORDS, VERSIONS, about_version, suggestion
from nebosvod.observation.formats.ades_psv import missing
from nebosvod.observation.formats.header_stations import unlike
from nebosvod.observation.formats.source_file import SourceFile, printable

MAX_DEPTH = 32
LONGEST_TEXT = 2000


class _Reader:
    """Handlers of the parser: gathers the children of each record."""

    def __init__(self, source: SourceFile) -> None:
        self.source = source
        self.parser = expat.ParserCreate(encoding="UTF-8")
        self.parser.buffer_text = True
        self.parser.StartDoctypeDeclHandler = self.doctype
        self.parser.EntityDeclHandler = self.doctype
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.CharacterDataHandler = self.characters
        self.depth = 0
        self.inside = 0  # depth of the record that is open, 0 if none
        self.field = ""
        self.text: list[str] = []
        self.length = 0
        self.record: dict[str, str] = {}
        self.records: list[dict[str, str]] = []
        self.line: list[int] = []
        self.version = self.station = ""  # as the header says
        self.header_station: list[str] = []

    @property
    def here(self) -> int:
        return int(self.parser.CurrentLineNumber)

    def doctype(self, *_: object) -> NoReturn:
        raise self.source.error(
            self.here, "a DOCTYPE or entity declaration is not allowed in ADES; delete it (nothing of it was expanded)"
        )

    def start(self, name: str, attributes: dict[str, str]) -> None:
        self.depth += 1
        if self.depth == 1:
            self.root(name, attributes)
        elif self.depth > MAX_DEPTH:
            raise self.source.error(self.here, f"nested deeper than {MAX_DEPTH}")
        elif self.inside and self.depth == self.inside + 1:
            self.child(name)
        elif not self.inside and name in RECORDS:
            self.inside, self.record = self.depth, {}
            self.line.append(self.here)
            self.header_station.append(self.station)
        elif name == "mpcCode":
            self.field, self.text, self.length = name, [], 0
        elif name in ("obsBlock", "observatory"):
            self.station = ""

    def root(self, name: str, attributes: dict[str, str]) -> None:
        if name != "ades":
            raise self.source.error(self.here, f'the root element is "{printable(name, 60)}"; allowed: ades')
        version = self.version = attributes.get("version", "")
        if version not in VERSIONS:
            told = printable(version, 20)
            raise self.source.error(self.here, f'version "{told}" of ADES; allowed: {" and ".join(VERSIONS)}')

    def child(self, name: str) -> None:
        if name not in NAMES:
            self.source.problem(self.here, f'element "{printable(name, 60)}" is no ADES name; {suggestion(name)}')
        elif name in self.record:
            self.source.problem(self.here, f'element "{name}" occurs twice in one record')
        self.field, self.text, self.length = name, [], 0

    def characters(self, text: str) -> None:
        in_header = not self.inside and self.field == "mpcCode"
        if in_header or (self.inside and self.depth == self.inside + 1):
            self.length += len(text)
            if self.length > LONGEST_TEXT:
                raise self.source.error(self.here, f'element "{printable(self.field, 60)}" is longer than any value')
            self.text.append(text)

    def end(self, name: str) -> None:
        if self.inside and self.depth == self.inside + 1:
            if name in NAMES:
                self.record[name] = "".join(self.text).strip()
        elif self.depth == self.inside:
            self.close_record(name)
            self.inside = 0
        elif not self.inside and name == self.field == "mpcCode":
            self.station, self.field = "".join(self.text).strip(), ""
        self.depth -= 1

    def close_record(self, name: str) -> None:
        filled = {key for key, value in self.record.items() if value}
        # the elements tell the kind of record as the columns of a table do
        if name not in ("radar", "offset"):
            for lacking in missing(filled):
                self.source.problem(self.line[-1], lacking.replace("column", "element"))
        else:
            self.record["trx" if name == "radar" else "obsCenter"] = name
        self.records.append(self.record)


def xml_cells(source: SourceFile) -> Cells:
    """The records of an ADES XML file as columns of text.

    Raises
    ------
    InputError
        With file and line: not well formed, DOCTYPE or entities, another version, unknown, repeated or missing
        elements.
    """
    reader = _Reader(source)
    try:
        reader.parser.Parse(source.data, True)
    except expat.ExpatError as error:
        raise source.error(error.lineno, f"not well-formed XML: {expat.ErrorString(error.code)}") from None
    source.refuse_problems()
    if not reader.records:
        raise source.error(1, "no observations in this file")
    names = sorted({name for record in reader.records for name in record})
    stations = [record.get("stn", "") for record in reader.records]
    return Cells(
        source=source,
        line=np.array(reader.line, dtype=np.int64),
        columns={name: [record.get(name, "") for record in reader.records] for name in names},
        notices=(
            *about_version(source.name, reader.version),
            *unlike(source.name, reader.line, reader.header_station, stations),
        ),
    )
