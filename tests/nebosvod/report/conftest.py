"""A run folder made from a small orbit determination of its own: two-body motion, two telescopes, one least squares.

Nothing of nebosvod computes these numbers, so the report is tested against an independent run of realistic size:
the shares add up, formal and true covariances differ where a bias is ignored, and the history is a real one.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

Array = npt.NDArray[np.float64]
AU_KM, GM_SUN, DAY_S, ARCSEC = 1.495978707e8, 1.32712440018e11, 86400.0, np.pi / 648000.0
OBLIQUITY = 84381.448 * ARCSEC
TILT = np.array(
    [[1, 0, 0], [0, np.cos(OBLIQUITY), -np.sin(OBLIQUITY)], [0, np.sin(OBLIQUITY), np.cos(OBLIQUITY)]]
)  # ICRF from ecliptic
PRESSURE_KM = 1361.0 / 2.99792458e8 * 1e-3  # km/s^2 per (m^2/kg) at 1 au
PHYSICAL = {"radius_m": (170.0, 20.0), "mass_kg": (6.1e10, 1.5e10), "albedo": (0.159, 0.05)}
TELESCOPES = ("NEB-1", "NEB-2")


def kappa(radius_m: float, mass_kg: float, albedo: float) -> float:
    """Area to mass times reflection of a sphere, m^2/kg."""
    return np.pi * radius_m**2 / mass_kg * (1.0 + 4.0 * albedo / 9.0)


def acceleration(state: Array, kappas: Array) -> Array:
    """Time derivative of the heliocentric states (k, 6) of two-body motion with radiation pressure."""
    r = state[:, :3]
    cube = np.linalg.norm(r, axis=1, keepdims=True) ** 3
    pull = PRESSURE_KM * AU_KM**2 * kappas[:, None] - GM_SUN
    return np.hstack([state[:, 3:], pull * r / cube])


def track(state: Array, kappas: Array, t_s: Array) -> Array:
    """States (n, k, 6) at increasing times by RK4, clones side by side."""
    out = np.empty((len(t_s), *state.shape))
    out[0] = state
    for i in range(1, len(t_s)):
        h = t_s[i] - t_s[i - 1]
        a = acceleration(state, kappas)
        b = acceleration(state + 0.5 * h * a, kappas)
        c = acceleration(state + 0.5 * h * b, kappas)
        d = acceleration(state + h * c, kappas)
        state = state + h / 6.0 * (a + 2 * b + 2 * c + d)
        out[i] = state
    return out


def angles(object_km: Array, telescope_km: Array) -> Array:
    """(RA, Dec) of positions (..., 3) seen from a telescope."""
    u = object_km - telescope_km
    return np.stack([np.arctan2(u[..., 1], u[..., 0]), np.arcsin(u[..., 2] / np.linalg.norm(u, axis=-1))], axis=-1)


def earth_km(t_s: Array) -> Array:
    """Heliocentric ICRF positions (n, 3) of a circular Earth that is at longitude 53 deg at t = 0."""
    longitude = np.radians(53.0) + 2 * np.pi * t_s / (365.256 * DAY_S)
    return AU_KM * np.stack([np.cos(longitude), np.sin(longitude), 0 * longitude], axis=1) @ TILT.T


def geostationary_km(t_s: Array, longitude: float) -> Array:
    """Heliocentric ICRF positions (n, 3) of a geostationary telescope."""
    turn = longitude + 0.94 + 2 * np.pi * t_s / 86164.1
    return earth_km(t_s) + 42164.0 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)


class Case:
    """One orbit determination: measurements, partials and the least-squares machinery of the fixture."""

    def __init__(self, days: float, cadence_h: float) -> None:
        self.grid_s = np.arange(0.0, 150.0 * DAY_S + 1.0, 0.25 * DAY_S)
        start = np.concatenate([earth_km(np.zeros(1))[0] + TILT @ np.array([-4.1e7, 5.0e7, 1.2e6]), np.zeros(3)])
        start[3:] = TILT @ np.array([-27.5, 13.2, 1.4])
        step = np.concatenate([np.full(3, 100.0), np.full(3, 1e-3), [1e-6]])
        clones = np.repeat(np.append(start, kappa(*(v for v, _ in PHYSICAL.values())))[None], 15, axis=0)
        for j in range(7):
            clones[1 + 2 * j, j] += step[j]
            clones[2 + 2 * j, j] -= step[j]
        every = track(clones[:, :6], clones[:, 6], self.grid_s)
        self.states = every[:, 0]
        partial = (every[:, 1::2] - every[:, 2::2]) / (2 * step[:, None])  # (n, 7, 6)
        r, m, a = (v for v, _ in PHYSICAL.values())
        chain = kappa(r, m, a) * np.array([2 / r, -1 / m, (4 / 9) / (1 + 4 * a / 9)])
        self.by = np.concatenate([partial[:, :6], chain[None, :, None] * partial[:, 6:7]], axis=1).transpose(0, 2, 1)
        pick = np.arange(0, int(days * 4) + 1, max(1, round(cadence_h / 6)))
        self.row_grid = np.repeat(pick, 2)
        self.telescope = np.tile([0, 1], len(pick))
        self.t_s = self.grid_s[self.row_grid]
        self.place_km = np.where(
            self.telescope[:, None] == 0, geostationary_km(self.t_s, 0.0), geostationary_km(self.t_s, np.pi)
        )
        self._measure()

    def _measure(self) -> None:
        """Partials of (RA*, Dec) by state and parameters, bias columns, and one simulated set of residuals."""
        rho = self.states[self.row_grid, :3] - self.place_km
        self.distance_km = np.linalg.norm(rho, axis=1)
        self.psi = angles(self.states[self.row_grid, :3], self.place_km)
        ra, dec = self.psi.T
        east = np.stack([-np.sin(ra), np.cos(ra), 0 * ra], axis=1)
        north = np.stack([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)], axis=1)
        self.D = np.stack([east, north], axis=1) / self.distance_km[:, None, None]
        self.H = np.einsum("nij,njk->nik", self.D, self.by[self.row_grid, :3])  # (n, 2, 9)
        n = len(self.t_s)
        self.B = np.zeros((n, 2, 4))
        for i in range(2):
            self.B[np.arange(n), i, 2 * self.telescope + i] = 1.0
        rng = np.random.default_rng(5)
        self.bias = rng.normal(0.0, 0.05 * ARCSEC, 4)
        noise = rng.normal(0.0, 0.1 * ARCSEC, (n, 2)) + np.einsum("nij,nj->ni", self.D, rng.normal(0, 3.0, (n, 3)))
        self.residual = noise + self.B @ self.bias

    def solve(self, with_bias: bool, upto: int | None = None) -> dict[str, Any]:
        """Gains, K_formal, K_true and the shares of every source (section "budget" of the method notes)."""
        n = len(self.t_s) if upto is None else upto
        names = [
            "x",
            "y",
            "z",
            "vx",
            "vy",
            "vz",
            *PHYSICAL,
            *[f"bias {t} {a}" for t in TELESCOPES for a in ("ra", "dec")],
        ]
        H = np.concatenate([self.H, self.B], axis=2)[:n] if with_bias else self.H[:n]
        prior_sigma = np.array([np.inf] * 6 + [s for _, s in PHYSICAL.values()] + [0.05 * ARCSEC] * 4)[: H.shape[2]]
        R = np.tile(np.eye(2) * (0.1 * ARCSEC) ** 2, (n, 1, 1))
        Z = 9.0 * np.einsum("nij,nkj->nik", self.D[:n], self.D[:n])
        W = np.linalg.inv(R + Z)  # noqa: TID251 - 2x2 blocks of a fixture
        scale = np.array([1e3] * 3 + [1e-3] * 3 + [s for _, s in PHYSICAL.values()] + [0.05 * ARCSEC] * 4)[: H.shape[2]]
        Hs = H * scale
        normal = np.einsum("nia,nij,njb->ab", Hs, W, Hs) + np.diag((scale / prior_sigma) ** 2)
        formal = np.linalg.solve(normal, np.eye(len(normal)))
        gain = scale[:, None, None] * np.einsum("ab,nib,nij->anj", formal, Hs, W)  # (s, n, 2)
        K_formal = scale[:, None] * formal * scale
        shares: dict[str, Array] = {}
        for i, name in enumerate(TELESCOPES):
            mine = self.telescope[:n] == i
            g = gain[:, mine]
            shares[f"measurement noise {name}"] = np.einsum("ani,nij,bnj->ab", g, R[mine], g)
            shares[f"telescope position {name}"] = np.einsum("ani,nij,bnj->ab", g, Z[mine], g)
            moved = np.einsum("ani,nik->ak", g, self.B[:n][mine][:, :, 2 * i : 2 * i + 2])
            if with_bias:
                moved = K_formal[:, 9 + 2 * i : 11 + 2 * i] / (0.05 * ARCSEC) ** 2
            shares[f"bias {name}"] = moved @ moved.T * (0.05 * ARCSEC) ** 2
        for j, (name, (_, sigma)) in enumerate(PHYSICAL.items()):
            column = K_formal[:, 6 + j] / sigma**2
            shares[name.split("_")[0]] = np.outer(column, column) * sigma**2
        estimate = np.einsum("ani,ni->a", gain, self.residual[:n])
        after = self.residual[:n] - np.einsum("nia,a->ni", H, estimate)
        chi2 = float(np.einsum("ni,nij,nj->", after, W, after) + np.sum((estimate / prior_sigma) ** 2))
        return {
            "names": names[: H.shape[2]], "formal": K_formal, "true": sum(shares.values()), "shares": shares,
            "estimate": estimate, "after": after, "chi2": chi2, "W": W, "H": H,
        }  # fmt: skip


def blocks(K: Array) -> tuple[float, float]:
    """Root trace of the position (km) and velocity (m/s) blocks."""
    return float(np.sqrt(np.trace(K[:3, :3]))), 1e3 * float(np.sqrt(np.trace(K[3:6, 3:6])))


def estimator_entry(case: Case, name: str, method: str, answer: dict[str, Any]) -> dict[str, Any]:
    """One item of summary.estimators."""
    K, F = answer["true"], answer["formal"]
    position, velocity = blocks(K)
    parameters = {
        p: {
            "prior_sigma": s,
            "sigma": float(np.sqrt(K[6 + j, 6 + j])),
            "estimate": v + float(answer["estimate"][6 + j]),
        }
        for j, (p, (v, s)) in enumerate(PHYSICAL.items())
    }
    treated = "estimated" if len(F) > 9 else "ignored"
    return {
        "name": name, "method": method, "status": "converged", "iterations": 3, "chi2": answer["chi2"],
        "dof": 2 * len(case.t_s) - 6, "condition_number": 4.1e5, "priors": ["radius", "mass", "albedo"],
        "treatment": {"state": "estimated", "radius": "estimated", "mass": "estimated", "albedo": "estimated",
                      "position NEB-1": "estimated", "position NEB-2": "estimated",
                      "bias NEB-1": treated, "bias NEB-2": treated},
        "state_km_km_s": (case.states[0] + answer["estimate"][:6]).tolist(),
        "covariance_km_km_s": K[:6, :6].tolist(), "covariance_formal_km_km_s": F[:6, :6].tolist(),
        "factor_km_km_s": np.linalg.cholesky(K[:6, :6]).tolist(),
        "sigma_position_km": position, "sigma_velocity_m_s": velocity,
        "sigma_formal_position_km": blocks(F)[0], "parameters": parameters,
    }  # fmt: skip


def budget_entries(name: str, answer: dict[str, Any]) -> list[dict[str, Any]]:
    """The items of summary.budget of one estimator."""
    total = blocks(answer["true"])
    entries = []
    for source, share in answer["shares"].items():
        p, v = blocks(share)
        entries.append({"estimator": name, "source": source, "sigma_position_km": p, "sigma_velocity_m_s": v,
                        "share_position": (p / total[0]) ** 2, "share_velocity": (v / total[1]) ** 2})  # fmt: skip
    return entries


def prediction_entry(
    name: str, estimator: str, plane: str, epoch: str, unit: str, W: Array, mean: Array, answer: dict[str, Any]
) -> dict[str, Any]:
    """One item of summary.predictions, from the linear map W (d, 9) in the prediction's unit."""
    W = np.hstack([W, np.zeros((len(W), len(answer["true"]) - 9))])
    K, F = W @ answer["true"] @ W.T, W @ answer["formal"] @ W.T
    axes, vectors = np.linalg.eigh(K)
    sigma = np.sqrt(np.diag(K))
    entry: dict[str, Any] = {
        "name": name, "estimator": estimator, "epoch_tdb": epoch, "plane": plane,
        "probability": [0.6827, 0.3935, 0.1987][len(W) - 1],
        f"semi_axes_{unit}": np.sqrt(axes[::-1]).tolist(), f"sigma_{unit}": sigma.tolist(),
        f"mean_{unit}": mean.tolist(), f"max_deviation_{unit}": (3 * sigma).tolist(),
        f"covariance_{unit}2": K.tolist(), f"covariance_formal_{unit}2": F.tolist(),
        f"sigma_formal_{unit}": np.sqrt(np.diag(F)).tolist(),
        "budget": [{"source": s, "share": (np.diag(W @ k @ W.T) / np.diag(K)).tolist(),
                    "share_total": float(np.trace(W @ k @ W.T) / np.trace(K))} for s, k in answer["shares"].items()],
    }  # fmt: skip
    if len(W) == 2:
        entry["angle_deg"] = float(np.degrees(np.arctan2(vectors[1, -1], vectors[0, -1])))
    return entry


