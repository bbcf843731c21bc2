"""Spacecraft from OEM files."""

import re

import numpy as np
import pytest

from nebosvod.dynamics.kepler import kepler_state
from nebosvod.errors import DataError, InputError
from nebosvod.observation import read_oem
from nebosvod.observation.spacecraft.ccsds_time import read_time

DAY = 86400.0


def kepler(t):
    one = np.ones(t.size)
    return kepler_state(398600.4, 42164.0, 0.1, 0.3, 0.2 * one, 0.7 * one, t * np.sqrt(398600.4 / 42164.0**3))


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
        found = oem.orbit.state_km_km_s(ephemeris, oem.orbit.epoch, first.t_s)  # type: ignore[attr-defined]
        earth = ephemeris.state_km_km_s("earth", oem.orbit.epoch, first.t_s)  # type: ignore[attr-defined]
        np.testing.assert_allclose(found - earth, first.states, rtol=0.0, atol=1e-6)  # type: ignore[attr-defined]

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
        with pytest.raises(DataError, match=words):
            read_oem(self.write(tmp_path, oem_text().replace(old, new)))

    @pytest.mark.parametrize(
        ("system", "written"),
        [
            ("UTC", "2028-11-15T{}.000Z"),
            ("UTC", "2028-320T{}.000"),
            ("UTC", "2028-320T{}Z"),
            ("TDB", "2028-320T{}.0"),
            ("TAI", "2028-320T{},000"),
        ],
    )
    def test_the_time_codes_of_ccsds_301_are_read(self, tmp_path, system, written):
        """Day of the year, and the terminator Z: 15 November is day 320 of the leap year 2028."""
        plain = oem_text().replace("= TDB", f"= {system}")
        coded = re.sub(r"2028-11-15T(\d\d:\d\d:\d\d)(\.000)?", lambda found: written.format(found[1]), plain)
        expected, found = (read_oem(self.write(tmp_path, text)).orbit for text in (plain, coded))
        assert coded != plain
        assert found.epoch == expected.epoch
        np.testing.assert_array_equal(found.segments[0].t_s, expected.segments[0].t_s)  # type: ignore[attr-defined]
        assert found.segments[0].end_s == expected.segments[0].end_s == pytest.approx(21600.0, abs=1e-5)

    def test_a_leap_second_has_a_day_of_the_year_too(self):
        assert read_time("2016-366T23:59:60.5Z", "UTC") - read_time("2017-001T00:00:00", "UTC") == pytest.approx(-0.5)

    @pytest.mark.parametrize(
        ("text", "system", "words"),
        [
            ("2028-367T00:00:00", "UTC", "2028 has no day 367"),
            ("2027-366T00:00:00", "UTC", "2027 has no day 366"),
            ("2027-000T00:00:00", "UTC", "2027 has no day 000"),
            ("2028-1-15T00:00:00", "UTC", "allowed 2028|allowed 2024"),
            ("2028-11-15T00:00:00Z", "TDB", "its Z says UTC, but TIME_SYSTEM says TDB"),
            ("2028-02-30T00:00:00Z", "UTC", "no such date|does not exist"),
            ("2028-320T23:59:60Z", "UTC", "no leap second"),
        ],
    )
    def test_a_time_that_is_none_is_refused_in_words(self, text, system, words):
        with pytest.raises(InputError, match=words):
            read_time(text, system)

    def test_each_segment_has_its_own_centre_and_time_system(self, tmp_path, ephemeris, epoch):
        """The same states told from the Sun in TAI after they were told from the Earth in TDB."""
        head, states = oem_text().split("META_START", 1)
        second = states.replace("= EARTH", "= SUN").replace("= TDB", "= TAI").replace("2028-11-15", "2028-11-16")
        orbit = read_oem(self.write(tmp_path, f"{head}META_START{states}META_START{second}")).orbit
        for start, body in ((0.0, "earth"), (DAY + 32.184, "sun")):
            t_s = np.array([start + 1.0, start + 1800.0, start + 9000.0])
            found = orbit.state_km_km_s(ephemeris, epoch, t_s) - ephemeris.state_km_km_s(body, epoch, t_s)
            # TDB - TT is 1.4 ms in November: 5 m at 3 km/s
            np.testing.assert_allclose(found[:, :3], kepler(t_s - start)[:, :3], rtol=0.0, atol=0.006)

    def test_each_covariance_starts_afresh(self, tmp_path):
        """The axes of one matrix say nothing of the next, and each has its own epoch."""
        triangle = "\n".join(" ".join(["1e-3"] * (k + 1)) for k in range(6))
        first = f"EPOCH = 2028-320T00:00:00Z\nCOV_REF_FRAME = RTN\n{triangle}\n".replace("Z", "")
        blocks = f"COVARIANCE_START\n{first}EPOCH = 2028-11-15T01:00:00\n{triangle}\nCOVARIANCE_STOP\n"
        held = read_oem(self.write(tmp_path, oem_text() + blocks)).covariances
        assert [one.frame for one in held] == ["RTN", "EME2000"]
        assert held[1].epoch - held[0].epoch == pytest.approx(3600.0)
        for wrong, words in (
            (f"COVARIANCE_START\n{first}{triangle}\nCOVARIANCE_STOP\n", "needs its own EPOCH"),
            (f"COVARIANCE_START\n{first}EPOCH = 2028-11-15T01:00:00\n1e-3\nCOVARIANCE_STOP\n", "has 1 rows, not 6"),
            (f"COVARIANCE_START\n{first}", "COVARIANCE_STOP is missing"),
        ):
            with pytest.raises(DataError, match=words):
                read_oem(self.write(tmp_path, oem_text() + wrong))

    def test_a_missing_file_is_named(self, tmp_path):
        with pytest.raises(DataError, match=r"absent\.oem"):
            read_oem(tmp_path / "absent.oem")
