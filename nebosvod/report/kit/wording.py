"""Numbers, units and names as a reader sees them.

Every number of the page goes through `quantity`, which writes the rounded text and keeps the exact value and
its unit in the element itself, so that a reader can copy it and a test can compare it with summary.json.
"""

import math
from collections.abc import Iterable, Sequence
from typing import TypeGuard

from markupsafe import Markup

from nebosvod.mission.vocabulary import PLANES

MINUS, THIN, NBSP, TIMES = (
    "\N{MINUS SIGN}",
    "\N{NARROW NO-BREAK SPACE}",
    "\N{NO-BREAK SPACE}",
    "\N{MULTIPLICATION SIGN}",
)
DASH = "\N{EM DASH}"
SUPERSCRIPT = str.maketrans("-0123456789", "\N{SUPERSCRIPT MINUS}⁰¹²³⁴⁵⁶⁷⁸⁹")

# unit of the files -> (from this magnitude on, factor, unit on the page), largest first
LADDER: dict[str, tuple[tuple[float, float, str], ...]] = {
    "km": ((1e7, 1 / 1.495978707e8, "au"), (0.1, 1.0, "km"), (1e-4, 1e3, "m"), (0.0, 1e6, "mm")),
    "km_s": ((0.1, 1.0, "km/s"), (1e-4, 1e3, "m/s"), (0.0, 1e6, "mm/s")),
    "m_s": ((1e3, 1e-3, "km/s"), (0.1, 1.0, "m/s"), (1e-4, 1e3, "mm/s"), (0.0, 1e6, "µm/s")),
    "arcsec": ((3600.0, 1 / 3600.0, "°"), (0.1, 1.0, "arcsec"), (1e-4, 1e3, "mas"), (0.0, 1e6, "µas")),
    "deg": ((0.0, 1.0, "°"),),
}
UNIT_TEXT = {
    "km_s": "km/s",
    "m_s": "m/s",
    "au_d2": "au/d²",
    "deg": "°",
    "deg_d": "°/d",
    "km2_s2": "km²/s²",
    "1": "",
    "": "",
}

PARAMETERS = {
    "radius_m": ("radius", "m"),
    "mass_kg": ("mass", "kg"),
    "albedo": ("Bond albedo", ""),
    "thermal_emission": ("thermal emission", ""),
    "ln_radius": ("ln radius", ""),
    "ln_mass": ("ln mass", ""),
    "ln_albedo": ("ln Bond albedo", ""),
    "a1_au_d2": ("A1", "au/d²"),
    "a2_au_d2": ("A2", "au/d²"),
    "a3_au_d2": ("A3", "au/d²"),
    "H_mag": ("absolute magnitude H", ""),
}
# a logarithm that is estimated in place of a quantity with a lognormal error -> that quantity
LOGARITHMS = {"ln_radius": "radius_m", "ln_mass": "mass_kg", "ln_albedo": "albedo"}
REMOVED = {
    "duty": "off duty",
    "twilight": "by day or in twilight",
    "altitude": "too low above the horizon",
    "sun": "too near the Sun",
    "earth": "too near the Earth's limb",
    "moon": "too near the Moon",
    "faint": "too faint",
    "magnitude": "too faint",
    "limiting_magnitude": "too faint",
    "occulted": "behind the Earth",
}
REASON = {  # why an estimator that did not converge has no answer
    "iteration_limit": "the fit did not converge within its iterations",
    "not_observable": "the measurements and priors do not determine every estimated quantity",
    "diverged": "the fit diverged",
}


def number(value: float, digits: int = 3) -> str:
    """A number with `digits` significant digits; whole numbers keep all of theirs up to 99 999."""
    if value == 0.0:
        return "0"
    size = abs(value)
    exponent = math.floor(math.log10(float(f"{size:.{digits - 1}e}")))
    sign = MINUS if value < 0 else ""
    if -3 <= exponent < 5:
        text = f"{size:.{max(0, digits - 1 - exponent)}f}"
        whole, dot, part = text.partition(".")
        if len(whole) > 4:
            whole = f"{int(whole):,}".replace(",", THIN)
        return sign + whole + dot + part
    mantissa = f"{size / 10.0**exponent:.{digits - 1}f}"
    return f"{sign}{mantissa}{NBSP}{TIMES}{NBSP}10{str(exponent).translate(SUPERSCRIPT)}"


def signed(value: float, digits: int = 3) -> str:
    """A number with its sign, whichever it is."""
    return ("+" if value > 0.0 else "") + number(value, digits)


