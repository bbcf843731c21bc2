"""Make the orbit of the synthetic impactor of the missions `neomir-like` and `soda-like`, and print it.

The heliocentric orbit is that of the Chelyabinsk body (Popova et al. 2013, Science 342, 1069: q 0.739 au, e 0.581,
i 4.93 deg, node 326.4422 deg, argument of perihelion 108.3 deg) brought to 2030-02-15, with one more condition: at
ENTRY it stands 100 km above the Earth, going down at the elevation of 18 deg that Chelyabinsk had. Steps:

1. the velocity at infinity: of those elements, where they cross Earth's distance, less Earth's velocity;
2. the hyperbola with that incoming asymptote whose path makes the wanted angle with the horizon at 100 km, bent round
   the Earth on the northern side;
3. from there back in time by the propagator with all forces, to the reference epoch of the mission.
"""

import numpy as np

from nebosvod.dynamics import Ephemeris, ForceModel, propagate
from nebosvod.dynamics.constants import RADIUS_KM
from nebosvod.dynamics.elements import cometary_to_state, state_to_cometary
from nebosvod.dynamics.frames import R_icrf_from_ecliptic
from nebosvod.timescale import Epoch

ENTRY = Epoch.parse("2030-02-15T03:20:00 TDB")
REFERENCE = {"neomir-like": "2030-01-16T00:00:00 TDB", "soda-like": "2030-02-14T03:00:00 TDB"}
AU_KM, DEG = 149597870.7, np.pi / 180.0
ELEMENTS = {"e": 0.581, "q_au": 0.739, "node": 326.4422, "peri": 108.3, "i": 4.93}
ALTITUDE_KM, BELOW_HORIZON_DEG = 100.0, 18.3


def velocity_at_earth(ephemeris: Ephemeris) -> np.ndarray:
    """Heliocentric velocity (3,), ICRF, of the elements where they cross the Earth's distance on the way in or out."""
    gm = ephemeris.gm_km3_s2["sun"]
    sun = ephemeris.state_km_km_s("sun", ENTRY, np.zeros(1))[0]
    earth = ephemeris.state_km_km_s("earth", ENTRY, np.zeros(1))[0] - sun
    best: tuple[float, np.ndarray] = (np.inf, earth)
    for days in np.arange(-400.0, 400.0, 0.05):
        elements = np.array(
            [ELEMENTS["e"], ELEMENTS["q_au"] * AU_KM, days * 86400.0]
            + [ELEMENTS[k] * DEG for k in ("node", "peri", "i")]
        )
        state = cometary_to_state(elements, gm)[0]
        turned = np.concatenate([R_icrf_from_ecliptic @ state[:3], R_icrf_from_ecliptic @ state[3:]])
        gap = float(np.linalg.norm(turned[:3] - earth[:3]))
        if gap < best[0]:
            best = (gap, turned)
    print(f"the elements pass {best[0]:.3g} km from the Earth at the date")
    return best[1][3:] - earth[3:]


def entry_state(ephemeris: Ephemeris, v_infinity: np.ndarray) -> np.ndarray:
    """Geocentric state (6,) at the entry altitude on the hyperbola that comes in with `v_infinity`."""
    gm, r = ephemeris.gm_km3_s2["earth"], RADIUS_KM["earth"] + ALTITUDE_KM
    v_inf = float(np.linalg.norm(v_infinity))
    S = v_infinity / v_inf
    v = float(np.sqrt(v_inf**2 + 2.0 * gm / r))
    h = r * v * np.cos(BELOW_HORIZON_DEG * DEG)
    e = float(np.sqrt(1.0 + (h * v_inf / gm) ** 2))
    # the side on which it passes: towards the north pole, as seen along the way in
    pole = np.array([0.0, 0.0, 1.0])
    T = pole - (pole @ S) * S
    T /= np.linalg.norm(T)
    # true anomaly of the asymptote and of the entry, both before perigee
    f_inf = -np.arccos(-1.0 / e)
    f = -np.arccos((h * h / gm / r - 1.0) / e)
    # incoming: position direction -S at f_inf; the motion turns from there towards T
    turn = f - f_inf
    up = -S * np.cos(turn) + T * np.sin(turn)
    ahead = S * np.sin(turn) + T * np.cos(turn)
    radial = gm / h * e * np.sin(f)
    return np.concatenate([r * up, radial * up + h / r * ahead])


def main() -> None:
    """Print the states."""
    ephemeris = Ephemeris.load()
    forces = ForceModel(ephemeris=ephemeris)
    v_infinity = velocity_at_earth(ephemeris)
    relative = entry_state(ephemeris, v_infinity)
    sun = ephemeris.state_km_km_s("sun", ENTRY, np.zeros(1))[0]
    start = relative + ephemeris.state_km_km_s("earth", ENTRY, np.zeros(1))[0] - sun
    print(f"v_infinity {np.linalg.norm(v_infinity):.3f} km/s, at entry {np.linalg.norm(relative[3:]):.3f} km/s")
    for name, text in REFERENCE.items():
        epoch = Epoch.parse(text)
        state = propagate(start, ENTRY, np.array([epoch - ENTRY]), forces, sensitivities=False).state[0]
        print(name, text)
        print("      position: [" + ", ".join(f"{x:.6f} km" for x in state[:3]) + "]")
        print("      velocity: [" + ", ".join(f"{x:.12f} km/s" for x in state[3:]) + "]")
        back = np.concatenate([R_icrf_from_ecliptic.T @ state[:3], R_icrf_from_ecliptic.T @ state[3:]])
        e, q, _, node, peri, i = state_to_cometary(back, ephemeris.gm_km3_s2["sun"])[0]
        angles = f"i {i / DEG:.3f}, node {node / DEG % 360:.3f}, peri {peri / DEG:.3f}"
        print(f"      q {q / AU_KM:.4f} au, e {e:.4f}, {angles}")


if __name__ == "__main__":
    main()
