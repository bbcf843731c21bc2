"""What would help: how well the telescopes must be known, and sigma against number, arc, cadence and noise."""

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from nebosvod.mission.reading.builtin import builtin_names
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import Download, csv
from nebosvod.report.kit.facts import leading
from nebosvod.report.kit.plate import BLUE, INK, ORANGE, VERMILION, Plate
from nebosvod.report.kit.scale import logarithmic, named
from nebosvod.report.kit.wording import DASH, NBSP, finite, quantity
from nebosvod.report.run.ledger import best_remedy, ledgers
from nebosvod.report.run.tables import Cell, Table
from nebosvod.results.folder import Item, RunFolder

GROWTHS: Mapping[float, tuple[str, str]] = {1.0: ("o", BLUE), 10.0: ("s", ORANGE), 50.0: ("^", VERMILION)}


def required_rows(run: RunFolder) -> list[Item]:
    """Rows of the inverse question, in the order of the leading predictions."""
    rows = (run.summary.get("noise_to_nuisance") or {}).get("required_position") or []
    order = [p["name"] for p in leading(run, run.main)] if run.main else []
    return sorted(rows, key=lambda r: order.index(r["prediction"]) if r["prediction"] in order else len(order))


def _limit(row: Item, percent: float, gain: str) -> float | None:
    """The size for one growth, None where none does it."""
    found: Item = next((one for one in row["limits"] if one["growth_percent"] == percent), {})
    value = found.get(f"sigma_position_{gain}_gain_km")
    return float(value) if finite(value) else None


def required_plate(run: RunFolder) -> Plate | None:
    """How well each telescope must be known for each prediction."""
    rows = required_rows(run)
    values = [v for r in rows for g in GROWTHS for k in ("new", "same") if (v := _limit(r, g, k)) is not None]
    if not values:
        return None
    now = [r["sigma_position_now_km"] for r in rows if finite(r.get("sigma_position_now_km"))]
    names = [f"{r['prediction']}, {r['telescope']}" for r in rows]
    high = 20.0 * len(rows)
    chart = Chart("required", height=0.0)
    x = logarithmic([*values, *now], "position sigma of the telescope, km")
    panel = chart.panel(x, named(names), top=6.0, bottom=6.0 + high)
    panel.open()
    for i, r in enumerate(rows):
        if finite(r.get("sigma_position_now_km")):
            panel.dots([r["sigma_position_now_km"]], [-i], "|", "now", color=INK)
    for growth, (marker, colour) in GROWTHS.items():
        for kind, name in (("same", "gain as it is"), ("new", "re-optimised")):
            points = [(v, -float(i)) for i, r in enumerate(rows) if (v := _limit(r, growth, kind)) is not None]
            if points:
                hollow = {"o": "O", "s": "S", "^": "^"}[marker] if kind == "same" else marker
                panel.marks(points, hollow, f"+{growth:g} %, {name}", color=colour, hollow=kind == "same", size=6.0)
    panel.close()
    entries: list[tuple[str, str, dict[str, Any]]] = [("|", "now", {"color": INK})] if now else []
    entries += [(m, f"sigma grows by {g:g} %", {"color": c, "size": 6.0}) for g, (m, c) in GROWTHS.items()]
    entries.append(("O", "hollow: gain as it is", {"color": BLUE}))
    chart.height = chart.legend(entries, high + 52.0)
    return chart.plate("Telescope position sigma at which each prediction's sigma grows by 1, 10 and 50 per cent",
                       required_sentence(run, 1.0) or Markup(""), [_required_data(rows)])  # fmt: skip


def _required_data(rows: Sequence[Item]) -> Download:
    """The figure's numbers."""
    columns: dict[str, Sequence[Any]] = {
        "prediction": [r["prediction"] for r in rows], "telescope": [r["telescope"] for r in rows],
        "sigma_position_now_km": [r.get("sigma_position_now_km") for r in rows],
    }  # fmt: skip
    for growth in GROWTHS:
        for kind in ("new", "same"):
            columns[f"grows_{growth:g}_percent_{kind}_gain_km"] = [_limit(r, growth, kind) for r in rows]
    return csv("required-position", columns)


