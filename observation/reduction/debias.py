"""Biases of star catalogues: what to take off directions that were measured against an old catalogue.

Eggl, Farnocchia, Chamberlin and Chesley (2020), Icarus 339, 113596: for 26 catalogues and each HEALPix pixel of the sky
(ring order; Gorski et al. 2005, ApJ 622, 759) the catalogue's offset from Gaia DR2 at J2000.0 and the error of its
proper motions. The table, `bias.dat`, is JPL's and is not shipped (40 MB with 49,152 pixels, 700 MB with 786,432):
download debias_2018.tgz or debias_hires2018.tgz from ssd.jpl.nasa.gov/ftp/ssd/debias and name the file. Of the file
only the rows that are needed are read.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from nebosvod.dynamics.constants import J2000_JD
from nebosvod.errors import DataError, InputError, counted
from nebosvod.observation.contracts import Array, Rows
from nebosvod.observation.formats.records import Astrometry
from nebosvod.units import ARCSEC

# The catalogues of the table in its order. Its last one is UCAC5, which it calls "W"; the MPC has since given W to Gaia
# DR3 and Y to UCAC5.
CATALOGUES = (
    "USNOA1", "USNOSA1", "USNOA2", "USNOSA2", "UCAC1", "Tyc2", "GSC1.1", "GSC1.2", "ACT", "GSCACT", "SDSS8", "USNOB1",
    "PPM", "UCAC4", "UCAC2", "PPMXL", "UCAC3", "NOMAD", "CMC14", "2MASS", "SDSS7", "CMC15", "SSTRC4", "URAT1", "Gaia1",
    "UCAC5",
)  # fmt: skip
UNBIASED = frozenset(("Gaia2", "Gaia3", "Gaia3E", "Gaia_Int", "Gaia_2016", "ATLAS2", "PS1_DR2", "UBSC"))
COLUMNS = 4 * len(CATALOGUES)  # of each: RA cos Dec (arcsec), Dec (arcsec), their proper motions (mas/yr)
COMMENT = b"!"
LARGEST_ARCSEC, LARGEST_MAS_YR = 60.0, 10000.0
CHUNK_BYTES = 1 << 24
DAYS_A_YEAR = 365.25


def debias(astrometry: Astrometry, table_path: str | Path | None = None) -> tuple[Array, tuple[str, ...]]:
    """Catalogue biases (n, 2) in RA cos Dec and Dec, rad, to SUBTRACT from the observed directions, and notices.

    Parameters
    ----------
    astrometry : where its records state a bias, that is what to take off.
    table_path : `bias.dat` of Eggl et al. (2020), of any number of pixels; None = no correction, and a notice.

    Raises
    ------
    DataError
        If the table cannot be opened.
    InputError
        If it is not of the published form, naming the line.

    References
    ----------
    Eggl, Farnocchia, Chamberlin, Chesley 2020, Icarus 339, 113596.
    """
    correction = np.zeros((len(astrometry), 2))
    stated = np.isfinite(astrometry.bias_rad).all(axis=1)
    correction[stated] = astrometry.bias_rad[stated]
    which = np.full(len(astrometry), -1)
    for number, name in enumerate(CATALOGUES):
        which[astrometry.catalogue == name] = number
    which[stated] = -1  # their file says what to take off
    biased = np.flatnonzero(which >= 0)
    if table_path is None:
        return correction, (*_untouched(biased.size), *_unknown(astrometry, which))
    path = Path(table_path)
    with contextlib.ExitStack() as stack:
        try:
            file = stack.enter_context(path.open("rb"))
            nside = _nside(file, path)
            values = _rows(file, path, ring_pixel(nside, astrometry.psi[biased]), which[biased])
        except OSError as error:
            raise DataError(f"{path}: the table of catalogue biases cannot be read ({error.strerror})") from None
    years = ((astrometry.epoch.day - J2000_JD) + astrometry.epoch.fraction + astrometry.t_s[biased] / 86400.0) / (
        DAYS_A_YEAR
    )
    correction[biased] = (values[:, :2] + 1e-3 * years[:, None] * values[:, 2:]) * ARCSEC
    taken = counted(biased.size, "observation")
    told = f"catalogue biases (Eggl et al. 2020, {nside} pixels a side) taken off {taken}"
    return correction, (told, *_unknown(astrometry, which))


def ring_pixel(nside: int, psi: Array) -> Rows:
    """Numbers (n,) of the HEALPix pixels, ring order, that contain directions psi (n, 2), RA and Dec in rad.

    Notes
    -----
    Between |sin Dec| = 2/3 the pixel's rising and falling edges are straight in
    (RA, sin Dec); in the caps they are so in RA (from the corner of the quarter) times sqrt(3 (1 - |sin Dec|)).

    References
    ----------
    Gorski et al. 2005, ApJ 622, 759, section 4.
    """
    z = np.sin(psi[:, 1])
    quarter = np.mod(psi[:, 0] / (0.5 * np.pi), 4.0)
    rising = np.floor(nside * (0.5 + quarter - 0.75 * z)).astype(np.int64)
    falling = np.floor(nside * (0.5 + quarter + 0.75 * z)).astype(np.int64)
    ring = nside + 1 + rising - falling  # 1 to 2 nside + 1, from the northern edge of the belt
    odd = 1 - (ring & 1)
    place = np.mod((rising + falling - nside + odd + 1) // 2, 4 * nside)
    belt = 2 * nside * (nside - 1) + (ring - 1) * 4 * nside + place
    inside = quarter - np.floor(quarter)
    reach = nside * np.sqrt(3.0 * np.maximum(0.0, 1.0 - np.abs(z)))
    before = np.floor(inside * reach).astype(np.int64)
    after = np.floor((1.0 - inside) * reach).astype(np.int64)
    cap_ring = before + after + 1  # from the nearer pole
    cap_place = np.mod(np.floor(quarter * cap_ring).astype(np.int64), 4 * cap_ring)
    north = 2 * cap_ring * (cap_ring - 1) + cap_place
    south = 12 * nside**2 - 2 * cap_ring * (cap_ring + 1) + cap_place
    pixel: Rows = np.where(np.abs(z) <= 2.0 / 3.0, belt, np.where(z > 0.0, north, south))
    return pixel


def _untouched(biased: int) -> tuple[str, ...]:
    """The sentence about a missing table; none if nothing would change."""
    if not biased:
        return ()
    were = "was" if biased == 1 else "were"
    return (
        f"{counted(biased, 'observation')} {were} measured against star catalogues with known biases (up to 1 arcsec), "
        "which are not taken off: give the table of Eggl et al. (2020), bias.dat of ssd.jpl.nasa.gov/ftp/ssd/debias",
    )


def _unknown(astrometry: Astrometry, which: Rows) -> tuple[str, ...]:
    """Sentences about observations that name no star catalogue, and those whose catalogue has no known biases."""
    stated = np.isfinite(astrometry.bias_rad).all(axis=1)
    told, other = [], astrometry.catalogue[(which < 0) & ~stated & ~np.isin(astrometry.catalogue, list(UNBIASED))]
    nameless, names = int(np.sum(other == "")), sorted(set(other.tolist()) - {""})
    if nameless:
        naming = "names" if nameless == 1 else "name"
        told.append(f"{counted(nameless, 'observation')} {naming} no star catalogue: its biases are left in them")
    if names:
        listing = ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
        number = counted(other.size - nameless, "observation")
        told.append(f"{number} by star catalogues whose biases are not known ({listing}): left as they are")
    return tuple(told)


def _nside(file: BinaryIO, path: Path) -> int:
    """Pixels along the side of a base pixel, from the number of rows.

    Raises
    ------
    InputError
        If no tessellation has so many pixels.
    """
    rows = 0
    for chunk in iter(lambda: file.read(CHUNK_BYTES), b""):
        rows += chunk.count(b"\n")
    file.seek(0)
    comments = sum(1 for _ in _head(file))
    rows -= comments
    nside = round(np.sqrt(max(rows, 0) / 12.0))
    if nside < 1 or 12 * nside**2 != rows:
        raise InputError(
            f"{path}: {rows} rows of data, which is no number of HEALPix pixels (12 n^2: 49152, 786432); is it the "
            "whole bias.dat of Eggl et al. (2020)?"
        )
    return int(nside)


def _head(file: BinaryIO) -> Iterator[bytes]:
    """Comments before the first row; leaves the file at the beginning of that row."""
    while True:
        at = file.tell()
        line = file.readline()
        if not line.startswith(COMMENT):
            file.seek(at)
            return
        yield line


def _rows(file: BinaryIO, path: Path, pixel: Rows, which: Rows) -> Array:
    """The four numbers (m, 4) of each wanted pixel and catalogue."""
    file.seek(0)
    line_number = sum(1 for _ in _head(file)) + 1
    order = np.argsort(pixel, kind="stable")
    values = np.empty((pixel.size, 4))
    at, row = -1, np.empty(0)
    for k in order.tolist():
        while at < pixel[k]:
            text = file.readline()
            at += 1
            if at == pixel[k]:
                row = _numbers(text, f"{path}:{line_number + at}")
        values[k] = row[4 * which[k] : 4 * which[k] + 4]
    return values


def _numbers(text: bytes, where: str) -> Array:
    """The numbers of one row.

    Raises
    ------
    InputError
        If there are not as many as the published table has, or one is no offset.
    """
    words = text.split()
    if len(words) != COLUMNS:
        raise InputError(
            f"{where}: {len(words)} columns instead of {COLUMNS} ({len(CATALOGUES)} catalogues with four numbers); "
            "only the table of Eggl et al. (2020) is read"
        )
    try:
        row = np.array([float(word) for word in words])
    except ValueError:
        raise InputError(f"{where}: a column is not a number") from None
    limits = np.tile([LARGEST_ARCSEC, LARGEST_ARCSEC, LARGEST_MAS_YR, LARGEST_MAS_YR], len(CATALOGUES))
    if not np.all(np.abs(row) <= limits):
        raise InputError(
            f"{where}: column {int(np.argmax(~(np.abs(row) <= limits))) + 1} is {row[~(np.abs(row) <= limits)][0]} "
            f"(allowed: {LARGEST_ARCSEC:.0f} arcsec, {LARGEST_MAS_YR:.0f} mas/yr)"
        )
    return row
