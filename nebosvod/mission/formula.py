"""Names that a formula of a prediction may have, and the units of osculating elements."""

from collections.abc import Mapping

STATE = ("x", "y", "z", "vx", "vy", "vz")  # heliocentric, ICRF, km and km/s
# as a formula says them -> as the force model does: m, kg, 1, au/d^2
PARAMETERS: Mapping[str, str] = {
    "radius": "radius_m",
    "mass": "mass_kg",
    "albedo": "albedo",
    "thermal_emission": "thermal_emission",
    "A1": "a1_au_d2",
    "A2": "a2_au_d2",
    "A3": "a3_au_d2",
    "H": "H_mag",
}
CONSTANTS = ("gm_sun", "gm_earth", "au")  # km^3/s^2, km
ENERGY = "(vx^2 + vy^2 + vz^2) / 2 - gm_sun / hypot(x, y, z)"  # specific, km^2/s^2
# osculating elements, heliocentric, ecliptic of J2000 -> unit as in a key
ELEMENTS: Mapping[str, str] = {
    "a": "au", "e": "1", "q": "au", "Q": "au", "i": "deg", "node": "deg", "peri": "deg", "M": "deg", "tp": "d",
    "period": "d", "n": "deg_d",
}  # fmt: skip


def formula_names() -> list[str]:
    """Every name that a formula may have."""
    return [*STATE, *(f"earth.{name}" for name in STATE), *PARAMETERS, *CONSTANTS]
