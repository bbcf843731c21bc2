"""The tables of the page: rows of ready text from the numbers of a run."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from nebosvod.estimation.accuracy.formed import matrix_of
from nebosvod.mission.vocabulary import METHODS
from nebosvod.report.kit import wording
from nebosvod.report.kit.facts import formal_ratio, impact_clause, leading, when
from nebosvod.report.kit.typography import Verbatim
from nebosvod.report.kit.wording import DASH, finite, percent, product, quantity, series
from nebosvod.results.folder import Item, RunFolder
from nebosvod.results.outlook import unit_of
from nebosvod.results.ownership import MARK

Cell = str | Markup


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Column heads, rows (the first cell of each is its head), and one letter a column: l(eft) or r(ight)."""

    caption: Cell
    head: tuple[Cell, ...]
    align: str
    rows: tuple[tuple[Cell, ...], ...]
    foot: tuple[Cell, ...] = ()


VARYING = ("times", "outputs_sha256", MARK)
SAME = 0.005


def budget_of_predictions(run: RunFolder, estimator: Item) -> Table | None:
    """Share of each source in the variance of each component of each prediction."""
    predictions = [p for p in leading(run, estimator) if p.get("budget")]
    if not predictions:
        return None
    sources = [row["source"] for row in predictions[0]["budget"]]
    shares = {(i, row["source"]): row["share"] for i, p in enumerate(predictions) for row in p["budget"]}
    order = {row["source"]: -row["share_total"] for row in predictions[0]["budget"]}
    sizes = [len(p["budget"][0]["share"]) for p in predictions]
    sources.sort(key=lambda s: (order[s], s))
    rows: list[tuple[Cell, ...]] = []
    for source in sources:
        cells = [percent(v) for i, n in enumerate(sizes) for v in shares.get((i, source), [math.nan] * n)]
        rows.append((source, *cells))
    head: list[Cell] = ["source"]
    total: list[Cell] = ["sigma of all (1σ)"]
    for p, n in zip(predictions, sizes):
        unit = unit_of(p)
        names = wording.axis_names(p["plane"], n)
        head += [Markup("{}<br>{}").format(p["name"], axis) for axis in names]
        total += [quantity(v, unit) for v in p.get(f"sigma_{unit}", [math.nan] * n)]
    return Table(
        caption="Share of each source in the variance of each predicted component",
        head=tuple(head),
        align="l" + "r" * sum(sizes),
        rows=tuple(rows),
        foot=tuple(total),
    )


def prediction_table(run: RunFolder, estimator: Item) -> Table | None:
    """The predictions of one estimator in full."""
    rows: list[tuple[Cell, ...]] = []
    for p in leading(run, estimator):
        unit = unit_of(p)
        axes, sigma, far = p[f"semi_axes_{unit}"], p.get(f"sigma_{unit}"), p.get(f"max_deviation_{unit}")
        mean = p.get(f"mean_error_{unit}") or []
        shown = series(far, unit) if far else DASH
        if far and any(mean):
            shown = Markup("{}<br>with a mean of {}").format(shown, series(mean, unit))
        what = Markup("<b>{}</b><br>{}<br>{}").format(
            p["name"], wording.plane_name(p["plane"], p.get("body")), wording.moment(when(p))
        )
        rows.append((
            what, ", ".join(wording.axis_names(p["plane"], len(axes))), series(sigma, unit) if sigma else DASH,
            shown, product(axes, unit), quantity(p.get("angle_deg"), "deg"),
        ))  # fmt: skip
    if not rows:
        return None
    return Table(
        caption=Markup("Predictions, estimator “{}”. {}").format(estimator["name"], _inside(run, estimator)),
        head=(
            "prediction",
            "components",
            "sigma of each (1σ)",
            Markup("largest deviation<br>(|mean| + 3σ)"),
            "semi-axes (1σ)",
            Markup("angle of<br>long axis"),
        ),
        align="llrrrr",
        rows=tuple(rows),
    )


def fact_table(run: RunFolder, estimator: Item) -> Table | None:
    """What else is known of each prediction: where, when, how near, how fast, and the chance of impact."""
    rows: list[tuple[Cell, ...]] = []
    for p in leading(run, estimator):
        facts = [_fact(p, key) for key in FACTS if p.get(key) is not None]
        mean = p.get(f"mean_{unit_of(p)}")
        if mean and any(mean):
            names = wording.axis_names(p["plane"], len(mean))
            facts[:0] = [Markup("{} = {}").format(n, quantity(v, unit_of(p), 6)) for n, v in zip(names, mean)]
        text = Markup("; ").join(facts) + "." + impact_clause(p)
        if text:
            rows.append((p["name"], text))
    return Table(caption="Nominal values of the predictions", head=("prediction", "values"), align="ll",
                 rows=tuple(rows)) if rows else None  # fmt: skip


