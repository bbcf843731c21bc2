"""Telescopes that cannot be told from the Earth at the scale of orbits: their places about it, to scale."""

from typing import Any

import numpy as np

from nebosvod.dynamics.constants import AU_KM, EARTH_RADIUS_KM
from nebosvod.dynamics.frames import R_ecliptic_from_icrf
from nebosvod.report.kit.plate import BLUE, GREEN, GREY, INK, ORANGE, SERIES, thin
from nebosvod.report.kit.sight import Cone, Disc, Marks, Sight, Thing, Track
from nebosvod.results.folder import Array, RunFolder

NEAR_KM = 0.06 * AU_KM  # nearer than this a telescope stands in the picture about the Earth
GROUND = 1.02  # Earth radii, up to which a telescope is a station on the ground
MOON_KM, LAGRANGE_KM = 384400.0, 1.4966e6
RESOLVED = 0.4  # of its distance: a telescope that moves less between two measurements is drawn as a line
SIZES = (5.4, 3.0, 3.6, 3.0, 3.0, 3.0)


def is_near(place: Array, earth: Array) -> bool:
    """Whether a telescope (n, 3) stays near the Earth (n, 3), km."""
    return bool(len(place)) and float(np.max(np.linalg.norm(place - earth, axis=1))) < NEAR_KM


def near_earth(run: RunFolder) -> Sight | None:
    """Telescopes near the Earth in axes that turn with it (away from the Sun, along its motion, north); None."""
    place, earth, index = (run.array(n) for n in ("telescope_position_km", "earth_position_km", "telescope_index"))
    state, fitted = run.array("state"), run.array("object_position_km")
    at = state[:, :3] if state is not None else fitted
    if place is None or earth is None or index is None or at is None:
        return None
    near = shown_near(run)
    if not near:
        return None
    turned = _turned(place - earth, earth)
    far = max(float(np.linalg.norm(turned[index == i], axis=1).max()) for i in near)
    half = 1.18 * max(far, 1.25 * EARTH_RADIUS_KM)
    factor, unit = (1e-6, "10⁶ km") if half > 1e6 else (1e-3, "10³ km") if half > 1.2e4 else (1.0, "km")
    first = np.flatnonzero(index == near[0])
    ends = np.array([first[0], first[-1]])
    looking = _turned(at[ends] - place[ends], earth[ends])
    things: list[Thing] = [*_limits(run, near, turned, index, factor), *_surroundings(half, factor)]
    things += _looks(turned[ends], looking, half, factor)
    for k, i in enumerate(near):
        things += _telescope(run.telescopes[i], i, factor * turned[index == i], SIZES[k % len(SIZES)])
    inside = np.concatenate([turned[index == i] for i in near])[:, 2]
    reach = max(1.1 * float(np.abs(inside).max()), min(1.4 * EARTH_RADIUS_KM, half)) * factor
    return Sight(
        names=(f"away from the Sun, {unit}", f"along the Earth's motion, {unit}", f"north, {unit}"),
        middle=np.zeros(2), half=half * factor, low=-reach, high=reach, things=things,
    )  # fmt: skip


def shown_near(run: RunFolder) -> list[int]:
    """Numbers of the telescopes that stand in the picture about the Earth; of a fit no stations on the ground."""
    place, earth, index = (run.array(n) for n in ("telescope_position_km", "earth_position_km", "telescope_index"))
    if place is None or earth is None or index is None:
        return []
    mine = {i: index == i for i in range(len(run.telescopes))}
    near = [i for i, rows in mine.items() if np.any(rows) and is_near(place[rows], earth[rows])]
    if run.array("state") is not None:
        return near
    return [i for i in near if np.linalg.norm((place - earth)[mine[i]], axis=1).max() > GROUND * EARTH_RADIUS_KM]


def _turned(vectors: Array, earth: Array) -> Array:
    """ICRF vectors (n, 3) in the axes that turn with the Earth at (n, 3)."""
    x = earth @ R_ecliptic_from_icrf.T
    v = vectors @ R_ecliptic_from_icrf.T
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross([0.0, 0.0, 1.0], x)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    axes = np.stack([x, y, np.cross(x, y)], axis=1)
    return np.asarray(np.einsum("nij,nj->ni", axes, v))


