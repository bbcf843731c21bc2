"""Where the observer of each record was, for records of many stations at once.

A trajectory file given for the station comes first, then the position the record states (spacecraft, roving observers),
then the MPC's parallax constants of the station. Ground sites all go through one pass over the Earth's rotation
(`sites`).

A record that states a position states no velocity. It is taken from the nearest other record of the station, if that
lies within a twelfth of an orbit: two positions and the fall between them give the velocity to 0.5 %. Elsewhere the
observer is given the velocity of the centre its position counts from; `velocity_known` tells. The velocity enters the
partials of a clock error and RTN axes, nothing else.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris, Flags, Rows, Texts
from nebosvod.observation.earth import obscodes
from nebosvod.observation.earth.sites import MPC_EARTH_RADIUS_KM, GroundSite, ground_states
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.reduction.recorded_places import RecordedPlaces
from nebosvod.observation.spacecraft.kinds import Spacecraft
from nebosvod.timescale import Epoch

LARGEST_PHASE = 0.5  # of an orbit, rad, over which two positions give the velocity
LARGEST_GAP_S = 86400.0
SAME_TIME_S = 1e-5
LEAST_GAP_S = 1.0  # places are written to a kilometre at worst: closer ones tell no velocity
LISTED = 5
ORIGINS = {"ssb": "barycentre"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Observers:
    """The observers of a table of records, row by row.

    Attributes
    ----------
    epoch, t_s : reference epoch and times (n,) of the records.
    telescope : (n,) name of the telescope of each record: the station's code; records of one station at one time but
        at different places (roving observers) are told apart as "247", "247/2" ...
    state_km_km_s : (n, 6) barycentric ICRF.
    velocity_known : (n,) whether the velocity is that of the observer; see the module.
    spacecraft : telescope -> what `observe` and the nuisances ask for states.
    notices : what stands in for missing tables, one sentence each.
    """

    epoch: Epoch
    t_s: Array
    telescope: Texts
    state_km_km_s: Array
    velocity_known: Flags
    spacecraft: Mapping[str, Spacecraft]
    notices: tuple[str, ...]


def telescopes(
    astrometry: Astrometry, ephemeris: Ephemeris, *, files: Mapping[str, Spacecraft] = MappingProxyType({})
) -> Observers:
    """Place the observer of every record.

    Parameters
    ----------
    files : station -> trajectory (`read_spk`, `read_oem`, any spacecraft); it is used instead of stated positions.

    Raises
    ------
    InputError
        If a station does not exist, or has no fixed place while the record states none either; names file and line.
    CoverageError
        If the ephemeris or a trajectory file does not cover a record.
    """
    epoch, t_s, station = astrometry.epoch, astrometry.t_s, astrometry.station
    filed = np.isin(station, list(files))
    stated = ~filed & (astrometry.centre != "")
    floating = stated & ~astrometry.roving
    itrf = _sites(astrometry, ~filed & ~floating)
    ground = np.isfinite(itrf[:, 0])
    states, velocity_known = np.empty((t_s.size, 6)), np.ones(t_s.size, dtype=np.bool_)
    notices: tuple[str, ...] = ()
    if ground.any():
        geocentric, earth = ground_states(itrf[ground], epoch, t_s[ground])
        states[ground] = geocentric + ephemeris.state_km_km_s("earth", epoch, t_s[ground])
        notices = earth.notices()
    for code in np.unique(station[filed]):
        mine = station == code
        states[mine] = files[str(code)].state_km_km_s(ephemeris, epoch, t_s[mine])
    for code in np.unique(station[floating]):
        mine = np.flatnonzero(floating & (station == code))
        states[mine], velocity_known[mine] = _floating_states(astrometry, mine, ephemeris)
    name = _names(astrometry, states)
    return Observers(
        epoch=epoch,
        t_s=t_s,
        telescope=name,
        state_km_km_s=states,
        velocity_known=velocity_known,
        spacecraft=_spacecraft(astrometry, name, states, np.where(stated[:, None], np.nan, itrf), files),
        notices=notices,
    )


def _sites(astrometry: Astrometry, wanted: Flags) -> Array:
    """ITRF places (n, 3), km, of the records that stand on the ground; nan elsewhere.

    Raises
    ------
    InputError
        For a station that does not exist, or has no place, naming file and line of the first records.
    """
    places, inverse = np.unique(astrometry.station, return_inverse=True)
    known = np.full((places.size, 3), np.nan)
    table = obscodes.codes()
    for i, code in enumerate(places.tolist()):
        row = table.get(code, {})
        if row.get("Longitude") is not None:
            angle = np.radians(row["Longitude"])
            known[i] = row["cos"] * np.cos(angle), row["cos"] * np.sin(angle), row["sin"]
    itrf = np.where(wanted[:, None], MPC_EARTH_RADIUS_KM * known[inverse], np.nan)
    roving = wanted & astrometry.roving
    itrf[roving] = astrometry.position_km[roving]
    lost = np.flatnonzero(wanted & ~np.isfinite(itrf).all(axis=1))
    if lost.size:
        raise InputError("\n".join(_no_place(astrometry, int(i)) for i in lost[:LISTED]))
    return itrf


def _no_place(astrometry: Astrometry, i: int) -> str:
    """The sentence about a record whose observer could be anywhere."""
    code, where = str(astrometry.station[i]), f"{astrometry.path[i]}:{astrometry.line[i]}"
    if not obscodes.known(code):
        return f'{where}: observatory code "{code}" {obscodes.unknown(code)}'
    return (
        f"{where}: observatory {obscodes.described(code)} has no fixed place and the record states no position; "
        f"give the position in the record or a trajectory file (SPK, OEM) for station {code}"
    )


def _floating_states(astrometry: Astrometry, rows: Rows, ephemeris: Ephemeris) -> tuple[Array, Flags]:
    """Barycentric states (r, 6) of records of one station that state where they were, and where the velocity holds."""
    t_s, place, centre = astrometry.t_s[rows], astrometry.position_km[rows], astrometry.centre[rows]
    lost = rows[~np.isfinite(place).all(axis=1)]
    if lost.size:
        raise InputError("\n".join(_no_place(astrometry, int(i)) for i in lost[:LISTED]))
    states, known = np.empty((rows.size, 6)), np.zeros(rows.size, dtype=np.bool_)
    for body in np.unique(centre):
        mine = centre == body
        gm = ephemeris.gm_km3_s2["sun" if body == "ssb" else str(body)]
        velocity, known[mine] = velocities(t_s[mine], place[mine], gm)
        states[mine] = np.concatenate([place[mine], velocity], axis=1)
        if body != "ssb":
            states[mine] += ephemeris.state_km_km_s(str(body), astrometry.epoch, t_s[mine])
    return states, known


def velocities(t_s: Array, place_km: Array, gm_km3_s2: float) -> tuple[Array, Flags]:
    """Velocities (r, 3), km/s, of one spacecraft from its positions (r, 3) about a centre, and which were found.

    Notes
    -----
    With the acceleration a = -GM r / r^3 linear between two positions, v1 = (r2 - r1) / dt - dt (2 a1 + a2) / 6; the
    error is v (n dt)^3 / 24 for motion with phase n dt, 0.5 % at the largest phase allowed. Zero where no other
    position is near enough.
    """
    velocity, known = np.zeros_like(place_km), np.zeros(t_s.size, dtype=np.bool_)
    order = np.argsort(t_s, kind="stable")
    t, r = t_s[order], place_km[order]
    distance = np.linalg.norm(r, axis=1, keepdims=True)
    fall = -gm_km3_s2 * r / np.maximum(distance, 1.0) ** 3
    rate = np.sqrt(gm_km3_s2 / np.maximum(distance[:, 0], 1.0) ** 3)
    best = np.full(t.size, np.inf)
    for shift in (1, -1):
        other = np.arange(t.size) + shift
        inside = (other >= 0) & (other < t.size)
        other = np.where(inside, other, 0)
        dt = np.where(inside, t[other] - t, 0.0)
        gap = np.abs(dt)
        good = (gap > LEAST_GAP_S) & (gap < LARGEST_GAP_S) & (gap * rate < LARGEST_PHASE) & (gap < best)
        step = np.where(good, dt, 1.0)[:, None]
        found = (r[other] - r) / step - step * (2.0 * fall + fall[other]) / 6.0
        velocity[order[good]] = found[good]
        known[order[good]] = True
        best[good] = gap[good]
    return velocity, known


def _names(astrometry: Astrometry, states: Array) -> Texts:
    """Names of telescopes (n,): the station; with a number where it was in several places at one time.

    Only observers on the ground, and derived positions, can be several under one code. A spacecraft is one, also where
    its place is written twice with other digits or by another orbit.
    """
    station, t_s = astrometry.station, astrometry.t_s
    order = np.lexsort((t_s, station))
    many = astrometry.roving | np.isin(station, list(obscodes.ROVING | obscodes.OCCULTATION))
    same = (station[order][1:] == station[order][:-1]) & (np.diff(t_s[order]) < SAME_TIME_S) & many[order][1:]
    apart = np.linalg.norm(np.diff(states[order, :3], axis=0), axis=1) > 1e-3
    if not np.any(same & apart):
        return station
    name = station.astype(object)
    number = 1
    for k in np.flatnonzero(same):
        number = (number if k and same[k - 1] else 1) + int(apart[k])
        if number > 1:
            name[order[k + 1]] = f"{station[order[k + 1]]}/{number}"
    return name.astype(np.str_)


def _spacecraft(
    astrometry: Astrometry, name: Texts, states: Array, itrf: Array, files: Mapping[str, Spacecraft]
) -> Mapping[str, Spacecraft]:
    """Telescope -> recorded places, with the site or the trajectory file behind them where there is one."""
    table: dict[str, Spacecraft] = {}
    for telescope in dict.fromkeys(name.tolist()):
        rows = np.flatnonzero(name == telescope)
        rows = rows[np.argsort(astrometry.t_s[rows], kind="stable")]
        code = str(astrometry.station[rows[0]])
        carrier = files.get(code)
        if carrier is None and np.isfinite(itrf[rows]).all():
            carrier = GroundSite(itrf_km=itrf[rows[0]], extrapolate=True)
        centres = set(astrometry.centre[rows].tolist())
        table[telescope] = RecordedPlaces(
            name=telescope,
            centre=carrier.centre if carrier else "sun" if centres & {"sun", "ssb"} else "earth",
            epoch=astrometry.epoch,
            t_s=astrometry.t_s[rows],
            states=states[rows],
            carrier=carrier,
        )
    return MappingProxyType(table)
