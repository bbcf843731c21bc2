"""What the sharpest records say by themselves: whom a fit to them alone keeps, and whether their sigmas are true.

Records many times sharper than the others decide the orbit, so they are heard before the crowd is: those that agree
with each other are not thrown out by it, and those that scatter more than they state lose the weight they claim.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc

from nebosvod.dynamics import ForceModel
from nebosvod.estimation import Status
from nebosvod.estimation.accuracy.score import sigmas
from nebosvod.estimation.solvers.rejection import Thresholds
from nebosvod.fits.correction import Knowledge
from nebosvod.fits.selection import Selected, attempted
from nebosvod.fits.shared_errors import SharedError
from nebosvod.observation.measurement.exposures import Sky

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
SHARPER = 0.3  # of the median sigma: records below it are heard by themselves
HEARD = 2  # degrees of freedom, below which they are not heard
SPARE = 4  # below which they do not judge their own sigmas, but may contradict themselves
UNTRUE = 3e-3  # chance of so large a scatter, below which stated sigmas are not believed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sharpest:
    """Flags (n,) of the sharp records that agree with each other, and stations whose sigmas are too small."""

    trusted: Flags
    errors: tuple[SharedError, ...] = ()


def sigma_rad(sky: Sky) -> Array:
    """One standard deviation (n,) for each record."""
    return np.asarray(np.sqrt(np.trace(sky.R, axis1=1, axis2=2) / 2.0), dtype=np.float64)


def sharpest(
    sky: Sky, x: Array, forces: ForceModel, thresholds: Thresholds | None, prior: Knowledge | None,
    station: npt.NDArray[np.str_], asked: Flags,
) -> Sharpest:  # fmt: skip
    """Fit the sharp records alone, from an orbit x (6 + m,); nobody is trusted where that leads nowhere.

    Parameters
    ----------
    station, asked : of the records, as in `Records`.
    """
    nobody = Sharpest(trusted=np.zeros(len(sky), dtype=np.bool_))
    sigma = sigma_rad(sky)
    sharp = sigma < SHARPER * float(np.median(sigma))
    if 2 * int(sharp.sum()) < len(x) + HEARD:
        return nobody
    alone = attempted(sky.select(sharp), x, forces, thresholds, prior)
    every = alone  # the first of its rounds, where it kept all
    if alone is None or not alone.selected.all():
        every = attempted(sky.select(sharp), x, forces, None, prior)
    if alone is None or every is None or not (_carried(alone) and _carried(every)):
        return nobody
    freedom = 2 * int(alone.selected.sum()) - len(x)
    if freedom < SPARE and chdtrc(freedom, alone.correction.cost) < UNTRUE:
        return nobody
    trusted = nobody.trusted.copy()
    trusted[np.flatnonzero(sharp)[alone.selected]] = True
    rows = np.flatnonzero(sharp)
    errors = []
    for code in np.unique(station[sharp & asked]).tolist() if freedom >= SPARE else ():
        mine = station[rows] == code
        one = _scattered(sky, alone, every, mine, rows, code, bool((station == code).sum() == mine.sum()))
        if one is not None:
            errors.append(one)
    return Sharpest(trusted=trusted, errors=tuple(errors))


def _carried(found: Selected) -> bool:
    """Whether records carry an orbit."""
    return found.correction.status is Status.CONVERGED and found.correction.S is not None


def _scatter(sky: Sky, found: Selected, mine: Flags, size: int) -> tuple[float, float]:
    """Chi squared of a station's selected records, and its share of the degrees of freedom."""
    chosen = mine & found.selected
    q = np.einsum("nij,nj->ni", sky.whitener[chosen], found.correction.residual[chosen])
    freedom = 2.0 * float(found.selected.sum()) - size
    return float(np.sum(q**2)), freedom * float(chosen.sum()) / float(found.selected.sum())


def _scattered(
    sky: Sky, alone: Selected, every: Selected, mine: Flags, rows: npt.NDArray[np.int64], code: str, whole: bool
) -> SharedError | None:
    """A station whose records scatter by more than they state, whatever gross errors are among them."""
    part, size = sky.select(rows), len(alone.correction.x)
    kept, freedom = _scatter(part, alone, mine, size)
    if freedom < SPARE / 2 or chdtrc(freedom, kept) > UNTRUE:
        return None
    chi2, freedom = _scatter(part, every, mine, size)
    times = float(np.sqrt(chi2 / freedom))
    own = np.diagonal(sky.R[rows[mine]], axis1=1, axis2=2)
    return SharedError(
        station=code,
        rows=rows[mine],
        span_s=(float(part.t_s[mine].min()), float(part.t_s[mine].max())),
        whole=whole,
        kind="scatter",
        significance={"scatter": sigmas(chi2, freedom)},
        estimate=(times,),
        sigma=(times / float(np.sqrt(2.0 * freedom)),),
        tried=1,
        merit=chi2 - freedom,
        size_rad=np.sqrt(max(times**2 - 1.0, 0.0) * own.mean(axis=0)),
        worth=float(np.sqrt(own.mean())),
    )
