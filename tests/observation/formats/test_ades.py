"""ADES in its forms: what each field becomes, real files, and the official schema as judge of what is written."""

import time
from pathlib import Path

import numpy as np
import pytest

from nebosvod.dynamics.constants import AU_KM
from nebosvod.errors import InputError
from nebosvod.observation.formats import mpc80
from nebosvod.observation.formats.reading import parse_astrometry, read_astrometry
from nebosvod.observation.formats.records import Astrometry, joined
from nebosvod.observation.formats.source_file import SourceFile

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="reference observations are not here")
ARCSEC = np.pi / 648000.0
HEADER = "permID|provID|mode|stn|obsTime|ra|dec|rmsRA|rmsDec|rmsCorr|astCat|mag|band|disc"
ROW = "3666|1979 HP|CCD|G96|2010-01-07T20:21:48.586Z|19.04175|-0.36842|0.1|0.2|-0.3|Gaia2|18.5|V|*"
SPACE = "trkSub|stn|sys|ctr|pos1|pos2|pos3|posCov11|posCov22|posCov33|posCov12|obsTime|rmsTime|ra|dec"


def psv(*lines: str) -> Astrometry:
    return parse_astrometry(SourceFile("f.psv", "\n".join(["# version=2022", *lines]).encode()))


def space(system: str, centre: str, *numbers: str) -> Astrometry:
    row = ("X1", "C51", system, centre, *numbers, "2010-01-07T20:21:48Z", "0.5", "19.0", "5.0")
    return psv(SPACE, "|".join(row))


def test_each_field_of_an_optical_record_goes_to_its_place() -> None:
    one = psv(HEADER, ROW)
    assert (one.designation[0], one.station[0], one.mode[0], one.catalogue[0]) == ("3666", "G96", "CCD", "Gaia2")
    assert (one.magnitude[0], one.band[0], bool(one.discovery[0]), one.line[0]) == (18.5, "V", True, 3)
    np.testing.assert_allclose(one.psi[0], np.radians([19.04175, -0.36842]), rtol=1e-15)
    np.testing.assert_allclose(one.sigma_rad[0], [0.1 * ARCSEC, 0.2 * ARCSEC], rtol=1e-15)
    assert one.correlation[0] == -0.3
    # TAI - UTC was 34 s in 2010; TDB - TT stays below 2 ms
    assert abs(one.t_s[0] - (20 * 3600 + 21 * 60 + 48.586 + 34 + 32.184)) < 2e-3
    assert one.centre[0] == ""
    assert one.notices == ()


def test_a_spacecraft_has_its_position_and_covariance_in_km() -> None:
    numbers = ("6685.9939", "1699.4357", "381.8355", "1.0", "4e0", "9", "0.5")
    one = space("ICRF_KM", "399", *numbers)
    np.testing.assert_array_equal(one.position_km[0], [6685.9939, 1699.4357, 381.8355])
    np.testing.assert_array_equal(one.position_covariance_km2[0], [[1, 0.5, 0], [0.5, 4, 0], [0, 0, 9]])
    assert (one.centre[0], bool(one.roving[0]), one.timing_sigma_s[0]) == ("earth", False, 0.5)
    sun = space("ICRF_AU", "10", "-0.5", "0.8", "0.3", "1e-16", "1e-16", "1e-16", "")
    np.testing.assert_allclose(sun.position_km[0], AU_KM * np.array([-0.5, 0.8, 0.3]), rtol=1e-15)
    np.testing.assert_allclose(sun.position_covariance_km2[0], 1e-16 * AU_KM**2 * np.eye(3), rtol=1e-15)
    assert (sun.centre[0], space("ICRF_AU", "0", "-0.5", "0.8", "0.3", "", "", "", "").centre[0]) == ("sun", "ssb")


def test_a_roving_observer_stands_on_the_ground() -> None:
    wgs = psv(SPACE, "X1|247|WGS84|399|90.0|0.0|1000|||||2010-01-07T20:21:48Z||19.0|5.0")
    np.testing.assert_allclose(wgs.position_km[0], [0.0, 6379.137, 0.0], atol=1e-9)
    itrf = psv(SPACE, "X1|247|ITRF|399|90.0|5000|4000|||||2010-01-07T20:21:48Z||19.0|5.0")
    np.testing.assert_allclose(itrf.position_km[0], [0.0, 5000.0, 4000.0], atol=1e-9)
    assert bool(wgs.roving[0])
    assert bool(itrf.roving[0])


