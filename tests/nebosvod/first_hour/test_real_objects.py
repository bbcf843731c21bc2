"""Real tracklets cut after each observation: impactors, a main-belt asteroid, one that was feared for some days."""

import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris
from nebosvod.first_hour.falls import interval
from nebosvod.pipeline import mission_of, objects

sys.path.insert(0, str(Path(__file__).resolve().parent))
from hour_real import DATA, FILES, answered, of  # type: ignore[import-not-found]

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference data is not here")


@pytest.fixture(scope="module")
def bodies() -> Ephemeris:
    return Ephemeris.load()


@pytest.mark.long
@needs_data
@pytest.mark.parametrize(
    ("name", "count", "low", "high"),
    [
        ("2014 AA", 3, 0.01, 0.08),  # 0.03 by an independent light ranging
        ("2014 AA", 4, 0.9, 1.0),
        ("2014 AA", 7, 0.9, 1.0),
        ("2018 LA", 4, 0.1, 0.35),
        ("2018 LA", 8, 0.3, 0.6),
        ("2018 LA", 13, 0.99, 1.0),
        ("2024 BX1", 7, 0.9, 1.0),
        ("2024 BX1", 14, 0.99, 1.0),
        ("2024 BX1", 40, 0.99, 1.0),
        ("2023 DW", 3, 0.0, 1e-3),
        ("2023 DW", 13, 0.0, 1e-3),
    ],
)
def test_the_probability_after_so_many_observations(
    name: str, count: int, low: float, high: float, bodies: Ephemeris
) -> None:
    """Under the headline prior."""
    found = answered(FILES[name], slice(0, count), bodies, 30.0 if name == "2023 DW" else 100.0)
    assert found.enough
    assert low <= found.headline.probability <= high


@pytest.mark.long
@needs_data
def test_one_night_of_a_main_belt_asteroid_is_no_alarm(bodies: Ephemeris) -> None:
    """(3666) Holman, the last night with three records of one station."""
    path = FILES["Holman"]
    mission = mission_of([str(path)])
    (records,) = objects(mission, split=False)
    records = records.by_time()
    nights = defaultdict(list)
    for k, (station, t_s) in enumerate(zip(records.station.tolist(), records.t_s.tolist(), strict=True)):
        nights[station, int(t_s // 86400.0)].append(k)
    rows = [rows for rows in nights.values() if len(rows) == 3][-1]
    found = of(records.select(np.array(rows)), path, bodies)
    assert found.headline.bound  # less than one of as many plain draws
    assert found.headline.probability < 1e-4
    assert found.headline.high < 2e-3
    assert len(found.grid.lines) < 200  # near the Earth, where rates hardly settle, it had 492


def test_intervals_hold_what_plain_draws_leave_open() -> None:
    """Of k hits in N plain draws Clopper and Pearson's interval; of few hits only an upper end, about theirs."""
    low, high = interval(0.1, 0.1 * 0.9 / 1000.0, 1000)
    assert low == pytest.approx(0.0821, abs=2e-4)  # tables, 100 of 1000
    assert high == pytest.approx(0.1203, abs=2e-4)
    assert interval(1e-3, 1e-6, 1000)[0] == 0.0
    assert 4e-3 < interval(1e-3, 1e-6, 1000)[1] < 6e-3  # one hit of 1000: 5.6e-3
    assert interval(1.0, 0.0, 500)[1] == 1.0


@needs_data
def test_a_prior_that_favours_what_is_far_is_not_cut_by_a_rate_that_is_not_allowed(bodies: Ephemeris) -> None:
    """2024 BX1 after seven, uniform in space and velocity: 0.010 +- 0.002 by a ranging of its own (DOP853, jplephem).

    Lines that ended 5.5 sigmas from a rate of 500 km/s left what is beyond 0.03 au out, and said 0.48.
    """
    found = answered(FILES["2024 BX1"], slice(0, 7), bodies).chances["cartesian"]
    assert 0.004 < found.probability < 0.03
