"""How far forces that are not in the model may move a virtual impactor: the asteroids beyond the sixteen that are.

The lightest of the sixteen are left out one by one; what each moves the hitting orbit in its target plane, in sigmas
and by its GM, stands for the others. JPL has 343 perturbers: the 327 that are not here have 48 km3/s2 in all, and 4.3
km3/s2 as the root of the sum of their squares. Other small forces are not looked at.
"""

from dataclasses import replace

import numpy as np

from nebosvod.dynamics.ephemeris import ASTEROIDS
from nebosvod.impacts.flight import Course
from nebosvod.impacts.hitting import HittingOrbit, plane_at

LIGHTEST = 6
GM_KM3_S2 = 4.3  # root of the sum of squares over 327 asteroids
MATTERS = 0.3  # sigmas, times sigmas: a change of ln P


def left_out_sigmas(course: Course, body: str, orbit: HittingOrbit) -> float | None:
    """By how many sigmas along the line they may move the point in the target plane; None where none is left out.

    Notes
    -----
    An asteroid without which the orbit has no such encounter tells nothing; where all are so, the answer is infinite.
    """
    given = course.orbit
    names = [name for name in ASTEROIDS if name not in given.settings.get("excluded", ())]
    if not given.settings.get("asteroids", True) or not names:
        return None
    size, along = np.linalg.svd(orbit.J, full_matrices=False)[1][0], np.linalg.svd(orbit.J)[0][:, 0]
    moved = []
    for name in sorted(names, key=lambda one: course.ephemeris.gm_km3_s2[one])[:LIGHTEST]:
        excluded = (*given.settings.get("excluded", ()), name)
        without = replace(course, orbit=replace(given, settings={**given.settings, "excluded": excluded}))
        there = plane_at(without, body, orbit.epoch, orbit.u)
        if there is not None:
            turn = orbit.plane.axes[[0, 2]] @ there[0].axes[[0, 2]].T
            shift = float((turn @ there[0].coordinates_km - orbit.plane.coordinates_km) @ along) / float(size)
            moved.append(shift / course.ephemeris.gm_km3_s2[name])
    return float(GM_KM3_S2 * np.sqrt(np.mean(np.square(moved)))) if moved else float("inf")


def left_out_words(sigmas: float | None, at: float | None) -> str:
    """What a reader must know of it; empty where it does not matter.

    Parameters
    ----------
    at : how many sigmas along the line the hits are.
    """
    if sigmas is None or sigmas * max(abs(at or 0.0), 1.0) < MATTERS:
        return ""
    far = f"{sigmas:.1g} sigmas" if np.isfinite(sigmas) else "many sigmas"
    return (
        f"asteroids that are not among the perturbers may move it by {far} along the line, and other small forces by "
        "more: the probability hangs on the force model, and no interval here knows of it"
    )
