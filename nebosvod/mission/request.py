"""What a mission asks for: when to measure, what is known before, which estimators, predictions and reports."""

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from nebosvod.borders.expression import read_expression
from nebosvod.borders.treatment import Treatment
from nebosvod.errors import InputError
from nebosvod.mission.covariance import COMETARY_SCALE, NONGRAV_SCALE, STATE_SCALE, Array, Matrix, checked
from nebosvod.mission.declared import TruePrior
from nebosvod.mission.fields import (
    Block,
    Decibel,
    Height,
    KeyPath,
    Parsed,
    PositiveDuration,
    PositiveLength,
    PositiveSpeed,
    Several,
    Text,
    When,
)
from nebosvod.mission.formula import ELEMENTS, formula_names
from nebosvod.mission.found import FoundOrbit, without_found
from nebosvod.mission.orbit import Frame
from nebosvod.mission.uncertainty import GROUPS, Group
from nebosvod.mission.vocabulary import Method
from nebosvod.mission.yaml.inherit import MAX_TELESCOPES
from nebosvod.timescale import Epoch

OWN_GAIN = ("schmidt", "as_printed")  # methods whose gain is not that of least squares
TWO_STAGE = ("two_stage", "hsieh_chen")  # methods that keep the orbit and what else is estimated apart
EXTENDED = ("ekf", "iterated_ekf")  # methods that linearise each measurement anew, and go through them once
WITH_HISTORY = (*TWO_STAGE, *EXTENDED, "smoother")  # methods whose beliefs after each measurement are kept
FROM_A_PRIOR = (*WITH_HISTORY, *OWN_GAIN)  # methods that start from a prior of everything they estimate
PARAMETER_GROUPS = ("radius", "mass", "albedo", "thermal_emission", "A1", "A2", "A3", "a1_residual", "H")


def _names(value: Any) -> Any:
    """`all`, or a list of telescope names."""
    if value == "all":
        return "all"
    if isinstance(value, list) and len(value) > MAX_TELESCOPES:
        raise InputError(f"is too long (got {len(value)} names; allowed {MAX_TELESCOPES})")
    if isinstance(value, list) and value and all(isinstance(name, str) for name in value):
        return tuple(value)
    if isinstance(value, list) and any(isinstance(name, int | float) for name in value):
        raise InputError(f'a name made of digits needs quotes: ["703"] (got {str(value)[:60]})')
    raise InputError(f"needs all or a list of telescope names (got {str(value)[:60]!r})")


TelescopeNames = Annotated[
    tuple[str, ...] | Literal["all"],
    Parsed(_names, {"anyOf": [{"const": "all"}, {"type": "array", "minItems": 1, "items": {"type": "string"}}]}),
]


def _formula(value: Any) -> str:
    """A formula that can be read."""
    return read_expression(value, formula_names()).text


Formula = Annotated[
    str, Parsed(_formula, {"type": "string", "maxLength": 1000, "examples": ["hypot(x - earth.x, y - earth.y)"]})
]


class Arc(Block):
    """Visits from start to end (both included) at a steady cadence, each of one or several exposures."""

    telescopes: TelescopeNames = "all"
    start: When
    end: When
    cadence: PositiveDuration
    exposures: Annotated[int, Field(ge=1, le=1000, description="Of each visit")] = 1
    spacing: PositiveDuration | None = Field(None, description="From exposure to exposure of a visit")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """The end does not precede the start; a visit ends before the next one."""
        if self.end < self.start:
            return [(("end",), f"end is before start (got end {self.end}, start {self.start})")]
        if (self.exposures > 1) != (self.spacing is not None):
            return [(("spacing",), "goes with exposures: several of them, and the time from one to the next")]
        if self.spacing is not None and (self.exposures - 1) * self.spacing >= self.cadence:
            return [(("spacing",), f"a visit of {self.exposures} exposures lasts longer than the cadence")]
        return []

    @property
    def visits(self) -> int:
        """How many visits the arc has."""
        return math.floor((self.end - self.start) / self.cadence + 1e-9) + 1

    @property
    def count(self) -> int:
        """How many epochs the arc has."""
        return self.visits * self.exposures

    def after_start_s(self) -> Array:
        """Epochs (count,), s after the start."""
        visit = self.cadence * np.arange(self.visits)
        return (visit[:, None] + (self.spacing or 0.0) * np.arange(self.exposures)).ravel()


