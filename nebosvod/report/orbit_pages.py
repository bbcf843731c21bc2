"""Pages of an orbit that was given: its ephemeris, and its approaches."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.borders.stored import read_object
from nebosvod.dynamics.surface import SURFACE_KM
from nebosvod.impacts.chance import chance_words
from nebosvod.report.kit.base import render
from nebosvod.report.kit.chart import NARROW, Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.outline import covariance_of
from nebosvod.report.kit.plate import BLUE, GREY, INK, VERMILION, Plate, thin
from nebosvod.report.kit.scale import calendar, linear, logarithmic
from nebosvod.report.kit.stamp import stamp_of
from nebosvod.report.kit.target import TargetView, target_plates
from nebosvod.report.kit.wording import NBSP, count, moment, quantity
from nebosvod.report.kit.worldmap import Corridor, maps
from nebosvod.report.run.tables import Cell, Table
from nebosvod.results.ahead_words import CALLED
from nebosvod.timescale import SECONDS_PER_DAY, Epoch
from nebosvod.units import AU_KM

Item = Mapping[str, Any]
NOTED = 1e-6  # a chance of impact from which the verdict is a caution
DOT = 40.0  # a picture so many times wider than half the disc shows it as a dot
MOST_PLANES = 8
SHOWN = 400  # rows of an ephemeris on the page; the table in the folder has them all
FIGURES = {"semi_major_arcsec": "long axis of the 1σ ellipse, arcsec", "distance_au": "distance, au"}


def make_ephemeris_page(folder: Path) -> str:
    """Return the page of a folder of `nebosvod ephemeris`; the same folder gives the same bytes."""
    summary = read_object(Path(folder) / "summary.json")
    rows = summary["rows"]
    headline = summary["ended"] or _seen(rows)
    return render(
        "orbit.html",
        kind="Ephemeris",
        stamp=stamp_of(Path(folder)),
        title=summary["title"],
        summary=summary,
        lead=summary["observer"],
        tone="caution" if summary["ended"] else "good",
        headline=_upper(headline),
        plates=[_over_time(rows, key, label) for key, label in FIGURES.items()] if len(rows) > 1 else [],
        rows_title="Positions",
        rows=_positions(rows),
    )


def make_approaches_page(folder: Path) -> str:
    """Return the page of a folder of `nebosvod approaches`; the same folder gives the same bytes."""
    summary = read_object(Path(folder) / "summary.json")
    rows = summary["approaches"]
    return render(
        "orbit.html",
        kind="Approaches",
        stamp=stamp_of(Path(folder)),
        title=summary["title"],
        summary=summary,
        lead=f"{summary['from_utc'][:10]} to {summary['to_utc'][:10]}, within {summary['within_au']:g} au",
        tone="caution" if summary["ended"] or summary["warnings"] or _likely(rows) >= NOTED else "good",
        headline=_said(summary),
        plates=[_distances(rows), *_planes(rows)] if rows else [],
        rows_title="Approaches",
        rows=_approaches(rows),
    )


def _upper(text: str) -> str:
    """With a capital letter."""
    return text[0].upper() + text[1:]


def _seen(rows: Sequence[Item]) -> str:
    """How bright, how near and how well known it is over these times."""
    nearest = min(rows, key=lambda row: row["distance_au"])
    size = [f"{value:.3g}" for value in sorted(row["semi_major_arcsec"] for row in rows)[:: max(len(rows) - 1, 1)]]
    known = [row for row in rows if row["V"] is not None]
    said = f"nearest at {nearest['distance_au']:.4g} au on {nearest['epoch_utc'][:10]}; known to "
    said += " to ".join(dict.fromkeys(size)) + " arcsec (1σ, the long axis)"
    if known:
        brightest = min(known, key=lambda row: row["V"])
        said = f"V {brightest['V']:.1f} at its brightest, on {brightest['epoch_utc'][:10]}; {said}"
    return said


def _likely(rows: Sequence[Item]) -> float:
    """The largest linear chance of impact."""
    return max((row["impact_probability_linear"] or 0.0 for row in rows), default=0.0)


def _called(body: str) -> str:
    """A body as a sentence names it."""
    return CALLED.get(body, body.capitalize())


def _said(summary: Item) -> Cell:
    """The answer in one line."""
    rows = summary["approaches"]
    if summary["ended"]:
        return str(summary["ended"][0].upper() + summary["ended"][1:])
    if not rows:
        near = summary["nearest"]
        told = "" if near is None else f"; the nearest is to {_called(near['body'])} at {near['distance_au']:.4g} au"
        return f"No approach within {summary['within_au']:g} au{told}"
    likely = max(rows, key=lambda row: row["impact_probability_linear"] or 0.0)
    nearest = min(rows, key=lambda row: row["distance_km"])
    text = Markup("{}; the nearest to {} on {} at {} ± {} (1σ)").format(
        count(len(rows), "approach").replace("approachs", "approaches"),
        _called(nearest["body"]),
        moment(nearest["epoch_tdb"]),
        quantity(nearest["distance_km"], "km"),
        quantity(nearest["sigma_distance_km"], "km"),
    )
    if (likely["impact_probability_linear"] or 0.0) >= 1e-12:
        text += Markup("; the linear chance to hit {} on {} is {}").format(
            _called(likely["body"]), moment(likely["epoch_tdb"]), chance_words(likely["impact_probability_linear"])
        )
    if _likely(rows) >= NOTED:
        text += "; nebosvod risk tells how far to believe it"
    return text


def _times(rows: list[Item], key: str) -> tuple[Epoch, Any]:
    epochs = [Epoch.parse(row[key]) for row in rows]
    return epochs[0], np.array([one - epochs[0] for one in epochs])


def _over_time(rows: list[Item], key: str, label: str) -> Plate:
    """One number of an ephemeris against the date."""
    start, t = _times(rows, "epoch_utc")
    values = np.array([row[key] for row in rows])
    few = thin(len(rows))
    wide = bool((values > 0.0).all() and values.max() > 30.0 * values.min())
    y = (logarithmic if wide else linear)(values, label)
    chart = Chart(f"ephemeris-{key.split('_')[0]}", width=NARROW, height=260.0)
    panel = chart.panel(calendar(start, t, most=3.5), y, top=8.0, bottom=214.0)
    panel.open()
    panel.line(t[few] / SECONDS_PER_DAY, values[few], label, stroke=BLUE, stroke_width=1.6)
    panel.close()
    caption = Markup("The {}: from {:.4g} to {:.4g}.").format(label, float(values.min()), float(values.max()))
    columns = {"epoch_utc": [row["epoch_utc"] for row in rows], key: values}
    return chart.plate(_upper(label), caption, [csv(f"ephemeris-{key}", columns)])


def _distances(rows: list[Item]) -> Plate:
    """Distances of approaches by date, with the smallest within three sigmas, and the Earth's radius."""
    start, t = _times(rows, "epoch_tdb")
    days = t / SECONDS_PER_DAY
    distance = np.array([max(row["distance_km"], 1.0) for row in rows])
    least = np.array([max(row["least_distance_3_sigma_km"], 1.0) for row in rows])
    y = logarithmic([*distance, *least, 6378.0], "distance from the centre, km")
    span = t if len(t) > 1 else np.array([t[0] - 30.0 * SECONDS_PER_DAY, t[0] + 30.0 * SECONDS_PER_DAY])
    chart = Chart("approaches", width=NARROW, height=310.0)
    panel = chart.panel(calendar(start, span, most=3.5), y, top=8.0, bottom=230.0)
    panel.open()
    panel.level(6378.0, stroke=GREY, stroke_width=1.0, stroke_dasharray="6 4")
    for k in range(len(rows)):
        panel.line([days[k], days[k]], [least[k], distance[k]], stroke=INK, stroke_width=0.8)
    panel.dots(days, distance, "o", "nominal", color=BLUE, size=4.0)
    panel.dots(days, least, "v", "smallest within 3 sigma", color=VERMILION, size=3.2)
    panel.close()
    entries: list[tuple[str, str, dict[str, Any]]] = [
        ("o", "nominal", {"color": BLUE, "size": 4.0}),
        ("v", "smallest within 3 sigma", {"color": VERMILION, "size": 3.2}),
        ("line", "radius of the Earth", {"stroke": GREY, "stroke_width": 1.0, "stroke_dasharray": "6 4"}),
    ]
    chart.height = chart.legend(entries, 272.0) + 4.0
    columns = {key: [row[key] for row in rows] for key in ("body", "epoch_utc", "distance_km", "sigma_distance_km")}
    caption = Markup("Each approach by its date: nominal distance, and the smallest that three sigmas allow.")
    return chart.plate("Distances of approaches by date", caption, [csv("approaches", columns)])


