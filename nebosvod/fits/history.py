"""How the probability of an impact came: refits of the records cut after each night, each with its risk.

A night is a run of records without a pause of eight hours, a day at most: of a telescope in space a day. Every refit
begins anew, as it would have that night: its own start, selection and weights.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.errors import CoverageError, EventError, GeometryError, InputError
from nebosvod.fits.engine import fit_object
from nebosvod.fits.uncertain import orbit_of
from nebosvod.impacts.approaches import approaches
from nebosvod.impacts.flight import GAP_S
from nebosvod.impacts.risk import WITHIN_AU, risk
from nebosvod.impacts.ways import Way, by_sampling
from nebosvod.mission import FitMission
from nebosvod.observation.formats.records import Astrometry
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.scene.dates import dated
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
Say = Callable[[str], None]
PAUSE_S, LONGEST_S = 8 * 3600.0, 86400.0
MOST_NIGHTS = 100
WAYS_OUT = (CoverageError, EventError, GeometryError, InputError)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Watched:
    """The impact whose probability is followed: on what and when; `until` as of the risk itself."""

    body: str
    epoch: Epoch
    until: Epoch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Night:
    """What was known after one night.

    Attributes
    ----------
    until : its last record. n_observations : so far.
    way : the recommended answer, or the bound of the plain draws; None where no orbit was known, `reason` says why.
    semi_axes_km : of the 1 sigma ellipse in the target plane, where the estimate has that encounter.
    """

    until: Epoch
    n_observations: int
    way: Way | None
    semi_axes_km: tuple[float, float] | None
    reason: str = ""


def nights(t_s: Array) -> Array:
    """Times (k,) of the last record of each night, for records at times (n,)."""
    t = np.sort(t_s)
    ends, begun = [], t[0]
    for now, then in zip(t, [*t[1:], np.inf], strict=True):
        if then - now > PAUSE_S or then - begun > LONGEST_S:
            ends.append(now)
            begun = then
    return np.array(ends)


def history(
    records: Astrometry, mission: FitMission, watched: Watched, ephemeris: Ephemeris, *, draws: int, seed: int = 1,
    say: Say = lambda line: None,
) -> tuple[Night, ...]:  # fmt: skip
    """The probability after each night of the records.

    Parameters
    ----------
    records : of one object. mission : how it is fitted.
    draws : of the plain sampling after each night.

    Raises
    ------
    InputError
        If there are more nights than can be meant.
    """
    records = dated(records, mission)
    ends = nights(records.t_s)
    if len(ends) > MOST_NIGHTS:
        raise InputError(f"--history: the observations are of {len(ends)} nights (allowed {MOST_NIGHTS})")
    found = []
    for k, end in enumerate(ends.tolist()):
        until = records.epoch + end
        count = int(np.count_nonzero(records.t_s <= end))
        say(f"night {k + 1} of {len(ends)}, {until.iso('utc', 0)[:10]}: {count} observations")
        part = records.select(records.t_s <= end)
        found.append(_night(part, mission, watched, ephemeris, until, draws, seed))
    return tuple(found)


def _night(
    records: Astrometry, mission: FitMission, watched: Watched, ephemeris: Ephemeris, until: Epoch, draws: int,
    seed: int,
) -> Night:  # fmt: skip
    """A refit and its risk."""
    night = Night(until=until, n_observations=len(records), way=None, semi_axes_km=None)
    try:
        fit = fit_object(records, mission, ephemeris)
        if fit.general.fit.estimate.solution is None or fit.verdict.failed:
            return replace(night, reason=fit.verdict.message)
        orbit = orbit_of(fit)
        way = _chance(orbit, watched, ephemeris, draws, seed)
        return replace(night, way=way, semi_axes_km=_ellipse(orbit, watched, ephemeris))
    except WAYS_OUT as error:
        return replace(night, reason=str(error))


def _chance(orbit: UncertainOrbit, watched: Watched, ephemeris: Ephemeris, draws: int, seed: int) -> Way:
    """The recommended answer for the impact that is followed; the bound of plain draws where no way finds it."""
    found = risk(orbit, watched.until, ephemeris, bodies=(watched.body,), draws=draws, seed=seed)
    same = [one for one in found.impactors if abs(one.epoch - watched.epoch) < GAP_S]
    if same:
        return min(same, key=lambda one: abs(one.epoch - watched.epoch)).way
    return by_sampling(found.cloud, None)


def _ellipse(orbit: UncertainOrbit, watched: Watched, ephemeris: Ephemeris) -> tuple[float, float] | None:
    """Semi-axes of the 1 sigma ellipse in the target plane, km, where the estimate comes near then."""
    same = [
        one for one in approaches(orbit, orbit.epoch, watched.until, WITHIN_AU, ephemeris).found
        if one.body == watched.body and abs(one.epoch - watched.epoch) < GAP_S and one.ellipse is not None
    ]  # fmt: skip
    ellipse = min(same, key=lambda one: abs(one.epoch - watched.epoch)).ellipse if same else None
    return None if ellipse is None else (float(ellipse.semi_axes[0]), float(ellipse.semi_axes[1]))
