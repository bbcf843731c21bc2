"""Packed and unpacked designations in the first twelve columns of a record."""

import pytest

from nebosvod.observation.formats.designations import Designation, combined, from_columns, from_text, is_satellite, kind
from nebosvod.observation.formats.object_names import merged, names_of, other_names, readings

# examples of https://www.minorplanetcenter.net/iau/info/PackedDes.html
PACKED = {
    "03202       ": Designation(number="3202"),
    "50000       ": Designation(number="50000"),
    "A0345       ": Designation(number="100345"),
    "a0017       ": Designation(number="360017"),
    "K3289       ": Designation(number="203289"),
    "~0000       ": Designation(number="620000"),
    "~AZaz       ": Designation(number="3140113"),
    "     J95X00A": Designation(provisional="1995 XA"),
    "     J95X01L": Designation(provisional="1995 XL1"),
    "     J95F13B": Designation(provisional="1995 FB13"),
    "     J98SA8Q": Designation(provisional="1998 SQ108"),
    "     J99AJ3Z": Designation(provisional="1999 AZ193"),
    "     PLS2040": Designation(provisional="2040 P-L"),
    "     T1S3138": Designation(provisional="3138 T-1"),
    "03202J95X00A": Designation(number="3202", provisional="1995 XA"),
    "    CJ95A010": Designation(provisional="C/1995 A1"),
    "    PJ94P01b": Designation(provisional="P/1994 P1-B"),
    "0004P       ": Designation(number="4P"),
    "     P10abcd": Designation(own="P10abcd"),
    "     A10Rq2c": Designation(own="A10Rq2c"),
    "  2005 TM173": Designation(provisional="2005 TM173"),
    "3666        ": Designation(number="3666"),
    # comets, their fragments, interstellar objects, surveys and the extended forms, by the same rules
    "0073P      b": Designation(number="73P-B"),
    "0073P     bt": Designation(number="73P-BT"),
    "0332PK10V01a": Designation(number="332P-A", provisional="P/2010 V1-A"),
    "0001P       ": Designation(number="1P"),
    "0003D       ": Designation(number="3D"),
    "0073PJ30J010": Designation(number="73P", provisional="P/1930 J1"),
    "    DJ93F02b": Designation(provisional="D/1993 F2-B"),
    "    AK17U010": Designation(provisional="A/2017 U1"),
    "    XB06C010": Designation(provisional="X/1106 C1"),
    "     K19Y040": Designation(own="K19Y040"),
    "2019 Y4     ": Designation(provisional="2019 Y4"),
    "0001I       ": Designation(number="1I"),
    "0001IK17U010": Designation(number="1I", provisional="I/2017 U1"),
    "0002IK19Q040": Designation(number="2I", provisional="I/2019 Q4"),
    "0067PJ69R010": Designation(number="67P", provisional="P/1969 R1"),
    "     _QC0000": Designation(provisional="2026 CA620"),
    "     _QC0aEM": Designation(provisional="2026 CZ6190"),
    "     T3S3138": Designation(provisional="3138 T-3"),
    "     J04O00A": Designation(provisional="A904 OA"),
    # written out
    "A904 OA     ": Designation(provisional="A904 OA"),
    "A/2017 U1   ": Designation(provisional="A/2017 U1"),
    "D/1993 F2-B ": Designation(provisional="D/1993 F2-B"),
    "C/-43 K1    ": Designation(provisional="C/-43 K1"),
    "1I/2017 U1  ": Designation(number="1I", provisional="I/2017 U1"),
    "332P-AA     ": Designation(number="332P-AA"),
    "620001      ": Designation(number="620001"),
    "2026 PDC27  ": Designation(provisional="2026 PDC27"),
    "     SIX    ": Designation(own="SIX"),
    "     12D    ": Designation(own="12D"),
    "     12345  ": Designation(own="12345"),
}


@pytest.mark.parametrize("columns", PACKED)
def test_the_columns_are_unpacked(columns: str) -> None:
    assert from_columns(columns) == PACKED[columns]


@pytest.mark.parametrize("columns", ["            ", "K05  K05TH3M", "Q           ", '     "<>"   '])
def test_what_is_no_designation_is_none(columns: str) -> None:
    assert from_columns(columns) is None


