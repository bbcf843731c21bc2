"""Long lists of stations made short: the largest few by themselves, the others of a kind together.

The whole list stays in summary.json and in the tables of the run folder.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from nebosvod.errors import counted
from nebosvod.findings.kinds import kind_of

Item = Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """One source of a budget, or several of a kind whose variances add up."""

    source: str
    members: tuple[Item, ...]

    def variance(self, key: str) -> float:
        """Sum of the squares of the members' sigmas."""
        return float(sum(row[key] ** 2 for row in self.members))

    def sigma(self, key: str) -> float:
        """Root of that sum."""
        return float(self.variance(key) ** 0.5)

    def share(self, key: str) -> float:
        """Sum of the members' shares."""
        return float(sum(row[key] for row in self.members))


def condensed(rows: Sequence[Item], stations: Sequence[str], most: int) -> list[Part]:
    """The budget with at most so many sources by themselves, then the others by kind, largest share first.

    Parameters
    ----------
    rows : of the `budget` of a summary, largest share first.
    """
    parts = [Part(source=row["source"], members=(row,)) for row in rows[:most]]
    named = {kind_of(row["source"], list(stations)) for row in rows[:most] if row["telescopes"]}
    kinds: dict[str, list[Item]] = {}
    for row in rows[most:]:
        alone = len(row["telescopes"]) != 1
        kinds.setdefault(row["source"] if alone else kind_of(row["source"], list(stations)), []).append(row)
    rest = [
        Part(source=_called(kind, members, kind in named), members=tuple(members)) for kind, members in kinds.items()
    ]
    return parts + sorted(rest, key=lambda part: -part.share("share_position"))


def _called(kind: str, members: Sequence[Item], some_shown: bool) -> str:
    """The name of a single source; `bias, 37 other stations together` of several."""
    if len(members) == 1:
        return str(members[0]["source"])
    return f"{kind}, {counted(len(members), 'other station' if some_shown else 'station')} together"


def without(rows: Sequence[Item], part: Part, key: str, left: float = 0.0) -> float:
    """Sigma of all rows if a part erred `left` times as much and nothing else changed, weights included (exact)."""
    total = sum(row[key] ** 2 for row in rows)
    return float(max(total - (1.0 - left**2) * part.variance(key), 0.0) ** 0.5)


def foremost(
    parameters: Mapping[str, Item], stations: Sequence[str], most: int
) -> tuple[dict[str, Item], dict[str, Item]]:
    """Numbers beside the state to show, at most so many where stations have many, and the others.

    First what is no station's, then theirs that were estimated, the farthest from zero in its sigmas first.
    """
    codes = "|".join(re.escape(name) for name in stations)
    of_a_station = re.compile(rf" (?:{codes})(?=[ _]|$)")
    own = {name: row for name, row in parameters.items() if not of_a_station.search(name)}
    theirs = {name: row for name, row in parameters.items() if name not in own}
    found = [name for name, row in theirs.items() if row["estimate"] != 0.0 and row["sigma"] > 0.0]
    found.sort(key=lambda name: -abs(theirs[name]["estimate"]) / theirs[name]["sigma"])
    shown = own | {name: theirs[name] for name in found[: max(most - len(own), 0)]}
    return shown, {name: row for name, row in theirs.items() if name not in shown}
