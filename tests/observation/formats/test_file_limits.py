"""Files too large for memory are refused by what they are before anything is taken apart: 500 MB, and little time."""

import gzip
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import sys, time
from pathlib import Path
from nebosvod.errors import DataError, InputError
from nebosvod.observation import read_oem
from nebosvod.observation.formats.reading import read_astrometry
from nebosvod.observation.reduction.weight_rules import read_rules
from nebosvod.observation.spacecraft.orbit_table import read_orbit_table
read = {"oem": read_oem, "table": lambda path: read_orbit_table(Path(path), "sun"), "weights": read_rules}
began = time.process_time()
try:
    read.get(sys.argv[1].rpartition(".")[2], read_astrometry)(sys.argv[1])
except (DataError, InputError) as error:
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


OEM = (
    b"CCSDS_OEM_VERS = 2.0\nMETA_START\nOBJECT_NAME = P\nOBJECT_ID = 1\nCENTER_NAME = SUN\nREF_FRAME = ICRF\n"
    b"TIME_SYSTEM = TDB\nSTART_TIME = 2028-01-01T00:00:00\nSTOP_TIME = 2028-12-01T00:00:00\nMETA_STOP\n"
)
TABLE = b"epoch,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n"
TRIANGLE = b"EPOCH = 2028-01-01\n" + b"".join(b"1 " * k + b"1\n" for k in range(6))

CASES = {
    "a.obs.gz": (bomb, "larger than 32,000,000 bytes (unpacked)"),
    "rows.obs": (lambda path: path.write_bytes(b"x\n" * 8_000_000), "lines (8,000,000)"),
    "blank.obs": (lambda path: path.write_bytes(b"\n" * 10_000_000), "lines (10,000,000)"),
    "columns.psv": (lambda path: path.write_bytes(b"# version=2022\n" + b"c|" * 499_999 + b"c\n"), "columns (500,000)"),
    "columns.csv": (lambda path: path.write_bytes(b"c," * 499_999 + b"c\n1\n"), "columns (500,000)"),
    "line.psv": (lambda path: path.write_bytes(b"# version=2022\n" + b"x" * 10_000_000), "a line of more than"),
    "cells.psv": (lambda path: path.write_bytes(PSV + b"||||||||||||||||||||||||||||||\n" * 200_000), "cells ("),
    "tags.xml": (lambda path: path.write_bytes(b"<ades>" + b"<a>" * 3_300_000), "cells ("),
    "blank.oem": (lambda path: path.write_bytes(OEM + b" \n" * 5_000_000), "more than 1,000,000 lines"),
    "line.oem": (lambda path: path.write_bytes(OEM + b"1 " * 5_000_000), "line.oem:11: a line of more than"),
    "keys.oem": (lambda path: path.write_bytes(OEM[:-10] + b"A = 1\n" * 999_000), "META_STOP is missing"),
    "matrices.oem": (
        lambda path: path.write_bytes(OEM + b"COVARIANCE_START\n" + TRIANGLE * 30_000), "more than 20,000 covariances"
    ),
    "blank.table": (lambda path: path.write_bytes(TABLE + b"#\n" * 5_000_000), "more than 1,000,000 lines"),
    "line.table": (lambda path: path.write_bytes(TABLE + b"," * 10_000_000), "line.table:2: a line of more than"),
    "rows.weights": (lambda path: path.write_bytes(b"a,b\n" * 2_500_000), "larger than 1,000,000 bytes"),
    "full.psv": (lambda path: path.write_bytes(PSV + b"ab|cd|ef|gh|ij|kl|mn\n" * 240_000), "full.psv:3"),
}  # fmt: skip


READ = ("full.psv", "keys.oem", "matrices.oem")  # of a size that is read


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
    assert float(seconds) < (20.0 if name in READ else 1.0)
