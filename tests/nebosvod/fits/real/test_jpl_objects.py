"""`nebosvod fit` of real files with its defaults, against JPL's states: chi squared for 6 by the fit's own covariance.

The two orbits rest on the same directions, so that chi squared stays below its expectation of 6, unless the weights or
the corrections of the directions differ. They do:

- 2024 MK passed at 0.002 au; amateurs' clocks were up to 2.4 s late. Times taken as exact: chi^2 161, 18 observations
  rejected. With 1 s for each time (the default) 9, with one clock for each station estimated 7.
- 2024 BX1, an impactor two hours before the end: 16, 5 and 7.
- (119839), 1997 to 2023, nearly all of it against star catalogues that JPL corrects and a file without their names does
  not allow: 23. With a bias of 0.2 arcsec estimated for each station 12.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel, propagate
from nebosvod.estimation import Status
from nebosvod.fits.correction import correct
from nebosvod.fits.engine import OrbitFit
from nebosvod.observation.formats.reading import read_astrometry
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.observation.reduction.observers import telescopes

ARCSEC = np.pi / 648000.0
EXACT = {"clock": "1e-9 s"}
CLOCKS = {"stations": "all", "timing": {"sigma": "1 s", "treatment": "estimated"}}
BIASES = {"stations": "all", "bias": {"sigma": "0.2 arcsec", "treatment": "estimated"}}
FIVE_PERCENT, PER_MILLE = 12.6, 22.5  # chi squared for 6 exceeds these by chance in so many cases


@pytest.fixture(scope="module")
def of_file(data: Path, fitted: Callable[..., OrbitFit], compared: Any, jpl_states: Any) -> Callable[..., Any]:
    """The fit of an 80-column file, and how far it is from JPL."""

    def fit(name: str, **plan: Any) -> tuple[OrbitFit, Any]:
        found = fitted(data / "observations" / f"{name.replace(' ', '')}.obs80", **plan)
        return found, compared(found, jpl_states[name])

    return fit


def rms_arcsec(found: OrbitFit) -> float:
    return float(np.sqrt(np.mean(found.general.residual[found.general.selected] ** 2)) / ARCSEC)


@pytest.mark.parametrize(
    ("name", "rejected", "chi2", "rms"),
    [("2014 AA", 0, 1.0, 0.10), ("2023 DW", 0, 2.0, 0.32), ("2005 TM173", 0, 1.0, 0.47), ("2007 VV7", 2, 1.0, 0.22)],
)
def test_short_arcs_end_within_a_fraction_of_their_sigma(
    of_file: Callable[..., Any], name: str, rejected: int, chi2: float, rms: float
) -> None:
    found, against = of_file(name)
    assert found.verdict.status is Status.CONVERGED
    assert (~found.general.selected).sum() == rejected
    assert against.chi2 < chi2
    assert rms_arcsec(found) == pytest.approx(rms, abs=0.02)


def test_the_gross_outliers_of_2007_vv7_are_both_of_291(of_file: Callable[..., Any]) -> None:
    """By JPL's orbit two records are off by 6.0 and 6.5 arcsec; the next largest residual is 0.8."""
    found, _ = of_file("2007 VV7")
    rejected = ~found.general.selected
    assert set(found.material.astrometry.station[rejected]) == {"291"}
    size = np.linalg.norm(found.general.residual, axis=1) / ARCSEC
    assert size[rejected].min() > 5.5
    assert size[~rejected].max() < 0.9


def test_an_arc_of_an_hour_is_not_observable(of_file: Callable[..., Any]) -> None:
    """2008 EK68: nothing wrong is claimed, and the sigma, 0.006 au of 0.011, is honest."""
    found, against = of_file("2008 EK68")
    assert found.verdict.failed
    assert found.verdict.status is Status.NOT_OBSERVABLE
    assert "how far the object is" in found.verdict.message
    assert against.chi2 < 6.0
    assert against.distance_km < against.sigma_km


def test_the_clocks_of_2024_mk(of_file: Callable[..., Any]) -> None:
    exact, wrong = of_file("2024 MK", **EXACT, shared_errors={"treatment": "told"})
    found, right = of_file("2024 MK")
    assert wrong.chi2 > 100.0
    assert (~exact.general.selected).sum() > 10
    assert right.chi2 < FIVE_PERCENT
    assert right.sigma_km > 3.0 * wrong.sigma_km
    assert (~found.general.selected).sum() == 0


@pytest.mark.long
def test_one_clock_for_each_station_of_2024_mk(of_file: Callable[..., Any]) -> None:
    """The clocks found are those that JPL's orbit shows: 1.5 s at L54, with a sigma of 0.2 s."""
    found, against = of_file("2024 MK", **EXACT, uncertainty=[CLOCKS])
    estimate = found.general.fit.estimate
    late = {name: value for name, value in found.general.fit.point.nuisances.items() if "L54" in name}
    ((name, value),) = late.items()
    assert against.chi2 < FIVE_PERCENT
    assert value > 4.0 * estimate.sigma(name)
    assert value == pytest.approx(1.5, abs=0.5)


@pytest.mark.parametrize(("relativity", "least_km", "most_km"), [("sun", 0.0, 0.005), ("eih", 0.2, 0.35)])
def test_jpl_carries_2024_mk_past_the_earth_with_the_relativity_of_the_sun_alone(
    ephemeris: Ephemeris, jpl_states: Any, relativity: Any, least_km: float, most_km: float
) -> None:
    """Its states before and three months after the approach: 3 m apart, with all planets' terms 266 m."""
    _, (before, start), (after, end) = jpl_states["2024 MK"]
    forces = ForceModel(ephemeris=ephemeris, relativity=relativity)
    reached = propagate(start, before, [after - before], forces).state[0]
    assert least_km <= np.linalg.norm((reached - end)[:3]) < most_km


