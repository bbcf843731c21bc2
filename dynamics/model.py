"""Which forces act, with which values, and by which parameters the trajectory is differentiated."""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered
from nebosvod.dynamics import nongrav as nongrav_module
from nebosvod.dynamics import radiation as radiation_module
from nebosvod.dynamics.constants import (
    ASTEROID_RADIUS_KM,
    AU_D2_KM_S2,
    AU_KM,
    J2000_JD,
    RADIATION_KM3_S2_PER_M2_KG,
    SPEED_OF_LIGHT_KM_S,
)
from nebosvod.dynamics.ephemeris import ASTEROIDS, BEYOND_S, PLANETS, Ephemeris
from nebosvod.dynamics.nongrav import Nongrav
from nebosvod.dynamics.radiation import SHADOW_RANGE_KM, RadiationPressure
from nebosvod.dynamics.window import LARGE_BYTES, Window
from nebosvod.errors import InputError
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Relativity = Literal["none", "sun", "eih"]
RELATIVITY: tuple[Relativity, ...] = ("none", "sun", "eih")
# The J2 field of the Earth is summed inside this distance: cutting at 0.1 au costs 0.18 m in ten years.
OBLATENESS_RANGE_KM = AU_KM
# North pole of the Sun: RA 286.13 deg, Dec 63.87 deg (IAU WGCCRE 2015)
SUN_POLE: Array = np.array(
    [
        np.cos(np.radians(63.87)) * np.cos(np.radians(286.13)),
        np.cos(np.radians(63.87)) * np.sin(np.radians(286.13)),
        np.sin(np.radians(63.87)),
    ]
)
# 2 G S/c^2 of the Sun. S = 1.92e41 kg m^2/s by helioseismology (Iorio 2012, Solar Physics 281, 815, who names
# values some percent apart); G = 6.6743e-11 m^3/(kg s^2), CODATA 2018
LENSE_THIRRING_KM3_S = 2.0 * 6.6743e-11 * 1.92e41 / (SPEED_OF_LIGHT_KM_S * 1e3) ** 2 * 1e-9
# An orbit that starts closer to an asteroid than this many radii is that asteroid's own
OWN_RADII = 10.0
# Columns that the kernel integrates; every parameter is a multiple of one of them
COLUMNS = ("kappa", "a1", "a2", "a3")
MOST_ARCS = 4  # kept at a time


class Physics(NamedTuple):
    """What the kernels need to know about the forces, as bare numbers and arrays."""

    gm: Array  # (bodies,) km^3/s^2 in window order
    c2: float  # speed of light squared, km^2/s^2
    mass_ratio: float  # Earth to Moon
    relativity: int  # place in RELATIVITY
    lense_thirring: float  # 2 G S/c^2 of the Sun, km^3/s; 0 switches the term off
    earth_zonal: Array  # (4,) radius in km, J2, J3, J4
    earth_range: float  # km; 0 switches the zonal harmonics off
    earth_pole_of_date: bool
    sun_oblate: bool
    sun_zonal: Array  # (4,) radius in km, J2, 0, 0
    sun_pole: Array  # (3,) unit vector of the Sun's rotation axis
    century: float  # Julian centuries of the epoch after J2000
    strength: Array  # (4,) of radiation pressure, A1, A2, A3 at 1 au times (1 au)^2, km^3/s^2
    radiation_on: bool
    radiation_unit: float  # km^3/s^2 per m^2/kg
    shadow_range: float  # km from the Earth; 0 switches its shadow off
    nongrav_on: bool
    nongrav_law: Array  # (5,) alpha, r0 in km, m, n, k
    nongrav_unit: float  # km^3/s^2 per au/d^2