def _planes(rows: list[Item]) -> list[Plate]:
    """Target planes where the body is more than a dot or may be hit, and the map of an impact on the Earth."""
    plates: list[Plate] = []
    for number, row in enumerate(rows):
        if None in (row["xi_km"], row["semi_major_km"], row["capture_radius_km"]) or row["body"] not in SURFACE_KM:
            continue
        centre = np.array([row["xi_km"], row["zeta_km"]])
        K = covariance_of(row["semi_major_km"], row["semi_minor_km"], row["angle_deg"])
        reach = float(np.abs(centre).max()) + 3.0 * float(row["semi_major_km"])
        a_dot = reach > DOT * row["capture_radius_km"] and (row["impact_probability_linear"] or 0.0) < NOTED
        if a_dot or len(plates) >= MOST_PLANES:
            continue
        view = TargetView(
            body=row["body"], radius_km=SURFACE_KM[row["body"]], capture_km=row["capture_radius_km"], centre=centre,
            covariance=K, points=np.empty((0, 2)), fates=np.empty(0, dtype=np.str_),
        )  # fmt: skip
        name = f"{_called(row['body'])} on {row['epoch_utc'][:10]}"
        words = "The b-plane of {} at one scale, with the circle within which orbits of this speed hit."
        caption = Markup(words).format(name)
        plates += target_plates(f"target-{number}", view, f"Target plane of {name}", caption)
        if row["longitude_deg"] is not None:
            fall = Corridor(name="falls", points=np.empty((0, 2)), nominal=(row["longitude_deg"], row["latitude_deg"]))
            plates += maps(f"map-{number}", [fall], f"Where it falls on {row['epoch_utc'][:10]}",
                           Markup("Where the orbit comes to the ground."))  # fmt: skip
    return plates


