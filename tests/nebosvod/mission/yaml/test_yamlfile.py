"""The YAML reader: what it reads, where it says things stand, and what it refuses."""

import os
import time
from pathlib import Path

import pytest

from nebosvod.errors import DataError, InputError
from nebosvod.mission.yaml.yamlfile import MAX_BYTES, Mark, parse_yaml, read_text, scalar


def refused(text: str) -> str:
    """The message of a document that must be refused."""
    with pytest.raises(InputError) as caught:
        parse_yaml(text, "f.yaml")
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("no", "no"), ("on", "on"), ("yes", "yes"), ("1e-9", 1e-9), ("017", 17), ("0o17", 15), ("0x1F", 31),
        ("12:30:00", "12:30:00"), ("true", True), ("FALSE", False), ("null", None), ("~", None), ("", None),
        (".5", 0.5), ("-1.", -1.0), ("+3", 3), ("1_000", "1_000"), ("2028-11-15", "2028-11-15"), ("=", "="),
        ("1e400", float("inf")), ("-.inf", float("-inf")), ("0.1 arcsec", "0.1 arcsec"), ("9" * 5000, float("inf")),
    ],
)  # fmt: skip
def test_scalars_follow_the_yaml_1_2_core_rules(text: str, value: object) -> None:
    got = scalar(text)
    assert got == value
    assert type(got) is type(value)


def test_quoted_scalars_are_text() -> None:
    assert parse_yaml("a: '12'\nb: \"true\"\nc: ''\n", "f").tree == {"a": "12", "b": "true", "c": ""}


def test_nan_is_read_as_nan_for_the_models_to_refuse() -> None:
    value = scalar(".nan")
    assert isinstance(value, float)
    assert value != value


def test_every_node_has_the_place_of_its_key_and_its_value() -> None:
    file = parse_yaml("a:\n  - {b: 1, c: [x, y]}\n  - d\né: 2\n", "f.yaml")
    assert file.tree == {"a": [{"b": 1, "c": ["x", "y"]}, "d"], "é": 2}
    assert file.keys[("a",)] == Mark(1, 1)
    assert file.values[("a", 0)] == Mark(2, 5)
    assert file.values[("a", 0, "b")] == Mark(2, 9)
    assert file.values[("a", 0, "c", 1)] == Mark(2, 19)
    assert file.keys[("a", 1)] == Mark(3, 5)
    assert file.values[("é",)] == Mark(4, 4)


def test_a_duplicate_key_is_noted_with_both_lines_and_the_first_value_stays() -> None:
    file = parse_yaml("a: 1\nb: 2\na: {c: 3}\n", "f.yaml")
    assert file.tree == {"a": 1, "b": 2}
    (problem,) = file.problems
    assert problem.mark == Mark(3, 1)
    assert "line 1" in problem.text


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("a:\n\t- b", "2:1", "spaces, not tabs"),
        ("a: [1, 2\nb: 3", "2:2", "flow sequence that began on line 1"),
        ("a: 'x", "1:6", "quoted scalar"),
        ("a: 1\n b: 2", "2:3", "not YAML"),
        ("a: &x 1\nb: *x", "1:4", "aliases"),
        ("b: *x", "1:4", "aliases"),
        ("a: !!python/object/apply:os.system [id]", "1:4", "tags are not allowed"),
        ("a: !x 1", "1:4", "tags are not allowed"),
        ("---\na: 1\n---\nb: 2", "3:1", "second document"),
        ("{[a]: 1}", "1:2", "key must be plain text"),
        ("? {a: 1}\n: 2", "1:3", "key must be plain text"),
        ("a: \x00", "1:4", "U+0000"),
        ("b: 1\na: \x1b[31m", "2:4", "U+001B"),
        ("", "1:1", "empty"),
        ("# only a comment\n", "1:1", "empty"),
    ],
)  # fmt: skip
def test_what_is_not_plain_yaml_is_refused_at_its_place(text: str, place: str, words: str) -> None:
    message = refused(text)
    assert message.startswith(f"f.yaml:{place}: ")
    assert words in message


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "{a: " * 100_000, "- " * 100_000, "a: " + "[" * 100_000, "[" * 40 + "]" * 40]
)
def test_deep_nesting_is_refused_at_once(text: str) -> None:
    began = time.process_time()
    assert "nested deeper than 32" in refused(text)
    assert time.process_time() - began < 0.5  # seconds; the limit stops the parser, whatever follows


def test_nesting_up_to_the_limit_is_read() -> None:
    assert parse_yaml("[" * 32 + "]" * 32, "f").tree is not None


def test_a_billion_laughs_is_refused() -> None:
    text = "a: &a [x, x]\n" + "".join(
        f"{chr(98 + i)}: &{chr(98 + i)} [*{chr(97 + i)}, *{chr(97 + i)}]\n" for i in range(20)
    )
    assert refused(text).startswith("f.yaml:1:4: aliases")


def test_too_many_values_are_refused_in_bounded_time() -> None:
    began = time.process_time()
    assert "more than 50000 values" in refused("[" + "a," * 400_000 + "]")
    assert time.process_time() - began < 2.0  # seconds


def test_a_folder_a_pipe_and_a_device_are_refused_at_once(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path, word in ((tmp_path, "directory"), (pipe, "pipe or a device"), (Path("/dev/zero"), "pipe or a device")):
        with pytest.raises(InputError, match=word):
            read_text(path)


def test_a_file_of_two_gigabytes_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    with path.open("wb") as stream:
        stream.truncate(2 * 1024**3)  # sparse: takes no disk
    began = time.process_time()
    with pytest.raises(InputError, match=r"2147483648 bytes, larger than 1000000"):
        read_text(path)
    assert time.process_time() - began < 0.2  # seconds


def test_a_file_at_the_limit_is_read(tmp_path: Path) -> None:
    path = tmp_path / "full.yaml"
    path.write_bytes(b"#" * MAX_BYTES)
    assert len(read_text(path)) == MAX_BYTES


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"a: 1\nb: \xff\n", ":2:4: byte 0xFF is not UTF-8"),
        ("é: 1\nй: ".encode() + b"\xd0", ":2:4: byte 0xD0 is not UTF-8"),
        (b"\xff\xfea\x00", ":1:1: UTF-16 byte order mark (byte 0xFF)"),
        (b"\xfe\xff\x00a", ":1:1: UTF-16 byte order mark (byte 0xFE)"),
    ],
)
def test_what_is_not_utf8_is_refused_with_place_and_byte(tmp_path: Path, data: bytes, words: str) -> None:
    path = tmp_path / "f.yaml"
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        read_text(path)
    assert words in str(caught.value)


def test_a_utf8_byte_order_mark_and_windows_line_ends_are_accepted(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1\r\nb: x\r\n")
    file = parse_yaml(read_text(path), "f")
    assert file.tree == {"a": 1, "b": "x"}
    assert file.values[("b",)] == Mark(2, 4)


def test_names_no_file_can_have_are_refused() -> None:
    for name in ("no/such/file.yaml", "x" * 5000, "a\0b"):
        with pytest.raises(InputError):
            read_text(Path(name))


def test_a_file_the_system_does_not_let_us_read_is_an_environment_error(tmp_path: Path) -> None:
    path, me = tmp_path / "f.yaml", os.geteuid()
    path.write_text("a: 1")
    path.chmod(0)
    if me == 0:  # root may read everything: look as nobody for a moment
        os.seteuid(65534)
    try:
        with pytest.raises(DataError, match="cannot be read"):
            read_text(path)
    finally:
        os.seteuid(me)
