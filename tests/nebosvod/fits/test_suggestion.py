"""`--suggest`: settings that mean what the given ones meant, with what would mend the fit; or nothing at all."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.errors import OutputError
from nebosvod.fits.suggestion import write_suggestion
from nebosvod.mission import load_fit
from nebosvod.pipeline import mission_of
from nebosvod.timescale import Epoch
from nebosvod.units import ARCSEC

EVERYTHING = Path(__file__).parents[1] / "everything"
EPOCH = Epoch.parse("2024-02-15 TDB")


def found(*errors: Any) -> Any:
    """What the tests of a fit say."""
    return SimpleNamespace(errors=errors, forces=())


def biased(station: str) -> Any:
    """A station with a bias of half an arcsecond."""
    return SimpleNamespace(
        station=station,
        kind="bias",
        whole=True,
        size_rad=np.full(2, 0.5 * ARCSEC),
        span_s=(0.0, 1.0),
        estimate=(0.5, 0),
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Every key of a fit, with the files it names."""
    for path in EVERYTHING.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


def test_where_nothing_is_to_be_mended_nothing_is_written_and_that_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "mended.yaml"
    call = ["fit", str(folder / "made.obs80"), "-o", str(folder / "out")]
    code = main(call)
    capsys.readouterr()
    assert main([*call, "--overwrite", "--suggest", str(out)]) == code
    assert f"nothing to suggest: {out} is not written" in capsys.readouterr().err
    assert not out.exists()


def test_suggested_settings_say_what_the_given_ones_said(folder: Path) -> None:
    """Numbers as 1e-8, dates and codes are read by YAML 1.2, as the program reads them, not by PyYAML's 1.1."""
    given = folder / "fit.yaml"
    text = given.read_text("utf-8").replace("from: 2024-02-01\n", "from: 2024-02-01T12:30:00\n")
    given.write_text(text.replace("title: Every key of a fit", "title: 12:30:00"), "utf-8")
    before, out = load_fit(given), folder / "mended.yaml"
    assert write_suggestion(out, before, found(biased("I41")), EPOCH, overwrite=False)
    after = load_fit(out)
    assert after.name == f"{before.name}-mended"
    assert after.title == before.title == "12:30:00"
    assert [entry.stations for entry in after.fit.uncertainty][-1] == ("I41",)
    kept = after.fit.model_copy(update={"uncertainty": after.fit.uncertainty[:-1]})
    assert repr(kept) == repr(before.fit)
    for name in ("object", "prior", "predictions", "force_model"):
        assert repr(getattr(after, name)) == repr(getattr(before, name))


def test_only_what_was_suggested_before_is_replaced_and_never_through_a_link(folder: Path) -> None:
    mission, out = load_fit(folder / "fit.yaml"), folder / "mended.yaml"
    own = folder / "own.yaml"
    own.write_text("name: mine\n", "utf-8")
    link = folder / "link.yaml"
    link.symlink_to(own)
    for path, overwrite in ((own, False), (own, True), (link, False), (link, True), (folder / "no" / "x.yaml", True)):
        with pytest.raises(OutputError, match="--suggest: "):
            write_suggestion(path, mission, found(biased("I41")), EPOCH, overwrite)
    assert own.read_text("utf-8") == "name: mine\n"
    for overwrite in (False, True):
        assert write_suggestion(out, mission, found(biased("I41")), EPOCH, overwrite)


def test_a_place_for_suggestions_is_refused_before_the_fit(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = folder / "own.yaml"
    own.write_text("name: mine\n", "utf-8")
    call = ["fit", str(folder / "made.obs80"), "-o", str(folder / "out"), "--overwrite", "--suggest", str(own)]
    assert main(call) == 3
    assert "was not suggested by this program" in capsys.readouterr().err
    assert not (folder / "out").exists()


def test_suggested_settings_can_be_run_wherever_they_are_written(folder: Path, tmp_path: Path) -> None:
    """Files outside their folder are copied beside them, once; stations named by digits keep their zeros."""
    home, taken = tmp_path / "home", tmp_path / "home" / "fit.obs80"
    home.mkdir()
    taken.write_text("of somebody else", "utf-8")
    (folder / "fit.obs80").write_bytes((folder / "made.obs80").read_bytes())
    plain = mission_of([str(folder / "made.obs80"), str(folder / "fit.obs80")])
    errors = [biased("084"), biased("500"), biased("704")]
    written = write_suggestion(home / "mended.yaml", plain, found(*errors), EPOCH, overwrite=False)
    assert [path.name for path in written] == ["mended.yaml", "made.obs80", "fit-2.obs80"]
    after = load_fit(home / "mended.yaml")
    assert after.fit.observations == ("made.obs80", "fit-2.obs80")
    assert [entry.stations for entry in after.fit.uncertainty] == [("084",), ("500",), ("704",)]
    assert taken.read_text("utf-8") == "of somebody else"
    again = write_suggestion(home / "mended.yaml", plain, found(*errors), EPOCH, overwrite=True)
    assert [path.name for path in again] == ["mended.yaml"]


def test_every_file_of_the_given_settings_is_found_from_another_folder(folder: Path, tmp_path: Path) -> None:
    before, home = load_fit(folder / "fit.yaml"), tmp_path / "home"
    home.mkdir()
    written = write_suggestion(home / "mended.yaml", before, found(biased("I41")), EPOCH, overwrite=False)
    assert len(written) > 1
    after = load_fit(home / "mended.yaml")
    kept = after.fit.model_copy(update={"uncertainty": after.fit.uncertainty[:-1]})
    assert repr(kept) == repr(before.fit)
