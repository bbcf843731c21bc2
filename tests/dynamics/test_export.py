"""Trajectories as SPK and OEM files: read back by other readers they are the same trajectory."""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav, propagate
from nebosvod.dynamics.constants import DAY_S
from nebosvod.dynamics.trajectory import Trajectory
from nebosvod.errors import InputError, OutputError
from nebosvod.timescale import Epoch

Array = np.ndarray


@pytest.fixture(scope="module")
def flight(ephemeris: Ephemeris, apophis: Callable[[Epoch, Any], Array], apophis_nongrav: Nongrav) -> Trajectory:
    """Apophis through the 2029 encounter: the hardest arc to tabulate."""
    epoch = Epoch.parse("2029-02-01T03:00:00 TDB")
    times = np.arange(0.0, 100.0, 0.5) * DAY_S
    return propagate(apophis(epoch, 0.0)[0], epoch, times, ForceModel(ephemeris=ephemeris, nongrav=apophis_nongrav))


def test_spk_read_by_jplephem_is_the_trajectory(flight: Trajectory, tmp_path: Path) -> None:
    """0.2 m and 2e-9 km/s: twice what the writer allows, for jplephem's day fractions."""
    from jplephem.spk import SPK

    count = flight.to_spk(tmp_path / "apophis.bsp", 20099942, "Apophis, a test")
    times = np.random.default_rng(2).uniform(*flight.span_s, 400)
    wanted = flight.state_at(times)
    with SPK.open(str(tmp_path / "apophis.bsp")) as kernel:
        assert len(kernel.segments) == count
        assert {(s.center, s.target, s.data_type, s.frame) for s in kernel.segments} == {(10, 20099942, 3, 1)}
        for t, state in zip(times, wanted):
            moment = flight.epoch + float(t)
            segment = next(s for s in kernel.segments if s.start_jd - 1e-9 <= moment.jd_tdb <= s.end_jd + 1e-9)
            read = segment.compute(moment.day, moment.fraction)
            assert np.abs(read[:3] - state[:3]).max() < 2e-4
            assert np.abs(read[3:] - state[3:]).max() < 2e-9
        ends = sorted((s.start_second, s.end_second) for s in kernel.segments)
    for (_, end), (start, _) in itertools.pairwise(ends):
        assert start == pytest.approx(end, abs=1e-6)


def test_smooth_arc_needs_few_segments(full_forces: ForceModel, neo: tuple[Epoch, Array], tmp_path: Path) -> None:
    arc = propagate(neo[1], neo[0], [365.25 * DAY_S], full_forces, False)
    assert arc.to_spk(tmp_path / "neo.bsp", 2000001) < 8
    assert (tmp_path / "neo.bsp").stat().st_size < 100_000


def test_spk_read_by_spice(flight: Trajectory, tmp_path: Path) -> None:
    spice = pytest.importorskip("spiceypy", reason="spiceypy is not installed")
    path = str(tmp_path / "apophis.bsp")
    flight.to_spk(path, 20099942)
    spice.furnsh(path)
    try:
        for t in np.linspace(flight.span_s[0], flight.span_s[1], 30):
            seconds = (flight.epoch - Epoch.from_jd(2451545.0)) + t
            state = spice.spkgeo(20099942, seconds, "J2000", 10)[0]
            assert np.abs(state - flight.state_at([t])[0])[:3].max() < 2e-4
    finally:
        spice.unload(path)


def test_segment_name_must_fit(flight: Trajectory, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="40 ASCII"):
        flight.to_spk(tmp_path / "x.bsp", 1, "Апофис")


def test_folder_that_does_not_exist_is_reported(flight: Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "nowhere" / "file"
    with pytest.raises(OutputError, match="nowhere"):
        flight.to_spk(path, 1)
    with pytest.raises(OutputError, match="nowhere"):
        flight.to_oem(path, object_name="A", object_id="1", created="2026-01-01T00:00:00")


def test_oem_read_back_is_the_trajectory_with_its_covariance(flight: Trajectory, tmp_path: Path) -> None:
    """1e-6 km and 1e-13 of the covariance: sixteen digits, and epochs to a nanosecond."""
    from nebosvod.observation.oem import read_oem

    factor = np.diag([100.0, 100.0, 100.0, 1e-5, 1e-5, 1e-5]) @ (np.eye(6) + 0.2 * np.tri(6))
    start = factor @ factor.T
    path = tmp_path / "apophis.oem"
    flight.to_oem(path, object_name="APOPHIS", object_id="99942", created="2026-01-01T00:00:00", covariance=start)
    text = path.read_text()
    assert text.startswith("CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2026-01-01T00:00:00\n")
    message = read_oem(path)
    assert message.object_name == "APOPHIS"
    assert len(message.covariances) == len(flight.t_s)
    for read, Phi, t in zip(message.covariances, flight.Phi, flight.t_s):
        wanted = Phi @ start @ Phi.T
        size = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
        assert np.abs((read.covariance - wanted) / size).max() < 1e-13
        assert abs(read.epoch - (flight.epoch + float(t))) < 2e-9 + 1e-5
    rows = [line.split() for line in text.split("META_STOP")[1].split("COVARIANCE_START")[0].split("\n") if line]
    assert np.array([[float(word) for word in row[1:]] for row in rows]) == pytest.approx(flight.state, rel=1e-15)


def test_oem_needs_ascending_times(flight: Trajectory, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="ascend"):
        flight.at([DAY_S, 0.0]).to_oem(
            tmp_path / "x.oem", object_name="A", object_id="1", created="2026-01-01T00:00:00"
        )
