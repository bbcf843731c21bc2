"""Numbers with units as people write them ("0.1 arcsec", "340 m", "12 h") -> internal units, and no other way in.

Internal units are km, s, rad; a body's radius is in m, its mass in kg, its density in kg/m^3, and
Marsden's A1..A3 in au/d^2.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from nebosvod.errors import InputError

AU_KM = 149597870.7  # IAU 2012 resolution B2
DAY_S = 86400.0
DEG = math.pi / 180.0  # rad
ARCSEC = math.pi / 648000.0  # rad; an angle in rad divided by it is in arcseconds
NUMBER = r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"

_QUANTITY = re.compile(rf"({NUMBER})\s*(.*)", re.DOTALL)
_LONGEST = 100
_ANGLE_FIELD = r"([-+]?)([0-9]{1,3}):([0-9]{2})(?::([0-9]{2}(?:\.[0-9]*)?))?"
_SEXAGESIMAL = re.compile(_ANGLE_FIELD)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Dimension:
    """One kind of quantity: how it is called, its units as factors to the internal unit, and an example."""

    name: str
    article: str
    factors: Mapping[str, float]
    example: str
    aliases: Mapping[str, str]

    @property
    def allowed(self) -> str:
        """The units, for a message."""
        return ", ".join(self.factors)

    @property
    def pattern(self) -> str:
        """A regular expression of what is accepted, for editors."""
        names = sorted([*self.factors, *self.aliases], key=len, reverse=True)
        return rf"^\s*{NUMBER}\s*({'|'.join(re.escape(name) for name in names)})\s*$"


def _dimension(name: str, article: str, example: str, factors: Mapping[str, float], **aliases: str) -> Dimension:
    spelled = {alias.replace("_per_", "/"): unit for alias, unit in aliases.items()}
    return Dimension(name=name, article=article, factors=factors, example=example, aliases=spelled)


ANGLE = _dimension(
    "angle", "an", "0.1 arcsec",
    {"arcsec": DEG / 3600, "mas": DEG / 3.6e6, "arcmin": DEG / 60, "deg": DEG, "rad": 1.0},
    degree="deg", degrees="deg",
)  # fmt: skip
ANGLE_RATE = _dimension(
    "angular rate", "an", "0.1 arcsec/d",
    {"arcsec/d": DEG / 3600 / DAY_S, "mas/d": DEG / 3.6e6 / DAY_S, "arcsec/h": DEG / 3600 / 3600, "deg/d": DEG / DAY_S,
     "rad/s": 1.0},
)  # fmt: skip
LENGTH = _dimension("length", "a", "3 km", {"m": 1e-3, "km": 1.0, "au": AU_KM}, AU="au")
SPEED = _dimension(
    "speed", "a", "0.5 m/s", {"mm/s": 1e-6, "m/s": 1e-3, "km/s": 1.0, "au/d": AU_KM / DAY_S}
)  # fmt: skip
DURATION = _dimension(
    "duration", "a", "12 h", {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0, "d": DAY_S, "yr": 365.25 * DAY_S}
)  # fmt: skip
RADIUS = _dimension("radius", "a", "170 m", {"m": 1.0, "km": 1e3})
MASS = _dimension("mass", "a", "6.1e10 kg", {"kg": 1.0})
DENSITY = _dimension(
    "density", "a", "2000 kg/m^3", {"kg/m^3": 1.0, "g/cm^3": 1e3}, kg_per_m3="kg/m^3", g_per_cm3="g/cm^3"
)  # fmt: skip
ACCELERATION = _dimension(
    "non-gravitational parameter", "a", "-2.9e-14 au/d^2", {"au/d^2": 1.0}, au_per_d2="au/d^2", AU_per_d2="au/d^2"
)  # fmt: skip
RATIO = _dimension("ratio", "a", "20 dB", {"dB": 1.0})
# How else people write units: (unit, how many of it), told in the message, never read. Seconds of arc and of time share
# no spelling: `"` and `'` are of angles.
_SPELT: Mapping[str, tuple[str, float]] = {
    spelling: meant
    for spellings, meant in (
        ("sec secs second seconds", ("s", 1.0)),
        ("msec msecs millisecond milliseconds", ("ms", 1.0)),
        ("us µs microsecond microseconds", ("ms", 1e-3)),
        ("mins minute minutes", ("min", 1.0)),
        ("hr hrs hour hours", ("h", 1.0)),
        ("day days", ("d", 1.0)),
        ("wk week weeks", ("d", 7.0)),
        ("mo mon month months", ("d", 30.4375)),
        ("y a yrs year years", ("yr", 1.0)),
        ("\" '' ″ ” as asec arcs arcsecs arcsecond arcseconds", ("arcsec", 1.0)),
        ("milliarcsec milliarcsecs milliarcsecond milliarcseconds", ("mas", 1.0)),
        ("uas µas microarcsec microarcsecs microarcsecond microarcseconds", ("mas", 1e-3)),
        ("' ′ ’ amin arcmins arcminute arcminutes", ("arcmin", 1.0)),
        ("° degs", ("deg", 1.0)),
        ("rads radian radians", ("rad", 1.0)),
        ("mrad mrads milliradian milliradians", ("rad", 1e-3)),
        ("urad µrad microrad microradian microradians", ("rad", 1e-6)),
        ("mm millimetre millimetres millimeter millimeters", ("m", 1e-3)),
        ("cm centimetre centimetres centimeter centimeters", ("m", 1e-2)),
        ("ms metre metres meter meters", ("m", 1.0)),
        ("kms kilometre kilometres kilometer kilometers", ("km", 1.0)),
        ("ua aus astronomical_unit astronomical_units", ("au", 1.0)),
        ("mps m/sec metres/second meters/second metres/s meters/s m_s m.s-1 ms-1", ("m/s", 1.0)),
        ("mmps mm/sec mm_s", ("mm/s", 1.0)),
        ("cm/s cm/sec", ("m/s", 1e-2)),
        ("kps km/sec kilometres/second kilometers/second km_s km.s-1 kms-1", ("km/s", 1.0)),
        ("km/h km/hr kmh kph", ("m/s", 1.0 / 3.6)),
        ("au/day", ("au/d", 1.0)),
        ("kgs kilogram kilograms", ("kg", 1.0)),
        ("g gram grams", ("kg", 1e-3)),
        ("t ton tons tonne tonnes", ("kg", 1e3)),
        ("kg/m3 kg/m**3 kg/m³", ("kg/m^3", 1.0)),
        ("g/cm3 g/cm**3 g/cm³ g/cc", ("g/cm^3", 1.0)),
        ("au/d2 au/d**2 au/d² au/day^2 au/day2 au/day**2", ("au/d^2", 1.0)),
        ("arcsec/day \"/d \"/day as/d", ("arcsec/d", 1.0)),
        ("mas/day", ("mas/d", 1.0)),
        ("arcsec/hr arcsec/hour \"/h as/h", ("arcsec/h", 1.0)),
        ("arcsec/min \"/min as/min", ("arcsec/h", 60.0)),
        ("deg/day °/d", ("deg/d", 1.0)),
        ("decibel decibels", ("dB", 1.0)),
    )
    for spelling in spellings.split()
}  # fmt: skip
DIMENSIONS = (RATIO, ANGLE, ANGLE_RATE, LENGTH, SPEED, DURATION, RADIUS, MASS, DENSITY, ACCELERATION)


def quantity(value: object, dimension: Dimension) -> float:
    """Read a number with its unit.

    Parameters
    ----------
    value : text such as "0.1 arcsec"; anything else is refused with advice.
    dimension : what is wanted.

    Returns
    -------
    float
        The value in the internal unit of the dimension; finite.

    Raises
    ------
    InputError
        If there is no unit, the unit is unknown or of another kind, or the number is not finite.
    """
    wanted = f"needs {dimension.article} {dimension.name} with a unit"
    allowed = f"allowed units: {dimension.allowed}"
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise InputError(f'{wanted} ({allowed}); for example "{dimension.example}"')
    if not isinstance(value, str):
        unit = dimension.example.split()[-1]
        raise InputError(f'{wanted} (got {value}; {allowed}); try "{value} {unit}"')
    match = _QUANTITY.fullmatch(value.strip()) if len(value) <= _LONGEST else None
    if match is None:
        raise InputError(f'{wanted} (got "{_cut(value)}"; {allowed}); for example "{dimension.example}"')
    number, unit = match[1], match[2].strip()
    factor = dimension.factors.get(dimension.aliases.get(unit, unit))
    if factor is None:
        raise InputError(f'{wanted} (got "{_cut(value)}"; {allowed}){_unit_hint(unit, number, dimension)}')
    result = float(number) * factor
    if not math.isfinite(result):
        raise InputError(f'needs a finite number (got "{_cut(value)}")')
    return result


def right_ascension(text: str) -> float:
    """Right ascension in rad, in [0, 2 pi): sexagesimal hours `12:30:00.5`, or an angle such as "187.5 deg"."""
    if ":" not in text:
        return quantity(text, ANGLE) % (2.0 * math.pi)
    hours = _sexagesimal(text, "right ascension", "12:30:00.5 (hours)")
    if not 0.0 <= hours < 24.0:
        raise InputError(f'right ascension is out of range (got "{_cut(text)}"; allowed 00:00:00 to 24:00:00, hours)')
    return hours * 15.0 * DEG


def declination(text: str) -> float:
    """Declination in rad, in [-pi/2, pi/2]: sexagesimal degrees `-05:30:00`, or an angle such as "-5.5 deg"."""
    value = quantity(text, ANGLE) / DEG if ":" not in text else _sexagesimal(text, "declination", "-05:30:00 (degrees)")
    if not -90.0 <= value <= 90.0:
        raise InputError(f'declination is out of range (got "{_cut(text)}"; allowed -90 to 90 deg)')
    return value * DEG


def _sexagesimal(text: str, what: str, example: str) -> float:
    """`[-]A:MM[:SS.s]` -> A with its fraction; the sign counts for -00:30:00 too."""
    match = _SEXAGESIMAL.fullmatch(text.strip()) if len(text) <= _LONGEST else None
    if match is None or int(match[3]) > 59 or float(match[4] or 0.0) >= 60.0:
        raise InputError(f'{what} is not sexagesimal (got "{_cut(text)}"); for example {example}')
    value = int(match[2]) + int(match[3]) / 60.0 + float(match[4] or 0.0) / 3600.0
    return -value if match[1] == "-" else value


def _unit_hint(unit: str, number: str, dimension: Dimension) -> str:
    """What the user may have meant by a unit that does not fit."""
    if unit.startswith(","):
        return "; the decimal mark is a point"
    if re.search(r"\d\s*[a-z]", unit.split("/")[0].split("^")[0], re.IGNORECASE):
        return f'; one number with one unit, for example "{dimension.example}"'
    if not unit and math.isfinite(float(number)):
        return f'; try "{number} {dimension.example.split()[-1]}"'
    if meant := respelt(number, unit, dimension):
        return f'; did you mean "{meant}"?'
    near = get_close_matches(unit, [*dimension.factors, *dimension.aliases], 1, 0.5)
    if near:
        return f'; did you mean "{number} {dimension.aliases.get(near[0], near[0])}"?'
    other = next((d for d in DIMENSIONS if unit in d.factors), None)
    return f"; {unit} is a unit of {other.name}" if other else ""


def respelt(number: str, unit: str, dimension: Dimension) -> str:
    """A quantity as it is written here, where its unit is spelt as others spell it; empty where it is not."""
    words = unit.replace(" per ", "/").replace(" / ", "/").strip().replace(" ", "_")
    for word in (words, words.lower(), words.removesuffix(".")):
        own = (dimension.aliases.get(word, word), 1.0)
        name, factor = own if own[0] in dimension.factors else _SPELT.get(word, own)
        if name in dimension.factors:
            return f"{number if factor == 1.0 else format(float(number) * factor, '.12g')} {name}"
    return ""


def meant_quantity(text: str, dimension: Dimension) -> str:
    """A quantity as it is written here, from a text that says it in any spelling; empty where it says none."""
    match = _QUANTITY.fullmatch(text.strip()) if len(text) <= _LONGEST else None
    return "" if match is None or not match[2].strip() else respelt(match[1], match[2].strip(), dimension)


def _cut(text: str) -> str:
    """Text short and printable enough for a message."""
    cut = text if len(text) <= 60 else text[:60] + "..."
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in cut)
