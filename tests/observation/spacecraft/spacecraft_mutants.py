"""Damaged files of spacecraft orbits and ephemerides through their readers, many in one process.

    python spacecraft_mutants.py KIND SCRATCH FIRST COUNT

KIND: spk (types 1, 2, 3, 8, 9, 13, 21), oem, ephemeris (the planets themselves). A file gives states, or a sentence
with its name: of `DataError`, or of `CoverageError` for a time outside of it. The process has 1 GB; each mutant has
20 s. Prints one JSON object.
"""

import random
import runpy
import struct
import sys
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from jplephem.daf import DAF

from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.ephemeris import DATA
from nebosvod.errors import CoverageError, DataError
from nebosvod.observation import read_oem, read_spk
from nebosvod.timescale import Epoch

SHARED = runpy.run_path(str(Path(__file__).resolve().parents[2] / "mutants.py"))  # a script is in no package
DAY_S = 86400.0
J2000 = Epoch.from_jd(2451545.0)
TYPES = (1, 2, 3, 8, 9, 13, 21)
NUMBERS = (0.0, -1.0, 1.0, 2.0, 1e308, -1e308, 1e-308, np.nan, np.inf, -np.inf, 1e9, 2.0**31, 6.0, 7.0, 0.5)
WORDS = (
    "", "nan", "inf", "1e400", "-1e308", "0", "-0", "9" * 400, "0000-00-00T00:00:00", "9999-12-31T23:59:60",
    "2016-12-31T23:59:60", "2000-366T00:00:00", "2000-02-30", "Z", "TDB", "UTC", "UT1", "EARTH", "SUN", "MARS", "ICRF",
    "META_START", "META_STOP", "COVARIANCE_START", "COVARIANCE_STOP", "COMMENT", "=", "EPOCH = 2000-01-01T12:00:00",
    "INTERPOLATION_DEGREE = 1e30", "INTERPOLATION_DEGREE = nan", "INTERPOLATION = LINEAR", "\x00", "☄", "\u0661",
    "a" * 3000, "TOD", "CCSDS_OEM_VERS = 2.0", "1_0", "0x10", "+", "\x0c", "\u2028",
)  # fmt: skip


def states(count: int) -> "np.ndarray[Any, Any]":
    """A circle about the Earth in a day."""
    angle = np.linspace(0.0, 2.0 * np.pi, count)
    zero = np.zeros(count)
    place = 42164.0 * np.stack([np.cos(angle), np.sin(angle), zero], axis=1)
    return np.hstack([place, 3.07 * np.stack([-np.sin(angle), np.cos(angle), zero], axis=1)])


def segment(kind: int, start: float) -> "np.ndarray[Any, Any]":
    """Numbers of a segment of a day, 24 records."""
    times, rows = start + np.linspace(0.0, DAY_S, 25), states(25)
    if kind in (9, 13):
        return np.concatenate([rows.ravel(), times, [7.0 if kind == 9 else 3.0, 25.0]])
    if kind == 8:
        return np.concatenate([rows.ravel(), [start, DAY_S / 24, 7.0, 25.0]])
    if kind in (2, 3):
        width = 3 if kind == 2 else 6
        records = []
        for k in range(24):
            series = np.zeros((width, 4))
            series[:, 0] = rows[k, :width]
            series[:, 1] = 1.0
            records.append(np.concatenate([[times[k] + 1800.0, 1800.0], series.ravel()]))
        return np.concatenate([*records, [start, 3600.0, float(len(records[0])), 24.0]])
    size = 15 if kind == 1 else 20
    lines = []
    for k in range(24):
        record = np.zeros(4 * size + 11)
        record[0] = times[k]
        record[1 : 1 + size] = 600.0 * np.arange(1, size + 1)
        record[1 + size : 7 + size] = rows[k].reshape(2, 3).T.ravel()
        record[7 + size : 7 + 4 * size] = 1e-6
        record[-4:] = (5.0, 4.0, 4.0, 4.0)
        lines.append(record)
    tail = [float(size), 24.0] if kind == 21 else [24.0]
    return np.concatenate([*lines, times[1:], tail])


def spk(kind: int) -> bytes:
    """A whole SPK file of one type, two segments."""
    name = b"NAME".ljust(60)
    head = struct.pack("<8sii60siii8s603s", b"DAF/SPK ", 2, 6, name, 2, 2, 513, b"LTL-IEEE", b"")
    ftp = b"FTPSTR:\r:\n:\r\n:\r\x00:\x81:\x10\xce:ENDFTP"
    file = BytesIO((head + ftp).ljust(1024, b"\0") + bytes(2048) + bytes(1024))
    daf = DAF(file)
    for start in (0.0, DAY_S):
        numbers = segment(kind, start)
        daf.add_array(b"SEGMENT".ljust(40), (start, start + DAY_S, -99, 399, 1, kind), numbers)
    file.seek(0, 2)
    file.write(bytes(-file.tell() % 1024))
    return file.getvalue()


