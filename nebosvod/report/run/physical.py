"""What the measurements say about radius, mass and albedo, and what they cannot say."""

import math
from collections.abc import Mapping

import numpy as np
from markupsafe import Markup

from nebosvod.report.kit import wording
from nebosvod.report.kit.wording import NBSP, finite, number, percent, quantity
from nebosvod.report.run.tables import Cell, Table
from nebosvod.results.folder import Item, RunFolder

SPHERE = ("radius_m", "mass_kg", "albedo", "thermal_emission", *wording.LOGARITHMS)


def parameter_table(estimator: Item) -> Table | None:
    """Prior and posterior sigma of every parameter beside the state."""
    rows: list[tuple[Cell, ...]] = []
    for key, item in (estimator.get("parameters") or {}).items():
        prior, sigma, estimate = item.get("prior_sigma"), item.get("sigma"), item.get("estimate")
        left = sigma / prior if finite(prior) and finite(sigma) and prior > 0 else None
        gain = _left(left) if left is not None else quantity(None)
        if key in wording.LOGARITHMS:
            name, unit = wording.parameter_name(wording.LOGARITHMS[key])
            rows.append((f"{name}, lognormal", _median(estimate, sigma, unit), _factor(prior), _factor(sigma), gain))
            continue
        name, unit = wording.parameter_name(key)
        shown = _plain(estimate, unit, wording.matched_digits(estimate or 0.0, sigma))
        before = _plain(prior, unit) if finite(prior) else "none"
        rows.append((name, shown, before, _plain(sigma, unit), gain))
    if not rows:
        return None
    return Table(
        caption=Markup("Parameters, estimator “{}” (1σ)").format(estimator["name"]),
        head=("parameter", "estimate", "prior sigma", "posterior sigma", "posterior / prior"),
        align="lrrrr",
        rows=tuple(rows),
    )


def _plain(value: float | None, unit: str, digits: int = 3) -> Markup:
    """A parameter in its own unit (no kilometre ladder: a radius stays in metres)."""
    if value is None or not math.isfinite(value):
        return quantity(None)
    text = number(value, digits) + (f"{NBSP}{unit}" if unit else "")
    return Markup('<data value="{}" data-unit="{}">{}</data>').format(repr(float(value)), unit, text)


def _median(logarithm: float | None, sigma: float | None, unit: str) -> Markup:
    """A quantity of which the logarithm was estimated."""
    if logarithm is None or not math.isfinite(logarithm):
        return quantity(None)
    value = math.exp(logarithm)
    return _plain(value, unit, wording.matched_digits(value, None if sigma is None else value * sigma))


def _factor(sigma: float | None) -> Markup:
    """One sigma of a logarithm: the factor it is worth."""
    if sigma is None or not math.isfinite(sigma):
        return quantity(None)
    return Markup('<data value="{}" data-unit="">×/÷{}{}</data>').format(repr(sigma), NBSP, number(math.exp(sigma), 4))


def _left(ratio: float) -> Markup:
    """Posterior over prior sigma; a gain too small to see in four digits is said in words."""
    if 0.0 <= 1.0 - ratio < 5e-5:
        return Markup('<data value="{}" data-unit="">1 (no gain)</data>').format(repr(ratio))
    return quantity(ratio, "", 4)


def kappa_partials(values: Mapping[str, float]) -> dict[str, float]:
    """Partials of ln kappa, kappa = (pi R^2/m) C_R, C_R = 1 + 4A/9 + f (1 - A), by radius, mass, albedo and f."""
    albedo, f = values["albedo"], values.get("thermal_emission", 0.0)
    reflection = 1.0 + 4.0 * albedo / 9.0 + f * (1.0 - albedo)
    return {
        "radius_m": 2.0 / values["radius_m"],
        "mass_kg": -1.0 / values["mass_kg"],
        "albedo": (4.0 / 9.0 - f) / reflection,
        "thermal_emission": (1.0 - albedo) / reflection,
    }


def kappa_sentence(run: RunFolder, estimator: Item) -> Markup | None:
    """The one combination of radius, mass and albedo that a track can see, before and after the fit."""
    found = estimator.get("parameters") or {}
    free = [key for key in SPHERE if key in found and finite(found[key].get("prior_sigma"))]
    if len(free) < 2:
        return None
    given = (run.summary.get("physics") or {}).get("radiation_pressure")
    values = {k: float(v) for k, v in given.items() if k in SPHERE and finite(v)} if isinstance(given, Mapping) else {}
    values = {**{k: float(found[k]["estimate"]) for k in free if finite(found[k].get("estimate"))}, **values}
    names, factor = run.array("names", estimator["name"]), run.array("factor", estimator["name"])
    if not {"radius_m", "mass_kg", "albedo"} <= set(values) or names is None or factor is None:
        return None
    order = [str(name) for name in names]
    if not set(free) <= set(order):
        return None
    partial = kappa_partials(values)
    partial |= {key: values[name] * partial[name] for key, name in wording.LOGARITHMS.items()}
    rows = factor[[order.index(key) for key in free]]
    after = float(np.linalg.norm(rows.T @ np.array([partial[key] for key in free])))
    before = math.hypot(*(partial[key] * float(found[key]["prior_sigma"]) for key in free))
    gain = after / before if before > 0 else math.nan
    said = (
        "the measurements do not narrow it"
        if gain > 0.995
        else Markup("the measurements narrow it to {} of the prior sigma").format(percent(gain))
    )
    listed = wording.join([wording.parameter_name(wording.LOGARITHMS.get(key, key))[0] for key in free])
    return Markup(
        "The orbit depends on {} only through <span class='nowrap'>κ = (πR²/m)(1 + "
        "4A/9 + f(1 − A))</span>. Its relative sigma is {} before and {} after the fit: {}. What "
        "each of them gains on its own is what κ tells together with the priors of the others."
    ).format(listed, percent(before), percent(after), said)
