"""When a page's answer was made, by which version, from which input: the line below its title."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nebosvod.borders.stored import read_object

SHOWN = 12  # digits of a hash


def stamp(made: Mapping[str, Any]) -> tuple[str, ...]:
    """Date, version and hash, as far as a manifest, or the answer of a command that leaves none, has them.

    Parameters
    ----------
    made : with `times`, `versions`, and `mission` or `inputs_sha256` (or the flat `mission_sha256`).
    """
    started = str((made.get("times") or {}).get("started_utc") or "")
    version = (made.get("versions") or {}).get("nebosvod")
    said = [f"{started[:10]} {started[11:16]} UTC"] if started else []
    said += [f"nebosvod {version}"] if version else []
    mission = made.get("mission")
    digest = mission.get("sha256") if isinstance(mission, Mapping) else made.get("mission_sha256")
    if digest:
        said.append(f"mission sha256 {digest[:SHOWN]}")
    else:
        said += [f"input sha256 {text[:SHOWN]}" for text in (made.get("inputs_sha256") or {}).values()][:1]
    return tuple(said)


def stamp_of(folder: Path) -> tuple[str, ...]:
    """The same of a folder."""
    return stamp(read_object(folder / "manifest.json"))