class SigmaPrior(Block):
    """Independent errors of the state at the reference epoch, the same on each ICRF axis."""

    position: PositiveLength
    velocity: PositiveSpeed


class Prior(Block):
    """What is known of the orbit before the first measurement: sigmas, or a covariance joint with A1..A3.

    Numbers of a covariance are in the units of its names: au, d (tp), deg for e q tp node peri i, as JPL prints
    them; km and km/s for x y z vx vy vz; au/d^2 for A1 A2 A3. That of a file is joint with all its orbit is known with.
    """

    sigma: SigmaPrior | None = None
    file: Text | None = Field(None, description="An orbit whose covariance it is: as object.orbit of kind file")
    found: FoundOrbit | None = None
    covariance: Matrix | None = None
    names: Several[str] | None = None
    epoch: When | None = Field(None, description="Of the covariance; the reference epoch when absent")
    frame: Frame | None = Field(None, description="Axes of the covariance; ecliptic_j2000 for elements when absent")
    true: TruePrior | None = Field(None, description="How wrong it really is, where that is not as it says")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """One of the three forms, complete."""
        if self.file is not None:
            return self._beside("file", ("sigma", "covariance", "names", "epoch", "frame"))
        if self.sigma is not None:
            return self._beside("sigma", ("covariance", "names", "epoch", "frame"))
        if self.covariance is None or self.names is None:
            return [((), "needs sigma {position, velocity}, or covariance and names, or file")]
        try:
            scales(self.names, len(self.covariance))
        except InputError as error:
            return [(("names",), str(error))]
        return []

    @classmethod
    def __get_pydantic_json_schema__(cls, source: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """The file alone is what a user writes."""
        return without_found(handler.resolve_ref_schema(handler(source)))

    def _beside(self, form: str, others: tuple[str, ...]) -> list[tuple[KeyPath, str]]:
        """What stands beside one of the forms, and belongs to another."""
        rest = [name for name in others if getattr(self, name) is not None]
        return [((rest[0],), f"stands beside {form}; keep one of the two forms")] if rest else []

    @property
    def read(self) -> FoundOrbit:
        """What is in the file."""
        if self.found is None:
            raise InputError(f"{self.file}: has not been read; load the mission from its file")
        return self.found


def scales(names: tuple[str, ...], size: int) -> Array:
    """Factors (k,) from the units of a covariance's names to internal units.

    Raises
    ------
    InputError
        If the names do not fit the matrix or are not a whole state (or whole elements) and A1..A3.
    """
    if len(names) != size or len(set(names)) != size:
        raise InputError(f"do not fit the matrix (got {len(set(names))} different names; the matrix has {size} rows)")
    orbit = STATE_SCALE if "x" in names else COMETARY_SCALE
    allowed = orbit | NONGRAV_SCALE
    wrong = [name for name in names if name not in allowed]
    missing = [name for name in orbit if name not in names]
    if wrong or missing:
        what = f"got {', '.join(wrong)}" if wrong else f"lacks {', '.join(missing)}"
        raise InputError(
            f"are not a whole orbit ({what[:80]}; allowed: e q tp node peri i, or x y z vx vy vz; and A1 A2 A3)"
        )
    return np.array([allowed[name] for name in names])


def internal_covariance(names: tuple[str, ...], covariance: Array, keep: tuple[str, ...]) -> Array:
    """The rows and columns `keep` of a covariance in internal units (km, s, rad, au/d^2)."""
    factor = scales(names, len(covariance))
    index = [names.index(name) for name in keep]
    scaled: Array = (covariance * factor[:, None] * factor)[np.ix_(index, index)]
    return checked(scaled)


class Estimator(Block):
    """One way to estimate; `treatment` overrides what the mission says of a group, for this estimator only."""

    name: Text
    method: Method
    treatment: dict[str, Treatment] = Field(
        default_factory=dict,
        description=f"Treatment by group: {', '.join((*PARAMETER_GROUPS, *GROUPS))}; "
        "of one telescope: 'bias NAME', 'position NAME', 'timing NAME'; or any source by its name in the budget",
    )
    telescopes: Annotated[TelescopeNames, Field(description="Takes the measurements of these alone")] = "all"
    iterations: Annotated[int, Field(ge=1, le=200, description="Cap of Gauss-Newton iterations")] = 20

    def takes(self, telescope: str) -> bool:
        """Whether it takes the measurements of a telescope."""
        return self.telescopes == "all" or telescope in self.telescopes


class SkyPrediction(Block):
    """The error ellipse on the sky as one telescope sees it, or the error of its distance from there."""

    name: Text
    plane: Literal["sky", "distance"]
    telescope: Text = Field(alias="from", description="Name of a telescope")
    at: When

    @property
    def when(self) -> Epoch:
        """The epoch asked about."""
        return self.at


class StatePrediction(Block):
    """The error of the predicted position (ICRF), or on radial, transverse, normal axes."""

    name: Text
    plane: Literal["position", "rtn", "rtn_velocity"]
    at: When

    @property
    def when(self) -> Epoch:
        """The epoch asked about."""
        return self.at


class ValuePrediction(Block):
    """One number of the orbit at a time: an osculating element, the specific energy, or a formula."""

    name: Text
    plane: Literal["element", "energy", "formula"]
    element: Literal["a", "e", "q", "Q", "i", "node", "peri", "M", "tp", "period", "n"] | None = Field(
        None, description="Heliocentric, ecliptic of J2000; tp: time to the perihelion passage"
    )
    formula: Formula | None = Field(
        None,
        description="Of x y z vx vy vz (heliocentric ICRF, km and km/s), the same of the Earth as earth.x ..., radius "
        "(m), mass (kg), albedo, thermal_emission, A1 A2 A3 (au/d^2), gm_sun, gm_earth (km^3/s^2), au (km)",
    )
    unit: Annotated[str, Field(pattern=r"^(m_s|km2_s2|deg_d|[A-Za-z][A-Za-z0-9]{0,19})$")] | None = Field(
        None, description="Of a formula, as it shall stand in keys: km, m_s, deg; without one a pure number"
    )
    at: When

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """What the plane needs, and nothing else."""
        found: list[tuple[KeyPath, str]] = []
        for key in ("element", "formula"):
            said = getattr(self, key) is not None
            if said != (self.plane == key):
                what = f"goes with plane {key}" if said else f"is missing; plane {key} needs it"
                found.append(((key,), what))
        if self.unit is not None and self.plane != "formula":
            found.append((("unit",), "goes with plane formula; the others have one of their own"))
        return found

    @property
    def when(self) -> Epoch:
        """The epoch asked about."""
        return self.at

    @property
    def in_unit(self) -> str:
        """The unit of its value, as in a key."""
        if self.element is not None:
            return ELEMENTS[self.element]
        return "km2_s2" if self.formula is None else self.unit or "1"


class EncounterPrediction(Block):
    """The error on the target plane of an encounter, or of its smallest distance."""

    name: Text
    plane: Literal["b_plane", "mtp", "perigee_distance", "entry"]
    body: Literal["mercury", "venus", "earth", "moon", "mars", "jupiter", "saturn", "uranus", "neptune"] = "earth"
    near: When = Field(description="About when the encounter is; the closest one within 3 days is taken")
    altitude: Height | None = Field(None, description="Above the surface (the ellipsoid), of plane entry; or 0 km")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """An altitude is where the atmosphere is entered."""
        if (self.altitude is not None) != (self.plane == "entry"):
            return [(("altitude",), 'goes with plane entry, which needs it, for example "100 km"')]
        if self.altitude is not None and not 0.0 <= self.altitude <= 1e5:
            return [(("altitude",), f"is out of range (got {self.altitude:g} km; allowed 0 km to 100000 km)")]
        return []

    @property
    def when(self) -> Epoch:
        """The epoch asked about."""
        return self.near


Prediction = Annotated[
    SkyPrediction | StatePrediction | ValuePrediction | EncounterPrediction, Field(discriminator="plane")
]


NuisanceGroup = Literal["parameters", Group]


class NuisancePlan(Block):
    """What counts as nuisance where the noise is held against it, and how small it should be."""

    eta_min: Decibel = Field(20.0, description="Noise over nuisance that is wanted; limits of the position follow")
    nuisances: Annotated[Several[NuisanceGroup], Field(min_length=1)] = Field(
        ("parameters", "position"), description="Those of the mean ratio; one with all of them is given beside it"
    )


class MonteCarlo(Block):
    """Repeated estimation with errors really drawn."""

    runs: Annotated[int, Field(ge=1)]


Perturber = Literal[
    "camilla", "ceres", "cybele", "davida", "eunomia", "euphrosyne", "europa", "hygiea", "interamnia", "iris", "juno",
    "pallas", "psyche", "sylvia", "thisbe", "vesta",
]  # fmt: skip


class ForcePlan(Block):
    """Which forces act, beside the Sun, planets, Moon, Pluto and what the object says of itself."""

    asteroids: bool = Field(True, description="The attraction of sixteen large asteroids")
    excluded: Several[Perturber] = Field((), description="Those of them that do not attract")
    relativity: Literal["sun", "eih", "none"] = Field("sun", description="Of the Sun alone, or eih: of all planets")
    lense_thirring: bool = Field(False, description="Frame dragging by the rotating Sun, below a metre a year")
    earth_oblateness: bool = Field(True, description="Zonal harmonics of the Earth")
    earth_harmonics: Literal[2, 3, 4] = Field(4, description="The highest of them")
    earth_pole: Literal["date", "j2000"] = Field("date", description="With precession and nutation, or fixed")
    earth_shadow: bool = Field(True, description="Whether the Earth's shadow interrupts radiation pressure")
    sun_oblateness: bool = Field(True, description="J2 of the Sun")
    ephemeris: str | None = Field(None, description="An SPK file beside the mission, instead of the one found")

    @property
    def settings(self) -> dict[str, Any]:
        """The keywords of `ForceModel` that say the same."""
        return {name: getattr(self, name) for name in type(self).model_fields if name != "ephemeris"}

    @property
    def facts(self) -> dict[str, Any]:
        """What is said of them in a summary: no detail of a force that is off, none that is off unless told."""
        meaningless = () if self.earth_oblateness else ("earth_harmonics", "earth_pole")
        usual = {name: field.default for name, field in type(self).model_fields.items()}
        return {
            name: value
            for name, value in self.settings.items()
            if name not in meaningless and (value is not False or usual[name] is not False)
        }

    @property
    def statements(self) -> tuple[str, ...]:
        """Every force in words, with those that were switched off."""
        without = f" without {', '.join(self.excluded)}" if self.excluded else ""
        relativity = {"sun": "relativity of the Sun", "eih": "relativity of all planets (EIH)", "none": "no relativity"}
        zonal = {2: "J2", 3: "J2, J3", 4: "J2 to J4"}[self.earth_harmonics]
        pole = {"date": "pole of date", "j2000": "pole of J2000"}[self.earth_pole]
        return (
            f"16 asteroids{without}" if self.asteroids else "no asteroids",
            relativity[self.relativity],
            *(("Lense-Thirring effect of the Sun",) if self.lense_thirring else ()),
            f"Earth {zonal} ({pole})" if self.earth_oblateness else "no oblateness of the Earth",
            "Sun J2" if self.sun_oblateness else "no oblateness of the Sun",
        )

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """A detail of a force that is off means nothing."""
        found: list[tuple[KeyPath, str]] = []
        if self.excluded and not self.asteroids:
            found.append(
                (("excluded",), "names asteroids, and none attracts with asteroids: false; remove one of them")
            )
        for key in ("earth_harmonics", "earth_pole"):
            if key in self.model_fields_set and not self.earth_oblateness:
                found.append(((key,), "means nothing with earth_oblateness: false; remove one of the two"))
        return found


Shown = Literal["information", "gains", "full_gains", "nuisances", "smallness", "bounds", "imitation"]


class ReportPlan(Block):
    """What the report shows."""

    sigma_level: Annotated[float, Field(gt=0.0, le=10.0, description="Size of the ellipses drawn")] = 3.0
    note: str | None = Field(None, max_length=5000, description="Free text, shown at the top")
    show: Several[Shown] = Field(
        (),
        description="Of the first estimate: D0, gains and refined nuisances as arrays (full_gains: of each nuisance by "
        "every measurement), whether errors are small, what errors in boxes allow after the measurements, and which "
        "motion a common error imitates",
    )
