"""Trajectories as SPK and OEM files: read back by other readers they are the same trajectory."""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav, propagate
from nebosvod.dynamics.constants import AU_KM, DAY_S
from nebosvod.dynamics.trajectory import Trajectory
from nebosvod.dynamics.twobody import kepler
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
    assert arc.to_spk(tmp_path / "neo.bsp", 2000001) < 30
    assert (tmp_path / "neo.bsp").stat().st_size < 100_000


def test_spk_read_by_spice_is_the_trajectory_over_its_whole_span(
    flight: Trajectory, full_forces: ForceModel, neo: tuple[Epoch, Array], tmp_path: Path
) -> None:
    """1e-6 km and 1e-9 km/s by CSPICE itself, first and last moment too; one unpadded record and it reads nothing."""
    import spiceypy as spice

    years = propagate(neo[1], neo[0], [-400.0 * DAY_S, 3652.5 * DAY_S], full_forces, False)
    for number, arc in enumerate((flight, years)):
        path = tmp_path / f"{number}.bsp"
        arc.to_spk(path, 20099942)
        assert path.stat().st_size % 1024 == 0
        day_s, fraction_s = (arc.epoch.day - 2451545.0) * DAY_S, arc.epoch.fraction * DAY_S
        first, last = (day_s + fraction_s + t for t in arc.span_s)
        seconds = np.concatenate([[first, last], np.random.default_rng(1).uniform(first, last, 2000)])
        spice.furnsh(str(path))
        try:
            read = np.array([spice.spkgeo(20099942, et, "J2000", 10)[0] for et in seconds])
        finally:
            spice.unload(str(path))
        wanted = arc.state_at((seconds - day_s) - fraction_s)  # just the moments that SPICE was asked for
        assert np.abs(read - wanted)[:, :3].max() < 1e-6
        assert np.abs(read - wanted)[:, 3:].max() < 1e-9


def spice_states(path: Path, seconds: Array) -> Array:
    """States (n, 6) as SPICE reads type 3: each record by its own midpoint and radius (SPK Required Reading)."""
    from jplephem.daf import DAF

    states = np.full((len(seconds), 6), np.nan)
    with path.open("rb") as file:
        daf = DAF(file)
        for _, summary in daf.summaries():
            begin, end, first, last = summary[0], summary[1], summary[6], summary[7]
            start, length, width, count = daf.read_array(last - 3, last)
            assert width * count + 4 == last - first + 1
            assert start == begin
            assert start + length * count == pytest.approx(end, abs=1e-6)
            for row in daf.read_array(first, last - 4).reshape(int(count), int(width)):
                mine = np.abs(seconds - row[0]) <= row[1]
                value = np.polynomial.chebyshev.chebval((seconds[mine] - row[0]) / row[1], row[2:].reshape(6, -1).T)
                states[mine] = value.T
    return states


def test_records_carry_their_own_middle_and_radius(flight: Trajectory, tmp_path: Path) -> None:
    """0.2 m and 2e-9 km/s at every moment: jplephem takes the edges from the directory, SPICE from the record."""
    flight.to_spk(tmp_path / "a.bsp", 20099942)
    times = np.random.default_rng(3).uniform(*flight.span_s, 400)
    read = spice_states(tmp_path / "a.bsp", times + (flight.epoch - Epoch.from_jd(2451545.0)))
    assert np.abs(read - flight.state_at(times))[:, :3].max() < 2e-4
    assert np.abs(read - flight.state_at(times))[:, 3:].max() < 2e-9


def test_spk_of_decades_and_of_a_grazing_hour_keep_their_digits(ephemeris: Ephemeris, tmp_path: Path) -> None:
    """0.1 and 0.2 m, 2e-9 km/s: position limits a record far from the Sun; 7000 km from the Earth it is 560 s long."""
    epoch = Epoch.parse("2030-05-01T00:00:00 TDB")
    earth = (ephemeris.state_km_km_s("earth", epoch, 0.0) - ephemeris.state_km_km_s("sun", epoch, 0.0))[0]
    gm = ephemeris.gm_km3_s2["earth"]
    lowest = np.array([0.0, 7000.0, 0.0, np.sqrt(25.0 + 2.0 * gm / 7000.0), 0.0, 0.0])
    grazing = earth + kepler(lowest, [-7200.0], gm)[0]
    far = np.array([38.0 * AU_KM, 9.0 * AU_KM, 2.0 * AU_KM, -1.1, 4.6, 0.4])
    for start, end_s, limit_km in ((far, 25.0 * 365.25 * DAY_S, 1e-4), (grazing, 14400.0, 2e-4)):
        arc = propagate(start, epoch, [end_s], ForceModel(ephemeris=ephemeris), False)
        arc.to_spk(tmp_path / "x.bsp", 1)
        times = np.random.default_rng(4).uniform(*arc.span_s, 500)
        read = spice_states(tmp_path / "x.bsp", times + (epoch - Epoch.from_jd(2451545.0)))
        assert np.abs(read - arc.state_at(times))[:, :3].max() < limit_km
        assert np.abs(read - arc.state_at(times))[:, 3:].max() < 2e-9


