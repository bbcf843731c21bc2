"""Answers: what they show, their figures against the numbers of the summary, tables, files."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from astropy import units as u
from astropy.table import QTable
from astropy.time import Time
from matplotlib.collections import PathCollection
from matplotlib.dates import date2num
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch

import nebosvod
from nebosvod.errors import InputError, OutputError
from nebosvod.report.kit.standing import PageFigure

APOPHIS = """
schema_version: 1
name: tab
reference_epoch: 2029-03-01T00:00:00 TDB
object:
  name: (99942) Apophis
  orbit: {kind: cometary, frame: ecliptic_j2000, epoch: 2459215.5 JD TDB, e: 0.1915216893501022,
          q: 0.7458270478466523 au, tp: 2459101.039422462638 JD TDB, node: 204.0389272089208 deg,
          peri: 126.6520518368553 deg, i: 3.336751320066756 deg}
telescopes:
  - {name: NEB, orbit: {kind: geostationary, longitude: 0 deg}, noise: {sigma: 0.1 arcsec},
     bias: {sigma: 0.05 arcsec, treatment: considered}}
schedule: [{start: 2029-03-01T00:00:00 TDB, end: 2029-04-08T00:00:00 TDB, cadence: 1 d}]
predictions:
  - {name: encounter, plane: b_plane, near: 2029-04-13T21:46:00 TDB}
  - {name: distance, plane: perigee_distance, near: 2029-04-13T21:46:00 TDB}
