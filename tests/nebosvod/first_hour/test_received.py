"""From where light comes: the equation of light time by bisection along a body that moves on a parabola."""

import numpy as np
import pytest
from scipy.optimize import brentq

from nebosvod.first_hour.received import fill_lines, fill_offsets

C_KM_S, GM_SUN, AU = 299792.458, 1.32712440018e11, 149597870.7


def test_light_left_when_its_way_takes_as_long_as_it_is_ago() -> None:
    """Late clocks move body and observer; a displaced observer is elsewhere. Angles by arctan2 of dot products."""
    rng = np.random.default_rng(5)
    m, n = 3, 4
    flown = np.concatenate([AU * rng.uniform(-2, 2, (m, n, 3)), 20.0 * rng.standard_normal((m, n, 3))], axis=2)
    sun = np.hstack([1e6 * rng.standard_normal((n, 3)), 0.01 * rng.standard_normal((n, 3))])
    sun_pull = 1e-9 * rng.standard_normal((n, 3))
    observer = np.hstack([AU * rng.uniform(-1, 1, (n, 3)), 20.0 * rng.standard_normal((n, 3))])
    late, displaced = rng.standard_normal((m, n)), 100.0 * rng.standard_normal((m, n, 3))
    line, motion = np.empty((m, n, 3)), np.empty((m, n, 3))
    fill_lines(flown, sun, sun_pull, observer, GM_SUN, late, displaced, line, motion)
    axes = np.linalg.qr(rng.standard_normal((n, 3, 3)))[0]
    distance, offset = np.empty((m, n)), np.empty((m, n, 2))
    fill_offsets(line, axes, distance, offset)
    for o in range(m):
        for e in range(n):
            r, v = flown[o, e, :3] + sun[e, :3], flown[o, e, 3:] + sun[e, 3:]
            a = -GM_SUN * flown[o, e, :3] / np.linalg.norm(flown[o, e, :3]) ** 3 + sun_pull[e]
            t = late[o, e]
            r = r + v * t + 0.5 * a * t * t
            place = observer[e, :3] + t * observer[e, 3:] + displaced[o, e]

            def way(tau: float, r=r, v=v, a=a, place=place):  # type: ignore[no-untyped-def]
                return r - tau * v + 0.5 * tau**2 * a - place

            tau = brentq(lambda x, way=way: float(np.linalg.norm(way(x)) - C_KM_S * x), 0.0, 1e5, xtol=1e-9)
            assert line[o, e] == pytest.approx(way(tau), abs=1e-4)
            assert motion[o, e] == pytest.approx(v - observer[e, 3:], rel=1e-13)
            assert distance[o, e] == pytest.approx(C_KM_S * tau, rel=1e-12)
            u = axes[e] @ line[o, e] / distance[o, e]
            angle = np.arctan2(np.linalg.norm(np.cross(u, [0.0, 0.0, 1.0])), u[2])
            assert np.hypot(*offset[o, e]) == pytest.approx(angle, rel=1e-12)
            assert np.arctan2(*offset[o, e]) == pytest.approx(np.arctan2(u[0], u[1]), abs=1e-12)
    bare = np.empty((m, n, 3))
    fill_lines(flown, sun, sun_pull, observer, GM_SUN, np.empty((0, 0)), np.empty((0, 0, 0)), bare, motion)
    fill_lines(flown, sun, sun_pull, observer, GM_SUN, 0.0 * late, 0.0 * displaced, line, motion)
    assert bare == pytest.approx(line, rel=1e-14)
