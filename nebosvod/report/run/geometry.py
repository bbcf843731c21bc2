"""Where everything was: plan view of the ecliptic, and distance and Sun angle of each measurement."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.report.kit import wording
from nebosvod.report.kit.chart import Chart, Panel
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import BLUE, GREEN, GREY, ORANGE, SERIES, Plate, thin
from nebosvod.report.kit.scale import calendar, linear
from nebosvod.report.kit.wording import quantity
from nebosvod.results.folder import Array, RunFolder
from nebosvod.timescale import SECONDS_PER_DAY

AU_KM = 1.495978707e8
OBLIQUITY_RAD = np.radians(84381.448 / 3600.0)  # IAU 1976, the J2000 ecliptic of JPL's orbits
SIGHT_LINES = 9
NEAR_EARTH_KM = 3.0e6  # twice the L1 distance: a telescope inside it cannot be told from the Earth at this scale


def plan_view(run: RunFolder) -> Plate | None:
    """Sun, Earth, telescopes and the asteroid's arc, seen from the north pole of the ecliptic, equal axes."""
    arc, place = run.array("object_track_km"), run.array("telescope_position_km")
    earth, state, index = run.array("earth_position_km"), run.array("state"), run.array("telescope_index")
    if arc is None or place is None or earth is None or state is None or index is None or not len(place):
        return None
    remote = [i for i in range(len(run.telescopes)) if _is_remote(place, earth, index == i)]
    paths = {"Earth": plan(earth)[thin(len(earth), 300)], "asteroid": plan(arc)[thin(len(arc), 400)]}
    paths |= {run.telescopes[i]: _unbroken(plan(place[index == i])) for i in remote}
    every = np.vstack([np.zeros((1, 2)), *paths.values()])
    middle = 0.5 * (np.nanmin(every, axis=0) + np.nanmax(every, axis=0))
    half = 0.54 * float(np.max(np.nanmax(every, axis=0) - np.nanmin(every, axis=0)))
    x = linear([middle[0] - half, middle[0] + half], "towards the equinox, au", pad=0.0)
    y = linear([middle[1] - half, middle[1] + half], "90° ahead in the ecliptic, au", pad=0.0)
    chart = Chart("geometry", width=334.0, height=0.0)
    panel = chart.panel(x, y, top=8.0, bottom=278.0, left=58.0, right=328.0)
    looks = _draw_tracks(panel, paths, place, state, run.telescopes)
    chart.height = chart.legend(looks, 322.0, 54.0)
    names = [name for name, path in paths.items() for _ in path]
    points = np.vstack(list(paths.values()))
    return chart.plate(
        "Plan view of the ecliptic: Sun, Earth, telescopes and the arc of the asteroid",
        _plan_caption(run, arc, place, earth, state, remote),
        [csv("plan-view", {"track": names, "x_au": points[:, 0], "y_au": points[:, 1]})],
    )


def plan(position_km: Array) -> Array:
    """ICRF positions (..., 3) in km -> ecliptic x, y (..., 2) in au."""
    y = position_km[..., 1] * np.cos(OBLIQUITY_RAD) + position_km[..., 2] * np.sin(OBLIQUITY_RAD)
    return np.stack([position_km[..., 0], y], axis=-1) / AU_KM


def _unbroken(points: Array) -> Array:
    """Points (n, 2) of a path, thinned, with a break (NaN) where a telescope did not measure for long."""
    points = points[thin(len(points), 300)]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    gaps = np.flatnonzero(steps > 5.0 * np.median(steps)) if len(steps) else np.empty(0, dtype=int)
    return np.insert(points, gaps + 1, np.nan, axis=0)


def _is_remote(place: Array, earth: Array, mine: Any) -> bool:
    """True for a telescope that the plan view can show apart from the Earth."""
    return bool(np.any(mine)) and float(np.max(np.linalg.norm(place[mine] - earth[mine], axis=1))) > NEAR_EARTH_KM


