"""What a fit says of its own answer, on made-up records of three stations and on a real arc that leads astray.

The made-up sky: an object 0.16 au away, seen from the ground, with noise of 0.2 arcsec.
"""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import nebosvod.fits.general
from nebosvod.cli import main
from nebosvod.dynamics import ForceModel, propagate
from nebosvod.estimation import Status
from nebosvod.estimation.solvers.rejection import Thresholds
from nebosvod.fits.answer import answer
from nebosvod.fits.ending import verdict
from nebosvod.fits.engine import fit_object
from nebosvod.fits.general import estimate
from nebosvod.mission import load_fit
from nebosvod.observation.formats.reading import read_astrometry
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.direction import offset
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.observation.reduction.observers import telescopes
from nebosvod.results.fit_tables import all_arrays, residuals
from nebosvod.scene.material import gather, prepare
from nebosvod.scene.scene import force_model
from nebosvod.timescale import Epoch

ARCSEC = np.pi / 648000.0
NOISE = 0.2  # arcsec
EPOCH = Epoch.parse("2023-03-01T00:00:00 TDB")
STATE = np.array([-1.62e8, 5.6e7, 2.4e7, -13.0, -26.0, -9.0])
SITES = ("F51", "W94", "568")
DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "observations"
ALL_TIMING = "  uncertainty:\n    - {stations: all, timing: {sigma: 1 s, treatment: estimated}}\n"


def psv(times, psi, rms):
    columns = ("permID", "mode", "stn", "obsTime", "ra", "dec", "rmsRA", "rmsDec", "astCat")
    rows = [
        ("1", "CCD", SITES[k % 3], f"{when}Z", f"{np.degrees(ra):.12f}", f"{np.degrees(dec):.12f}", rms, rms, "UCAC4")
        for k, (when, (ra, dec)) in enumerate(zip(times, psi.tolist()))
    ]
    return "\n".join(["# version=2022", *("|".join(map(str, row)) for row in (columns, *rows))]) + "\n"


@pytest.fixture
def made(ephemeris, tmp_path):
    """A function that writes records of an orbit, with their errors (n, 2) in arcsec added, and settings."""

    def make(more="  clock: 0 s\n", *, n=30, days=15.0, rms=NOISE, state=STATE, error=0.0):
        times = np.datetime64("2023-03-01T00:00:00.000") + (np.linspace(-days / 2.0, days / 2.0, n) * 86400e3).astype(
            "timedelta64[ms]"
        )
        path = tmp_path / "made.psv"
        path.write_text(psv(times, np.ones((n, 2)), rms), "utf-8")
        records = read_astrometry(path)
        t_s = records.t_s + (records.epoch - EPOCH)
        observers = telescopes(records, ephemeris).state_km_km_s
        trajectory = propagate(state, EPOCH, [t_s.min(), t_s.max()], ForceModel(ephemeris=ephemeris))
        R = np.tile(ARCSEC**2 * np.eye(2), (n, 1, 1))
        seen = compute(trajectory, Sky.of(EPOCH, t_s, records.psi, R, observers, ephemeris).exposures)
        noise = NOISE * np.random.default_rng(5).standard_normal((n, 2))
        path.write_text(psv(times, offset(seen.psi, ARCSEC * (noise + error)), rms), "utf-8")
        place, speed = (", ".join(f"{x!r} {u}" for x in v) for v, u in
                        ((state[:3].tolist(), "km"), (state[3:].tolist(), "km/s")))  # fmt: skip
        settings = tmp_path / "made.yaml"
        settings.write_text(
            "schema_version: 1\nname: made\nobject:\n  name: made\n"
            f"  orbit: {{kind: state, frame: icrf, epoch: 2023-03-01 TDB, position: [{place}], velocity: [{speed}]}}\n"
            f"fit:\n  observations: [made.psv]\n{more}",
            "utf-8",
        )
        mission = load_fit(settings)
        return SimpleNamespace(mission=mission, records=gather(mission), path=settings)

    return make


@pytest.fixture
def fit(made, ephemeris):
    """A function that makes records and fits them."""
    return lambda *words, **changes: (lambda one: fit_object(one.records, one.mission, ephemeris))(
        made(*words, **changes)
    )


@pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference observations is not here")
def test_two_bad_records_that_few_others_cannot_outvote_are_said(tmp_path, capsys):
    """13 records of 2007 VV7: with the two of station 291 the orbit is 6e5 km off, 12 of its sigmas."""
    lines = (DATA / "2007VV7.obs80").read_text("ascii").splitlines()[8:21]
    (tmp_path / "few.obs80").write_text("\n".join(lines) + "\n", "ascii")
    assert main(["fit", str(tmp_path / "few.obs80"), "-o", str(tmp_path / "run")]) == 0
    said = "kept because there are few; the worst is few.obs80:10, chi 3.5"
    assert said in " ".join(capsys.readouterr().out.split())
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    assert summary["fit"]["n_rejected"] == 0
    assert any(said in text for text in summary["warnings"])
    assert said in (tmp_path / "run" / "report.html").read_text("utf-8")
    assert main(["fit", str(tmp_path / "few.obs80"), "--split", "-o", str(tmp_path / "each")]) == 0
    assert f"warnings: {len(summary['warnings'])};" in " ".join(capsys.readouterr().out.split())