class Arc(NamedTuple):
    """What every integration over one arc needs."""

    low_s: float  # from here, after the epoch, to
    high_s: float
    window: Window
    sun: Array  # (6,) barycentric at the epoch
    physics: Physics


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForceModel:
    """The forces on an asteroid and the parameters of the sensitivity zeta.

    Parameters
    ----------
    ephemeris : where the perturbers are.
    asteroids : whether the 16 asteroids attract.
    relativity : "none", "sun" (Schwarzschild term of the Sun) or "eih" (all planets).
    lense_thirring : frame dragging by the rotating Sun, beside any of these.
    earth_oblateness : zonal harmonics of the Earth.
    earth_harmonics : the highest of them, 2, 3 or 4.
    earth_pole : "date" (precession and nutation) or "j2000".
    sun_oblateness : J2 of the Sun.
    radiation : sphere in sunlight, or None.
    earth_shadow : whether the Earth's shadow (umbra and penumbra) interrupts the radiation.
    nongrav : Marsden's A1, A2, A3, or None.
    parameters : names of the columns of zeta in their order, of "radius_m", "mass_kg", "albedo", "thermal_emission"
        (with radiation), "a1_au_d2", "a2_au_d2", "a3_au_d2" (with nongrav).
    excluded : asteroids that do not attract; `propagate` adds the one that the object itself is.

    Raises
    ------
    InputError
        For an unknown or repeated parameter, or one of a force that is off; for an unknown switch, or one of yes
        and no that is neither True nor False.

    Notes
    -----
    The defaults are what is physically there, but the frame dragging, half a metre a year. Two models of JPL differ
    and can be had: solution 220 of Apophis (2024) is relativity="eih", sun_oblateness=False, earth_harmonics=2; the
    small-body code as frozen in its reference state of Apophis is relativity="eih", earth_pole="j2000".
    """

    ephemeris: Ephemeris
    asteroids: bool = True
    relativity: Relativity = "sun"
    lense_thirring: bool = False
    earth_oblateness: bool = True
    earth_harmonics: Literal[2, 3, 4] = 4
    earth_pole: Literal["date", "j2000"] = "date"
    sun_oblateness: bool = True
    radiation: RadiationPressure | None = None
    earth_shadow: bool = True
    nongrav: Nongrav | None = None
    parameters: tuple[str, ...] = ()
    excluded: tuple[str, ...] = ()
    _gm: Array = field(init=False, repr=False)
    _columns: "tuple[npt.NDArray[np.int64], Array]" = field(init=False, repr=False)
    _physics: "dict[tuple[float, float], Physics]" = field(init=False, repr=False, default_factory=dict)
    _arcs: "dict[tuple[float, ...], Arc]" = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", tuple(self.parameters))
        for switch in SWITCHES:
            object.__setattr__(self, switch, _yes_or_no(switch, getattr(self, switch)))
        if self.relativity not in RELATIVITY:
            raise InputError(f'relativity "{self.relativity}" is unknown (allowed: {", ".join(RELATIVITY)})')
        if self.earth_harmonics not in (2, 3, 4):
            raise InputError(f"earth_harmonics {self.earth_harmonics} is unknown (allowed: 2, 3, 4)")
        if self.earth_pole not in ("date", "j2000"):
            raise InputError(f'earth_pole "{self.earth_pole}" is unknown (allowed: date, j2000)')
        strangers = [body for body in self.excluded if body not in ASTEROIDS]
        if strangers:
            raise InputError(f'excluded "{strangers[0]}" is unknown; known: {", ".join(ASTEROIDS)}')
        for name in self.parameters:
            self._check_parameter(name)
        if len(set(self.parameters)) != len(self.parameters):
            raise InputError(f"parameters {self.parameters} repeat a name")
        gm = np.array([self.ephemeris.gm_km3_s2[body] for body in self.bodies])
        object.__setattr__(self, "_gm", gm)
        object.__setattr__(self, "_columns", self._find_columns())

    @property
    def settings(self) -> dict[str, Any]:
        """The switches by name: what can be chosen of the forces that act on every object."""
        return {name: getattr(self, name) for name in SETTINGS}

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of what attracts, in the order of the window."""
        return PLANETS + tuple(a for a in ASTEROIDS if a not in self.excluded) if self.asteroids else PLANETS

    @bordered()
    def window(self, epoch: Epoch, start_s: float, end_s: float) -> Window:
        """The ephemeris of `bodies` over an arc, TDB seconds after `epoch`."""
        window = self.ephemeris.window(epoch, start_s, end_s, asteroids=self.asteroids)
        if not (self.asteroids and self.excluded):
            return window
        rows = [row for row, body in enumerate(PLANETS + ASTEROIDS) if body not in self.excluded]
        return dataclasses.replace(window, layout=window.layout[rows], timing=window.timing[rows])

    @bordered()
    def perturber_at(self, position_km: Array, epoch: Epoch) -> str | None:
        """The attracting asteroid within OWN_RADII radii of a barycentric position (3,), or None: the object itself."""
        for body in self.bodies[len(PLANETS) :]:
            gap = np.linalg.norm(position_km - self.ephemeris.position_km(body, epoch, 0.0)[0])
            if gap < OWN_RADII * ASTEROID_RADIUS_KM[body]:
                return body
        return None

    def _check_parameter(self, name: str) -> None:
        """Refuse an unknown name and a parameter whose force is off."""
        groups = (
            (radiation_module.PARAMETERS, self.radiation, "radiation pressure"),
            (nongrav_module.PARAMETERS, self.nongrav, "non-gravitational acceleration"),
        )
        for names, force, title in groups:
            if name in names:
                if force is None:
                    raise InputError(f"parameter {name} needs {title}, which is off in this force model")
                return
        known = ", ".join(radiation_module.PARAMETERS + nongrav_module.PARAMETERS)
        raise InputError(f'unknown dynamic parameter "{name}"; known: {known}')

    @property
    def values(self) -> Array:
        """Current values of the parameters, shape (m,), in their order."""
        found = []
        for name in self.parameters:
            owner = self.radiation if name in radiation_module.PARAMETERS else self.nongrav
            found.append(float(getattr(owner, name)))
        return np.array(found, dtype=np.float64)

    def with_values(self, values: Mapping[str, float]) -> "ForceModel":
        """The same model with some parameters elsewhere, e.g. {"radius_m": 171.0}; see `RadiationPressure.moved`.

        Raises
        ------
        InputError
            For an unknown parameter, or one of a force that is off; where the force does not exist, naming the value.
        """
        radiation, nongrav = self.radiation, self.nongrav
        for name in values:
            self._check_parameter(name)
        mine = {name: float(v) for name, v in values.items() if name in radiation_module.PARAMETERS}
        theirs = {name: float(v) for name, v in values.items() if name in nongrav_module.PARAMETERS}
        if mine and radiation is not None:
            radiation = _moved(radiation, mine)
        if theirs and nongrav is not None:
            nongrav = dataclasses.replace(nongrav, **theirs)
        return dataclasses.replace(self, radiation=radiation, nongrav=nongrav)

    @bordered()
    def physics(self, epoch: Epoch) -> Physics:
        """The bare numbers for the kernels, with times counted from `epoch`; kept for the next call."""
        key = (epoch.day, epoch.fraction)
        physics = self._physics.get(key)
        if physics is None:
            if len(self._physics) > 16:
                self._physics.clear()
            physics = self._physics[key] = self._physics_at(epoch)
        return physics

    def _physics_at(self, epoch: Epoch) -> Physics:
        scalars = self.ephemeris.scalars
        kappa = 0.0 if self.radiation is None else self.radiation.kappa_m2_kg
        accelerations = (
            (0.0, 0.0, 0.0)
            if self.nongrav is None
            else (self.nongrav.a1_au_d2, self.nongrav.a2_au_d2, self.nongrav.a3_au_d2)
        )
        unit = AU_D2_KM_S2 * AU_KM**2
        zonal = np.array([scalars[name] for name in ("earth_radius_km", "earth_j2", "earth_j3", "earth_j4")])
        zonal[self.earth_harmonics :] = 0.0
        return Physics(
            gm=self._gm,
            c2=float(scalars["speed_of_light_km_s"] ** 2),
            mass_ratio=float(scalars["earth_moon_mass_ratio"]),
            relativity=RELATIVITY.index(self.relativity),
            lense_thirring=LENSE_THIRRING_KM3_S if self.lense_thirring else 0.0,
            earth_zonal=zonal,
            earth_range=float(OBLATENESS_RANGE_KM if self.earth_oblateness else 0.0),
            earth_pole_of_date=self.earth_pole == "date",
            sun_oblate=self.sun_oblateness,
            sun_zonal=np.array([scalars["sun_radius_km"], scalars["sun_j2"], 0.0, 0.0]),
            sun_pole=SUN_POLE.copy(),
            century=float((epoch.day - J2000_JD + epoch.fraction) / 36525.0),
            strength=np.array([RADIATION_KM3_S2_PER_M2_KG * kappa, *(unit * a for a in accelerations)]),
            radiation_on=self.radiation is not None,
            radiation_unit=float(RADIATION_KM3_S2_PER_M2_KG),
            shadow_range=float(SHADOW_RANGE_KM if self.earth_shadow else 0.0),
            nongrav_on=self.nongrav is not None,
            nongrav_law=(Nongrav() if self.nongrav is None else self.nongrav).law,
            nongrav_unit=float(unit),
        )

    def columns(self) -> tuple[npt.NDArray[np.int64], Array]:
        """Columns that the kernel integrates (places in COLUMNS), and the matrix (q, m) from them to the parameters."""
        return self._columns

    def _find_columns(self) -> tuple[npt.NDArray[np.int64], Array]:
        wanted: dict[int, dict[int, float]] = {}
        kappa = {} if self.radiation is None else self.radiation.kappa_partials()
        for place, name in enumerate(self.parameters):
            column = 0 if name in kappa else 1 + nongrav_module.PARAMETERS.index(name)
            wanted.setdefault(column, {})[place] = kappa.get(name, 1.0)
        used = sorted(wanted)
        chain = np.zeros((len(used), len(self.parameters)))
        for row, column in enumerate(used):
            for place, factor in wanted[column].items():
                chain[row, place] = factor
        return np.array(used, dtype=np.int64), chain


# What a mission may choose, and a stored orbit keeps; of these, what is yes or no
SETTINGS = tuple(
    field.name
    for field in dataclasses.fields(ForceModel)
    if field.init and field.name not in ("ephemeris", "radiation", "nongrav", "parameters")
)
SWITCHES = tuple(field.name for field in dataclasses.fields(ForceModel) if field.type is bool)


def arc_of(forces: ForceModel, epoch: Epoch, low_s: float, high_s: float, margin_s: float) -> Arc:
    """The arc from `low_s` to `high_s` with a margin before it, inside the ephemeris and never empty.

    Kept for the next call: a fit integrates over one arc again and again, and finding all this takes longer than
    integrating a month.
    """
    key = (epoch.day, epoch.fraction, low_s, high_s, margin_s)
    arc = forces._arcs.get(key)
    if arc is None:
        for end_s in (low_s, high_s):
            forces.ephemeris.require(epoch, end_s, asteroids=forces.asteroids)
        first, _ = forces.ephemeris.coverage(asteroids=forces.asteroids)
        low = max(low_s - margin_s, first - epoch - BEYOND_S)
        high = high_s if low < high_s else low + 1.0
        arc = Arc(low, high, forces.window(epoch, low, high), forces.ephemeris.sun_at(epoch), forces.physics(epoch))
        if len(forces._arcs) >= MOST_ARCS or arc.window.coefficients.nbytes > LARGE_BYTES:
            forces._arcs.clear()
        forces._arcs[key] = arc
    return arc


def _yes_or_no(name: str, value: object) -> bool:
    """A switch as a bool; a word such as "no", which counts as true in Python, is refused."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    got = f'"{value}"' if isinstance(value, str) else repr(value)
    raise InputError(f"{name} {got} is not allowed (True or False)")


