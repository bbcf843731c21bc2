"""What observations weigh, against the paper and against another implementation of it."""

import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nebosvod.errors import DataError, InputError
from nebosvod.observation.formats import mpc80
from nebosvod.observation.formats.mpc80 import parse
from nebosvod.observation.formats.mpc80_codes import CATALOGUES
from nebosvod.observation.formats.reading import read_astrometry
from nebosvod.observation.formats.source_file import SourceFile
from nebosvod.observation.reduction.weight_rules import COLUMNS, default_rules, parse_rules, read_rules
from nebosvod.observation.reduction.weights import noise_covariance, weigh

ARCSEC = np.pi / 648000.0
HEAD = ",".join(COLUMNS)
S_PLACE = "     K05TH3M  s2005 10 09.20072 1 +  504.4738 + 5046.9579 + 4682.8243        {}"


def line(station="046", date="2005 10 09.20072", mode="C", catalogue="r"):
    return f"     K05TH3M  {mode}{date} 21 31 27.040-00 10 33.90         19.2 V{catalogue}p0839{station}"


def read(*lines: str):
    return parse(SourceFile("f.obs", "\n".join(lines).encode()))


def sigma_arcsec(*lines: str, **choices):
    return weigh(read(*lines), **choices).sigma_rad / ARCSEC


@pytest.mark.parametrize(
    ("station", "date", "mode", "catalogue", "expected"),
    [
        ("046", "2005 10 09.20072", "C", "r", 1.0),
        ("046", "2005 10 09.20072", "C", " ", 1.5),
        ("703", "2013 12 31.99900", "C", "r", 1.0),
        ("703", "2014 01 01.00100", "C", "r", 0.8),
        ("691", "2002 12 31.99900", "C", "c", 0.6),
        ("691", "2003 01 01.00100", "C", "c", 0.5),
        ("644", "2003 08 31.99900", "C", "c", 0.6),
        ("644", "2003 09 01.00100", "C", "c", 0.4),
        ("F51", "2015 10 09.20072", "C", "L", 0.2),
        ("T12", "2018 10 09.20072", "C", "V", 0.1),
        ("T12", "2018 10 09.20072", "C", "t", 1.0),
        ("046", "1885 10 09.20072", " ", " ", 10.0),
        ("046", "1935 10 09.20072", "P", " ", 5.0),
        ("046", "1985 10 09.20072", "A", " ", 2.5),
        ("046", "1995 10 09.20072", "T", " ", 0.5),
        ("046", "1995 10 09.20072", "e", " ", 0.75),
        ("046", "1895 10 09.20072", "M", " ", 2.0),
        ("046", "2015 10 09.20072", "n", "q", 1.0),
    ],
)
def test_an_observation_without_a_stated_rms_weighs_what_the_paper_says(station, date, mode, catalogue, expected):
    """Veres et al. (2017), tables 2 to 4."""
    np.testing.assert_allclose(sigma_arcsec(line(station, date, mode, catalogue)), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("station", "expected"), [("C57", 1.3), ("C53", 1.5), ("C51", 1.0), ("C49", 60.0), ("250", 0.1), ("274", 0.1)]
)
def test_a_record_of_a_spacecraft_weighs_by_its_own_rule(station, expected) -> None:
    records = line(station, mode="S"), S_PLACE.format(station)
    np.testing.assert_allclose(sigma_arcsec(*records), expected, rtol=1e-12)


def test_an_occultation_is_no_image_of_a_spacecraft_though_it_states_a_position() -> None:
    np.testing.assert_allclose(sigma_arcsec(line("275", mode="S"), S_PLACE.format("275")), 0.2, rtol=1e-12)


def test_a_stated_rms_comes_before_the_table_and_keeps_its_correlation() -> None:
    records = replace(read(line("703")), sigma_rad=np.array([[0.3, 0.2]]) * ARCSEC, correlation=np.array([0.4]))
    ours = weigh(records)
    np.testing.assert_allclose(ours.sigma_rad / ARCSEC, [[0.3, 0.2]], rtol=1e-12)
    assert ours.correlation[0] == 0.4
    assert ours.rule[0] == "stated rms"
    by_table = weigh(records, stated=False)
    np.testing.assert_allclose(by_table.sigma_rad / ARCSEC, 1.0, rtol=1e-12)
    assert by_table.correlation[0] == 0.0
    assert by_table.rule[0] == "V17: station 703, CCD CMO, until 2014-01-01"


