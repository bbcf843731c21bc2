"""Who may speak to the server of `nebosvod open`, what it refuses, and how the command begins and ends."""

import http.client
import json
import signal
import socket
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from nebosvod.workbench.desk import ChangedError, Desk
from tests.nebosvod.workbench.conftest import MISSION, Served, ended, opened

JSON = {"content-type": "application/json"}


def asked(
    served: Served, method: str, path: str, body: bytes = b"", **headers: str
) -> tuple[int, dict[str, str], bytes]:
    """Status, headers and body of an answer."""
    host = served.origin.removeprefix("http://")
    connection = http.client.HTTPConnection(host, timeout=60)
    told = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, body or None, told)
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return found


def place(served: Served, name: str = "") -> str:
    return served.address.removeprefix(served.origin) + name


def test_the_page_is_there_for_who_knows_its_address_and_for_no_other(served: Served) -> None:
    host = served.origin.removeprefix("http://")
    port = host.split(":")[1]
    status, headers, body = asked(served, "GET", place(served))
    assert (status, b"<textarea" in body) == (200, True)
    assert "default-src 'none'" in headers["content-security-policy"]
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"
    assert asked(served, "GET", "/")[0] == 404
    assert asked(served, "GET", "/start")[0] == 404
    assert asked(served, "GET", place(served)[:-2] + "/start")[0] == 404  # a letter is missing
    assert asked(served, "GET", place(served, "start"), host=f"evil.example:{port}")[0] == 421  # its name leads here
    assert asked(served, "GET", place(served, "start"), host="127.0.0.1")[0] == 421
    assert asked(served, "GET", place(served, "start"), host=f"localhost:{port}")[0] == 200
    assert asked(served, "GET", place(served, "start"), sec_fetch_site="cross-site")[0] == 403
    for name in ("", "start", "report"):  # a link in another page may open the page, whoever knows its address; no more
        going = {"sec_fetch_site": "cross-site", "sec_fetch_mode": "navigate", "sec_fetch_dest": "document"}
        assert asked(served, "GET", place(served, name), **going)[0] == (403 if name else 200)
        assert asked(served, "GET", place(served, name), **{**going, "sec_fetch_dest": "iframe"})[0] == 403
    assert asked(served, "GET", place(served, "start"), origin="https://evil.example")[0] == 403
    assert asked(served, "GET", place(served, "../pyproject.toml"))[0] == 404
    assert asked(served, "GET", place(served, "desk.py"))[0] == 404


@pytest.mark.parametrize("name", ["look", "edit", "save", "run", "stop"])
def test_only_the_page_itself_may_ask_for_something_to_be_done(served: Served, name: str) -> None:
    body = json.dumps({"text": "x", "mark": "", "path": [], "verb": "run", "slug": "x", "overwrite": True}).encode()
    before = served.file.read_bytes()
    for headers in ({}, {"origin": "null"}, {"origin": "http://evil.example"}, {"origin": "http://127.0.0.1:1"}):
        assert asked(served, "POST", place(served, name), body, **JSON, **headers)[0] == 403
    assert asked(served, "POST", place(served, name), body, origin=served.origin)[0] == 400  # as a foreign form would
    assert asked(served, "GET", place(served, name))[0] == 405
    assert served.file.read_bytes() == before


def test_what_is_posted_is_held_to_what_the_address_takes(served: Served) -> None:
    for body in (b"{", b"[]", b'{"text": 3}', b"{}", b"[" * 100_000, b'{"text": "' + b"x" * 9_000_000 + b'"}'):
        status, _, said = asked(served, "POST", place(served, "look"), body, **JSON, origin=served.origin)
        assert status == 400
        assert "text" in json.loads(said)
    for slug in ("../x", "a/b", "", ".x"):
        body = json.dumps(
            {"verb": "run", "slug": slug, "mark": Desk(str(served.file)).mark(), "overwrite": False}
        ).encode()
        assert asked(served, "POST", place(served, "run"), body, **JSON, origin=served.origin)[0] == 400


