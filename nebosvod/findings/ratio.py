"""Noise against nuisance at each measurement, and how well telescopes must be known for a wanted ratio.

The ratio is that of powers, tr R over the trace of what the nuisances do to a measurement; its mean over measurements
is a ratio of sums. Two stand side by side: with the nuisances the mission names, by default the dynamic parameters and
the telescope's position as in the source, and with all.
"""

from typing import Any, cast

import numpy as np
import numpy.typing as npt

from nebosvod.estimation import LinearProblem
from nebosvod.estimation.accuracy.budget import NoiseToNuisance, critical_sigma, noise_to_nuisance
from nebosvod.mission.request import NuisanceGroup
from nebosvod.scene.point import View
from nebosvod.scene.scene import Scene
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
LIMITS_DB = (0.0, 20.0, 40.0)


def ratio(scene: Scene, problem: LinearProblem, view: View) -> tuple[dict[str, Any], dict[str, Array]]:
    """The noise-to-nuisance block with its means by telescope, and the ratios at each measurement.

    Parameters
    ----------
    problem, view : of an estimator at the nominal point, so that no ratio depends on what was drawn.
    """
    plan, seen = scene.mission.noise_to_nuisance, view.observation
    found = noise_to_nuisance(problem, _sources(scene, problem, view, plan.nuisances))
    whole = noise_to_nuisance(problem)
    # the critical size is that of a telescope position error even where the mission knows of none
    critical = critical_sigma(np.broadcast_to(problem.truth, (problem.n, 2, 2)), seen.H_z)
    equivalent = np.sqrt(found.nuisance) / np.linalg.norm(seen.H_z, axis=(1, 2))
    limits = sorted({*LIMITS_DB, plan.eta_min})

    def means(mine: Flags) -> dict[str, Any]:
        """Means of the ratios over some measurements, equivalent errors, and limits of the position error."""
        median = float(np.median(critical[mine]))
        return {
            **_means(found, whole, mine),
            "sigma_z_equivalent_km": _rms(equivalent[mine]),
            "sigma_z_limit_km": {f"{db:g}_dB": median * 10.0 ** (-db / 20.0) for db in limits},
            "n_below_eta_min": int(np.count_nonzero(found.eta_db[mine] < plan.eta_min)),
        }

    block = {
        "nuisances": list(plan.nuisances),
        "eta_min_db": plan.eta_min,
        **means(np.ones(seen.t_s.size, dtype=bool)),
        "mean": "ratio of sums over the measurements",
        "eta_db": [_finite(value) for value in found.eta_db],
        "sigma_z_critical_km": [_finite(value) for value in critical],
        "by_telescope": [
            {"telescope": telescope.name, **means(seen.telescope_index == number)}
            | _spread(critical[seen.telescope_index == number])
            for number, telescope in enumerate(seen.telescopes)
        ],
        "limit_statistic": "median over the measurements",
    }
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
    return cast(NuisanceGroup, scene.sources[name].group) if name in scene.sources else None


def _means(found: NoiseToNuisance, whole: NoiseToNuisance, mine: Flags) -> dict[str, Any]:
    """Means of the ratios over some measurements, and the errors of a measurement equivalent to the nuisances."""
    return {
        "eta_db_mean": _finite(found.mean_db("eta", mine)),
        "eta_effective_db_mean": _finite(found.mean_db("effective", mine)),
        "eta_whitened_db_mean": _finite(found.mean_db("whitened", mine)),
        "eta_all_db_mean": _finite(whole.mean_db("eta", mine)),
        "eta_all_effective_db_mean": _finite(whole.mean_db("effective", mine)),
        "sigma_nuisance_arcsec": _rms(found.sigma_nuisance[mine] / ARCSEC),
        "sigma_equivalent_arcsec": _rms(found.sigma_equivalent[mine] / ARCSEC),
    }


def _spread(critical: Array) -> dict[str, Any]:
    return {
        "n_observations": int(critical.size),
        "sigma_z_critical_min_km": float(critical.min()),
        "sigma_z_critical_median_km": float(np.median(critical)),
        "sigma_z_critical_max_km": float(critical.max()),
    }


def _rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _finite(value: float) -> float | None:
    """The number, or null where nothing but noise acts."""
    return float(value) if np.isfinite(value) else None
