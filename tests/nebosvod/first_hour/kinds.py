"""Made-up records of kinds of objects that a sceptic would try, written as a file that `alert` reads."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, ForceModel
from nebosvod.dynamics.frames import R_icrf_from_ecliptic
from nebosvod.dynamics.impact import follow
from nebosvod.observation import GeocentricOrbit, GroundSite, Spacecraft, Telescope, apparent_magnitude
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
ARCSEC = np.pi / 648000.0
AU, GM_SUN, GM_EARTH, LUNAR_KM = 149597870.7, 1.32712440018e11, 398600.4418, 384400.0
EPOCH = Epoch.parse("2026-03-21T10:25:00 UTC")  # midnight of Hawaii, which looks at what is opposite to the Sun
SITE = GroundSite.from_parallax(np.radians(203.74409), 0.936241, 0.351543)  # F51
HIGH = GeocentricOrbit(elements_epoch=EPOCH, a_km=6900.0, i_rad=1.70, node_rad=1.0, mean_anomaly_rad=2.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """An object and who sees it.

    Attributes
    ----------
    state : from the heliocentric state (6,) of the Earth to that of the object, ecliptic axes of J2000, `after_h` hours
        after the middle of the records.
    """

    name: str
    state: Callable[[Array], Array]
    H: float
    after_h: float = 0.0
    observer: Spacecraft = SITE
    code: str = "F51"
    count: int = 4
    minutes: float = 40.0
    sigma_arcsec: float = 0.4
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Made:
    """A file's text, and the truth: range and range rate at the middle of the records, heliocentric state, ICRF."""

    text: str
    range_au: float
    rate_km_s: float
    state: Array
    epoch: Epoch
    forces: ForceModel


def conic(
    line: tuple[float, float, float], q_au: float, e: float, turn_deg: float, inward: bool = False
) -> Callable[[Array], Array]:
    """An orbit about the Sun through a place given by longitude from opposition, latitude (deg) and range (au).

    Parameters
    ----------
    turn_deg : of the motion across, from the east to the north of the ecliptic.
    """

    def state(earth: Array) -> Array:
        lon = np.arctan2(earth[1], earth[0]) + np.radians(line[0])
        lat = np.radians(line[1])
        u = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
        r = earth[:3] + line[2] * AU * u
        d = float(np.linalg.norm(r))
        speed2 = GM_SUN * (2.0 / d - (1.0 - e) / (q_au * AU))
        across = np.sqrt(GM_SUN * q_au * AU * (1.0 + e)) / d
        along = np.sqrt(max(speed2 - across**2, 0.0)) * (-1.0 if inward else 1.0)
        radial = r / d
        east = np.cross([0.0, 0.0, 1.0], radial)
        east /= np.linalg.norm(east)
        turn = np.radians(turn_deg)
        v = along * radial + across * (np.cos(turn) * east + np.sin(turn) * np.cross(radial, east))
        return np.concatenate([r, v])

    return state


def about_earth(
    place_km: tuple[float, float, float], velocity_km_s: tuple[float, float, float]
) -> Callable[[Array], Array]:
    """A state from the Earth's: away from the Sun, along the Earth's motion, to the north."""

    def state(earth: Array) -> Array:
        out = earth[:3] / np.linalg.norm(earth[:3])
        north = np.array([0.0, 0.0, 1.0])
        axes = np.stack([out, np.cross(north, out), north], axis=1)
        return earth + np.concatenate([axes @ place_km, axes @ velocity_km_s])

    return state


def made(kind: Kind, ephemeris: Ephemeris) -> Made:
    """The records of an object."""
    forces = ForceModel(ephemeris=ephemeris)
    then = EPOCH + 3600.0 * kind.after_h
    earth, sun = (ephemeris.state_km_km_s(body, then, np.zeros(1))[0] for body in ("earth", "sun"))
    away = (earth - sun).reshape(2, 3) @ R_icrf_from_ecliptic  # to the ecliptic
    state = (kind.state(away.ravel()).reshape(2, 3) @ R_icrf_from_ecliptic.T).ravel()
    middle = -3600.0 * kind.after_h
    half = 60.0 * kind.minutes / 2.0
    t_s = middle + np.linspace(-half, half, kind.count)
    reference = int(np.argmin(np.abs(t_s - middle)))
    flown = follow(state, then, (min(float(t_s[0]), 0.0) - 1e5, max(float(t_s[-1]), 0.0) + 1.0), 0.0, forces, True)
    telescope = Telescope(name=kind.code, spacecraft=kind.observer, sigma_rad=kind.sigma_arcsec * ARCSEC)
    seen = compute(flown, Exposures.of(then, [(telescope, t_s)], ephemeris))
    noise = kind.sigma_arcsec * ARCSEC * np.random.default_rng(kind.seed).standard_normal((kind.count, 2))
    psi = seen.psi + noise / np.stack([np.cos(seen.psi[:, 1]), np.ones(kind.count)], axis=1)
    return Made(
        text=_text(kind, ephemeris, then, seen.t_s, psi, seen.telescope_state, seen.target_state),
        range_au=float(seen.distance_km[reference] / AU),
        rate_km_s=float(seen.u[reference] @ (seen.target_state - seen.telescope_state)[reference, 3:]),
        state=state,
        epoch=then,
        forces=forces,
    )


