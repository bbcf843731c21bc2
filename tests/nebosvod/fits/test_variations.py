"""The line of variations by constrained corrections: on each hyperplane nothing fits better, by scipy."""

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import numpy.typing as npt
import pytest
from scipy.optimize import least_squares

import nebosvod
from nebosvod import UncertainOrbit, read_orbit
from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.impact import fly
from nebosvod.ephemerides.observers import observer
from nebosvod.ephemerides.sky import sky
from nebosvod.errors import InputError
from nebosvod.fits.correction import Knowledge
from nebosvod.fits.engine import OrbitFit, fit_object
from nebosvod.fits.uncertain import orbit_of
from nebosvod.fits.variations import Variations
from nebosvod.impacts.string import String
from nebosvod.mission import FitMission
from nebosvod.mission.reading.again import made_from
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.pipeline import objects
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
PDC27 = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "impact" / "2026pdc27.epoch1.psv"
needs_data = pytest.mark.skipif(not PDC27.is_file(), reason="the folder of reference data is not here")
SCHEMA = json.loads((Path(nebosvod.__file__).parent / "results" / "risk.schema.json").read_text("utf-8"))
ARCSEC = np.pi / 648000.0
DIRECTION = np.array([0.6, -0.5, 0.4, 0.3, -0.3, 0.2]) / np.sqrt(0.99)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A folder of a fit, the orbit read from it, and the fit of the same records by hand."""

    folder: Path
    orbit: UncertainOrbit
    fit: OrbitFit

    def residuals(self, u: Array) -> Array:
        """Whitened residuals (2 n,) of an orbit u sigmas aside, flown and seen by itself."""
        there, sky_of = self.fit.found.sky, self.fit.lean.selected
        flight = fly(self.orbit.state + self.orbit.factor @ u, there.epoch, there.span_s, self.fit.general.scene.forces)
        off = there.residual(compute(flight, there.exposures).psi)
        rows: Array = np.einsum("nij,nj->ni", there.whitener, off)[sky_of].ravel()
        return rows

    def least(self, direction: Array, s: float) -> tuple[float, Array]:
        """Least chi squared among orbits s sigmas along a direction, and the orbit, by scipy without our partials."""
        return self._least(np.linalg.svd(direction[None])[2][1:], s * direction)

    @cached_property
    def least_of_all(self) -> float:
        """Chi squared of the best orbit, by scipy."""
        return self._least(np.eye(6), np.zeros(6))[0]

    def _least(self, free: Array, beside: Array) -> tuple[float, Array]:
        found = least_squares(
            lambda w: self.residuals(beside + (w - 1.0) @ free), np.ones(len(free)), diff_step=1e-3,
            xtol=1e-10, ftol=1e-14, gtol=1e-10,
        )  # fmt: skip
        return 2.0 * float(found.cost), beside + (found.x - 1.0) @ free


def fitted(folder: Path, ephemeris: Ephemeris) -> Fitted:
    mission = made_from(folder)
    assert isinstance(mission, FitMission)
    (records,) = objects(mission, split=False)
    return Fitted(folder, read_orbit(folder), fit_object(records, mission, ephemeris))


@pytest.fixture(scope="module")
def short(ephemeris: Ephemeris, tmp_path_factory: pytest.TempPathFactory) -> Fitted:
    """Eight made-up records of two days, seen from the Earth's centre: the region is long and bent."""
    home = tmp_path_factory.mktemp("variations")
    first = Epoch.parse("2023-03-01 UTC")
    state = np.array([-1.512e8, 5.8e7, 2.4e7, -12.0, -26.5, -9.0])
    truth = UncertainOrbit(name="made up", epoch=first, state=state, factor=np.eye(6))
    t_s = np.array([0.0, 1.0, 2.0, 24.0, 25.0, 26.0, 47.0, 48.0]) * 3600.0
    noise = np.random.default_rng(5).standard_normal((len(t_s), 2)) * 0.3 * ARCSEC
    seen = sky(truth, observer("500"), first, t_s, ephemeris).psi
    rows = ["# version=2022", "trkSub|mode|stn|obsTime|ra|dec|rmsRA|rmsDec|astCat"]
    for t, (ra, dec), (x, y) in zip(t_s.tolist(), seen, noise, strict=True):
        at = (first + t).iso("utc", 3).removesuffix("Z").split(" ")[0]
        place = f"{np.degrees(ra + x / np.cos(dec)) % 360.0:.8f}|{np.degrees(dec + y):.8f}"
        rows.append(f"MADEUP|CCD|500|{at}Z|{place}|0.3|0.3|Gaia3")
    (home / "made.psv").write_text("\n".join(rows) + "\n", "utf-8")
    assert main(["fit", str(home / "made.psv"), "-o", str(home / "fit")]) == 0
    return fitted(home / "fit", ephemeris)