def _surroundings(half: float, factor: float) -> list[Thing]:
    """The Earth to scale, the Moon's orbit, L1 and L2, as far as they lie in the picture."""
    turn = np.linspace(0.0, 2.0 * np.pi, 91)
    ring = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    look: dict[str, Any] = {"fill": "#cfd8e3", "stroke": "#4a5a6a", "stroke_width": 0.8}
    things: list[Thing] = [Disc(name="", centre=np.zeros(3), radius=EARTH_RADIUS_KM * factor, look=look)]
    text = "Earth" if half > 3.0 * EARTH_RADIUS_KM else ""
    if 0.02 * half > EARTH_RADIUS_KM:
        things.append(Marks(name="", points=np.zeros((1, 3)), marker="o", look={"color": GREEN, "size": 5.0}))
    things.append(Marks(name="", points=np.zeros((1, 3)), marker="|", look={"color": "none"}, text=text))
    if 0.04 * half < MOON_KM < 1.3 * half:
        look = {"stroke": GREY, "stroke_width": 0.8, "stroke_dasharray": "2 3"}
        things.append(Track(name="mean distance of the Moon", points=MOON_KM * factor * ring, look=look))
    if 1.1 * half > LAGRANGE_KM:
        for side, name in ((-1.0, "L1"), (1.0, "L2")):
            at = np.array([[side * LAGRANGE_KM * factor, 0.0, 0.0]])
            shown = name if 0.4 * half < LAGRANGE_KM else ""
            things.append(Marks(name="", points=at, marker="P", look={"color": INK}, text=shown))
    return things


def _telescope(name: str, i: int, points: Array, size: float) -> list[Thing]:
    """Where one telescope measured; a line as well where its motion can be followed."""
    colour, marker = SERIES[(i + 1) % len(SERIES)]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    things: list[Thing] = []
    if len(steps) and float(np.median(steps)) < RESOLVED * float(np.median(np.linalg.norm(points, axis=1))):
        gaps = np.flatnonzero(steps > max(5.0 * float(np.median(steps)), 1e-12)) + 1
        look = {"stroke": colour, "stroke_width": 0.9, "opacity": 0.5}
        things.append(Track(name="", points=np.insert(points, gaps, np.nan, axis=0), look=look))
    few = points[thin(len(points), 250)]
    look = {"color": colour, "size": size, "hollow": size > 5.0, "opacity": 0.8}
    return [*things, Marks(name=name, points=few, marker=marker, look=look)]


def _looks(places: Array, looking: Array, half: float, factor: float) -> list[Thing]:
    """Where the object was: lines from the telescope towards it, at the first and the last measurement."""
    things: list[Thing] = []
    for k, dashes in ((0, "2 3"), (-1, "")):
        if len(looking) == 2 and k == 0 and np.allclose(places[0], places[1]) and np.allclose(looking[0], looking[1]):
            continue
        way = looking[k] / np.linalg.norm(looking[k])
        ends = factor * np.stack([places[k], places[k] + 4.0 * half * way])
        look: dict[str, Any] = {"stroke": BLUE, "stroke_width": 1.2}
        look |= {"stroke_dasharray": dashes} if dashes else {}
        name = "to the asteroid, last" if k else "to the asteroid, first"
        things.append(Track(name=name, points=ends, look=look))
    return things


def _limits(run: RunFolder, near: list[int], turned: Array, index: Array, factor: float) -> list[Thing]:
    """What the first telescope with limits cannot see about Sun and Earth, at its last measurement."""
    rows = {row["telescope"]: row.get("limits_deg") or {} for row in run.summary.get("visibility") or []}
    for i in near:
        name = run.telescopes[i]
        limits, at = rows.get(name, {}), turned[np.flatnonzero(index == i)[-1]]
        whose = f" by {name}" if len(run.telescopes) > 1 else ""
        cones: list[Thing] = []
        if limits.get("sun"):
            said = f"not seen{whose}: within {limits['sun']:g}° of the Sun"
            cones.append(Cone(name=said, apex=at * factor, axis=np.array([-1.0, 0.0, 0.0]), inner_rad=0.0,
                              outer_rad=np.radians(limits["sun"]), color=ORANGE))  # fmt: skip
        distance = float(np.linalg.norm(at))
        if limits.get("earth") is not None and distance > 1.01 * EARTH_RADIUS_KM:
            wide = np.radians(limits["earth"]) + np.arcsin(EARTH_RADIUS_KM / distance)
            said = f"not seen{whose}: within {limits['earth']:g}° of the Earth's limb"
            cones.append(Cone(name=said, apex=at * factor, axis=-at, inner_rad=0.0, outer_rad=float(wide), color=GREEN))
        if cones:
            return cones
    return []