def test_a_stated_rms_below_the_floor_is_raised_and_told() -> None:
    records = replace(read(line()), sigma_rad=np.array([[0.001, 0.2]]) * ARCSEC)
    ours = weigh(records)
    np.testing.assert_allclose(ours.sigma_rad / ARCSEC, [[0.05, 0.2]], rtol=1e-12)
    assert ours.rule[0] == 'stated rms, raised to 0.05"'
    assert ours.notices == ('1 stated rms below 0.05" were raised to it',)
    star = replace(records, mode=np.array(["OCC"]), precision_rad=np.full((1, 2), 1e-4 * ARCSEC))
    np.testing.assert_allclose(weigh(star).sigma_rad / ARCSEC, [[0.001, 0.2]], rtol=1e-12)


def test_no_sigma_is_finer_than_the_last_digit() -> None:
    records = replace(read(line("F51")), precision_rad=np.array([[1.5, 0.1]]) * ARCSEC)
    ours = weigh(records)
    np.testing.assert_allclose(ours.sigma_rad / ARCSEC, [[1.5 / np.sqrt(12.0), 0.2]], rtol=1e-12)
    assert ours.rule[0].endswith("raised to the last digit")


def test_more_than_four_in_a_night_weigh_as_four() -> None:
    night = [line("703", f"2015 10 09.{20072 + 100 * i}") for i in range(9)]
    ours = weigh(read(*night, line("703", "2015 10 10.20072"), line("G96", "2015 10 09.20072")))
    np.testing.assert_allclose(ours.sigma_rad[:9, 0] / ARCSEC, 0.8 * 1.5, rtol=1e-12)
    np.testing.assert_allclose(ours.sigma_rad[9:, 0] / ARCSEC, [0.8, 0.5], rtol=1e-12)
    assert list(ours.night_count) == [9] * 9 + [1, 1]
    assert ours.rule[0] == "V17: station 703, CCD CMO, from 2014-01-01, sqrt(9/4)"
    np.testing.assert_allclose(sigma_arcsec(*night, night_limit=None), 0.8, rtol=1e-12)
    np.testing.assert_allclose(sigma_arcsec(*night[:4]), 0.8, rtol=1e-12)


def test_occultations_of_a_night_keep_their_weights() -> None:
    events = [line("244", f"2015 10 09.{20072 + 100 * i}", mode="E") for i in range(9)]
    ours = weigh(read(*events))
    assert ours.night_count[0] == 9
    np.testing.assert_allclose(ours.sigma_rad / ARCSEC, 0.2, rtol=1e-12)


def test_a_night_changes_at_local_noon_not_at_midnight_utc() -> None:
    # E12, Siding Spring, longitude 149 deg: local noon is 2h 4m UTC (day 0.086)
    night = [line("E12", f"2015 10 09.{i}0000") for i in (4, 5, 6, 7, 8)]
    before = [line("E12", f"2015 10 09.0{i}000") for i in (1, 3, 8)]
    assert list(weigh(read(*before, *night)).night_count) == [3, 3, 3, 5, 5, 5, 5, 5]
    # I41, Palomar, 243 deg: local noon is 19h 48m UTC (day 0.825), 0h UTC is in the afternoon
    evening = [line("I41", "2015 10 08.99000"), line("I41", "2015 10 09.01000"), line("I41", "2015 10 08.80000")]
    assert list(weigh(read(*evening)).night_count) == [2, 2, 1]


def test_nights_of_two_objects_and_of_two_rovers_are_counted_apart() -> None:
    two = read(line("703"), line("703", "2005 10 09.20172"))
    both = replace(two, designation=np.array(["2005 TM173", "2007 VV7"]))
    assert list(weigh(both).night_count) == [1, 1]
    rovers = (
        "00433         V2023 08 26.19193220 55 41.10 -08 18 29.6          15.1 VV~7811270",
        "00433         v2023 08 26.1919321 237.76096  +38.11385      0           ~7811270",
        "00433         V2023 08 26.19203220 55 41.10 -08 18 29.6          15.1 VV~7811270",
        "00433         v2023 08 26.1920321 238.76096  +38.11385      0           ~7811270",
    )
    assert list(weigh(read(*rovers)).night_count) == [1, 1]