def test_segment_name_must_fit(flight: Trajectory, tmp_path: Path) -> None:
    for name in ("Апофис", 41 * "x"):
        with pytest.raises(InputError, match="40 ASCII"):
            flight.to_spk(tmp_path / "x.bsp", 1, name)
    assert not (tmp_path / "x.bsp").exists()


def test_file_and_segments_carry_the_name(flight: Trajectory, tmp_path: Path) -> None:
    from jplephem.daf import DAF

    name = 40 * "x"
    flight.to_spk(tmp_path / "x.bsp", 1, name)
    with (tmp_path / "x.bsp").open("rb") as file:
        daf = DAF(file)
        assert daf.locifn.decode().strip() == name
        assert {segment.decode() for segment, _ in daf.summaries()} == {name}


def test_folder_that_does_not_exist_is_reported(flight: Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "nowhere" / "file"
    with pytest.raises(OutputError, match="nowhere"):
        flight.to_spk(path, 1)
    with pytest.raises(OutputError, match="nowhere"):
        flight.to_oem(path, object_name="A", object_id="1", created="2026-01-01T00:00:00")


def test_oem_read_back_is_the_trajectory_with_its_covariance(flight: Trajectory, tmp_path: Path) -> None:
    """1e-6 km and 1e-13 of the covariance: sixteen digits, and epochs to a nanosecond."""
    from nebosvod.observation.spacecraft.oem import read_oem

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


def test_oem_read_by_another_program_is_the_trajectory(flight: Trajectory, tmp_path: Path) -> None:
    """The package `oem` validates the file against CCSDS 502.0-B and finds epochs, states and covariances."""
    from oem import OrbitEphemerisMessage

    path, start = tmp_path / "apophis.oem", np.diag([1e4, 4e4, 9e4, 1e-10, 4e-10, 9e-10])
    flight.to_oem(path, object_name="APOPHIS", object_id="99942", created="2026-01-01T00:00:00", covariance=start)
    (segment,) = OrbitEphemerisMessage.open(path).segments
    heading = {key: segment.metadata[key] for key in ("CENTER_NAME", "REF_FRAME", "TIME_SYSTEM", "OBJECT_ID")}
    assert heading == {"CENTER_NAME": "SUN", "REF_FRAME": "ICRF", "TIME_SYSTEM": "TDB", "OBJECT_ID": "99942"}
    states = list(segment.states)
    assert np.array([np.concatenate([s.position, s.velocity]) for s in states]) == pytest.approx(
        flight.state, rel=1e-15
    )
    for epoch, t in zip((s.epoch.tdb for s in states), flight.t_s):
        moment = flight.epoch + float(t)
        late = ((epoch.jd1 - moment.day) + (epoch.jd2 - moment.fraction)) * DAY_S
        assert abs(late) < 2e-9 + 1e-10
    for read, Phi in zip(segment.covariances, flight.Phi, strict=True):
        wanted = Phi @ start @ Phi.T
        assert np.abs(read.matrix - wanted).max() < 1e-9 * np.abs(wanted).max()


def test_oem_needs_ascending_times(flight: Trajectory, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="ascend"):
        flight.at([DAY_S, 0.0]).to_oem(
            tmp_path / "x.oem", object_name="A", object_id="1", created="2026-01-01T00:00:00"
        )


def test_oem_needs_times_that_differ(flight: Trajectory, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="ascend"):
        flight.at([0.0, 0.0]).to_oem(tmp_path / "x.oem", object_name="A", object_id="1", created="2026-01-01T00:00:00")


def test_oem_refuses_what_it_cannot_hold(flight: Trajectory, tmp_path: Path) -> None:
    path, created = tmp_path / "x.oem", "2026-01-01T00:00:00"
    with pytest.raises(InputError, match=r"shape \(6, 6\), got \(3, 3\)"):
        flight.to_oem(path, object_name="A", object_id="1", created=created, covariance=np.eye(3))
    with pytest.raises(InputError, match="ASCII"):
        flight.to_oem(path, object_name="Апофис", object_id="1", created=created)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"created": "yesterday"}, r"created 'yesterday' is not allowed \(a date in UTC like 2026-01-31T12:00:00\)"),
        ({"created": ""}, r"created '' is not allowed"),
        ({"created": "2026-01-01"}, r"created '2026-01-01' is not allowed"),
        ({"created": "2026-01-01T00:00:00\nX = 1"}, r"created .* is not allowed"),
        ({"created": "2026-02-30T00:00:00"}, r"created '2026-02-30T00:00:00' is not allowed .*no such date"),
        ({"object_name": "A\nCENTER_NAME = EARTH"}, r"object_name .* is not allowed \(one line of printable ASCII"),
        ({"object_name": " "}, r"object_name ' ' is not allowed .*not empty"),
        ({"object_id": "1\r2"}, r"object_id '1\\r2' is not allowed"),
        ({"object_id": ""}, r"object_id '' is not allowed .*not empty"),
    ],
)
def test_oem_refuses_texts_that_would_break_its_lines(
    flight: Trajectory, tmp_path: Path, options: dict[str, str], message: str
) -> None:
    good = {"object_name": "A", "object_id": "1", "created": "2026-01-01T00:00:00"}
    with pytest.raises(InputError, match=message):
        flight.to_oem(tmp_path / "x.oem", **{**good, **options})
    assert not list(tmp_path.iterdir())