def required_sentence(run: RunFolder, growth: float) -> Markup | None:
    """What the leading prediction asks of the telescope that it asks most of."""
    rows = required_rows(run)
    rows = [r for r in rows if r["prediction"] == rows[0]["prediction"] and _limit(r, growth, "new") is not None]
    if not rows:
        return None
    tight = min(rows, key=lambda r: _limit(r, growth, "new") or 0.0)
    needed, now = _limit(tight, growth, "new") or 0.0, tight.get("sigma_position_now_km")
    text = Markup(
        "For the sigma of {} to grow by less than {:g}{}% over perfectly known telescopes, the position of {} must be "
        "known to {}"
    ).format(
        tight["prediction"], growth, NBSP, tight["telescope"], quantity(needed, "km"))  # fmt: skip
    if finite(now):
        verdict = "it is, with" if now <= needed else "it is not, with"
        text += Markup(" ({} {})").format(verdict, quantity(now, "km"))
    return Markup("{}.").format(text)


def required_table(run: RunFolder) -> Table | None:
    """The inverse question in numbers: re-optimised, and with the gain as it is."""
    rows: list[tuple[Cell, ...]] = []
    for r in required_rows(run):
        unit = next(k for k in r if k.startswith("sigma_total_perfect_")).removeprefix("sigma_total_perfect_")
        cells: list[Cell] = [
            r["prediction"],
            r["telescope"],
            r.get("assumed") or quantity(r.get("sigma_position_now_km"), "km"),
            quantity(r[f"sigma_total_perfect_{unit}"], unit),
        ]
        for growth in GROWTHS:
            one: Item = next((x for x in r["limits"] if x["growth_percent"] == growth), {})
            new, same = (one.get(f"sigma_position_{k}_gain_km") for k in ("new", "same"))
            reason = Markup('<span class="said">{}</span>').format(one.get("reason") or DASH)
            first = quantity(new, "km") if finite(new) else reason
            cells.append(Markup("{}<br>{}").format(first, quantity(same, "km")))
        rows.append(tuple(cells))
    if not rows:
        return None
    return Table(
        caption="Position sigma of a telescope (1σ of each axis) at which the total sigma of a prediction has grown "
        "so much over a perfectly known telescope: above with the gain re-optimised, below with the gain as it is",
        head=("prediction", "telescope", "now", "sigma if perfect", *(f"grows by {g:g}{NBSP}%" for g in GROWTHS)),
        align="llrrrrr", rows=tuple(rows),
    )  # fmt: skip


RATIOS = ("eta_db_mean", "eta_all_db_mean", "eta_effective_db_mean", "eta_whitened_db_mean")


def limit_table(run: RunFolder) -> Table | None:
    """How well each telescope must be known for a wanted noise-to-nuisance ratio of one measurement."""
    block = run.summary.get("noise_to_nuisance") or {}
    parts = block.get("by_telescope") or []
    parts = [*parts, {"telescope": "all", **block}] if block.get("sigma_z_limit_km") else parts
    rows: list[tuple[Cell, ...]] = []
    for one in parts:
        cells: list[Cell] = [one["telescope"]]
        cells += [quantity(one.get(k)) for k in RATIOS]
        cells.append(quantity(one.get("sigma_equivalent_arcsec"), "arcsec"))
        cells += [quantity(one.get(f"sigma_z_critical_{k}_km"), "km") for k in ("min", "max")]
        cells += [_both_limits(one, key, limit) for key, limit in one["sigma_z_limit_km"].items()]
        rows.append(tuple(cells))
    if not rows:
        return None
    limits = [key.replace("_", NBSP) for key in parts[-1]["sigma_z_limit_km"]]
    return Table(
        caption="Noise-to-nuisance ratio, dB (each measurement by itself; with all nuisances; counted with all that a "
        "common nuisance touches; whitened), the sigma of one measurement with its nuisances, and the telescope "
        "position sigma that is as large as the noise, or alone keeps the ratio at a limit: above for the median "
        "measurement, below for the mean ratio, in which the measurements nearest to the object count most",
        head=("telescope", "mean ratio", "with all", "effective", "whitened", "noise and nuisances", "critical, least",
              "critical, most", *limits),
        align="l" + "r" * (7 + len(limits)), rows=tuple(rows),
    )  # fmt: skip


