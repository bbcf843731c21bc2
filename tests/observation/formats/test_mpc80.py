"""The 80-column format of the Minor Planet Center: real files, single records, and everything that can be wrong."""

import time
from pathlib import Path

import erfa
import numpy as np
import pytest

from nebosvod.dynamics.constants import AU_KM
from nebosvod.errors import InputError
from nebosvod.observation.formats import mpc80
from nebosvod.observation.formats.mpc80 import parse
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.formats.source_file import SourceFile

DATA = Path(__file__).resolve().parents[4] / "shared" / "data" / "observations"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="reference observations are not here")
GROUND = "     K05TH3M  C2005 10 09.20072 21 31 27.04 -00 10 33.9          19.2 Vrp0839703"
S_LINE = "j4767K10F61M  S2010 03 26.79569 06 54 24.99 +42 59 21.9                L~0KAAC51"
S_PLACE = "j4767K10F61M  s2010 03 26.79569 1 +  504.4738 + 5046.9579 + 4682.8243   ~0KAAC51"
V_LINE = "00433         V2023 08 26.19193220 55 41.10 -08 18 29.6          15.1 VV~7811270"
V_PLACE = "00433         v2023 08 26.1919321 237.76096  +38.11385      0           ~7811270"
R_LINE = "00433         R1975 01 23.00000                                          JPLR254"
R_PLACE = "00433         r1975 01 23.00000                                          JPLR254"
ARCSEC = np.pi / 648000.0


def read(*lines: str) -> Astrometry:
    return parse(SourceFile("f.obs", "\n".join(lines).encode()))


def test_a_ground_record_becomes_direction_time_station_and_magnitude() -> None:
    one = read(GROUND)
    assert (one.designation[0], one.station[0], one.mode[0], one.catalogue[0]) == ("2005 TM173", "703", "CCD", "UCAC2")
    assert (one.magnitude[0], one.band[0], one.centre[0], bool(one.discovery[0])) == (19.2, "V", "", False)
    np.testing.assert_allclose(one.psi[0, 0], np.radians(15 * (21 + 31 / 60 + 27.04 / 3600)), rtol=1e-15)
    # -00 keeps its sign
    np.testing.assert_allclose(one.psi[0, 1], -(10 * 60 + 33.9) * ARCSEC, rtol=1e-14)
    assert one.utc[0] == "2005-10-09T04:49:02.2080Z"
    assert np.isnan(one.sigma_rad).all()
    assert np.isnan(one.position_km).all()
    # the last digit: 0.01 s of RA (0.15" times cos Dec) and 0.1"
    np.testing.assert_allclose(one.precision_rad[0], [0.15 * ARCSEC, 0.1 * ARCSEC], rtol=1e-4)


def test_times_are_tdb_seconds_after_the_zero_hour_before_the_first() -> None:
    one = read(GROUND)
    # TAI - UTC was 32 s in 2005; TDB - TT stays below 2 ms
    assert abs(one.t_s[0] - (0.20072 * 86400.0 + 32.0 + 32.184)) < 2e-3
    assert str(one.epoch) == "2005-10-09T00:00:00.000 TDB"


@needs_data
def test_nine_thousand_records_are_read_in_less_than_half_a_second() -> None:
    path = DATA / "phaethon_mpc_full.obs80.gz"
    spent = []
    for _ in range(3):
        began = time.process_time()
        table = mpc80.read(path)
        spent.append(time.process_time() - began)
    assert min(spent) < 0.5
    assert len(table) == 9004
    assert table.objects == ("3200",)
    assert int((table.centre != "").sum()) == 412 + 3
    assert int(table.roving.sum()) == 3


def test_a_spacecraft_is_where_its_second_line_says() -> None:
    one = read(S_LINE, S_PLACE)
    np.testing.assert_array_equal(one.position_km, [[504.4738, 5046.9579, 4682.8243]])
    assert (one.centre[0], one.station[0], one.designation[0], one.line[0]) == ("earth", "C51", "454767", 1)
    assert not one.roving[0]


