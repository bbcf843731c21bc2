"""Small things said right: files that check opens, folders in the way, runs that lack a file, verdicts with names."""

from pathlib import Path

import pytest

from nebosvod.cli import main
from nebosvod.mission.reading.builtin import builtin_path
from nebosvod.observation import read_astrometry
from nebosvod.observation.formats.records import joined
from nebosvod.studies.trust import verdict


def records(*written: tuple[str, str]) -> str:
    """Lines of 80 columns: a day of July 2022 and the last digits of the declination of each."""
    start = "     K22O01A  C2022 07 "
    return "".join(f"{start}{day} 20 00 00.00 +10 00 0{second}".ljust(77) + "568\n" for day, second in written)


def test_a_file_that_is_part_of_another_changes_nothing(tmp_path: Path) -> None:
    """Exact twins are paired before copies that were changed in their last digit."""
    first, more = tmp_path / "first.obs", tmp_path / "more.obs"
    first.write_text(records(("26.10000", "0.0"), ("26.20000", "0.0")), "utf-8")
    more.write_text(records(("26.10000", "0.0"), ("26.20000", "0.0"), ("26.10000", "0.1")), "utf-8")
    alone, both = read_astrometry(more), joined([read_astrometry(first), read_astrometry(more)])
    assert len(alone) == len(both) == 3
    assert sorted(alone.psi[:, 1].tolist()) == sorted(both.psi[:, 1].tolist())


@pytest.mark.parametrize("content", [b"\xa3\x00rubbish", b"CCSDS_OEM_VERS = 2.0\nMETA_START\nOBJECT_NAME = X\n"])
def test_check_opens_the_files_of_orbits_as_a_run_does(
    tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "orbit.oem").write_bytes(content)
    text = builtin_path("minimal").read_text("utf-8")
    text = text.replace("{kind: heliocentric, lead: 10 deg}", "{kind: oem, file: orbit.oem}")
    text = text.replace("  - {name: behind, like: ahead, orbit: {lead: -10 deg}}\n", "")
    (tmp_path / "m.yaml").write_text(text, "utf-8")
    mission = str(tmp_path / "m.yaml")
    codes = [main(["check", mission]), main(["run", mission, "-o", str(tmp_path / "out")])]
    said = capsys.readouterr().err.splitlines()
    assert codes == [3, 3]
    assert "orbit.oem" in said[0]
    assert said[0] == said[-1]


def test_what_is_no_run_is_not_offered_to_be_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "there").write_text("mine", "utf-8")
    assert main(["run", "minimal", "-o", str(tmp_path / "there")]) == 3
    said = capsys.readouterr().err
    assert "is not a run folder of this program" in said
    assert "--overwrite" not in said


def test_a_run_that_lacks_a_file_or_has_a_cut_one_is_told_by_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("one", "two"):
        assert main(["run", "minimal", "-o", str(tmp_path / name)]) == 0
    arrays = tmp_path / "two" / "arrays.npz"
    arrays.write_bytes(arrays.read_bytes()[:1000])
    assert main(["compare", str(tmp_path / "one"), str(tmp_path / "two")]) == 2
    assert "arrays.npz" in capsys.readouterr().err
    (tmp_path / "one" / "summary.json").unlink()
    assert main(["report", str(tmp_path / "one")]) == 2
    assert "one: summary.json missing, which its manifest.json lists" in capsys.readouterr().err


def test_a_verdict_names_the_tests_that_failed_and_how_rare_one_is() -> None:
    test = "variance of whitened component 3 (1 expected) 1.12"
    said = verdict([], 1, 33, 2000, [test], 0.01)
    assert f"{test}; one right covariance in 100 fails so by chance" in said


def test_check_of_a_fit_opens_the_trajectories_of_its_stations(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "c51.oem").write_bytes(b"\xa3\x00rubbish")
    (tmp_path / "a.obs").write_text(records(("26.10000", "0.0")), "utf-8")
    plan = "fit: {observations: [a.obs], spacecraft: {C51: {kind: oem, file: c51.oem}}}\n"
    (tmp_path / "f.yaml").write_text(f"schema_version: 1\nname: f\n{plan}", "utf-8")
    assert main(["check", str(tmp_path / "f.yaml")]) == 3
    assert "fit.spacecraft.C51: c51.oem: byte 0xA3 in its first line" in capsys.readouterr().err
