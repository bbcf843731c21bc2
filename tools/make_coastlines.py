"""Make nebosvod/report/kit/coastlines.json: the land of the Earth for the maps of the pages.

From Natural Earth's land at 1:110 000 000 (public domain), as the npm package world-atlas 2 holds it (TopoJSON, ISC).
Needs npm and the network, so it is run by hand when the source changes:

    python tools/make_coastlines.py

Rings of the source close on the sphere. Here each is laid flat: longitudes run on over 180 deg where the land does
(Chukotka, Wrangel, Fiji), and the Antarctic, which goes once around, is closed along the pole. Coordinates are rounded
to 0.01 deg (1.1 km, finer than the source's own generalisation). A ring is its first point, then the steps from point
to point: longitude, latitude, longitude, ... Land lies to the right of its ring; a lake's goes the other way.
"""

import hashlib
import io
import json
import subprocess
import sys
import tarfile
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

PACKAGE = "world-atlas@2.0.2"
MEMBER = "package/land-110m.json"
SHA256 = "ead5f68119c49a9250902e7da303bcb209341bbb8fefe7369a439b48b704658a"
TARGET = Path(__file__).resolve().parent.parent / "nebosvod" / "report" / "kit" / "coastlines.json"
STEPS = 100  # per degree


def fetched() -> bytes:
    """The file of the package, as npm delivers it."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["npm", "pack", "--silent", PACKAGE], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        (archive,) = Path(folder).glob("*.tgz")
        with tarfile.open(archive) as tar:
            member = tar.extractfile(MEMBER)
            return b"" if member is None else member.read()


def arcs_of(topology: dict[str, Any]) -> list[list[tuple[float, float]]]:
    """The arcs in degrees: TopoJSON holds steps on a grid, with scale and origin."""
    (sx, sy), (ox, oy) = topology["transform"]["scale"], topology["transform"]["translate"]
    found = []
    for arc in topology["arcs"]:
        x = y = 0
        points = []
        for dx, dy in arc:
            x, y = x + dx, y + dy
            points.append((ox + sx * x, oy + sy * y))
        found.append(points)
    return found


def rings_of(topology: dict[str, Any]) -> list[list[tuple[float, float]]]:
    """Every ring of the land, closed; an arc of negative number ~k is arc k backwards."""
    arcs = arcs_of(topology)
    found = []
    for geometry in topology["objects"]["land"]["geometries"]:
        polygons = geometry["arcs"] if geometry["type"] == "MultiPolygon" else [geometry["arcs"]]
        for ring in (ring for polygon in polygons for ring in polygon):
            points: list[tuple[float, float]] = []
            for number in ring:
                arc = arcs[number] if number >= 0 else arcs[~number][::-1]
                points += arc[1:] if points else arc
            found.append(points)
    return found


def flat(ring: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """A ring with longitudes that run on, closed along the pole where it goes once around the Earth."""
    points = ring[:1]
    for x, y in ring[1:]:
        points.append((points[-1][0] + (x - points[-1][0] + 180.0) % 360.0 - 180.0, y))
    if abs(points[-1][0] - points[0][0]) > 180.0:
        pole = -90.0 if points[0][1] < 0.0 else 90.0
        points += [(points[-1][0], pole), (points[0][0], pole), points[0]]
    middle = 0.5 * (min(x for x, _ in points) + max(x for x, _ in points))
    turn = 360.0 * ((middle + 180.0) // 360.0)
    return [(x - turn, y) for x, y in points]


def steps_of(ring: list[tuple[float, float]]) -> list[int]:
    """A ring as its first point and the steps after it, in 0.01 deg; steps of nothing are left out."""
    grid = [(round(STEPS * x), round(STEPS * y)) for x, y in ring]
    kept = grid[:1] + [b for a, b in pairwise(grid) if a != b]
    return [*kept[0], *(step for a, b in pairwise(kept) for step in (b[0] - a[0], b[1] - a[1]))]


def main() -> None:
    """Fetch, check, decode, write."""
    raw = fetched()
    digest = hashlib.file_digest(io.BytesIO(raw), "sha256").hexdigest()
    if digest != SHA256:
        sys.exit(f"{PACKAGE} {MEMBER}: sha256 is {digest}, expected {SHA256}")
    rings = [steps_of(flat(ring)) for ring in rings_of(json.loads(raw))]
    head = {
        "source": f"Natural Earth, land 1:110m, by way of the npm package {PACKAGE} ({MEMBER.rpartition('/')[2]})",
        "licence": "Natural Earth: public domain; world-atlas: ISC, (c) 2013-2019 Michael Bostock",
        "source_sha256": digest,
        "made_by": "tools/make_coastlines.py",
        "steps_per_deg": STEPS,
    }
    lines = ",\n".join(json.dumps(ring, separators=(",", ":")) for ring in rings)
    TARGET.write_text(json.dumps(head, indent=1)[:-2] + ',\n "rings": [\n' + lines + "\n]}\n", "utf-8")
    print(f"{TARGET}: {len(rings)} rings, {sum(len(r) for r in rings) // 2} points, {TARGET.stat().st_size} bytes")


if __name__ == "__main__":
    main()
