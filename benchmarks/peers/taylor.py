"""heyoka behind the two calls of peers/programs.py."""

import importlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from peers.cases import A123, EPOCH, Array
from peers.programs import AU_D_KM_S, Bodies

from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.constants import AU_KM, DAY_S, SPEED_OF_LIGHT_KM_S
from nebosvod.dynamics.ephemeris import PLANETS

SUN_NAMES = ("x_0", "y_0", "z_0", "vx_0", "vy_0", "vz_0")


class Heyoka:
    """heyoka: Taylor series compiled for this system; X, or X with the 36 equations of Phi, tolerance 1e-15.

    It reads no DE440: Sun, planets, Moon and Pluto start from it and are integrated along as Newtonian points, the
    asteroid with the Sun's relativity and A1-A3. No asteroids, no oblateness. Compiling comes before the times.
    Only the asteroid's own variations are integrated; `var_ode_sys` would carry those of all twelve bodies.
    """

    def __init__(self, asteroids: Bodies) -> None:
        if asteroids != "none":
            raise RuntimeError("sixteen more bodies would have to be integrated along")
        self.hy = importlib.import_module("heyoka")
        ephemeris = Ephemeris.load()
        self.gm = [ephemeris.gm_km3_s2[body] * DAY_S**2 / AU_KM**3 for body in PLANETS]
        states = [np.reshape(ephemeris.state_km_km_s(body, EPOCH, 0.0), 6) / AU_D_KM_S for body in PLANETS]
        self.start = np.concatenate(states)
        self.integrators = {}
        for partials in (False, True):
            begin = time.perf_counter()
            initial = np.zeros(72 + 36 * partials)
            self.integrators[partials] = self.hy.taylor_adaptive(
                self.system(partials), initial, tol=1e-15, compact_mode=True
            )
            spent = time.perf_counter() - begin
            print(f"heyoka compiled {'X, Phi' if partials else 'X'} in {spent:.1f} s", flush=True)

    def system(self, partials: bool) -> list[tuple[Any, Any]]:
        """Equations of the eleven bodies and of the asteroid, au and d."""
        hy, last = self.hy, len(self.gm)
        equations = hy.model.nbody(last + 1, masses=self.gm, Gconst=1.0)
        names = [f"{axis}_{last}" for axis in ("x", "y", "z", "vx", "vy", "vz")]
        own = hy.make_vars(*names)
        relative = [a - b for a, b in zip(own, hy.make_vars(*SUN_NAMES))]
        d, w = relative[:3], relative[3:]
        c2, gm = (SPEED_OF_LIGHT_KM_S * DAY_S / AU_KM) ** 2, self.gm[0]
        r2, w2, dw = (hy.sum([a * b for a, b in zip(u, v)]) for u, v in ((d, d), (w, w), (d, w)))
        r = hy.sqrt(r2)
        h = [d[1] * w[2] - d[2] * w[1], d[2] * w[0] - d[0] * w[2], d[0] * w[1] - d[1] * w[0]]
        size = hy.sqrt(hy.sum([a * a for a in h]))
        t = [h[1] * d[2] - h[2] * d[1], h[2] * d[0] - h[0] * d[2], h[0] * d[1] - h[1] * d[0]]
        for k in range(3):
            relativity = gm / (c2 * r2 * r) * ((4.0 * gm / r - w2) * d[k] + 4.0 * dw * w[k])
            law = (A123[0] * d[k] / r + A123[1] * t[k] / (size * r) + A123[2] * h[k] / size) / r2
            variable, acceleration = equations[6 * last + 3 + k]
            equations[6 * last + 3 + k] = (variable, acceleration + relativity + law)
        if partials:
            phi = [hy.make_vars(*(f"phi_{i}_{j}" for j in range(6))) for i in range(6)]
            for i in range(3):
                rows = [hy.diff(equations[6 * last + 3 + i][1], variable) for variable in own]
                for j in range(6):
                    equations.append((phi[i][j], phi[i + 3][j]))
                    equations.append((phi[i + 3][j], hy.sum([rows[k] * phi[k][j] for k in range(6)])))
        return list(equations)

    def prepare(self, start: Array, days: float, partials: bool) -> Callable[[], Any]:
        """Its integrator, set to the start."""
        integrator = self.integrators[partials]
        integrator.time = 0.0
        integrator.state[:72] = np.concatenate([self.start, start / AU_D_KM_S + self.start[:6]])
        if partials:  # row by row of Phi: (i, j) and (i + 3, j) in turn
            integrator.state[72:] = np.stack([np.eye(6)[:3], np.eye(6)[3:]], axis=2).ravel()

        def run() -> Array:
            integrator.propagate_until(days)
            return np.array(integrator.state[66:69] - integrator.state[:3])

        return run

    def position_km(self, result: Array) -> Array:
        """In km."""
        return result * AU_KM
