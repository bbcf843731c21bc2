"""How large the noise of each station really is, by restricted likelihood, and the fit weighed by that.

A weight is a rule's opinion of a station. Where a fit is asked for it (`noise_scale: by_station`), each station's
sigmas get the one factor at which the residuals are likeliest, what the orbit took away from them counted in.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.estimation import Block, LinearProblem, Prior
from nebosvod.estimation.accuracy.variance_components import estimate_components
from nebosvod.estimation.problem.square_root import left_inverse
from nebosvod.fits.correction import Knowledge
from nebosvod.fits.selection import Selected
from nebosvod.observation.measurement.exposures import Sky

Array = npt.NDArray[np.float64]
LEAST = 5  # selected records of a station that has a factor of its own
OTHERS = "other stations"
CLOSE = 0.01  # of a sigma: factors nearer to 1 change nothing
SMALLEST = 0.1  # factor on a sigma, whatever few residuals say


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseFactor:
    """Factor on the sigmas of a station, or of all with few records, its sigma, and the records it is from."""

    station: str
    factor: float
    sigma: float
    records: int


def noise_factors(
    sky: Sky, found: Selected, station: npt.NDArray[np.str_], prior: Knowledge | None
) -> list[NoiseFactor]:
    """The factors of a converged correction, by station.

    Parameters
    ----------
    station : (n,) of every record, rejected ones included.
    """
    rows = np.flatnonzero(found.selected)
    names, which, count = np.unique(station[rows], return_inverse=True, return_counts=True)
    many = count >= LEAST
    place = np.where(many, np.cumsum(many) - 1, many.sum())[which]
    labels = (*names[many].tolist(), *([] if many.all() else [OTHERS]))
    if not labels or found.correction.S is None:
        return []
    H = found.correction.seen.H[rows]
    columns = tuple(str(k) for k in range(H.shape[2]))
    problem = LinearProblem(
        residual=found.correction.residual[rows],
        R=sky.R[rows],
        blocks=(Block(name="orbit", names=columns, H=H),),
        priors=_priors(prior, found.correction.x),
        noise_names=labels,
        noise_label=place,
    )
    told = estimate_components(problem)
    records = np.bincount(place, minlength=len(labels))
    return [
        NoiseFactor(
            station=name,
            factor=float(max(np.sqrt(factor), SMALLEST)),
            sigma=float(0.5 * spread / max(np.sqrt(factor), SMALLEST)),
            records=int(n),
        )
        for name, factor, spread, n in zip(told.names, told.factors, told.sigma, records)
    ]


def by_record(factors: list[NoiseFactor], station: npt.NDArray[np.str_]) -> Array:
    """The factor on the sigma of every record (n,)."""
    of = {one.station: one.factor for one in factors}
    other = of.get(OTHERS, 1.0)
    return np.array([of.get(code, other) for code in station.tolist()])


def _priors(prior: Knowledge | None, x: Array) -> tuple[Prior, ...]:
    """Prior knowledge about the point of the correction, of those columns that it knows wholly."""
    if prior is None:
        return ()
    used = np.flatnonzero(prior.U.any(axis=0))
    U = prior.U[:, used]
    if np.linalg.matrix_rank(U / np.linalg.norm(U, axis=0)) < len(used):
        return ()
    factor = left_inverse(U)
    names = tuple(str(k) for k in used)
    return (Prior(name="prior", names=names, covariance=factor @ factor.T, mean=(prior.mean - x)[used]),)
