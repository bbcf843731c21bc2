"""A folder of a risk made from closed forms: draws along a line that crosses the Earth, a second one at the Moon.

Nothing of nebosvod computes these numbers; the folder is written by the program's own writer.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from nebosvod.report.pages import report_text
from nebosvod.results.result import OwnedFolder, Result

DRAWS, SIGMA_KM, CAPTURE_KM, XI_KM = 3000, 20000.0, 8200.0, 4500.0
SHARES = {"star catalogue Gaia2": 0.6, "measurement noise 500": 0.3, "clock of W84": 0.1}


def approach(body: str, **more: Any) -> dict[str, Any]:
    row: dict[str, Any] = {
        "body": body, "impact": True, "epoch_utc": "2038-07-10T05:29:23.041 UTC",
        "epoch_tdb": "2038-07-10T05:30:32.225 TDB", "sigma_time_s": 596.3, "distance_km": 2938.06,
        "distance_au": 2938.06 / 149597870.7, "sigma_distance_km": 3313.0, "least_distance_3_sigma_km": 2895.0,
        "speed_km_s": 18.04, "v_infinity_km_s": 14.158, "xi_km": XI_KM, "zeta_km": 0.0, "semi_major_km": SIGMA_KM,
        "semi_minor_km": 4.0, "angle_deg": 90.0, "capture_radius_km": CAPTURE_KM, "impact_probability_linear": 0.2685,
        "no_plane": None, "longitude_deg": -77.0, "latitude_deg": 45.2,
    }  # fmt: skip
    return row | more


def way(name: str, p: float | None, low: float, high: float, draws: int = 0, hits: int = 0) -> dict[str, Any]:
    return {
        "way": name, "probability": p, "low": low, "high": high, "bound": p is None, "draws": draws, "hits": hits,
        "effective_hits": float(hits), "note": None,
    }  # fmt: skip


def impactor(number: int, body: str, ways: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    best = next(one for one in ways if one["way"] == "sampling")
    row: dict[str, Any] = {
        "number": number, "body": body, "epoch_utc": "2038-07-10T05:30:23 UTC",
        "epoch_tdb": "2038-07-10T05:31:31.817 TDB", "sigma_time_s": 133.1, "recommended": "sampling",
        "reason": "it assumes nothing", "ways": ways, "energy_mt": 310.0, "palermo": 1.23, "torino": 8,
        "approach": approach(body), **{key: best[key] for key in ("probability", "low", "high", "bound")},
    }  # fmt: skip
    return row | more


def budget(p: float) -> dict[str, Any]:
    return {
        "probability": p, "effective_hits": DRAWS * p, "enough": False, "sigmas": 0.4, "rows": [
            {
                "source": name, "elasticity": -0.5 * share, "elasticity_error": 0.02, "log_odds": None,
                "log_odds_error": None, "share": share, "probability_if_halved": p * (1.0 + share),
                "probability_if_halved_error": 0.01,
            }
            for name, share in SHARES.items()
        ],
    }  # fmt: skip


def corridor() -> dict[str, Any]:
    level = {
        "epoch_utc": "2038-07-10T05:30:20.123 UTC", "sigma_time_s": 133.0, "longitude_deg": -100.0,
        "latitude_deg": 40.0, "semi_major_km": 400.0, "semi_minor_km": 20.0, "angle_from_east_deg": 15.0,
        "no_ellipse": None, "speed_km_s": 18.0, "below_horizon_deg": 45.0,
    }  # fmt: skip
    bent = {"semi_major_km": None, "semi_minor_km": None, "angle_from_east_deg": None, "no_ellipse": "bent"}
    return {"entry_100_km": level | bent, "ground": level, "grazing_probability": 0.004}


def nights() -> list[dict[str, Any]]:
    chances = [None, 0.004, 0.03, 0.12, 0.26]
    return [
        {
            "until_utc": f"2026-07-{4 + 3 * k:02d}T09:00:00 UTC", "n_observations": 10 + 4 * k, "probability": p,
            "low": 0.0 if p is None else 0.8 * p, "high": 0.001 if p is None else 1.2 * p, "bound": p is None,
            "semi_major_km": 3e6 / 5.0**k, "semi_minor_km": 50.0,
        }
        for k, p in enumerate(chances)
    ]  # fmt: skip


def make(name: str = "2026 PDC27", **more: Any) -> Result:
    """A whole result; `more` replaces keys of the summary."""
    rng = np.random.default_rng(4)
    along = SIGMA_KM * rng.standard_normal(DRAWS)
    points = np.stack([XI_KM + 4.0 * rng.standard_normal(DRAWS), along], axis=1)
    hits = np.hypot(*points.T) < CAPTURE_KM
    moon = np.abs(along - 2.2 * SIGMA_KM) < 1500.0
    none = np.full(DRAWS, np.nan)
    exact = float(norm.cdf(np.sqrt(CAPTURE_KM**2 - XI_KM**2) / SIGMA_KM) * 2.0 - 1.0)
    p = float(hits.mean())
    spread = 1.96 * float(np.sqrt(p * (1.0 - p) / DRAWS))
    sampled = way("sampling", p, p - spread, p + spread, DRAWS, int(hits.sum()))
    ways = [way("linear", exact, exact, exact), way("line_of_variations", 0.88, 0.87, 0.89, 51, 12), sampled]
    far = [way("linear", 8e-4, 8e-4, 8e-4), way("sampling", 2 / DRAWS, 8e-5, 2.4e-3, DRAWS, 2)]
    rows = [
        impactor(
            0, "earth", ways, budget=budget(p), sigmas=0.2, stretching_km=SIGMA_KM, corridor=corridor(),
        ),
        impactor(1, "moon", far, epoch_utc="2038-07-11T20:00:00 UTC", energy_mt=None, palermo=None, torino=None,
                 approach=approach("moon", impact=False, longitude_deg=None, latitude_deg=None)),
    ]  # fmt: skip
    summary: dict[str, Any] = {
        "schema_version": 1, "kind": "risk", "title": f"Impact risk of {name}", "object": name, "orbit": {
            "origin": "pdc27 (a fit)", "epoch_tdb": "2026-06-21T00:00:00.000 TDB", "epoch_jd_tdb": [2461212.0, 0.5],
            "state_km_km_s": [1.5e8, 0.0, 0.0, 0.0, 29.0, 0.0], "names": ["x", "y", "z", "vx", "vy", "vz"],
            "factor": np.eye(6).tolist(), "sigma": [1.0] * 6, "sigma_position_km": 263.4, "parameters": {},
            "magnitude": {"H": 20.0, "G": 0.15},
        },
        "on_utc": "2026-08-01T00:00:00 UTC", "until_utc": "2039-01-01T00:00:00 UTC", "bodies": ["earth", "moon"],
        "seed": 1, "n_draws": DRAWS, "n_virtual_impactors": 2, "sampling": sampled, "virtual_impactors": rows,
        "palermo_cumulative": 1.24, "history": nights(), "ended": None, "warnings": [],
    }  # fmt: skip
    arrays = {
        "deviations": np.zeros((DRAWS, 6)), "weights": np.ones(DRAWS),
        "hit_body": np.where(hits, "earth", np.where(moon, "moon", "")),
        "hit_t_s": np.where(hits | moon, 3.8e8 + along / 100.0, np.nan),
        "longitude_deg": np.where(hits, (-100.0 + along / 80.0 + 180.0) % 360.0 - 180.0, np.nan),
        "latitude_deg": np.where(hits, 40.0 - (along / 2000.0) ** 2, np.nan),
        "speed_km_s": np.where(hits, 18.0, np.nan), "elevation_deg": np.where(hits, 45.0, np.nan),
        "line_xi_zeta_km_0": np.stack([np.full(41, XI_KM), np.linspace(-5.0, 5.0, 41) * SIGMA_KM], axis=1),
    }  # fmt: skip
    for k, (body, mask) in enumerate((("earth", hits), ("moon", moon))):
        arrays |= {
            f"hits_{k}": mask, f"t_s_{k}": 3.8e8 + along / 100.0, f"distance_km_{k}": np.hypot(*points.T),
            f"xi_zeta_km_{k}": points if k == 0 else points - [XI_KM, 2.2 * SIGMA_KM], f"axes_{k}": np.eye(3),
            f"capture_radius_km_{k}": np.array(CAPTURE_KM if body == "earth" else 1760.0),
            f"v_infinity_km_s_{k}": np.array(14.158), f"none_{k}": none,
        }  # fmt: skip
    manifest = {"schema_version": 1, "kind": "risk", "versions": {"nebosvod": "0.2.0"}, "times": {}}
    return Result(summary=summary | more, manifest=manifest, arrays=arrays, tables={})


@pytest.fixture(scope="session")
def make_risk_folder() -> Callable[..., Path]:
    """Writes such a folder and returns it."""

    def written(folder: Path, **more: Any) -> Path:
        with OwnedFolder(folder, report_text) as target:
            target.publish(make(**more))
        return folder

    return written


@pytest.fixture(scope="session")
def risk_folder(tmp_path_factory: pytest.TempPathFactory, make_risk_folder: Callable[..., Path]) -> Path:
    """The folder as it is."""
    return make_risk_folder(tmp_path_factory.mktemp("risk") / "risk")
