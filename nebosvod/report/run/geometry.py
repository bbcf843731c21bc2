"""Where everything was: orbits, telescopes, Sun, what cannot be seen, the encounter; from above and from the side."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.dynamics.constants import AU_KM
from nebosvod.dynamics.frames import R_ecliptic_from_icrf
from nebosvod.report.kit import planets, wording
from nebosvod.report.kit.chart import WIDE, Chart, fitted
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import BLUE, GREEN, GREY, ORANGE, SERIES, VERMILION, Plate, thin
from nebosvod.report.kit.sight import Cone, Marks, Sight, Thing, Track, draw, entries
from nebosvod.report.kit.wording import number, quantity
from nebosvod.report.run.near_earth import is_near, near_earth, shown_near
from nebosvod.results.folder import Array, RunFolder
from nebosvod.timescale import Epoch

GM_SUN_KM3_S2 = 1.32712440041e11  # DE440; for the shape of an orbit in a picture
SIGHT_LINES = 7
SEVERAL = 1.05  # revolutions, from which on what was measured is drawn as dots by time
MOST_DOTS = 400
MOST_NAMED = 6  # telescopes by name in a caption
SHADES = ("#9bc8e8", "#4aa3d8", "#0072B2", "#08306b")  # of dots by time, the oldest palest
CLOSE_AU = 0.06  # encounters nearer to each other cannot be told apart
FAR = 1.7  # an orbit that reaches so many times farther than all the rest is cut at the edge
TRACK: dict[str, Any] = {"stroke": BLUE, "stroke_width": 2.4}
ORBIT: dict[str, Any] = {"stroke": BLUE, "stroke_width": 0.9, "stroke_dasharray": "5 3"}
PLANET: dict[str, Any] = {"stroke": GREEN, "stroke_width": 0.9, "stroke_dasharray": "5 3"}


def geometry_plate(run: RunFolder) -> Plate | None:
    """The geometry of a run as a figure of its page; None where it has no measurement."""
    if geometry_chart(run) is None:
        return None
    return fitted(
        lambda width: geometry_chart(run, width) or Chart("geometry"),
        _title(run),
        _caption(run),
        [_data(run)],
    )


def _title(run: RunFolder) -> str:
    """What the figure shows: sites on the ground are not drawn, and there may be no encounter."""
    found = places_of(run)
    drawn = bool(shown_near(run)) or (found is not None and bool(_telescopes(run, *found[1:4], turns=0.0)))
    parts = ["Sun", "orbits", *["telescopes"] * drawn, *["encounter"] * bool(_encounters(run))]
    return f"Geometry from above and from the side: {wording.join(parts)}"


def geometry_chart(run: RunFolder, width: float = WIDE) -> Chart | None:
    """Draw the geometry of a run; None where it has no measurement.

    Parameters
    ----------
    width : px; from 600 on the neighbourhood of the Earth stands beside the Solar System, else below it.
    """
    system = _solar_system(run)
    if system is None:
        return None
    near = near_earth(run)
    chart = Chart("geometry", width=width, height=0.0)
    beside = width > 600.0
    title = "from ecliptic north, and from the side"
    size = (width - 2 * 58.0 - 26.0) / 2.0 if beside and near else min(width - 58.0 - 12.0, 400.0)
    if not near:
        below = draw(chart, system, left=58.0, top=20.0, size=size, title=title)
        if beside:  # the legend has room at the right
            chart.height = max(below, chart.legend(entries(system.things), 30.0, 58.0 + size + 40.0))
            return chart
    else:
        below = draw(chart, system, left=58.0, top=20.0, size=size, title=title)
        words = "about the Earth, turning with it around the Sun"
        if beside:
            below = max(below, draw(chart, near, left=width - 12.0 - size, top=20.0, size=size, title=words))
        else:
            below = draw(chart, near, left=58.0, top=below + 22.0, size=size, title=words)
    things = [*system.things, *(near.things if near else ())]
    chart.height = chart.legend(entries(things), below + 6.0, 12.0)
    return chart


def ecliptic_au(position_km: Array) -> Array:
    """ICRF positions (..., 3), km, in the ecliptic of J2000, au."""
    found: Array = np.asarray(position_km, dtype=np.float64) @ R_ecliptic_from_icrf.T / AU_KM
    return found


def _solar_system(run: RunFolder) -> Sight | None:
    """Everything around the Sun; None where the run has no measurement."""
    found = places_of(run)
    if found is None:
        return None
    arc, place, earth, index, seen = found
    met, turns = _encounters(run), _turns(run)
    bodies = list(dict.fromkeys(["earth", *(planets.WITH.get(body, body) for body, _, _ in met)]))
    things: list[Thing] = [Marks(name="Sun", points=np.zeros((1, 3)), marker="o", look={"color": ORANGE, "size": 9.0})]
    things += _exclusions(run, ecliptic_au(place), index)
    things += [Track(name=f"orbit of {_the(body)}", points=planets.orbit(body), look=PLANET) for body in bodies]
    things += _sight_lines(ecliptic_au(place), seen)
    if turns > SEVERAL:
        things += _by_years(run, ecliptic_au(earth), seen)
    else:
        things.append(Track(name="Earth, during the measurements", points=ecliptic_au(earth)[thin(len(earth), 300)],
                            look={"stroke": GREEN, "stroke_width": 2.4}))  # fmt: skip
    things += _telescopes(run, place, earth, index, turns)
    if turns <= SEVERAL:
        things.append(Track(name=wording.NBSP.join(["asteroid,", "measured arc"]), points=ecliptic_au(arc), look=TRACK))
    things.append(Marks(name="first measurement", points=seen[:1], marker="O", look={"color": BLUE}))
    things.append(Marks(name="last measurement", points=seen[-1:], marker="o", look={"color": BLUE, "size": 6.0}))
    things += [Marks(name="encounter", points=at[None], marker="X", look={"color": VERMILION, "size": 4.0}, text=said)
               for _, said, at in met]  # fmt: skip
    middle, half, low, high = _frame(things)
    path = _osculating(run, FAR * float(np.abs(middle).max() + half))
    if path is not None:
        things.insert(1, Track(name="orbit of the asteroid", points=path, look=ORBIT))
        if float(np.nanmax(np.linalg.norm(path, axis=1))) < FAR * (half + float(np.abs(middle).max())) * 0.99:
            middle, half, low, high = _frame(things)
    names = ("towards the equinox, au", "90° ahead in the ecliptic, au", "north, au")
    return Sight(names=names, middle=middle, half=half, low=low, high=high, things=things)


def places_of(run: RunFolder) -> tuple[Array, Array, Array, Array, Array] | None:
    """Path of the object, telescopes, Earth (km), telescope of each measurement, measured places (au, ecliptic); None.

    Of a fit the path goes through the measured places.
    """
    place, earth, index = (run.array(n) for n in ("telescope_position_km", "earth_position_km", "telescope_index"))
    state, seen = run.array("state"), run.array("object_position_km")
    at = state[:, :3] if state is not None else seen
    if place is None or earth is None or index is None or at is None or not len(place):
        return None
    arc = run.array("object_track_km")
    return (at if arc is None else arc), place, earth, index, ecliptic_au(at)


def _turns(run: RunFolder) -> float:
    """How many times the object goes round the Sun while it is measured; 0 on an open orbit."""
    t, state = run.array("epoch_s"), _state(run)
    if t is None or state is None:
        return 0.0
    r, v = state
    inverse = 2.0 / float(np.linalg.norm(r)) - float(v @ v) / GM_SUN_KM3_S2  # 1/a
    rate = np.sqrt(GM_SUN_KM3_S2 * inverse**3) if inverse > 0.0 else 0.0
    return float(np.ptp(t)) * float(rate) / (2.0 * np.pi)


def _by_years(run: RunFolder, earth: Array, seen: Array) -> list[Thing]:
    """Measured places as dots, pale to dark by time: a line over several revolutions would be one stripe."""
    t = run.array("epoch_s")
    if t is None:
        return []
    few = np.unique(np.linspace(0, len(t) - 1, MOST_DOTS).astype(int)) if len(t) > MOST_DOTS else np.arange(len(t))
    edges = np.quantile(t, np.linspace(0.0, 1.0, len(SHADES) + 1))
    things: list[Thing] = [Marks(name="Earth, then", points=earth[few], marker="o", look={"color": GREEN, "size": 2.0})]
    for k, shade in enumerate(SHADES):
        last = k == len(SHADES) - 1
        mine = few[(t[few] >= edges[k]) & ((t[few] < edges[k + 1]) | last)]
        if len(mine):
            first, end = ((run.epoch + float(t[one])).iso()[:7] for one in (mine[0], mine[-1]))
            name = f"measured {first}" if first == end else f"measured {first} to {end}"
            things.append(Marks(name=name, points=seen[mine], marker="o", look={"color": shade, "size": 4.0}))
    return things


def _frame(things: Sequence[Thing]) -> tuple[Array, float, float, float]:
    """Middle and half width of the view from above, and the reach of the one from the side."""
    every = np.vstack([one.points for one in things if isinstance(one, Track | Marks)])
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    half = 0.54 * float((high - low)[:2].max())
    room = 0.06 * half
    return 0.5 * (low + high)[:2], half, float(low[2]) - room, float(high[2]) + room


def _the(body: str) -> str:
    return "the Earth" if body == "earth" else body.capitalize()


def _encounters(run: RunFolder) -> list[tuple[str, str, Array]]:
    """Each encounter that is predicted, once: the body, what to write beside it, and where the body then is."""
    found: dict[tuple[str, str], tuple[str, str, Array]] = {}
    for p in run.predictions(run.main["name"]) if run.main else []:
        body, when = p.get("body"), p["epoch_tdb"]
        if body and planets.known(body):
            said = when[:10] if body == "earth" else f"{_the(body)}, {when[:10]}"
            at = planets.place(body, Epoch.parse(when).jd_tdb)
            found.setdefault((body, when[:10]), (body, said, at))
    apart: list[tuple[str, str, Array]] = []
    for body, said, at in found.values():
        k = next((k for k, one in enumerate(apart) if np.linalg.norm(one[2] - at) < CLOSE_AU), None)
        if k is None:
            apart.append((body, said, at))
        else:  # at one spot of the picture: one mark for both
            apart[k] = (apart[k][0], f"{apart[k][1]}; {said}", apart[k][2])
    return apart


def _osculating(run: RunFolder, limit_au: float) -> Array | None:
    """The orbit of the object at the reference epoch (361, 3), undefined beyond a distance; None without a state."""
    state = _state(run)
    if state is None:
        return None
    r, v = state
    h = np.cross(r, v)
    bend = np.cross(v, h) / GM_SUN_KM3_S2 - r / np.linalg.norm(r)
    e = float(np.linalg.norm(bend))
    if not float(h @ h) > 0.0:
        return None
    P = bend / e if e > 1e-9 else r / np.linalg.norm(r)
    Q = np.cross(h / np.linalg.norm(h), P)
    f = np.linspace(-np.pi, np.pi, 361)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = float(h @ h) / GM_SUN_KM3_S2 / (1.0 + e * np.cos(f)) / AU_KM
    distance = np.where((distance > 0.0) & (distance < limit_au), distance, np.nan)
    return np.asarray(distance[:, None] * (np.outer(np.cos(f), P) + np.outer(np.sin(f), Q)))


def _state(run: RunFolder) -> tuple[Array, Array] | None:
    """Heliocentric position and velocity of the object in ecliptic axes, km and km/s: the reference of a run, or what
    a fit found; None without either."""
    reference, orbit = run.summary.get("reference"), run.summary.get("orbit")
    if reference:
        r, v = reference["position_km"], reference["velocity_km_s"]
    elif orbit:
        r, v = orbit["state_km_km_s"][:3], orbit["state_km_km_s"][3:]
    else:
        return None
    return ecliptic_au(r) * AU_KM, ecliptic_au(v) * AU_KM


def _sight_lines(place: Array, seen: Array) -> list[Thing]:
    """Lines from telescopes to the object, a few of them."""
    few = np.unique(np.linspace(0, len(place) - 1, SIGHT_LINES).astype(int))
    look: dict[str, Any] = {"stroke": GREY, "stroke_width": 0.6}
    return [Track(name="line of sight", points=np.stack([place[k], seen[k]]), look=look) for k in few]


def _telescopes(run: RunFolder, place: Array, earth: Array, index: Array, turns: float) -> list[Thing]:
    """Paths of the telescopes that can be told from the Earth, and where they measured last."""
    things: list[Thing] = []
    for i, name in enumerate(run.telescopes):
        mine = index == i
        if not np.any(mine) or is_near(place[mine], earth[mine]):
            continue
        colour, marker = SERIES[(i + 1) % len(SERIES)]
        path = _unbroken(ecliptic_au(place[mine]))
        if turns > SEVERAL:
            things.append(Marks(name="", points=path, marker="o", look={"color": colour, "size": 2.0}))
        else:
            things.append(Track(name="", points=path, look={"stroke": colour, "stroke_width": 1.6}))
        last = path[np.isfinite(path[:, 0])][-1:]
        things.append(Marks(name=name, points=last, marker=marker, look={"color": colour, "size": 6.0}))
    return things


def _unbroken(points: Array) -> Array:
    """Points (n, 3) of a path, thinned, with a break (NaN) where a telescope did not measure for long."""
    points = points[thin(len(points), 300)]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    gaps = np.flatnonzero(steps > 5.0 * np.median(steps)) if len(steps) else np.empty(0, dtype=int)
    return np.insert(points, gaps + 1, np.nan, axis=0)


def _exclusions(run: RunFolder, place: Array, index: Array) -> list[Thing]:
    """What the first telescope that has such limits cannot see about the Sun, at its last measurement."""
    for i, name in enumerate(run.telescopes):
        limits, mine = limits_of(run, name), np.flatnonzero(index == i)
        if len(mine) and (limits.get("sun") or limits.get("sun_largest")):
            return sun_cones(limits, place[mine[-1]], -place[mine[-1]], name, len(run.telescopes) > 1)
    return []


def limits_of(run: RunFolder, telescope: str) -> dict[str, float]:
    """The limits of a telescope, degrees, by what they keep off; empty where the folder does not say."""
    rows = run.summary.get("visibility") or []
    found = next((row.get("limits_deg") for row in rows if row["telescope"] == telescope), None)
    return dict(found or {})


def sun_cones(limits: dict[str, float], apex: Array, axis: Array, name: str, several: bool) -> list[Thing]:
    """Cones about the Sun, nearer than which and farther than which a telescope does not measure."""
    whose = f" by {name}" if several else ""
    cones: list[Thing] = []
    if limits.get("sun"):
        text = f"not seen{whose}: within {limits['sun']:g}° of the Sun"
        cones.append(Cone(name=text, apex=apex, axis=axis, inner_rad=0.0, outer_rad=np.radians(limits["sun"]),
                          color=ORANGE))  # fmt: skip
    if limits.get("sun_largest"):
        text = f"not seen{whose}: beyond {limits['sun_largest']:g}° from the Sun"
        cones.append(Cone(name=text, apex=apex, axis=axis, inner_rad=np.radians(limits["sun_largest"]),
                          outer_rad=np.pi, color=GREY))  # fmt: skip
    return cones


def _caption(run: RunFolder) -> Markup:
    """Dates and distances at both ends, and which telescopes are too near the Earth to be seen apart."""
    found, t = places_of(run), run.array("epoch_s")
    if found is None:
        return Markup("")
    _, place, _, index, seen = found
    ends = [float(np.linalg.norm(seen[k] - ecliptic_au(place[k]))) * AU_KM for k in (0, -1)]
    dates = [wording.date((run.epoch + float(t[k])).iso()) if t is not None else "" for k in (0, -1)]
    station = "station " if "fit" in run.summary else ""
    ends_by = [station + run.telescopes[int(index[k])] for k in (0, -1)]
    text = Markup("The asteroid is {} from {} at the first measurement ({}), {} from {} at the last ({}).").format(
        quantity(ends[0], "km"), ends_by[0], dates[0], quantity(ends[1], "km"), ends_by[1], dates[1]
    )
    idle = [name for i, name in enumerate(run.telescopes) if not np.any(index == i)]
    if idle:
        none = wording.join(idle) if len(idle) <= MOST_NAMED else wording.count(len(idle), "telescope")
        text += Markup(" {} {} nothing and {} not drawn.").format(
            none, *(("measures", "is") if len(idle) == 1 else ("measure", "are"))
        )
    turns = _turns(run)
    if turns > SEVERAL:
        text += Markup(" It goes round the Sun {} times meanwhile: measured places are dots, pale to dark.").format(
            number(turns, 2)
        )
    near = [run.telescopes[i] for i in shown_near(run)]
    if near:
        who = wording.join(near) if len(near) <= MOST_NAMED else wording.count(len(near), "telescope")
        text += Markup(
            " {} cannot be told from the Earth at the scale of orbits; the picture about it shows {}."
        ).format(who, "them" if len(near) > 1 else "it")
    return text


def _data(run: RunFolder) -> Any:
    """Tracks of the object, the Earth and each telescope."""
    found = places_of(run)
    if found is None:
        return csv("geometry", {})
    arc, place, earth, index, _ = found
    tracks = {"asteroid": ecliptic_au(arc), "Earth": ecliptic_au(earth)[thin(len(earth), 300)]}
    tracks |= {name: ecliptic_au(place[index == i]) for i, name in enumerate(run.telescopes[:MOST_NAMED])}
    tracks = {name: path[thin(len(path), 300)] for name, path in tracks.items()}
    points = np.vstack(list(tracks.values()))
    names = [name for name, path in tracks.items() for _ in path]
    return csv("geometry", {"track": names, "x_au": points[:, 0], "y_au": points[:, 1], "z_au": points[:, 2]})
