"""How much an impact matters: energy, the Palermo scale, and the Torino scale.

Diameter from H with the mean albedo of near-Earth objects, mass with a mean density, as the impact lists do.
"""

from dataclasses import dataclass

import numpy as np

DIAMETER_KM_AT_H0 = 1329.0
ALBEDO = 0.154
DENSITY_KG_M3 = 2600.0
JOULE_PER_MT = 4.184e15
BACKGROUND_PER_YEAR = 0.03  # impacts of an energy of 1 Mt and more
TORINO_YEARS = 100.0
REGIONAL_MT, GLOBAL_MT = 100.0, 1e5
CLOSE, CERTAIN = 0.01, 0.99  # probabilities
SLANTS = (-8.0, -2.0, 4.0)  # 2 log E + 3 log P, at 1 % with 0.1, 100 and 1e5 Mt


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """How large and dense the object is taken to be, and where that is from."""

    diameter_km: float
    density_kg_m3: float
    said: str

    @classmethod
    def of(cls, H: float | None, diameter: float | None = None, density_kg_m3: float | None = None) -> "Size | None":
        """From what is known; None without a diameter and a magnitude."""
        dense = DENSITY_KG_M3 if density_kg_m3 is None else density_kg_m3
        if diameter is not None:
            return cls(diameter_km=diameter, density_kg_m3=dense, said="given")
        if H is None:
            return None
        said = f"H {H:g} with albedo {ALBEDO}"
        return cls(diameter_km=diameter_km(H), density_kg_m3=dense, said=said)


def diameter_km(H: float, albedo: float = ALBEDO) -> float:
    """Diameter by the absolute magnitude."""
    return float(DIAMETER_KM_AT_H0 / np.sqrt(albedo) * 10.0 ** (-0.2 * H))


def energy_mt(diameter: float, speed_km_s: float, density_kg_m3: float = DENSITY_KG_M3) -> float:
    """Kinetic energy of a sphere, Mt of TNT."""
    mass_kg = density_kg_m3 * np.pi / 6.0 * (1e3 * diameter) ** 3
    return float(0.5 * mass_kg * (1e3 * speed_km_s) ** 2 / JOULE_PER_MT)


def palermo(probability: float, energy: float, years: float) -> float | None:
    """Palermo scale: log10 of the risk over that of all other impacts of the same energy until then.

    Parameters
    ----------
    energy : Mt of TNT.
    years : until the impact.

    References
    ----------
    Chesley, Chodas, Milani, Valsecchi, Yeomans 2002, Icarus 159, 423, equations 1 to 3.
    """
    if probability <= 0.0 or energy <= 0.0 or years <= 0.0:
        return None
    return float(np.log10(probability / (BACKGROUND_PER_YEAR * energy**-0.8 * years)))


def cumulative(values: list[float]) -> float | None:
    """Palermo scale of several impacts together."""
    return float(np.log10(np.sum(10.0 ** np.array(values)))) if values else None


def torino(probability: float, energy: float, years: float) -> int | None:
    """Torino scale, 0 to 10; None more than 100 years ahead.

    Parameters
    ----------
    energy : Mt of TNT.

    Notes
    -----
    The scale is a diagram of log P and log E without equations in its papers. Its edges as others have read them: P of
    1 % and 99 %, E of 1, 100 and 1e5 Mt, and three parallel lines (log E - k)/3 + (log P + 2)/2 = 0 that pass P = 1 %
    at 0.1, 100 and 1e5 Mt and part 0|1, 1|2 and, below and above 1 %, 2|6 and 4|5.

    References
    ----------
    Binzel 2000, Planetary and Space Science 48, 297; Morrison, Chapman, Steel, Binzel 2004, in Mitigation of Hazardous
    Comets and Asteroids, 353: the diagram. Wikipedia, "Torino scale", and PerezHz/NEOs.jl (`torinoscale`): the lines.
    """
    if years > TORINO_YEARS:
        return None
    if energy < 1.0 or probability <= 0.0:
        return 0
    slant = 2.0 * np.log10(energy) + 3.0 * np.log10(probability)
    if probability >= CERTAIN:
        return 8 if energy < REGIONAL_MT else 9 if energy < GLOBAL_MT else 10
    if probability < CLOSE:
        return int(np.searchsorted(SLANTS, slant, side="right")) if slant < SLANTS[2] else 6
    if energy < REGIONAL_MT:
        return 3
    if energy < GLOBAL_MT:
        return 4 if slant < SLANTS[2] else 5
    return 7
