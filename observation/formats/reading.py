"""Files of real astrometry in whatever format: the format is told from the contents, never from the name."""

from pathlib import Path

from nebosvod.observation.formats import mpc80, orbfit_rwo
from nebosvod.observation.formats.ades import to_astrometry
from nebosvod.observation.formats.ades_psv import csv_cells, psv_cells
from nebosvod.observation.formats.ades_xml import xml_cells
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.formats.source_file import SourceFile, read_source


def read_astrometry(path: str | Path) -> Astrometry:
    """Read ADES PSV, ADES XML, comma-separated text with ADES names, MPC 80-column records, or OrbFit .rwo.

    Raises
    ------
    DataError
        If the file cannot be opened.
    InputError
        With file and line, for whatever in it cannot be used; up to twenty problems at once.
    """
    return parse_astrometry(read_source(path))


def parse_astrometry(source: SourceFile) -> Astrometry:
    """The observations in the contents of a file; raises as `read_astrometry`."""
    kind = format_of(source)
    if kind == "mpc80":
        return mpc80.parse(source)
    if kind == "rwo":
        return orbfit_rwo.parse(source)
    cells = {"psv": psv_cells, "csv": csv_cells, "xml": xml_cells}[kind]
    return to_astrometry(cells(source))


def format_of(source: SourceFile) -> str:
    """`xml`, `psv`, `csv`, `rwo` or `mpc80`, by the first lines that are neither blank nor comments."""
    start = source.data[:4096].lstrip()
    if start.startswith(b"<"):
        return "xml"
    if orbfit_rwo.is_rwo(source.data):
        return "rwo"
    if start.startswith((b"# version", b"#version")):
        return "psv"
    for line in source.data[:100_000].split(b"\n"):
        if line.strip() and not line.lstrip().startswith((b"#", b"!")):
            # an 80-column record may hold one bar or comma as a note, a header of ADES holds many
            return "psv" if line.count(b"|") > 2 else "csv" if line.count(b",") > 2 else "mpc80"
    return "mpc80"