def test_a_port_that_is_taken_is_told_and_one_that_is_named_is_used_until_a_signal(tmp_path: Path) -> None:
    (tmp_path / "desk.yaml").write_text(MISSION, "utf-8")
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        done = program(tmp_path, "desk.yaml", "--port", str(port))
        assert done.returncode == 3
        assert done.stderr.startswith(f"error: port {port}: Address already in use; give another --port")
    served = opened(tmp_path, "desk.yaml", "--port", str(port))
    assert served.origin == f"http://127.0.0.1:{port}"
    body = json.dumps({"verb": "run", "slug": "desk", "mark": Desk(str(served.file)).mark(), "overwrite": False})
    host = served.origin.removeprefix("http://")
    connection = http.client.HTTPConnection(host, timeout=60)
    connection.request("POST", place(served, "run"), body, {**JSON, "origin": served.origin})
    assert json.loads(connection.getresponse().readline())["step"] == "running"
    ended(served, signal.SIGTERM)  # a run goes on: it ends with the server, and nothing is left of it
    connection.close()
    assert [path.name for path in tmp_path.iterdir()] == ["desk.yaml"]


def program(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "nebosvod", "open", "--no-browser", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60, check=False)


def test_what_is_no_text_is_refused_before_anything_is_served(tmp_path: Path, capsys: Any) -> None:
    from nebosvod.cli import main

    (tmp_path / "latin.yaml").write_bytes(b"name: caf\xe9\n")
    (tmp_path / "large.yaml").write_bytes(b"#" * 1_000_001)
    for name, code, said in (
        ("none.yaml", 2, "no such file"),
        ("minimul", 2, 'did you mean "minimal"'),
        ("", 2, "is a directory"),
        ("latin.yaml", 2, "latin.yaml:1:10: byte 0xE9 is not UTF-8"),
        ("large.yaml", 2, "larger than 1000000"),
    ):
        assert main(["open", name if name == "minimul" else str(tmp_path / name), "--no-browser"]) == code
        assert said in capsys.readouterr().err


@pytest.mark.parametrize("missing", ["starlette", "uvicorn"])
def test_without_the_extra_a_sentence_names_it(missing: str, tmp_path: Path) -> None:
    code = f"import sys; sys.modules['{missing}'] = None; from nebosvod.cli import main; sys.exit(main(['open', 'minimal']))"  # noqa: E501
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert done.stderr == (
        f"error: nebosvod open needs {missing}, which comes with the extra page: pip install 'nebosvod[page]'\n"
    )


def test_a_file_is_saved_as_it_was_kept_and_only_where_it_says_what_was_read(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_bytes(b"# one\r\nname: x\r\n")
    file.chmod(0o600)
    desk = Desk(str(file))
    text, mark = desk.read()
    mark = desk.save(text.replace("\r\n", "\n").replace("x", "y"), mark)
    assert file.read_bytes() == b"# one\r\nname: y\r\n"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    file.write_bytes(b"name: theirs\n")
    with pytest.raises(ChangedError, match="has changed on disk since it was read here; nothing was written"):
        desk.save("name: mine\n", mark)
    file.unlink()
    with pytest.raises(ChangedError, match="is gone from disk since it was read here; nothing was written"):
        desk.save("name: mine\n", mark)
    assert list(tmp_path.iterdir()) == []


def test_a_built_in_mission_becomes_a_file_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    desk = Desk("minimal")
    text, mark = desk.read()
    assert (mark, desk.saved, desk.argument) == ("", False, "minimal")
    (tmp_path / "minimal.yaml").write_text("theirs")
    with pytest.raises(ChangedError, match="exists already; nothing was written"):
        desk.save(text, mark)
    (tmp_path / "minimal.yaml").unlink()
    desk.save(text, mark)
    assert (tmp_path / "minimal.yaml").read_text("utf-8") == text
    assert (desk.saved, desk.argument) == (True, str(tmp_path / "minimal.yaml"))
    link = tmp_path / "link.yaml"
    link.symlink_to(tmp_path / "minimal.yaml")
    linked = Desk(str(link))
    with pytest.raises(Exception, match="symbolic link"):
        linked.save("name: x\n", linked.read()[1])
