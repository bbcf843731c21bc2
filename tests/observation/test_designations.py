"""Packed and unpacked designations in the first twelve columns of a record."""

import pytest

from nebosvod.observation.designations import Designation, from_columns, kind, merged, other_names, readings

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
}


@pytest.mark.parametrize("columns", PACKED)
def test_the_columns_are_unpacked(columns: str) -> None:
    assert from_columns(columns) == PACKED[columns]


@pytest.mark.parametrize("columns", ["            ", "K05  K05TH3M", "Q           ", '     "<>"   '])
def test_what_is_no_designation_is_none(columns: str) -> None:
    assert from_columns(columns) is None


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