"""


@pytest.fixture(scope="module")
def apophis(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("mission") / "tab.yaml"
    path.write_text(APOPHIS, "utf-8")
    return nebosvod.run(path)


def points_of(line: Line2D) -> npt.NDArray[np.float64]:
    return np.asarray(line.get_xydata(), dtype=np.float64)


def corners_of(patch: Patch) -> npt.NDArray[np.float64]:
    return np.asarray(patch.get_path().vertices, dtype=np.float64)


def test_it_shows_itself_in_one_line_and_in_a_notebook(apophis: Any) -> None:
    """A Result once printed its whole summary, 196 000 characters."""
    assert len(repr(apophis)) < 400
    assert repr(apophis).startswith("<Result: tab. Earth b-plane on 2029-04-13: ")
    page = apophis._repr_html_()
    assert apophis.headline in page.replace("&#x27;", "'")
    assert "encounter (Earth b-plane), 1σ" in page
    assert 'alt="encounter: Earth b-plane' in page
    assert page.count("data:image/png;base64,") == 1


def test_the_target_plane_is_drawn_in_the_values_of_the_summary(apophis: Any) -> None:
    """Axes in km: the nominal orbit at its place, the ellipse as wide as its covariance says."""
    figure = apophis.plot.target_plane("encounter")
    assert isinstance(figure, Figure)
    row = next(p for p in apophis.summary["predictions"] if p["name"] == "encounter")
    axes = figure.axes[0]
    factor = {"ξ, km": 1.0, "ξ, 10³ km": 1e-3}[axes.get_xlabel()]
    crosses = [line for line in axes.get_lines() if line.get_marker() == "+"]
    assert any(np.allclose(points_of(line)[0], factor * np.array(row["mean_km"]), rtol=1e-9) for line in crosses)
    ellipse = apophis.plot.ellipse("encounter").axes[0]
    reach = max(float(np.ptp(corners_of(p)[:, 0])) for p in ellipse.patches if isinstance(p, PathPatch))
    assert reach == pytest.approx(2.0 * 3.0 * row["sigma_km"][0], rel=2e-3)


def test_the_budget_is_drawn_as_long_as_its_shares(apophis: Any) -> None:
    shares = {row["source"]: 100.0 * row["share_total"] for row in apophis.summary["predictions"][0]["budget"]}
    axes = apophis.plot.budget().axes[0]
    rows = [corners_of(patch) for patch in axes.patches]
    upper = sorted(float(np.ptp(one[:, 0])) for one in rows if abs(one[:, 1].mean()) < 0.3)
    assert upper == pytest.approx(sorted(shares.values()), abs=0.01)
    assert axes.get_yticklabels()[0].get_text() == "encounter"


def test_the_geometry_has_the_earth_one_unit_from_the_sun(apophis: Any) -> None:
    """Within the eccentricity of its orbit."""
    axes = apophis.plot.geometry().axes[0]
    assert axes.get_ylabel().endswith("au")
    paths = [one[np.isfinite(one).all(axis=1)] for line in axes.get_lines() if len(one := points_of(line)) > 20]
    assert any(np.all(np.abs(np.hypot(*one.T) - 1.0) < 0.018) for one in paths)


def test_the_timeline_has_a_tick_for_each_exposure_at_its_date(apophis: Any) -> None:
    axes = apophis.plot.timeline().axes[0]
    ticks = np.unique(np.concatenate([points_of(line)[:, 0] for line in axes.get_lines()]))
    ticks = ticks[np.isfinite(ticks)]
    wanted = date2num(apophis.tables["visibility"]["epoch_tdb"].datetime)  # type: ignore[no-untyped-call]
    assert all(np.abs(ticks - one).min() < 1e-3 for one in wanted)


def test_every_figure_is_a_figure_or_says_what_is_missing(apophis: Any) -> None:
    made = apophis.plot.every()
    assert set(made) >= {"budget", "target_plane", "geometry", "timeline", "residuals", "remedies", "ellipse"}
    assert all(isinstance(one, PageFigure) and one.label and one.png().startswith(b"\x89PNG") for one in made.values())
    with pytest.raises(InputError, match="has no prediction of an entry"):
        apophis.plot.ground()
    with pytest.raises(InputError, match=r"has no prediction 'fall' \(predictions: encounter \(b_plane\)"):
        apophis.plot.target_plane("fall")


def test_tables_are_of_astropy_with_units_and_moments(apophis: Any) -> None:
    table = apophis.tables["measurements"]
    assert isinstance(table, QTable)
    after = (table["epoch_tdb"] - Time("2029-03-01T00:00:00", scale="tdb")).to(u.s)
    assert np.abs(after - table["t"]).max() < 1.0 * u.ms
    budget = apophis.tables["budget"]
    total = np.sqrt((budget["sigma_position_km"] ** 2).sum())
    assert total.to_value("km") == pytest.approx(apophis.summary["estimators"][0]["sigma_position_km"], rel=1e-9)
    predictions = apophis.tables["predictions"]
    assert predictions["semi_axes"].unit == u.km
    assert predictions["semi_axes"].shape == (2, 2)
    with pytest.raises(KeyError, match="there are: measurements"):
        apophis.tables["masurements"]


def test_the_typed_summary_says_what_the_summary_says(apophis: Any) -> None:
    typed = apophis.typed
    estimate = typed.estimates[0]
    assert np.sqrt(np.trace(estimate.covariance[:3, :3])) == pytest.approx(estimate.sigma_position.to_value("km"))
    encounter = typed.prediction("encounter")
    assert np.sqrt(np.linalg.eigvalsh(encounter.covariance.to_value("km2"))[::-1]) == pytest.approx(
        encounter.semi_axes.to_value("km"), rel=1e-6
    )
    assert sum(share.share for share in encounter.budget) == pytest.approx(1.0)
    assert abs(encounter.epoch - Time("2029-04-13T21:46:00", scale="tdb")) < 2.0 * u.min  # as JPL says
    assert typed.prediction("distance").semi_axes.shape == (1,)
    with pytest.raises(KeyError, match="there are: encounter, distance"):
        typed.prediction("fall")


def test_it_is_saved_as_the_command_would_and_read_back(apophis: Any, tmp_path: Path) -> None:
    folder = apophis.save(tmp_path / "kept")
    assert json.loads((folder / "summary.json").read_text("utf-8")) == apophis.summary
    assert (folder / "report.html").read_text("utf-8") == apophis.report().text
    again = nebosvod.Result.load(folder)
    assert repr(again) == repr(apophis)
    assert again.tables["budget"]["share_position"].tolist() == apophis.tables["budget"]["share_position"].tolist()
    with pytest.raises(OutputError, match="exists already"):
        apophis.save(folder)
    apophis.save(folder, overwrite=True)
    page = apophis.report(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text("utf-8") == page.text
    assert "<iframe srcdoc=" in page._repr_html_()
    with pytest.raises(InputError, match=r"is the folder of a run; read it by nebosvod.Result.load"):
        nebosvod.Risk.load(folder)


def test_a_mission_shows_itself_and_draws_before_it_is_run() -> None:
    mission = nebosvod.load_mission("minimal")
    assert repr(mission).startswith("<Mission minimal: object Example, ")
    assert "62 exposures" in mission._repr_html_()
    axes = mission.plot.timeline().axes[0]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["ahead", "behind"]
    assert mission.plot.geometry().axes[0].get_ylabel().endswith("au")


def test_marks_of_a_figure_are_marks_of_matplotlib(apophis: Any) -> None:
    """On the page they are strokes; here they keep their size whatever the limits."""
    lines = apophis.plot.residuals().axes[0].get_lines()
    assert any(line.get_marker() == "s" and len(line.get_xdata()) == 39 for line in lines)
    assert not [one for one in apophis.plot.residuals().axes[0].collections if isinstance(one, PathCollection)]
