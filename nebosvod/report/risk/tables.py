"""Tables of a risk."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from nebosvod.report.kit.wording import DASH, MINUS, NBSP, moment, number, percent, product, quantity
from nebosvod.report.risk.draws import Arrays, draws_of
from nebosvod.report.risk.words import body_name, chance, way_name
from nebosvod.report.run.tables import Cell, Table
from nebosvod.timescale import Epoch

Item = Mapping[str, Any]
QUANTILES = [
    ("one end", 0.0),
    ("5 %", 0.05),
    ("25 %", 0.25),
    ("middle", 0.5),
    ("75 %", 0.75),
    ("95 %", 0.95),
    ("the other end", 1.0),
]


def impactor_table(rows: Sequence[Item]) -> Table | None:
    """Every virtual impactor, by date."""
    if not rows:
        return None
    columns: list[tuple[str, str, Callable[[Item], Cell]]] = [
        ("body", "l", lambda row: body_name(row["body"]).removeprefix("the ")),
        ("time", "l", lambda row: moment(row["epoch_utc"])),
        ("1σ", "r", lambda row: quantity(row["sigma_time_s"], "s")),
        ("probability, 95 %", "r", chance),
        ("by", "l", lambda row: way_name(row["recommended"])),
        ("ν, sigmas", "r", lambda row: _signed(row.get("sigmas"))),
        ("stretching, km/σ", "r", lambda row: _plain(row.get("stretching_km"))),
        ("v∞", "r", lambda row: _speed(_incoming(row))),
        ("energy", "r", lambda row: DASH if row["energy_mt"] is None else f"{number(row['energy_mt'])} Mt"),
        ("Palermo, Torino", "r", _scales),
    ]
    used = [c for c in columns if any(c[2](row) != DASH for row in rows)]
    cells: list[tuple[Cell, ...]] = [tuple(make(row) for _, _, make in used) for row in rows]
    return Table(
        caption="Virtual impactors: sets of orbits inside the uncertainty that hit one body at one encounter.",
        head=tuple(name for name, _, _ in used), align="".join(letter for _, letter, _ in used), rows=tuple(cells),
    )  # fmt: skip


def _plain(value: float | None) -> str:
    return DASH if value is None else number(value)


def _signed(value: float | None) -> str:
    """Sigmas with two decimals."""
    return DASH if value is None else f"{value:.2f}".replace("-", "−")


def _scales(row: Item) -> str:
    """Palermo scale, and Torino where it is defined."""
    if row["palermo"] is None:
        return DASH
    return f"{row['palermo']:.2f}".replace("-", MINUS) + ("" if row["torino"] is None else f", {row['torino']}")


def _incoming(row: Item) -> float | None:
    """Speed at infinity: of the drawn orbits, or of the estimate."""
    known = [row.get("v_infinity_km_s"), (row["approach"] or {}).get("v_infinity_km_s")]
    return next((float(value) for value in known if value is not None), None)


def _speed(value: float | None) -> str:
    return DASH if value is None else f"{value:.2f} km/s"


def ways_table(row: Item) -> Table:
    """Every way: probability, orbits flown, hits, what limits it."""
    cells: list[tuple[Cell, ...]] = []
    for way in row["ways"]:
        best = " (recommended)" if way["way"] == row["recommended"] else ""
        drawn = f"{way['hits']} of {way['draws']}" if way["draws"] else DASH
        effective = number(way["effective_hits"], 4) if way["draws"] else DASH
        cells.append((way_name(way["way"]) + best, chance(way), drawn, effective, way["note"] or DASH))
    head = ("way", "probability, 95 %", "hits", "effective hits", "note")
    return Table(caption="The ways side by side; the target is the same for all.", head=head, align="lrrrw",
                 rows=tuple(cells))  # fmt: skip


def budget_table(row: Item) -> Table | None:
    """Each source: elasticity, share along the line, and the probability if it were halved."""
    budget = row.get("budget") or {}
    rows = budget.get("rows") or []
    if not rows:
        return None
    odds = rows[0]["log_odds"] is not None
    anew = any(one.get("elasticity_reoptimised") is not None for one in rows)
    cells: list[tuple[Cell, ...]] = [
        (
            one["source"],
            _with_error(one["elasticity"], one["elasticity_error"]),
            *([_reoptimised(one)] if anew else []),
            *([_with_error(one["log_odds"], one["log_odds_error"])] if odds else []),
            DASH if one["share"] is None else percent(one["share"]),
            _share_with_error(one["probability_if_halved"], one["probability_if_halved_error"]),
        )
        for one in rows
    ]
    head = (
        "source", "d ln P / d ln σ, estimate held", *(["re-optimised"] if anew else []),
        *(["d ln P/(1−P) / d ln σ"] if odds else []), "share along the line", "P if it were halved, estimate held",
    )  # fmt: skip
    few = "" if budget["enough"] else " Too few hits for elasticities to be more than a hint."
    nu = "" if budget["sigmas"] is None else f" The hits lie {_signed(budget['sigmas'])} sigmas along the line."
    moves = "; re-optimised the weights are solved anew, of the same records, and the estimate moves" if anew else ""
    caption = Markup(
        "What the probability of {} hangs on, by {} effective hits, with standard errors. The estimate and its weights "
        "are held{}.{}{}"
    ).format(percent(budget["probability"]), number(budget["effective_hits"], 4), moves, nu, few)
    return Table(caption=caption, head=head, align="l" + "r" * (len(head) - 1), rows=tuple(cells))


def _reoptimised(one: Item) -> str:
    known = one.get("elasticity_reoptimised") is not None
    return _with_error(one["elasticity_reoptimised"], one["elasticity_reoptimised_error"]) if known else DASH


def _with_error(value: float, error: float) -> str:
    digits = 2 if error < 0.5 else 1
    return f"{value:+.{digits}f} ± {error:.{digits}f}".replace("-", "−")


def _share_with_error(value: float, error: float) -> str:
    """A probability with two digits of its error."""
    if value < 1e-3:
        return f"{number(value, 2)} ± {number(error, 1)}"
    n = min(max(1 - math.floor(math.log10(100.0 * error)), 0), 5) if error > 0.0 else 2
    return f"{100.0 * value:.{n}f} ± {100.0 * error:.{n}f} %"


def encounter_table(row: Item) -> Table | None:
    """What is known of the encounter of the estimate itself; None where it has none."""
    one = row["approach"]
    if one is None:
        return None
    facts: list[tuple[str, Cell]] = [
        ("time of the estimate", moment(one["epoch_utc"])),
        ("1σ of it", quantity(one["sigma_time_s"], "s")),
        ("distance from the centre", quantity(one["distance_km"], "km", 5)),
        ("1σ of it", quantity(one["sigma_distance_km"], "km")),
        ("ξ, ζ", Markup("{}, {}").format(quantity(one["xi_km"], "km", 6), quantity(one["zeta_km"], "km", 6))),
        ("long axis of the ellipse, 1σ", quantity(one["semi_major_km"], "km", 4)),
        ("short axis", quantity(one["semi_minor_km"], "km")),
        ("its long axis from +ξ towards +ζ", quantity(one["angle_deg"], "deg", 4)),
        ("capture radius", quantity(one["capture_radius_km"], "km", 5)),
        ("v∞", _speed(one["v_infinity_km_s"])),
    ]  # fmt: skip
    if one["longitude_deg"] is not None:
        facts.append(("the estimate comes down at", place(one["longitude_deg"], one["latitude_deg"])))
    return Table(caption="The encounter of the estimate", head=("", "value"), align="lr", rows=tuple(facts))


def corridor_table(row: Item, arrays: Arrays, epoch_tdb: str) -> Table | None:
    """Places along the corridor of the Earth from end to end, as the hits lie in the target plane."""
    if row["body"] != "earth":
        return None
    draws = draws_of(row["number"], arrays)
    t_s, hits = np.asarray(draws["hit_t_s"]), np.asarray(draws["hits"], dtype=np.bool_)
    chosen = np.flatnonzero(hits & np.isfinite(t_s) & np.isfinite(draws["longitude_deg"]))
    if not len(chosen):
        return None
    chosen = chosen[np.argsort(_along(np.asarray(draws["xi_zeta_km"])[chosen], t_s[chosen]), kind="stable")]
    start = Epoch.parse(epoch_tdb)
    digits = _digits(draws, chosen)
    passed = np.cumsum(np.asarray(draws["weights"])[chosen])
    cells: list[tuple[Cell, ...]] = []
    for name, part in QUANTILES if len(chosen) > 1 else [("the only one", 0.0)]:
        k = chosen[min(int(np.searchsorted(passed, part * passed[-1])), len(chosen) - 1)]
        cells.append((
            name, _second((start + float(t_s[k])).iso("utc", 0)),
            place(float(draws["longitude_deg"][k]), float(draws["latitude_deg"][k]), digits),
            f"{draws['speed_km_s'][k]:.2f} km/s", f"{draws['elevation_deg'][k]:.1f}°",
        ))  # fmt: skip
    head = ("of the hits", "UTC", "place on the ground, geodetic", "speed", "below the horizon")
    return Table(caption="The corridor from end to end", head=head, align="lllrr", rows=tuple(cells))


def _along(points: npt.NDArray[np.float64], t_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Places (n,) along the long direction of points (n, 2) of the target plane, rising with time; else times."""
    if len(points) < 3 or not np.isfinite(points).all():
        return t_s
    centred = points - points.mean(axis=0)
    along: npt.NDArray[np.float64] = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    return along if along @ (t_s - t_s.mean()) >= 0.0 else -along