def test_a_position_may_be_in_au() -> None:
    place = S_PLACE[:32] + "2 -0.50000001 +0.12345678 +0.00000001" + S_PLACE[69:]
    assert len(place) == 80
    one = read(S_LINE, place)
    np.testing.assert_allclose(one.position_km[0] / AU_KM, [-0.50000001, 0.12345678, 0.00000001], rtol=1e-14)


def test_the_discovery_asterisk_stands_on_the_first_line_only() -> None:
    one = read(S_LINE[:12] + "*" + S_LINE[13:], S_PLACE)
    assert bool(one.discovery[0])


def test_the_second_line_of_a_deleted_record_goes_with_it() -> None:
    one = read(GROUND, S_LINE.replace("  S2010", "  X2010"), S_PLACE, V_LINE, V_PLACE, R_LINE, R_PLACE)
    assert (one.station.tolist(), dict(one.left_out)) == (["703", "270"], {"deleted": 1, "radar": 1})
    assert len(one.notices) == 2


def test_a_roving_observer_stands_where_the_second_line_says() -> None:
    one = read(V_LINE, V_PLACE)
    longitude, latitude, height = erfa.gc2gd(1, one.position_km[0] * 1e3)
    np.testing.assert_allclose(np.degrees([longitude % (2 * np.pi), latitude]), [237.76096, 38.11385], atol=1e-9)
    assert abs(height) < 1e-3
    assert bool(one.roving[0])


@pytest.mark.parametrize(("text", "worth"), [
    ("21 31 27.04 +60 10 33.9 ", (0.15, 0.1)), ("21 31 27    +60 10 33   ", (15.0, 1.0)),
    ("21 31.45    +60 10.5    ", (9.0, 6.0)), ("21 31       +60 10      ", (900.0, 60.0)),
    ("21 31 27.044+60 10 33.91", (0.015, 0.01)),
])  # fmt: skip
def test_the_last_digit_tells_the_precision(text: str, worth: tuple[float, float]) -> None:
    one = read(GROUND[:32] + text + GROUND[56:])
    cosine = np.cos(one.psi[0, 1])
    np.testing.assert_allclose(one.precision_rad[0] / ARCSEC, [worth[0] * cosine, worth[1]], rtol=1e-9)
    assert abs(np.degrees(one.psi[0, 0]) / 15.0 - 21.52) < 0.01
    assert abs(np.degrees(one.psi[0, 1]) - 60.17) < 0.01


@needs_data
def test_the_files_of_edge_cases_are_read_as_documented() -> None:
    wise = mpc80.read(DATA / "j4767_wise_excerpt.txt")
    assert (len(wise), wise.objects, dict(wise.left_out)) == (12, ("454767",), {"deleted": 1})
    assert np.isfinite(wise.position_km).all()
    mixed = mpc80.read(DATA / "obs80_two_line_records.txt")
    assert mixed.station.tolist() == ["802", "275", "270"]
    assert mixed.centre.tolist() == ["", "earth", "earth"]
    assert mixed.mode.tolist() == ["PHO", "OCC", "CCD"]
    np.testing.assert_array_equal(mixed.position_km[1], [4353.003, -481.61, 1382.34])


@pytest.mark.parametrize(("lines", "at", "words"), [
    ((S_LINE,), 1, 'line "S" is not followed by its line "s"'),
    ((S_PLACE,), 1, 'line "s" stands alone'),
    ((S_LINE, S_PLACE.replace("26.79569", "26.79568")), 2, "is not of the same object, time and observatory as line 1"),
    ((S_LINE, GROUND, S_PLACE), 1, 'line "S" is not followed by its line "s"'),
    ((GROUND[:77] + "C51",), 1, "C51 (WISE) has no fixed place"),
    ((GROUND, GROUND[:55]), 2, "the record has 55 columns, not 80"),
])  # fmt: skip
def test_lines_that_do_not_belong_together_are_named(lines: tuple[str, ...], at: int, words: str) -> None:
    with pytest.raises(InputError) as error:
        read(*lines)
    assert str(error.value).splitlines()[0].startswith(f"f.obs:{at}: ")
    assert words in str(error.value).splitlines()[0]
