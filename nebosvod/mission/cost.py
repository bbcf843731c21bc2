"""What a mission will cost before it is started: measurements, memory, disk, time; and the limits.

Orders of magnitude, good to a factor of three: they keep a slip of the pen (a cadence of 1e-6 s, 10^9
Monte Carlo runs) from filling a disk.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from nebosvod.mission.fields import KeyPath
from nebosvod.mission.model import Mission

MAX_OBSERVATIONS = 1_000_000
MAX_RUNS = 100_000
MAX_TIME_S = 86400.0
_ROW_BYTES_MEMORY = 6000.0  # partials, whitened rows and factors of one measurement, several copies
_ROW_BYTES_DISK = 1200.0  # arrays.npz and the tables
_ROW_S = 60e-6  # trajectory, partials and one estimator
_START_S = 3.0  # imports, kernels, report
_RUN_S, _RUN_ROW_S = 1e-3, 4e-6  # one Monte Carlo run, and its share by measurement


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cost:
    """An estimate of what a run needs."""

    n_observations: int
    n_runs: int
    memory_mb: float
    disk_mb: float
    time_s: float

    def __str__(self) -> str:
        return (
            f"{self.n_observations:,} scheduled measurements, {self.n_runs:,} Monte Carlo runs: about "
            f"{_amount(self.memory_mb)} of memory, {_amount(self.disk_mb)} of disk, {_duration(self.time_s)}"
        )


def estimate_cost(mission: Mission) -> Cost:
    """Estimate what a run needs, from counts alone."""
    rows = sum(arc.count * _telescopes(mission, i) for i, arc in enumerate(mission.schedule))
    runs = mission.monte_carlo.runs if mission.monte_carlo else 0
    estimators = len(mission.estimators)
    return Cost(
        n_observations=rows,
        n_runs=runs,
        memory_mb=250.0 + rows * _ROW_BYTES_MEMORY / 1e6 + runs * 1e-3,
        disk_mb=2.0 + rows * _ROW_BYTES_DISK / 1e6 + runs * 1e-3,
        time_s=_START_S + rows * _ROW_S * (1 + estimators) + runs * estimators * (_RUN_S + rows * _RUN_ROW_S),
    )


def complaints(mission: Mission) -> Iterator[tuple[KeyPath, str]]:
    """What is beyond the limits, with the estimate."""
    cost = estimate_cost(mission)
    if cost.n_observations > MAX_OBSERVATIONS:
        counts = [arc.count * _telescopes(mission, i) for i, arc in enumerate(mission.schedule)]
        worst = max(range(len(counts)), key=counts.__getitem__)
        text = f"makes too many measurements ({cost}; allowed {MAX_OBSERVATIONS:,} measurements); use a longer cadence"
        yield ("schedule", worst, "cadence"), text
    if cost.n_runs > MAX_RUNS:
        yield (
            ("monte_carlo", "runs"),
            f"is too many ({cost}; allowed {MAX_RUNS:,} runs); a thousand gives sigmas to 2 %",
        )
    if cost.time_s > MAX_TIME_S and cost.n_observations <= MAX_OBSERVATIONS and 0 < cost.n_runs <= MAX_RUNS:
        yield ("monte_carlo", "runs"), f"would take more than a day ({cost}); use fewer runs or measurements"


def _telescopes(mission: Mission, arc: int) -> int:
    names = mission.schedule[arc].telescopes
    return len(mission.telescopes) if names == "all" else len(set(names))


def _amount(megabytes: float) -> str:
    for unit in ("MB", "GB", "TB"):
        if megabytes < 1000.0:
            return f"{megabytes:.3g} {unit}"
        megabytes /= 1000.0
    return f"{megabytes:,.3g} PB"


def _duration(seconds: float) -> str:
    for limit, size, unit in ((120.0, 1.0, "s"), (7200.0, 60.0, "min"), (172800.0, 3600.0, "h"), (3e7, 86400.0, "d")):
        if seconds < limit:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 31557600.0:,.3g} years"
