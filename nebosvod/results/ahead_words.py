"""What comes after a fit, in sentences for the terminal and the page, from the block `ahead` of its summary."""

from collections.abc import Mapping
from typing import Any

from nebosvod.impacts.chance import chance_words

CALLED = {"earth": "the Earth", "moon": "the Moon", "sun": "the Sun"}


def ahead_sentences(ahead: Mapping[str, Any] | None) -> list[str]:
    """Impacts in reach, the next approaches or that there are none, and what else is known of the object."""
    if ahead is None:
        return []
    said = [_in_reach(row) for row in ahead["in_reach"]]
    said += [_approach(row) for row in ahead["approaches"] if not row["impact"]]
    if ahead["reason"]:
        said.append(ahead["reason"])
    elif not ahead["approaches"]:
        said.append(
            f"no approach to the Earth or the Moon within {ahead['within_au']:g} au until {ahead['to_utc'][:10]}"
        )
    return [*said, _object(ahead)]


def _in_reach(row: Mapping[str, Any]) -> str:
    """An impact within some sigmas."""
    body, when = CALLED.get(row["body"], row["body"]), row["epoch_utc"][:16].replace("T", " ")
    chance = row["impact_probability_linear"]
    told = "" if chance is None else f"; linear probability {chance_words(chance)}"
    if row["sigmas"] == 0.0:
        return f"the orbit hits {body} on {when} UTC{told}"
    return f"an impact on {body} on {when} UTC is within reach of {row['sigmas']:.2g} sigma{told}"


def _approach(row: Mapping[str, Any]) -> str:
    """An approach of the next days."""
    body, when = CALLED.get(row["body"], row["body"]), row["epoch_utc"][:16].replace("T", " ")
    return (
        f"passes {body} on {when} UTC at {row['distance_km']:,.0f} km ({row['distance_au']:.5f} au), 1 sigma "
        f"{row['sigma_distance_km']:,.3g} km and {row['sigma_time_s']:,.3g} s"
    )


def _object(ahead: Mapping[str, Any]) -> str:
    """H, period and MOID."""
    said = []
    H = ahead["magnitude"]
    if H is not None:
        said.append(f"H {H['H']:.2f} (scatter {H['scatter_mag']:.2f} of {H['n']})")
    if ahead["period_d"] is not None:
        said.append(f"period {_pair(ahead['period_d'], ahead['sigma_period_d'])} d")
    return "; ".join([*said, f"MOID of the Earth {_pair(ahead['moid_earth_au'], ahead['sigma_moid_earth_au'])} au"])


def _pair(value: float, sigma: float) -> str:
    """A number with the digits that its sigma leaves."""
    digits = 0
    while digits < 9 and sigma * 10.0**digits < 2.0:
        digits += 1
    return f"{value:.{digits}f} +- {sigma:.2g}"
