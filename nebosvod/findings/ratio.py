"""Noise against nuisance at each measurement, and how well telescopes must be known for a wanted ratio.

The ratio is that of powers, tr R over the trace of what the nuisances do to a measurement; its mean over measurements
is a ratio of sums. Two stand side by side: with the nuisances the mission names, by default the dynamic parameters and
the telescope's position as in the source, and with all.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np
import numpy.typing as npt

from nebosvod.estimation import LinearProblem
from nebosvod.estimation.accuracy.budget import critical_sigma, noise_to_nuisance
from nebosvod.mission.request import NuisanceGroup
from nebosvod.scene.point import View
from nebosvod.scene.scene import PlannedScene, Scene
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
LIMITS_DB = (0.0, 20.0, 40.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RatioMeans:
    """Noise against nuisance over some measurements, ratios of sums, dB; infinite where nothing but noise acts.

    Attributes
    ----------
    eta, effective, whitened : of the powers of noise and of the nuisances asked about, three ways; of estimation's
        `NoiseToNuisance`. all_eta, all_effective : with every nuisance.
    sigma_nuisance_arcsec, sigma_equivalent_arcsec : error of a measurement that does as much as those nuisances.
    sigma_z_equivalent_km : error of the telescope's position that does.
    sigma_z_limits_km : by the ratio wanted, dB: how well a position must be known for it, median over the measurements.
    n_below_eta_min : measurements below the ratio that the mission wants.
    """

    eta_db: float
    effective_db: float
    whitened_db: float
    all_eta_db: float
    all_effective_db: float
    sigma_nuisance_arcsec: float
    sigma_equivalent_arcsec: float
    sigma_z_equivalent_km: float
    sigma_z_limits_km: Mapping[float, float]
    n_below_eta_min: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TelescopeRatio:
    """Noise against nuisance of one telescope; critical : smallest, median, largest of its measurements."""

    telescope: str
    means: RatioMeans
    n_observations: int
    critical_min_km: float
    critical_median_km: float
    critical_max_km: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoiseRatio:
    """Noise against nuisance of n measurements.

    Attributes
    ----------
    nuisances : the groups asked about. eta_min_db : the ratio that the mission wants.
    eta_db, critical_km : (n,) the ratio, and the error of a telescope's position that does as much as the noise.
    """

    nuisances: tuple[NuisanceGroup, ...]
    eta_min_db: float
    means: RatioMeans
    eta_db: Array
    critical_km: Array
    by_telescope: tuple[TelescopeRatio, ...]


def ratio(scene: PlannedScene, problem: LinearProblem, view: View) -> tuple[NoiseRatio, dict[str, Array]]:
    """The ratios with their means by telescope, and the arrays of each measurement.

    Parameters
    ----------
    problem, view : of an estimator at the nominal point, so that no ratio depends on what was drawn.

    References
    ----------
    Guo, Ivashkin 2018, KIAM preprint 213, (3.17)-(3.31).
    """
    plan, seen = scene.mission.noise_to_nuisance, view.observation
    found = noise_to_nuisance(problem, _sources(scene, problem, view, plan.nuisances))
    whole = noise_to_nuisance(problem)
    # the critical size is that of a telescope position error even where the mission knows of none
    critical = critical_sigma(np.broadcast_to(problem.truth, (problem.n, 2, 2)), seen.H_z)
    equivalent = np.sqrt(found.nuisance) / np.linalg.norm(seen.H_z, axis=(1, 2))
    limits = sorted({*LIMITS_DB, plan.eta_min})

    def means(mine: Flags) -> RatioMeans:
        """Means of the ratios over some measurements, equivalent errors, and limits of the position error."""
        median = float(np.median(critical[mine]))
        return RatioMeans(
            eta_db=found.mean_db("eta", mine),
            effective_db=found.mean_db("effective", mine),
            whitened_db=found.mean_db("whitened", mine),
            all_eta_db=whole.mean_db("eta", mine),
            all_effective_db=whole.mean_db("effective", mine),
            sigma_nuisance_arcsec=_rms(found.sigma_nuisance[mine] / ARCSEC),
            sigma_equivalent_arcsec=_rms(found.sigma_equivalent[mine] / ARCSEC),
            sigma_z_equivalent_km=_rms(equivalent[mine]),
            sigma_z_limits_km={db: median * 10.0 ** (-db / 20.0) for db in limits},
            n_below_eta_min=int(np.count_nonzero(found.eta_db[mine] < plan.eta_min)),
        )

    def of_telescope(name: str, mine: Flags) -> TelescopeRatio:
        own = critical[mine]
        return TelescopeRatio(
            telescope=name,
            means=means(mine),
            n_observations=int(own.size),
            critical_min_km=float(own.min()),
            critical_median_km=float(np.median(own)),
            critical_max_km=float(own.max()),
        )

    block = NoiseRatio(
        nuisances=plan.nuisances,
        eta_min_db=plan.eta_min,
        means=means(np.ones(seen.t_s.size, dtype=bool)),
        eta_db=found.eta_db,
        critical_km=critical,
        by_telescope=tuple(of_telescope(one.name, seen.telescope_index == k) for k, one in enumerate(seen.telescopes)),
    )
    arrays = {
        "eta_db": found.eta_db,
        "eta_effective_db": found.eta_effective_db,
        "eta_whitened_db": found.eta_whitened_db,
        "eta_all_db": whole.eta_db,
        "sigma_nuisance_arcsec": found.sigma_nuisance / ARCSEC,
        "sigma_equivalent_arcsec": found.sigma_equivalent / ARCSEC,
        "sigma_z_equivalent_km": equivalent,
        "sigma_z_critical_km": critical,
    }
    return block, arrays


def _sources(scene: Scene, problem: LinearProblem, view: View, groups: tuple[NuisanceGroup, ...]) -> list[str]:
    """Names in the problem of the sources of some groups; a prior of dynamic parameters may be joint with the orbit."""
    dynamic = set(view.observation.parameter_names)
    named = [prior.name for prior in problem.priors if "parameters" in groups and dynamic & set(prior.names)]
    return named + [term.name for term in view.terms if _group(scene, term.name) in groups]


def _group(scene: Scene, name: str) -> NuisanceGroup | None:
    """The group of a source; what an error really is counts not beside what it is assumed to be."""
    source = scene.sources.get(name)
    return None if source is None or source.shadows is not None else cast(NuisanceGroup, source.group)


def _rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))
