"""What the drawn orbits say: elements and sizes with their quantiles, classes, regions of range and range rate."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import AU_KM
from nebosvod.dynamics.frames import R_ecliptic_from_icrf
from nebosvod.first_hour.draws import Draws
from nebosvod.first_hour.grid import HEADLINE, Grid
from nebosvod.first_hour.region import diameter_m, magnitudes_of
from nebosvod.first_hour.tracklet import Tracklet

Array = npt.NDArray[np.float64]
LEVELS = (0.025, 0.16, 0.5, 0.84, 0.975)
REGIONS = (0.68, 0.95)
CLASSES = ("near_earth", "main_belt", "distant", "hyperbolic", "earth_satellite", "other")
NEAR_Q_AU, BELT_AU, DISTANT_AU = 1.3, (2.0, 3.6), 5.5
SATELLITE_KM = 1.5e6  # the Earth's sphere of influence


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Numbers:
    """Of each drawn orbit (m,): range, range rate, elements about the Sun (ecliptic of J2000), H and diameter."""

    range_au: Array
    rate_km_s: Array
    a_au: Array
    e: Array
    i_deg: Array
    q_au: Array
    H: Array | None
    diameter_m: Array | None
    kind: npt.NDArray[np.str_]

    @property
    def quantities(self) -> Mapping[str, Array]:
        """Those that have numbers, by name."""
        names = ("range_au", "rate_km_s", "a_au", "e", "i_deg", "q_au", "H", "diameter_m")
        return {name: values for name in names if (values := getattr(self, name)) is not None}


def numbers(tracklet: Tracklet, draws: Draws) -> Numbers:
    """Elements, sizes and classes of drawn orbits."""
    r, v = draws.states[:, :3], draws.states[:, 3:]
    gm = tracklet.forces.ephemeris.gm_km3_s2["sun"]
    distance = np.linalg.norm(r, axis=1)
    a = 1.0 / (2.0 / distance - np.sum(v * v, axis=1) / gm)
    h = np.cross(r, v)
    e = np.linalg.norm(np.cross(v, h) / gm - r / distance[:, None], axis=1)
    i = np.arccos(np.clip(h @ R_ecliptic_from_icrf[2] / np.linalg.norm(h, axis=1), -1.0, 1.0))
    H = magnitudes_of(tracklet, r)
    a_au, q = a / AU_KM, np.sum(h * h, axis=1) / gm / (1.0 + e) / AU_KM
    return Numbers(
        range_au=np.exp(draws.coordinates[:, 0]), rate_km_s=draws.coordinates[:, 1], a_au=a_au, e=e,
        i_deg=np.degrees(i), q_au=q, H=H, diameter_m=None if H is None else diameter_m(H),
        kind=_kinds(tracklet, draws.states, a_au, e, q),
    )  # fmt: skip


def _kinds(tracklet: Tracklet, states: Array, a: Array, e: Array, q: Array) -> npt.NDArray[np.str_]:
    """The class (m,) of each orbit."""
    ephemeris = tracklet.forces.ephemeris
    now = np.zeros(1)
    earth = (
        ephemeris.state_km_km_s("earth", tracklet.epoch, now) - ephemeris.state_km_km_s("sun", tracklet.epoch, now)
    )[0]
    away = states - earth
    distance = np.linalg.norm(away[:, :3], axis=1)
    energy = 0.5 * np.sum(away[:, 3:] ** 2, axis=1) - ephemeris.gm_km3_s2["earth"] / distance
    rules = [
        (energy < 0.0) & (distance < SATELLITE_KM), e >= 1.0, q <= NEAR_Q_AU,
        (a > BELT_AU[0]) & (a < BELT_AU[1]), a > DISTANT_AU,
    ]  # fmt: skip
    names = ["earth_satellite", "hyperbolic", "near_earth", "main_belt", "distant"]
    found: npt.NDArray[np.str_] = np.select(rules, names, "other")
    return found


def scores(found: Numbers, draws: Draws, prior: str = HEADLINE) -> dict[str, float]:
    """The share of each class: a score, no probability, unless the prior is that of a population."""
    w = draws.weight(prior)
    return {name: float(w[found.kind == name].sum()) for name in CLASSES}


def quantiles(values: Array, w: Array, levels: tuple[float, ...] = LEVELS) -> list[float]:
    """Quantiles of values (m,) with weights (m,)."""
    order = np.argsort(values)
    share = np.cumsum(w[order]) - 0.5 * w[order]
    return [float(v) for v in np.interp(levels, share, values[order])]


def levels_of(grid: Grid, prior: str = HEADLINE) -> Array:
    """How much of the posterior is denser than each node (m,): the node is inside of the 68 % region where < 0.68."""
    w = grid.weight(prior)
    size = grid.width[grid.line] * np.ptp(grid.share, axis=1) * _lengths(grid)
    density = np.where(size > 0.0, w / np.where(size > 0.0, size, 1.0), 0.0)
    order = np.argsort(-density)
    found = np.empty(len(w))
    found[order] = np.cumsum(w[order]) - w[order]
    return found


def _lengths(grid: Grid) -> Array:
    """Of the interval of range rates of each node's line (m,), km/s."""
    rate, line = grid.nodes.coordinates[:, 1], grid.line
    lowest, highest = np.full(len(grid.lines), np.inf), np.full(len(grid.lines), -np.inf)
    np.minimum.at(lowest, line, rate)
    np.maximum.at(highest, line, rate)
    return np.asarray((highest - lowest)[line])


def boxes(grid: Grid, prior: str = HEADLINE) -> dict[str, dict[str, list[float]]]:
    """The least and largest range and range rate of the regions that hold 68 and 95 %."""
    level = levels_of(grid, prior)
    found = {}
    for share in REGIONS:
        inside = level < share
        x = grid.nodes.coordinates[inside]
        low = grid.low[grid.line[inside]]
        high = low + grid.width[grid.line[inside]]
        found[f"{100 * share:.0f}"] = {
            "range_au": [float(np.exp(low.min())), float(np.exp(high.max()))],
            "rate_km_s": [float(x[:, 1].min()), float(x[:, 1].max())],
        }
    return found