SATELLITES = [
    "J013S       ",
    "J013SJ74J010",
    "    SK20J420",
    "S/2003 J 2  ",
    "Jupiter XIII",
    "S001S       ",
    "J XIII      ",
]


@pytest.mark.parametrize("columns", SATELLITES)
def test_natural_satellites_are_known_and_are_no_designations(columns: str) -> None:
    assert is_satellite(columns)
    assert from_columns(columns.ljust(12)) is None


def test_a_tail_of_a_year_to_come_is_no_date_and_no_name() -> None:
    # K69 packs 2069; 67P was found in 1969 (J69)
    assert from_columns("0067PK69R010", 2027) == Designation(number="67P")
    assert from_columns("03202K99X00A", 2027) == Designation(number="3202")
    assert from_columns("03202J95X00A", 2027) == Designation(number="3202", provisional="1995 XA")


def test_what_the_columns_of_one_ades_record_say_is_put_together() -> None:
    said = [from_text("332P"), from_text("P/2010 V1-A"), Designation(own="trk")]
    assert combined([one for one in said if one]) == Designation(number="332P-A", provisional="P/2010 V1-A", own="trk")
    assert combined([Designation(number="73P"), Designation(number="73P-B")]) == Designation(number="73P-B")
    assert combined([Designation(number="3666"), Designation(number="433")]) is None


def test_one_object_keeps_one_name_when_its_orbit_letter_changes() -> None:
    """1I was A/2017 U1 and C/2017 U1 before: a letter says what the orbit is, not which object it is."""
    found = [Designation(provisional=text) for text in ("A/2017 U1", "C/2017 U1", "2017 U1", "2017 UA1")]
    assert names_of(found) == ["C/2017 U1"] * 3 + ["2017 UA1"]
    assert names_of([*found, Designation(number="1I", provisional="I/2017 U1")]) == ["1I"] * 3 + ["2017 UA1", "1I"]


def test_the_name_is_the_most_lasting_designation() -> None:
    assert Designation(number="3666", provisional="1979 HP", own="x").name == "3666"
    assert Designation(provisional="1979 HP", own="x").name == "1979 HP"
    assert Designation(own="x").name == "x"


def test_kinds_of_unpacked_designations_are_told_apart() -> None:
    numbers = ("1", "3666", "620000", "4P", "73P-B")
    provisional = ("1979 HP", "2016 NX22", "2040 P-L", "C/2019 Y4", "A904 OA")
    assert [kind(text) for text in numbers] == ["number"] * 5
    assert [kind(text) for text in provisional] == ["provisional"] * 5
    assert [kind(text) for text in ("", "0", "Apophis", "1979HP", "٣٦٦")] == [""] * 5


MEANT = {
    "03666": "3666",
    "(3666)": "3666",
    "j4767": "454767",
    "K10F61M": "2010 FM61",
    "j4767K10F61M": "454767",
    "2023DW": "2023 DW",
    "2024 yr4": "2024 YR4",
    "CK19Y040": "C/2019 Y4",
    "73P-b": "73P-B",
    "0073Pb": "73P-B",
    "0001IK17U010": "1I",
    "67P/Churyumov-Gerasimenko": "67P",
    "73P/Schwassmann-Wachmann 3-B": "73P-B",
    "2I/Borisov": "2I",
    "(3666) Holman": "3666",
    "2026pdc27": "2026 PDC27",
}


@pytest.mark.parametrize("text", MEANT)
def test_a_designation_may_be_written_packed_or_without_its_blank(text: str) -> None:
    assert MEANT[text] in readings(text)


def test_the_text_as_written_is_meant_first() -> None:
    # "A1234" may be the number 101234 and is more likely an observer's own name where there is one
    assert list(readings("A1234")) == ["A1234", "101234"]


def test_other_names_lead_to_the_most_lasting_one() -> None:
    found = [
        Designation(provisional="1979 HP", own="trk1"),
        Designation(number="3666", provisional="1979 HP"),
        Designation(provisional="2023 DW", own="trk1"),
        Designation(own="lone"),
    ]
    assert other_names(found) == {"1979 HP": ("3666",), "trk1": ("3666", "2023 DW")}
    # one table knows the number, another one the observer's name
    parts = [other_names(found[:1]), other_names(found[1:2])]
    assert merged(parts) == {"trk1": ("3666",), "1979 HP": ("3666",)}
