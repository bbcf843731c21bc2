"""Spacecraft from tables, SPK and OEM files."""

import numpy as np
import pytest
from jplephem.spk import SPK
from scipy.interpolate import BarycentricInterpolator, KroghInterpolator

from nebosvod.errors import CoverageError, DataError, InputError
from nebosvod.observation import read_oem, read_spk, table
from nebosvod.observation.kepler import kepler_state
from nebosvod.observation.tabulated import Segment
from nebosvod.timescale import Epoch

DAY = 86400.0


def kepler(t):
    one = np.ones(t.size)
    return kepler_state(398600.4, 42164.0, 0.1, 0.3, 0.2 * one, 0.7 * one, t * np.sqrt(398600.4 / 42164.0**3))


def segment_of(polynomials, method, window, nodes):
    """A table of six polynomials, or of three and their derivatives."""
    both = [*polynomials, *(p.deriv() for p in polynomials)][:6]
    states = np.stack([p(nodes) for p in both], axis=1)
    return both, Segment(t_s=nodes, states=states, start_s=nodes[0], end_s=nodes[-1], method=method, window=window)


@pytest.mark.parametrize(
    ("method", "window", "degree", "count"), [("hermite", 4, 7, 3), ("hermite", 3, 5, 3), ("lagrange", 5, 4, 6)]
)
def test_interpolation_reproduces_polynomials_of_its_degree_and_no_higher(method, window, degree, count):
    rng = np.random.default_rng(1)
    nodes = 0.25 * np.arange(12) + rng.uniform(0.0, 0.15, 12)
    where = rng.uniform(nodes[0], nodes[-1], 60)  # windows in disorder
    for more, exact in ((0, True), (1, False)):
        polynomials = [np.polynomial.Polynomial(c) for c in rng.normal(size=(count, degree + 1 + more))]
        expected, segment = segment_of(polynomials, method, window, nodes)
        error = np.abs(segment.evaluate(where) - np.stack([p(where) for p in expected], axis=1))
        # values up to 3^7: round-off 5e-13, times the growth of differences over close points
        assert bool(error.max() < 1e-9) is exact


