"""A mission edited in Python is checked like a file, and its text is what runs."""

import hashlib
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from astropy import units as u
from astropy.time import Time, TimeDelta

from nebosvod import load_mission, run
from nebosvod.errors import InputError
from nebosvod.mission import FitMission, Mission, list_missions, load_fit, load_mission_text, template_text
from nebosvod.mission.editing import as_text, as_tree
from nebosvod.mission.fields import epoch_text
from nebosvod.timescale import Epoch

ROOT = Path(__file__).resolve().parents[3]
NAMES = [name for name, _ in list_missions()]
MINIMAL = (ROOT / "scenarios" / "minimal.yaml").read_text("utf-8")


@pytest.mark.parametrize("name", [*NAMES, "template"])
def test_the_text_of_a_mission_in_memory_says_the_same_mission(name: str) -> None:
    """To the last bit of every number: written in the units of the program."""
    mission = load_mission_text(template_text("mine")) if name == "template" else load_mission(name)
    again = load_mission_text(as_text(as_tree(mission)))
    assert as_tree(again) == as_tree(mission)
    assert again.times_s(again.telescopes[0].name).tolist() == mission.times_s(mission.telescopes[0].name).tolist()
    assert [s.name for s in again.sources] == [s.name for s in mission.sources]


@pytest.mark.parametrize(
    "epoch",
    [
        "2029-03-01T00:00:00 TDB",
        "2029-03-01 UTC",
        "2459101.039422462638 JD TDB",
        "2000-01-01T12:00:00 TT",
        "59215.123456789 MJD TT",
    ],
)
def test_an_epoch_is_written_so_that_it_is_read_again(epoch: str) -> None:
    assert Epoch.parse(epoch_text(Epoch.parse(epoch))) == Epoch.parse(epoch)


