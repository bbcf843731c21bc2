"""Earth orientation on any date: the IERS tables that astropy ships from 1962 on, and what stands in outside of them.

- from 1973: IERS Bulletin A with the final values of Bulletin B (finals2000A); linear in UT1 - TAI between days;
- 1962 to 1972: EOP C04;
- before 1962: no polar motion (the pole lies within 0.3", 10 m), and UT1 is what the clocks showed, to about 0.1 s
  (46 m at the equator): UTC in 1960 and 1961, universal time before (`universal_time`);
- after the last day of the tables: its UT1 - TAI. The Earth drifts from it by up to 1 ms a day, 0.5 m for each day.

Nothing is fetched from anywhere.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import erfa
import numpy as np
import numpy.typing as npt

from nebosvod.errors import DataError, counted
from nebosvod.observation.contracts import Array
from nebosvod.observation.earth.universal_time import ut1_jd
from nebosvod.timescale import Epoch
from nebosvod.units import ARCSEC

UTC_FIRST_MJD = 36934  # 1960-01-01, from when on UTC is tied to TAI
C04_FIRST_MJD = 37665  # 1962-01-01
LEAPS_FIRST_MJD = 41317  # 1972-01-01, from when on it is so by whole seconds
FINALS_FIRST_MJD = 41684  # 1973-01-02
# Columns of finals2000A.all (readme.finals2000A): pole x, pole y, UT1-UTC of Bulletin A; the same of Bulletin B
BULLETIN_A = (slice(18, 27), slice(37, 46), slice(58, 68))
BULLETIN_B = (slice(134, 144), slice(144, 154), slice(154, 165))
TT_MINUS_TAI_S = 32.184
UT1_DRIFT_S_DAY = 1e-3
EQUATOR_KM_S = 0.4651


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orientation:
    """Universal time and the pole at n dates.

    Attributes
    ----------
    ut1_jd : two-part UT1 Julian dates, each (n,).
    x_pole_rad, y_pole_rad : (n,).
    before, after : (n,) whether the date is before 1962 or after the last day of the tables.
    beyond_days : by how many days the latest date passes the end of the tables; 0 if none does.
    """

    ut1_jd: tuple[Array, Array]
    x_pole_rad: Array
    y_pole_rad: Array
    before: npt.NDArray[np.bool_]
    after: npt.NDArray[np.bool_]
    beyond_days: float

    def notices(self) -> tuple[str, ...]:
        """What stands in for the tables, with the size of its error; empty if they cover every date."""
        told = []
        if self.before.any():
            times = counted(int(self.before.sum()), "time")
            told.append(
                f"{times} before 1962, the first year of the Earth-orientation table: UT1 is "
                "taken as the time the clocks showed, and no polar motion (sites good to about 50 m)"
            )
        if self.after.any():
            error_m = UT1_DRIFT_S_DAY * self.beyond_days * EQUATOR_KM_S * 1e3
            times = counted(int(self.after.sum()), "time")
            told.append(
                f"{times} up to {self.beyond_days:.0f} d after the end of the Earth-orientation table: its last values "
                f"are kept (sites good to about {max(error_m, 1.0):.0f} m); update astropy-iers-data"
            )
        return tuple(told)


def orientation(jd1_tt: Array, jd2_tt: Array) -> Orientation:
    """Orientation of the Earth at two-part TT Julian dates, both (n,)."""
    tai, columns = _table()
    where = (jd1_tt - 2400000.5) + jd2_tt - TT_MINUS_TAI_S / 86400.0
    row = np.clip(np.searchsorted(tai, where, side="right") - 1, 0, tai.size - 2)
    part = np.clip((where - tai[row]) / (tai[row + 1] - tai[row]), 0.0, 1.0)[:, None]
    ut1_minus_tai, x_pole, y_pole = (columns[row] + part * (columns[row + 1] - columns[row])).T
    jd2_ut1 = jd2_tt + (ut1_minus_tai - TT_MINUS_TAI_S) / 86400.0
    old = where < tai[0]
    if old.any():
        jd2_ut1[old] = ut1_jd(jd1_tt[old], jd2_tt[old])[1]
    after = where > tai[-1]
    return Orientation(
        ut1_jd=(jd1_tt, jd2_ut1),
        x_pole_rad=x_pole,
        y_pole_rad=y_pole,
        before=where < C04_FIRST_MJD,
        after=after,
        beyond_days=float(np.max(where[after] - tai[-1])) if after.any() else 0.0,
    )


def table_span() -> tuple[Epoch, Epoch]:
    """From when, and until when, UT1 and pole are tabulated."""
    last_tai = float(_table()[0][-1])
    return Epoch.from_jd(2400000.5, C04_FIRST_MJD, "utc"), Epoch.from_jd(
        2400000.5, last_tai + TT_MINUS_TAI_S / 86400.0, "tt"
    )


@cache
def _table() -> tuple[Array, Array]:
    """Moments (k,), MJD TAI, and UT1 - TAI (s), x, y (rad) of each (k, 3), from 1960 on."""
    import astropy_iers_data

    mjd, x, y, ut1_minus_utc = np.concatenate(
        [
            [(mjd, 0.0, 0.0, 0.0) for mjd in range(UTC_FIRST_MJD, C04_FIRST_MJD)],
            _c04(Path(astropy_iers_data.IERS_B_FILE)),
            _finals(Path(astropy_iers_data.IERS_A_FILE)),
        ]
    ).T
    if not np.all(np.diff(mjd) == 1.0):
        raise DataError("Earth-orientation table: days are missing in the files of astropy-iers-data; reinstall it")
    tai_minus_utc = _tai_minus_utc(mjd)
    return mjd + tai_minus_utc / 86400.0, np.stack([ut1_minus_utc - tai_minus_utc, x * ARCSEC, y * ARCSEC], axis=1)


def _tai_minus_utc(mjd: Array) -> Array:
    """TAI - UTC (k,), s, at 0h UTC: drifting with UTC until 1972, whole seconds after."""
    leaps = erfa.leap_seconds.get()
    month = [erfa.cal2jd(int(row["year"]), int(row["month"]), 1)[1] for row in leaps]
    value: Array = leaps["tai_utc"][np.searchsorted(month, mjd, side="right") - 1].astype(np.float64)
    early = mjd < LEAPS_FIRST_MJD
    year, months, day, fraction = erfa.jd2cal(2400000.5, mjd[early])
    value[early] = erfa.dat(year, months, day, fraction)
    return value


def _c04(path: Path) -> Array:
    """Rows (MJD, x", y", UT1 - UTC) of EOP C04 from 1962 until Bulletin A begins."""
    rows = []
    for line in _lines(path):
        if not line.startswith("#") and line.strip():
            try:
                mjd, x, y, ut1 = (float(word) for word in line.split()[4:8])
            except ValueError:
                raise DataError(f"{path}: not the EOP C04 series, at {line[:40]!r}; update astropy-iers-data") from None
            if mjd >= FINALS_FIRST_MJD:
                break
            rows.append((mjd, x, y, ut1))
    if not rows or rows[0][0] != C04_FIRST_MJD:
        raise DataError(f"{path}: does not begin on 1962-01-01; update astropy-iers-data")
    return np.array(rows)


def _finals(path: Path) -> Array:
    """Rows (MJD, x", y", UT1 - UTC) of finals2000A.all, Bulletin B where it is there, as far as it predicts."""
    rows = []
    for line in _lines(path):
        columns = BULLETIN_B if line[BULLETIN_B[2]].strip() else BULLETIN_A
        if not line[columns[2]].strip():
            break
        try:
            rows.append((float(line[7:15]), *(float(line[column]) for column in columns)))
        except ValueError:
            raise DataError(f"{path}: cannot be read at {line[:20]!r}; update astropy-iers-data") from None
    return np.array(rows)


def _lines(path: Path) -> list[str]:
    """Lines of a table that another package installed."""
    try:
        return path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: the Earth-orientation table cannot be read ({error}); reinstall astropy") from None
