"""The building blocks of the mission's models: strict blocks, quantities with units, epochs, uncertain values."""

import re
from collections.abc import Callable, Sequence
from typing import Annotated, Any, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from nebosvod.errors import InputError
from nebosvod.timescale import HINT, SCALES, Epoch
from nebosvod.units import (
    ACCELERATION,
    ANGLE,
    ANGLE_RATE,
    DENSITY,
    DURATION,
    LENGTH,
    MASS,
    RADIUS,
    RATIO,
    SPEED,
    Dimension,
    quantity,
)

Row = TypeVar("Row")
Several = Annotated[tuple[Row, ...], Field(strict=False)]
KeyPath = tuple[str | int, ...]
LARGEST = 1e30  # of any quantity in internal units, so that squares and products stay finite
# control characters, line separators, and the marks that turn the direction of writing
_UNSEEN = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


class Complaints(ValueError):
    """Several things wrong inside one block: pairs of a path below the block and the sentence."""

    def __init__(self, items: Sequence[tuple[KeyPath, str]]) -> None:
        super().__init__("; ".join(text for _, text in items))
        self.items = tuple(items)


class Block(BaseModel):
    """A mapping of the mission file: no unknown keys, no conversions, no nan or infinity, never changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, hide_input_in_errors=True)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        items = self.complaints()
        if items:
            raise Complaints(items)
        return self

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """What does not fit together inside this block; a block with such rules overrides this."""
        return []


class Parsed:
    """Annotation: the value is read by a function of the plain tree's value; `schema` is what editors see.

    `write` is the way back, where the value in memory is not what the file says.
    """

    def __init__(
        self, read: Callable[[Any], Any], schema: dict[str, Any], write: Callable[[Any], Any] | None = None
    ) -> None:
        self.read = read
        self.schema = schema
        self.write = write

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate by `read` alone."""
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, source: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """The schema given."""
        return dict(self.schema)


def measured(
    dimension: Dimension, low: float | None = None, high: float | None = None, *, open_low: bool = False, text: str = ""
) -> Parsed:
    """A quantity with a unit inside a range given in internal units; `text` says the range in words."""

    def read(value: Any) -> float:
        number = quantity(value, dimension)
        if abs(number) > LARGEST or (open_low and 0.0 < number < 1.0 / LARGEST):
            raise InputError(f'is out of range (got "{value}"; allowed 1e-30 to 1e30 in the unit used inside)')
        too_low = low is not None and (number <= low if open_low else number < low)
        if too_low or (high is not None and number > high):
            raise InputError(f'is out of range (got "{value}"; allowed {text})')
        return number

    about = f"{dimension.article} {dimension.name} with its unit: {dimension.allowed}" + (f"; {text}" if text else "")
    schema = {
        "type": "string",
        "pattern": dimension.pattern,
        "description": about[0].upper() + about[1:],
        "examples": [dimension.example],
    }
    unit = next(name for name, factor in dimension.factors.items() if factor == 1.0)
    return Parsed(read, schema, lambda number: f"{float(number)!r} {unit}")


def _positive(dimension: Dimension) -> Parsed:
    return measured(dimension, 0.0, open_low=True, text="more than 0")


_TURN = 6.283185307179586

