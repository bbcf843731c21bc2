"""The sources of uncertainty about telescopes, collected from all places where a mission may say them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from nebosvod.mission.bias import Bias
from nebosvod.mission.fields import Block, KeyPath, Text
from nebosvod.mission.position import Position
from nebosvod.mission.request import TelescopeNames
from nebosvod.mission.target import Body, Target
from nebosvod.mission.telescope import Telescope
from nebosvod.mission.uncertainty import GROUPS, Error, Group, Timing

KINDS: tuple[Group, ...] = ("bias", "position", "timing")  # what an entry of `shared`, or of a fit, may have
OWN: tuple[Group, ...] = tuple(group for group in GROUPS if group in Telescope.model_fields)  # what a telescope may


class Shared(Block):
    """One source of uncertainty that acts on several telescopes: the same draw in all of them."""

    name: Text
    telescopes: TelescopeNames = "all"
    bias: Bias | None = None
    position: Position | None = None
    timing: Timing | None = None

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Exactly one kind; a fresh draw at every exposure cannot be shared."""
        said = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(said) != 1:
            got = f"got {' and '.join(said)}" if said else "got none"
            return [((), f"needs exactly one of bias, position, timing ({got}); write one entry for each")]
        if self.position is not None and self.position.correlation == "white":
            text = "white errors are drawn anew for each exposure and cannot be shared; use constant or gauss_markov"
            return [(("position", "correlation"), text)]
        return []


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Source:
    """One source: what it is, whom it hits, and by which words an estimator may name it.

    Attributes
    ----------
    name : in the error budget; unique in the mission.
    group : one of GROUPS.
    keys : words for `treatment` of an estimator, the most particular first.
    telescopes : names of those it acts on.
    error : the block that describes it.
    path : where that block stands in the file.
    shadows : the source whose truth this is, where that is of another kind than is assumed; no estimator knows of it.
    """

    name: str
    group: Group
    keys: tuple[str, ...]
    telescopes: tuple[str, ...]
    error: Error
    path: KeyPath
    shadows: "Source | None" = None

    @property
    def fresh(self) -> bool:
        """Whether it is drawn anew at each measurement."""
        return getattr(self.error, "correlation", "") == "white"

    @property
    def slow(self) -> bool:
        """Whether it changes from one measurement to the next and remembers: a state of its own, not a constant."""
        return getattr(self.error, "correlation", "") == "gauss_markov" or self.stays

    @property
    def stays(self) -> bool:
        """Whether it stays as it is for a while and is then drawn anew: a bias by arcs, an orbit determined anew."""
        return getattr(self.error, "correlation", "") == "per_arc" or getattr(self.error, "renewal", None) is not None


def sources(telescopes: tuple[Telescope, ...], shared: tuple[Shared, ...], target: Target) -> Iterator[Source]:
    """Every source of a mission, and what some really are where that is of another kind than is assumed."""
    for source in _assumed(telescopes, shared, target):
        yield source
        other = getattr(source.error, "other_kind", None)
        if other is not None:
            name, path = f"{source.name} in truth", (*source.path, "true")
            yield replace(source, name=name, keys=(), error=other, path=path, shadows=source)


def _assumed(telescopes: tuple[Telescope, ...], shared: tuple[Shared, ...], target: Target) -> Iterator[Source]:
    """The sources as they are assumed: of each telescope, shared, of the object."""
    names = tuple(telescope.name for telescope in telescopes)
    for i, telescope in enumerate(telescopes):
        for group in OWN:
            error = getattr(telescope, group)
            if error is not None:
                name = f"{_title(group, error)} {telescope.name}"
                keys = tuple(dict.fromkeys((name, f"{group} {telescope.name}", group)))
                yield Source(
                    name=name,
                    group=group,
                    keys=keys,
                    telescopes=(telescope.name,),
                    error=error,
                    path=("telescopes", i, group),
                )
    for i, entry in enumerate(shared):
        group = next(kind for kind in KINDS if getattr(entry, kind) is not None)
        whom = names if entry.telescopes == "all" else tuple(name for name in names if name in entry.telescopes)
        yield Source(
            name=entry.name,
            group=group,
            keys=(entry.name, group),
            telescopes=whom,
            error=getattr(entry, group),
            path=("shared", i, group),
        )
    yield from of_object(target, names)


def of_object(target: Body, telescopes: tuple[str, ...]) -> Iterator[Source]:
    """The photocentre and the process noise of the object, which act on what all telescopes see."""
    if target.photocentre is not None:
        yield Source(
            name="photocentre",
            group="photocentre",
            keys=("photocentre",),
            telescopes=telescopes,
            error=target.photocentre,
            path=("object", "photocentre"),
        )
    if target.process_noise is not None:
        yield Source(
            name="process noise",
            group="process_noise",
            keys=("process_noise", "process noise"),
            telescopes=telescopes,
            error=target.process_noise,
            path=("object", "process_noise"),
        )


def _title(group: Group, error: Error) -> str:
    """What the budget calls a source of one telescope."""
    if group != "position":
        return group.replace("_", " ")
    return "orbit error" if isinstance(error, Position) and error.correlation == "orbit_error" else "telescope position"
