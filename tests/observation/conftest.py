"""Support of the observation tests: the real ephemeris, and a closed-form orbit that stands in for a trajectory."""

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.constants import AU_KM
from nebosvod.timescale import Epoch

GM_SUN = 1.3271244004127942e11
DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoBody:
    """A Kepler orbit about the Sun with a constant transverse thrust-like parameter: state, Phi and zeta exact to
    round-off by complex-step differentiation of the closed form. Times are seconds after the epoch."""

    epoch: Epoch
    start: Any  # (6,) heliocentric state at the epoch
    kick: float = 0.0  # the one "dynamic parameter": multiplies a displacement of t^2, see `position`
    t_s: Any = None
    parameter_names: tuple[str, ...] = ("kick",)

    def _flow(self, start: Any, kick: Any, t: Any) -> Any:
        """State (n, 6) by f and g functions of the eccentric-anomaly difference; works on complex numbers."""
        r0, v0 = start[:3], start[3:]
        r = np.sqrt(np.sum(r0 * r0))
        a = 1.0 / (2.0 / r - np.sum(v0 * v0) / GM_SUN)
        n = np.sqrt(GM_SUN / a**3)
        ec, es = 1.0 - r / a, np.sum(r0 * v0) / np.sqrt(GM_SUN * a)
        x = (n * t).astype(complex)
        for _ in range(30):
            f = x - ec * np.sin(x) + es * (1.0 - np.cos(x)) - n * t
            x = x - f / (1.0 - ec * np.cos(x) + es * np.sin(x))
        cos, sin = np.cos(x), np.sin(x)
        now = a * (1.0 - ec * cos + es * sin)
        F, g = 1.0 - a / r * (1.0 - cos), t + (sin - x) / n
        Fdot, gdot = -np.sqrt(GM_SUN * a) / (now * r) * sin, 1.0 - a / now * (1.0 - cos)
        position = F[:, None] * r0 + g[:, None] * v0
        velocity = Fdot[:, None] * r0 + gdot[:, None] * v0
        drift = np.array([1e-9, -2e-9, 5e-10])
        return np.concatenate(
            [position + kick * drift * t[:, None] ** 2, velocity + 2.0 * kick * drift * t[:, None]], axis=1
        )

    @property
    def state(self) -> Any:
        return self._flow(self.start, self.kick, self.t_s).real

    @property
    def Phi(self) -> Any:
        columns = []
        for j in range(6):
            h = 1e-30 * (AU_KM if j < 3 else 30.0)
            step = self.start.astype(complex)
            step[j] += 1j * h
            columns.append(self._flow(step, self.kick, self.t_s).imag / h)
        return np.stack(columns, axis=2)

    @property
    def zeta(self) -> Any:
        return self._flow(self.start, self.kick + 1e-30j, self.t_s).imag[:, :, None] / 1e-30

    def at(self, t_s: Any) -> "TwoBody":
        return replace(self, t_s=np.asarray(t_s, dtype=np.float64))

    def state_at(self, t_s: Any) -> Any:
        return self.at(t_s).state


@pytest.fixture(scope="session")
def ephemeris() -> Ephemeris:
    return Ephemeris.load()


@pytest.fixture(scope="session")
def epoch() -> Epoch:
    return Epoch.parse("2028-11-15T00:00:00 TDB")


@pytest.fixture(scope="session")
def two_body(epoch: Epoch) -> TwoBody:
    """An Apophis-like orbit: a = 0.92 au, e = 0.19, i = 3.3 deg."""
    start = np.array([-0.52, 0.83, 0.31]) * AU_KM
    return TwoBody(epoch=epoch, start=np.concatenate([start, [-24.5, -11.0, -3.6]]), kick=1.0)


@pytest.fixture(scope="session")
def data() -> Path:
    if not DATA.is_dir():
        pytest.skip(f"reference data not found at {DATA}")
    return DATA


@dataclass(frozen=True, kw_only=True, eq=False)
class Still:
    """A target that stays at one heliocentric place: for tests of geometry."""

    epoch: Epoch
    position: Any  # (3,)
    t_s: Any = None
    parameter_names: tuple[str, ...] = ()

    @property
    def state(self) -> Any:
        return np.tile(np.concatenate([self.position, np.zeros(3)]), (self.t_s.size, 1))

    def at(self, t_s: Any) -> "Still":
        return replace(self, t_s=np.asarray(t_s, dtype=np.float64))

    def state_at(self, t_s: Any) -> Any:
        return self.at(t_s).state


@dataclass(frozen=True, kw_only=True, eq=False)
class Shifted:
    """Another spacecraft displaced by a constant vector, or one that rests at a displacement from a body."""

    by_km: Any
    spacecraft: Any = None
    body: str = ""
    centre: str = "earth"

    def state_km_km_s(self, ephemeris: Any, epoch: Epoch, t_s: Any) -> Any:
        if self.spacecraft is None:
            base = ephemeris.state_km_km_s(self.body, epoch, t_s)
        else:
            base = self.spacecraft.state_km_km_s(ephemeris, epoch, t_s)
        return base + np.concatenate([self.by_km, np.zeros(3)])


def derivative(f: Any, h: float) -> Any:
    """Central difference of fourth order: the error is f^(5) h^4 / 30, about 1e-12 of f' for h = 1e-3 of its scale."""
    return (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)


@pytest.fixture(scope="session")
def support() -> Any:
    """The stand-ins and the derivative, for test modules that are imported by path."""
    return SimpleNamespace(
        TwoBody=TwoBody,
        Still=Still,
        Shifted=Shifted,
        derivative=derivative,
        likelihood_ratio=likelihood_ratio,
    )


def likelihood_ratio(draws: Any, covariance: Any) -> tuple[float, float]:
    """Two-sided p-value that draws (N, d) about zero have this covariance, and the one for their mean being zero.

    N (tr W - ln det W - d) with W the sample covariance whitened by the true one is chi-square with d (d + 1) / 2
    degrees of freedom: it sees every variance and every correlation at once.
    """
    count, size = draws.shape
    white = np.linalg.solve(np.linalg.cholesky(covariance), draws.T)
    W = white @ white.T / count
    statistic = count * (np.trace(W) - np.linalg.slogdet(W)[1] - size)
    mean = count * np.sum(white.mean(axis=1) ** 2)
    return _two_sided(statistic, size * (size + 1) / 2), _two_sided(mean, size)


def _two_sided(statistic: float, dof: float) -> float:
    return float(2.0 * min(chi2.cdf(statistic, dof), chi2.sf(statistic, dof)))
