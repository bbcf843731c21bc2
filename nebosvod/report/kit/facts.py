"""What the summary says, as other modules ask for it: leading predictions, their units and sizes, grouped shares."""

import math

from markupsafe import Markup

from nebosvod.findings.kinds import kind_of
from nebosvod.mission.vocabulary import PLANES
from nebosvod.report.kit import wording
from nebosvod.report.kit.wording import percent, product, quantity
from nebosvod.results.folder import Item, RunFolder
from nebosvod.results.outlook import moment_words, unit_of

LEADING = [name for name, plane in PLANES.items() if plane.leads]  # the others follow in the mission's order
PRIOR_ORBITS = ("prior orbit", "prior orbit and parameters")  # the sources that are an orbit known beforehand


def when(prediction: Item) -> str:
    """The epoch of a prediction, as text in the scale a reader is told it in."""
    return moment_words(prediction["epoch_tdb"], prediction.get("time_scale", "tdb"))


def formal_ratio(main: Item) -> float | None:
    """True over formal position sigma, None where either is missing."""
    true, formal = main.get("sigma_position_km"), main.get("sigma_formal_position_km")
    return true / formal if true and formal else None


def leading(run: RunFolder, main: Item) -> list[Item]:
    """The predictions of the main estimator, target planes and closest approaches first."""
    every = run.predictions(main["name"])
    return sorted(every, key=lambda p: LEADING.index(p["plane"]) if p["plane"] in LEADING else len(LEADING))


def position_shares(run: RunFolder, main: Item) -> list[tuple[str, float]]:
    """Source and share of the position variance, largest first."""
    return [(row["source"], row["share_position"]) for row in run.budget(main["name"])]


def of_telescopes(kind: str, n: int) -> str:
    """`bias` of one telescope, `bias (2 telescopes)` added up over several."""
    return f"{kind} ({n}{wording.NBSP}telescopes)" if n > 1 else kind


def size(prediction: Item) -> Markup:
    """`50.4 × 8.32 km` of an ellipse, `± 34.3 km` of a scalar."""
    unit = unit_of(prediction)
    axes = prediction[f"semi_axes_{unit}"]
    mean = prediction.get(f"mean_{unit}")
    if len(axes) > 1:
        return product(axes, unit)
    if mean:
        return wording.with_sigma(mean[0], axes[0], unit)
    return Markup("± {}").format(quantity(axes[0], unit))


def total_sigma(prediction: Item) -> float:
    """The root of the sum of the variances of all components, in the unit of the prediction."""
    return math.hypot(*prediction[f"sigma_{unit_of(prediction)}"])


def earlier_orbit(summary: Item, estimator: str) -> bool | None:
    """Whether an estimator started from an orbit known beforehand; None where the summary has no budget to say so."""
    sources = [row["source"] for row in summary.get("budget") or [] if row["estimator"] == estimator]
    return any(source in PRIOR_ORBITS for source in sources) if sources else None


def object_name(run: RunFolder) -> str:
    """The name of the object."""
    thing = run.summary["object"]
    return str(thing["name"]) if isinstance(thing, dict) else str(thing)


def grouped(shares: list[tuple[str, float]], telescopes: list[str]) -> list[tuple[str, float, int]]:
    """Sources added up over telescopes: (kind, share, number of sources), largest first."""
    sums: dict[str, tuple[float, int]] = {}
    for source, own in shares:
        kind = kind_of(source, telescopes)
        share, n = sums.get(kind, (0.0, 0))
        sums[kind] = (share + own, n + 1)
    return sorted(((k, s, n) for k, (s, n) in sums.items()), key=lambda item: (-item[1], item[0]))


def impact_clause(p: Item) -> Markup:
    """The chance of impact, linear and by drawn orbits; empty where the prediction has none."""
    linear, drawn = p.get("impact_probability_linear"), p.get("impact_probability_monte_carlo")
    if linear is None:
        return Markup("")
    text = Markup(" Probability of impact: {} (linear)").format(chance(linear))
    if drawn:
        low, high = drawn["interval_95"]
        text += Markup(", {} of {} drawn orbits (95{}% interval {} to {})").format(
            drawn["hits"], drawn["runs"], wording.NBSP, percent(low), percent(high)
        )
    return text + "."


def chance(value: float) -> Markup:
    """A probability: 0 and 1 in words a reader cannot take for rounded ones."""
    if value < 1e-12:
        return Markup('<data value="{}" data-unit="">&lt;{}10⁻¹²</data>').format(repr(value), wording.NBSP)
    if value > 1.0 - 1e-9:
        return Markup('<data value="{}" data-unit="">1</data>').format(repr(value))
    return quantity(value)