def changed(i: int, j: int, value: float) -> Array:
    """The covariance of 100 km and 1e-5 km/s with one element changed."""
    matrix = np.diag([1e4, 1e4, 1e4, 1e-10, 1e-10, 1e-10])
    matrix[i, j] = value
    return matrix


def correlated(rho: float) -> Array:
    """x and vx correlated by rho."""
    matrix = changed(0, 3, 1e-3 * rho)
    matrix[3, 0] = 1e-3 * rho
    return matrix


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (changed(2, 4, np.nan), "needs finite numbers, got nan in row 2, column 4"),
        (changed(5, 5, np.inf), "needs finite numbers, got inf in row 5, column 5"),
        (changed(4, 4, -1e-10), "needs variances of 0 or more, got -1e-10"),
        (changed(0, 3, 1e-5), "must be symmetric, got 1e-05 in row 0, column 3 and 0 in row 3, column 0"),
        (correlated(1.1), "must be positive semidefinite, got a smallest eigenvalue of the correlations of -0.1"),
    ],
)
def test_oem_refuses_a_matrix_that_is_no_covariance(
    flight: Trajectory, tmp_path: Path, covariance: Array, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        flight.to_oem(
            tmp_path / "x.oem", object_name="A", object_id="1", created="2026-01-01T00:00:00", covariance=covariance
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("covariance", [np.zeros((6, 6)), correlated(1.0), correlated(1.0 + 1e-10)])
def test_oem_takes_a_singular_covariance(flight: Trajectory, tmp_path: Path, covariance: Array) -> None:
    """A direction known exactly, also as a text of ten digits has it."""
    flight.at([0.0]).to_oem(
        tmp_path / "x.oem", object_name="A", object_id="1", created="2026-01-01T00:00:00", covariance=covariance
    )


def test_oem_is_written_as_the_standard_asks(flight: Trajectory, tmp_path: Path) -> None:
    """Line by line (CCSDS 502.0-B-2, 5.2): header, metadata, ephemeris, covariance; epochs to a nanosecond."""
    path, short = tmp_path / "x.oem", flight.at([0.0, 0.123456789])
    short.to_oem(path, object_name="APOPHIS", object_id="2004 MN4", created="2026-01-01T00:00:00", covariance=np.eye(6))
    lines = path.read_text().splitlines()
    first, last = "2029-02-01T03:00:00.000000000", "2029-02-01T03:00:00.123456789"
    assert lines[:13] == [
        "CCSDS_OEM_VERS = 2.0", "CREATION_DATE = 2026-01-01T00:00:00", "ORIGINATOR = NEBOSVOD", "",
        "META_START", "OBJECT_NAME = APOPHIS", "OBJECT_ID = 2004 MN4", "CENTER_NAME = SUN", "REF_FRAME = ICRF",
        "TIME_SYSTEM = TDB", f"START_TIME = {first}", f"STOP_TIME = {last}", "META_STOP",
    ]  # fmt: skip
    assert [line.split()[0] for line in lines[14:16]] == [first, last]
    assert lines[17:20] == ["COVARIANCE_START", f"EPOCH = {first}", "COV_REF_FRAME = ICRF"]
    assert [len(line.split()) for line in lines[20:26]] == [1, 2, 3, 4, 5, 6]
    assert lines[26:28] == [f"EPOCH = {last}", "COV_REF_FRAME = ICRF"]
    assert lines[-1] == "COVARIANCE_STOP"
    assert len(lines) == 35


def _write(flight: Trajectory, path: Path) -> None:
    """The trajectory as the kind of file that the name says."""
    if path.suffix == ".bsp":
        flight.to_spk(path, target=2000001, name="A")
    else:
        flight.to_oem(path, object_name="A", object_id="1", created="2026-01-01T00:00:00")


@pytest.mark.parametrize("name", ["x.bsp", "x.oem"])
def test_exports_are_written_whole_under_a_new_name_and_never_through_a_link(
    flight: Trajectory, tmp_path: Path, name: str
) -> None:
    """A second name of the old file keeps the old bytes, so the new ones were not written into it."""
    path, other, link = tmp_path / name, tmp_path / "other", tmp_path / f"link-{name}"
    path.write_bytes(b"old")
    other.hardlink_to(path)
    _write(flight, path)
    assert other.read_bytes() == b"old"
    assert path.stat().st_size > 1000
    link.symlink_to(other)
    with pytest.raises(OutputError, match="symbolic link"):
        _write(flight, link)
    assert other.read_bytes() == b"old"
    assert {one.name for one in tmp_path.iterdir()} == {name, "other", f"link-{name}"}
