"""What a plan advises, in one sentence."""

from collections.abc import Mapping
from typing import Any

from nebosvod.errors import counted

UNITS = {"m_s": "m/s", "km2_s2": "km^2/s^2", "deg_d": "deg/d", "1": ""}
CRITERIA = {
    "a": "root trace",
    "d": "geometric mean of the semi-axes",
    "minimax": "largest component, whatever the correlation of errors",
    "guaranteed": "largest error of a component, every error within 3 sigma",
}


def advice(found: Mapping[str, Any]) -> str:
    """What to do, in one sentence, with what it brings against even spacing."""
    which, unit = found["criterion"], UNITS.get(found["unit"], found["unit"])
    best, greedy, even = found["windows"][0], found["greedy"][which], found["uniform"]
    last, other = greedy[-1]["sigma_after"][which], even[-1]["sigma_after"][which]
    less = f"{best['reduction_percent'][which]:.2g} % less"
    said = f"measure next with {best['telescope']} at {best['epoch_tdb']}: {less}"
    brings = f"{counted(len(greedy), 'visit')} chosen so {'brings' if len(greedy) == 1 else 'bring'} {last:.4g} {unit}"
    return f"{said}; {brings}, as many at even times {other:.4g} {unit}"


def short_epoch(epoch: str) -> str:
    """An epoch to the minute."""
    return epoch[:16].replace("T", " ")
