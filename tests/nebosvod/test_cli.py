"""The command line: what a newcomer sees, exit codes, and how fast it starts."""

import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

from nebosvod import __version__
from nebosvod.cli import main
from nebosvod.commands.start import ANSWERS
from nebosvod.mission import load_mission

MADE = Path(__file__).parent / "everything" / "made.obs80"
EVERYTHING = MADE.with_name("fit.yaml")
HEAVY = ("numba", "scipy", "astropy", "matplotlib", "jplephem", "jinja2", "rich")


def modules_after(code: str) -> set[str]:
    """Names of all modules loaded in a fresh interpreter after some code."""
    script = f"import sys\n{code}\nprint('MODULES', *sorted(sys.modules), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True)
    return set(done.stderr.split("MODULES ", 1)[1].split())


def test_importing_the_package_loads_nothing_but_itself() -> None:
    loaded = modules_after("import nebosvod")
    assert not {name for name in loaded if name.split(".")[0] in (*HEAVY, "numpy", "pydantic", "click", "erfa")}


def test_importing_the_command_line_loads_click_and_errors_only() -> None:
    loaded = modules_after("import nebosvod.cli")
    own = {name for name in loaded if name.startswith("nebosvod")}
    leaves = {"nebosvod.errors", "nebosvod.version", "nebosvod.borders"}
    assert own == {"nebosvod", "nebosvod.cli", *leaves, "nebosvod.borders.interrupts", "nebosvod.borders.moved"}
    assert not {name for name in loaded if name.split(".")[0] in (*HEAVY, "numpy", "pydantic", "yaml", "erfa")}


@pytest.mark.parametrize("command", ["['missions']", "['schema']", "['--help']", "['validate', '--help']"])
def test_light_commands_do_not_load_heavy_modules(command: str) -> None:
    loaded = modules_after(f"from nebosvod.cli import main\nassert main({command}) == 0")
    assert not {name for name in loaded if name.split(".")[0] in HEAVY}


def test_check_loads_what_flies_an_orbit_and_nothing_that_draws_or_solves() -> None:
    loaded = modules_after("from nebosvod.cli import main\nassert main(['check', 'apophis-2029']) == 0")
    assert not {name for name in loaded if name.split(".")[0] in ("astropy", "matplotlib", "jinja2", "rich")}
    assert not {name for name in loaded if name.startswith(("nebosvod.estimation.solvers", "nebosvod.report"))}


@pytest.mark.smoke
def test_version_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert __version__ in capsys.readouterr().out
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    for command in ("run", "check", "init", "missions", "report", "schema", "validate", "plan", "compare"):
        assert command in text
    assert "Exit codes" in text
    assert "..." not in text.partition("Commands:")[2]  # no summary is cut


@pytest.mark.parametrize(
    "argv",
    [
        ["fly"],
        ["run"],
        ["run", "minimal", "--fast"],
        ["run", "minimal", "--seed", "-1"],
        ["run", "minimal", "--seed", "x"],
        ["validate"],
        ["validate", "minimal", "--workers", "0"],
        ["validate", "minimal", "--runs", "many"],
        ["plan"],
        ["plan", "minimal", "-p", "x", "--criterion", "e"],
    ],
)
def test_wrong_arguments_are_exit_2_with_usage(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(argv) == 2
    err = capsys.readouterr().err
    assert "Usage" in err
    assert "Traceback" not in err


@pytest.mark.smoke
def test_missions_lists_the_built_in_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["missions"]) == 0
    out = capsys.readouterr().out
    for name in ("apophis-2029", "apophis-heliocentric", "minimal"):
        assert name in out


