"""Where to look next: the drawn orbits on the sky of telescopes in the hours to come, with contours."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.first_hour.contour import contours
from nebosvod.first_hour.falls import Falls
from nebosvod.first_hour.possible import Possible, of_mean
from nebosvod.first_hour.region import faintness, magnitudes_of
from nebosvod.first_hour.sight import lines, until
from nebosvod.first_hour.tangent import Tangent, angles
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.observation import Telescope
from nebosvod.observation.measurement.direction import angle_between
from nebosvod.observation.measurement.exposures import Exposures
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
SHOWN = 300  # orbits that are put on the sky


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Field:
    """Where one telescope would see the object at one time.

    Attributes
    ----------
    telescope, epoch : who and when.
    psi : (m, 2) RA and Dec of drawn orbits, rad, all of one weight; fewer where some have fallen.
    middle : (2,) their mean direction. sigma_rad : (2,) semi-axes of their spread.
    contours : by share, closed lines (k, 2) RA and Dec, rad, that hold so much of the probability.
    magnitude : median V; None without a magnitude.
    fallen : share of the orbits that have come down before.
    possible : whether the telescope can see the middle.
    """

    telescope: str
    epoch: Epoch
    psi: Array
    middle: Array
    sigma_rad: Array
    contours: dict[str, list[Array]]
    magnitude: float | None
    fallen: float
    possible: Possible


def fields_of(
    tracklet: Tracklet, falls: Falls, telescopes: Sequence[Telescope], t_s: Array, rng: np.random.Generator
) -> list[Field]:
    """The sky of telescopes at times (n,), s after the reference time; a field for each pair in that order."""
    draws, ephemeris = falls.draws, tracklet.forces.ephemeris
    w = draws.weight()
    rows = rng.choice(len(w), SHOWN, p=w)
    flown = until(tracklet, draws.states[rows], falls.t_s[rows], t_s)
    H = magnitudes_of(tracklet, draws.states[rows, :3])
    found = []
    for telescope in telescopes:
        observer = telescope.spacecraft.state_km_km_s(ephemeris, tracklet.epoch, t_s)
        seen = Exposures.at(tracklet.epoch, t_s, observer, ephemeris)
        line, _ = lines(seen, flown)
        for k, t in enumerate(t_s.tolist()):
            alive = np.isfinite(line[:, k]).all(axis=1)
            if alive.any():
                magnitude = None if H is None else _magnitude(H[alive], flown[alive, k, :3], line[alive, k])
                at, velocity = seen.select(np.array([k])), flown[alive, k, 3:]
                sight = of_mean(telescope, at, line[alive, k], velocity, ephemeris, magnitude)
                fallen = float(1.0 - alive.mean())
                found.append(_field(telescope.name, tracklet.epoch + t, line[alive, k], magnitude, fallen, sight))
    return found


def _magnitude(H: Array, place: Array, line: Array) -> float:
    """Median V of orbits with H (m,) at heliocentric places (m, 3) on lines of sight (m, 3)."""
    r, d = np.linalg.norm(place, axis=1), np.linalg.norm(line, axis=1)
    return float(np.median(H + faintness(r, d, angle_between(-place, -line))))


def _field(
    name: str, epoch: Epoch, line: Array, magnitude: float | None, fallen: float, sight: Possible
) -> Field:  # fmt: skip
    """One field from lines of sight (m, 3)."""
    u = line / np.linalg.norm(line, axis=1)[:, None]
    tangent = Tangent.about(u)
    plane = tangent.onto(u)
    away = (plane - plane.mean(axis=0)).T / np.sqrt(len(plane))
    sigma = np.linalg.svd(np.hstack([away, np.zeros((2, 2))]), compute_uv=False)
    drawn = contours(plane)
    around = {share: [angles(tangent.back(edge)) for edge in edges] for share, edges in drawn.items()}
    return Field(
        telescope=name, epoch=epoch, psi=angles(u), middle=angles(tangent.centre[None])[0], sigma_rad=sigma,
        contours=around, magnitude=magnitude, fallen=fallen, possible=sight,
    )  # fmt: skip