def test_one_place_or_many_are_changed() -> None:
    mission = load_mission("apophis-2029")
    for value in ("0.05 arcsec", 0.05 * u.arcsec, 50 * u.mas):
        sharper = mission.with_("telescopes.*.noise.sigma", value)
        assert [t.noise.sigma for t in sharper.telescopes] == pytest.approx([2.42406840554768e-07] * 2, rel=1e-13)
    first = mission.telescopes[0].name
    one = mission.with_(["telescopes", first, "noise", "sigma"], "0.05 arcsec")
    assert one.telescopes[0].noise.sigma == pytest.approx(2.42406840554768e-07)
    assert one.telescopes[1].noise.sigma == mission.telescopes[1].noise.sigma
    assert mission.with_("telescopes.-1.noise.sigma", "1 arcsec").telescopes[1].noise.sigma > 4e-6
    for when in ("2029-04-01 UTC", datetime(2029, 4, 1, tzinfo=UTC), Time("2029-04-01T00:01:09.185647", scale="tdb")):
        assert abs(mission.with_("schedule.0.end", when).schedule[0].end - Epoch.parse("2029-04-01 UTC")) < 1e-5
    for step in ("12 h", timedelta(hours=12), TimeDelta(0.5 * u.day), 0.5 * u.day):
        assert mission.with_("schedule.0.cadence", step).schedule[0].cadence == 43200.0
    assert mission.with_("monte_carlo", {"runs": 7}).monte_carlo.runs == 7  # type: ignore[union-attr]
    assert mission.with_("monte_carlo.runs", 8).monte_carlo.runs == 8  # type: ignore[union-attr]
    assert mission.with_("predictions", None).predictions == ()
    assert len(mission.with_("predictions.0", None).predictions) == len(mission.predictions) - 1
    doubt = {"object.albedo.sigma": 0.1, "object.albedo.treatment": "considered"}
    doubted = load_mission_text(MINIMAL).with_("object.albedo", 0.2).with_(doubt).object.albedo
    assert doubted is not None
    assert (doubted.value, doubted.sigma, doubted.treatment) == (0.2, 0.1, "considered")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("telescopes.*.nois.sigma", "0.1 arcsec", r'edited:\d+:\d+: telescopes\[0\].nois.*did you mean "?noise'),
        ("telescopes.*.noise.sigma", "0.1 km", r"telescopes\[0\].noise.sigma: needs an angle with a unit"),
        ("telescopes.*.noise.sigma", 0.1 * u.km, r"telescopes\[0\].noise.sigma: needs an angle with a unit"),
        ("telescopes.*.noise.sigma", "-1 arcsec", r"telescopes\[0\].noise.sigma: is out of range"),
        ("telescopes.behnd.noise.sigma", "1 arcsec", r'"behnd" is no element there .*did you mean "behind"'),
        ("telescopes.7.noise.sigma", "1 arcsec", r'"7" is no element there \(got 2 elements'),
        ("schedule.0.end", "2028-03-01 TDB", r"schedule\[0\]"),
        ("schedule.0.end", datetime(2029, 4, 1), r"has no time zone"),
        ("", 1, "is no path of a mission"),
        ("telescopes..noise", 1, "is no path of a mission"),
        ("object.radius", object(), "cannot hold a object"),
        ("reference_epoch", None, "reference_epoch"),
    ],
)
def test_an_edit_is_refused_as_a_file_would_be(path: str, value: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_mission("minimal").with_(path, value)


def test_the_manifest_holds_what_ran(tmp_path: Path) -> None:
    """And the numbers are those of the file that says the same."""
    file = tmp_path / "coarse.yaml"
    file.write_text(MINIMAL.replace("cadence: 1 d", "cadence: 3 d"))
    wanted = run(load_mission(file))
    plain = load_mission("minimal")
    arc = plain.schedule[0].model_copy(update={"cadence": 3 * 86400.0})
    for mission in (plain.with_("schedule.0.cadence", "3 d"), plain.model_copy(update={"schedule": (arc,)})):
        result = run(mission)
        assert result.summary == wanted.summary
        text = result.manifest["mission"]["text"]
        assert text == mission.text != plain.text
        assert result.manifest["mission"]["sha256"] == hashlib.sha256(text.encode()).hexdigest()
        assert run(load_mission_text(text)).summary == wanted.summary


def test_a_mission_changed_by_any_way_does_not_lie_about_its_text() -> None:
    mission = load_mission("minimal")
    assert mission.text == MINIMAL
    assert mission.model_copy().text == MINIMAL
    assert mission.model_copy(deep=True).text == MINIMAL
    other = mission.model_copy(update={"title": "another"})
    assert load_mission_text(other.text).title == "another"
    assert Mission.model_validate(as_tree(mission)).text == as_text(as_tree(mission))
    with pytest.raises(InputError, match="schedule"):
        mission.model_copy(update={"schedule": ()})


def test_a_mission_with_files_keeps_its_place(tmp_path: Path) -> None:
    text = MINIMAL
    (tmp_path / "m.yaml").write_text(text)
    mission = load_mission(tmp_path / "m.yaml").with_("title", "edited: yes # no")
    assert mission.path == tmp_path / "m.yaml"
    assert mission.title == "edited: yes # no"


def test_fits_are_edited_too(tmp_path: Path) -> None:
    (tmp_path / "a.obs80").write_text("")
    (tmp_path / "fit.yaml").write_text(
        "schema_version: 1\nname: f\nfit:\n  observations: [a.obs80]\n  from: 2024-06-01\n  clock: 2 s\n"
        "  uncertainty:\n    - {stations: all, bias: {sigma: 0.1 arcsec, treatment: considered}}\n"
    )
    mission = load_fit(tmp_path / "fit.yaml")
    changes = {"fit.from": Time("2024-06-03", scale="utc"), "fit.uncertainty.*.bias.sigma": 0.2 * u.arcsec}
    later = mission.with_(changes)
    assert later.fit.since is not None
    assert abs(later.fit.since - Epoch.parse("2024-06-03 UTC")) < 1e-8
    assert as_tree(later)["fit"]["clock"] == "2.0 s"  # type: ignore[index, call-overload]
    assert as_tree(load_mission_again(tmp_path, later.text)) == as_tree(later)
    assert json.dumps(as_tree(later))


def load_mission_again(folder: Path, text: str) -> FitMission:
    (folder / "again.yaml").write_text(text)
    return load_fit(folder / "again.yaml")
