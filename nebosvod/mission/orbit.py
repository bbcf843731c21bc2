"""The heliocentric orbit of the object in the forms people have it: elements, a state, or JPL's SBDB block."""

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from nebosvod.errors import CoverageError, InputError
from nebosvod.mission.covariance import COMETARY_SCALE, Array, Matrix
from nebosvod.mission.fields import (
    LARGEST,
    Altitude,
    Angle,
    Azimuth,
    Block,
    Complaints,
    Height,
    Inclination,
    KeyPath,
    Length,
    Parsed,
    PositiveLength,
    PositiveSpeed,
    Several,
    Speed,
    When,
)
from nebosvod.timescale import Epoch
from nebosvod.units import AU_KM, DEG

if TYPE_CHECKING:
    from nebosvod.dynamics import Ephemeris

GM_EARTH_KM3_S2 = 398600.4  # for limits of a speed alone
FASTEST_KM_S = 73.0  # of what is bound to the Sun

Frame = Literal["ecliptic_j2000", "icrf"]
Representation = Literal["cometary", "keplerian", "equinoctial", "state"]
Six = tuple[float, float, float, float, float, float]


class CometaryOrbit(Block):
    """Cometary elements: e, perihelion distance q, time of perihelion tp, node, argument of perihelion, inclination."""

    kind: Literal["cometary"]
    frame: Frame
    epoch: When
    e: Annotated[float, Field(ge=0.0, le=100.0)]
    q: PositiveLength
    tp: When
    node: Angle
    peri: Angle
    i: Inclination

    @property
    def representation(self) -> Representation:
        """How `elements` are to be read."""
        return "cometary"

    @property
    def elements(self) -> Six:
        """[e, q_km, tp_s after the epoch, node, peri, i], angles in rad."""
        return (self.e, self.q, self.tp - self.epoch, self.node, self.peri, self.i)


class KeplerianOrbit(Block):
    """Keplerian elements of an ellipse: a, e, i, node, argument of perihelion, mean anomaly M."""

    kind: Literal["keplerian"]
    frame: Frame
    epoch: When
    a: PositiveLength
    e: Annotated[float, Field(ge=0.0, lt=1.0)]
    i: Inclination
    node: Angle
    peri: Angle
    M: Angle

    @property
    def representation(self) -> Representation:
        """How `elements` are to be read."""
        return "keplerian"

    @property
    def elements(self) -> Six:
        """[a_km, e, i, node, peri, M], angles in rad."""
        return (self.a, self.e, self.i, self.node, self.peri, self.M)


class EquinoctialOrbit(Block):
    """Equinoctial elements of an ellipse.

    h, k = e sin, cos(peri + node); p, q = tan(i/2) sin, cos(node); longitude = M + peri + node.
    """

    kind: Literal["equinoctial"]
    frame: Frame
    epoch: When
    a: PositiveLength
    h: Annotated[float, Field(gt=-1.0, lt=1.0)]
    k: Annotated[float, Field(gt=-1.0, lt=1.0)]
    p: Annotated[float, Field(ge=-1e3, le=1e3)]
    q: Annotated[float, Field(ge=-1e3, le=1e3)]
    longitude: Angle

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """The eccentricity they imply is that of an ellipse."""
        e = (self.h**2 + self.k**2) ** 0.5
        return [] if e < 1.0 else [(("h",), f"h and k give eccentricity {e:.6g} (allowed: less than 1)")]

    @property
    def representation(self) -> Representation:
        """How `elements` are to be read."""
        return "equinoctial"

    @property
    def elements(self) -> Six:
        """[a_km, h, k, p, q, mean longitude in rad]."""
        return (self.a, self.h, self.k, self.p, self.q, self.longitude)


class StateOrbit(Block):
    """Heliocentric position and velocity."""

    kind: Literal["state"]
    frame: Frame
    epoch: When
    position: Annotated[Several[Length], Field(min_length=3, max_length=3)]
    velocity: Annotated[Several[Speed], Field(min_length=3, max_length=3)]

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """Outside the Sun."""
        r = sum(x * x for x in self.position) ** 0.5
        return [] if r > 700000.0 else [(("position",), f"is inside the Sun (got {r:.6g} km from its centre)")]

    @property
    def representation(self) -> Representation:
        """How `elements` are to be read."""
        return "state"

    @property
    def elements(self) -> Six:
        """[x, y, z km, vx, vy, vz km/s] on the axes of `frame`."""
        return (*self.position, *self.velocity)  # type: ignore[return-value]


