"""Tables that say what an observation weighs: one row a rule, as comma-separated text anybody can edit.

The table that comes with nebosvod is `data/weights.csv`; a user's table has the same columns.
"""

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date
from functools import cache
from pathlib import Path

import numpy as np

from nebosvod.errors import DataError, InputError
from nebosvod.observation.contracts import Flags
from nebosvod.observation.earth import obscodes
from nebosvod.observation.formats.records import Astrometry

DEFAULT = Path(__file__).parent.parent / "data" / "weights.csv"
COLUMNS = ("station", "mode", "catalogue", "from", "until", "sigma_ra_arcsec", "sigma_dec_arcsec", "source")
OPTIONAL = ("source",)
ANY = "*"
NO_CATALOGUE, SPACE = "none", "SPACE"
MODES = ("CCD", "CMO", "VID", "PHO", "NOR", "ENC", "PMT", "MIC", "MER", "TDI", "OCC", SPACE)
LARGEST_ARCSEC = 3600.0
LARGEST_BYTES = 1_000_000  # the table that comes with the program has 3,400
MOST_PROBLEMS = 20
# Records that say nothing of the detector were photographed before this year and made by CCDs after it
FIRST_CCD_YEAR = 1990
MJD_ORDINAL = 678576  # of 1858-11-17, the day 0 of MJD


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rule:
    """What one observation weighs if it is one of these.

    Attributes
    ----------
    stations, modes, catalogues : names it applies to; empty = any.
    from_mjd, until_mjd : UTC dates it applies to, the first included, the last not.
    sigma_arcsec : standard deviations of RA cos Dec and of Dec.
    where : file and line; source : where the number comes from.
    """

    stations: frozenset[str]
    modes: frozenset[str]
    catalogues: frozenset[str]
    from_mjd: float
    until_mjd: float
    sigma_arcsec: tuple[float, float]
    where: str
    source: str

    @property
    def text(self) -> str:
        """The rule in words, such as `V17: station 703, CCD CMO, from 2014-01-01`."""
        parts = [
            f"station {_some(self.stations, 3)}" if self.stations else "",
            " ".join(sorted(self.modes)) if 0 < len(self.modes) < 4 else "",
            "no catalogue" if self.catalogues == {NO_CATALOGUE} else _some(self.catalogues, 2),
            f"from {_iso(self.from_mjd)}" if np.isfinite(self.from_mjd) else "",
            f"until {_iso(self.until_mjd)}" if np.isfinite(self.until_mjd) else "",
        ]
        told = ", ".join(part for part in parts if part)
        return f"{self.source}: {told or 'any observation'}"


@cache
def default_rules() -> tuple[Rule, ...]:
    """The rules that come with nebosvod: Veres et al. 2017 with additions (see the head of the file).

    References
    ----------
    Veres, Farnocchia, Chesley, Chamberlin 2017, Icarus 296, 139.
    """
    return read_rules(DEFAULT)


def read_rules(path: str | Path) -> tuple[Rule, ...]:
    """Read a table of rules; a later one takes precedence over an earlier one.

    Raises
    ------
    DataError
        If the file cannot be opened.
    InputError
        With file, line and column, for whatever in it cannot be used; all problems at once.
    """
    path = Path(path)
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise InputError(f"{path}: larger than {LARGEST_BYTES:,} bytes, no table of weights")
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise DataError(f"{path}: the table of weights cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 at byte {error.start}") from None
    return parse_rules(text.splitlines(), path.name)


def parse_rules(lines: Iterable[str], name: str) -> tuple[Rule, ...]:
    """Rules from the lines of a table; `name` stands for the file in messages. Raises as `read_rules` does."""
    numbered = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not numbered:
        raise InputError(f"{name}: no table of weights in it (the first row must be: {','.join(COLUMNS)})")
    head = [word.strip() for word in numbered[0][1].split(",")]
    for column in COLUMNS:
        if column not in head and column not in OPTIONAL:
            raise InputError(f"{name}:{numbered[0][0]}: column {column} is missing (needed: {', '.join(COLUMNS)})")
    for i, column in enumerate(head):
        if column not in COLUMNS or column in head[:i]:
            raise InputError(
                f'{name}:{numbered[0][0]}: column "{column}" is unknown or twice there (allowed: {", ".join(COLUMNS)})'
            )
    rules, problems = [], []
    for number, line in numbered[1:]:
        words = next(csv.reader([line]), [])
        try:
            if len(words) != len(head):
                raise InputError(f"{len(words)} columns instead of {len(head)}")
            rules.append(_rule(dict(zip(head, (word.strip() for word in words))), f"{name}:{number}", name))
        except InputError as error:
            problems.append(f"{name}:{number}: {error}")
    if problems:
        more = [f"{name}: and {len(problems) - MOST_PROBLEMS} more"] if len(problems) > MOST_PROBLEMS else []
        raise InputError("\n".join([*problems[:MOST_PROBLEMS], *more]))
    return tuple(rules)


