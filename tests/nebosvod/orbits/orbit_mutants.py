"""Cut, changed and hostile files of orbits through `read_orbit`, many in one process.

    python orbit_mutants.py KIND SCRATCH FIRST COUNT [RUN_FOLDER]

KIND: oef, sbdb, mpc_orb, oem, folder. The process has 1 GB; each mutant has 20 s. Prints one JSON object: how many were
read and refused, and what was wrong by seed.
"""

import json
import random
import resource
import shutil
import sys
from contextlib import suppress
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np

from nebosvod import read_orbit
from nebosvod.dynamics import Ephemeris
from nebosvod.errors import InputError

HERE = Path(__file__).resolve().parent


def loaded(path: Path) -> Any:
    """A module by its file: this is a script, which no package holds."""
    spec = spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


seeds, folders = loaded(HERE / "conftest.py"), loaded(HERE.parent / "results" / "folder_mutants.py")
shared = loaded(HERE.parents[1] / "mutants.py")
FILES, mutated_json = folders.FILES, folders.mutated_json
WORDS = (
    "", "nan", "inf", "1e400", "-1e308", "1e-320", "0", "-0", "9" * 400, "x", "☄", "\x00", "\ufeff", "\u0661", "1d5",
    "1D+05", "'", "=", "a" * 3000, "\x1b[31m", "END_OF_HEADER", "format  = 'OEF1.1'", "refsys = EQUM J2000", "TDB",
    "UTC",     "KEP", "EQU", "COM", "CAR", "COV", "NOR", "COR", "LSP", "LSP 1 2 8 1 2", "NGR 1 2", "MAG", "MJD", "1862",
    "META_START", "META_STOP", "COVARIANCE_START", "COVARIANCE_STOP", "COV_REF_FRAME = RTN", "CENTER_NAME = EARTH",
    "TIME_SYSTEM = TT", "EPOCH = 9999-12-31T23:59:60", "1_0", "0x10", "\x0c", "\u2028",
)  # fmt: skip


def mpc_orb() -> dict[str, Any]:
    """An orbit as the Minor Planet Center gives it, with a force."""
    names = ["x", "y", "z", "vx", "vy", "vz", "yarkovski"]
    values = [0.9, 0.4, 0.1, -0.007, 0.014, 0.002, -8.0]
    sigma = [1e-8] * 3 + [1e-10] * 3 + [0.1]
    covariance = {f"cov{i}{j}": sigma[i] * sigma[j] * float(i == j) for i in range(7) for j in range(i, 7)}
    return {
        "CAR": {"coefficient_names": names, "coefficient_values": values, "covariance": covariance},
        "designation_data": {"permid": "54509"},
        "epoch_data": {"epoch": 60000.0, "timeform": "MJD", "timesystem": "TDT"},
        "magnitude_data": {"H": 22.6, "G": 0.15},
        "system_data": {"refsys": "Ecliptic", "refframe": "ICRF", "EclipticObliquityArcseconds": 84381.448},
    }


def oem() -> str:
    """States with a covariance."""
    lines = ["CCSDS_OEM_VERS = 2.0", "CREATION_DATE = 2026-01-01T00:00:00", "ORIGINATOR = X", "META_START",
             "OBJECT_NAME = X", "OBJECT_ID = 2026-001A", "CENTER_NAME = SUN", "REF_FRAME = ICRF", "TIME_SYSTEM = TDB",
             "START_TIME = 2023-02-25T00:00:00", "STOP_TIME = 2023-02-27T00:00:00", "INTERPOLATION = HERMITE",
             "INTERPOLATION_DEGREE = 7", "META_STOP"]  # fmt: skip
    for hour in range(0, 49, 2):
        angle = 2e-7 * 3600.0 * hour
        place, speed = np.array([np.cos(angle), np.sin(angle), 0.1]), np.array([-np.sin(angle), np.cos(angle), 0.0])
        stamp = f"2023-02-{25 + hour // 24:02}T{hour % 24:02}:00:00.000"
        lines.append(" ".join([stamp, *(f"{x:.9f}" for x in 1.5e8 * place), *(f"{v:.9f}" for v in 29.8 * speed)]))
    lines += ["COVARIANCE_START", "EPOCH = 2023-02-26T00:00:00", "COV_REF_FRAME = ICRF"]
    lines += [" ".join(f"{float(i == j) * (1e-8 if i > 2 else 1e2):.6e}" for j in range(i + 1)) for i in range(6)]
    return "\n".join([*lines, "COVARIANCE_STOP", ""])


def change_text(rng: random.Random, text: str) -> bytes:
    """Change words, lines and letters, cut, and turn a bit."""
    data = bytearray(shared.change_text(rng, text, WORDS))
    if data and rng.random() < 0.1:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


def mutant(kind: str, seed: int, path: Path, whole: Path | None) -> Path:
    """Write a mutant; returns what is to be read."""
    rng = random.Random(f"{kind} {seed}")
    if kind == "folder":
        assert whole is not None
        for name in ("summary.json", "arrays.npz"):
            (path / name).write_bytes((whole / name).read_bytes())
        name, mutation = FILES[rng.choice(("summary", "arrays"))]
        (path / name).write_bytes(mutation(rng, (whole / name).read_bytes()))
        return path
    if kind in ("sbdb", "mpc_orb"):
        content = seeds.sbdb_answer() if kind == "sbdb" else mpc_orb()
        path.write_bytes(mutated_json(rng, json.dumps(content).encode()))
    else:
        path.write_bytes(change_text(rng, oem() if kind == "oem" else rng.choice((seeds.YR4, seeds.APOLLO))))
    return path


def tried(path: Path, ephemeris: Ephemeris) -> str:
    """What became of one mutant: read, refused, or what was wrong."""
    try:
        orbit = read_orbit(path)
        with suppress(InputError):  # of physics that a folder's summary says, without its name
            orbit.forces(ephemeris)
    except InputError as error:
        said = str(error)
        named = path.name in said and all(line.isprintable() for line in said.split("\n")) and len(said) < 20_000
        return "refused" if named else f"no file in, or no plain text: {said[:300]!r}"
    if not np.isfinite(orbit.state).all() or not np.isfinite(orbit.sigma).all():
        return f"not finite: {orbit.state} {orbit.sigma}"
    return "read"


def main(kind: str, scratch: str, first: str, count: str, folder: str = "") -> None:
    """Try `count` mutants from number `first` on."""
    whole = Path(folder) if folder else None
    path = Path(scratch) / ("orbit" if kind == "folder" else f"orbit.{kind}")
    if whole is not None:
        shutil.rmtree(path, ignore_errors=True)
        shutil.copytree(whole, path)
    else:
        text = {"sbdb": json.dumps(seeds.sbdb_answer()), "mpc_orb": json.dumps(mpc_orb()), "oem": oem()}
        path.write_text(text.get(kind, seeds.YR4), "utf-8")
    ephemeris = Ephemeris.load()
    assert tried(path, ephemeris) == "read", tried(path, ephemeris)
    shared.limit(resource.RLIMIT_DATA)  # files that are only mapped do not count
    shared.count_readings(kind, int(first), int(count), lambda seed: tried(mutant(kind, seed, path, whole), ephemeris))


if __name__ == "__main__":
    main(*sys.argv[1:])