def scale_of(value: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which a value of a file's unit reads best."""
    for least, factor, text in LADDER.get(unit, ()):
        if abs(value) >= least:
            return factor, text
    return 1.0, UNIT_TEXT.get(unit, unit.replace("_", "/"))


def finite(value: object) -> TypeGuard[float]:
    """True for a number that can be printed."""
    return isinstance(value, int | float) and math.isfinite(value)


def quantity(value: float | None, unit: str = "", digits: int = 3) -> Markup:
    """The rounded value with its unit, carrying the exact one in the element: `81.8 km` is 81.77207 km inside."""
    if value is None or not math.isfinite(value):
        return Markup('<span class="none" title="no value">{}</span>').format(DASH)
    factor, text = scale_of(value, unit)
    shown = number(value * factor, digits) + ("" if not text else text if text == "°" else NBSP + text)
    return Markup('<data value="{}" data-unit="{}">{}</data>').format(repr(float(value)), unit, shown)


def series(values: Sequence[float], unit: str, between: str = ", ", like: float | None = None) -> Markup:
    """Values in one unit, `0.769, 1.07 km`, each carrying its exact value; the unit fits `like`, or the largest."""
    if not values or not all(finite(v) for v in values):
        return quantity(None)
    factor, text = scale_of(max(abs(v) for v in values) if like is None else like, unit)
    parts = [
        Markup('<data value="{}" data-unit="{}">{}</data>').format(repr(float(v)), unit, number(v * factor))
        for v in values
    ]
    return Markup('<span class="nowrap">{}{}</span>').format(
        Markup(between).join(parts), f"{NBSP}{text}" if text else ""
    )


def product(values: Sequence[float], unit: str, like: float | None = None) -> Markup:
    """Semi-axes, `50.4 × 8.32 km`."""
    return series(values, unit, f" {TIMES} ", like)


def matched_digits(value: float, sigma: float | None) -> int:
    """Significant digits that carry a value to the second digit of its sigma, 3 to 9."""
    if not value or not sigma or not (math.isfinite(value) and math.isfinite(sigma)):
        return 3
    return min(9, max(3, math.floor(math.log10(abs(value))) - math.floor(math.log10(sigma)) + 2))


def with_sigma(value: float, sigma: float, unit: str) -> Markup:
    """`38 006.5 ± 1.0 km`: both in one unit, the value to the second digit of its sigma."""
    factor, text = scale_of(value, unit)
    return Markup('<span class="nowrap"><data value="{}" data-unit="{}">{}</data> ± <data value="{}" '
        'data-unit="{}">{}</data>{}</span>').format(
        repr(float(value)), unit, number(value * factor, matched_digits(value, sigma)),
        repr(float(sigma)), unit, number(sigma * factor), "" if not text else text if text == "°" else NBSP + text,
    )  # fmt: skip


def percent(share: float) -> Markup:
    """A variance share: `62 %`, `0.4 %`, `< 0.1 %`."""
    if not math.isfinite(share):
        return quantity(None)
    value = 100.0 * share
    if 0 < value < 0.1:
        text = f"<{NBSP}0.1"
    elif value < 9.95:
        text = f"{value:.1f}"
    else:
        text = f"{value:.0f}"
    return Markup('<data value="{}" data-unit="share">{}</data>').format(repr(float(share)), f"{text}{NBSP}%")


def join(parts: Iterable[str | Markup], last: str = "and") -> Markup:
    """`a`, `a and b`, `a, b and c`."""
    items = [Markup.escape(part) for part in parts]
    if len(items) < 2:
        return items[0] if items else Markup("")
    return Markup("{} {} {}").format(Markup(", ").join(items[:-1]), last, items[-1])


def count(n: int, noun: str) -> str:
    """`1 measurement`, `578 measurements`."""
    return (f"{n:,}".replace(",", THIN) if n > 9999 else str(n)) + NBSP + noun + ("" if n == 1 else "s")


def date(epoch: str) -> Markup:
    """The calendar date of an epoch written by nebosvod, not to be broken at its hyphens."""
    return Markup('<span class="nowrap">{}</span>').format(epoch[:10])


def moment(epoch: str) -> Markup:
    """Date and time to the minute of an epoch written by nebosvod, with its scale."""
    return Markup('<span class="nowrap">{} {} {}</span>').format(epoch[:10], epoch[11:16], epoch.rpartition(" ")[2])


def plane_name(plane: str, body: str | None = None) -> str:
    """The plane of a prediction by its full name, with the body it is centred on."""
    name = PLANES[plane].words if plane in PLANES else plane.replace("_", " ")
    return f"{body.capitalize()} {name}" if body else name


def axis_names(plane: str, size: int) -> tuple[str, ...]:
    """Names of a prediction's components."""
    names = PLANES[plane].symbols if plane in PLANES else ()
    return names if len(names) == size else tuple(f"component {i + 1}" for i in range(size))


def parameter_name(key: str) -> tuple[str, str]:
    """Name and unit of an estimated parameter from its key."""
    if key in PARAMETERS:
        return PARAMETERS[key]
    for tail, unit in (
        ("_arcsec", "arcsec"),
        ("_arcsec_d", "arcsec/d"),
        ("_rad", "rad"),
        ("_km_s", "km/s"),
        ("_km", "km"),
        ("_s", "s"),
    ):
        if key.endswith(tail):
            return key.removesuffix(tail).replace("_", " "), unit
    return key, ""
