"""`nebosvod alert`: the answer on the terminal and in folders, and what it says where there is none."""

import json
import re
import shutil
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import AltAz, EarthLocation, SkyCoord, get_body
from astropy.time import Time

from nebosvod.cli import main
from nebosvod.commands.alert_answer import alert_lines
from nebosvod.dynamics import Ephemeris
from nebosvod.observation.earth import obscodes
from nebosvod.report.alert_page import make_alert_page
from nebosvod.results.folder import SCHEMAS
from nebosvod.timescale import Epoch

sys.path.insert(0, str(Path(__file__).resolve().parent))
from kinds import KINDS, made  # type: ignore[import-not-found]

# the first records of 2018 LA, which fell on Botswana the same day; MPC
LA = """\
     K18L00A tC2018 06 02.34329516 11 10.342-11 19 34.92               V~2i5UG96
     K18L00A tC2018 06 02.34850816 10 59.352-11 20 21.37         18.2 GV~2i5UG96
     K18L00A tC2018 06 02.35372316 10 48.154-11 21 08.95         18.3 GV~2i5UG96
     K18L00A tC2018 06 02.35894416 10 36.604-11 21 57.30         18.0 GV~2i5UG96
"""
FELL = (23.3, -21.2)  # deg, US government sensors


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the first four observations."""
    folder = tmp_path_factory.mktemp("la")
    (folder / "la.obs80").write_text(LA)
    assert main(["alert", str(folder / "la.obs80"), "-o", str(folder / "out"), "--hours", "1,3,8"]) == 0
    return folder / "out"


def summary_of(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text("utf-8"))
    return found


def test_four_observations_of_an_impactor_give_a_probability_and_its_corridor(answer: Path) -> None:
    found = summary_of(answer)
    assert found["status"] == "answered"
    assert found["orbit_status"] == "not_observable"
    assert 0.1 < found["probability"] < 0.35  # an independent light ranging
    assert found["low"] < found["probability"] < found["high"]
    assert found["grid"]["effective"]["uniform"] >= 30.0
    assert any(inside(edge, FELL) for edge in found["impact"]["contours_deg"]["95"])
    # SBDB's orbit from all observations: a = 1.38 au, e = 0.432, i = 4.3 deg, within what four leave open
    for name, truth in (("a_au", 1.38), ("e", 0.432), ("i_deg", 4.3), ("H", 30.5)):
        assert found["quantities"][name]["q025"] < truth < found["quantities"][name]["q975"]


def inside(edge: list[list[float]], point: tuple[float, float]) -> bool:
    """Whether a point lies inside of a closed line, by the crossings of a ray."""
    x, y = point
    crossed = False
    for (x0, y0), (x1, y1) in pairwise(edge):
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) / (y1 - y0) * (x1 - x0):
            crossed = not crossed
    return crossed


def test_the_folder_has_the_shape_of_its_schema_and_its_page_can_be_made_again(answer: Path) -> None:
    schema = json.loads(SCHEMAS["alert"].read_text("utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(summary_of(answer), schema)
    page = (answer / "report.html").read_bytes()
    assert main(["report", str(answer)]) == 0
    assert (answer / "report.html").read_bytes() == page
    assert b"Probability to hit the Earth within 100 days" in page
    with np.load(answer / "arrays.npz") as arrays:
        assert arrays["node_weight_uniform"].sum() == pytest.approx(1.0)
        hits = arrays["draw_weight_uniform"][arrays["draw_body"] == "earth"].sum()
    assert hits == pytest.approx(summary_of(answer)["probability"], rel=1e-9)


def test_the_sky_of_the_next_hours_holds_where_the_object_was_seen(answer: Path) -> None:
    """An hour later, by interpolation of the records of I52 and G96 at 09:33 to 09:40 UTC: 16h 08m 56s, -11 28.9."""
    field = summary_of(answer)["fields"][0]
    ra, dec = field["ra_deg"], field["dec_deg"]
    assert abs(ra - 242.234) < 5.0 * field["semi_major_arcsec"] / 3600.0
    assert abs(dec + 11.4815) < 5.0 * field["semi_major_arcsec"] / 3600.0
    assert field["contours_deg"]["95"]


def test_orbits_that_will_fall_are_on_the_sky_until_they_do(answer: Path) -> None:
    """Those on the sky are 300 draws; who has come down before is one whose own flight ended so early."""
    found = summary_of(answer)
    with np.load(answer / "arrays.npz") as arrays:
        weight, end_s = arrays["draw_weight_uniform"], arrays["draw_t_s"]
        shown = [len(arrays[f"field_psi_{k}"]) for k in range(3)]
    reference = Epoch.parse(found["reference_epoch_tdb"])
    for field, number in zip(found["fields"], shown, strict=True):
        share = float(weight[end_s < Epoch.parse(field["epoch_utc"]) - reference].sum())
        assert field["fallen"] == pytest.approx(share, abs=4.0 * np.sqrt(share * (1.0 - share) / 300))
        assert number == round(300 * (1.0 - field["fallen"]))
    assert found["fields"][0]["fallen"] == 0.0
    assert found["fields"][2]["fallen"] > 0.01


def judged(code: str, epoch_utc: str, ra_deg: float, dec_deg: float) -> tuple[float, float, float]:
    """Altitudes of a direction and of the Sun, and the angle between them, deg, by astropy."""
    longitude = float(obscodes.codes()[code]["Longitude"]) * u.deg
    across, up = (6378.137 * part * u.km for part in obscodes.parallax(code))
    place = EarthLocation.from_geocentric(across * np.cos(longitude), across * np.sin(longitude), up)
    when = Time(epoch_utc.removesuffix(" UTC"), scale="utc")
    frame, target = AltAz(obstime=when, location=place), SkyCoord(ra_deg * u.deg, dec_deg * u.deg)
    sun = get_body("sun", when, place)
    apart = sun.transform_to(frame).separation(target.transform_to(frame)).deg
    return float(target.transform_to(frame).alt.deg), float(sun.transform_to(frame).alt.deg), float(apart)


def test_where_to_look_says_whether_it_can_be_seen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In the night, as it sets at dawn, by day, and from the Earth's centre; altitudes by astropy."""
    (tmp_path / "la.obs80").write_text(LA)
    options = ["--hours", "1,3,6,24", "--from-site", "G96", "--from-site", "F51", "--from-site", "500"]
    assert main(["alert", str(tmp_path / "la.obs80"), *options, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["fields"]
    assert [row["visible"] for row in rows] == [True, *[False] * 3, *[True] * 2, *[False] * 2, *[None] * 4]
    for row in rows[:8]:
        ours = [row[name] for name in ("altitude_deg", "sun_altitude_deg", "elongation_deg")]
        judge = judged(row["telescope"][:3], row["epoch_utc"], row["ra_deg"], row["dec_deg"])
        np.testing.assert_allclose(ours, judge, atol=0.05)
        assert row["visible"] == (judge[0] > 10.0 and judge[1] < -12.0)
        words = (row["not_seen"] or "").split(", ")
        assert ("daylight" in words) == (judge[1] > -0.833)
        assert ("twilight" in words) == (-12.0 < judge[1] < -0.833)
        assert ("below the horizon" in words) == (judge[0] < 0.0)
        assert ("too low" in words) == (0.0 < judge[0] < 10.0)
    assert rows[8]["altitude_deg"] is rows[8]["sun_altitude_deg"] is rows[8]["not_seen"] is None
    assert rows[8]["elongation_deg"] == pytest.approx(167.0, abs=1.0)


def test_what_cannot_be_seen_is_recommended_nowhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At 14:36 UTC the Sun was 27 deg up at Mt Lemmon; until dawn, the object at 20 deg, it could be seen."""
    (tmp_path / "la.obs80").write_text(LA)
    out = tmp_path / "out"
    assert main(["alert", str(tmp_path / "la.obs80"), "--hours", "6", "--decide", "-o", str(out)]) == 0
    said, found = capsys.readouterr(), summary_of(out)
    jsonschema.validate(found, json.loads(SCHEMAS["alert"].read_text("utf-8")))
    assert found["decisions"] == []
    assert "--decide: left out, as it cannot be observed then: G96" in said.err
    assert "not possible: daylight, below the horizon" in said.out
    then = found["next_visible"]
    height, sun, _ = judged("G96", then["epoch_utc"], 242.3, -11.4)
    assert height > 10.0
    assert sun < -12.0
    words = "t none of the times asked for can it be observed"
    assert f"{words} (daylight, below the horizon); the first chance is G96" in said.out
    head = make_alert_page(out).split('id="verdict"')[1].split("</section>")[0]
    assert f"A{words}" in head
    assert "sees it at" not in head


def test_a_folder_that_does_not_say_what_can_be_seen_is_still_read(answer: Path, tmp_path: Path) -> None:
    folder = tmp_path / "earlier"
    shutil.copytree(answer, folder)
    summary = summary_of(folder)
    del summary["next_visible"]
    for row in summary["fields"]:
        for name in ("altitude_deg", "sun_altitude_deg", "elongation_deg", "visible", "not_seen"):
            del row[name]
    (folder / "summary.json").write_text(json.dumps(summary))
    assert main(["report", str(folder)]) == 0
    assert "sees it at" in (folder / "report.html").read_text("utf-8")


def test_a_spacecraft_whose_place_is_not_known_is_stood_in_for_by_the_earth_and_it_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = made(KINDS["space telescope, main belt"], Ephemeris.load())
    (tmp_path / "kind.psv").write_text(truth.text, "utf-8")
    assert main(["alert", str(tmp_path / "kind.psv"), "--hours", "1"]) == 0
    said = capsys.readouterr()
    assert "told from the Earth's centre (500): C51" in said.err
    assert "500 (Geocentric)" in said.out


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([0], "one observation: a direction is known and no motion"),
        ([0, 0], "no motion"),
    ],
)
def test_one_time_of_observation_is_no_answer(
    lines: list[int], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = LA.splitlines()
    text = "\n".join(rows[k] for k in lines)
    if len(lines) > 1:  # the same time by another station
        text = f"{rows[0]}\n{rows[0][:-3]}V06"
    (tmp_path / "one.obs80").write_text(text + "\n")
    assert main(["alert", str(tmp_path / "one.obs80")]) == 1
    assert words in capsys.readouterr().err


def test_a_fit_of_an_arc_too_short_answers_with_a_probability(
    answer: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What `fit` called wrong input, or nothing: a status, the family of the orbit, a probability."""
    observations = answer.parent / "la.obs80"
    assert main(["fit", str(observations), "-o", str(tmp_path / "fit")]) == 0
    out = capsys.readouterr().out
    assert "not observable:" in out
    assert "Probability to hit the Earth within 100 days" in out
    found, alone = summary_of(tmp_path / "fit"), summary_of(answer)
    jsonschema.validate(found, json.loads(SCHEMAS["fit"].read_text("utf-8")))
    assert found["fit"]["status"] == "not_observable"
    assert found["first_hour"]["probability"] == pytest.approx(alone["probability"], rel=1e-9)
    assert "Probability to hit the Earth" in (tmp_path / "fit" / "report.html").read_text("utf-8")


def test_two_observations_tell_of_the_prior_alone_and_it_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "two.obs80").write_text("\n".join(LA.splitlines()[:2]) + "\n")
    assert main(["alert", str(tmp_path / "two.obs80"), "--json"]) == 0
    out = capsys.readouterr().out
    found = json.loads(out)
    assert any("two observations tell a direction and a motion" in text for text in found["warnings"])
    assert set(found["by_prior"]) == {"uniform", "cartesian"}
    assert found["orbit_status"] == "not_observable"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--within", "100"], "--within: needs a duration with a unit"),
        (["--within", "100"], 'try "100 d"'),
        (["--within", "0"], "--within: needs more than 0"),
        (["--within", "-1 d"], "--within:"),
        (["--smallest", "5"], 'try "5 m"'),
        (["--smallest", "2 kg"], "--smallest:"),
        (["--hours", "1,x"], "--hours: needs numbers"),
        (["--hours", "-1"], "--hours:"),
        (["--seed", "-1"], "--seed: -1"),
        (["--from-site", "ZZZ"], "an observer is"),
        (["--split", "--history"], "--split:"),
        (["--to", "2018-06-02T08:00"], "--to:"),
        (["--by", "G96"], "--by G96: chooses telescopes of a mission"),
        (["--hours", "1e9"], "numbers from 0 to 87600"),
        (["--hours", "nan"], "numbers from 0 to 87600"),
    ],
)
def test_wrong_options_are_named(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "la.obs80").write_text(LA)
    assert main(["alert", str(tmp_path / "la.obs80"), *options]) == 2
    assert words in capsys.readouterr().err