def test_an_occultation_is_the_star_with_the_offset() -> None:
    head = "permID|stn|sys|ctr|pos1|pos2|pos3|obsTime|raStar|decStar|deltaRA|deltaDec|astCat"
    row = "3666|275|ICRF_KM|399|1190.349|-3232.544|3165.935|2020-09-15T14:02:19.12Z|27.7|60.0|2.0|-3.0|Gaia3E"
    one = psv(head, row)
    # dRA cos Dec = 2", cos 60 deg = 1/2; the curvature of the sky over 3" is below 1e-4"
    moved = np.degrees(one.psi[0]) * 3600.0 - [27.7 * 3600.0, 60.0 * 3600.0]
    np.testing.assert_allclose(moved, [4.0, -3.0], atol=2e-4)


def test_an_occultation_near_the_pole_is_offset_on_the_tangent_plane() -> None:
    head = "permID|stn|sys|ctr|pos1|pos2|pos3|obsTime|raStar|decStar|deltaRA|deltaDec"
    one = psv(head, "3666|275|ICRF_KM|399|1190|-3232|3165|2020-09-15T14:02:19.12Z|27.7|89.9|0.0|1080.0")
    # 0.3 deg north of 89.9 deg along the meridian is 0.2 deg beyond the pole; tan 0.3 deg - 0.3 deg is 0.01"
    np.testing.assert_allclose(np.degrees(one.psi[0]), [207.7, 89.8], atol=1e-5)


def test_the_stated_precision_is_an_arc_on_the_sky() -> None:
    one = psv("permID|stn|obsTime|ra|dec|precRA|precDec", "3666|G96|2020-09-15T14:02:19.12Z|27.7|60.0|0.01|0.1")
    np.testing.assert_allclose(one.precision_rad[0], [0.5 * 0.15 * ARCSEC, 0.1 * ARCSEC], rtol=1e-12)


def test_records_of_one_direction_from_two_places_are_two() -> None:
    row = "X1|247|WGS84|399|90.0|{}|1000|||||2010-01-07T20:21:48Z||19.0|5.0"
    assert len(psv(SPACE, row.format("0.0"), row.format("0.1"), row.format("0.0"))) == 2


def test_old_line_ends_are_line_ends() -> None:
    one = parse_astrometry(SourceFile("f", "\r".join(["# version=2022", HEADER, ROW]).encode()))
    assert one.line.tolist() == [3]


def test_a_leap_second_is_a_second_of_its_own() -> None:
    before, there, after = (
        psv("trkSub|stn|obsTime|ra|dec", f"X1|G96|{text}|19.0|5.0")
        for text in ("2016-12-31T23:59:59Z", "2016-12-31T23:59:60Z", "2017-01-01T00:00:00Z")
    )
    assert abs((there.epoch - before.epoch) + there.t_s[0] - before.t_s[0] - 1.0) < 1e-6
    assert abs((after.epoch - before.epoch) + after.t_s[0] - before.t_s[0] - 2.0) < 1e-6


def test_years_before_1960_are_read_as_universal_time() -> None:
    one = psv("trkSub|stn|obsTime|ra|dec", "X1|024|1938-11-28T23:19:29.568Z|72.51275|19.82031")
    # TT - UT1 in 1939 was 24.0 s (Astronomical Almanac, K8: 1938 23.96, 1939 24.02)
    assert abs(one.t_s[0] - (23 * 3600 + 19 * 60 + 29.568 + 24.0)) < 0.3


def test_time_runs_on_over_the_first_day_of_utc() -> None:
    old, new = (
        psv("trkSub|stn|obsTime|ra|dec", f"X1|024|{text}|72.5|19.8")
        for text in ("1959-12-31T23:59:59.999Z", "1960-01-01T00:00:00Z")
    )
    # UTC was steered to UT2 by steps of up to 0.1 s; the polynomial is good to 0.2 s
    assert abs((new.epoch - old.epoch) + new.t_s[0] - old.t_s[0]) < 0.3


