"""The blocks of the file of a study, each with its keys and limits."""

from typing import Annotated, Any

from pydantic import Field

from nebosvod.errors import InputError
from nebosvod.mission.fields import (
    Block,
    KeyPath,
    Parsed,
    PositiveDuration,
    PositiveLength,
    Several,
    Size,
    Text,
    When,
)
from nebosvod.mission.yaml.yamlfile import shown
from nebosvod.studies.axes import MOST_VALUES, in_unit
from nebosvod.studies.near_earth import PUBLISHED
from nebosvod.studies.sampling import Sample, read_sample

SCHEMA_VERSION = 1
MOST_AXES, MOST_ANSWERS, MOST_TIMES = 20, 50, 100

SampleField = Annotated[
    Sample,
    Parsed(
        read_sample,
        {
            "description": "How points are chosen",
            "oneOf": [
                {"const": "grid"},
                {"type": "object", "required": ["kind"], "properties": {"kind": {"enum": ["grid", "sobol", "latin"]}}},
                {"type": "object", "required": ["sobol"], "properties": {"sobol": {"type": "object"}}},
                {"type": "object", "required": ["latin"], "properties": {"latin": {"type": "object"}}},
            ],
            "examples": ["grid", {"sobol": {"n": 1024}}, {"latin": {"n": 1000, "seed": 1}}],
        },
    ),
]


def _steps(value: Any) -> int | bool:
    if isinstance(value, bool) or (isinstance(value, int) and 2 <= value <= MOST_VALUES):
        return value
    raise InputError(f"needs how many values the range has, 2 to {MOST_VALUES:,} (got {shown(str(value), 40)})")


Steps = Annotated[
    int | bool,
    Parsed(_steps, {"oneOf": [{"type": "integer", "minimum": 2, "maximum": MOST_VALUES}, {"type": "boolean"}]}),
]


def _paths(value: Any) -> tuple[str, ...]:
    found = [value] if isinstance(value, str) else value
    if not isinstance(found, list) or not found or not all(isinstance(one, str) and one.strip() for one in found):
        raise InputError("needs a path of the mission, such as telescopes.*.noise.sigma, or a list of paths")
    return tuple(found)


Paths = Annotated[
    tuple[str, ...],
    Parsed(
        _paths,
        {
            "description": "Place in the mission, keys joined by points; in a list a name, an index, or * for all",
            "oneOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}],
            "examples": ["telescopes.*.noise.sigma"],
        },
    ),
]


class AxisBlock(Block):
    """One thing that is varied."""

    set: Paths
    values: Any = Field(
        description="A range with units, or a list",
        json_schema_extra={"oneOf": [{"type": "string"}, {"type": "array", "minItems": 1}]},
        examples=["0.02 arcsec .. 1 arcsec", ["1 h", "6 h", "1 d"]],
    )
    log: Steps | None = Field(
        default=None, description="Steps of a range, even in the logarithm; true where it is sampled"
    )
    linear: Steps | None = Field(default=None, description="Steps of a range, even; true where it is sampled")


def _before(value: Any) -> tuple[tuple[float, str], ...]:
    rows = value if isinstance(value, list) else [value]
    if not 1 <= len(rows) <= MOST_TIMES:
        raise InputError(f"has {len(rows)} times (allowed 1 to {MOST_TIMES})")
    found = []
    for one in rows:
        try:
            seconds = in_unit(one if isinstance(one, str) else "", "s")
        except InputError:
            seconds = 0.0
        if seconds <= 0.0:
            raise InputError(f'needs a duration above 0, such as 7 d, or a list of them (got "{shown(str(one), 40)}")')
        found.append((seconds, " ".join(one.split())))
    if len({seconds for seconds, _ in found}) < len(found):
        raise InputError("has a time twice")
    return tuple(found)


Before = Annotated[
    tuple[tuple[float, str], ...],
    Parsed(
        _before,
        {
            "description": "With what is measured until so long before the epoch of the orbit (of kind impact: the "
            "fall); a column for each",
            "oneOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}],
            "examples": [["30 d", "7 d", "1 d"]],
        },
    ),
]


class AnswerBlock(Block):
    """One number of a point."""

    name: Text
    before: Before | None = None
    of: Text = Field(description="Its path, as in summary.json", examples=["predictions.encounter.semi_axes_km.0"])


