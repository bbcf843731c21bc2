"""Tables of a fit's page."""

import math
import re

from markupsafe import Markup

from nebosvod.errors import counted
from nebosvod.report.kit.wording import DASH, number, percent, quantity
from nebosvod.report.run.tables import Cell, Table
from nebosvod.results.condensed import condensed, foremost, without
from nebosvod.results.folder import Item

MOST = 10  # sources, and numbers of stations, by themselves
FULL_NIGHT = re.compile(r", sqrt\((\d+)/(\d+)\)$")  # end of a rule: n observations of a night, more than so many
WIDENED = ", and by what they are widened where one station has more observations in a night than the rule counts"
REJECTED = 60  # shown; residuals.ecsv has them all
ELEMENTS = (
    ("a_au", "semi-major axis a", "au"), ("e", "eccentricity e", ""), ("q_au", "perihelion distance q", "au"),
    ("i_deg", "inclination i", "deg"), ("node_deg", "node Ω", "deg"), ("peri_deg", "argument of perihelion ω", "deg"),
    ("mean_anomaly_deg", "mean anomaly M", "deg"), ("tp_jd_tdb", "perihelion passage", "JD TDB"),
)  # fmt: skip
STATE = ("x", "y", "z", "vx", "vy", "vz")


def digits(value: float, sigma: float) -> tuple[str, str]:
    """A value to the second digit of its sigma, and the sigma."""
    places = 0
    while places < 14 and 0.0 < sigma * 10.0**places < 10.0:
        places += 1
    return f"{value:.{places}f}".replace("-", "−"), number(sigma, 2)


def elements(orbit: Item) -> Table | None:
    """Elements with one sigma."""
    found = orbit["elements"]
    if found is None:
        return None
    rows: list[tuple[Cell, ...]] = []
    for key, name, unit in ELEMENTS:
        value, sigma = digits(found[key]["value"], found[key]["sigma"])
        rows.append((name, Markup('<data value="{}">{}</data>').format(repr(found[key]["value"]), value), sigma, unit))
    return Table(
        caption=f"Elements, heliocentric, ecliptic of J2000, at {orbit['epoch_tdb']}",
        head=("element", "value", "1 sigma", "unit"),
        align="lrrl",
        rows=tuple(rows),
    )


def state(orbit: Item) -> Table:
    """State with one sigma."""
    rows: list[tuple[Cell, ...]] = []
    for k, name in enumerate(STATE):
        unit = "km" if k < 3 else "km/s"
        value, sigma = digits(orbit["state_km_km_s"][k], orbit["sigma_km_km_s"][k])
        exact = repr(orbit["state_km_km_s"][k])
        rows.append((name, Markup('<data value="{}">{}</data>').format(exact, value), sigma, unit))
    return Table(
        caption=f"State, heliocentric, ICRF axes, at {orbit['epoch_tdb']}",
        head=("", "value", "1 sigma", "unit"),
        align="lrrl",
        rows=tuple(rows),
    )


def parameters(estimator: Item, stations: list[str]) -> Table | None:
    """What else was estimated or considered, before and after: of stations, the farthest from zero."""
    shown, others = foremost(estimator["parameters"], stations, MOST)
    rows: list[tuple[Cell, ...]] = []
    for name, row in shown.items():
        before = DASH if row["prior_sigma"] is None else f"{row['prior_sigma']:.3g}"
        rows.append((name.replace("_", " "), f"{row['estimate']:.4g}", f"{row['sigma']:.2g}", before))
    if others:
        words = "other number" if rows else "number"
        rows.append((f"{counted(len(others), words)} of stations", "nearer to zero" if rows else "", "", ""))
    if not rows:
        return None
    return Table(
        caption="Beside the state: value, 1 sigma after and before the fit, units in the names"
        + ("; all of them in tables/parameters.ecsv" if others else ""),
        head=("", "value", "1 sigma", "before"),
        align="lrrr",
        rows=tuple(rows),
    )


def stations(fit: Item) -> Table:
    """Residuals by station."""
    rows: list[tuple[Cell, ...]] = []
    for row in fit["stations"]:
        cells = (row[f"{what}_{axis}_arcsec"] for what in ("rms", "mean") for axis in ("ra", "dec"))
        shown = (DASH if value is None else f"{value:.3f}".replace("-", "−") for value in cells)
        rows.append((row["station"], str(row["n_observations"]), str(row["n_selected"]), *shown))
    return Table(
        caption="Residuals by station, arcsec, selected observations",
        head=("station", "observations", "selected", "rms RA*", "rms Dec", "mean RA*", "mean Dec"),
        align="lrrrrrr",
        rows=tuple(rows),
    )