@pytest.mark.parametrize("method", ["hermite", "lagrange"])
def test_interpolation_is_that_of_scipy_in_a_window_about_each_time(method):
    nodes = np.sort(np.random.default_rng(2).uniform(0.0, 2.0, 30)) * DAY
    states = kepler(nodes)
    segment = Segment(t_s=nodes, states=states, start_s=nodes[0], end_s=nodes[-1], method=method, window=6)
    for where in np.linspace(nodes[0], nodes[-1], 47)[1:-1]:
        first = int(np.clip(np.searchsorted(nodes, where) - 3, 0, 24))
        mine = slice(first, first + 6)
        found = segment.evaluate(np.array([where]))[0]
        if method == "lagrange":
            expected = BarycentricInterpolator(nodes[mine], states[mine])(where)
        else:
            points = np.repeat(nodes[mine], 2)
            values = np.stack([states[mine, :3], states[mine, 3:] * DAY], axis=1).reshape(-1, 3)
            curve = KroghInterpolator((points - where) / DAY, values)
            expected = np.concatenate([curve(0.0), curve.derivative(0.0) / DAY])
        np.testing.assert_allclose(found[:3], expected[:3], rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(found[3:], expected[3:], rtol=0.0, atol=1e-10)


def test_a_table_gives_its_points_and_the_orbit_between_them(ephemeris, epoch):
    nodes = np.arange(0.0, 2.0, 0.02) * DAY
    orbit = table(epoch, nodes, kepler(nodes), "earth")
    between = np.linspace(0.0, nodes[-1], 777)
    state = orbit.state_km_km_s(ephemeris, epoch, between) - ephemeris.state_km_km_s("earth", epoch, between)
    # sixteenth-order interpolation of a step of 1/50 revolution: round-off of 1.5e8 km remains
    np.testing.assert_allclose(state[:, :3], kepler(between)[:, :3], rtol=0.0, atol=2e-7)
    np.testing.assert_allclose(state[:, 3:], kepler(between)[:, 3:], rtol=0.0, atol=1e-9)


def test_a_table_refuses_times_outside_with_its_span(ephemeris, epoch):
    nodes = np.arange(5) * 3600.0
    orbit = table(epoch, nodes, kepler(nodes), "earth", source="mine.ecsv")
    with pytest.raises(CoverageError, match=r"mine.ecsv: no state at 2028-11-16.*2028-11-15T00:00:00 TDB to 2028-11"):
        orbit.state_km_km_s(ephemeris, epoch, np.array([0.0, DAY]))


@pytest.mark.parametrize(
    ("t_s", "states", "words"),
    [
        ([0.0, 0.0, 1.0], np.zeros((3, 6)), "ascend"),
        ([0.0, 1.0, 2.0], np.zeros((3, 5)), r"states \(k, 6\)"),
        ([0.0, 1.0, 2.0], np.full((3, 6), np.nan), "not finite"),
        ([0.0], np.zeros((1, 6)), "at least two"),
    ],
)
def test_broken_tables_are_refused(epoch, t_s, states, words):
    with pytest.raises(InputError, match=words):
        table(epoch, t_s, states, "earth")


# NAIF CSPICE through spiceypy, spkgeo(-170, et, "J2000", 10) on the file of the shared data: et, km, km/s
CSPICE_JWST = [
    (
        631109800.0,
        [
            -24663978.838716466,
            134098056.93903147,
            58334008.88508941,
            -30.35378671803126,
            -4.778728455930371,
            -1.998144707233228,
        ],
    ),
    (
        700000000.25,
        [
            -146540100.6549917,
            29505808.368314147,
            12522962.957883319,
            -6.979290747428827,
            -26.884511699948675,
            -11.746241265080648,
        ],
    ),
    (
        721234567.0,
        [
            103763070.4559664,
            99040288.67020023,
            42763518.591133535,
            -22.158413545219535,
            18.845947071583335,
            8.291717149277707,
        ],
    ),
    (
        756987654.322,
        [
            -14365282.33139025,
            135324865.58749887,
            58971552.12146449,
            -30.69525874795308,
            -2.79838381749268,
            -1.2184597021311698,
        ],
    ),
    (
        757296000.0,
        [
            -23794407.7133634,
            134190801.6773687,
            58474477.18261771,
            -30.443573310051487,
            -4.554798643135228,
            -2.003928579167053,
        ],
    ),
]


class TestSpk:
    """JWST (type 13) and Apophis (type 2)."""

    @pytest.fixture
    def jwst(self, data):
        return data / "observers" / "jwst_horizons_20200101_20240101_v01.bsp"

    def test_type_13_agrees_with_cspice_to_a_millimetre(self, jwst, ephemeris):
        """At both ends, at odd times, and at the last point itself."""
        orbit = read_spk(jwst)
        assert orbit.origin == "sun"
        (segment,) = orbit.segments
        assert (segment.method, segment.window) == ("hermite", 6)
        found = segment.evaluate(np.array([et for et, _ in CSPICE_JWST]))
        expected = np.array([state for _, state in CSPICE_JWST])
        # 1.5e8 km carry 3e-8 km; two orders of divided differences
        np.testing.assert_allclose(found[:, :3], expected[:, :3], rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(found[:, 3:], expected[:, 3:], rtol=0.0, atol=1e-11)

    def test_jwst_is_about_L2_and_moves_as_its_velocity_says(self, jwst, ephemeris, support):
        orbit = read_spk(jwst, -170)
        epoch = Epoch.parse("2023-03-01T00:00:00 TDB")
        t_s = np.linspace(0.3, 200.3, 41) * DAY  # away from the points, where one polynomial gives way to the next
        state = orbit.state_km_km_s(ephemeris, epoch, t_s)
        distance = np.linalg.norm(state[:, :3] - ephemeris.position_km("earth", epoch, t_s), axis=1)
        assert 1.1e6 < distance.min() < distance.max() < 1.9e6
        numeric = support.derivative(lambda h: orbit.state_km_km_s(ephemeris, epoch, t_s + h)[:, :3], 300.0)
        np.testing.assert_allclose(state[:, 3:], numeric, rtol=0.0, atol=1e-8)

    def test_a_type_2_file_is_evaluated_by_jplephem_in_the_segment_that_covers_the_date(self, data, ephemeris):
        path = data / "dynamics" / "apophis_jpl220_2021_2050.bsp"
        orbit = read_spk(path)
        epoch = Epoch.parse("2028-12-01T00:00:00 TDB")
        t_s = np.linspace(0.0, 90.0, 19) * DAY
        state = orbit.state_km_km_s(ephemeris, epoch, t_s) - ephemeris.state_km_km_s("sun", epoch, t_s)
        kernel = SPK.open(path)
        for k in (0, 7, 18):
            jd = epoch.day + t_s[k] / DAY
            segment = next(s for s in kernel.segments if s.start_jd <= jd < s.end_jd)
            np.testing.assert_allclose(state[k, :3], segment.compute(jd), rtol=0.0, atol=1e-4)
        kernel.close()
        with pytest.raises(CoverageError, match="no state at 2060"):
            orbit.state_km_km_s(ephemeris, Epoch.parse("2060-01-01T00:00:00 TDB"), np.zeros(1))

    def test_a_wrong_target_and_a_broken_file_are_refused(self, jwst, tmp_path):
        with pytest.raises(DataError, match=r"no target -82 \(there are \[-170\]\)"):
            read_spk(jwst, -82)
        broken = tmp_path / "broken.bsp"
        broken.write_bytes(b"DAF/SPK " + b"\0" * 40)
        with pytest.raises(DataError, match=r"broken.bsp"):
            read_spk(broken)
        with pytest.raises(DataError, match="cannot be read"):
            read_spk(tmp_path / "absent.bsp")

    def retyped(self, jwst, tmp_path, kind):
        """The file of JWST with another type number: types 9 and 13 have one layout."""
        raw = bytearray(jwst.read_bytes())
        place = raw.index(np.array([-170, 10, 1, 13], dtype="<i4").tobytes())
        raw[place + 12 : place + 16] = np.array([kind], dtype="<i4").tobytes()
        other = tmp_path / f"type{kind}.bsp"
        other.write_bytes(raw)
        return other

    def test_type_9_interpolates_positions_and_velocities_each_by_itself(self, jwst, tmp_path):
        (segment,) = read_spk(self.retyped(jwst, tmp_path, 9)).segments
        assert segment.method == "lagrange"
        t_s = segment.t_s[300:304] + 40000.0
        window = slice(298, 304)  # of the first: three points on either side
        expected = BarycentricInterpolator(segment.t_s[window], segment.states[window])(t_s[:1])
        np.testing.assert_allclose(segment.evaluate(t_s)[:1], expected, rtol=1e-12)
        np.testing.assert_allclose(segment.evaluate(segment.t_s[:3]), segment.states[:3], rtol=1e-15)

    def test_an_unsupported_type_is_named(self, jwst, tmp_path):
        with pytest.raises(DataError, match=r"SPK type \[21\]; types 2, 3, 9 and 13 are read"):
            read_spk(self.retyped(jwst, tmp_path, 21))


OEM = """CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2028-01-01T00:00:00
ORIGINATOR = TEST
META_START
OBJECT_NAME = PROBE
OBJECT_ID = 2028-001A
CENTER_NAME = EARTH
REF_FRAME = EME2000
TIME_SYSTEM = TDB
START_TIME = 2028-11-15T00:00:00
STOP_TIME = 2028-11-15T06:00:00
INTERPOLATION = HERMITE
INTERPOLATION_DEGREE = 7
META_STOP
COMMENT states follow
{states}
"""


def oem_text(count=13):
    lines = []
    for k, state in enumerate(kepler(np.arange(count) * 1800.0)):
        numbers = " ".join(f"{value:.12e}" for value in state)
        lines.append(f"2028-11-15T{k // 2:02d}:{30 * (k % 2):02d}:00.000 {numbers}")
    return OEM.format(states="\n".join(lines))


class TestOem:
    """CCSDS messages."""

    def write(self, tmp_path, text):
        path = tmp_path / "probe.oem"
        path.write_text(text)
        return path

    def test_states_come_back_between_the_lines(self, tmp_path, ephemeris, epoch):
        oem = read_oem(self.write(tmp_path, oem_text()))
        t_s = np.linspace(0.0, 21600.0, 50)
        state = oem.orbit.state_km_km_s(ephemeris, epoch, t_s) - ephemeris.state_km_km_s("earth", epoch, t_s)
        # seventh-degree interpolation at half an hour of a day's orbit
        np.testing.assert_allclose(state[:, :3], kepler(t_s)[:, :3], rtol=0.0, atol=2e-4)
        assert oem.object_name == "PROBE"

    def test_utc_and_tai_stamps_are_told_apart(self, tmp_path):
        utc = read_oem(self.write(tmp_path, oem_text().replace("= TDB", "= UTC"))).orbit.epoch
        tai = read_oem(self.write(tmp_path, oem_text().replace("= TDB", "= TAI"))).orbit.epoch
        tdb = read_oem(self.write(tmp_path, oem_text())).orbit.epoch
        assert utc - tai == pytest.approx(37.0, abs=1e-4)
        assert tai - tdb == pytest.approx(32.184, abs=2e-3)

    def test_covariances_are_read_symmetric(self, data):
        path = data / "formats" / "ccsds" / "CovarianceExample.oem"
        oem = read_oem(self.fixed(path))
        assert len(oem.covariances) == 2
        first = oem.covariances[0]
        np.testing.assert_array_equal(first.covariance, first.covariance.T)
        assert first.covariance[2, 1] == -4.2212341e-04
        assert first.covariance[5, 5] == 6.2244443e-10
        assert first.frame == "EME2000"

    def fixed(self, path):
        return path

    def test_a_real_file_with_gaps_between_segments_is_read(self, data, ephemeris):
        oem = read_oem(data / "formats" / "ccsds" / "AstroForgeSC_Optical.oem")
        assert len(oem.orbit.segments) >= 2
        first = oem.orbit.segments[0]
        found = oem.orbit.state_km_km_s(ephemeris, oem.orbit.epoch, first.t_s)
        earth = ephemeris.state_km_km_s("earth", oem.orbit.epoch, first.t_s)
        np.testing.assert_allclose(found - earth, first.states, rtol=0.0, atol=1e-6)

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("CCSDS_OEM_VERS = 2.0", "hello", "probe.oem:1: not an OEM"),
            ("CENTER_NAME = EARTH", "CENTER_NAME = PLUTO X", "CENTER_NAME PLUTO X"),
            ("REF_FRAME = EME2000", "REF_FRAME = TEME", "REF_FRAME TEME"),
            ("TIME_SYSTEM = TDB", "TIME_SYSTEM = MET", "TIME_SYSTEM MET"),
            ("STOP_TIME = 2028-11-15T06:00:00\n", "", "lack STOP_TIME"),
            ("T01:00:00.000 ", "T01:00:00.000 x", "probe.oem:18: expected numbers"),
            ("T01:00:00.000 ", "T01:00:00.000 1.0 ", "probe.oem:18: expected 6 or 9 finite numbers, got 7"),
            ("T01:00:00.000", "T31:00:00.000", "probe.oem:18: .*no such time"),
            ("2028-11-15T01:00:00.000", "2028-11-15T00:00:00.000", "ascend"),
        ],
    )
    def test_what_cannot_be_used_is_named_with_its_line(self, tmp_path, old, new, words):
        with pytest.raises(InputError, match=words):
            read_oem(self.write(tmp_path, oem_text().replace(old, new)))

    def test_a_missing_file_is_named(self, tmp_path):
        with pytest.raises(DataError, match=r"absent\.oem"):
            read_oem(tmp_path / "absent.oem")
