"""ADES, the IAU's format of astrometry: PSV and XML (2017 and 2022), and comma-separated files with ADES names.

Reading: text -> `Cells` (columns of text, format checked) -> `Astrometry` (numbers, contents checked).
"""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

import erfa
import numpy as np

from nebosvod.observation.contracts import Array, Texts
from nebosvod.observation.earth import obscodes
from nebosvod.observation.earth.universal_time import FIRST_YEAR, LAST_YEAR, month_days, tdb_times
from nebosvod.observation.formats.ades_cells import Cells
from nebosvod.observation.formats.ades_places import places
from nebosvod.observation.formats.ades_psv import csv_cells, psv_cells
from nebosvod.observation.formats.ades_write import Residuals, write_psv, write_xml
from nebosvod.observation.formats.ades_xml import xml_cells
from nebosvod.observation.formats.designations import (
    NO_SATELLITES,
    OWN_NAME,
    Designation,
    combined,
    from_text,
    is_satellite,
    kind,
)
from nebosvod.observation.formats.object_names import exercises, names_of, other_names
from nebosvod.observation.formats.records import Astrometry, told, without_repeats
from nebosvod.observation.formats.source_file import read_source
from nebosvod.timescale import Epoch
from nebosvod.units import ARCSEC

__all__ = ["Residuals", "read_csv", "read_psv", "read_xml", "to_astrometry", "write_psv", "write_xml"]

TIME = re.compile(r"(\d{4})-(\d{2})-(\d{2})T(\d{2}):(\d{2}):(\d{2})(\.\d{0,12})?Z", re.ASCII)
CATALOGUE = re.compile(r"[.A-Za-z0-9_]{1,8}")
SHORT_NAME = re.compile(r"[A-Za-z0-9_]{1,3}")


def read_psv(path: str | Path) -> Astrometry:
    """Read an ADES PSV file; raises InputError with file and line, DataError if it cannot be opened."""
    return to_astrometry(psv_cells(read_source(path)))


def read_csv(path: str | Path) -> Astrometry:
    """Read a comma-separated file with ADES names; raises as `read_psv`."""
    return to_astrometry(csv_cells(read_source(path)))


def read_xml(path: str | Path) -> Astrometry:
    """Read an ADES XML file; raises as `read_psv`."""
    return to_astrometry(xml_cells(read_source(path)))


def to_astrometry(cells: Cells) -> Astrometry:
    """What the columns mean.

    Raises
    ------
    InputError
        With file, line and name of each cell that cannot be used; up to twenty at once.
    """
    cells, left_out = _observed(cells)
    designation, called, notices = _designations(cells)
    station = _stations(cells)
    epoch, t_s = _times(cells)
    psi = _directions(cells)
    sigma, correlation = _uncertainties(cells)
    timing = np.stack([cells.numbers(name, "(0, 1e5)") for name in ("rmsTime", "uncTime")])
    centre, position, covariance, roving, ground = places(cells)
    magnitude = cells.numbers("mag", "[-5, 35]")
    worth = np.stack([15.0 * cells.numbers("precRA", "(0, 100)"), cells.numbers("precDec", "(0, 100)")], axis=1)
    worth[:, 0] *= np.cos(psi[:, 1])
    catalogue, mode, band = (_names(cells, name) for name in ("astCat", "mode", "band"))
    starred = np.array([bool(star) for star in cells.text("raStar")]) & ~(np.array(cells.text("ra")) != "")
    mode = np.where(np.isin(station, list(obscodes.OCCULTATION)) | starred, "OCC", mode)
    cells.source.refuse_problems()
    n = len(cells)
    table = Astrometry(
        epoch=epoch,
        path=np.full(n, cells.source.name),
        line=cells.line,
        designation=designation,
        station=station,
        t_s=t_s,
        utc=np.array(cells.text("obsTime")),
        psi=psi,
        precision_rad=worth * ARCSEC,
        written_rad=_last_digits(cells, psi),
        written_s=_last_digit(text.removesuffix("Z").rpartition(":")[2] for text in cells.text("obsTime")),
        sigma_rad=sigma,
        correlation=correlation,
        timing_sigma_s=np.where(np.isnan(timing).all(axis=0), np.nan, np.sqrt(np.nansum(timing**2, axis=0))),
        catalogue=catalogue,
        mode=mode,
        centre=centre,
        position_km=position,
        position_covariance_km2=covariance,
        roving=roving,
        magnitude=magnitude,
        band=band,
        discovery=np.array(cells.text("disc")) == "*",
        left_out=MappingProxyType(left_out),
        notices=(*cells.notices, *notices, *ground, *(told(reason, number) for reason, number in left_out.items())),
        other_names=MappingProxyType(called),
    )
    return without_repeats(table)