def test_unknown_detectors_count_as_photographs_before_1990_and_as_ccds_after() -> None:
    records = read(line(date="1989 12 31.50000"), line(date="1990 01 02.50000"))
    unknown = replace(records, mode=np.array(["", "UNK"]))
    np.testing.assert_allclose(weigh(unknown).sigma_rad[:, 0] / ARCSEC, [2.5, 1.0], rtol=1e-12)


def test_a_users_table_comes_before_a_stated_rms(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(f"{HEAD}\n703,*,*,,,0.33,0.44,my study\n", encoding="utf-8")
    records = replace(
        read(line("703"), line("G96")), sigma_rad=np.full((2, 2), 0.3 * ARCSEC), correlation=np.full(2, 0.5)
    )
    ours = weigh(records, path)
    np.testing.assert_allclose(ours.sigma_rad / ARCSEC, [[0.33, 0.44], [0.3, 0.3]], rtol=1e-12)
    assert list(ours.correlation) == [0.0, 0.5]
    assert ours.rule[0] == "my study: station 703"


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("7O3,*,*,,,1,1,x", r't\.csv:2: station: observatory code "7O3"'),
        ("703,CDC,*,,,1,1,x", r't\.csv:2: mode: "CDC" is none of CCD'),
        ("703,*,*,,,0,1,x", r't\.csv:2: sigma_ra_arcsec: "0" \(allowed: above 0'),
        ("703,*,*,,,1,nan,x", r't\.csv:2: sigma_dec_arcsec: "nan"'),
        ("703,*,*,,,1,1e9,x", r't\.csv:2: sigma_dec_arcsec: "1e9"'),
        ("703,*,*,2014,,1,1,x", r't\.csv:2: from: "2014" is no date'),
        ("703,*,*,2014-02-30,,1,1,x", r't\.csv:2: from: "2014-02-30" is no date'),
        ("703,*,*,2014-01-01,2013-01-01,1,1,x", r"t\.csv:2: until: 2013-01-01 is not after"),
        ("703,*,*,,,1,1", r"t\.csv:2: 7 columns instead of 8"),
        ("703,,*,,,1,1,x", r"t\.csv:2: an empty cell"),
    ],
)
def test_a_wrong_row_is_refused_with_file_line_and_column(row: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_rules([HEAD, row], "t.csv")


def test_all_wrong_rows_are_told_at_once() -> None:
    with pytest.raises(InputError, match=r"(?s)t\.csv:2: .*t\.csv:4: "):
        parse_rules([HEAD, "703,*,*,,,0,1,x", "703,*,*,,,1,1,x", "703,*,*,x,,1,1,x"], "t.csv")


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], r"no table of weights"),
        (["station,mode"], r"t\.csv:1: column catalogue is missing"),
        ([HEAD + ",weight"], r't\.csv:1: column "weight" is unknown'),
        ([HEAD + ",mode"], r't\.csv:1: column "mode" is unknown or twice'),
    ],
)
def test_a_wrong_head_is_refused(lines: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_rules(lines, "t.csv")


def test_files_that_are_no_tables_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be read"):
        read_rules(tmp_path / "none.csv")
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(InputError, match="not UTF-8"):
        read_rules(tmp_path / "binary")


@pytest.mark.parametrize(("choices", "message"), [({"floor_arcsec": -1.0}, "floor"), ({"night_limit": 0}, "limit")])
def test_wrong_choices_are_refused(choices, message) -> None:
    with pytest.raises(InputError, match=message):
        weigh(read(line()), **choices)


def test_a_clock_error_tilts_the_noise_along_the_motion() -> None:
    records = replace(read(line(), line("G96")), sigma_rad=np.full((2, 2), 1e-6), correlation=np.array([0.5, 0.0]))
    ours = weigh(records, floor_arcsec=0.0, night_limit=None)
    R = noise_covariance(ours, np.array([np.nan, 2.0]), np.array([[1e-6, 1e-6], [3e-6, -4e-6]]))
    np.testing.assert_allclose(R[0], [[1e-12, 0.5e-12], [0.5e-12, 1e-12]], rtol=1e-12)
    np.testing.assert_allclose(R[1], [[37e-12, -48e-12], [-48e-12, 65e-12]], rtol=1e-12)


# Where another implementation of the paper (NEODyS, OrbFit) differs by its own later choices:
# - 0.6" for anything measured against Gaia, micrometers 3", Hipparcos itself 0.4";
# - HST, 1.3 there, whose images are sharper than a tenth of an arcsecond.
# - rows for single observing programmes of a station, which records do not carry here.
def vfcc17(path: Path):
    """Rows (station, modes, catalogues, programme, from year, until year, sigma) of a table of OrbFit's."""
    pattern = re.compile(r"(\S+) +t=(\S+) +c=(\S+) +p=(\S*) +>( [\d-]+)? +<( [\d-]+)? +@ +([\d.]+), +([\d.]+)( *!.*)?")
    for text in path.read_text().splitlines():
        found = pattern.match(text.rstrip())
        assert found, text
        yield found.groups()


def test_every_rule_of_another_implementation_gives_the_same_sigma(data: Path) -> None:
    differ, compared = [], 0
    for station, _, catalogues, programme, start, end, sigma, *_ in vfcc17(
        data / "orbits" / "orbfit_weight_rules" / "vfcc17.rules"
    ):
        if station == "ALL" or programme:
            continue
        day = (start or "").strip() or ("2002-12-31" if (end or "").startswith(" 2003") else "2012-06-01")
        year, month, rest = day.split("-")
        for catalogue in "rUVt" if catalogues == "*" else catalogues:
            space = station in ("249", "250", "C49", "C50", "C51", "258")
            records = [line(station, f"{year} {month} {rest}.50000", "S" if space else "C", catalogue)]
            if space:
                records.append(S_PLACE.format(station).replace("2005 10 09.20072", f"{year} {month} {rest}.50000"))
            ours = sigma_arcsec(*records)[0, 0]
            compared += 1
            if abs(ours - float(sigma)) > 1e-9:
                differ.append((station, CATALOGUES[catalogue], float(sigma), round(float(ours), 3)))
    assert compared > 150
    # T stations: the paper gives 0.1" for Gaia catalogues alone. Y28: the paper's row has no date, OrbFit's begins in
    # 2015 and takes Gaia DR2 in. 248 after 1991, on paper only: Hipparcos ended in 1993
    assert {(station, theirs, ours) for station, _, theirs, ours in differ} == {
        ("T09", 0.1, 1.0), ("T12", 0.1, 1.0), ("T14", 0.1, 1.0), ("Y28", 1.0, 0.3), ("Y28", 0.3, 1.0),
        ("248", 0.15, 0.2), ("250", 1.3, 0.1),
    }  # fmt: skip


@pytest.mark.parametrize(("catalogue", "expected"), [("V", 0.02), ("W", 0.02), ("X", 0.02), ("t", 0.2), ("r", 0.2)])
def test_an_occultation_tied_to_gaia_weighs_as_its_star(catalogue: str, expected: float) -> None:
    records = [line("275", "2005 10 09.20072", "S", catalogue), S_PLACE.format("275")]
    np.testing.assert_allclose(sigma_arcsec(*records)[0], expected, atol=1e-9)


def test_a_stated_rms_of_an_occultation_stands_in_ades_too(tmp_path: Path) -> None:
    """A record of station 275 without a mode is one all the same: 3.5 mas are not raised to 50."""
    names = "provID|stn|sys|ctr|pos1|pos2|pos3|obsTime|ra|dec|rmsRA|rmsDec|astCat"
    row = "1979 HP|275|ICRF_KM|399|1190.349|-3232.544|3165.935|2020-09-15T14:02:19.12Z|27.7348|8.1062"
    row += "|0.0035|0.0042|Gaia3E"
    path = tmp_path / "one.psv"
    path.write_text(f"# version=2022\n{names}\n{row}\n")
    found = weigh(read_astrometry(path))
    assert found.rule[0].startswith("stated rms")
    assert "raised to 0.05" not in found.rule[0]


def test_the_shipped_table_names_a_source_in_every_row() -> None:
    assert {rule.source for rule in default_rules()} == {"V17", "V17g", "N", "F22", "G", "H", "O"}
    assert len(default_rules()) > 40


def test_nine_thousand_observations_are_weighed_in_a_twentieth_of_a_second(data: Path) -> None:
    records = mpc80.read(data / "observations" / "phaethon_mpc_full.obs80.gz")
    weigh(records.select(np.arange(10)))
    began = time.process_time()
    ours = weigh(records)
    assert time.process_time() - began < 0.2
    assert np.isfinite(ours.sigma_rad).all()
    assert (ours.sigma_rad > 0.0).all()