def applies(rule: Rule, astrometry: Astrometry, mjd: np.ndarray, mode: np.ndarray, space: Flags) -> Flags:
    """Which records (n,) a rule speaks of; `mode` as `detector_modes` gives it, `mjd` UTC."""
    mine = (mjd >= rule.from_mjd) & (mjd < rule.until_mjd)
    if rule.stations:
        mine &= np.isin(astrometry.station, list(rule.stations))
    if rule.modes and mine.any():
        mine &= np.isin(mode, list(rule.modes)) | (space & (SPACE in rule.modes))
    if rule.catalogues and mine.any():
        unknown = np.isin(astrometry.catalogue, ["", "UNK"]) & (NO_CATALOGUE in rule.catalogues)
        mine &= np.isin(astrometry.catalogue, list(rule.catalogues - {NO_CATALOGUE})) | unknown
    return np.asarray(mine, dtype=np.bool_)


def detector_modes(astrometry: Astrometry, mjd: np.ndarray) -> np.ndarray:
    """Kind of detector of each record (n,); what is unknown counts as a photograph before 1990, as a CCD after."""
    guessed = np.where(mjd < date(FIRST_CCD_YEAR, 1, 1).toordinal() - MJD_ORDINAL, "PHO", "CCD")
    return np.where(np.isin(astrometry.mode, ["", "UNK"]), guessed, astrometry.mode)


def _rule(row: dict[str, str], where: str, name: str) -> Rule:
    """One row of the table."""
    stations, modes = _names(row["station"]), _names(row["mode"])
    for code in sorted(stations):
        if not obscodes.known(code):
            raise InputError(f'station: observatory code "{code}" {obscodes.unknown(code)}')
    if modes - set(MODES):
        raise InputError(f'mode: "{min(modes - set(MODES))}" is none of {", ".join(MODES)}')
    sigma = _sigma(row, "sigma_ra_arcsec"), _sigma(row, "sigma_dec_arcsec")
    start, end = _mjd(row["from"], "from", -np.inf), _mjd(row["until"], "until", np.inf)
    if start >= end:
        raise InputError(f"until: {row['until']} is not after {row['from']}")
    return Rule(
        stations=stations,
        modes=modes,
        catalogues=_names(row["catalogue"]),
        from_mjd=start,
        until_mjd=end,
        sigma_arcsec=sigma,
        where=where,
        source=row.get("source") or name,
    )


def _names(text: str) -> frozenset[str]:
    """Names separated by blanks; empty for any."""
    if not text:
        raise InputError('an empty cell (allowed: names separated by blanks, or "*")')
    return frozenset() if text == ANY else frozenset(text.split())


def _some(names: frozenset[str], most: int) -> str:
    """The first names in order."""
    return " ".join(sorted(names)[:most]) + (" ..." if len(names) > most else "")


def _sigma(row: dict[str, str], column: str) -> float:
    """A standard deviation."""
    try:
        value = float(row[column])
    except ValueError:
        value = np.nan
    if not 0.0 < value <= LARGEST_ARCSEC:
        raise InputError(f'{column}: "{row[column]}" (allowed: above 0, up to {LARGEST_ARCSEC:.0f})')
    return value


def _mjd(text: str, column: str, empty: float) -> float:
    """A date as MJD."""
    if not text:
        return empty
    try:
        if len(text) == 10:  # fromisoformat accepts 20140101 and 2014-W01-1 as well
            return float(date.fromisoformat(text).toordinal() - MJD_ORDINAL)
    except ValueError:
        text = text[:10]
    raise InputError(f'{column}: "{text}" is no date (allowed: YYYY-MM-DD or nothing)')


def _iso(mjd: float) -> str:
    """The date of an MJD."""
    return date.fromordinal(int(mjd) + MJD_ORDINAL).isoformat()