def _draw_tracks(
    panel: Panel, paths: Mapping[str, Array], place: Array, state: Array, telescopes: list[str]
) -> list[tuple[str, str, dict[str, Any]]]:
    """Sun, Earth's path, telescopes, lines of sight and the asteroid with its measured part heavier; what to name."""
    for k in np.unique(np.linspace(0, len(place) - 1, SIGHT_LINES).astype(int)):
        x, y = np.stack([plan(place[k]), plan(state[k, :3])], axis=1)
        panel.line(x, y, stroke=GREY, stroke_width=0.5)
    panel.open()
    panel.dots([0.0], [0.0], "o", "Sun", color=ORANGE, size=11.0)
    looks: list[tuple[str, str, dict[str, Any]]] = [("o", "Sun", {"color": ORANGE, "size": 11.0})]
    for name, path in paths.items():
        own = telescopes.index(name) if name in telescopes else None
        colour = {"Earth": GREEN, "asteroid": BLUE}.get(name) or SERIES[(own or 0) % len(SERIES)][0]
        dash = {} if name == "asteroid" else {"stroke_dasharray": "6 2" if name == "Earth" else "2 2"}
        look: dict[str, Any] = {"stroke": colour, "stroke_width": 1.1 if name == "asteroid" else 1.6, **dash}
        panel.line(path[:, 0], path[:, 1], name, **look)
        if name != "asteroid":
            end = path[np.isfinite(path[:, 0])][-1]
            panel.dots([end[0]], [end[1]], "o", f"{name}, last measurement", color=colour, size=6.0)
        looks.append(("line", name, look))
    seen = plan(state[:, :3])
    few = seen[thin(len(seen), 300)]
    panel.dots(few[:, 0], few[:, 1], "o", "measured", color=BLUE, size=2.8)
    panel.dots([seen[0, 0]], [seen[0, 1]], "O", "first measurement", color=BLUE)
    panel.dots([seen[-1, 0]], [seen[-1, 1]], "o", "last measurement", color=BLUE, size=6.5)
    panel.close()
    return [*looks, ("O", "first", {"color": BLUE}), ("o", "last measurement", {"color": BLUE, "size": 6.5})]


def _plan_caption(run: RunFolder, arc: Array, place: Array, earth: Array, state: Array, remote: list[int]) -> Markup:
    """Dates and distances at both ends, and which telescopes are too near the Earth to be seen apart."""
    t = run.array("epoch_s")
    ends = [float(np.linalg.norm(state[k, :3] - place[k])) for k in (0, -1)]
    dates = [wording.date((run.epoch + float(t[k])).iso()) if t is not None else "" for k in (0, -1)]
    text = Markup(
        "Seen from ecliptic north. The asteroid is {} from the observing telescope at the first "
        "measurement ({}) and {} at the last ({}); thin grey lines are lines of sight."
    ).format(quantity(ends[0], "km"), dates[0], quantity(ends[1], "km"), dates[1])
    near = [name for i, name in enumerate(run.telescopes) if i not in remote]
    if near:
        far = float(np.max(np.linalg.norm(place - earth, axis=1))) if not remote else None
        inside = Markup(", within {} of the Earth,").format(quantity(far, "km")) if far else ""
        text += Markup(" {}{} cannot be told from the Earth at this scale.").format(wording.join(near), inside)
    return text


def viewing(run: RunFolder) -> Plate | None:
    """Distance and Sun angle of the asteroid at each measurement, by telescope."""
    place, state, index, t = (run.array(n) for n in ("telescope_position_km", "state", "telescope_index", "epoch_s"))
    if place is None or state is None or index is None or t is None or np.ptp(t if len(t) else [0.0]) == 0.0:
        return None
    look = state[:, :3] - place
    distance = np.linalg.norm(look, axis=1)
    cosine = -np.sum(look * place, axis=1) / distance / np.linalg.norm(place, axis=1)
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    chart = Chart("viewing", width=334.0, height=0.0)
    dates = calendar(run.epoch, t, most=4.0)
    upper = chart.panel(
        dates.silenced(), linear([0.0, *(distance / AU_KM)], "distance, au"), top=8.0, bottom=138.0, left=58.0
    )
    lower = chart.panel(dates, linear(angle, "angle from the Sun, °"), top=152.0, bottom=278.0, left=58.0)
    for panel, series in ((upper, distance / AU_KM), (lower, angle)):
        panel.open()
        for i, name in enumerate(run.telescopes):
            mine = np.flatnonzero(index == i)
            few, (colour, marker) = thin(len(mine), 400), SERIES[i % len(SERIES)]
            # a second telescope at the same place stays visible inside the first one's marker
            panel.dots(t[mine][few] / SECONDS_PER_DAY, series[mine][few], marker, name, color=colour,
                       size=4.4 if i == 0 else 2.2)  # fmt: skip
        panel.close()
    used = [i for i in range(len(run.telescopes)) if np.any(index == i)]
    chart.height = chart.legend(
        [(SERIES[i % 6][1], run.telescopes[i], {"color": SERIES[i % 6][0], "size": 5.0}) for i in used], 322.0, 54.0
    )
    nearest, farthest = int(np.argmin(distance)), int(np.argmax(distance))
    caption = Markup(
        "Every measurement: the asteroid is between {} and {} from the telescope and between {} "
        "and {} from the Sun in the sky."
    ).format(
        quantity(float(distance[nearest]), "km"),
        quantity(float(distance[farthest]), "km"),
        quantity(float(angle.min()), "deg"),
        quantity(float(angle.max()), "deg"),
    )
    few = thin(len(t))
    columns = {"days_after_reference": (t / SECONDS_PER_DAY)[few], "telescope": [run.telescopes[i] for i in index[few]],
               "distance_km": distance[few], "sun_angle_deg": angle[few]}  # fmt: skip
    label = "Distance and Sun angle of the asteroid at each measurement"
    return chart.plate(label, caption, [csv("viewing", columns)])