def test_a_record_beyond_the_threshold_is_named_where_few_keep_it(fit):
    error = np.zeros((12, 2))
    error[5] = [1.2, 0.0]
    found = fit(n=12, error=error)
    assert found.general.selected.all()
    (said,) = [text for text in found.verdict.cautions if "kept because there are few" in text]
    assert f"made.psv:{3 + 5}, chi {np.sqrt(found.general.chi2[5]):.1f}" in said
    assert found.general.chi2[5] > 8.0


def test_a_good_fit_has_no_cautions(fit):
    found = fit()
    assert found.verdict.status is Status.CONVERGED
    assert found.verdict.cautions == ()


def test_sigmas_that_are_too_small_are_said_and_far_too_small_ones_fail(fit):
    off = "  clock: 0 s\n  rejection: {enabled: false}\n"
    found = fit(off, rms=NOISE / 1.35)
    assert found.verdict.status is Status.CONVERGED
    assert any("the sigmas are too small" in text and "for 54 degrees" in text for text in found.verdict.cautions)
    found = fit(off, rms=NOISE / 3.0)
    assert found.verdict.failed
    assert "the sigmas are too small" in found.verdict.message
    assert any("kept because rejection is off" in text for text in found.verdict.cautions)


def test_rare_but_slight_misfit_is_a_caution_not_a_failure(fit):
    """A reduced chi squared between 2.3 and 3 over 54 degrees of freedom is rarer than one in 10^6."""
    found = fit("  clock: 0 s\n  rejection: {enabled: false}\n", rms=NOISE / 1.7)
    assert 2.3 < found.general.fit.estimate.chi2 / 54 < 3.0
    assert found.verdict.status is Status.CONVERGED
    assert any("as if by a factor of 1." in text for text in found.verdict.cautions)


def test_known_errors_that_are_estimated_count_as_degrees_of_freedom(fit):
    """Each has a prior, which is as good as a measurement: 60 numbers, 6 unknown."""
    bias = "  uncertainty:\n    - {stations: all, bias: {sigma: 0.1 arcsec, treatment: estimated}}\n"
    found = fit("  clock: 0 s\n  rejection: {enabled: false}\n" + bias, rms=NOISE / 1.45)
    assert any("for 54 degrees" in text for text in found.verdict.cautions)


def test_more_than_half_rejected_is_no_orbit(fit):
    found = fit()
    selected = np.arange(30) < 15
    assert not verdict(found.found, replace(found.general, selected=selected)).failed
    selected[0] = False
    judged = verdict(found.found, replace(found.general, selected=selected))
    assert judged.status is Status.DIVERGED
    assert judged.message.startswith("16 of 30 observations were rejected")


def test_an_unbound_orbit_within_its_sigma_is_not_believed(fit):
    """Eccentricity 1.003 +- 0.002 over a day, and known over two months."""
    fast = STATE.copy()
    gm = 1.32712440018e11
    fast[3:] *= np.sqrt(2.003 * gm / np.linalg.norm(STATE[:3])) / np.linalg.norm(STATE[3:])
    found = fit(days=1.0, state=fast)
    assert found.verdict.status is Status.NOT_OBSERVABLE
    assert "unbound" in found.verdict.message
    assert fit(days=60.0, state=fast).verdict.status is Status.CONVERGED


def test_the_limit_of_iterations_says_what_to_raise(fit):
    found = fit("  clock: 0 s\n  iterations: 1\n", n=12, error=np.full((12, 2), 200.0))
    assert found.verdict.status is Status.ITERATION_LIMIT
    assert "Raise fit.iterations (now 1)." in found.verdict.message


BIASED = "  clock: 0 s\n  uncertainty:\n    - {stations: [F51], bias: {sigma: 5 arcsec, treatment: estimated}}\n"


USUAL = Thresholds()


def again(found, selected, thresholds=USUAL):
    """The estimate anew from a selection."""
    forces = force_model(found.mission, found.material.ephemeris)
    sky = found.material.weighed(found.material.sky(found.epoch), found.lean.correction.seen)
    state = found.lean.correction.state
    return estimate(found.mission, found.material, sky, forces, state, found.priors, selected, thresholds)