class RepeatBlock(Block):
    """How often a point is repeated with a truth and noise that are drawn."""

    draws: Annotated[int, Field(ge=0, le=100_000)] = 0
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 0
    seeds: Annotated[int, Field(ge=1)] = 1
    shared: bool = Field(
        default=False,
        description="Whether a draw has one bias, clock error and plate scale of each telescope for all points",
    )

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Seeds and shared errors have a meaning only where something is drawn."""
        if self.shared and not self.draws:
            return [(("shared",), "nothing is drawn, so no error is shared; say draws: 30 or more")]
        if self.seeds > 1 and not self.draws:
            return [(("seeds",), f"nothing is drawn, so {self.seeds} seeds give one answer; say draws: {self.seeds}")]
        return []


class FindBlock(Block):
    """Which point is looked for."""

    minimise: Text | None = None
    maximise: Text | None = None
    where: dict[str, Text] = Field(default_factory=dict, description='Conditions, such as {sigma: "< 1 km"}')
    cost: str | int | float | None = Field(default=None, description="A formula of what is varied and of the answers")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """One objective, not two."""
        if (self.minimise is None) == (self.maximise is None):
            return [((), "needs minimise or maximise, one of them: a name of an answer, of what is varied, or cost")]
        return []


class ImpactorsBlock(Block):
    """Impactors drawn from the orbits of a catalogue, and companions that miss."""

    orbits: Text = Field(
        default=PUBLISHED,
        description=f"Catalogue of near-Earth objects, of which orbits are drawn by Opik's probability; {PUBLISHED}: "
        "the model of Granvik et al. 2018",
    )
    n: Annotated[int, Field(ge=1, le=1_000_000)] = Field(description="Impactors")
    misses: Annotated[int, Field(ge=0, le=1_000_000)] = Field(default=0, description="Companions that miss")
    within: PositiveLength = Field(default=100_000.0, description="How far misses pass the Earth's centre at the most")
    start: When = Field(description="First date of the encounters")
    span: PositiveDuration = Field(description="Over which they are even")
    smallest: Size = Field(default=20.0, description="Diameter; their number goes with its power -2.70")
    largest: Size = 300.0
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 0

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Diameters and distances make spans."""
        found: list[tuple[KeyPath, str]] = []
        if not self.smallest < self.largest:
            found.append((("largest",), f"is not above smallest ({self.smallest:g} m)"))
        if self.within <= 7000.0:
            found.append((("within",), "is not above the Earth (allowed more than 7000 km)"))
        return found


class ObjectsBlock(Block):
    """Objects, each of which takes the place of the mission's."""

    from_: Text | None = Field(None, alias="from", description="ECSV or CSV of elements, an SBDB query, or MPCORB")
    first: Annotated[int, Field(ge=1)] | None = Field(default=None, description="So many rows; all when absent")
    impactors: ImpactorsBlock | None = None
    move: bool | None = Field(
        None, description="Whether epochs of the mission move with that of the orbit; true for impactors when absent"
    )

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """A catalogue, or a draw."""
        if (self.from_ is None) == (self.impactors is None):
            return [((), "needs from (a catalogue) or impactors, one of them")]
        return []


class RequireBlock(Block):
    """How good each thing must be for a wanted answer."""

    of: Text = Field(description="Name of an answer")
    at_most: Text = Field(description="What it may be", examples=["1 km"])
    each: dict[str, Paths] = Field(min_length=1, max_length=MOST_AXES, description="Things by a name of one's own")
    cost: str | int | float | None = Field(
        default=None, description="A formula of the names; else the sum of now / value"
    )


class WarningBlock(Block):
    """From when on an object is warned of."""

    of: Text = Field(description="Name of an answer, such as a probability of impact")
    at_least: Text | float = Field(description="From which it is a warning", examples=[0.01])


class StudyFile(Block):
    """A study."""

    schema_version: Annotated[int, Field(ge=1, le=SCHEMA_VERSION)]
    study: Text = Field(description="Its name")
    title: Text | None = None
    mission: Text = Field(description="A mission file, beside this one, or a built-in mission")
    vary: dict[str, AxisBlock] = Field(default_factory=dict, max_length=MOST_AXES)
    objects: ObjectsBlock | None = None
    sample: SampleField = Sample()
    repeat: RepeatBlock = RepeatBlock()
    answer: Annotated[Several[AnswerBlock], Field(min_length=1, max_length=MOST_ANSWERS)]
    find: FindBlock | None = None
    require: RequireBlock | None = None
    warning: WarningBlock | None = None

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Something is varied, or required."""
        if self.vary or self.objects is not None or self.require is not None:
            return []
        return [((), "varies nothing: needs vary, objects or require")]


def study_schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of the file of a study."""
    schema = StudyFile.model_json_schema(by_alias=True)
    definitions = schema.pop("$defs")
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "nebosvod study",
        **{key: value for key, value in schema.items() if key != "title"},
        "$defs": dict(sorted(definitions.items())),
    }