def rejected(fit: Item) -> Table | None:
    """Every rejected observation, worst first."""
    found = sorted(fit["rejected"], key=lambda row: -(row["chi"] or 0.0))
    if not found:
        return None
    rows: list[tuple[Cell, ...]] = [
        (
            row["utc"][:19].replace("T", " "),
            row["station"],
            f"{row['residual_ra_arcsec']:+.2f}".replace("-", "−"),
            f"{row['residual_dec_arcsec']:+.2f}".replace("-", "−"),
            DASH if row["chi"] is None else f"{row['chi']:.1f}",
            f"{row['file'].rpartition('/')[2]}:{row['line']}",
        )
        for row in found[:REJECTED]
    ]
    more = f", the worst {REJECTED} of {len(found)}" if len(found) > REJECTED else ""
    return Table(
        caption=f"Rejected observations{more}: residual, arcsec, and chi by the covariance of the residual",
        head=("UTC", "station", "RA*", "Dec", "chi", "record"),
        align="llrrrl",
        rows=tuple(rows),
    )


def weights(fit: Item) -> Table:
    """Which rules gave the weights; one row for a rule, however full the nights were that it widens."""
    found: dict[str, list[tuple[int, float]]] = {}
    for rule, n in fit["weights"].items():
        full = FULL_NIGHT.search(rule)
        factor = math.sqrt(int(full[1]) / int(full[2])) if full else 1.0
        found.setdefault(FULL_NIGHT.sub("", rule), []).append((int(n), factor))
    widened = any(factor != 1.0 for parts in found.values() for _, factor in parts)
    rows: list[tuple[Cell, ...]] = []
    for rule, parts in sorted(found.items(), key=lambda item: -sum(n for n, _ in item[1])):
        low, high = (f"{pick(factor for _, factor in parts):.3g}" for pick in (min, max))
        span = low if low == high else f"{low} to {high}"
        rows.append((rule, str(sum(n for n, _ in parts)), *([span] if widened else [])))
    return Table(
        caption="Where the sigmas came from" + (WIDENED if widened else ""),
        head=("rule", "observations", *(["sigmas times"] if widened else [])),
        align="lrr" if widened else "lr", rows=tuple(rows),
    )  # fmt: skip


def budget(rows: list[Item], stations: list[str]) -> Table | None:
    """What each source contributes to the state amid the arc: the largest, then the other stations together."""
    if not rows:
        return None
    return Table(
        caption="Share of each source in the variance of the position at the epoch of the fit, its sigmas alone, and "
        "what would remain of the position sigma if its error vanished (of a prior: were it known exactly) or halved "
        "and the weights stayed as they are (exact)"
        + ("; all of them in tables/budget.ecsv" if len(rows) > MOST else ""),
        head=("source", "share of position", "position", "velocity", "position if no error", "if halved"),
        align="lrrrrr",
        rows=tuple(
            (
                part.source,
                percent(part.share("share_position")),
                quantity(part.sigma("sigma_position_km"), "km"),
                quantity(part.sigma("sigma_velocity_m_s"), "m_s"),
                quantity(without(rows, part, "sigma_position_km"), "km"),
                quantity(without(rows, part, "sigma_position_km", 0.5), "km"),
            )
            for part in condensed(rows, stations, MOST)
        ),
    )


def reference(row: Item) -> Table:
    """The difference from a reference orbit by component."""
    ratio = row["sigma_ratio"]
    rows: list[tuple[Cell, ...]] = []
    for k, name in enumerate(STATE):
        unit = "km" if k < 3 else "km/s"
        rows.append(
            (
                name,
                f"{row['difference_km_km_s'][k]:+.4g} {unit}".replace("-", "−"),
                f"{row['sigmas'][k]:.2f}",
                DASH if ratio is None else f"{ratio[k]:.2f}",
            )
        )
    return Table(
        caption=f"This orbit minus {row['name']} at {row['epoch_tdb']}",
        head=("", "difference", "in sigmas", "sigma / its sigma"),
        align="lrrr",
        rows=tuple(rows),
    )