def predictions(case: Case, estimator: str, answer: dict[str, Any]) -> list[dict[str, Any]]:
    """Sky, target plane, distance and RTN predictions from the states of the last days."""
    state, by = case.states[-1], case.by[-1]
    toward = state[3:] - TILT @ np.array([-29.3, -5.0, 0.0])
    s = toward / np.linalg.norm(toward)
    zeta = -(np.eye(3) - np.outer(s, s)) @ (TILT @ np.array([-29.3, -5.0, 0.0]))
    zeta /= np.linalg.norm(zeta)
    plane = np.stack([np.cross(s, zeta), zeta])
    mean = np.array([-12643.7, 47115.2])
    week = len(case.states) - 29
    place = geostationary_km(case.grid_s[week : week + 1], 0.0)
    ra, dec = angles(case.states[week : week + 1, :3], place)[0]
    look = np.array([[-np.sin(ra), np.cos(ra), 0], [-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)]])
    look = look / np.linalg.norm(case.states[week, :3] - place) / ARCSEC @ case.by[week, :3]
    radial = state[:3] / np.linalg.norm(state[:3])
    normal = np.cross(state[:3], state[3:])
    normal /= np.linalg.norm(normal)
    rtn = np.stack([radial, np.cross(normal, radial), normal])
    encounter, before = "2029-04-13T21:46:02.000 TDB", "2029-04-06T00:00:00.000 TDB"
    earth, near, zero = {"body": "earth"}, np.array([38012.1]), np.zeros(3)
    first = (mean / np.linalg.norm(mean)) @ plane @ by[:3]
    return [
        {**prediction_entry("encounter", estimator, "b_plane", encounter, "km", plane @ by[:3], mean, answer), **earth},
        {**prediction_entry("perigee", estimator, "perigee_distance", encounter, "km", 0.8 * first[None], near, answer),
         **earth},
        prediction_entry("sky a week before", estimator, "sky", before, "arcsec", look, zero[:2], answer),
        prediction_entry("position at the encounter", estimator, "rtn", encounter, "km", rtn @ by[:3], zero, answer),
    ]  # fmt: skip


