"""What a decision says: the dictionary that is printed, written and drawn, and one sentence."""

from collections.abc import Mapping
from typing import Any

from nebosvod.impacts.chance import chance_words
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.planning.decide import Decision, Outcome, Wanted

SCHEMA_VERSION = 1
KIND = "decision"
LEAST = 0.05  # a chance to decide that is worth a word


def decision_row(orbit: UncertainOrbit, wanted: Wanted, found: Decision) -> dict[str, Any]:
    """What the JSON of `nebosvod plan --decide` holds."""
    rows = [_row(orbit, one, found) for one in found.outcomes]
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "title": f"What will the next observation of {orbit.name} do?",
        "object": orbit.name,
        "orbit": orbit.origin,
        "until_utc": wanted.until.iso("utc", 0),
        "bodies": list(wanted.bodies),
        "probability": found.probability,
        "n_draws": wanted.draws,
        "n_hits": found.hits,
        "n_truths": wanted.truths,
        "seed": wanted.seed,
        "exposures": wanted.exposures,
        "spacing_s": wanted.spacing_s,
        "below": found.below,
        "above": found.above,
        "visits": rows,
        "best": max(range(len(rows)), key=lambda k: rows[k]["chance_below"] + rows[k]["chance_above"]),
        "never_visible": list(found.unseen),
        "map_error": None if found.flown else found.misjudged,
        "warnings": list(found.warnings),
    }


def _row(orbit: UncertainOrbit, one: Outcome, found: Decision) -> dict[str, Any]:
    begins = orbit.epoch + float(one.visit.t_s[0])
    foreseen = one.foreseen
    return {
        "telescope": one.visit.telescope,
        "epoch_utc": begins.iso("utc", 0),
        "epoch_tdb": begins.iso(),
        "quantiles": {f"{level:g}": value for level, value in one.quantiles.items()},
        "bound": one.bound,
        "chance_below": one.chance_below(found.below),
        "chance_above": one.chance_above(found.above),
        "effective_median": float(sorted(foreseen.effective)[len(foreseen.effective) // 2]),
        "redrawn": float(foreseen.redrawn.mean()),
    }


def said_chance(value: float, bound: float | None) -> str:
    """A future probability in words; where no orbit hits, which is not 0, its bound."""
    if value > 0.0:
        return f"{value:.2g}" if value < 0.995 else chance_words(value)
    return "next to 0" if bound is None else f"< {bound:.1g}"  # of an earlier version


def advice(found: Mapping[str, Any]) -> str:
    """What to expect, in one sentence."""
    row = found["visits"][found["best"]]
    low, high = (said_chance(row["quantiles"][level], row.get("bound")) for level in ("0.1", "0.9"))
    span = (f"{low} to {high}" if low != high else low).replace("<", "below")
    when = f"{row['telescope']} on {row['epoch_utc'][:16].replace('T', ' ')} UTC"
    if row["chance_below"] + row["chance_above"] < LEAST:
        return (
            f"no visit is likely to decide: after {when} the probability will be {span} (80 %), "
            f"now {chance_words(found['probability'])}"
        )
    return (
        f"after {when} the probability falls below {found['below']:.2g} with {_percent(row['chance_below'])} and "
        f"rises above {found['above']:.2g} with {_percent(row['chance_above'])}; it will be {span} "
        f"(80 %), now {chance_words(found['probability'])}"
    )


def said_share(chance: float) -> str:
    """The share of the truths of a visit, in whole percent; that of none or all of them is no 0 and no certainty."""
    whole = f"{100.0 * chance:.0f} %"
    return {"0 %": "< 1 %", "100 %": "> 99 %"}.get(whole, whole)


def _percent(chance: float) -> str:
    """The same in a sentence."""
    return said_share(chance).replace("<", "less than").replace(">", "more than")