def _moved(sphere: RadiationPressure, values: Mapping[str, float]) -> RadiationPressure:
    """The sphere with some values elsewhere; refused in plain words where kappa = (pi R^2/m) C_R does not exist."""
    wanted = {name: values.get(name, getattr(sphere, name)) for name in radiation_module.PARAMETERS}
    for name, value in wanted.items():
        if not math.isfinite(value):
            raise InputError(f"{name} = {value} is not allowed (a finite number)")
        if value == 0.0 and name in ("radius_m", "mass_kg"):
            raise InputError(f"{name} = {value} is not allowed (any number but 0: radiation pressure is by R^2/m)")
    try:
        moved = sphere.moved(values)
        numbers = [moved.kappa_m2_kg, *moved.kappa_partials().values()]
    except InputError:
        albedo, emission = wanted["albedo"], wanted["thermal_emission"]
        raise InputError(
            f"albedo = {albedo} with thermal_emission = {emission} is not allowed (there is no radiation pressure to "
            "differentiate where C_R = 1 + 4 A/9 + f (1 - A) is 0)"
        ) from None
    except OverflowError:
        numbers = [math.inf]
    if not all(map(math.isfinite, numbers)):
        together = ", ".join(f"{name} = {value}" for name, value in wanted.items())
        raise InputError(f"{together}: not allowed together (radiation pressure by R^2/m is too large a number)")
    return moved
