"""How often reality lies inside the ellipses a fit predicts: arcs of real objects, cut into pieces.

Each object's directions since 1990 are cut into apparitions (gaps of 60 days). Three of them in a row are fitted, and
every later one is predicted. Reality is the mean direction of a later apparition, as observed; its own error is small
and counted in. An ellipse that says 90 % must hold it in 90 % of the cases. Three ways to say how large it is:

- formal: each station's sigma is the scatter of its own residuals, every observation independent of every other: the
  textbook's least squares, reduced chi squared one;
- weighed: as `nebosvod fit` does it: Veres et al. 2017, no more than four observations a night;
- considered: the weights of the first, and a bias of BIAS_ARCSEC of each station, of its own in each apparition (a star
  catalogue is wrong by zones), whose share is added to the covariance of the orbit and of the observed mean.

Gross errors are those of a fit to the whole arc. The predictions from one fit, and overlapping spans, are not
independent: the shares scatter more than their numbers suggest.
Usage: python benchmarks/realism.py [DATA] [--bias 0.2]     DATA: the folder with observations/ and orbits/
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, ForceModel, propagate
from nebosvod.errors import CoverageError, EventError
from nebosvod.estimation import Status
from nebosvod.estimation.accuracy import ellipse
from nebosvod.fits.correction import Correction, correct
from nebosvod.fits.engine import fit_object
from nebosvod.observation import Observation
from nebosvod.observation.formats.reading import read_astrometry
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.pipeline import mission_of
from nebosvod.timescale import SECONDS_PER_DAY

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
ARCSEC = np.pi / 648000.0
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
OBJECTS = {
    "3200": "observations/phaethon_mpc_full.obs80.gz",
    "3666": "observations/03666_Holman.obs80",
    "1862": "orbits/orbfit_1862_Apollo/1862.obs",
    "119839": "observations/4_random_mpc_ADES_provIDs_no_sats.csv",
    "230891": "observations/4_random_mpc_ADES_provIDs_no_sats.csv",
}
FIRST = "1990"
GAP_S = 60.0 * SECONDS_PER_DAY
FITTED = 3  # apparitions in a row
LEAST = 10  # observations that a fit needs
FEW = 5  # residuals of a station that tell its scatter
FLOOR_ARCSEC = 0.05
LEVELS = (0.5, 0.9, 0.99)
WAYS = ("formal", "weighed", "considered")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Arc:
    """A long arc: its sky in the order of time, station and apparition (n,) of each observation, and the best orbit."""

    sky: Sky
    station: npt.NDArray[np.str_]
    apparition: Rows
    state: Array
    forces: ForceModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """One mean direction of a later apparition against its prediction.

    Attributes
    ----------
    error : (2,) observed minus predicted, RA* and Dec, rad.
    covariance : (2, 2) of that by the fit, rad^2.
    after_s : how long after the last fitted observation.
    """

    error: Array
    covariance: Array
    after_s: float

    @property
    def distance(self) -> float:
        """In sigmas of the ellipse."""
        return ellipse.normalized_distance(np.linalg.cholesky(self.covariance), self.error)


def apparitions(t_s: Array) -> Rows:
    """Number of the apparition (n,) of each of these ascending times: a gap of 60 days begins a new one."""
    number: Rows = np.concatenate([[0], np.cumsum(np.diff(t_s) > GAP_S)])
    return number


def scattered(arc: Arc) -> Sky:
    """The sky weighed by the scatter of each station about the best orbit; stations of few keep their weights."""
    trajectory = propagate(arc.state, arc.sky.epoch, arc.sky.span_s, arc.forces)
    v = arc.sky.residual(compute(trajectory, arc.sky.exposures).psi)
    sigma = np.sqrt(np.trace(arc.sky.R, axis1=1, axis2=2) / 2.0)
    for code in np.unique(arc.station):
        mine = arc.station == code
        if mine.sum() >= FEW:
            sigma[mine] = np.sqrt(np.mean(v[mine] ** 2))
    sigma = np.maximum(sigma, FLOOR_ARCSEC * ARCSEC)
    return arc.sky.weighed(sigma[:, None, None] ** 2 * np.eye(2))


def predictions(arc: Arc, sky: Sky, bias_rad: float) -> Iterator[Prediction]:
    """Fit FITTED apparitions at a time, predict every later one; with a bias also its share in both."""
    last = int(arc.apparition.max())
    for first in range(0, last - FITTED + 1, FITTED):
        inside = (arc.apparition >= first) & (arc.apparition < first + FITTED)
        if inside.sum() < LEAST:
            continue
        try:
            found = correct(sky, arc.state, arc.forces, selected=inside)
        except (CoverageError, EventError):
            continue
        if found.status is not Status.CONVERGED:
            continue
        K = considered(arc, sky, found, inside, bias_rad)
        end = float(sky.t_s[inside].max())
        for number in range(first + FITTED, last + 1):
            rows = np.flatnonzero(arc.apparition == number)
            yield against(arc, sky, found.seen, K, rows, bias_rad, end)


def considered(arc: Arc, sky: Sky, found: Correction, inside: Flags, bias_rad: float) -> Array:
    """Covariance (6, 6) of the state: formal, and for each station and apparition K H^T W times a bias of its own.

    x - truth = K sum_i H_i^T R_i^-1 (v_i + b_g(i)): the share of b_g is M_g b_g with M_g = K sum_(i in g) H_i^T R_i^-1.
    """
    if found.S is None:
        raise ValueError("a converged correction has a covariance")
    K = found.S @ found.S.T
    whitened = sky.whitener @ found.seen.H
    pull = np.einsum("nki,nkj->nij", whitened, sky.whitener)
    total = K.copy()
    for rows in groups(arc, np.flatnonzero(inside)):
        M = K @ pull[rows].sum(axis=0)
        total += bias_rad**2 * (M @ M.T)
    return total


def against(arc: Arc, sky: Sky, seen: Observation, K: Array, rows: Rows, bias_rad: float, end: float) -> Prediction:
    """The weighted mean residual of some observations, and the covariance that orbit, noise and biases give it."""
    inverse = np.einsum("nki,nkj->nij", sky.whitener[rows], sky.whitener[rows])
    noise = np.linalg.solve(inverse.sum(axis=0), np.eye(2))
    share = noise @ inverse
    H = np.einsum("nij,njk->ik", share, seen.H[rows])
    covariance = H @ K @ H.T + noise
    place = {int(row): number for number, row in enumerate(rows)}
    for part in groups(arc, rows):
        G = share[[place[int(row)] for row in part]].sum(axis=0)
        covariance += bias_rad**2 * (G @ G.T)
    return Prediction(
        error=np.einsum("nij,nj->i", share, sky.residual(seen.psi)[rows]),
        covariance=covariance,
        after_s=float(np.mean(sky.t_s[rows])) - end,
    )


def groups(arc: Arc, rows: Rows) -> Iterator[Rows]:
    """These observations by station and apparition."""
    keys = np.char.add(arc.station[rows], np.char.add(" ", arc.apparition[rows].astype(str)))
    for key in np.unique(keys):
        yield rows[keys == key]


def shares(distances: Sequence[float]) -> tuple[float, ...]:
    """Which part of the distances (sigmas) lies inside the ellipses of LEVELS."""
    return tuple(float(np.mean(np.array(distances) <= ellipse.level_of(level))) for level in LEVELS)


def arc_of(path: Path, designation: str, ephemeris: Ephemeris) -> Arc:
    """The arc of one object since FIRST, by a fit to all of it, less what that fit rejects."""
    records = read_astrometry(path)
    records = records.of(designation) if len(records.objects) > 1 else records
    records = records.select(np.array([text[:4] >= FIRST for text in records.utc.tolist()]))
    found = fit_object(records, mission_of([str(path)]), ephemeris)
    material, keep = found.material, np.flatnonzero(found.general.selected)
    sky = material.weighed(material.sky(found.epoch), found.lean.correction.seen).select(keep)
    return Arc(
        sky=sky,
        station=material.astrometry.station[keep],
        apparition=apparitions(sky.t_s),
        state=found.lean.correction.state,
        forces=ForceModel(ephemeris=ephemeris),
    )


def compare(arc: Arc, bias_rad: float) -> dict[str, list[Prediction]]:
    """All predictions of one arc, each way."""
    scatter = scattered(arc)
    return {
        "formal": list(predictions(arc, scatter, 0.0)),
        "weighed": list(predictions(arc, arc.sky, 0.0)),
        "considered": list(predictions(arc, scatter, bias_rad)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="?", default=DATA)
    parser.add_argument("--bias", type=float, default=0.2, help="sigma of the bias of a station, arcsec")
    asked = parser.parse_args()
    if not asked.data.is_dir():
        print(f"the observations are not here: {asked.data}")
        return
    ephemeris = Ephemeris.load()
    together: dict[str, list[float]] = {way: [] for way in WAYS}
    print(f"{'object':8} {'n':>5} {'app.':>4} {'pred.':>5} {'error':>7}  " + "".join(f"{way:^28}" for way in WAYS))
    print(f"{'':8} {'':>5} {'':>4} {'':>5} {'arcsec':>7}  " + "  sigma   50 %  90 %  99 %  " * len(WAYS))
    for name, file in OBJECTS.items():
        arc = arc_of(asked.data / file, name, ephemeris)
        found = compare(arc, asked.bias * ARCSEC)
        error = np.median([np.linalg.norm(one.error) for one in found["formal"]]) / ARCSEC
        line = f"{name:8} {len(arc.sky):5d} {arc.apparition[-1] + 1:4d} {len(found['formal']):5d} {error:7.2f}  "
        for way in WAYS:
            distances = [one.distance for one in found[way]]
            together[way] += distances
            sigma = np.median([np.sqrt(np.trace(one.covariance)) for one in found[way]]) / ARCSEC
            line += f"{sigma:7.2f}  " + " ".join(f"{100.0 * share:5.0f}" for share in shares(distances)) + "  "
        print(line, flush=True)
    line = f"{'all':8} {'':>5} {'':>4} {len(together['formal']):5d} {'':>7}  "
    for way in WAYS:
        line += f"{'':7}  " + " ".join(f"{100.0 * share:5.0f}" for share in shares(together[way])) + "  "
    print(line)


if __name__ == "__main__":
    main()