class ImpactOrbit(Block):
    """An orbit that comes down over a place of the Earth: where, when, from where, how fast."""

    kind: Literal["impact"]
    at: When = Field(description="When it comes through the altitude")
    longitude: Azimuth = Field(description="Geodetic, east")
    latitude: Altitude = Field(description="Geodetic")
    altitude: Height = Field(100.0, description="Over the ellipsoid of WGS 84, 20 km to 1000 km; 100 km when absent")
    elevation: Altitude = Field(description="Of the path, below the horizon: more than 0 deg, up to 90 deg")
    azimuth: Azimuth = Field(description="Where it flies to, from north to east")
    speed: PositiveSpeed = Field(description="From the Earth's centre, whose axes do not turn")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """It comes from far away, and from above."""
        found: list[tuple[KeyPath, str]] = []
        if not 20.0 <= self.altitude <= 1000.0:
            found.append((("altitude",), f"is out of range (got {self.altitude:g} km; allowed 20 km to 1000 km)"))
        if self.elevation <= 0.0:
            found.append((("elevation",), "is not above 0 deg: the path must lead down"))
        escape = math.sqrt(2.0 * GM_EARTH_KM3_S2 / (6378.0 + self.altitude))
        if not escape < self.speed <= FASTEST_KM_S:
            text = (
                f"is out of range (got {self.speed:g} km/s; allowed more than {escape:.2f} km/s, which comes from far"
            )
            found.append((("speed",), f"{text} away, to {FASTEST_KM_S:g} km/s)"))
        return found

    @property
    def epoch(self) -> Epoch:
        """When it comes down."""
        return self.at

    @property
    def frame(self) -> Frame:
        """Axes of `elements`."""
        return "icrf"

    @property
    def representation(self) -> Representation:
        """How `elements` are to be read."""
        return "state"

    @property
    def elements(self) -> Six:
        """[x, y, z km, vx, vy, vz km/s], heliocentric, by the ephemeris that is found.

        Where that ends before, a state of the Earth's orbit, for estimates of cost: the epoch is refused elsewhere.
        """
        from nebosvod.dynamics import Ephemeris

        try:
            return tuple(self.state(Ephemeris.load()).tolist())
        except CoverageError:
            return (AU_KM, 0.0, 0.0, 0.0, 30.0, 0.0)

    def state(self, ephemeris: "Ephemeris") -> Array:
        """Heliocentric ICRF state (6,) by an ephemeris."""
        from nebosvod.observation.earth.ground import falling_state

        return falling_state(
            ephemeris,
            self.at,
            longitude_rad=self.longitude,
            latitude_rad=self.latitude,
            altitude_km=self.altitude,
            elevation_rad=self.elevation,
            azimuth_rad=self.azimuth,
            speed_km_s=self.speed,
        )


def _number(value: Any) -> float:
    """A number, also as JPL prints it: in quotes."""
    try:
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise ValueError
        number = float(value)
    except ValueError:
        raise InputError(f"needs a number (got {str(value)[:60]!r})") from None
    if not abs(number) <= LARGEST:
        raise InputError(f"needs a finite number up to 1e30 (got {str(value)[:60]!r})")
    return number


def _as_printed(value: Any) -> str | float:
    """A number kept as it was printed, with all its digits."""
    _number(value)
    kept: str | float = value
    return kept


def _julian(value: Any) -> Epoch:
    """A Julian date TDB as JPL prints it, digits kept."""
    _number(value)
    return Epoch.parse(f"{value} JD TDB")


_LOOSE_NUMBER = {"anyOf": [{"type": "number"}, {"type": "string"}]}
PrintedNumber = Annotated[float, Parsed(_number, _LOOSE_NUMBER)]
PrintedJulian = Annotated[
    Epoch, Parsed(_julian, _LOOSE_NUMBER | {"description": "Julian date TDB"}, lambda epoch: epoch.jd_tdb)
]


class Printed(BaseModel):
    """A block that JPL prints: keys this program has no use for are passed over."""

    model_config = ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False, hide_input_in_errors=True)


class PrintedElement(Printed):
    """One element or model parameter of JPL's lists."""

    name: str
    value: Annotated[str | float, Parsed(_as_printed, _LOOSE_NUMBER)]

    @property
    def number(self) -> float:
        """The value as a number."""
        return _number(self.value)


class SbdbCovariance(Printed):
    """`orbit.covariance` of the answer of JPL's SBDB service: labels, matrix, epoch and the elements at that epoch."""

    epoch: PrintedJulian
    labels: Several[str]
    data: Matrix
    elements: Several[PrintedElement]


# constants of Marsden's g(r), by the keywords of the force model; of water ice: Marsden et al. 1973, table III
INVERSE_SQUARE = {"alpha": 1.0, "r0_au": 1.0, "m": 2.0, "n": 5.093, "k": 0.0}
WATER_ICE = {"alpha": 0.1112620426, "r0_au": 2.808, "m": 2.15, "n": 5.093, "k": 4.6142}
_JPL_LAW = {"ALN": "alpha", "R0": "r0_au", "NM": "m", "NN": "n", "NK": "k"}  # as JPL names them
_ELEMENT_NAMES = {"e": "e", "q": "q", "tp": "tp", "om": "node", "w": "peri", "i": "i"}