@pytest.fixture(scope="module")
def line(short: Fitted) -> String:
    return Variations(fit=short.fit, orbit=short.orbit).along(DIRECTION)


def test_chi_squared_along_it_is_the_least_on_each_hyperplane(short: Fitted, line: String) -> None:
    least = short.least_of_all
    assert line.ends[0] < -5.0
    assert line.ends[1] > 5.0
    bent = []
    for k in (4, len(line.sigmas) // 2 - 6, len(line.sigmas) // 2 + 5, -5):
        sigma, u = line.sigmas[k], line.points[k]
        chi2, there = short.least(DIRECTION, float(u @ DIRECTION))
        assert abs(sigma) == pytest.approx(np.sqrt(chi2 - least), rel=1e-5, abs=1e-5)
        assert u == pytest.approx(there, abs=1e-3)
        straight = short.residuals(sigma * DIRECTION)
        bent.append(float(straight @ straight) - chi2)
    assert max(bent) > 10.0, "a straight line leaves what the observations allow"


def test_the_gradient_is_parallel_to_the_weak_direction(short: Fitted, line: String) -> None:
    """The constrained normal equations, by difference quotients; also between the points that were corrected."""
    for sigma in (-4.1, -1.0, 0.6, 3.3):
        u = line.at(np.array([sigma]))[0]
        steps = 1e-3 * np.eye(6)
        J = np.array([(short.residuals(u + h) - short.residuals(u - h)) / 2e-3 for h in steps])
        gradient = J @ short.residuals(u)
        along = float(gradient @ DIRECTION)
        assert abs(along) > 0.3
        assert np.linalg.norm(gradient - along * DIRECTION) < 0.01 * abs(along)
        assert line.sigma_of(u[None])[0] == pytest.approx(sigma, abs=1e-4)


def test_rows_that_hold_the_hyperplane_stand_beside_those_of_a_prior() -> None:
    one, other = Knowledge(U=np.eye(6)[:1], mean=np.full(6, 2.0)), Knowledge(U=np.eye(6)[1:3], mean=np.arange(6.0))
    x = np.array([1.0, 5.0, -1.0, 0.0, 0.0, 0.0])
    assert one.beside(other).rows(x)[:, -1].tolist() == [1.0, -4.0, 3.0]


def test_errors_that_are_not_in_the_weights_leave_it_straight(short: Fitted) -> None:
    """A covariance that considered biases make larger is not that of chi squared."""
    wider = replace(short.orbit, factor=1.1 * short.orbit.factor)
    with pytest.raises(InputError, match="errors that are not in the weights"):
        Variations(fit=short.fit, orbit=wider)


def risk_of(folder: Path, until: str, name: str) -> tuple[dict[str, Any], Any]:
    asked = ["risk", str(folder), "--until", until, "--bodies", "earth", "--draws", "300", "--overwrite"]
    assert main([*asked, "-o", str(folder.parent / name)]) == 0
    summary = json.loads((folder.parent / name / "summary.json").read_text("utf-8"))
    jsonschema.validate(summary, SCHEMA)
    return summary, np.load(folder.parent / name / "arrays.npz")


def test_a_risk_says_which_line_it_has(short: Fitted) -> None:
    summary, arrays = risk_of(short.folder, "2023-06-01", "curved")
    assert summary["line"]["kind"] == "curved"
    assert summary["line"]["why_straight"] is None
    white = np.linalg.solve(short.orbit.factor, arrays["line_deviations"].T).T
    at = int(np.argmin(np.abs(arrays["line_sigmas"] - 4.0)))
    v = short.residuals(white[at])
    assert np.sqrt(v @ v - short.least_of_all) == pytest.approx(arrays["line_sigmas"][at], rel=1e-3)
    records = short.folder.parent / "made.psv"
    records.rename(records.with_suffix(".away"))
    try:
        summary, _ = risk_of(short.folder, "2023-06-01", "straight")
    finally:
        records.with_suffix(".away").rename(records)
    assert summary["line"]["kind"] == "straight"
    assert "made.psv, which is not there" in summary["line"]["why_straight"]


@needs_data
def test_on_a_long_arc_it_is_straight(ephemeris: Ephemeris) -> None:
    """All 52 records of the exercise 2026 PDC27, over three months."""
    mission = FitMission.model_validate(
        {"schema_version": 1, "name": "pdc", "fit": {"observations": [str(PDC27)]}}
    )  # fmt: skip
    (records,) = objects(mission, split=False)
    fit = fit_object(records, mission, ephemeris)
    line = Variations(fit=fit, orbit=orbit_of(fit)).along(DIRECTION)
    near = np.abs(line.sigmas) < 5.1
    assert line.points[near] == pytest.approx(np.outer(line.sigmas[near], DIRECTION), abs=2e-3)
