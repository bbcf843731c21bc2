"""Where everything was: plan view of the ecliptic, and distance and Sun angle of each measurement."""

from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.report import wording
from nebosvod.report.folder import Array, RunFolder
from nebosvod.report.plate import BLUE, GREEN, GREY, INK, ORANGE, SERIES, Plate, figure, plate, thin, time_axis
from nebosvod.report.wording import quantity
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
    fig = figure(4.5, 4.7, bottom_in=0.98)
    axes = fig.subplots()
    _draw_tracks(axes, arc, earth, state)
    remote = [i for i in range(len(run.telescopes)) if _is_remote(place, earth, index == i)]
    for i in remote:
        mine = _unbroken(plan(place[index == i]))
        axes.plot(*mine.T, color=SERIES[i % 6][0], lw=1.4, ls=(0, (1, 1)), label=run.telescopes[i])
        axes.plot(*mine[-1], SERIES[i % 6][1], color=SERIES[i % 6][0], ms=5)
    for k in np.unique(np.linspace(0, len(place) - 1, SIGHT_LINES).astype(int)):
        axes.plot(*np.stack([plan(place[k]), plan(state[k, :3])], axis=1), color=GREY, lw=0.5, zorder=1)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("towards the equinox, au")
    axes.set_ylabel("90° ahead in the ecliptic, au")
    fig.legend(loc="lower center", ncols=4, handlelength=1.4, columnspacing=1.2)
    return plate(
        fig,
        "geometry",
        "Plan view of the ecliptic: Sun, Earth, telescopes and the arc of the asteroid",
        _plan_caption(run, arc, place, earth, state, remote),
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


def _draw_tracks(axes: Any, arc: Array, earth: Array, state: Array) -> None:
    """Sun, Earth's path and the asteroid's, with the measured part heavier."""
    axes.plot(0, 0, "o", color=ORANGE, ms=9, mec=INK, mew=0.6, ls="", label="Sun")
    path = plan(earth)[thin(len(earth), 300)]
    axes.plot(*path.T, color=GREEN, lw=1.6, ls=(0, (5, 1.5)), label="Earth")
    axes.plot(*plan(earth[-1]), "o", color=GREEN, ms=5)
    axes.plot(*plan(arc)[thin(len(arc), 400)].T, color=BLUE, lw=1.0, alpha=0.7, label="asteroid")
    seen = plan(state[:, :3])
    axes.plot(*seen[thin(len(seen), 300)].T, "o", color=BLUE, ms=2.2, mew=0, label="measured")
    axes.plot(*seen[0], "o", mfc="white", mec=BLUE, ms=5.5, label="first")
    axes.plot(*seen[-1], "o", color=BLUE, ms=5.5, label="last")


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
    fig = figure(4.5, 4.0, rows=2)
    upper, lower = fig.subplots(2, 1, sharex=True)
    for i, name in enumerate(run.telescopes):
        mine = np.flatnonzero(index == i)
        colour, marker = SERIES[i % 6]
        few = thin(len(mine), 600)
        size = (
            3.6 if i == 0 else 1.8
        )  # a second telescope at the same place stays visible inside the first one's marker
        upper.plot(
            t[mine][few] / SECONDS_PER_DAY,
            distance[mine][few] / AU_KM,
            marker,
            ms=size,
            mew=0,
            color=colour,
            label=name,
        )
        lower.plot(t[mine][few] / SECONDS_PER_DAY, angle[mine][few], marker, ms=size, mew=0, color=colour)
    upper.set_ylabel("distance, au")
    upper.set_ylim(0, 1.08 * float(distance.max()) / AU_KM)
    upper.legend(loc="best", markerscale=2, handletextpad=0.2)
    lower.set_ylabel("angle from the Sun, °")
    time_axis(lower, run.epoch, t)
    fig.align_ylabels()
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
    return plate(fig, "viewing", "Distance and Sun angle of the asteroid at each measurement", caption)
