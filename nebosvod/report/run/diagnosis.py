"""What the residuals say of the model, on the pages of runs and fits: sentences, tests of biases and patterns."""

from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import GREY, SERIES, Plate
from nebosvod.report.kit.scale import linear, logarithmic
from nebosvod.report.kit.wording import DASH, NBSP, count, moment, number, percent, quantity, series
from nebosvod.report.run.tables import Cell, Table
from nebosvod.results.folder import Array, Item, RunFolder

DASHED = "5 3"
MOST_SHOWN = 12  # telescopes without a bias whose tests are shown


def sentences(run: RunFolder) -> list[str]:
    """What was found, what would hurt most, and that nothing was found where that is so."""
    found = run.summary.get("diagnosis")
    if not found:
        return []
    said = [f"{text[:1].upper()}{text[1:]}." for text in found["findings"]]
    asked = len(found["bias_tests"]), len(found["residual_tests"])
    if not said and any(asked):
        who = "station" if "fit" in run.summary else "telescope"
        made = [
            f"no {what} in tests of {count(n, who)}" for what, n in zip(("bias", "pattern"), asked, strict=True) if n
        ]
        few = [f"no {who} has enough measurements for a test of {w}" for w, n in
               zip(("biases", "patterns"), asked, strict=True) if not n]  # fmt: skip
        alarm = f"chance of a false alarm {100.0 * found['level']:g}{NBSP}%{' in either' if not few else ''}"
        said.append(f"Residuals look like noise: {'; '.join([', '.join(made), *few, alarm])}.")
    if found["worst_rhythm"]:
        text = found["worst_rhythm"]["told"]
        said.append(f"{text[:1].upper()}{text[1:]}.")
    return said


def bias_table(run: RunFolder) -> Table | None:
    """Both hypotheses for each telescope; of many, for those that have a bias and those with most measurements."""
    rows: list[tuple[Cell, ...]] = []
    tests: list[Item] = list((run.summary.get("diagnosis") or {}).get("bias_tests", ()))
    largest = {one["telescope"] for one in sorted(tests, key=lambda one: -one["n"])[:MOST_SHOWN]}
    chosen = [one for one in tests if one["telescope"] in largest or one["verdict"] != "no bias"]
    for one in chosen:
        for form in ("constant", "appearing"):
            h = one[form]
            if h is None:
                continue
            size = series(h["bias_arcsec"], "arcsec")
            sigma = series(h["sigma_arcsec"], "arcsec")
            found = one[f"found_{form}_arcsec"] or {}
            since = DASH if h["since_tdb"] is None else moment(h["since_tdb"])
            told = "yes" if one["verdict"] == form else "no"
            rows.append((
                one["telescope"], form, since, size, sigma, number(h["statistic"]), _chance(h["chance"]), told,
                quantity(found.get("0.9"), "arcsec"), quantity(h["shift_km"], "km"),
            ))  # fmt: skip
    if not rows:
        return None
    return Table(
        caption="Is there a bias: none (H0) against one that is there all the time, and one that appears (H1, the best "
        "of several moments)"
        + (f"; {len(tests) - len(chosen)} more were asked and have none" if len(tests) > len(chosen) else ""),
        head=("telescope", "bias", "since", "RA cos Dec, Dec", "1σ", "drop of χ²", "by chance", "found",
              f"found with 90{NBSP}% from", "moves the orbit by"),
        align="lllrrrrlrr", rows=tuple(rows),
    )  # fmt: skip