def _observed(cells: Cells) -> tuple[Cells, dict[str, int]]:
    """The records that are directions, and how many others there are."""
    left_out = {"radar": 0, "deleted": 0, "offset": 0}
    rows = []
    marks = zip(cells.text("deprecated"), cells.text("trx"), cells.text("obsCenter"))
    for row, (deprecated, transmitter, primary) in enumerate(marks):
        if deprecated:
            left_out["deleted"] += 1
        elif transmitter:
            left_out["radar"] += 1
        elif primary:
            left_out["offset"] += 1
        else:
            rows.append(row)
    if not rows:
        counts = ", ".join(f"{number} {reason}" for reason, number in left_out.items() if number)
        raise cells.source.error(1, f"no directions in this file ({counts} left out)")
    return cells.keep(rows), {reason: number for reason, number in left_out.items() if number}


def _designations(cells: Cells) -> tuple[Texts, dict[str, tuple[str, ...]], tuple[str, ...]]:
    """The name of each record's object (number, else provisional, else the observer's own), other names, notices."""
    found: dict[tuple[str, str, str], Designation | None] = {}
    named = []
    own = [first or second for first, second in zip(cells.text("trkSub"), cells.text("artSat"))]
    for row, key in enumerate(zip(cells.text("permID"), cells.text("provID"), own)):
        if key not in found:
            found[key] = _designation(*key)
        one = found[key]
        if one is None:
            _no_designation(cells, row, key)
        named.append(one or Designation())
    known = {key: one for key, one in found.items() if one}
    return np.array(names_of(named)), other_names(known.values()), _about_names(cells.source.name, known)


def _about_names(file: str, found: Mapping[tuple[str, str, str], Designation]) -> tuple[str, ...]:
    """What a user should know about the names in a file."""
    exchanged = any((key[0] and not one.number) or kind(key[1]) == "number" for key, one in found.items())
    notices = [f"{file}: permID and provID are exchanged in some records; each was read as what it is"] * exchanged
    return (*notices, *exercises(file, found.values()))


def _designation(permanent: str, provisional: str, own: str) -> Designation | None:
    """The designation of one record by what the texts are, whichever column they stand in; None if they are nothing."""
    parts = [from_text(text) for text in (permanent, provisional) if text]
    known = [one for one in parts if one is not None]
    if len(known) < len(parts) or not (parts or own) or not OWN_NAME.fullmatch(own or "-"):
        return None
    return combined([*known, Designation(own=own)])


def _no_designation(cells: Cells, row: int, key: tuple[str, str, str]) -> None:
    """Note which text of a record is no designation, and why."""
    for name, text in zip(("permID", "provID", "trkSub"), key):
        if text and is_satellite(text):
            cells.wrong(row, name, NO_SATELLITES)
            return
    name = next((name for name, text in zip(("permID", "provID"), key) if text and from_text(text) is None), "trkSub")
    cells.wrong(row, name, 'is no designation; allowed such as permID "3666", provID "1979 HP", trkSub "B853"')


def _stations(cells: Cells) -> Texts:
    """Observatory codes, all known."""
    codes = cells.text("stn")
    unknown = {code for code in set(codes) if not obscodes.known(code)}
    for row, code in enumerate(codes):
        if code in unknown:
            # looking for what was meant takes 8 ms, and of many wrong codes only the first are shown
            cells.wrong(row, "stn", obscodes.NO_CODE if cells.source.full else obscodes.unknown(code))
    return np.array(codes)


def _times(cells: Cells) -> tuple[Epoch, Array]:
    """Epoch and TDB seconds after it (n,)."""
    n = len(cells)
    parts = np.tile(np.array([2000, 1, 1, 0, 0, 0]), (n, 1))
    fraction = np.zeros(n)
    for row, text in enumerate(cells.text("obsTime")):
        if match := TIME.fullmatch(text):
            parts[row] = [int(match[i]) for i in range(1, 7)]
            fraction[row] = float(match[7]) if match[7] and len(match[7]) > 1 else 0.0
        else:
            utc = " (is the Z of UTC missing?)" if TIME.fullmatch(text + "Z") else ""
            cells.wrong(row, "obsTime", f"allowed such as 2016-12-31T23:59:59.123Z, UTC{utc}")
    year, month, day, hour, minute, second = parts.T
    there = (day >= 1) & (day <= month_days(year, month))
    covered = (year >= FIRST_YEAR) & (year <= LAST_YEAR)
    last_minute = (hour == 23) & (minute == 59)
    clock = (hour < 24) & (minute < 60) & (second < np.where(last_minute, 61, 60))
    for row in np.flatnonzero(~(there & covered & clock)).tolist():
        if not there[row]:
            why = "there is no such day"
        elif not covered[row]:
            why = f"allowed years {FIRST_YEAR} to {LAST_YEAR}"
        else:
            why = "there is no such time of day; seconds below 60, or 60 at a leap second"
        cells.wrong(row, "obsTime", why)
    usable = there & covered & clock
    year, month, day = (np.where(usable, part, dummy) for part, dummy in ((year, 2000), (month, 1), (day, 1)))
    seconds = np.where(usable, hour * 3600.0 + minute * 60.0 + second + fraction, 0.0)
    epoch, t_s, exists = tdb_times(year, month, day, seconds)
    for row in np.flatnonzero(usable & ~exists).tolist():
        cells.wrong(row, "obsTime", "there was no leap second on this day; the last one is 2016-12-31T23:59:60Z")
    return epoch, t_s