FACTS = {
    "telescope": ("seen by", ""), "ra_deg": ("RA", "deg"), "dec_deg": ("Dec", "deg"), "distance_km": ("distance", "km"),
    "position_km": ("heliocentric position", "km"), "velocity_km_s": ("velocity", "km_s"),
    "closest_approach_tdb": ("closest approach", ""), "closest_distance_km": ("distance then", "km"),
    "speed_km_s": ("speed", "km_s"), "capture_radius_km": ("capture radius", "km"),
    "impact": ("nominal orbit hits", ""),
    "evaluated_on": ("evaluated on the", ""), "altitude_km": ("altitude", "km"),
    "path_below_horizon_deg": ("path below the horizon", "deg"), "path_azimuth_deg": ("azimuth of the path", "deg"),
    "longitude_deg": ("longitude", "deg"),
    "sigma_longitude_deg": ("1σ", "deg"), "latitude_deg": ("geodetic latitude", "deg"),
    "sigma_latitude_deg": ("1σ", "deg"), "latitude_geocentric_deg": ("geocentric latitude", "deg"),
    "impact_longitude_deg": ("longitude on the ground", "deg"),
    "impact_latitude_deg": ("geodetic latitude on the ground", "deg"), "sigma_time_s": ("1σ of the time", "s"),
}  # fmt: skip


def _fact(p: Item, key: str) -> Markup:
    """One fact with its name and unit."""
    (name, unit), value = FACTS[key], p[key]
    if isinstance(value, bool):
        return Markup("{}: {}").format(name, "yes" if value else "no")
    if isinstance(value, list):
        return Markup("{} {}").format(name, series(value, unit))
    if key.endswith("_tdb"):
        return Markup("{} {}").format(name, wording.moment(value))
    return Markup("{} {}").format(name, value if isinstance(value, str) else quantity(value, unit, 6))


def budget_of_parameters(run: RunFolder, estimator: Item) -> Table | None:
    """Share of each source in the variance of each parameter beside the state."""
    rows = run.budget(estimator["name"])
    names = list((rows[0].get("share_parameters") or {}) if rows else {})
    if not names:
        return None
    return Table(
        caption="Share of each source in the variance of each parameter",
        head=("source", *(wording.parameter_name(name)[0] for name in names)), align="l" + "r" * len(names),
        rows=tuple((row["source"], *(percent(row["share_parameters"][name]) for name in names)) for row in rows),
    )  # fmt: skip


def inside_table(run: RunFolder) -> Table | None:
    """D0, smallness and the names of the arrays, where the mission asks to see inside the estimate."""
    found = run.summary.get("inside")
    if not found:
        return None
    rows: list[tuple[Cell, ...]] = []
    if "information" in found:
        told = found["information"]
        sigma = quantity(told["sigma_position_km"], "km")
        for name, line in zip(("x", "y", "z", "vx", "vy", "vz"), told["D0"]):
            rows.append((f"D0, row of {name}", ", ".join(f"{value:.4g}" for value in line)))
        rows.append((Markup("position by σ² D0⁻¹ / N, noise alone"), sigma))
    if "smallness" in found:
        small = found["smallness"]
        words = "small" if small["small"] else "not small"
        rows.append(("second-order terms over the noise, largest", Markup("{} ({})").format(
            quantity(small["largest"]), words)))  # fmt: skip
    rows += [*_bound_rows(found), *_imitation_rows(found)]
    if found["arrays"]:
        rows.append(("arrays", ", ".join(found["arrays"])))
    caption = Markup("Inside the estimate of “{}”").format(found["estimator"])
    return Table(caption=caption, head=("quantity", "value"), align="ll", rows=tuple(rows))


def _bound_rows(found: Item) -> list[tuple[Cell, ...]]:
    """What errors in boxes allow about each prediction."""
    rows: list[tuple[Cell, ...]] = []
    for row in found.get("bounds") or []:
        name = f"{row['prediction']}, errors within {row['level']:g} sigma"
        if row["reason"] is not None:
            rows.append((name, row["reason"]))
            continue
        lower, upper = (next(key for key in row if key.startswith(end)) for end in ("lower_", "upper_"))
        text = ", ".join(f"{a:+.4g} to {b:+.4g}" for a, b in zip(row[lower], row[upper]))
        if row["inflation"] > 1.0:
            text += f"; the boxes contradict the measurements and were made {row['inflation']:.3g} times wider"
        rows.append((name, f"{text} ({wording.scale_of(0.0, lower[6:])[1]})"))
    return rows


