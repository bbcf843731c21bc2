"""The 80-column format of the Minor Planet Center: one line a record, two for observers without a fixed place.

https://www.minorplanetcenter.net/iau/info/OpticalObs.html, .../SatelliteObs.html, .../RovingObs.html. Records are
parsed as columns of one byte matrix, never one by one: nine thousand take a tenth of a second.
"""

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from nebosvod.errors import counted
from nebosvod.observation.contracts import Array, Rows, Texts
from nebosvod.observation.earth import obscodes
from nebosvod.observation.earth.earth_orientation import table_span
from nebosvod.observation.earth.universal_time import FIRST_YEAR, LAST_YEAR, iso, month_days, tdb_times
from nebosvod.observation.formats import mpc80_codes
from nebosvod.observation.formats.designations import NO_SATELLITES, Designation, from_columns, is_satellite
from nebosvod.observation.formats.header_stations import unlike
from nebosvod.observation.formats.mpc80_columns import BLANK, MINUS, PLUS, decimals, distinct, integer, sexagesimal
from nebosvod.observation.formats.mpc80_lines import RecordLines, record_lines
from nebosvod.observation.formats.mpc80_places import positions
from nebosvod.observation.formats.object_names import exercises, names_of, other_names
from nebosvod.observation.formats.records import Astrometry, told, without_repeats
from nebosvod.observation.formats.source_file import SourceFile, read_source
from nebosvod.timescale import Epoch

MOST_LETTERS = 2  # of a comet's fragment
MAGNITUDE = re.compile(r" *[+-]?([0-9]+\.?[0-9]*|\.[0-9]+) *")


def read(path: str | Path) -> Astrometry:
    """Read a file of 80-column records (also gzipped).

    Raises
    ------
    DataError
        If the file cannot be opened.
    InputError
        With file and line, for whatever in it cannot be used; up to twenty problems at once.
    """
    return parse(read_source(path))


def parse(source: SourceFile) -> Astrometry:
    """Read 80-column records from the contents of a file; raises as `read` does."""
    records = record_lines(source)
    if not records.first.size:
        source.refuse_problems()
        counts = ", ".join(f"{number} {reason}" for reason, number in records.left_out.items() if number)
        raise source.error(1, f"no observations in this file{f' ({counts} left out)' if counts else ''}")
    head = records.head
    station = _stations(records)
    designations, which_designation, dropped = _designations(records)
    called = other_names(designations)
    psi, precision = _directions(records)
    times = _times(records)
    centre, position, roving = positions(records, station)
    magnitude, band = _magnitudes(records)
    source.refuse_problems()
    epoch, t_s, utc = times.tdb()
    n = records.first.size
    codes, which_code = distinct(head[:, 14:15])
    catalogues, which_catalogue = distinct(head[:, 71:72])
    mode = np.array([mpc80_codes.MODES.get(code, "") for code in codes])[which_code]
    left_out = {reason: number for reason, number in records.left_out.items() if number}
    table = Astrometry(
        epoch=epoch,
        path=np.full(n, source.name),
        line=records.line[records.first],
        designation=np.array(names_of(designations))[which_designation],
        station=station,
        t_s=t_s,
        utc=utc,
        psi=psi,
        precision_rad=precision,
        written_rad=precision,
        written_s=times.worth_s,
        sigma_rad=np.full((n, 2), np.nan),
        correlation=np.zeros(n),
        timing_sigma_s=np.full(n, np.nan),
        catalogue=np.array([mpc80_codes.CATALOGUES.get(code, "") for code in catalogues])[which_catalogue],
        mode=np.where(np.isin(station, list(obscodes.OCCULTATION)), "OCC", mode),
        centre=centre,
        position_km=position,
        position_covariance_km2=np.full((n, 3, 3), np.nan),
        roving=roving,
        magnitude=magnitude,
        band=band,
        discovery=head[:, 12] == ord("*"),
        left_out=MappingProxyType(left_out),
        notices=(
            *dropped,
            *_headers(records, station),
            *_unknown_catalogues(records, catalogues, which_catalogue),
            *(told(reason, number) for reason, number in left_out.items()),
        ),
        other_names=MappingProxyType(called),
    )
    return without_repeats(table)


def _stations(records: RecordLines) -> Texts:
    """Observatory codes, all known."""
    codes, which = distinct(records.head[:, 77:80])
    for k, code in enumerate(codes):
        if not obscodes.known(code):
            records.wrong(which == k, lambda _, code=code: f'columns 78-80 "{code}": {obscodes.unknown(code)}')  # type: ignore[misc]
    return np.array(codes)[which]


def _unknown_catalogues(records: RecordLines, codes: list[str], which: Rows) -> tuple[str, ...]:
    """A notice of letters in column 72 that stand for no star catalogue of the MPC's table."""
    strange = [k for k, code in enumerate(codes) if code.strip() and code not in mpc80_codes.CATALOGUES]
    if not strange:
        return ()
    letters, number = ", ".join(f'"{codes[k]}"' for k in strange), int(np.isin(which, strange).sum())
    text = (
        f"{counted(number, 'record')} with a star catalogue in column 72 that is not known ({letters}); taken as none"
    )
    return (f"{records.source.name}: {text}",)


def _headers(records: RecordLines, station: Texts) -> tuple[str, ...]:
    """Notices of headers that name another observatory than the records below them."""
    return unlike(records.source.name, records.line[records.first].tolist(), records.header_station, station.tolist())