def oem() -> bytes:
    """A whole OEM with two blocks and covariances."""
    lines = ["CCSDS_OEM_VERS = 2.0", "CREATION_DATE = 2026-01-01T00:00:00", "ORIGINATOR = X"]
    for day in (1, 2):
        lines += ["META_START", "OBJECT_NAME = X", "OBJECT_ID = 2026-001A", "CENTER_NAME = EARTH", "REF_FRAME = ICRF",
                  "TIME_SYSTEM = UTC", f"START_TIME = 2000-01-{day:02}T12:00:00",
                  f"STOP_TIME = 2000-01-{day + 1:02}T12:00:00",
                  "INTERPOLATION = HERMITE", "INTERPOLATION_DEGREE = 7", "META_STOP"]  # fmt: skip
        for k, row in enumerate(states(25)):
            hours = 12 + k
            stamp = f"2000-01-{day + hours // 24:02}T{hours % 24:02}:00:00.000"
            lines.append(" ".join([stamp, *(f"{value:.9f}" for value in row)]))
        lines += ["COVARIANCE_START", f"EPOCH = 2000-01-{day:02}T13:00:00", "COV_REF_FRAME = RTN"]
        lines += [" ".join(f"{float(i == j):.3f}" for j in range(i + 1)) for i in range(6)]
        lines += ["COVARIANCE_STOP"]
    return ("\n".join(lines) + "\n").encode()


def change_binary(rng: random.Random, data: bytes) -> bytes:
    """Cut, flip bits, overwrite numbers and counters, above all where the file describes itself."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        what = rng.randrange(8)
        size = len(changed)
        if size < 16:
            break
        spot = rng.choice(
            (rng.randrange(size), rng.randrange(min(size, 3072)), rng.randrange(max(0, size - 1200), size))
        )
        if what == 0:
            del changed[spot:]
        elif what == 1:
            del changed[spot : spot + rng.choice((1, 8, 1024))]
        elif what == 2:
            changed[spot] ^= 1 << rng.randrange(8)
        elif what == 3:
            changed[spot:spot] = rng.randbytes(rng.choice((1, 8, 64)))
        elif what == 4:
            at = spot - spot % 4
            changed[at : at + 4] = struct.pack("<i", rng.choice((0, 1, 2, 3, -1, 2**31 - 1, -(2**31), 10**6)))
        else:
            at = spot - spot % 8
            changed[at : at + 8] = struct.pack("<d", rng.choice(NUMBERS))
    return bytes(changed)


def change_text(rng: random.Random, data: bytes) -> bytes:
    """Change words, lines and bytes."""
    changed: bytes = SHARED["change_text"](rng, data.decode("utf-8"), WORDS)
    return change_binary(rng, changed) if rng.random() < 0.1 else changed


def read_orbit(kind: str, path: Path, ephemeris: Ephemeris) -> None:
    """Read a file and ask for states at times inside and outside of it."""
    orbit = read_spk(path, -99) if kind == "spk" else read_oem(path).orbit
    for t_s in (np.linspace(10.0, DAY_S - 10.0, 50), np.linspace(0.0, 2.0 * DAY_S, 49), np.array([1e9])):
        try:
            found = orbit.state_km_km_s(ephemeris, J2000, t_s)
        except CoverageError as error:
            if str(path.name) not in str(error):
                raise ValueError(f"no file in: {error}") from None
        else:
            if found.shape != (t_s.size, 6) or not np.abs(found).max() < 1e10:
                raise ValueError(f"states of shape {found.shape} up to {np.abs(found).max()}")


def read_planets(path: Path) -> None:
    """Load the ephemeris and ask for every body."""
    planets = Ephemeris.load(path, DATA / "sb441_n16_1990_2060.bsp")
    first, last = planets.span
    for body in ("earth", "sun", "moon", "jupiter"):
        for epoch in (first, J2000, last):
            planets.state_km_km_s(body, epoch, np.zeros(1))


def tried(kind: str, seed: int, path: Path, ephemeris: Ephemeris, whole: bytes) -> str:
    """What became of one mutant: read, refused, or what was wrong."""
    rng = random.Random(f"{kind} {seed}")
    if kind == "spk":
        path.write_bytes(change_binary(rng, spk(rng.choice(TYPES))))
    else:
        path.write_bytes((change_binary if kind == "ephemeris" else change_text)(rng, whole))
    try:
        read_planets(path) if kind == "ephemeris" else read_orbit(kind, path, ephemeris)
    except (CoverageError, DataError) as error:
        return "refused" if path.name in str(error) or "ephemeris" in str(error) else f"no file in: {error}"
    return "read"


def main(kind: str, scratch: str, first: str, count: str) -> None:
    """Try `count` mutants from number `first` on."""
    path = Path(scratch) / f"mutant.{kind}"
    # the excerpt: mapping the full files takes more room than the limit allows
    ephemeris = Ephemeris.load(DATA / "de440_1990_2060.bsp", DATA / "sb441_n16_1990_2060.bsp")
    whole = oem() if kind == "oem" else b""
    if kind == "ephemeris":
        whole = ephemeris.path.read_bytes()
    for number in TYPES if kind == "spk" else (0,):
        path.write_bytes(spk(number) if kind == "spk" else whole)
        read_planets(path) if kind == "ephemeris" else read_orbit(kind, path, ephemeris)
    SHARED["limit"]()
    SHARED["count_readings"](kind, int(first), int(count), lambda seed: tried(kind, seed, path, ephemeris, whole))


if __name__ == "__main__":
    main(*sys.argv[1:])