Angle = Annotated[float, measured(ANGLE)]
PositiveAngle = Annotated[float, _positive(ANGLE)]
Separation = Annotated[float, measured(ANGLE, 0.0, _TURN / 2, text="0 deg to 180 deg")]
Inclination = Annotated[float, measured(ANGLE, 0.0, _TURN / 2, text="0 deg to 180 deg")]
Altitude = Annotated[float, measured(ANGLE, -_TURN / 4, _TURN / 4, text="-90 deg to 90 deg")]
Lead = Annotated[float, measured(ANGLE, -_TURN / 2, _TURN / 2, text="-180 deg to 180 deg")]
Azimuth = Annotated[float, measured(ANGLE, -_TURN, _TURN, text="-360 deg to 360 deg")]
Length = Annotated[float, measured(LENGTH)]
PositiveLength = Annotated[float, _positive(LENGTH)]
Height = Annotated[float, measured(LENGTH, 0.0, text="0 or more")]
Speed = Annotated[float, measured(SPEED)]
PositiveSpeed = Annotated[float, _positive(SPEED)]
PositiveDuration = Annotated[float, _positive(DURATION)]
Duration = Annotated[float, measured(DURATION, 0.0, text="0 or more")]
Offset = Annotated[float, measured(DURATION)]
LocalTime = Annotated[float, measured(DURATION, 0.0, 86399.999, text="0 h to below 24 h")]
PositiveAngleRate = Annotated[float, _positive(ANGLE_RATE)]
Size = Annotated[float, _positive(RADIUS)]
MassKg = Annotated[float, _positive(MASS)]
DensityKgM3 = Annotated[float, _positive(DENSITY)]
Decibel = Annotated[float, measured(RATIO, -200.0, 200.0, text="-200 dB to 200 dB")]
Acceleration = Annotated[float, measured(ACCELERATION)]
PositiveAcceleration = Annotated[float, _positive(ACCELERATION)]


def _epoch(value: Any) -> Epoch:
    if not isinstance(value, str):
        raise InputError(f"needs an epoch with its time scale (got {value!r}; allowed scales: UTC, TDB, TT); {HINT}")
    if len(value) > 60:
        raise InputError(f"is not an epoch (got {len(value)} characters); {HINT}")
    return Epoch.parse(value)


def epoch_text(epoch: Epoch) -> str:
    """An epoch as a file would say it, exactly."""
    for digits in (0, 3, 6, 9):
        text = epoch.iso("tdb", digits)
        if Epoch.parse(text) == epoch:
            return text
    return f"{epoch.day - 2400000.5:.0f}{f'{epoch.fraction:.20f}'.removeprefix('0')} MJD TDB"


When = Annotated[
    Epoch,
    Parsed(
        _epoch,
        {
            "type": "string",
            "pattern": r"^.+ (TDB|TT|UTC|tdb|tt|utc)$",
            "description": "An epoch with its time scale: a calendar date or a Julian date",
            "examples": ["2028-11-15T00:00:00 TDB", "2028-11-15 UTC", "2459215.5 JD TDB"],
        },
        epoch_text,
    ),
]


_DATE = re.compile(r"\d{4}-\d{2}-\d{2}([T ]\d{2}:\d{2}(:\d{2}(\.\d+)?)?)?")


def observation_time(value: Any) -> Epoch:
    """An epoch; without a time scale a date of observations, which are in UTC.

    Raises
    ------
    InputError
        If it is neither; says what is allowed.
    """
    text = value.strip().removesuffix("Z") if isinstance(value, str) else ""
    if _DATE.fullmatch(text):
        return Epoch.parse(f"{text} UTC")
    if text.rpartition(" ")[2].lower() in SCALES:
        return _epoch(value)
    got = str(value)[:60]
    raise InputError(f'needs a date (got "{got}"; allowed such as 2024-07-01 or 2024-07-01T12:00:00, in UTC)')


ObservationTime = Annotated[
    Epoch,
    Parsed(
        observation_time,
        {
            "type": "string",
            "pattern": r"^\d.*$",
            "description": "A date, UTC unless another scale is said; a date alone is its 0h",
            "examples": ["2024-07-01", "2024-07-01T12:00:00", "2460492.5 JD TDB"],
        },
        epoch_text,
    ),
]


def line_of_text(value: Any) -> str:
    if not isinstance(value, str):
        raise InputError(f"needs text (got {value!r}); put it in quotes")
    if not value.strip():
        raise InputError("needs text (got nothing)")
    if len(value) > 200 or "\n" in value:
        raise InputError(f"needs one line of at most 200 characters (got {len(value)})")
    if bad := _UNSEEN.search(value):
        raise InputError(f"has a character that cannot be shown (got U+{ord(bad[0]):04X}); delete it")
    return value.strip()


Text = Annotated[
    str, Parsed(line_of_text, {"type": "string", "minLength": 1, "maxLength": 200, "description": "One line of text"})
]


Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
PositiveNumber = Annotated[float, Field(ge=1e-12, le=1e3)]