def _both_limits(one: Item, key: str, median_km: float | None) -> Markup:
    """The position sigma for a limit of the ratio: for the median measurement, and for the mean of all."""
    by_mean = mean_limit_km(one, float(key.removesuffix("_dB")))
    return quantity(median_km, "km") if by_mean is None else Markup("{}<br>{}").format(
        quantity(median_km, "km"), quantity(by_mean, "km"))  # fmt: skip


def mean_limit_km(one: Item, limit_db: float) -> float | None:
    """The position sigma that, as the only nuisance, makes the mean ratio of noise to nuisance as large as a limit.

    Notes
    -----
    The mean is a ratio of sums, so the sigma that stands for all nuisances together is scaled by what is missing.
    """
    size, now = one.get("sigma_z_equivalent_km"), one.get("eta_db_mean")
    return float(size * 10.0 ** ((now - limit_db) / 20.0)) if finite(size) and finite(now) else None


def remedy_sentence(run: RunFolder, main: Item) -> Markup | None:
    """Which single source, halved, helps the leading prediction most; and whether more of the same would."""
    books = ledgers(run, main)
    best = best_remedy(books[0], "if_halved") if books else None
    if best is None:
        return None
    left = best.then["if_halved", "new"] or 0.0
    text = Markup("Halving the error of {} would bring {} from {} to {}").format(
        best.source, books[0].title, quantity(books[0].total, books[0].unit), quantity(left, books[0].unit)
    )  # fmt: skip
    block = next((b for b in run.summary.get("curves") or [] if b["prediction"] == books[0].title), None)
    sparse = ((block or {}).get("cadence") or {}).get(f"sigma_total_{books[0].unit}") or []
    if len(sparse) > 1 and finite(sparse[1]):
        text += Markup("; half as many measurements over the same arc would make it {}").format(
            quantity(sparse[1], books[0].unit)
        )
    return Markup("{}.").format(text)


def brief_sentence(run: RunFolder, main: Item) -> Markup | None:
    """The best single remedy, and how well the telescope must be known that matters most; None without either."""
    parts = []
    books = ledgers(run, main)
    best = best_remedy(books[0], "if_halved") if books else None
    if best is not None:
        unit = books[0].unit
        parts.append(Markup("Halving the error of {} brings {} from {} to {}").format(
            best.source, books[0].title, quantity(books[0].total, unit), quantity(best.then["if_halved", "new"], unit)
        ))  # fmt: skip
    rows = required_rows(run)
    rows = [r for r in rows if r["prediction"] == rows[0]["prediction"] and _limit(r, 10.0, "new") is not None]
    if rows:
        tight = min(rows, key=lambda r: _limit(r, 10.0, "new") or 0.0)
        now = tight.get("sigma_position_now_km")
        said = Markup("position tolerance of {} for 10{}% growth: {}").format(
            tight["telescope"], NBSP, quantity(_limit(tight, 10.0, "new"), "km"))  # fmt: skip
        parts.append(said + (Markup(" (now {})").format(quantity(now, "km")) if finite(now) else Markup("")))
    return Markup("; ").join(parts) + "." if parts else None


def plan_sentence(run: RunFolder) -> Markup | None:
    """Which command says what to measure next."""
    if run.main is None or not leading(run, run.main):
        return None
    name = leading(run, run.main)[0]["name"]
    word, mission = f"“{name}”" if " " in name else name, run.summary["mission"]
    return Markup(
        'Which measurement next, and when: <code>nebosvod plan {} --prediction "{}"</code> ranks them by how much they '
        "shrink {} per hour."
    ).format(
        mission if mission in builtin_names() else "MISSION.yaml", name, word)  # fmt: skip