def test_the_bias_of_a_station_that_is_all_left_out_is_unknown_and_brings_it_back(fit):
    error = np.zeros((30, 2))
    error[::3, 1] = 3.0
    found = fit(BIASED, error=error)
    mine = found.material.astrometry.station == SITES[0]
    apart = again(found, ~mine, None)
    v = apart.residual[mine] / ARCSEC
    assert np.abs(v[:, 1]).min() > 2.0
    # the error of the orbit of the other two stations adds a little to the 5 arcsec
    bound = np.sum(v**2, axis=1) / (5.0**2 + NOISE**2)
    assert np.all(apart.chi2[mine] <= 1.0001 * bound)
    assert np.all(apart.chi2[mine] > 0.9 * bound)
    back = again(found, ~mine)
    assert back.selected.all()
    assert back.stands


def test_a_selection_that_does_not_stand_is_said(fit, monkeypatch):
    found = fit(BIASED)
    fewer = np.arange(30) != 4  # which comes back in the next round
    monkeypatch.setattr(nebosvod.fits.general, "ROUNDS", 0)
    assert not again(found, fewer).stands
    assert again(found, np.ones(30, dtype=bool)).stands
    monkeypatch.setattr(nebosvod.fits.general, "ROUNDS", 15)
    monkeypatch.setattr(nebosvod.fits.general, "reselect", lambda chi2, chosen, *more: chosen ^ ~fewer)
    general = again(found, fewer)
    assert not general.stands
    judged = verdict(found.found, general)
    assert judged.failed
    assert "circle" in judged.message
    assert not any("circle" in text for text in (found.verdict.message, *found.verdict.cautions))


def test_no_default_clock_where_timing_is_a_source(made, ephemeris, capsys):
    def clocks(more):
        one = made(more)
        return prepare(one.records, one.mission, ephemeris).exposures.timing_sigma_s

    assert np.all(clocks("") >= 1.0)
    assert not clocks(ALL_TIMING).any()
    some = clocks(ALL_TIMING.replace("all", "[W94]"))
    np.testing.assert_array_equal(some == 0.0, np.arange(30) % 3 == 1)
    assert np.all(clocks("  clock: 1 s\n" + ALL_TIMING) >= 1.0)
    assert main(["check", str(made(ALL_TIMING).path)]) == 0
    assert "none where timing is uncertain" in capsys.readouterr().out


def test_sigmas_of_the_table_hold_clock_and_stated_place(fit):
    found = fit("  clock: 20 s\n")
    said = answer(found)
    seen, arrays, table = found.general.seen, all_arrays(said), residuals(said)
    t, rate = found.material.exposures.timing_sigma_s, found.general.seen.rate / ARCSEC
    expected = np.sqrt(NOISE**2 + (t[:, None] * rate) ** 2)
    assert np.any(expected > 1.5 * NOISE)
    np.testing.assert_allclose(table.columns["sigma_ra"], expected[:, 0], rtol=1e-12)
    np.testing.assert_allclose(table.columns["sigma_dec"], expected[:, 1], rtol=1e-12)
    tilt = arrays["R_total"][:, 0, 1] / ARCSEC**2 / expected.prod(axis=1)
    np.testing.assert_allclose(table.columns["correlation"], tilt, rtol=1e-12)
    np.testing.assert_allclose(arrays["R_total"], arrays["R"], rtol=1e-15)
    place = np.full((30, 3, 3), np.nan)
    place[7] = np.diag([9.0, 4.0, 1.0])
    stated = replace(found.material, astrometry=replace(found.material.astrometry, position_covariance_km2=place))
    more = stated.total_noise(seen) - stated.exposures.noise(seen.rate)
    H = seen.H_z[7]
    np.testing.assert_allclose(more[7], H @ place[7] @ H.T, rtol=1e-6)
    assert np.flatnonzero(more.any(axis=(1, 2))).tolist() == [7]


def test_biases_of_star_catalogues_are_taken_off(made, ephemeris, tmp_path):
    """A table of 48 pixels that says 0.3 and -0.2 arcsec everywhere: what was measured is too large by as much."""
    row = " ".join(["0.300 -0.200 0.0 0.0"] * 26)
    (tmp_path / "bias.dat").write_text("! head\n" * 23 + f"{row}\n" * 48, "ascii")
    one = made("  debias: bias.dat\n")
    material = prepare(one.records, one.mission, ephemeris)
    moved = (material.observed - one.records.psi) / ARCSEC
    moved[:, 0] *= np.cos(one.records.psi[:, 1])
    np.testing.assert_allclose(moved, np.tile([-0.3, 0.2], (30, 1)), atol=1e-5)