def test_the_impactor_2024_bx1(of_file: Callable[..., Any]) -> None:
    """328 records of 2.6 hours, two of G18 off by 30 and 36 arcsec (4 s), the last 6,800 km away."""
    found, against = of_file("2024 BX1")
    rejected = ~found.general.selected
    assert found.verdict.status is Status.CONVERGED
    assert set(found.material.astrometry.station[rejected]) == {"G18"}
    assert against.chi2 < FIVE_PERCENT
    assert against.distance_km < against.sigma_km


def test_gross_errors_close_to_the_earth_do_not_stop_the_iteration(
    data: Path, ephemeris: Ephemeris, jpl_states: Any
) -> None:
    """Nothing rejected: residuals of 70 sigma from 17,000 km, where the cost has a round-off of 4e-9 of itself."""
    ((epoch, state),) = jpl_states["2024 BX1"]
    records = read_astrometry(data / "observations" / "2024BX1.obs80").by_time()
    places = telescopes(records, ephemeris).state_km_km_s
    R = np.tile((0.5 * ARCSEC) ** 2 * np.eye(2), (len(records), 1, 1))
    sky = Sky.of(epoch, records.t_s + (records.epoch - epoch), records.psi, R, places, ephemeris)
    found = correct(sky, state, ForceModel(ephemeris=ephemeris, relativity="eih"))
    assert found.status is Status.CONVERGED


@pytest.mark.parametrize(("name", "n"), [("609631", 109), ("742428", 117), ("119839", 587)])
def test_orbits_over_decades(
    data: Path, fitted: Callable[..., OrbitFit], compared: Any, jpl_states: Any, name: str, n: int
) -> None:
    """From 1997 on, without catalogue corrections: within a per mille of chi squared with biases of the stations."""
    path = data / "observations" / "4_random_mpc_ADES_provIDs_no_sats.csv"
    records = read_astrometry(path).of(name)
    plain = compared(fitted(path, records), jpl_states[name])
    found = fitted(path, records, uncertainty=[BIASES])
    biased = compared(found, jpl_states[name])
    assert len(found.material) == n
    assert found.verdict.status is Status.CONVERGED
    assert plain.chi2 < 30.0
    assert biased.chi2 < PER_MILLE  # 13.8 for 119839; 7.2 with a bias for each night
    assert biased.sigma_km > 1.8 * plain.sigma_km


@pytest.mark.usefixtures("long_ephemeris")
def test_phaethon_of_nine_thousand(data: Path, fitted: Callable[..., OrbitFit]) -> None:
    """Every record read and placed, few rejected."""
    found = fitted(data / "observations" / "phaethon_mpc_full.obs80.gz")
    assert found.verdict.status is Status.CONVERGED
    assert len(found.material) == 9004
    assert (~found.general.selected).mean() < 0.01
    assert rms_arcsec(found) < 0.6


A2_ESTIMATED = {"nongrav": {"A2": {"value": "0 au/d^2", "treatment": "estimated"}}}


@pytest.mark.usefixtures("long_ephemeris")
def test_a2_of_phaethon(data: Path, fitted: Callable[..., OrbitFit], phaethon_of_jpl: Any) -> None:
    """-4.8 +- 2.3 from the 8897 directions since 1990, JPL -4.9 +- 1.4 from 4757 to 2018 (1e-15 au/d^2)."""
    found = fitted(data / "observations" / "phaethon_mpc_full.obs80.gz", object=A2_ESTIMATED)
    value = found.general.fit.point.parameters["a2_au_d2"]
    sigma = found.general.fit.estimate.sigma("a2_au_d2")
    assert abs(value - phaethon_of_jpl.a2_au_d2) < sigma
    assert 1.2e-15 < sigma < 2.5e-15  # 2.3 since 1990; 1.5 while stations with a shared error kept their weight


@pytest.mark.usefixtures("long_ephemeris")
def test_phaethon_by_gaia_and_by_the_rest(
    data: Path, fitted: Callable[..., OrbitFit], state_at: Any, phaethon_of_jpl: Any
) -> None:
    """The state of November 2011: chi^2 5 from Gaia's stars and the first years, 46 from all the other catalogues."""
    path = data / "observations" / "phaethon_mpc_full.obs80.gz"
    records = read_astrometry(path)
    gaia = np.array([name.startswith("Gaia") or name == "ATLAS2" for name in records.catalogue.tolist()])
    early = np.array([text < "1990" for text in records.utc.tolist()])
    chi2 = []
    occulted = records.mode == "OCC"  # sharper than JPL's orbit of 2018
    for rows in ((gaia | early) & ~occulted, ~gaia & ~occulted):
        as_stated = {"shared_errors": {"treatment": "told"}}
        found = fitted(path, records.select(rows), object=A2_ESTIMATED, **as_stated)
        orbit = state_at(found, phaethon_of_jpl.epoch)
        chi2.append(float(np.sum(np.linalg.solve(orbit.S, orbit.state - phaethon_of_jpl.state) ** 2)))
    assert chi2[0] < FIVE_PERCENT
    assert chi2[1] > PER_MILLE
