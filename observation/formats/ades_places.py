"""Where the observers of ADES records were: sys, ctr, pos1-3 and the covariance posCov11-33."""

import re

import erfa
import numpy as np

from nebosvod.dynamics.constants import AU_KM
from nebosvod.observation.contracts import Array, Flags, Texts
from nebosvod.observation.earth import obscodes
from nebosvod.observation.formats.ades_cells import Cells
from nebosvod.observation.formats.mpc80_places import GREATEST_KM, NEAREST_KM

INERTIAL = {"ICRF_KM": 1.0, "ICRF_AU": AU_KM}  # km in one unit
GROUND = ("WGS84", "ITRF")
CENTRES = {399: "earth", 10: "sun", 0: "ssb"}
POSITIONS = ("pos1", "pos2", "pos3")
COVARIANCES = ("posCov11", "posCov12", "posCov13", "posCov22", "posCov23", "posCov33")
INTEGER = re.compile(r"[+-]?\d{1,9}(?:\.0*)?", re.ASCII)


def places(cells: Cells) -> tuple[Texts, Array, Array, Flags, tuple[str, ...]]:
    """Centres, positions (n, 3) km, covariances (n, 3, 3) km^2, which observers stood on the ground, and notices."""
    n = len(cells)
    stations, systems, centres = cells.text("stn"), cells.text("sys"), cells.text("ctr")
    values = np.stack([cells.numbers(name, "[-1e12, 1e12]") for name in POSITIONS], axis=1)
    written = np.isfinite(values)
    centre, position = np.full(n, "", dtype="U5"), np.full((n, 3), np.nan)
    roving = np.zeros(n, dtype=bool)
    needs = {one for one in set(stations) if obscodes.needs_position(one)}
    for row in range(n):
        if not (systems[row] or centres[row] or written[row].any()):
            if stations[row] in needs:
                name = obscodes.described(stations[row])
                cells.wrong(row, "stn", f"{name} has no fixed place: the record needs sys, ctr, pos1, pos2 and pos3")
            continue
        found = _place(cells, row, systems[row], centres[row], values[row], stations[row])
        if found is not None:
            centre[row], position[row], roving[row] = found
    covariance, notices = _covariances(cells, np.where(centre == "", np.nan, 1.0), roving)
    return centre, position, covariance, roving, notices


def _place(
    cells: Cells, row: int, system: str, centre: str, values: Array, station: str
) -> tuple[str, Array, bool] | None:
    """Centre, position and whether on the ground for one record; None after noting what is wrong."""
    if system not in (*INERTIAL, *GROUND):
        cells.wrong(row, "sys", f"allowed {', '.join((*INERTIAL, *GROUND))}")
        return None
    body = CENTRES.get(int(float(centre))) if INTEGER.fullmatch(centre) else None
    if body is None or (system in GROUND and body != "earth"):
        cells.wrong(row, "ctr", "allowed 399 (Earth), with ICRF also 10 (Sun) and 0 (solar-system barycentre)")
        return None
    lacking = [name for name, value in zip(POSITIONS, values) if np.isnan(value)]
    if lacking:
        cells.wrong(row, lacking[0], "sys and ctr are given, so all of pos1, pos2, pos3 are needed")
        return None
    if system in GROUND:
        return _on_the_ground(cells, row, system, values)
    position = INERTIAL[system] * values
    radius = float(np.linalg.norm(position))
    nearest = NEAREST_KM if body == "earth" and station not in obscodes.OCCULTATION else 0.0
    if not nearest <= radius <= GREATEST_KM:
        cells.wrong(
            row,
            "pos1",
            f"the observer would be {radius:.6g} km from the centre {centre}; allowed {nearest:.0f} to "
            f"{GREATEST_KM:.0e} km (is sys right: ICRF_KM or ICRF_AU?)",
        )
        return None
    return body, position, False


def _on_the_ground(cells: Cells, row: int, system: str, values: Array) -> tuple[str, Array, bool] | None:
    """A place on the Earth: WGS84 is longitude, latitude (deg), altitude (m); ITRF longitude (deg), Rxy, Rz (km)."""
    longitude, second, third = values.tolist()
    right = -360.0 <= longitude <= 360.0
    if system == "WGS84":
        right &= -90.0 <= second <= 90.0 and -1000.0 <= third <= 1e5
        allowed = "longitude -360 to 360 deg, latitude -90 to 90 deg, altitude -1000 to 100000 m"
        place = erfa.gd2gc(1, np.radians(longitude), np.radians(second), third) / 1e3 if right else values
    else:
        right &= 6300.0 <= np.hypot(second, third) <= 6500.0 and second >= 0.0
        allowed = "longitude -360 to 360 deg, distances from axis and equator in km, on the Earth's surface"
        turn = np.radians(longitude)
        place = np.array([second * np.cos(turn), second * np.sin(turn), third])
    if not right:
        cells.wrong(row, "pos1", f"with pos2 {second:g}, pos3 {third:g} is no place by {system}: {allowed}")
        return None
    return "earth", place, True


def _covariances(cells: Cells, present: Array, roving: Flags) -> tuple[Array, tuple[str, ...]]:
    """Position covariances (n, 3, 3) km^2 by the unit of sys; those of places on the ground are not used."""
    n = len(cells)
    full = np.full((n, 3, 3), np.nan)
    if not any(name in cells.columns for name in COVARIANCES):
        return full, ()
    parts = {name: cells.numbers(name, "[-1e25, 1e25]", real=True) for name in COVARIANCES}
    given = np.any([np.isfinite(part) for part in parts.values()], axis=0)
    unit2 = np.array([INERTIAL.get(system, np.nan) ** 2 for system in cells.text("sys")])
    for row in np.flatnonzero(given & np.isfinite(present) & ~roving).tolist():
        matrix = np.zeros((3, 3))
        for name, part in parts.items():
            i, j = int(name[-2]) - 1, int(name[-1]) - 1
            matrix[i, j] = matrix[j, i] = part[row]
        lacking = next((name for name in ("posCov11", "posCov22", "posCov33") if np.isnan(parts[name][row])), "")
        if lacking:
            cells.wrong(row, lacking, "posCov11, posCov22 and posCov33 are needed together")
            continue
        matrix[np.isnan(matrix)] = 0.0
        smallest = float(np.linalg.eigvalsh(matrix)[0])
        if smallest < -1e-9 * float(np.trace(np.abs(matrix))):
            cells.wrong(row, "posCov11", f"the covariance is not positive: smallest eigenvalue {smallest:.3g}")
        else:
            full[row] = matrix * unit2[row]
    unused = int(np.count_nonzero(given & roving))
    return full, (f"{unused} covariances of places on the ground were not used",) if unused else ()
