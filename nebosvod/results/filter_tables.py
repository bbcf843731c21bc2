"""The history of a filter in a run folder: arrays, a table for spreadsheets, and how its innovations look."""

from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.engine.filtering import Filtered
from nebosvod.engine.fitting import Fit
from nebosvod.mission.slugs import array_name
from nebosvod.results.result import Table
from nebosvod.results.run_summary import parameter_unit
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.scene.scene import Scene
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
Arrays = dict[str, npt.NDArray[Any]]


def filter_arrays(scene: Scene, one: Fit) -> Arrays:
    """Beliefs and innovations of one estimator after each measurement; empty where it keeps none.

    What is estimated beside the state is in the units that its names end with, as in summary.json.
    """
    found, name = one.filtered, array_name(one.estimator.name)
    if found is None:
        return {}
    shown, scale = _shown(scene, one, found.names)
    arrays: Arrays = {
        f"filter_t_s_{name}": one.observation.t_s,
        f"filter_state_{name}": found.now.state,
        f"filter_factor_{name}": found.now.factor,
        f"filter_names_{name}": np.array(shown, dtype=np.str_),
        f"filter_beside_{name}": scale * found.now.beside,
        f"filter_beside_sigma_{name}": scale * found.now.sigma,
        f"smoothed_state_{name}": found.smoothed.state,
        f"smoothed_factor_{name}": found.smoothed.factor,
        f"smoothed_beside_{name}": scale * found.smoothed.beside,
        f"smoothed_beside_sigma_{name}": scale * found.smoothed.sigma,
        f"innovation_{name}": found.innovation,
        f"innovation_sigma_{name}": found.innovation_sigma,
        f"nis_{name}": found.nis,
    }
    if found.free_state is not None and found.blend is not None:
        blended, scale = _shown(scene, one, found.blended)
        arrays |= {
            f"bias_free_state_{name}": found.free_state,
            f"blend_{name}": found.blend / scale,
            f"blend_names_{name}": np.array(blended, dtype=np.str_),
        }
    return arrays


def filter_table(scene: Scene, one: Fit, found: Filtered) -> Table:
    """One row for each measurement: what was told, and what is believed after it; units in the names."""
    seen = one.observation
    names = np.array([telescope.name for telescope in seen.telescopes])
    shown, scale = _shown(scene, one, found.names)
    columns: Arrays = {
        "t_s": seen.t_s,
        "telescope": names[seen.telescope_index],
        "innovation_ra_arcsec": found.innovation[:, 0] / ARCSEC,
        "innovation_dec_arcsec": found.innovation[:, 1] / ARCSEC,
        "sigma_innovation_ra_arcsec": found.innovation_sigma[:, 0] / ARCSEC,
        "sigma_innovation_dec_arcsec": found.innovation_sigma[:, 1] / ARCSEC,
        "nis": found.nis,
    }
    for before, beliefs in (("", found.now), ("smoothed_", found.smoothed)):
        sigma = np.linalg.norm(beliefs.factor, axis=2)
        for k, axis in enumerate(STATE_NAMES):
            columns[f"{before}{axis}"] = beliefs.state[:, k]
            columns[f"{before}sigma_{axis}"] = sigma[:, k]
        for k, name in enumerate(shown):
            columns[f"{before}{name}"] = scale[k] * beliefs.beside[:, k]
            columns[f"{before}sigma_{name}"] = scale[k] * beliefs.sigma[:, k]
    if found.free_state is not None:
        for k, axis in enumerate(STATE_NAMES):
            columns[f"bias_free_{axis}"] = found.free_state[:, k]
    return Table(
        columns=columns,
        units={},
        description="A filter after each measurement: innovation (observed minus predicted) with its sigma and "
        "normalised square; heliocentric ICRF state at that time and what is estimated beside it, from the "
        "measurements so far and (smoothed) from all; of a two-stage filter the state as if there were no bias",
    )


def _shown(scene: Scene, one: Fit, names: tuple[str, ...]) -> tuple[list[str], Array]:
    """Names with their units, and the factors from the internal ones."""
    behind = {name: term.name for term in one.seen.terms for name in term.names}
    units = [parameter_unit(scene, behind[name], name) if name in behind else ("", 1.0) for name in names]
    return [f"{name}_{unit}" if unit else name for name, (unit, _) in zip(names, units)], np.array(
        [f for _, f in units]
    )