def noise_to_nuisance(case: Case) -> dict[str, Any]:
    """eta per measurement and the position accuracy it asks for."""
    eta = 10 * np.log10(2 * (0.1 * ARCSEC) ** 2 / (9.0 * np.sum(case.D**2, axis=(1, 2)) + 2 * (0.05 * ARCSEC) ** 2))
    critical = np.sqrt(2) * 0.1 * ARCSEC / np.sqrt(np.sum(case.D**2, axis=(1, 2)))
    low = float(np.min(critical))
    return {"eta_db_mean": float(np.mean(eta)), "eta_db": eta.tolist(), "sigma_z_critical_km": critical.tolist(),
            "sigma_z_limit_km": {"0_dB": low, "20_dB": low / 10, "40_dB": low / 100}}  # fmt: skip


MISSION_TEXT = "schema_version: 1\nname: apophis-2029  # <b>not markup</b>\nobject: {name: Apophis}\n"


def manifest() -> dict[str, Any]:
    """The manifest of the case."""
    return {
        "schema_version": 1, "status": "converged", "seed": 1,
        "versions": {"nebosvod": "0.1.0", "python": "3.11.9", "numpy": np.__version__},
        "mission": {"text": MISSION_TEXT, "sha256": "ab" * 32},
        "ephemeris": {"source": "DE440 excerpt 1990-2060", "sha256": "cd" * 32, "span": ["1990-01-01", "2060-01-01"]},
        "times": {"started_utc": "2026-11-22T17:00:00Z", "wall_s": 2.4, "cpu_s": 2.2},
        "outputs_sha256": {"arrays.npz": "ef" * 32},
    }  # fmt: skip


