"""Where the observers of two-line records were: spacecraft (S, s) and roving observers on the ground (V, v)."""

import re

import erfa
import numpy as np

from nebosvod.dynamics.constants import AU_KM
from nebosvod.observation.contracts import Array, Flags, Texts
from nebosvod.observation.earth import obscodes
from nebosvod.observation.formats.mpc80_lines import RecordLines

SIGNED = re.compile(r" *([+-]?) *(\d+\.?\d*|\.\d+) *")
NEAREST_KM, GREATEST_KM = 6300.0, 1e11  # at the ground; 670 au


def positions(records: RecordLines, station: Texts) -> tuple[Texts, Array, Flags]:
    """What positions count from, positions (n, 3) km, and which are of roving observers, from the second lines."""
    n = records.first.size
    position = np.full((n, 3), np.nan)
    code = records.head[:, 14]
    needs = np.isin(station, [one for one in set(station.tolist()) if obscodes.needs_position(one)])
    records.wrong(
        needs & (records.second < 0),
        lambda line: (
            f"observatory {obscodes.described(line[77:80])} has no fixed place: the record needs two lines, "
            f'S and s (spacecraft) or V and v (roving observer), but column 15 is "{line[14]}"'
        ),
    )
    for i in np.flatnonzero(records.second >= 0).tolist():
        row = int(records.second[i])
        text = bytes(records.rows[row]).decode("ascii")
        place = spacecraft_km(text, str(station[i])) if code[i] == ord("S") else roving_km(text)
        if isinstance(place, str):
            records.source.problem(int(records.line[row]), place)
        else:
            position[i] = place
    return np.where(records.second >= 0, "earth", ""), position, code == ord("V")


def spacecraft_km(line: str, station: str) -> Array | str:
    """The geocentric ICRF position (3,) in line "s" of a spacecraft, km, or what is wrong with it.

    Positions derived from occultations are referred to a point of the shadow's axis, which may lie inside the Earth.
    """
    parts = [SIGNED.fullmatch(line[start:end]) for start, end in ((34, 45), (46, 57), (58, 69))]
    unit = {"1": 1.0, "2": AU_KM}.get(line[32])
    if unit is None:
        return f'column 33 "{line[32]}": allowed 1 (km) or 2 (au)'
    if None in parts:
        wrong = line[34:69]
        return f'position (columns 35-45, 47-57, 59-69) "{wrong}": allowed three numbers with a sign'
    place = unit * np.array([float(part[1] + part[2]) for part in parts if part])
    radius = float(np.linalg.norm(place))
    nearest = 0.0 if station in obscodes.OCCULTATION else NEAREST_KM
    if not nearest <= radius <= GREATEST_KM:
        return (
            f"position: {radius:.0f} km from the Earth's centre; a spacecraft is between {nearest:.0f} "
            f"and {GREATEST_KM:.0e} km from it (is the unit in column 33 right: 1 km, 2 au?)"
        )
    return place


def roving_km(line: str) -> Array | str:
    """The ITRF position (3,) of a roving observer in line "v", km, or what is wrong with it."""
    parts = [SIGNED.fullmatch(line[start:end]) for start, end in ((34, 44), (45, 55), (56, 61))]
    if line[32] != "1" or None in parts:
        return (
            f'place (columns 33-61) "{line[32:61]}": allowed 1, then east longitude and latitude in degrees '
            "and altitude in metres"
        )
    longitude, latitude, altitude = (float(part[1] + part[2]) for part in parts if part)
    if not (-180.0 <= longitude <= 360.0 and -90.0 <= latitude <= 90.0 and abs(altitude) < 1e5):
        return (
            f"place: longitude {longitude}, latitude {latitude}, altitude {altitude} m: allowed -180 to 360, "
            "-90 to 90, below 100 km"
        )
    place: Array = erfa.gd2gc(1, np.radians(longitude), np.radians(latitude), altitude) / 1e3
    return place