class SbdbOrbit(Block):
    """JPL's Small-Body Database block at the epoch of its covariance: pasted, or read from the service's JSON file."""

    kind: Literal["sbdb"]
    file: str | None = Field(None, description="The service's JSON answer (cov=mat), beside the mission file")
    covariance: SbdbCovariance
    model_pars: Several[PrintedElement] = ()

    @model_validator(mode="before")
    @classmethod
    def _absent(cls, data: Any) -> Any:
        """A file or the block itself is needed; JPL prints null where an orbit has no model parameters."""
        if isinstance(data, dict) and "covariance" not in data:
            advice = "give file: ANSWER.json (cov=mat), or the covariance block that JPL prints"
            raise Complaints([] if data.get("file") else [((), advice)])  # a bad file has been reported
        if isinstance(data, dict) and data.get("model_pars", ()) is None:
            return {key: value for key, value in data.items() if key != "model_pars"}
        return data

    @classmethod
    def __get_pydantic_json_schema__(cls, source: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """The file stands for the blocks."""
        block = handler.resolve_ref_schema(handler(source))
        block["required"] = ["kind"]
        block["anyOf"] = [{"required": ["file"]}, {"required": ["covariance"]}]
        return block

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """All six elements are there and are an orbit; labels and matrix fit; the force model is the one we have."""
        names = {_ELEMENT_NAMES.get(item.name) for item in self.covariance.elements}
        missing = [name for name in COMETARY_SCALE if name not in names]
        if missing:
            return [(("covariance", "elements"), f"lacks {', '.join(missing)} (needs e, q, tp, om, w, i)")]
        try:
            e, q, *_, i = self.elements
            constants = {p.name: p.number for p in self.model_pars}
        except InputError as error:
            return [(("covariance", "elements"), str(error))]
        if e < 0.0 or q <= 0.0:
            return [(("covariance", "elements"), f"are no orbit (got e {e:g}, q {q:g} km; allowed e >= 0, q > 0)")]
        if not 0.0 <= i <= 180.0 * DEG:
            return [(("covariance", "elements"), f"are no orbit (got i {i / DEG:g} deg; allowed 0 deg to 180 deg)")]
        alien = [name for name in constants if name not in ("A1", "A2", "A3", *_JPL_LAW)]
        if alien:
            return [(("model_pars",), f"this version does not have the force of {', '.join(alien)[:60]}")]
        lacking = [name for name in ("ALN", "NK", "NM", "R0") if name not in constants]
        if 0 < len(lacking) < 4:
            return [(("model_pars",), f"lacks {', '.join(lacking)} of the law g(r) (needs ALN, NK, NM, R0, or none)")]
        if not all(constants.get(name, 1.0) > 0.0 for name in ("ALN", "R0")):
            return [(("model_pars",), "ALN and R0 of the law g(r) must be positive")]
        return []

    @property
    def law(self) -> dict[str, float] | None:
        """Constants of g(r) of its A1..A3: those JPL prints, that of water ice where it prints none; None without A."""
        printed = {p.name: p.number for p in self.model_pars}
        if not any(name in printed for name in ("A1", "A2", "A3")):
            return None
        said = {key: printed[name] for name, key in _JPL_LAW.items() if name in printed}
        return {**(INVERSE_SQUARE if said else WATER_ICE), **said}

    @property
    def epoch(self) -> Epoch:
        """The epoch of the covariance and its elements."""
        return self.covariance.epoch

    @property
    def frame(self) -> Frame:
        """JPL's elements refer to the ecliptic of J2000."""
        return "ecliptic_j2000"

    @property
    def representation(self) -> Representation:
        """How `elements` are to be read."""
        return "cometary"

    @property
    def elements(self) -> Six:
        """[e, q_km, tp_s after the epoch, node, peri, i], angles in rad."""
        got = {_ELEMENT_NAMES[p.name]: p for p in self.covariance.elements if p.name in _ELEMENT_NAMES}
        tp = _julian(got["tp"].value) - self.epoch
        angles = (got[name].number * DEG for name in ("node", "peri", "i"))
        return (got["e"].number, got["q"].number * AU_KM, tp, *angles)  # type: ignore[return-value]

    def nongrav_value(self, label: str) -> float | None:
        """The value of A1, A2 or A3 (au/d^2) that came with the orbit, if any."""
        return next((p.number for p in self.model_pars if p.name == label), None)

    @property
    def a1(self) -> float | None:
        """A1 of the orbit (au/d^2), if any."""
        return self.nongrav_value("A1")
