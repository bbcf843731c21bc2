"""What the page of `nebosvod alert` says of the fall and of the answers after each observation: figure and tables."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.impacts.chance import LEAST, digits
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import BLUE, GREEN, GREY, VERMILION, Plate
from nebosvod.report.kit.scale import Scale, linear, logarithmic
from nebosvod.report.kit.wording import DASH, MINUS, moment, number
from nebosvod.report.run.tables import Cell, Table
from nebosvod.results.alert_words import duration, top_of
from nebosvod.timescale import Epoch

Item = Mapping[str, Any]
PRIORS = {
    "uniform": ("uniform in range and rate", BLUE, "o"),
    "cartesian": ("uniform in space and velocity", VERMILION, "s"),
    "jeffreys": ("Jeffreys’", GREEN, "^"),
}
DECADES = 100.0  # ratio of probabilities from which their axis is logarithmic
FLOOR = 0.1  # of the least probability, down to which a logarithmic axis shows ends of intervals


def chance(row: Item) -> Cell:
    """A probability with its interval, or the bound."""
    if row["bound"]:
        return Markup("&lt; {}").format(number(row["high"], 2))
    n = digits(row["low"])
    ends = (row["low"] if row["low"] >= LEAST else 0.0, row["high"])
    return Markup("{} ({} to {})").format(*(number(value, n) for value in (row["probability"], *ends)))


def fall_table(fall: Item | None) -> Table | None:
    """Where it may fall, in numbers."""
    if fall is None:
        return None
    at = f"at {fall['entry_km']:.0f} km"
    parts = (
        ("longitude, deg", fall["longitude_deg"], 2), ("latitude, deg", fall["latitude_deg"], 2),
        (f"speed {at}, km/s", fall["speed_km_s"], 2), (f"angle below the horizon {at}, deg", fall["elevation_deg"], 1),
    )  # fmt: skip
    rows = tuple(
        (label, *(_fixed(row[name], n) for name in ("q025", "q16", "median", "q84", "q975"))) for label, row, n in parts
    )
    told = Markup("If it hits: {} ± {} (68 %).").format(moment(fall["epoch_utc"]), duration(fall["half_68_s"]))
    told += " East and north are positive; longitudes run on across the date line."
    return Table(caption=told, head=("", "2.5 %", "16 %", "median", "84 %", "97.5 %"), rows=rows, align="lrrrrr")


def _fixed(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}".replace("-", MINUS)


def history_figure(rows: Sequence[Item]) -> Plate:
    """Probabilities after each observation, with their intervals."""
    start = Epoch.parse(rows[0]["epoch_utc"])
    t = np.array([Epoch.parse(row["epoch_utc"]) - start for row in rows]) / 3600.0
    up = _chance_axis([one for row in rows for one in row["chances"].values()])
    chart = Chart("chances-by-time", height=300.0)
    panel = chart.panel(
        linear(t, f"h after {rows[0]['epoch_utc'][:16].replace('T', ' ')} UTC"), up, top=8.0, bottom=225.0
    )
    panel.open()
    columns: dict[str, Any] = {
        "epoch_utc": [row["epoch_utc"] for row in rows],
        "observations": [row["n_observations"] for row in rows],
    }
    bounded = False
    for prior, (name, color, marker) in PRIORS.items():
        known = [(t[k], row["chances"][prior]) for k, row in enumerate(rows) if prior in row["chances"]]
        x, p = np.array([at for at, _ in known]), np.array([top_of(one) for _, one in known])
        bound = np.array([one["bound"] for _, one in known], dtype=bool)
        ends = np.array([[max(one["low"], up.low), one["high"], np.nan] for _, one in known]).reshape(-1, 3)
        panel.line(np.repeat(x[~bound], 3), ends[~bound].ravel(), stroke=color, stroke_width=1.0)
        panel.line(x, p, name, stroke=color, stroke_width=1.4)
        panel.dots(x[~bound], p[~bound], marker, name, color=color, size=3.0)
        panel.dots(x[bound], p[bound], "v", f"{name}: below", color=color, hollow=True)
        bounded |= bool(bound.any())
        chances = [row["chances"].get(prior, {}) for row in rows]
        columns |= {
            f"{prior}{end}": [one.get(key) for one in chances]
            for end, key in (("", "probability"), ("_low", "low"), ("_high", "high"))
        }
    panel.close()
    entries: list[tuple[str, str, dict[str, Any]]] = [
        (marker, name, {"color": color, "size": 3.0}) for name, color, marker in PRIORS.values()
    ]
    if bounded:
        entries.append(("v", "below (95 %)", {"color": GREY, "hollow": True}))
    chart.height = chart.legend(entries, 267.0) + 4.0
    caption = Markup("Probability of impact after each observation, by prior, with intervals of 95 %.")
    return chart.plate("Probability of impact by time", caption, [csv("history", columns)])


def _chance_axis(chances: Sequence[Item]) -> Scale:
    """From 0 to 1, or logarithmic where probabilities span more than two decades."""
    p = [top for top in map(top_of, chances) if top > LEAST]
    if not p or max(p) <= DECADES * min(p):
        return linear([0.0, 1.0], "probability of impact")
    lows = [one["low"] for one in chances if one["low"] > FLOOR * min(p)]
    return logarithmic([min(p), *lows, *(one["high"] for one in chances)], "probability of impact")


def history_table(rows: Sequence[Item], headline: str) -> Table | None:
    """What was known after each observation, in numbers."""
    if not rows:
        return None
    body = tuple(
        (
            str(row["n_observations"]), row["epoch_utc"][:16].replace("T", " "), chance(row["chances"][headline]),
            number(row["range_au"], 3), *(_ends(row["corridor"], name) for name in ("longitude_deg", "latitude_deg")),
        )
        for row in rows
    )  # fmt: skip
    head = ("observations", "UTC", "probability", "range, au", "longitude, deg", "latitude, deg")
    told = f"After each observation; prior {PRIORS[headline][0]}. Longitude and latitude of the fall: middle 95 %."
    return Table(caption=Markup(told), head=head, rows=body, align="llrrrr")


def _ends(corridor: Item | None, name: str) -> str:
    """The middle 95 % of a coordinate of the fall."""
    if corridor is None:
        return DASH
    return " to ".join(_fixed(corridor[name][end], 2) for end in ("q025", "q975"))