def test_a_fit_with_the_orbit_of_the_first_half_as_its_prior_is_the_fit_of_all(made, tmp_path, capsys):
    """Information adds up, whichever of the two ways it comes in: records, or the covariance they gave."""
    settings = (
        "  clock: 0 s\n  epoch: 2023-03-01 TDB\n  rejection: {enabled: false}\n  shared_errors: {treatment: 'off'}\n"
    )
    whole = made(settings, n=60, days=80.0).path
    text, found = whole.read_text("utf-8"), {}
    head = text[: text.index("object:")]
    (tmp_path / "first.yaml").write_text(text + "  to: 2023-02-27\n", "utf-8")
    given = "object:\n  name: made\n  orbit: {kind: file, file: first}\nprior: orbit\n"
    (tmp_path / "then.yaml").write_text(head + given + text[text.index("fit:") :] + "  from: 2023-02-27\n", "utf-8")
    for name in ("made", "first", "then"):
        assert main(["fit", str(tmp_path / f"{name}.yaml"), "-o", str(tmp_path / name)]) == 0
        found[name] = json.loads((tmp_path / name / "summary.json").read_text("utf-8"))["orbit"]
    factor = np.array(found["made"]["factor_km_km_s"])
    gap = np.array(found["then"]["state_km_km_s"]) - found["made"]["state_km_km_s"]
    assert np.linalg.norm(np.linalg.solve(factor, gap)) < 0.03
    ratio = np.linalg.solve(factor, np.array(found["then"]["factor_km_km_s"]))
    np.testing.assert_allclose(np.linalg.svd(ratio, compute_uv=False), 1.0, atol=0.01)
    assert found["first"]["sigma_position_km"] > 2.0 * found["made"]["sigma_position_km"]


def test_forces_that_come_with_an_orbit_stay_when_another_orbit_is_found(made, tmp_path):
    """A1 of an earlier fit, estimated jointly with its orbit: as if it were written out."""
    text = made("  clock: 0 s\n  rejection: {enabled: false}\n", n=60, days=80.0).path.read_text("utf-8")
    head, records = text[: text.index("object:")], text[text.index("fit:") :]
    force = "  nongrav: {A1: {value: 2e-8 au/d^2, sigma: 1e-8 au/d^2, treatment: estimated}}\n"
    (tmp_path / "first.yaml").write_text(text[: text.index("fit:")] + force + records + "  to: 2023-02-27\n", "utf-8")
    assert main(["fit", str(tmp_path / "first.yaml"), "-o", str(tmp_path / "first")]) == 0
    found = json.loads((tmp_path / "first" / "summary.json").read_text("utf-8"))["estimators"][0]["parameters"]
    a1 = found["a1_au_d2"]["estimate"]
    given = "object:\n  name: made\n  orbit: {kind: file, file: first}\n"
    written = f"  nongrav: {{A1: {{value: {a1!r} au/d^2, treatment: estimated}}}}\n"
    states = []
    for name, more in (("along", ""), ("written", written)):
        path = tmp_path / f"{name}.yaml"
        path.write_text(head + given + more + "prior: orbit\n" + records + "  from: 2023-02-27\n", "utf-8")
        assert main(["fit", str(path), "-o", str(tmp_path / name)]) == 0
        summary = json.loads((tmp_path / name / "summary.json").read_text("utf-8"))
        assert summary["physics"]["nongrav_au_d2"]["a1_au_d2"] == pytest.approx(a1, rel=1e-12)
        states.append(summary["estimators"][0])
    one, two = (np.array(state["state_km_km_s"]) for state in states)
    assert np.linalg.norm(np.linalg.solve(np.array(states[1]["factor_km_km_s"]), one - two)) < 1e-3
    assert states[0]["sigma_position_km"] == pytest.approx(states[1]["sigma_position_km"], rel=1e-6)


def test_a_prior_covariance_needs_no_orbit_to_start_from(made, tmp_path):
    """Its orbit is the one found; a covariance that says nothing changes nothing."""
    text = made("  clock: 0 s\n  rejection: {enabled: false}\n", n=60, days=80.0).path.read_text("utf-8")
    head, records = text[: text.index("object:")], text[text.index("fit:") :]
    wide = [[1e18 if i == j < 3 else 1e6 if i == j else 0.0 for j in range(6)] for i in range(6)]
    prior = f"prior: {{covariance: {wide}, names: [x, y, z, vx, vy, vz], epoch: 2023-03-01 TDB}}\n"
    found = []
    for name, more in (("with", prior), ("without", "")):
        (tmp_path / f"{name}.yaml").write_text(head + more + records, "utf-8")
        assert main(["fit", str(tmp_path / f"{name}.yaml"), "-o", str(tmp_path / name)]) == 0
        found.append(json.loads((tmp_path / name / "summary.json").read_text("utf-8"))["orbit"])
    assert found[0]["sigma_position_km"] == pytest.approx(found[1]["sigma_position_km"], rel=1e-6)
