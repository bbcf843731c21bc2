"""Objects of a study, each in the place of the mission's: of a catalogue, or drawn impactors and near misses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nebosvod.dynamics import Ephemeris
from nebosvod.errors import InputError
from nebosvod.mission import Mission
from nebosvod.mission.fields import epoch_text
from nebosvod.mission.yaml.yamlfile import Tree
from nebosvod.studies.axes import Axis
from nebosvod.studies.catalogue import read_catalogue
from nebosvod.studies.file import ImpactorsBlock, ObjectsBlock
from nebosvod.studies.impactors import Draw, Drawn, DrawnObjects
from nebosvod.studies.near_earth import PUBLISHED, orbits_of, published_orbits
from nebosvod.timescale import SECONDS_PER_DAY, Epoch


class Changes(Sequence[dict[str, Tree]]):
    """What each object changes in a mission, by path, made when it is asked for."""

    def __init__(self, rows: Sequence[Mapping[str, Any]], mission: Mission, move: bool) -> None:
        self._rows, self._mission, self._move = rows, mission, move

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, number: Any) -> Any:
        return _changes(self._rows[number], self._mission, self._move)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Objects:
    """Objects as an axis of a study: each changes several places of the mission at once.

    Attributes
    ----------
    drawn : the objects, where they were drawn; None for those of a catalogue.
    """

    axis: Axis
    drawn: DrawnObjects | None

    def known(self) -> list[Drawn]:
        """What is known of each drawn object beside its orbit."""
        return [] if self.drawn is None else [one["drawn"] for one in self.drawn]


def file_of(block: ObjectsBlock, beside: Path | None) -> Path | None:
    """The file of the objects, or of the orbits of which they are drawn; None for the published distribution."""
    name = block.from_ if block.impactors is None else block.impactors.orbits
    folder = beside.parent if beside is not None else Path()
    if name == PUBLISHED and not (folder / PUBLISHED).exists():
        return None
    return folder / str(name)


def read_objects(block: ObjectsBlock, file: Path | None, mission: Mission) -> Objects:
    """The objects of a study.

    Raises
    ------
    InputError
        If a catalogue cannot be read, or none can be drawn of it.
    """
    drawn = None if block.impactors is None else _drawn(file, block.impactors)
    rows = read_catalogue(_known(file))[: block.first] if drawn is None else drawn
    move = block.move if block.move is not None else drawn is not None
    names = tuple(str(row["name"]) for row in rows) if drawn is None else drawn.names
    axis = Axis(name="object", paths=(), values=Changes(rows, mission, move), texts=names)
    return Objects(axis=axis, drawn=drawn)


def _known(file: Path | None) -> Path:
    """A catalogue has a file, whatever its name."""
    return Path(PUBLISHED) if file is None else file


def _drawn(file: Path | None, block: ImpactorsBlock) -> DrawnObjects:
    """Impactors and misses from the orbits of a catalogue, or of the published distribution."""
    drawn = Draw(
        impacts=block.n,
        misses=block.misses,
        within_km=block.within,
        start=block.start,
        days=block.span / SECONDS_PER_DAY,
        smallest_m=block.smallest,
        largest_m=block.largest,
        seed=block.seed,
    )
    if file is not None and not file.exists():
        raise InputError(f"{file}: no such file; {PUBLISHED} is the published distribution that comes with the program")
    orbits = published_orbits() if file is None else orbits_of(read_catalogue(file))
    return DrawnObjects(orbits, drawn, Ephemeris.load())


def _changes(row: Mapping[str, Any], mission: Mission, move: bool) -> dict[str, Tree]:
    """What an object changes in a mission, by path; its epochs too, where they move with that of the orbit."""
    found: dict[str, Tree] = {"object.name": row["name"], "object.orbit": row["orbit"]}
    if "magnitude" in row:
        found["object.magnitude"] = row["magnitude"]
    if not move:
        return found
    orbit = row["orbit"]
    shift_s = Epoch.parse(str(orbit.get("at", orbit.get("epoch")))) - mission.object.orbit.epoch
    places: dict[str, Epoch] = {"reference_epoch": mission.reference_epoch}
    for k, arc in enumerate(mission.schedule):
        places |= {f"schedule.{k}.start": arc.start, f"schedule.{k}.end": arc.end}
    for k, one in enumerate(mission.predictions):
        places[f"predictions.{k}.{'near' if hasattr(one, 'near') else 'at'}"] = one.when
    return found | {place: epoch_text(epoch + shift_s) for place, epoch in places.items()}