def _directions(cells: Cells) -> Array:
    """RA and Dec (n, 2), rad: measured, or those of an occulted star with the offset of the object added."""
    ra, dec = cells.numbers("ra", "[0, 360)"), cells.numbers("dec", "[-90, 90]")
    star_ra, star_dec = cells.numbers("raStar", "[0, 360)"), cells.numbers("decStar", "[-90, 90]")
    offset = np.stack([cells.numbers(name, "[-1e5, 1e5]") for name in ("deltaRA", "deltaDec")], axis=1)
    blank = [not first and not second for first, second in zip(cells.text("ra"), cells.text("raStar"))]
    for row in np.flatnonzero(blank).tolist():
        cells.wrong(row, "ra", "is empty; allowed [0, 360) in degrees")
    for row, pair in enumerate(zip(cells.text("ra"), cells.text("dec"), cells.text("raStar"), cells.text("decStar"))):
        if bool(pair[0]) != bool(pair[1]):
            cells.wrong(row, "dec" if pair[0] else "ra", "is empty; RA and Dec belong together")
        elif not pair[0] and pair[2] and (not pair[3] or np.isnan(offset[row]).any()):
            cells.wrong(row, "raStar", "an occultation needs raStar, decStar, deltaRA and deltaDec")
    by_star = np.isnan(ra) & ~np.isnan(star_ra)
    with np.errstate(invalid="ignore"):
        # the offset is measured on the plane that touches the sky at the star
        turned, lifted = erfa.tpsts(*(offset.T * ARCSEC), np.radians(star_ra), np.radians(star_dec))
    return np.stack(
        [
            np.mod(np.where(by_star, turned, np.radians(ra)), 2.0 * np.pi),
            np.where(by_star, lifted, np.radians(dec)),
        ],
        axis=1,
    )


def _last_digits(cells: Cells, psi: Array) -> Array:
    """What the last digits of RA cos Dec and Dec are worth (n, 2), rad; nan of an occulted star."""
    worth = np.radians(np.stack([_last_digit(cells.text(name)) for name in ("ra", "dec")], axis=1))
    worth[:, 0] *= np.cos(psi[:, 1])
    return worth


def _last_digit(texts: Iterable[str]) -> Array:
    """What the last digit of each decimal number is worth; nan where there is none."""
    return np.array([10.0 ** -len(text.partition(".")[2]) if text else np.nan for text in texts])


def _uncertainties(cells: Cells) -> tuple[Array, Array]:
    """Stated sigmas (n, 2), rad, nan where none, and correlations (n,)."""
    sigma = np.stack([cells.numbers(name, "(0, 1e5)") for name in ("rmsRA", "rmsDec")], axis=1)
    for row, (first, second) in enumerate(zip(cells.text("rmsRA"), cells.text("rmsDec"))):
        if bool(first) != bool(second):
            cells.wrong(row, "rmsDec" if first else "rmsRA", "is empty; give both rmsRA and rmsDec, or neither")
    correlation = cells.numbers("rmsCorr", "(-1, 1)")
    return sigma * ARCSEC, np.where(np.isnan(correlation) | np.isnan(sigma[:, 0]), 0.0, correlation)


def _names(cells: Cells, name: str) -> Texts:
    """Short names as they stand, "" for UNK."""
    form = CATALOGUE if name == "astCat" else SHORT_NAME
    texts = cells.text(name)
    strange = {text for text in set(texts) if text and not form.fullmatch(text)}
    for row, text in enumerate(texts):
        if text in strange:
            cells.wrong(row, name, "allowed letters, digits and _, at most " + ("8" if name == "astCat" else "3"))
    return np.array(["" if text == "UNK" else text for text in texts])
