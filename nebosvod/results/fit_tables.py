"""Tables and arrays of a fit's run folder."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.estimation.accuracy.formed import formed
from nebosvod.findings.blame import StateShare
from nebosvod.fits.answer import Answer, residuals_by_station
from nebosvod.fits.orbit import ELEMENTS, OrbitAt
from nebosvod.results.fit_summary import station
from nebosvod.results.orbit_arrays import orbit_arrays, response_arrays
from nebosvod.results.result import Table
from nebosvod.results.run_summary import estimator_row
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
Arrays = dict[str, npt.NDArray[Any]]


def all_tables(found: Answer) -> dict[str, Table]:
    """Residuals by record, stations, states at the epochs asked for, the budget."""
    tables = {
        "residuals": residuals(found),
        "stations": _rows([station(one) for one in residuals_by_station(found.fit)], "Residuals by station"),
    }
    orbits = [one for one in (found.amid, found.orbit, *found.further) if one is not None]
    if orbits:
        tables["orbit"] = orbit_table(orbits)
    beside = estimator_row(found.fit.general.scene, found.fit.priors, found.fit.general.fit)["parameters"]
    if beside:
        tables["parameters"] = _rows(
            [{"name": name, **row} for name, row in beside.items()],
            "Numbers beside the state before and after the fit, units in the names; sigma of what is only considered",
        )
    if found.budget:
        tables["budget"] = _rows(
            [_flat_budget(one) for one in found.budget],
            "What each source contributes to the state at the epoch of the fit; squares of the sigmas add up; what the "
            "position sigma would be if its error vanished (a prior: known exactly) or halved and the weights stayed",
        )
    return tables


def _flat_budget(share: StateShare) -> dict[str, Any]:
    """One source of the state's budget as scalars."""
    return {
        "source": share.source,
        "sigma_position_km": share.sigma.position_km,
        "sigma_velocity_m_s": share.sigma.velocity_m_s,
        "share_position": share.share_position,
        "share_velocity": share.share_velocity,
        "sigma_position_km_if_vanished": share.remedies.if_vanished.same_gain.position_km,
        "sigma_position_km_if_halved": share.remedies.if_halved.same_gain.position_km,
    }


def residuals(found: Answer) -> Table:
    """One row for each record, by time: what was observed, what is left, what it weighs, whether it counts."""
    fit = found.fit
    records, general = fit.material.astrometry, fit.general
    v, R = general.residual / ARCSEC, fit.material.total_noise(general.seen) / ARCSEC**2
    sigma = np.sqrt(np.diagonal(R, axis1=1, axis2=2))
    return Table(
        columns={
            "utc": records.utc,
            "t": records.t_s + (records.epoch - fit.epoch),
            "designation": records.designation,
            "station": records.station,
            "ra": np.degrees(records.psi[:, 0]),
            "dec": np.degrees(records.psi[:, 1]),
            "residual_ra": v[:, 0],
            "residual_dec": v[:, 1],
            "sigma_ra": sigma[:, 0],
            "sigma_dec": sigma[:, 1],
            "correlation": R[:, 0, 1] / (sigma[:, 0] * sigma[:, 1]),
            "chi": np.sqrt(general.chi2),
            "selected": general.selected,
            "rule": fit.material.rule,
            "distance": general.seen.distance_km,
            "file": records.path,
            "line": records.line,
        },
        units={
            "t": "s", "ra": "deg", "dec": "deg", "residual_ra": "arcsec", "residual_dec": "arcsec",
            "sigma_ra": "arcsec", "sigma_dec": "arcsec", "distance": "km",
        },
        description="Observed minus computed after the fit, RA times cos Dec and Dec, estimated biases taken out; "
        "sigmas with clock and stated place of the observer; chi by the covariance of each residual; "
        "t in TDB seconds after the epoch of the fit",
    )  # fmt: skip


def orbit_table(orbits: Sequence[OrbitAt]) -> Table:
    """One row for each epoch: state, elements, sigmas, and the covariance of the state row by row."""
    columns: Arrays = {"epoch_tdb": np.array([one.epoch.iso() for one in orbits])}
    for k, name in enumerate(STATE_NAMES):
        columns[name] = np.array([one.state[k] for one in orbits])
        columns[f"sigma_{name}"] = np.array([np.linalg.norm(one.S[k]) for one in orbits])
    elements = [one.cometary() for one in orbits]
    for k, name in enumerate(ELEMENTS):
        columns[name] = np.array([np.nan if found is None else found[0][k] for found in elements])
        columns[f"sigma_{name}"] = np.array(
            [np.nan if found is None else np.linalg.norm(found[1][k]) for found in elements]
        )
    held = [np.array(formed(one.S) or np.full((6, 6), np.nan)) for one in orbits]
    for i in range(6):
        for j in range(i + 1):
            columns[f"covariance_{i}{j}"] = np.array([K[i, j] for K in held])
    return Table(
        columns=columns,
        units={},
        description="Heliocentric ICRF state (km, km/s) and ecliptic J2000 elements with 1 sigma, units in the names; "
        "covariance_ij of the state, lower triangle; nan where double precision does not hold it",
    )


def all_arrays(found: Answer) -> Arrays:
    """Everything in arrays.npz."""
    fit = found.fit
    general = fit.general
    arrays: Arrays = {
        "epoch_s": fit.material.astrometry.t_s + (fit.material.astrometry.epoch - fit.epoch),
        "reference_epoch_jd_tdb": np.array([fit.epoch.day, fit.epoch.fraction]),
        "telescope_index": fit.material.exposures.telescope_index,
        "telescope_names": np.array(fit.material.names),
        "psi": fit.material.observed,
        "residual": general.residual,
        "R": fit.material.exposures.noise(general.seen.rate),
        "R_total": fit.material.total_noise(general.seen),
        "selected": general.selected,
        "chi2": general.chi2,
        "H": general.seen.H,
        "H_z": general.seen.H_z,
        "distance_km": general.seen.distance_km,
        **_places(found),
    }
    estimate = general.fit.estimate
    if estimate.solution is not None:
        arrays |= {"factor_fit": estimate.S_true, "names_fit": np.array(estimate.names)}
        arrays |= orbit_arrays(general.scene.mission, estimate, "fit")
        arrays |= response_arrays(general.scene.mission, general.fit, "fit")
    return arrays


def _places(found: Answer) -> Arrays:
    """Heliocentric ICRF places of the object at emission, and of telescope and Earth at reception, km."""
    scene, seen = found.fit.general.scene, found.fit.general.seen
    sun = scene.ephemeris.position_km("sun", seen.epoch, seen.t_s)
    sent = scene.ephemeris.position_km("sun", seen.epoch, seen.t_s - seen.light_time_s)
    return {
        "object_position_km": seen.target_state[:, :3] - sent,
        "telescope_position_km": seen.telescope_state[:, :3] - sun,
        "earth_position_km": scene.ephemeris.position_km("earth", seen.epoch, seen.t_s) - sun,
    }


def _rows(rows: Sequence[Mapping[str, Any]], description: str) -> Table:
    """A table from rows with the same keys; None becomes nan."""
    columns = {key: np.array([np.nan if row[key] is None else row[key] for row in rows]) for key in rows[0]}
    return Table(columns=columns, units={}, description=description)