def test_a_station_without_a_place_and_no_file_are_wrong_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "space.obs80").write_text(LA.replace("G96", "C51").replace("tC2018", " C2018"))
    assert main(["alert", str(tmp_path / "space.obs80")]) == 2
    assert "C51" in capsys.readouterr().err
    assert main(["alert"]) == 2
    assert main(["alert", str(tmp_path / "none.obs80")]) == 2


def test_a_night_is_answered_object_by_object_and_one_without_an_answer_stops_nobody(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = "     K14A00A* C2014 01 01.26257 05 32 35.55 +13 59 45.0          19.1 Vq~0yn5G96\n"
    (tmp_path / "night.obs80").write_text(alone + LA)
    assert main(["alert", str(tmp_path / "night.obs80"), "--split", "--hours", "1"]) == 1
    said = capsys.readouterr()
    assert "2018 LA: P 0.1" in said.out
    assert "2014 AA: one observation" in said.err


def test_a_fit_of_every_object_tells_a_probability_below_an_arc_too_short(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Three records are no orbit, and no failure; a single one of another object has no answer, which is one."""
    alone = "     K14A00A* C2014 01 01.26257 05 32 35.55 +13 59 45.0          19.1 Vq~0yn5G96\n"
    (tmp_path / "night.obs80").write_text(alone + "\n".join(LA.splitlines()[:3]) + "\n")
    assert main(["fit", str(tmp_path / "night.obs80"), "--split", "-o", str(tmp_path / "night")]) == 1
    said = capsys.readouterr()
    assert "  2018 LA: P 0.0" in said.out
    assert "2014 AA" in said.err
    assert "2018 LA" not in said.err
    found = summary_of(tmp_path / "night" / "2018-LA")["first_hour"]
    assert found["low"] <= found["probability"] <= found["high"]


def test_records_hours_later_leave_no_good_one_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A fifth record, made up of an orbit at 0.0079 au that fits the four, with an error of 0.5 arcsec.

    The best curve of all goes far away at a thousand km/s; two good records were left out, as no orbit about it fits.
    """
    later = "     K18L00A  C2018 06 02.48394416 04 50.990-11 45 59.34         18.0 GV~2i5UG96\n"
    (tmp_path / "later.obs80").write_text(LA + later)
    assert main(["alert", str(tmp_path / "later.obs80"), "--hours", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["rejected"] == []
    assert found["quantities"]["range_au"]["q025"] < 0.00786 < found["quantities"]["range_au"]["q975"]


@pytest.mark.long
def test_what_one_more_observation_would_do_is_told(answer: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Whom it asks is who observed last; chances and quantiles of the probability afterwards are in order."""
    observations = str(answer.parent / "la.obs80")
    assert main(["alert", observations, "--decide", "--hours", "2", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["decisions"]
    assert row["telescope"].startswith("G96")
    assert 0.0 <= row["settles_low"] <= row["settles"] <= row["settles_high"] <= 1.0
    assert row["settles_high"] - row["settles_low"] > 0.2  # of a dozen truths
    assert row["quantiles"]["q16"] <= row["quantiles"]["median"] <= row["quantiles"]["q84"]


def test_by_an_unknown_telescope_is_wrong_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["alert", "first-hours", "--by", "nobody"]) == 2
    assert "nobody" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("", 2, "no observations in this file"),
        ("# nothing\n# here\n", 2, "no observations in this file"),
        ("hello world this is not a record\n", 2, ":1:"),
        (LA.replace("G96", "XXX"), 2, "observatory codes"),
        (LA.replace("G96", "247"), 2, "has no fixed place"),
        (LA.replace(" tC2018", " tS2018").replace("G96", "C57"), 2, "tells where the spacecraft was"),
        (LA.replace("C2018", "C2890"), 2, "allowed 1800 to 2199"),
        (LA + LA.splitlines()[3].replace("2018 06 02", "2021 06 02") + "\n", 1, "use nebosvod fit"),
        (LA.splitlines()[0] + "\n" + LA.splitlines()[0] + "\n", 1, "one observation"),
    ],
)
def test_odd_files_end_with_a_sentence(
    text: str, code: int, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "odd.obs80").write_text(text)
    assert main(["alert", str(tmp_path / "odd.obs80")]) == code
    said = capsys.readouterr()
    assert words in said.err
    assert "Traceback" not in said.err
    assert not said.out


def test_several_objects_are_named_where_one_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = LA.splitlines()
    mixed = "\n".join([*rows[:2], *(row.replace("K18L00A", "K18L00B") for row in rows[2:])]) + "\n"
    (tmp_path / "mixed.obs80").write_text(mixed)
    assert main(["alert", str(tmp_path / "mixed.obs80")]) == 2
    assert "2018 LB" in capsys.readouterr().err


# four directions that circle the pole in 20 minutes, as of a satellite: least squares find no start that can be flown
POLE = "".join(
    f"{row[:32]}{f'{5 * k % 24:02d} 11 10.34 +89 59 {34.9 + 5 * k:04.1f}':<24}{row[56:]}\n"
    for k, row in enumerate(LA.splitlines())
)


@pytest.mark.parametrize("split", [False, True])
def test_a_fit_without_any_orbit_is_answered_by_its_first_hour(
    split: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With why there is no orbit, and without the hint to try least squares, which were."""
    (tmp_path / "pole.obs80").write_text(POLE)
    options = ["--split"] if split else []
    assert main(["fit", str(tmp_path / "pole.obs80"), *options, "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    assert "no orbit by least squares: no starting orbit can be followed over the arc" in said.err
    assert "P < " in said.out if split else "Probability to hit the Earth within 100 days: below" in said.out
    assert "nebosvod fit" not in said.out
    folder = tmp_path / "out" / "2018-LA" if split else tmp_path / "out"
    assert summary_of(folder)["kind"] == "alert"
    assert str(folder) in said.out


def test_directions_that_leap_and_magnitudes_that_are_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Faster than light at half an au ended in a sentence about an integrated span; 99.9 gave an H of 111."""
    leaps = [f"{7 * k % 24:02d} 11 10.34 {'+-'[k % 2]}{20 * k:02d} 19 34.9" for k in range(4)]
    text = "".join(f"{row[:32]}{leap:<24}{row[56:]}\n" for row, leap in zip(LA.splitlines()[:3], leaps, strict=False))
    (tmp_path / "leaps.obs80").write_text(text)
    assert main(["alert", str(tmp_path / "leaps.obs80")]) == 1
    assert "see whether they are all of one object" in capsys.readouterr().err
    (tmp_path / "none.obs80").write_text("".join(f"{row[:65]}99.9 V{row[71:]}\n" for row in LA.splitlines()))
    assert main(["alert", str(tmp_path / "none.obs80"), "--hours", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["V"] is None
    assert "H" not in found["quantities"]


def test_a_time_shorter_than_the_hours_asked_for_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "la.obs80").write_text(LA)
    assert main(["alert", str(tmp_path / "la.obs80"), "--within", "2 h", "--hours", "1,3"]) == 0
    said = capsys.readouterr()
    assert "Probability to hit the Earth within 2 h: below" in said.out
    assert "--hours 3: left out, after the 2 h in which an impact counts" in said.err


def test_a_mission_is_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["alert", "first-hours", "--split"]) == 2
    assert "--split: first-hours is a mission" in capsys.readouterr().err


def test_what_many_objects_have_in_common_is_said_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "".join(f"{row}\n" for row in LA.splitlines()[:2])
    (tmp_path / "night.obs80").write_text(rows + rows.replace("K18L00A", "K18L00B"))
    assert main(["alert", str(tmp_path / "night.obs80"), "--split", "--hours", "1"]) == 0
    assert capsys.readouterr().err.count("two observations tell a direction and a motion") == 1


def test_an_answer_of_an_earlier_program_is_refused_by_what_it_lacks(
    answer: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "earlier"
    shutil.copytree(answer, folder)
    summary = summary_of(folder)
    del summary["impact"]["contours_deg"]
    (folder / "summary.json").write_text(json.dumps(summary))
    assert main(["report", str(folder)]) == 2
    assert "impact.contours_deg: the file lacks it; make the run again" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["compare", "FOLDER", "FOLDER"], "of which no two are compared"),
        (["ephemeris", "FOLDER", "--from", "2018-06-02", "--to", "2018-06-03"], "holds no orbit"),
        (["risk", "FOLDER", "--until", "2020-01-01"], "holds no orbit"),
    ],
)
def test_who_cannot_use_an_answer_says_so(
    command: list[str], words: str, answer: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(answer) if word == "FOLDER" else word for word in command]) == 2
    assert words in capsys.readouterr().err


def numbers_of(page: str, figure: str) -> list[float]:
    """Those of the paths of a figure."""
    found = re.search(rf'id="{figure}".*?</svg>', page, re.DOTALL)
    assert found is not None
    numbers = [
        float(number) for path in re.findall(r' d="([^"]*)"', found[0]) for number in re.findall(r"-?[\d.]+", path)
    ]
    assert len(numbers) > 500
    return numbers


def test_a_picture_of_the_sky_knows_no_0_h_and_is_squeezed_by_nobody(answer: Path, tmp_path: Path) -> None:
    """Turned about the pole to 0 h it is the same; with one orbit 20 deg away, too, and the caption tells."""
    page = make_alert_page(answer)
    folder = tmp_path / "turned"
    shutil.copytree(answer, folder)
    summary = summary_of(folder)
    field = summary["fields"][0]
    turn = field["ra_deg"]
    field["ra_deg"] = 0.0
    for edges in field["contours_deg"].values():
        for edge in edges:
            for point in edge:
                point[0] = (point[0] - turn) % 360.0
    with np.load(folder / "arrays.npz") as stored:
        arrays = dict(stored)
    arrays["field_psi_0"][:, 0] = (arrays["field_psi_0"][:, 0] - np.radians(turn)) % (2.0 * np.pi)
    (folder / "summary.json").write_text(json.dumps(summary))
    np.savez(folder / "arrays.npz", **arrays)
    turned = make_alert_page(folder)
    np.testing.assert_allclose(numbers_of(turned, "field-0"), numbers_of(page, "field-0"), atol=0.1)
    arrays["field_psi_0"][7] += np.radians(20.0)
    np.savez(folder / "arrays.npz", **arrays)
    spoiled = make_alert_page(folder)
    outside = r"(\d) of 300 drawn orbits lie outside of the picture"
    told, before = ([int(n) for n in re.findall(outside, text)] for text in (spoiled, turned))
    assert sum(told) == sum(before) + 1
    lines = len(numbers_of(turned, "field-0")) - len(numbers_of(spoiled, "field-0"))
    assert abs(lines) < 10  # of a dot


def test_the_head_of_the_page_tells_each_number_once(answer: Path) -> None:
    head = make_alert_page(answer).split('id="verdict"')[1].split("</section>")[0]
    found = summary_of(answer)
    best, (p, low, high) = found["quantities"]["range_au"], (found[key] for key in ("probability", "low", "high"))
    assert head.count(f"{p:.3g} ({low:.3g} to {high:.3g})") == 1
    assert f"{best['median']:.3g} au within a factor of 1.7" in head
    assert "probability, 95 %" not in head


def test_a_folder_in_the_way_is_told_before_anything_is_computed_and_stops_no_night(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = tmp_path / "la.obs80"
    made.write_text(LA, "ascii")
    night = tmp_path / "night"
    (night / "2018-LA").mkdir(parents=True)
    (night / "2018-LA" / "mine.txt").write_text("kept", "utf-8")
    assert main(["alert", str(made), "--split", "-o", str(night), "--hours", "1"]) == 3
    told = capsys.readouterr()
    assert told.out.startswith("2018 LA: P 0.1")  # the answer is not lost
    assert "1 of 1 folder could not be written" in told.err
    assert "2018-LA: exists already and is not a run folder" in told.err
    monkeypatch.setattr("nebosvod.commands.alert_work.found_for", lambda *_: pytest.fail("computed first"))
    assert main(["alert", str(made), "-o", str(night / "2018-LA"), "--hours", "1"]) == 3
    assert (night / "2018-LA" / "mine.txt").read_text("utf-8") == "kept"


def test_nothing_is_to_settle_where_the_probability_is_a_bound(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = tmp_path / "la.obs80"
    made.write_text(LA, "ascii")
    assert main(["alert", str(made), "--within", "0.1 h", "--hours", "0.05", "--decide", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["probability"] is None
    assert told["decisions"] == []
    assert any(text.startswith("--decide: ") and "nothing to settle" in text for text in told["warnings"])


def test_bounds_regions_and_the_course_are_told_in_numbers(answer: Path, tmp_path: Path) -> None:
    """A prior's bound is no 0, the place of fall is a table, intervals stand over decades, what is left out is said."""
    folder = tmp_path / "out"
    shutil.copytree(answer, folder)
    summary = summary_of(folder)
    summary["by_prior"]["cartesian"] |= {"probability": None, "low": 0.0, "high": 1.1e-4, "bound": True}
    summary["history"] = [
        {
            "n_observations": n, "epoch_utc": f"2018-06-02T08:{15 + n}:00 UTC", "effective_nodes": 50.0,
            "sigma_log_range": 0.5, "range_au": 0.004, "chances": summary["by_prior"],
            "corridor": summary["impact"] if n == 4 else None,
        }
        for n in (3, 4)
    ]  # fmt: skip
    summary["decisions"] = []
    summary["fields"] = 5 * summary["fields"]
    (folder / "summary.json").write_text(json.dumps(summary))
    with np.load(folder / "arrays.npz") as stored:
        arrays = dict(stored)
    np.savez(folder / "arrays.npz", **arrays, **{f"field_psi_{k}": arrays["field_psi_0"] for k in range(3, 15)})
    page = make_alert_page(folder)
    assert "the prior decides, from &lt; 1.1" in page
    assert "from 0 to" not in page
    place = page.split('id="table-fall"')[1].split("</table>")[0]
    assert f"{summary['impact']['longitude_deg']['median']:.2f}" in place
    for share in (68, 95):
        assert f"{share} % of them" in page
    assert 'data-y="log ' in page.split('id="chances-by-time"')[1].split("</svg>")[0]
    course = page.split('id="table-history"')[1].split("</table>")[0]
    assert f"{summary['impact']['longitude_deg']['q025']:.2f} to" in course
    assert "The first 6 of 15 are drawn." in page
    said = "\n".join(alert_lines(summary))
    assert "and 3 more (summary.json, page)" in said
    assert "the prior decides" in said
    assert "uniform in space and velocity < 0.00011" in said