def level_table(row: Item) -> Table | None:
    """Entry at 100 km, of the Earth alone, and impact: mean time, mean place, ellipse or why none, speed, angle."""
    names = {"entry_100_km": "100 km", "ground": "the ground"} if row["body"] == "earth" else {"ground": "the surface"}
    levels = [
        (name, level) for key, name in names.items()
        if (level := (row.get("corridor") or {}).get(key)) is not None
    ]  # fmt: skip
    if not levels:
        return None
    cells: list[tuple[Cell, ...]] = []
    for name, one in levels:
        where = DASH if one["longitude_deg"] is None else place(one["longitude_deg"], one["latitude_deg"])
        ellipse: Cell = one["no_ellipse"] or DASH
        if one["semi_major_km"] is not None:
            ellipse = Markup("{}, {} from east to north").format(
                product([one["semi_major_km"], one["semi_minor_km"]], "km"), quantity(one["angle_from_east_deg"], "deg")
            )
        when = Markup("{} ± {}").format(_second(one["epoch_utc"]), quantity(one["sigma_time_s"], "s"))
        cells.append((name, when, where, ellipse, _speed(one["speed_km_s"]), f"{one['below_horizon_deg']:.1f}°"))
    head = ("at", "UTC, 1σ", "mean place, geodetic", "ellipse, 1σ", "speed", "below the horizon")
    return Table(
        caption="Where and when it comes down, of the drawn orbits that hit",
        head=head,
        align="lllwrr",
        rows=tuple(cells),
    )


def _second(epoch_utc: str) -> Markup:
    """Date and time to the second, not to be broken."""
    return Markup('<span class="nowrap">{}</span>').format(epoch_utc[:19].replace("T", " "))


def _digits(draws: Arrays, chosen: npt.NDArray[np.intp]) -> int:
    """Decimals that tell the places of a corridor apart."""
    spread = float(np.ptp(np.asarray(draws["latitude_deg"])[chosen]))
    return 2 if spread <= 0.0 else min(max(2, math.ceil(-math.log10(spread)) + 1), 5)


def place(longitude_deg: float, latitude_deg: float, digits: int = 2) -> str:
    """`23.30° E, 21.20° S`."""
    east, north = ("E" if longitude_deg >= 0.0 else "W"), ("N" if latitude_deg >= 0.0 else "S")
    return f"{abs(longitude_deg):.{digits}f}°{NBSP}{east}, {abs(latitude_deg):.{digits}f}°{NBSP}{north}"