def _designations(records: RecordLines) -> tuple[list[Designation], Rows, list[str]]:
    """The different designations, which each record has, and notices of what of them was not used."""
    columns, which = distinct(records.head[:, 0:12])
    this_year = int(table_span()[1].iso("utc")[:4])  # the tables of the Earth's rotation end a year ahead at most
    found, notices = [], []
    for k, text in enumerate(columns):
        designation = from_columns(text, this_year)
        if designation is None:
            records.wrong(which == k, partial(_no_designation, text))
        elif designation == Designation(number=designation.number) and len(text[5:].strip()) > MOST_LETTERS:
            told_as = f'"{text}" was read as {designation.number}'
            notices.append(f"{records.source.name}: {told_as}: what follows the number is of a year to come")
        found.append(designation or Designation())
    return found, which, [*notices, *exercises(records.source.name, found)]


def _no_designation(text: str, _: str) -> str:
    """What is wrong with columns 1-12."""
    if is_satellite(text):
        return f'columns 1-12: "{text}" {NO_SATELLITES}'
    return (
        f'columns 1-12: "{text}" is no designation; allowed: a packed number in 1-5, a packed provisional '
        "designation or a name of up to seven letters in 6-12"
    )


def _directions(records: RecordLines) -> tuple[Array, Array]:
    """RA and Dec (n, 2), rad, and what the last digit of each is worth on the sky, rad."""
    head = records.head
    hours, hour_worth, ra_right = sexagesimal(head[:, 32:44], 23)
    degrees, degree_worth, dec_right = sexagesimal(head[:, 45:56], 90)
    sign = head[:, 44]
    dec_right &= ((sign == PLUS) | (sign == MINUS)) & (degrees <= 90.0)
    records.wrong(
        ~ra_right,
        lambda line: f'right ascension (columns 33-44) "{line[32:44]}": {_why(line[32:44], "HH MM SS.ddd", "23")}',
    )
    records.wrong(
        ~dec_right,
        lambda line: f'declination (columns 45-56) "{line[44:56]}": {_why(line[44:56], "+DD MM SS.dd", "90")}',
    )
    dec = np.radians(np.where(sign == MINUS, -degrees, degrees))
    precision = np.stack([np.radians(hour_worth * 15.0) * np.cos(dec), np.radians(degree_worth)], axis=1)
    return np.stack([np.radians(hours * 15.0), dec], axis=1), precision


def _why(text: str, form: str, most: str) -> str:
    """What is allowed in a field of sexagesimal digits, and what the mistake may be."""
    hint = ""
    if re.search(r"[OoIl]", text):
        hint = "; a letter stands where a digit belongs"
    elif re.search(r" 6\d", text):
        hint = "; write 60 as the next minute or degree"
    return f"allowed {form} or {form[:-5].rstrip('S ')}.m, at most {most} and below 60{hint}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Times:
    """Calendar days with decimals; `worth_s` is what the last digit is worth."""

    year: Rows
    month: Rows
    day: Rows
    fraction: Array
    worth_s: Array

    def tdb(self) -> tuple[Epoch, Array, Texts]:
        second = self.fraction * 86400.0
        epoch, t_s, _ = tdb_times(self.year, self.month, self.day, second)
        # 0.1 ms is the tenth part of the smallest step, a millionth of a day
        ticks = np.rint(second * 1e4).astype(np.int64)
        return epoch, t_s, iso(self.year, self.month, self.day, ticks)


def _times(records: RecordLines) -> _Times:
    """Dates in columns 16-32."""
    head = records.head
    year, years = integer(head[:, 15:19])
    month, months = integer(head[:, 20:22])
    day, days = integer(head[:, 23:25])
    fraction, digits, right = decimals(head[:, 25:32])
    right &= years & months & days & (digits > 0) & (head[:, 19] == BLANK) & (head[:, 22] == BLANK)
    length = month_days(year, month)
    there = (day >= 1) & (day <= length)
    covered = (year >= FIRST_YEAR) & (year <= LAST_YEAR)
    records.wrong(
        ~right, lambda line: f'date (columns 16-32) "{line[15:32]}": allowed YYYY MM DD.dddddd with decimals of the day'
    )
    records.wrong(right & ~there, lambda line: f'date (columns 16-32) "{line[15:32]}": there is no such day')
    records.wrong(
        right & there & ~covered,
        lambda line: f'date (columns 16-32) "{line[15:32]}": allowed {FIRST_YEAR} to {LAST_YEAR}',
    )
    return _Times(
        year=year,
        month=month,
        day=day,
        fraction=fraction,
        worth_s=np.asarray(86400.0 * 10.0**-digits, dtype=np.float64),
    )


def _magnitudes(records: RecordLines) -> tuple[Array, Texts]:
    """Magnitudes, nan where there is none, and their bands."""
    columns, which = distinct(records.head[:, 65:70])
    values = np.full(len(columns), np.nan)
    for k, text in enumerate(columns):
        if MAGNITUDE.fullmatch(text):
            values[k] = float(text)
        elif text.strip():
            records.wrong(which == k, lambda _, text=text: f'magnitude (columns 66-70) "{text}": allowed 14.7')  # type: ignore[misc]
    bands, which_band = distinct(records.head[:, 70:71])
    return values[which], np.array([band.strip() for band in bands])[which_band]
