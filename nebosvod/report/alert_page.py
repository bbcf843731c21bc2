"""The page of a folder of `nebosvod alert`."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from nebosvod.borders.stored import read_arrays, read_object
from nebosvod.first_hour.tangent import Tangent, directions
from nebosvod.report.alert_course import PRIORS, chance, fall_table, history_figure, history_table
from nebosvod.report.kit.base import render
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import BLUE, GREY, SKY, VERMILION, Plate, thin
from nebosvod.report.kit.scale import Scale, linear, logarithmic
from nebosvod.report.kit.stamp import stamp_of
from nebosvod.report.kit.wording import moment, number
from nebosvod.report.kit.worldmap import Corridor, maps
from nebosvod.report.run.tables import Cell, Table
from nebosvod.results.alert_words import (
    NOTED,
    angle,
    duration,
    first_visible,
    hits_words,
    none_visible,
    prior_decides,
    sight,
    span,
    top_of,
)
from nebosvod.results.alert_words import arc as arc_words

Item = Mapping[str, Any]
Array = npt.NDArray[np.float64]
Arrays = Mapping[str, npt.NDArray[Any]]
QUANTITIES = {
    "range_au": "range, au", "rate_km_s": "range rate, km/s", "a_au": "semi-major axis, au", "e": "eccentricity",
    "i_deg": "inclination, deg", "q_au": "perihelion, au", "H": "H", "diameter_m": "diameter, m",
}  # fmt: skip
MOST_FIELDS = 6
UNKNOWN = 100.0  # factor within which a range is, from which its ends are said
SQUEEZED = 1.3  # how much wider a picture may become by a hundredth of the drawn orbits
PICTURED = 0.99  # of drawn orbits, that a picture of the sky holds where the others would widen it by more
DASHED: dict[str, Any] = {"stroke": GREY, "stroke_width": 1.0, "stroke_dasharray": "6 4"}
LEAP = 20.0  # times the usual step of a contour
REGIONS: dict[str, dict[str, Any]] = {  # told apart in grey too
    "95": {"stroke": SKY, "stroke_width": 1.8, "stroke_dasharray": "5 3"}, "68": {"stroke": BLUE, "stroke_width": 2.0},
}  # fmt: skip


def make_alert_page(folder: Path) -> str:
    """Return the page of a folder of `nebosvod alert`; the same folder gives the same bytes."""
    summary, arrays = read_object(Path(folder) / "summary.json"), read_arrays(Path(folder) / "arrays.npz")
    fields = summary["fields"][:MOST_FIELDS]
    return render(
        "alert.html",
        kind="First hour",
        stamp=stamp_of(Path(folder)),
        title=summary["title"],
        summary=summary,
        within=span(summary["within_d"]),
        arc=arc_words(summary["arc_h"]),
        headline=_headline(summary),
        tone="caution" if summary["warnings"] or (summary["probability"] or 0.0) >= NOTED else "good",
        tiles=_tiles(summary),
        answers=_answers(summary),
        plane=[_plane(summary, arrays)],
        chances=_chances(summary),
        quantities=_quantities(summary["quantities"]),
        scores=_scores(summary["scores"]),
        fields=[_field(row, arrays[f"field_psi_{k}"], k) for k, row in enumerate(fields)],
        field_table=_fields(summary["fields"]),
        corridor=_corridor(summary, arrays),
        fall=fall_table(summary["impact"]),
        history=[history_figure(summary["history"])] if len(summary["history"]) > 1 else [],
        history_table=history_table(summary["history"], summary["headline"]),
        decisions=_decisions(summary["decisions"]),
    )


def _short(row: Item) -> Cell:
    """The same without its interval."""
    return Markup("{}{}").format("< " if row["bound"] else "", number(top_of(row), 2))


def _headline(summary: Item) -> Cell:
    """The answer in a line."""
    return Markup("Probability to hit the Earth within {}: {}").format(span(summary["within_d"]), chance(summary))


def _tiles(summary: Item) -> list[tuple[str, Cell]]:
    """The numbers a reader looks for."""
    quantities = summary["quantities"]
    tiles: list[tuple[str, Cell]] = []
    fall = summary["impact"]
    if fall is not None:
        when = Markup("{} ± {}").format(moment(fall["epoch_utc"]), duration(fall["half_68_s"]))
        tiles.append(("if it hits, 68 %", when))
    tiles.append(("range, 68 %", _range(summary)))
    if size := quantities.get("diameter_m"):
        factor, unit = (1e-3, "km") if size["q84"] >= 1000.0 else (1.0, "m")
        ends = dict.fromkeys(number(factor * size[name], 2) for name in ("q16", "q84"))
        tiles.append(("diameter, 68 %", f"{' to '.join(ends)} {unit}"))
    return tiles


def _range(summary: Item) -> Cell:
    """The range as far as it is known: within so many percent, or within a factor."""
    best = summary["quantities"]["range_au"]
    factor = max(best["q84"] / best["median"], best["median"] / best["q16"])
    if summary["orbit_status"] == "observable":
        percent = number(100.0 * summary["grid"]["sigma_log_range"], 2)
        return Markup("{} au ± {} %").format(number(best["median"], 3), percent)
    if factor < UNKNOWN:
        return Markup("{} au within a factor of {}").format(number(best["median"], 3), number(factor, 2))
    return Markup("{} to {} au").format(number(best["q16"], 1), number(best["q84"], 1))


def _answers(summary: Item) -> list[tuple[str, list[Cell]]]:
    """How well the orbit is known, whether the probability may be believed, what would settle it."""
    said: list[tuple[str, list[Cell]]] = [("How accurate", [_sentence(summary["message"])])]
    said.append(("Can it be believed", list(_belief(summary))))
    best = max(summary["decisions"], key=lambda row: row["settles"], default=None)
    if best is not None:
        said.append(("What would help", [
            Markup("One more observation from {} at {} settles it with a chance of {} ({} to {}).").format(
                best["telescope"], moment(best["epoch_utc"]),
                *(number(best[name], 2) for name in ("settles", "settles_low", "settles_high")))
        ]))  # fmt: skip
    elif summary["fields"] and (first := first_visible(summary)) is None:
        said.append(("What would help", [_sentence(none_visible(summary))]))
    elif summary["fields"] and first is not None:
        said.append(("What would help", [
            Markup("One more observation: {} sees it at RA {:.3f}°, Dec {:+.3f}° ± {} (1σ), {}.").format(
                first["telescope"], first["ra_deg"], first["dec_deg"], angle(first["semi_major_arcsec"], "°"),
                moment(first["epoch_utc"]))
        ]))  # fmt: skip
    return said


def _belief(summary: Item) -> Iterator[Cell]:
    """Whether the probability may be believed."""
    bound = summary["bound"]
    if bound:
        yield f"It is a bound (95 %) and no estimate: {hits_words(summary['hits'])}."
    if prior_decides(summary["by_prior"]):
        order = sorted(summary["by_prior"].values(), key=top_of)
        low, high = order[0], next(row for row in reversed(order) if not row["bound"])
        caution = "The" if bound else "With caution: the"
        yield Markup("{} prior decides, from {} to {}.").format(caution, _short(low), _short(high))
        yield "More observations bring the priors together."
    elif not bound:
        yield "Yes, as far as the stated noise holds: it hardly depends on the prior."


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + ("" if text.endswith(".") else ".")


def _plane(summary: Item, arrays: Arrays) -> Plate:
    """Nodes of the grid in the plane of range and range rate, the bounds, and the drawn orbits that hit."""
    x, y, level = np.exp(arrays["node_ln_range_au"]), arrays["node_rate_km_s"], arrays["node_level"]
    shown = level < 0.9999
    across, up = logarithmic(x[shown], "range, au"), linear(y[shown], "range rate, km/s")
    hit_x, hit_y = _hits(arrays, across, up)
    bounds = [(np.exp(arrays["bound_ln_range_au"]), rate) for rate in arrays["bound_rate_km_s"].T]
    chart = Chart("plane", height=330.0)
    panel = chart.panel(across, up, top=8.0, bottom=250.0)
    panel.open()
    panel.clip()
    for ranges, rates in bounds:
        panel.line(ranges, rates, "bound of the region", **DASHED)
    parts = (
        (shown & (level >= 0.95), "outside of 95 %", GREY, 1.6),
        ((level >= 0.68) & (level < 0.95), "within 95 %", SKY, 2.4),
        (level < 0.68, "within 68 %", BLUE, 3.0),
    )  # fmt: skip
    few = thin(len(hit_x), 400)  # below the nodes, which they would hide
    panel.dots(hit_x[few], hit_y[few], "P", "hits the Earth", color=VERMILION, size=3.0)
    for chosen, name, color, size in parts:
        panel.dots(x[chosen], y[chosen], "o", name, color=color, size=size)
    panel.unclip()
    panel.close()
    entries: list[tuple[str, str, dict[str, Any]]] = [
        ("o", name, {"color": color, "size": size}) for _, name, color, size in parts
    ]
    if hit_x.size:
        entries.append(("P", "drawn orbit that hits", {"color": VERMILION, "size": 3.0}))
    if any(_inside(ranges, rates, across, up).any() for ranges, rates in bounds):
        entries.append(("line", "bound", DASHED))
    chart.height = chart.legend(entries, 292.0) + 4.0
    caption = Markup("Nodes of the grid by the part of the posterior that is denser; prior uniform in range and rate.")
    if hit_x.size:
        caption += " More orbits were drawn where some hit: how many crosses there are is no probability."
    columns = {"range_au": x, "rate_km_s": y, "weight": arrays["node_weight_uniform"], "denser": level}
    return chart.plate("Range and range rate", caption, [csv("grid", columns)])


def _hits(arrays: Arrays, across: Scale, up: Scale) -> tuple[Array, Array]:
    """Range and range rate of the drawn orbits that hit the Earth, of those in the picture."""
    hit = (arrays["draw_body"] == "earth") & (arrays["draw_weight_uniform"] > 0.0)
    x, y = np.exp(arrays["draw_ln_range_au"][hit]), arrays["draw_rate_km_s"][hit]
    inside = _inside(x, y, across, up)
    return x[inside], y[inside]


def _inside(x: Array, y: Array, across: Scale, up: Scale) -> npt.NDArray[np.bool_]:
    """Which points lie in a picture."""
    with np.errstate(invalid="ignore"):
        found: npt.NDArray[np.bool_] = (x >= across.low) & (x <= across.high) & (y >= up.low) & (y <= up.high)
    return found


def _chances(summary: Item) -> Table:
    """Probabilities by prior."""
    rows = tuple((PRIORS[prior][0], chance(row), str(row["hits"])) for prior, row in summary["by_prior"].items())
    return Table(
        caption=Markup("Probability of impact by prior, with its 95 % interval."),
        head=("prior", "probability", "drawn hits"), rows=rows, align="lrr",
    )  # fmt: skip


def _quantities(quantities: Item) -> Table:
    """Medians and ends of 68 and 95 %."""
    rows = tuple(
        (label, *(number(quantities[key][name], 4) for name in ("q025", "q16", "median", "q84", "q975")))
        for key, label in QUANTITIES.items() if key in quantities
    )  # fmt: skip
    head = ("", "2.5 %", "16 %", "median", "84 %", "97.5 %")
    return Table(caption=Markup("Of the drawn orbits, elements about the Sun."), head=head, rows=rows, align="lrrrrr")


def _scores(scores: Item) -> Table:
    rows = tuple((name.replace("_", " "), number(value, 2)) for name, value in scores.items())
    return Table(caption=Markup("Shares of the posterior."), head=("class", "score"), rows=rows, align="lr")


def _field(row: Item, psi: Array, k: int) -> Plate:
    """The sky of one telescope at one time, about the mean place."""
    centre = np.array([row["ra_deg"], row["dec_deg"]])
    points = _offsets(np.degrees(psi), centre)
    edges = {
        share: [_offsets(np.array(edge), centre) for edge in lines] for share, lines in row["contours_deg"].items()
    }
    both = np.concatenate([_pictured(points), *(edge for lines in edges.values() for edge in lines)])
    low, high = both.min(axis=0), both.max(axis=0)
    away = int(((points < low) | (points > high)).any(axis=1).sum())
    wide = float((high - low).max())
    factor, unit = (3600.0, "arcsec") if wide < 0.1 else (60.0, "arcmin") if wide < 3.0 else (1.0, "deg")
    ra, dec = factor * points.T
    edges = {share: [factor * edge for edge in lines] for share, lines in edges.items()}
    chart = Chart(f"field-{k}", height=290.0)
    panel = chart.panel(
        linear(factor * both[:, 0], f"east of the mean, {unit}").reversed(),
        linear(factor * both[:, 1], f"north of the mean, {unit}"), top=8.0, bottom=215.0,
    )  # fmt: skip
    panel.open()
    panel.clip()
    panel.dots(ra, dec, "o", "drawn orbit", color=GREY, size=1.4)
    for share, color in (("95", SKY), ("68", BLUE)):
        for edge in edges.get(share, []):
            for piece in _pieces(edge):
                panel.line(piece[:, 0], piece[:, 1], f"{share} %", stroke=color, stroke_width=1.6)
    panel.unclip()
    panel.close()
    entries: list[tuple[str, str, dict[str, Any]]] = [
        ("line", "68 %", {"stroke": BLUE, "stroke_width": 1.6}), ("line", "95 %", {"stroke": SKY, "stroke_width": 1.6}),
        ("o", "drawn orbit", {"color": GREY, "size": 1.4}),
    ]  # fmt: skip
    chart.height = chart.legend(entries, 257.0) + 4.0
    caption = Markup("{} from {}{}{}").format(
        moment(row["epoch_utc"]), row["telescope"], "" if row["V"] is None else f", V about {row['V']:.1f}",
        f"; {away} of {len(points)} drawn orbits lie outside of the picture" if away else "",
    )  # fmt: skip
    return chart.plate(
        f"The sky at {row['epoch_utc'][:16]}",
        caption,
        [csv(f"field-{k}", {"ra_deg": np.degrees(psi[:, 0]), "dec_deg": np.degrees(psi[:, 1])})],
    )


def _pictured(points: Array) -> Array:
    """Points (m, 2) without those few that lie so far out that the others would be squeezed."""
    away = np.abs(points - np.median(points, axis=0))
    far = np.max(away / np.maximum(np.quantile(away, 0.68, axis=0), 1e-12), axis=1)
    near = points[far <= np.quantile(far, PICTURED)]
    squeezed = (np.ptp(points, axis=0) > SQUEEZED * np.ptp(near, axis=0)).any()
    return near if squeezed else points


def _offsets(places_deg: Array, centre_deg: Array) -> Array:
    """Angles (n, 2) to the east and north of a place (2,) to others, deg: on the whole sky, and across 0 h."""
    about = Tangent.about(directions(np.radians(centre_deg[None])))
    return np.degrees(about.onto(directions(np.radians(places_deg))))


def _pieces(edge: Array) -> list[Array]:
    """A closed line (k, 2), parted where it leaves the plane on one side and comes back on the other."""
    steps = np.linalg.norm(np.diff(edge, axis=0), axis=1)
    leaps = np.flatnonzero(steps > LEAP * max(float(np.median(steps)), 0.01 * float(np.ptp(edge, axis=0).max())))
    return [piece for piece in np.split(edge, leaps + 1) if len(piece) > 1]


def _fields(rows: Sequence[Item]) -> Table | None:
    """Where to look, as a table."""
    if not rows:
        return None
    body = tuple(
        (
            row["epoch_utc"][:16].replace("T", " "), row["telescope"], f"{row['ra_deg']:.4f}", f"{row['dec_deg']:.4f}",
            f"{angle(row['semi_major_arcsec'], '°')} × {angle(row['semi_minor_arcsec'], '°')}",
            "–" if row["V"] is None else f"{row['V']:.1f}", sight(row) or "–",
        )
        for row in rows
    )  # fmt: skip
    head = ("UTC", "from", "RA, deg", "Dec, deg", "spread, 1σ", "V", "seen")
    told = "Mean place of the drawn orbits, ICRF."
    if len(rows) > MOST_FIELDS:
        told += f" The first {MOST_FIELDS} of {len(rows)} are drawn."
    return Table(caption=Markup(told), head=head, rows=body, align="llrrrrl")


def _corridor(summary: Item, arrays: Arrays) -> list[Plate]:
    """Maps of the points of fall."""
    if summary["impact"] is None:
        return []
    contours = summary["impact"]["contours_deg"]
    regions = [
        Corridor(
            name=f"region of {share} %",
            points=np.empty((0, 2)),
            outlines=[np.array(edge) for edge in contours[share]],
            outlines_name=f"{share} % of them",
            outline_look=look,
        )
        for share, look in REGIONS.items()
    ]
    return maps(
        "fall",
        [*regions, Corridor(name="end of a drawn orbit", points=arrays["fall_place_deg"])],
        "Where it may fall",
        Markup("Drawn orbits that hit the Earth, where they end: at a height drawn between the ground and 50 km."),
    )


def _decisions(rows: Sequence[Item]) -> Table | None:
    """What one more observation would do."""
    if not rows:
        return None
    body = tuple(
        (
            row["epoch_utc"][:16].replace("T", " "), row["telescope"],
            f"{number(row['settles'], 2)} ({number(row['settles_low'], 2)} to {number(row['settles_high'], 2)})",
            *(number(row["quantiles"][name], 2) for name in ("q16", "median", "q84")),
        )
        for row in rows
    )  # fmt: skip
    head = ("UTC", "from", "chance to settle it", "P then, 16 %", "median", "84 %")
    told = "Probability after one more observation of truths drawn from the posterior. "
    told += "Settled: below a tenth of what it is now, or above the middle between that and 1."
    return Table(caption=Markup(told), head=head, rows=body, align="llrrrr")