def test_deprecated_radar_and_offset_records_are_counted() -> None:
    one = psv(
        HEADER + "|deprecated", ROW + "|", ROW.replace("19.04", "19.05") + "|X", "# x",
        "permID|trx|rcv|obsTime|delay|rmsDelay|frq", "3666|251|251|2010-01-07T20:21:48.586Z|1.0|0.1|2380",
        "# x", "permID|mode|stn|obsTime|obsCenter|deltaRA|deltaDec",
        "3666|CCD|G96|2010-01-07T20:21:48.586Z|Jupiter|1.0|0.1",
    )  # fmt: skip
    assert len(one) == 1
    assert dict(one.left_out) == {"deleted": 1, "radar": 1, "offset": 1}
    assert any("1 radar record was left out" in notice for notice in one.notices)


def test_a_repeated_record_is_kept_once_with_a_notice() -> None:
    one = psv(HEADER, ROW, ROW, ROW.replace("18.5", "18.6"))
    assert (len(one), dict(one.left_out)) == (1, {"duplicate": 2})
    assert "f.psv:4, f.psv:5" in one.notices[0]
    both = joined([psv(HEADER, ROW), psv(HEADER, ROW, ROW.replace("G96", "703"))])
    assert both.station.tolist() == ["G96", "703"]


def test_line_ends_byte_order_mark_version_and_order_of_columns_do_not_matter() -> None:
    plain = psv(HEADER, ROW)
    names, cells = HEADER.split("|"), ROW.split("|")
    text = "\r\n".join(["# version=2017", "! x", "", "|".join(names[::-1]), " | ".join(cells[::-1]), ""])
    other = parse_astrometry(SourceFile("f.psv", b"\xef\xbb\xbf" + text.encode()))
    for name in ("psi", "t_s", "sigma_rad", "station", "designation", "magnitude"):
        np.testing.assert_array_equal(getattr(other, name), getattr(plain, name))
    assert other.line[0] == 5


def test_records_without_their_number_join_those_that_have_it() -> None:
    one = psv(
        HEADER, ROW, "|1979 HP" + ROW[12:].replace("19.04", "19.05"), "03666||" + ROW[13:].replace("19.04", "19.06")
    )
    assert one.objects == ("3666",)


def record_bytes(table: Astrometry) -> list[bytes]:
    """The lines of an 80-column file that its observations came from."""
    lines = Path(str(table.path[0])).read_bytes().split(b"\n")
    return [lines[number - 1] for number in table.line.tolist()]


@needs_data
def test_the_eighty_column_file_and_its_twin_with_ades_names_say_the_same() -> None:
    columns = mpc80.read(DATA / "observations" / "03666_Holman.obs80")
    twin = read_astrometry(DATA / "observations" / "holman_data_with_sats_occ.csv")
    assert (len(columns), len(twin)) == (4312, 4313)
    # the twin keeps the one record that is marked deleted (X) in the other file, its second line
    twin = twin.select(np.arange(4313) != 1)
    np.testing.assert_array_equal(columns.station, twin.station)
    # each value of the columns lies within half of its last digit, the twin's within half of 1e-5 deg and of 1 ms
    apart = np.abs(columns.psi - twin.psi)
    apart[:, 0] *= np.cos(columns.psi[:, 1])
    assert np.max(apart - 0.5 * columns.precision_rad) < np.radians(0.5e-5)
    seconds = np.abs(columns.t_s - twin.t_s + (columns.epoch - twin.epoch))
    digits = np.array([len(line[25:32].strip(b". ")) for line in record_bytes(columns)])
    assert np.max(seconds - 0.5 * 86400.0 / 10.0**digits) < 0.6e-3
    # the same to the last digit but for seven positions of WISE, which differ by up to 6 m
    np.testing.assert_allclose(columns.position_km, twin.position_km, atol=6e-3)
    assert int((columns.position_km != twin.position_km)[columns.centre != ""].any(axis=1).sum()) == 7
    np.testing.assert_array_equal(columns.magnitude, twin.magnitude)
    # 27 records of 2001 bear USNO-A2.0 in the columns and no catalogue in the twin
    other = columns.catalogue != twin.catalogue
    assert set(zip(columns.catalogue[other].tolist(), twin.catalogue[other].tolist())) == {("USNOA2", "")}
    assert int(other.sum()) == 27


