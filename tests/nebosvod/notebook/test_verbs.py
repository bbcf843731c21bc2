"""Functions against their commands: the same numbers, quantities and moments for texts, errors by parameter."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy import units as u
from astropy.time import Time

import nebosvod
from nebosvod.cli import main
from nebosvod.errors import InputError, OutputError, WorkerError

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "observations"
STUDY = """
schema_version: 1
study: noise
mission: minimal
vary: {sigma: {set: telescopes.*.noise.sigma, values: [0.05 arcsec, 0.1 arcsec]}}
answer: [{name: position, of: predictions.ten days later.semi_axes_km.0}]
"""


@pytest.fixture(scope="module")
def minimal() -> Any:
    return nebosvod.run("minimal")


@pytest.fixture(scope="module")
def folder(minimal: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(minimal.save(tmp_path_factory.mktemp("run") / "minimal-run"))


def test_a_run_is_that_of_the_command(minimal: Any, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "minimal", "-o", str(folder.parent / "other"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == minimal.summary


def test_an_ephemeris_is_that_of_the_command_and_takes_moments_and_durations(
    minimal: Any, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sky = nebosvod.ephemeris(minimal, Time("2028-04-20", scale="utc"), Time("2028-04-21", scale="utc"), 6 * u.h, "500")
    assert (
        main(["ephemeris", str(folder), "--from", "2028-04-20", "--to", "2028-04-21", "--step", "6 h", "--json"]) == 0
    )
    theirs = json.loads(capsys.readouterr().out)
    for mine, row in zip(sky.summary["rows"], theirs["rows"], strict=True):
        assert mine == {name: value if isinstance(value, str) else pytest.approx(value) for name, value in row.items()}
    assert sky.tables["ephemeris"]["distance_au"].unit == u.au
    assert len(sky.tables["ephemeris"]) == 5
    assert "Nearest at 0.0968" in repr(sky)
    assert "<table" in sky._repr_html_()


def test_approaches_and_risk_take_a_result_for_an_orbit(minimal: Any) -> None:
    found = nebosvod.approaches(minimal, "2028-04-21", "2028-06-01", within=0.01 * u.au)
    assert "No approach within 0.01 au" in repr(found)
    hit = nebosvod.risk(minimal, "2028-06-01", draws=100)
    assert hit.summary["virtual_impactors"] == []
    assert len(repr(hit)) < 400


def test_runs_are_compared_as_objects_or_folders(minimal: Any, folder: Path) -> None:
    finer = nebosvod.run(nebosvod.load_mission("minimal").with_("telescopes.*.noise.sigma", "0.05 arcsec"))
    both = nebosvod.compare(folder, finer)
    sigmas = [one["sigma_position_km"] for one in both.summary["estimators"][0]["by_run"]]
    assert sigmas == [one.typed.estimates[0].sigma_position.to_value("km") for one in (minimal, finer)]
    assert "ten days later" in both.headline
    assert both.headline.split(":")[0] in both.report().text


def test_a_plan_names_the_visit_that_helps_most(tmp_path: Path) -> None:
    plan = nebosvod.plan("minimal", visits=1)
    assert json.loads(plan.save(tmp_path / "plan.json").read_text("utf-8")) == plan.summary
    assert plan.headline.startswith("measure next with ")
    assert plan.plot.names
    with pytest.raises(InputError, match=r"^visits: "):
        nebosvod.plan("minimal", visits=0)


def test_a_study_keeps_its_folder(tmp_path: Path) -> None:
    (tmp_path / "noise.yaml").write_text(STUDY, "utf-8")
    study = nebosvod.study(tmp_path / "noise.yaml", output=tmp_path / "kept", workers=1)
    assert study.save() == tmp_path / "kept"
    copy = nebosvod.Study.load(study.save(tmp_path / "copy"))
    assert copy.summary == study.summary
    assert sorted(path.name for path in copy.folder.iterdir()) == sorted(path.name for path in study.folder.iterdir())
    with pytest.raises(OutputError, match="exists"):
        study.save(tmp_path / "copy")
    assert len(study.table) == 2
    assert np.diff(study.table["position"])[0] > 0.0
    assert nebosvod.Study.load(tmp_path / "kept").summary == study.summary
    assert study.plot.names == ("curve_position",)
    assert {"target_plane", "budget"} & set(dir(study.plot)) == set()  # what Tab offers is there
    with pytest.raises(InputError, match=r"has no such figure \(there are: curve_position\)$"):
        getattr(study.plot, "target_plane")()  # noqa: B009  (of its class alone)
    assert len(repr(study)) < 400


def test_a_validation_keeps_its_folder(tmp_path: Path) -> None:
    found = nebosvod.validate("minimal", 20, output=tmp_path / "trust", workers=1)
    assert found.summary["n_runs"] == 20
    assert (tmp_path / "trust" / "validation.html").read_text("utf-8") == found.report().text
    with pytest.raises(InputError, match=r"^runs: 3 "):
        nebosvod.validate("minimal", 3, output=tmp_path / "few")


@pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference data is not here")
def test_a_fit_of_real_observations() -> None:
    """2014 AA: seven observations, two hours before it fell into the Atlantic."""
    fit = nebosvod.fit(DATA / "2014AA.obs80")
    assert isinstance(fit, nebosvod.Fit)
    assert len(repr(fit)) < 400
    assert fit.typed.n_observations == 7
    assert "residuals" in fit.plot.every()


@pytest.mark.long
@pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference data is not here")
def test_an_alert_of_two_hours_of_observations() -> None:
    found = nebosvod.alert(DATA / "2014AA.obs80", hours="1")
    assert found.summary["probability"] > 0.5
    assert "plane" in found.plot.names


def test_errors_name_the_parameter_and_not_an_option(minimal: Any) -> None:
    with pytest.raises(InputError, match=r"^until: needs a date"):
        nebosvod.ephemeris(minimal, "2028-04-20", "2028-0-0")
    with pytest.raises(InputError, match=r"^until: .* is before since "):
        nebosvod.ephemeris(minimal, "2028-04-20", "2028-04-01")
    with pytest.raises(InputError, match="an orbit is a path"):
        nebosvod.risk(3, "2028-06-01")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"^criterion: 'best' \(allowed: a, d, "):
        nebosvod.plan("minimal", criterion="best")
    with pytest.raises(InputError, match="mars-2"):
        nebosvod.risk(minimal, "2028-06-01", bodies=["earth", "mars-2"])
    with pytest.raises(InputError, match="got int"):
        nebosvod.compare(minimal, 3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"a study is loaded by a path .*got int"):
        nebosvod.study(3)  # type: ignore[arg-type]
    for name in ("fit", "alert"):
        with pytest.raises(InputError, match=r"^files: a path, or a list of paths.*got int"):
            getattr(nebosvod, name)(3)
    with pytest.raises(InputError, match=r"^hours: needs up to .* numbers"):
        nebosvod.alert("first-hours", hours=[-1])
    with pytest.raises(InputError, match=r"no telescope 'X' .allowed: "):
        nebosvod.load_mission("minimal").telescope("X")


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"coordinates": "polar"}, r"^coordinates: 'polar' \(allowed: cartesian, equinoctial\)"),
        ({"draws": "many"}, r"^draws: needs a whole number \(got 'many'\)"),
        ({"draws": True}, r"^draws: needs a whole number"),
        ({"density": "heavy"}, r"^density: needs a number \(got 'heavy'\)"),
    ],
)
def test_what_is_no_number_and_no_known_word_is_refused_by_its_name(minimal: Any, said: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        nebosvod.risk(minimal, "2028-06-01", **said)


@pytest.mark.parametrize("verb", ["validate", "study"])
def test_an_unknown_cluster_is_refused_and_slurm_is_sought(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cluster that is not there would be waited for without an end."""
    monkeypatch.setenv("PATH", str(tmp_path))
    (tmp_path / "noise.yaml").write_text(STUDY, "utf-8")
    asked = "minimal" if verb == "validate" else tmp_path / "noise.yaml"
    with pytest.raises(InputError, match=r"^cluster: 'pbs' \(allowed: slurm\)"):
        getattr(nebosvod, verb)(asked, cluster="pbs", output=tmp_path / "kept")
    with pytest.raises(WorkerError, match=r"^cluster slurm: there is no sbatch here"):
        getattr(nebosvod, verb)(asked, cluster="slurm", output=tmp_path / "kept")


@pytest.mark.parametrize("seed", [-1, 0.5, "one", None])
def test_a_seed_is_held_to_what_the_option_takes(seed: Any) -> None:
    with pytest.raises(InputError, match=r"^seed: needs a whole number"):
        nebosvod.run("minimal", seed=seed)


def test_a_folder_in_the_way_is_told_in_the_words_of_python(minimal: Any, folder: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"exists already; use overwrite=True to replace that run, or another folder"):
        minimal.save(folder)
    (tmp_path / "note.txt").write_text("of somebody")
    with pytest.raises(OutputError, match=r"; use another folder$"):
        minimal.save(tmp_path, overwrite=True)
