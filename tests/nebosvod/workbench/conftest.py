"""One server of the command itself for all tests of this folder, and a browser that looks at its page."""

import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
MISSION = """\
# a mission whose sigmas are those of its noise, and nothing else
schema_version: 1
name: desk
reference_epoch: 2029-03-01T00:00:00 TDB
object:
  name: (99942) Apophis
  orbit: {kind: cometary, frame: ecliptic_j2000, epoch: 2459215.5 JD TDB, e: 0.1915216893501022,
          q: 0.7458270478466523 au, tp: 2459101.039422462638 JD TDB, node: 204.0389272089208 deg,
          peri: 126.6520518368553 deg, i: 3.336751320066756 deg}
telescopes:
  - name: NEB
    orbit: {kind: geostationary, longitude: 0 deg}
    noise: {sigma: 0.1 arcsec}  # what the camera does
schedule: [{start: 2029-03-01T00:00:00 TDB, end: 2029-04-08T00:00:00 TDB, cadence: 12 h}]
predictions: [{name: encounter, plane: b_plane, near: 2029-04-13T21:46:00 TDB}]
"""


@dataclass(frozen=True)
class Served:
    """A running `nebosvod open`."""

    address: str
    folder: Path
    process: subprocess.Popen[str]

    @property
    def origin(self) -> str:
        return "/".join(self.address.split("/")[:3])

    @property
    def file(self) -> Path:
        return self.folder / "desk.yaml"


def opened(folder: Path, *words: str, show: bool = False) -> Served:
    """Start the command; it has said its address."""
    process = subprocess.Popen(
        [sys.executable, "-m", "nebosvod", "open", *words, *([] if show else ["--no-browser"])],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    assert process.stdout is not None
    line = process.stdout.readline()
    found = re.search(r"http://127\.0\.0\.1:\d+/\S+/", line)
    assert found, line + process.stdout.read()
    return Served(found[0], folder, process)


def ended(served: Served, by: int = signal.SIGINT) -> str:
    """End it by a signal; it says so, and leaves with 130."""
    served.process.send_signal(by)
    assert served.process.wait(30) == 130
    assert served.process.stdout is not None
    with served.process.stdout as stream:
        return stream.read()


@pytest.fixture(scope="session")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("desk")
    (folder / "desk.yaml").write_text(MISSION, "utf-8")
    one = opened(folder, "desk.yaml")
    yield one
    assert ended(one).split("\n") == ["Ctrl-C ends it", "", "interrupted; nothing half-written is left", ""]
