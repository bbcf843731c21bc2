"""What a mission will cost before it is started: measurements, memory, disk, time; and the limits.

Good to a factor of two on the machine the built-in missions were timed on: they keep a slip of the pen (a cadence of
1e-6 s, 10^9 Monte Carlo runs) from filling a disk. Orbits that are flown anew cost most: two for each uncertain
parameter of the orbit to see how far a prediction is from linear, and one for each Monte Carlo run.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from nebosvod.mission.fields import KeyPath
from nebosvod.mission.model import Mission
from nebosvod.mission.reading import flight

MAX_OBSERVATIONS = 1_000_000
MAX_RUNS = 100_000
MAX_TIME_S = 86400.0
MAX_FULL_GAINS = 2000  # measurements of which the response of each to each is kept: 200 MB
_ROW_BYTES_MEMORY = 6000.0  # partials, whitened rows and factors of one measurement, several copies
_ROW_BYTES_DISK = 1200.0  # arrays.npz and the tables
_ROW_S = 60e-6  # trajectory, partials and one estimator
_SHOCKS_S = 2.5e-5  # by the cube of the intervals of process noise: 72 of them take 10 s
_START_S = 2.6  # imports, kernels, report
_ACCURACY_S, _ACCURACY_ROW_S = 0.15, 150e-6  # curves, requirements, comparison of one prediction; its share by row
_MOST_ROWS = 2000  # beyond so many those searches are thinned or left out
_PAGE_S = 0.12  # figures and tables of one prediction
_STEP_BYTES, _ONE_STEP_S = 20e3, 40e-6  # a step of the integration, with the bodies at its nodes; where it is searched
_FLOWN_STEP_S = 20e-6  # a step of an orbit flown with many others
_FLIGHT_S, _POINT_S, _ENCOUNTER_S = 0.5e-3, 0.2e-3, 1.2e-3  # an orbit flown anew, and what is predicted on it
_HIT_FLIGHT_S, _HIT_S = 7e-3, 12e-3  # the same where it comes down
_DRAW_S, _DRAW_ROW_S = 0.4e-3, 1e-6  # one Monte Carlo truth, measured, and its share by row
_STEP_S, _STEP_ROW_S = 0.05e-3, 0.2e-6  # one linear estimate of it
_ITERATED_S, _ITERATED_ROW_S = 15e-3, 40e-6  # one iterated estimate of it, where a linear step would not do
CLONES_MOST = 2000  # orbits drawn about the first estimate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cost:
    """An estimate of what a run needs."""

    n_observations: int
    n_runs: int
    memory_mb: float
    disk_mb: float
    time_s: float
    time_iterated_s: float  # where Monte Carlo must iterate every estimate; the same without Monte Carlo

    def __str__(self) -> str:
        return (
            f"{self.n_observations:,} scheduled measurements, {self.n_runs:,} Monte Carlo runs: about "
            f"{_amount(self.memory_mb)} of memory, {_amount(self.disk_mb)} of disk, {_duration(self.time_s)}"
            + (f" ({_duration(self.time_iterated_s)} where one linear step would not do)" if self.n_runs else "")
        )


def estimate_cost(mission: Mission) -> Cost:
    """Estimate what a run needs, from counts alone."""
    rows = sum(arc.count * _telescopes(mission, i) for i, arc in enumerate(mission.schedule))
    runs = mission.monte_carlo.runs if mission.monte_carlo else 0
    count = len(mission.estimators)
    linear = runs * (_DRAW_S + rows * _DRAW_ROW_S + count * (_STEP_S + rows * _STEP_ROW_S))
    iterated = runs * (1 + count) * (_ITERATED_S + rows * _ITERATED_ROW_S)
    steps = flight.steps(mission)
    rest = _START_S + 4.0 * steps * _ONE_STEP_S + rows * _ROW_S * (1 + count) + _predicting_s(mission, rows, runs)
    rest += count * _shocks_s(mission)
    return Cost(
        n_observations=rows,
        n_runs=runs,
        memory_mb=250.0 + rows * _ROW_BYTES_MEMORY / 1e6 + runs * 1e-3 + steps * _STEP_BYTES / 1e6,
        disk_mb=2.0 + rows * _ROW_BYTES_DISK / 1e6 + runs * 1e-3,
        time_s=rest + linear,
        time_iterated_s=rest + (iterated if runs else linear),
    )


def _shocks_s(mission: Mission) -> float:
    """Process noise for one estimator: three parameters an interval, in solutions that are dense in them."""
    noise = mission.object.process_noise
    return 0.0 if noise is None or noise.treatment == "fixed" else _SHOCKS_S * noise.intervals**3


def _predicting_s(mission: Mission, rows: int, runs: int) -> float:
    """Accuracy of the predictions: analysis, orbits flown at the ends of the sigmas, and those drawn by Monte Carlo."""
    asked = len(mission.predictions)
    kinds = len({tuple(sorted(one.treatment.items())) for one in mission.estimators})
    encounters = sum(hasattr(one, "near") for one in mission.predictions)
    lands = any(one.plane == "entry" for one in mission.predictions)
    flown_s, encounter = (_HIT_FLIGHT_S, _HIT_S) if lands else (_FLIGHT_S, _ENCOUNTER_S)
    orbit = flight.steps(mission) * _FLOWN_STEP_S + flown_s + encounters * encounter + (asked - encounters) * _POINT_S
    flown = kinds * 2 * (6 + len(mission.free_parameters)) + min(runs, CLONES_MOST) if asked else 0
    analysis = kinds * (_ACCURACY_S + min(rows, _MOST_ROWS) * _ACCURACY_ROW_S) + _PAGE_S
    return asked * analysis + flown * orbit


def complaints(mission: Mission) -> Iterator[tuple[KeyPath, str]]:
    """What is beyond the limits, with the estimate."""
    cost = estimate_cost(mission)
    if cost.n_observations > MAX_OBSERVATIONS:
        counts = [arc.count * _telescopes(mission, i) for i, arc in enumerate(mission.schedule)]
        worst = max(range(len(counts)), key=counts.__getitem__)
        text = f"makes too many measurements ({cost}; allowed {MAX_OBSERVATIONS:,} measurements); use a longer cadence"
        yield ("schedule", worst, "cadence"), text
    if "full_gains" in mission.report.show and cost.n_observations > MAX_FULL_GAINS:
        text = f"full_gains grows with the square of the measurements (got {cost.n_observations:,} scheduled; allowed "
        yield ("report", "show"), f"{text}{MAX_FULL_GAINS:,}); gains has those of each nuisance by its own measurement"
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