def _imitation_rows(found: Item) -> list[tuple[Cell, ...]]:
    """Which motion each group of common errors looks like."""
    rows: list[tuple[Cell, ...]] = []
    for row in found.get("imitations") or []:
        direction = ", ".join(f"{name} {weight:.3g}" for name, weight in row["direction"].items())
        lost = row["condition_number"] is None
        rows.append((f"{row['group']} imitates", f"{direction}{' (not told from it at all)' if lost else ''}"))
    return rows


def shift_table(run: RunFolder, estimator: Item) -> Table | None:
    """How far each source that is off on average moves the estimate and its predictions; None where none is."""
    found = [row for row in run.summary.get("shifts") or [] if row["estimator"] == estimator["name"]]
    if not found:
        return None
    rows: list[tuple[Cell, ...]] = []
    for row in found:
        parts = []
        for part in row["predictions"]:
            unit = next(key.removeprefix("shift_") for key in part if key.startswith("shift_"))
            parts.append(series(part[f"shift_{unit}"], unit))
        rows.append((row["source"], series(row["shift_position_km"], "km"), quantity(row["in_sigmas"]), *parts))
    names = [part["prediction"] for part in found[0]["predictions"]]
    return Table(
        caption=Markup("Shift by each source that is off on average, estimator “{}”").format(estimator["name"]),
        head=("source", "position at the reference epoch, x y z", "in sigmas", *names),
        align="l" + "r" * (2 + len(names)),
        rows=tuple(rows),
    )


def _inside(run: RunFolder, estimator: Item) -> Markup:
    """How much of the probability the 1 sigma ellipsoid holds, by dimension."""
    held = {len(p[f"semi_axes_{unit_of(p)}"]): p["probability"] for p in run.predictions(estimator["name"])}
    parts = [Markup("{} in {} dimension{}").format(percent(held[n]), n, "" if n == 1 else "s") for n in sorted(held)]
    return Markup("The 1σ semi-axes hold {} of the probability.").format(wording.join(parts))


def prediction_comparison(run: RunFolder) -> Table | None:
    """Semi-axes by every estimator whose predictions differ from the main one's; None where none does."""
    main = run.main
    if main is None:
        return None
    found = {(p["name"], p["estimator"]): p for p in run.predictions()}
    made = [main["name"], *different(run, main)]
    if len(made) < 2:
        return None
    rows: list[tuple[Cell, ...]] = []
    for name in dict.fromkeys(p["name"] for p in run.predictions()):
        for kind in ("true", "formal"):
            cells = [_axes_of(found.get((name, estimator)), kind) for estimator in made]
            rows.append((Markup("{}, {}").format(name, kind), *cells))
    return Table(
        caption="Semi-axes of the predictions by estimator (1σ)",
        head=("prediction", *made),
        align="l" + "r" * len(made),
        rows=tuple(rows),
    )


def different(run: RunFolder, main: Item) -> list[str]:
    """Estimators with a true or formal sigma of some prediction that is off the main estimator's by more than 0.5 %."""
    own = {p["name"]: p for p in run.predictions(main["name"])}
    names = []
    for p in run.predictions():
        unit, mine = unit_of(p), own.get(p["name"])
        if mine is None or p["estimator"] in names or p["estimator"] == main["name"]:
            continue
        keys = (f"sigma_{unit}", f"sigma_formal_{unit}")
        if any(not np.allclose(p.get(key, []), mine.get(key, []), rtol=SAME, atol=0.0) for key in keys):
            names.append(p["estimator"])
    return names


def _axes_of(prediction: Item | None, kind: str) -> Cell:
    """True or formal semi-axes of one prediction."""
    if prediction is None:
        return DASH
    unit = unit_of(prediction)
    if kind == "true":
        return product(prediction[f"semi_axes_{unit}"], unit)
    if prediction.get(f"factor_formal_{unit}") is not None:
        lengths = np.linalg.svd(np.array(prediction[f"factor_formal_{unit}"]), compute_uv=False)
        return product(lengths.tolist(), unit)
    formal = prediction.get(f"covariance_formal_{unit}2")
    return product(_semi_axes(formal), unit) if formal else DASH


def _semi_axes(covariance: Any) -> list[float]:
    """Semi-axes of a covariance, largest first."""
    values = np.linalg.eigvalsh(np.atleast_2d(np.asarray(covariance, dtype=np.float64)))
    return [float(v) for v in np.sqrt(np.maximum(values[::-1], 0.0))]


