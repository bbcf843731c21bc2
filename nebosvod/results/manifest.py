"""manifest.json: where a result came from."""

import platform
import time
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from nebosvod.engine.fitting import Fit
from nebosvod.results.ownership import sha256_of
from nebosvod.scene.scene import Scene
from nebosvod.version import __version__

LIBRARIES = ("numpy", "scipy", "astropy", "jplephem", "numba", "pyerfa", "matplotlib")


def manifest(scene: Scene, seed: int, started: float, fits: list[Fit]) -> dict[str, Any]:
    """Where a result came from; only `times` differ between two runs with one seed."""
    mission = scene.mission
    first, last = scene.ephemeris.span
    inputs = {str(path): sha256_of(path) for path in mission.input_files if path.is_file()}
    return {
        "schema_version": 1,
        "versions": {
            "nebosvod": __version__,
            "python": platform.python_version(),
            **{name: version(name) for name in LIBRARIES},
        },
        "mission": {"name": mission.name, "sha256": mission.sha256, "text": mission.text},
        "ephemeris": {
            "source": scene.ephemeris.source,
            "sha256": dict(scene.ephemeris.sha256),
            "span": f"{first.iso(digits=0)} to {last.iso(digits=0)}",
        },
        **({"inputs_sha256": inputs} if inputs else {}),
        "seed": seed,
        "status": {one.estimator.name: str(one.status) for one in fits},
        "leap_seconds": "erfa's table; TAI - UTC stays at its last value, 37 s, after it; UT1 = UTC",
        "times": {
            "started_utc": datetime.fromtimestamp(started, UTC).isoformat(timespec="seconds"),
            "elapsed_s": round(time.time() - started, 3),
        },
    }
