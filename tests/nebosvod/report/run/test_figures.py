"""Figures and wording: geometry of the drawing, axes, numbers as text."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nebosvod.report.kit import scale, wording
from nebosvod.report.kit.outline import outline
from nebosvod.report.run import diagnosis, ellipses, encounters, figures, geometry, page, viewing
from nebosvod.results.folder import RunFolder, read_folder
from nebosvod.timescale import Epoch

K = np.array([[4.0, 1.5], [1.5, 1.0]])
EPOCH = Epoch.parse("2028-11-15T00:00:00 TDB")


@pytest.fixture(scope="module")
def run(run_folder: Path) -> RunFolder:
    return read_folder(run_folder)


@pytest.mark.parametrize("level", [1, 2, 3])
def test_outline_is_the_curve_of_constant_probability(level: int) -> None:
    points = outline(K, level)
    assert np.einsum("ni,ij,nj->n", points, np.linalg.solve(K, np.eye(2)), points) == pytest.approx(level**2, rel=1e-12)


def test_outline_of_a_singular_covariance_is_a_segment() -> None:
    points = outline(np.array([[4.0, 2.0], [2.0, 1.0]]), 1)
    assert points[:, 0] == pytest.approx(2.0 * points[:, 1], abs=1e-7)
    assert np.abs(points[:, 0]).max() == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize(("minor", "along"), [(1.0, False), (0.125, False), (0.02, True)])
def test_an_ellipse_of_16_to_1_looks_like_one_and_a_line_is_drawn_along_its_axes(
    run: RunFolder, minor: float, along: bool
) -> None:
    vectors = np.array([[0.6, -0.8], [0.8, 0.6]])
    covariance = (vectors * np.array([4.0, minor**2])) @ vectors.T
    prediction = {
        **run.predictions("batch")[0],
        "covariance_km2": covariance.tolist(),
        "covariance_formal_km2": (0.25 * covariance).tolist(),
        "semi_axes_km": [2.0, minor],
    }
    drawn = ellipses.ellipse_plate(prediction)
    assert drawn is not None
    assert ("along the long axis, km" in drawn.svg) is along
    assert ("ξ, km" in drawn.svg) is not along
    said = drawn.caption.striptags()
    assert ("Drawn along its own axes" in said) is along
    assert "25 % of the realistic area; in the worst direction the realistic sigma is 2.00" in said


def test_a_target_plane_shows_every_drawn_orbit_by_its_fate_and_a_far_body_not_at_all(run: RunFolder) -> None:
    prediction = {**run.predictions("batch")[0], "capture_radius_km": 13000.0}
    rng = np.random.default_rng(2)
    moved = rng.standard_normal((40, 2)) @ np.linalg.cholesky(np.array(prediction["covariance_km2"])).T
    fates = np.repeat([1.0, 0.0, np.nan], [7, 30, 3])
    moved[-1] = np.nan
    known = replace(run, arrays={**run.arrays, "clones_encounter_km": moved, "hits_encounter": fates})
    (whole,) = encounters.plane_plates(known, prediction)
    assert whole.data[0].text.count(",hit\n") == 7
    assert whole.data[0].text.count(",miss\n") == 30
    assert whole.data[0].text.count(",unknown\n") == 2
    (far,) = encounters.plane_plates(run, {**prediction, "mean_km": [3e6, 4e6]})
    assert "the Earth (a dot at this scale)" in far.svg
    assert encounters.plane_plates(run, {**prediction, "capture_radius_km": None}) == []


def test_geometry_looks_down_the_pole_of_the_ecliptic() -> None:
    tilt = np.radians(84381.448 / 3600)
    pole = np.array([0.0, -np.sin(tilt), np.cos(tilt)])
    ahead = np.array([0.0, np.cos(tilt), np.sin(tilt)])
    assert geometry.ecliptic_au(1.495978707e8 * pole) == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)
    assert geometry.ecliptic_au(1.495978707e8 * ahead) == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)


def test_telescopes_are_drawn_about_the_earth_where_they_cannot_be_told_from_it(run: RunFolder) -> None:
    near = geometry.geometry_plate(run)
    far = geometry.geometry_plate(
        replace(run, arrays={**run.arrays, "telescope_position_km": 0.9 * run.arrays["telescope_position_km"]})
    )
    assert near is not None
    assert far is not None
    assert "NEB-1 and NEB-2 cannot be told from the Earth" in near.caption
    assert "about the Earth" in near.svg
    assert ">NEB-1<" in near.svg
    assert ">NEB-1<" in far.svg
    assert "about the Earth" not in far.svg
    assert "told from the Earth" not in far.caption


def test_a_geometry_names_what_it_shows_and_from_where_it_was_measured(run: RunFolder) -> None:
    first, last = (run.telescopes[int(run.arrays["telescope_index"][k])] for k in (0, -1))
    drawn = geometry.geometry_plate(run)
    assert drawn is not None
    assert "telescopes" in drawn.label
    assert f" from {first} at the first measurement" in drawn.caption
    assert f" from {last} at the last" in drawn.caption
    assert "not drawn" not in drawn.caption
    sites = replace(run, summary={**run.summary, "fit": {}, "predictions": []}, arrays={
        **run.arrays, "telescope_position_km": run.arrays["earth_position_km"],
        "telescope_index": np.zeros_like(run.arrays["telescope_index"])})  # fmt: skip
    bare = geometry.geometry_plate(sites)
    assert bare is not None
    assert "encounter" not in bare.label
    assert f"from station {run.telescopes[0]} at the first" in bare.caption
    assert f"{run.telescopes[1]} measures nothing and is not drawn" in bare.caption


@pytest.mark.parametrize(
    ("asked", "fit", "said"),
    [
        (
            (3, 1),
            False,
            "no bias in tests of 3 telescopes, no pattern in tests of 1 telescope; chance of a false alarm 1",
        ),
        ((4, 0), True, "no bias in tests of 4 stations; no station has enough measurements for a test of patterns; "),
    ],
)
def test_residuals_that_look_like_noise_are_not_said_of_tests_that_were_not_made(
    run: RunFolder, asked: tuple[int, int], fit: bool, said: str
) -> None:
    found = {"findings": [], "bias_tests": [{}] * asked[0], "residual_tests": [{}] * asked[1], "level": 0.01,
             "worst_rhythm": None}  # fmt: skip
    (told,) = diagnosis.sentences(
        replace(run, summary={**run.summary, "diagnosis": found} | ({"fit": {}} if fit else {}))
    )
    assert said in told.replace("\N{NO-BREAK SPACE}", " ")
    assert " 0 " not in told


def test_path_of_a_telescope_is_not_drawn_across_a_gap() -> None:
    x = np.concatenate([np.arange(10.0), np.arange(60.0, 70.0)])
    drawn = geometry._unbroken(np.stack([x, 0 * x], axis=1))
    assert np.flatnonzero(np.isnan(drawn[:, 0])).tolist() == [10]


@pytest.mark.parametrize("days", [0.04, 0.5, 3, 10, 40, 76, 144, 400, 3650, 36500])
def test_a_time_axis_has_a_few_dates_inside_it(days: float) -> None:
    axis = scale.calendar(EPOCH, np.array([0.0, days * 86400.0]))
    places, texts = zip(*axis.ticks)
    assert 1 <= len(places) <= 9
    assert axis.low <= min(places)
    assert max(places) <= axis.high - 0.02 * days
    assert len(set(texts)) == len(texts)


def test_ticks_stand_at_the_dates_they_name() -> None:
    axis = scale.calendar(EPOCH, np.array([0.0, 144 * 86400.0]))
    assert axis.ticks[0] == (pytest.approx(16.0), "2028-12")  # type: ignore[comparison-overlap]


def test_history_hides_what_is_undetermined_and_says_from_when(run: RunFolder) -> None:
    drawn = figures.sigma_over_time(run)
    assert drawn is not None
    said = drawn.caption.striptags()
    true = run.arrays["history_sigma_position_km_filter"]
    first = int(np.argmax(true < figures.UNDETERMINED_KM))
    assert f"after {first + 1} measurements" in said
    assert "Formal and true sigma agree throughout" in said
    formal = run.arrays["history_sigma_formal_position_km_filter"]
    off = figures.sigma_over_time(
        replace(run, arrays={**run.arrays, "history_sigma_formal_position_km_filter": 0.5 * formal})
    )
    assert off is not None
    assert "True over formal sigma is 2.00 at its furthest from 1" in off.caption.striptags()


def test_residual_caption_counts_what_is_drawn(run: RunFolder) -> None:
    arrays = {**run.arrays, "residual_after_batch": np.array(run.arrays["residual_after_batch"])}
    arrays["residual_after_batch"][:] = 0.5 * arrays["sigma_measurement"]
    arrays["residual_after_batch"][3, 1] = 4.0 * arrays["sigma_measurement"][3, 1]
    drawn = figures.residuals(replace(run, arrays=arrays), run.estimators[0])
    assert drawn is not None
    said = drawn.caption.striptags()
    assert "100 % of the residuals lie inside" in said
    assert f"Beyond 3σ: 1 of {2 * len(arrays['epoch_s'])}" in said


def test_many_measurements_do_not_make_a_heavy_page(run: RunFolder) -> None:
    n = 40
    grown = {
        name: np.repeat(run.arrays[name], n, axis=0)
        for name in ("telescope_index", "residual_after_batch", "sigma_measurement", "telescope_position_km", "state")
    }
    grown["epoch_s"] = np.repeat(run.arrays["epoch_s"], n) + np.tile(np.arange(n), len(run.arrays["epoch_s"]))
    big = replace(run, arrays={**run.arrays, **grown})
    drawn = [figures.residuals(big, run.estimators[0]), viewing.viewing(big)]
    assert all(p is not None and len(p.svg) < 600_000 for p in drawn)


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 3, "0"),
        (81.77207, 3, "81.8"),
        (-2.5, 3, "−2.50"),
        (0.00999961, 3, "0.0100"),
        (999.96, 3, "1000"),
        (12345.6, 3, "12\N{NARROW NO-BREAK SPACE}346"),
        (99999.7, 3, "1.00\N{NO-BREAK SPACE}×\N{NO-BREAK SPACE}10⁵"),
        (6.1e10, 3, "6.10\N{NO-BREAK SPACE}×\N{NO-BREAK SPACE}10¹⁰"),
        (-2.9018e-14, 4, "−2.902\N{NO-BREAK SPACE}×\N{NO-BREAK SPACE}10⁻¹⁴"),
    ],
)
def test_numbers_are_written_with_their_significant_digits(value: float, digits: int, text: str) -> None:
    assert wording.number(value, digits) == text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (117.24, "km", "117 km"),
        (0.0124, "km", "12.4 m"),
        (2.0e8, "km", "1.34 au"),
        (0.0176, "m_s", "17.6 mm/s"),
        (0.0435, "arcsec", "43.5 mas"),
        (76.9, "deg", "76.9°"),
        (None, "km", "—"),
        (float("nan"), "km", "—"),
    ],
)
def test_quantities_come_in_the_unit_that_reads_best(value: float | None, unit: str, text: str) -> None:
    assert wording.quantity(value, unit).striptags() == text


def test_prediction_with_its_sigma_is_written_to_the_digits_that_count() -> None:
    said = wording.with_sigma(38006.48759, 1.049, "km").striptags()
    assert said == "38 006.5 ± 1.05 km"


def test_summary_schema_admits_the_run_and_refuses_what_is_not_one(run: RunFolder) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((Path(page.__file__).parents[2] / "results" / "summary.schema.json").read_text("utf-8"))
    check = jsonschema.Draft202012Validator(schema)
    check.check_schema(schema)
    check.validate(run.summary)
    for path, value in (
        (("estimators", 0, "sigma_position_km"), None),
        (("estimators", 0, "status"), "fine"),
        (("estimators", 0, "covariance_km_km_s"), [[1.0]]),
        (("reference_epoch_tdb",), "2028-11-15"),
        (("predictions", 0, "plane"), "b-plane"),
        (("budget", 0, "share_position"), 1.5),
        (("surprise",), 1),
    ):
        broken = json.loads(json.dumps(run.summary))
        target = broken
        for key in path[:-1]:
            target = target[key]
        target[path[-1]] = value
        assert not check.is_valid(broken), path