def estimator_table(run: RunFolder) -> Table:
    """All estimators side by side."""
    rows: list[tuple[Cell, ...]] = []
    for e in run.estimators:
        ratio, dof = formal_ratio(e), e.get("dof")
        reduced = e["chi2"] / dof if dof and finite(e.get("chi2")) else None
        rows.append((
            e["name"], METHODS.get(e["method"], e["method"].replace("_", " ")), e["status"].replace("_", " "),
            str(e["iterations"]) if e.get("iterations") is not None else DASH,
            quantity(e.get("sigma_position_km"), "km"), quantity(e.get("sigma_formal_position_km"), "km"),
            quantity(ratio, "", 4), quantity(e.get("sigma_velocity_m_s"), "m_s"),
            quantity(reduced), quantity(e.get("condition_number"), "", 2), _treatment(e),
        ))  # fmt: skip
    return Table(
        caption="Estimators (1σ, root trace): realistic sigma, what the error is under the mission's error model, "
        "against the reported one, what the estimator believes",
        head=(
            "estimator",
            "method",
            "status",
            "iterations",
            "position, realistic",
            "position, reported",
            Markup("realistic /<br>reported"),
            "velocity, realistic",
            "χ² per dof",
            "condition number",
            "not estimated",
        ),
        align="lllrrrrrrrl",
        rows=tuple(rows),
    )


def _treatment(estimator: Item) -> Cell:
    """The groups an estimator does not solve for, by treatment."""
    treatment: Mapping[str, str] = estimator.get("treatment") or {}
    parts = []
    for how in ("considered", "ignored", "fixed"):
        names = [group for group, treated in treatment.items() if treated == how]
        if names:
            parts.append(Markup("{}: {}").format(how, ", ".join(names)))
    return Markup("; ").join(parts) if parts else "nothing"


def state_table(run: RunFolder, estimator: Item) -> Table:
    """The estimated state at the reference epoch with the sigma of each component."""
    K = matrix_of(estimator, "covariance_km_km_s", "factor_km_km_s")
    sigma = np.full(6, np.nan) if K is None else np.sqrt(np.maximum(np.diag(K), 0.0))
    rows: list[tuple[Cell, ...]] = []
    for i, name in enumerate(("x", "y", "z", "vx", "vy", "vz")):
        unit = "km" if i < 3 else "km/s"
        value = f"{estimator['state_km_km_s'][i]:.{3 if i < 3 else 9}f}".replace("-", wording.MINUS)
        rows.append((name, f"{value}{wording.NBSP}{unit}", quantity(float(sigma[i]), "km" if i < 3 else "km_s")))
    return Table(
        caption=Markup("Heliocentric state, ICRF, at {}, estimator “{}”").format(
            wording.moment(run.summary["reference_epoch_tdb"]), estimator["name"]
        ),
        head=("component", "estimate", "sigma (1σ)"),
        align="lrr",
        rows=tuple(rows),
    )


def visibility_table(run: RunFolder) -> Table | None:
    """How many epochs each telescope could use, and what removed the others."""
    blocks = run.summary.get("visibility") or []
    reasons = sorted({reason for block in blocks for reason in block.get("removed") or {}})
    rows = tuple(
        (
            block["telescope"],
            str(block["candidates"]),
            str(block["visible"]),
            *(str((block.get("removed") or {}).get(reason, 0)) for reason in reasons),
        )
        for block in blocks
    )
    if not rows:
        return None
    names = [wording.REMOVED.get(reason, reason.replace("_", " ")) for reason in reasons]
    return Table(caption="Epochs of the schedule", head=("telescope", "scheduled", "seen", *names),
                 align="lrr" + "r" * len(names), rows=rows)  # fmt: skip


def physics_table(run: RunFolder) -> Table | None:
    """The force model of the run."""
    rows = tuple(flat(run.summary.get("physics") or {}))
    return Table(caption="Physics", head=("term", "value"), align="ll", rows=rows) if rows else None


def provenance_table(run: RunFolder) -> Table:
    """The manifest but for the mission text, and for what differs between two runs of one mission: times and hashes."""
    rows = tuple(
        row for row in flat({k: v for k, v in run.manifest.items() if k not in VARYING}) if not row[0].endswith("text")
    )
    return Table(caption="Provenance", head=("entry", "value"), align="ll", rows=rows)


def flat(value: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """A nested mapping as rows of path and text."""
    for key, item in value.items():
        known, unit = wording.PARAMETERS.get(key, ("", ""))
        name = prefix + (f"{known}, {unit}".rstrip(", ") if known else str(key).replace("_", " "))
        if isinstance(item, Mapping):
            yield from flat(item, f"{name}: ")
        elif isinstance(item, list):
            yield name, ", ".join(str(part) for part in item)
        else:
            yield name, plain(item)


def plain(value: object) -> str:
    """A value of a JSON file as text."""
    if value is None or isinstance(value, bool):
        return DASH if value is None else "on" if value else "off"
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def mission_text(run: RunFolder) -> Verbatim:
    """The mission file as it was read."""
    block = run.manifest.get("mission")
    text = block.get("text") if isinstance(block, Mapping) else None
    return Verbatim(escape(str(text if text is not None else run.manifest.get("mission_text", ""))))