def history(case: Case) -> dict[str, Array]:
    """Arrays of the sigma history of the estimator `filter`: not determined (inf) for the first measurements."""
    true, formal = np.full(len(case.t_s), np.inf), np.full(len(case.t_s), np.inf)
    for k in range(6, len(case.t_s), 4):
        answer = case.solve(True, k + 1)
        true[k : k + 4], formal[k : k + 4] = blocks(answer["true"])[0], blocks(answer["formal"])[0]
    return {
        "history_t_s_filter": case.t_s,
        "history_sigma_position_km_filter": true,
        "history_sigma_formal_position_km_filter": formal,
    }


def build(folder: Path, days: float = 144.0, cadence_h: float = 48.0, object_name: str = "(99942) Apophis") -> Path:
    """Write a whole run folder and return it."""
    case = Case(days, cadence_h)
    full, blind = case.solve(True), case.solve(False)
    summary = {
        "schema_version": 1, "mission": "apophis-2029", "object": object_name,
        "title": "Apophis before the 2029 encounter, seen by two geostationary telescopes",
        "reference_epoch_tdb": "2028-11-15T00:00:00.000 TDB", "n_observations": len(case.t_s),
        "telescopes": list(TELESCOPES),
        "reference": {"position_km": case.states[0, :3].tolist(), "velocity_km_s": case.states[0, 3:].tolist()},
        "estimators": [estimator_entry(case, "batch", "batch_qr", full),
                       estimator_entry(case, "filter", "recursive", full),
                       estimator_entry(case, "bias ignored", "batch_qr", blind)],
        "budget": budget_entries("batch", full) + budget_entries("filter", full)
        + budget_entries("bias ignored", blind),
        "noise_to_nuisance": noise_to_nuisance(case),
        "predictions": predictions(case, "batch", full) + predictions(case, "bias ignored", blind),
        "accuracy_comparison": None, "consistency": None,
        "visibility": [{"telescope": t, "candidates": 289, "visible": len(case.t_s) // 2,
                        "removed": {"sun": 31, "earth": 3 + i}} for i, t in enumerate(TELESCOPES)],
        "physics": {"asteroids": True, "relativity": "sun", "earth_oblateness": True,
                    "radiation_pressure": {**{k: v for k, (v, _) in PHYSICAL.items()}, "thermal_emission": 0.0}},
        "warnings": ["UTC after 2027-06-28 uses TAI - UTC = 37 s"],
        "assumptions": ["albedo is the Bond albedo"],
    }  # fmt: skip
    n = len(case.t_s)
    arrays: dict[str, npt.NDArray[Any]] = {
        "epoch_s": case.t_s, "telescope_index": case.telescope, "telescope_names": np.array(TELESCOPES),
        "state": case.states[case.row_grid], "psi": case.psi, "residual": case.residual,
        "residual_after_batch": full["after"], "residual_after_filter": full["after"],
        "residual_after_bias ignored": blind["after"],
        "sigma_measurement": np.full((n, 2), 0.1 * ARCSEC), "telescope_position_km": case.place_km,
        "earth_position_km": earth_km(case.t_s), "object_track_km": case.states[:, :3], "object_track_t_s": case.grid_s,
        "names_batch": np.array(full["names"]), "factor_batch": np.linalg.cholesky(full["true"]), **history(case),
    }  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "manifest.json").write_text(json.dumps(manifest(), indent=1), encoding="utf-8")
    (folder / "summary.json").write_text(json.dumps(summary, indent=1), encoding="utf-8")
    np.savez(folder / "arrays.npz", **arrays)  # type: ignore[arg-type]
    return folder


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder as `nebosvod run` leaves it, before the report."""
    return build(tmp_path_factory.mktemp("run") / "apophis run")


@pytest.fixture(scope="session")
def make_run_folder() -> Callable[..., Path]:
    """The builder itself, for folders that differ."""
    return build


@pytest.fixture(scope="session")
def real_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the program itself: the smallest mission with a target on the sky, an ignored bias, and Monte Carlo."""
    from nebosvod.mission import load_mission
    from nebosvod.pipeline import run
    from nebosvod.report.pages import report_text
    from nebosvod.results.result import OwnedFolder

    folder = tmp_path_factory.mktemp("real")
    built_in = Path(__file__).parents[3] / "scenarios" / "minimal.yaml"
    text = built_in.read_text("utf-8").replace("  - {name: ten days later", SKY + "  - {name: ten days later")
    (folder / "small.yaml").write_text(text + ESTIMATORS, "utf-8")
    with OwnedFolder(folder / "run", report_text) as target:
        target.publish(run(load_mission(str(folder / "small.yaml")), seed=3))
    return folder / "run"


SKY = "  - {name: seen from ahead, plane: sky, from: ahead, at: 2028-04-29T00:00:00 TDB}\n"
ESTIMATORS = """monte_carlo: {runs: 40}
estimators:
  - {name: batch, method: batch_qr}
  - {name: blind, method: batch_qr, treatment: {bias: ignored}}
"""