def _positions(rows: list[Item]) -> Table | None:
    """Rows of an ephemeris for the page."""
    if not rows:
        return None
    shown = rows[:SHOWN]
    head = ("UTC", "RA, deg", "Dec, deg", "ellipse, 1σ, arcsec", "angle, deg", "distance, au", "phase, deg",
            "elongation, deg", "V")  # fmt: skip
    body: list[tuple[Cell, ...]] = [
        (
            row["epoch_utc"][:19].replace("T", NBSP).replace("-", "\u2011"),
            f"{row['ra_deg']:.6f}",
            f"{row['dec_deg']:.6f}".replace("-", "−"),
            f"{row['semi_major_arcsec']:.3g} × {row['semi_minor_arcsec']:.3g}",
            f"{row['position_angle_deg']:.1f}",
            f"{row['distance_au']:.6f}",
            f"{row['phase_deg']:.2f}",
            f"{row['elongation_deg']:.2f}",
            "–" if row["V"] is None else f"{row['V']:.2f}",
        )
        for row in shown
    ]
    more = "" if len(rows) == len(shown) else f" The first {len(shown)} of {len(rows)} times."
    caption = f"Astrometric places, ICRF; the angle of the ellipse is from north to east.{more}"
    return Table(caption=Markup(caption), head=head, rows=tuple(body), align="l" + "r" * (len(head) - 1))


def _approaches(rows: list[Item]) -> Table | None:
    """Rows of approaches for the page."""
    if not rows:
        return None
    head = ("body", "time", "1σ", "distance", "1σ", "smallest within 3σ", "b-plane ξ, ζ", "ellipse, 1σ", "v∞",
            "chance of impact")  # fmt: skip
    body: list[tuple[Cell, ...]] = [
        (
            row["body"].capitalize() + (" (hits)" if row["impact"] else ""),
            moment(row["epoch_tdb"]),
            quantity(row["sigma_time_s"], "s"),
            Markup("{} ({:.5f} au)").format(quantity(row["distance_km"], "km"), row["distance_km"] / AU_KM),
            quantity(row["sigma_distance_km"], "km"),
            quantity(row["least_distance_3_sigma_km"], "km"),
            _pair(row, "xi_km", "zeta_km", ", "),
            _pair(row, "semi_major_km", "semi_minor_km", " × "),
            "–" if row["v_infinity_km_s"] is None else f"{row['v_infinity_km_s']:.3f} km/s",
            "–" if row["impact_probability_linear"] is None else chance_words(row["impact_probability_linear"]),
        )
        for row in rows
    ]
    caption = "Sigmas and chances are linear, on the target plane; a bound orbit has no b-plane."
    return Table(caption=Markup(caption), head=head, rows=tuple(body), align="l" + "r" * (len(head) - 1))


def _pair(row: Item, one: str, other: str, between: str) -> Cell:
    if row[one] is None:
        return "–"
    return Markup("{}{}{}").format(quantity(row[one], "km"), between, quantity(row[other], "km"))