@needs_data
def test_four_thousand_comma_separated_records_take_less_than_a_quarter_of_a_second() -> None:
    spent = []
    for _ in range(3):
        began = time.process_time()
        read_astrometry(DATA / "observations" / "holman_data_with_sats_occ.csv")
        spent.append(time.process_time() - began)
    assert min(spent) < 0.25


@needs_data
def test_files_of_other_programs_are_read() -> None:
    sample = read_astrometry(DATA / "formats" / "layup" / "example.psv")
    assert (sample.objects, dict(sample.left_out)) == (("3666",), {"deleted": 1})
    assert "exchanged" in sample.notices[0]
    four = read_astrometry(DATA / "observations" / "4_random_mpc_ADES_provIDs_no_sats.csv")
    assert {"119839", "230891", "609631", "742428"} <= set(four.objects)
    xml = read_astrometry(DATA / "formats" / "layup" / "ades_sample.xml")
    assert xml.objects == ("3666", "2014 XX")


ENTITIES = {
    "doctype": '<!DOCTYPE ades>\n<ades version="2022"/>',
    "external": '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>\n<ades version="2022">&x;</ades>',
    "bomb": '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "' + "&a;" * 10 + '">]><ades version="2022">&b;</ades>',
    "parameter": '<!DOCTYPE a [<!ENTITY % x SYSTEM "http://127.0.0.1/x"> %x;]>\n<ades version="2022"/>',
}


@pytest.mark.parametrize("which", ENTITIES)
def test_a_doctype_ends_the_reading_of_xml_before_anything_is_expanded(which: str) -> None:
    with pytest.raises(InputError, match=r"f\.xml:1: a DOCTYPE or entity declaration is not allowed"):
        parse_astrometry(SourceFile("f.xml", ENTITIES[which].encode()))


XML = """<?xml version="1.0" encoding="UTF-8"?>
<ades version="2017"><obsBlock><obsContext><observatory><mpcCode>703</mpcCode></observatory></obsContext>
<obsData><optical><permID>3666</permID><stn>G96</stn><obsTime>2010-01-07T20:00:00Z</obsTime><ra>19.0</ra>
<dec>5.0</dec></optical></obsData></obsBlock><obsBlock><obsContext><observatory><mpcCode>F51</mpcCode></observatory>
</obsContext><obsData><optical><permID>3666</permID><stn>F51</stn><obsTime>2010-01-08T20:00:00Z</obsTime>
<ra>19.0</ra><dec>5.0</dec></optical></obsData></obsBlock></ades>
"""
PSV = """# version=2017
# observatory
! mpcCode 703
permID|stn|obsTime|ra|dec
3666|G96|2010-01-07T20:00:00Z|19.0|5.0
# observatory
! mpcCode F51
permID|stn|obsTime|ra|dec
3666|F51|2010-01-08T20:00:00Z|19.0|5.0
"""
OBS80 = """COD 703
03666         C2022 07 26.00000123 42 46.013+17 52 55.07               V     G96
COD F51
03666         C2022 07 27.00000123 42 46.013+17 52 55.07               V     F51
"""


@pytest.mark.parametrize(("text", "line"), [(XML, 3), (PSV, 5), (OBS80, 2)])
def test_a_header_that_names_another_observatory_is_told_and_the_rows_are_used(text, line) -> None:
    """Each block has a header of its own: the second one agrees."""
    one = parse_astrometry(SourceFile("f", text.encode()))
    assert one.station.tolist() == ["G96", "F51"]
    (said,) = [notice for notice in one.notices if "the header names" in notice]
    assert (
        said
        == f"f: the header names observatory 703, and 1 record from line {line} on G96; what the records say was used"
    )


@pytest.mark.parametrize("text", [XML, PSV])
def test_the_old_version_of_ades_is_told(text) -> None:
    assert any(n.startswith("f is ADES 2017") for n in parse_astrometry(SourceFile("f", text.encode())).notices)
    new = text.replace("2017", "2022")
    assert not any("ADES" in n for n in parse_astrometry(SourceFile("f", new.encode())).notices)


def test_a_letter_for_no_star_catalogue_is_told() -> None:
    strange = OBS80.splitlines()[1][:71] + "!" + OBS80.splitlines()[1][72:]
    one = parse_astrometry(SourceFile("f", f"{strange}\n".encode()))
    assert one.catalogue.tolist() == [""]
    assert any('column 72 that is not known ("!")' in notice for notice in one.notices)