def residual_table(run: RunFolder) -> Table | None:
    """Runs, correlation and rhythm of each component of each telescope."""
    rows: list[tuple[Cell, ...]] = []
    for one in (run.summary.get("diagnosis") or {}).get("residual_tests", ()):
        for s in one["series"]:
            rows.append((
                one["telescope"], s["axis"].replace("RA*", "RA cos Dec"), str(one["n"]), number(one["scatter"]),
                f"{s['runs']} of {s['runs_expected']:.0f}", _chance(s["runs_chance"]),
                f"{s['correlation']:+.2f} ({s['lag']})", _chance(s["correlation_chance"]),
                _period(s["period_s"]), number(s["amplitude_sigmas"], 2), _chance(s["rhythm_chance"]),
                DASH if s["at_worst_chance"] is None else _chance(s["at_worst_chance"]),
            ))  # fmt: skip
    if not rows:
        return None
    return Table(
        caption="Are the residuals noise: recursive residuals in sigmas, each test with the chance of as much by noise",
        head=("telescope", "", "n", "rms, σ", "runs of expected", "by chance", "correlation (lag)", "by chance",
              "strongest rhythm", "amplitude, σ", "by chance", "power at the worst rhythm, by chance"),
        align="llrrrrrrrrrr", rows=tuple(rows),
    )  # fmt: skip


def power_plate(run: RunFolder) -> Plate | None:
    """Chance to find a bias by its size, for each telescope: there all the time, and from the middle on."""
    drawn: list[tuple[str, str, Array, Array]] = []
    sizes, power = run.array("bias_size_arcsec"), run.array("bias_power")
    if sizes is None or power is None:
        return None
    for i, one in enumerate(run.summary["diagnosis"]["bias_tests"][:MOST_SHOWN]):
        for k, form in enumerate(("constant", "appearing")):
            if np.isfinite(power[i, k]).all():
                drawn.append((one["telescope"], form, sizes[i, k, 1:], power[i, k, 1:]))
    if not drawn:
        return None
    chart = Chart("power", height=0.0)
    reach = max(float(sizes[np.argmax(power > 0.999)]) for *_, sizes, power in drawn)
    x = logarithmic([min(float(sizes[0]) for *_, sizes, _ in drawn), reach], "size of the bias, arcsec")
    panel = chart.panel(x, linear([0.0, 1.0], "found", pad=0.0), top=8.0, bottom=168.0)
    panel.level(0.9, stroke=GREY, stroke_width=0.7)
    panel.open()
    entries: list[tuple[str, str, dict[str, Any]]] = []
    telescopes = list(dict.fromkeys(name for name, *_ in drawn))
    columns: dict[str, Any] = {}
    for name, form, sizes, power in drawn:
        colour = SERIES[telescopes.index(name) % len(SERIES)][0]
        look: dict[str, Any] = {"stroke": colour, "stroke_width": 1.6}
        if form == "appearing":
            look["stroke_dasharray"] = DASHED
        shown = sizes <= reach * 1.0001
        panel.line(sizes[shown], power[shown], f"{name}, {form}", **look)
        entries.append(("line", f"{name}, {'all the time' if form == 'constant' else 'from the middle on'}", look))
        columns |= {f"size_arcsec_{name}_{form}": sizes, f"found_{name}_{form}": power}
    panel.close()
    chart.height = chart.legend(entries, 214.0)
    level = (run.summary.get("diagnosis") or {})["level"]
    caption = Markup(
        "How large a bias must be to be found, in the direction that is hardest to see, while the chance of a false "
        "alarm among all telescopes is {}: {}."
    ).format(percent(level), Markup("; ").join(_found(run, one) for one in telescopes))
    return chart.plate("Chance to find a bias by its size, for each telescope", caption, [csv("power", columns)])


def _found(run: RunFolder, telescope: str) -> Markup:
    """Sizes that one telescope's tests find nine times of ten."""
    one: Item = next(t for t in run.summary["diagnosis"]["bias_tests"] if t["telescope"] == telescope)
    sizes = [(one[f"found_{form}_arcsec"] or {}).get("0.9") for form in ("constant", "appearing")]
    return Markup("{} finds {} of it nine times of ten, {} if it appears in the middle").format(
        telescope, quantity(sizes[0], "arcsec"), quantity(sizes[1], "arcsec")
    )


def _chance(value: float) -> str:
    """A chance, small ones as a power of ten."""
    return f"{value:.2f}" if value >= 0.095 else number(value, 2) if value >= 1e-3 else f"{value:.0e}"


def _period(seconds: float) -> str:
    """A period in days, or hours."""
    return f"{number(seconds / 86400.0)}{NBSP}d" if seconds >= 86400.0 * 0.5 else f"{number(seconds / 3600.0)}{NBSP}h"