def _text(
    kind: Kind, ephemeris: Ephemeris, epoch: Epoch, t_s: Array, psi: Array, observer: Array, target: Array
) -> str:
    """PSV, with the place of who is no site."""
    placed = not isinstance(kind.observer, GroundSite)
    places = "sys|ctr|pos1|pos2|pos3|" if placed else ""
    lines = ["# version=2022", f"trkSub|mode|stn|{places}obsTime|ra|dec|rmsRA|rmsDec|astCat|mag|band"]
    sun, earth = (ephemeris.position_km(body, epoch, t_s) for body in ("sun", "earth"))
    line, r = target[:, :3] - observer[:, :3], target[:, :3] - sun
    far, d = np.linalg.norm(line, axis=1), np.linalg.norm(r, axis=1)
    phase = np.arccos(np.sum(line * r, axis=1) / far / d)
    V = apparent_magnitude(kind.H, 0.15, d, far, phase)
    for k in range(len(t_s)):
        at = (epoch + float(t_s[k])).iso("utc", 3).replace(" UTC", "Z")
        x, y, z = observer[k, :3] - earth[k]
        place = f"ICRF_KM|399|{x:.4f}|{y:.4f}|{z:.4f}|" if placed else ""
        ra, dec = np.degrees(psi[k, 0]) % 360.0, np.degrees(psi[k, 1])
        noise = f"{kind.sigma_arcsec}|{kind.sigma_arcsec}"
        lines.append(f"Kind1|CCD|{kind.code}|{place}{at}|{ra:.7f}|{dec:.7f}|{noise}|Gaia2|{V[k]:.1f}|V")
    return "\n".join(lines) + "\n"


def _straight(range_au: float, speed_km_s: float) -> Callable[[Array], Array]:
    """Comes from opposition straight at the Earth's middle, but slowly across: no motion on the sky but parallax."""
    return about_earth((range_au * AU, 0.0, 0.0), (-speed_km_s, 0.0, 0.0))


LEAVE_NOW = np.sqrt(2.0 * GM_EARTH / LUNAR_KM + 64.0)
KINDS = {
    kind.name: kind
    for kind in (
        Kind(name="temporary capture", state=about_earth((7e5, 3e5, 2e5), (-0.25, 0.70, 0.35)), H=29.5),
        Kind(name="satellite, 150,000 km", state=about_earth((140e3, 40e3, 30e3), (-0.3, 1.0, 0.6)), H=31.0),
        Kind(name="satellite, 42,164 km", state=about_earth((40e3, 13e3, 3e3), (-0.95, 2.92, 0.1)), H=31.5),
        Kind(name="interstellar, e = 3", state=conic((15.0, 10.0, 0.7), 1.2, 3.0, 60.0), H=21.0),
        Kind(name="comet, e = 1", state=conic((-20.0, 15.0, 1.1), 0.9, 1.0, 110.0, True), H=16.0),
        Kind(name="main belt", state=conic((10.0, 5.0, 1.6), 2.3, 0.15, 8.0), H=16.0),
        Kind(name="Trojan", state=conic((20.0, -8.0, 4.2), 4.9, 0.06, -10.0), H=12.0),
        Kind(
            name="flyby at 1 LD, 24 h before",
            state=about_earth((0.0, LUNAR_KM, 0.0), (-float(LEAVE_NOW), 0.0, 0.5)),
            H=27.0,
            after_h=24.0,
        ),
        Kind(
            name="flyby at 1 LD, 5 d before",
            state=about_earth((0.0, LUNAR_KM, 0.0), (-float(LEAVE_NOW), 0.0, 0.5)),
            H=27.0,
            after_h=120.0,
        ),
        Kind(
            name="impactor, 12 h before",
            state=about_earth((6110.0, -1500.0, 1300.0), (-15.5, 3.0, 2.5)),
            H=29.0,
            after_h=12.0,
        ),
        Kind(
            name="impactor, 3 h before",
            state=about_earth((6110.0, -1500.0, 1300.0), (-15.5, 3.0, 2.5)),
            H=31.0,
            after_h=3.0,
            minutes=25.0,
        ),
        Kind(name="opposition, still, 0.08 au", state=_straight(0.08, 9.0), H=24.0),
        Kind(name="opposition, 40 au", state=conic((0.5, 1.0, 40.0), 38.0, 0.1, 5.0), H=6.0, minutes=60.0),
        Kind(name="pole", state=conic((90.0, 66.5, 0.06), 0.9, 0.25, 25.0), H=23.0),
        Kind(
            name="space telescope, NEA",
            state=conic((40.0, 20.0, 0.08), 0.95, 0.3, 15.0),
            H=23.0,
            code="C51",
            observer=HIGH,
            count=4,
            minutes=50.0,
        ),
        Kind(
            name="space telescope, main belt",
            state=conic((40.0, 5.0, 1.7), 2.2, 0.12, 9.0),
            H=16.0,
            code="C51",
            observer=HIGH,
            count=4,
            minutes=50.0,
        ),
    )
}