@pytest.mark.parametrize("mission", ["apophis-2029", "apophis-heliocentric", "minimal"])
def test_check_prints_what_a_mission_resolves_to(mission: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", mission]) == 0
    out = capsys.readouterr().out
    loaded = load_mission(mission)
    for telescope in loaded.telescopes:
        assert telescope.name in out
    assert "cost" in out
    assert "nothing was run" in out


def test_init_writes_a_mission_that_checks_and_never_overwrites(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "my mission.yaml"
    assert main(["init", str(path)]) == 0
    text = path.read_text("utf-8")
    assert "#" in text
    assert main(["check", str(path)]) == 0
    assert main(["init", str(path)]) == 3
    assert path.read_text("utf-8") == text
    assert main(["init", str(tmp_path / "mission.txt")]) == 2
    assert "ends in .yaml" in capsys.readouterr().err


def test_schema_prints_the_json_schema(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["type"] == "object"
    assert "telescopes" in schema["properties"]


@pytest.mark.parametrize("answer", [*ANSWERS])
def test_schema_prints_that_of_every_answer(answer: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema", "--answer", answer]) == 0
    schema = json.loads(capsys.readouterr().out)
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["properties"].get("kind", {}).get("const") in (None, answer)
    assert main(["schema", "--answer", answer, "--fit"]) == 2
    assert "one file at a time" in capsys.readouterr().err


def test_an_unknown_built_in_name_gets_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "apofis-2029"]) == 2
    assert "apophis-2029" in capsys.readouterr().err


def test_an_unobservable_problem_is_exit_1_with_the_weak_direction(
    tmp_path: Path, minimal_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two measurements at one time, no prior: rank below 6, the direction named, no covariance anywhere."""
    path = tmp_path / "short.yaml"
    path.write_text(minimal_text.replace("end: 2028-04-19T00:00:00 TDB", "end: 2028-03-20T00:00:00 TDB"), "utf-8")
    assert main(["run", str(path), "-o", str(tmp_path / "run")]) == 1
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    found = summary["estimators"][0]
    assert summary["n_observations"] == 2
    assert found["status"] == "not_observable"
    assert found["rank"] < found["n_estimated"]
    assert found["weak_direction"]
    assert found["covariance_km_km_s"] is None
    assert "not determine" in capsys.readouterr().out
    assert (tmp_path / "run" / "report.html").is_file()


def test_an_iteration_that_does_not_converge_is_exit_1_with_the_last_state(
    tmp_path: Path, minimal_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "hurried.yaml"
    path.write_text(minimal_text + "estimators: [{name: hurried, method: batch_qr, iterations: 1}]\n", "utf-8")
    assert main(["run", str(path), "-o", str(tmp_path / "run")]) == 1
    found = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))["estimators"][0]
    assert found["status"] == "iteration_limit"
    assert len(found["state_km_km_s"]) == 6
    assert "iteration limit was reached" in capsys.readouterr().out


def test_trouble_of_the_system_is_exit_3_and_names_the_file(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse() -> None:
        raise OSError(28, "No space left on device", "cache.nbi")

    monkeypatch.setattr("nebosvod.mission.list_missions", refuse)
    assert main(["missions"]) == 3
    assert "cache.nbi: No space left on device" in capsys.readouterr().err


def test_nothing_visible_is_exit_1_and_says_which_limit(
    tmp_path: Path, minimal_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "blind.yaml"
    text = minimal_text.replace(
        "noise: {sigma: 0.1 arcsec}", "noise: {sigma: 0.1 arcsec}\n    exclusion: {sun: 179 deg}"
    )
    path.write_text(text, "utf-8")
    assert main(["run", str(path), "-o", str(tmp_path / "run")]) == 1
    err = capsys.readouterr().err
    assert "sun 31" in err
    assert "ahead" in err
    assert not (tmp_path / "run").exists()


def test_an_epoch_outside_the_ephemeris_is_wrong_input_with_the_span(
    tmp_path: Path, minimal_text: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    excerpt = Path(__file__).resolve().parents[2] / "dynamics" / "data" / "de440_1990_2060.bsp"
    monkeypatch.setenv("NEBOSVOD_EPHEMERIS", str(excerpt))  # whatever else is installed
    path = tmp_path / "far.yaml"
    path.write_text(minimal_text.replace("2028", "2300"), "utf-8")
    assert main(["run", str(path), "-o", str(tmp_path / "run")]) == 2
    err = capsys.readouterr().err
    assert "1990" in err
    assert "2060" in err


def test_a_damaged_ephemeris_is_exit_3(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "de440.bsp"
    broken.write_bytes(b"DAF/SPK " + bytes(5000))
    monkeypatch.setenv("NEBOSVOD_EPHEMERIS", str(broken))
    assert main(["run", "minimal", "-o", str(tmp_path / "run")]) == 3
    assert "de440.bsp" in capsys.readouterr().err


def test_an_internal_error_writes_a_crash_file_instead_of_a_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("nebosvod.mission.list_missions", lambda: 1 / 0)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert main(["missions"]) == 4
    err = capsys.readouterr().err
    assert "Traceback" not in err
    (crash,) = tmp_path.glob("nebosvod-crash-*.txt")
    assert str(crash) in err
    assert "ZeroDivisionError" in crash.read_text("utf-8")
    with pytest.raises(ZeroDivisionError):
        main(["--debug", "missions"])


def test_output_has_no_colour_when_it_is_not_a_terminal(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "nebosvod", "run", "minimal", "-o", str(tmp_path / "run")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert "\x1b" not in done.stdout
    assert done.stderr == ""
    assert str(tmp_path / "run" / "report.html") in done.stdout.replace("\n", "")


def test_the_answer_names_every_kind_of_prediction_with_its_unit(
    tmp_path: Path, minimal_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "planes.yaml"
    at = "at: 2028-04-29T00:00:00 TDB"
    rows = [f"  - {{name: p{i}, plane: {plane}, {at}}}" for i, plane in enumerate(("rtn", "rtn_velocity", "position"))]
    rows.append(f"  - {{name: seen, plane: sky, from: ahead, {at}}}")
    path.write_text(minimal_text + "\n".join(rows) + "\n", "utf-8")
    assert main(["run", str(path), "-o", str(tmp_path / "run")]) == 0
    out = capsys.readouterr().out
    for unit in (" km", " m/s", " arcsec"):
        assert unit in out


def test_a_closed_pipe_is_not_an_error() -> None:
    command = f"{sys.executable} -m nebosvod schema | head -c 10"
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, timeout=60, check=False
    )
    assert "Traceback" not in done.stderr
    assert done.stdout.startswith("{")


def test_a_run_does_not_load_what_only_fits_and_campaigns_need(tmp_path: Path) -> None:
    """scipy.stats alone is a quarter of a second."""
    folder = str(tmp_path / "run")
    loaded = modules_after(f"from nebosvod.cli import main\nassert main(['run', 'minimal', '-o', {folder!r}]) == 0")
    assert not {name for name in loaded if name.split(".")[:2] == ["scipy", "stats"]}


ODD_WORDS = ("", " ", "\x1b[31m", "a\nb", "a" * 5000, "\udcff", "☄", "nan", "1e400", "-1", "9" * 400)


@pytest.mark.parametrize("word", ODD_WORDS, ids=range(len(ODD_WORDS)))
@pytest.mark.parametrize(
    "command",
    [
        ("fit", str(MADE), "--object"), ("fit", str(MADE), "--object", "2024 AA1", "--object"),
        ("fit", str(MADE), "--from"),
        ("fit", str(EVERYTHING), "--object"), ("fit", str(MADE), "--suggest"), ("plan", "minimal", "--estimator"),
        ("plan", "minimal", "-p", "ten days later", "--step"), ("validate", "minimal", "--runs"),
        ("run", "minimal", "--seed"), ("report",), ("run",), ("check",), ("fit",),
    ],
    ids=" ".join,
)  # fmt: skip
def test_an_odd_word_on_the_command_line_is_wrong_input_told_on_one_safe_line(
    command: tuple[str, ...],
    word: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*command, word]) in (2, 3)  # 3: no file can have a name of 5000 letters
    said = capsys.readouterr().err
    assert "Traceback" not in said
    assert all(line.isprintable() and (len(line) < 1000 or "Invalid value" in line) for line in said.splitlines())
    assert sum(line.lower().startswith("error: ") for line in said.split("\n")) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_folder_whose_name_holds_a_line_break_is_told_on_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "new\nline\x1b[31m"
    for _ in range(2):
        code = main(["run", "minimal", "-o", str(folder)])
        said = capsys.readouterr().err
    assert code == 3
    advice = "use --overwrite to replace that run, or -o for another folder"
    assert said.splitlines() == [f"error: {tmp_path}/new\\nline\\x1b[31m: exists already; {advice}"]


def test_a_file_where_a_folder_is_needed_is_called_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("x")
    for command in (["run", "minimal", "-o"], ["fit", str(MADE), "-o"], ["validate", "minimal", "--runs", "60", "-o"]):
        assert main([*command, str(tmp_path / "file" / "x")]) == 3
        assert "a file stands where a folder is needed" in capsys.readouterr().err
