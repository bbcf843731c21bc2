"""Files too large for memory are refused by what they are before anything is taken apart: 500 MB, and little time."""

import gzip
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import sys, time
from pathlib import Path
from nebosvod.errors import InputError
from nebosvod.observation.astrometry_files import read_astrometry
began = time.process_time()
try:
    read_astrometry(sys.argv[1])
except InputError as error:
    print(str(error).splitlines()[0][:200])
else:
    print("read")
print(time.process_time() - began)
# not ru_maxrss, which a child has from its parent, here a whole test run
status = Path("/proc/self/status").read_text().splitlines()
print(next(line.split()[1] for line in status if line.startswith("VmHWM")))
"""
PSV = b"# version=2022\npermID|stn|obsTime|ra|dec|mode|astCat\n"
RECORD = b"00433         A1893 10 29.4132  06 08 59.32 +53 39 04.2                 HA053802\n"


def bomb(path: Path) -> None:
    """400 MB in 400 kB."""
    with gzip.open(path, "wb") as file:
        for _ in range(500):
            file.write(RECORD * 10_000)


CASES = {
    "a.obs.gz": (bomb, "larger than 32,000,000 bytes (unpacked)"),
    "rows.obs": (lambda path: path.write_bytes(b"x\n" * 8_000_000), "lines (8,000,000)"),
    "blank.obs": (lambda path: path.write_bytes(b"\n" * 10_000_000), "lines (10,000,000)"),
    "columns.psv": (lambda path: path.write_bytes(b"# version=2022\n" + b"c|" * 499_999 + b"c\n"), "columns (500,000)"),
    "columns.csv": (lambda path: path.write_bytes(b"c," * 499_999 + b"c\n1\n"), "columns (500,000)"),
    "line.psv": (lambda path: path.write_bytes(b"# version=2022\n" + b"x" * 10_000_000), "a line of more than"),
    "cells.psv": (lambda path: path.write_bytes(PSV + b"||||||||||||||||||||||||||||||\n" * 200_000), "cells ("),
    "tags.xml": (lambda path: path.write_bytes(b"<ades>" + b"<a>" * 3_300_000), "cells ("),
    "full.psv": (lambda path: path.write_bytes(PSV + b"ab|cd|ef|gh|ij|kl|mn\n" * 240_000), "full.psv:3"),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_too_much_is_refused_within_500_mb(name: str, tmp_path: Path) -> None:
    make, said = CASES[name]
    make(tmp_path / name)
    command = [sys.executable, "-c", SCRIPT, str(tmp_path / name)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    message, seconds, kilobytes = done.stdout.splitlines()
    assert said in message
    assert int(kilobytes) < 500_000
    assert float(seconds) < (20.0 if name == "full.psv" else 1.0)
