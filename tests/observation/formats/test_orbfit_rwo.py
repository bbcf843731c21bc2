"""OrbFit's .rwo files: what stands in the columns, and what is wrong in them, in words."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation.formats.reading import parse_astrometry, read_astrometry
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.formats.source_file import SourceFile
from nebosvod.observation.reduction.debias import debias
from nebosvod.observation.reduction.stated_weights import kept
from nebosvod.observation.reduction.weights import weigh

ARCSEC = np.pi / 648000.0
HEAD = (
    "version =   2\nerrmod  = 'fcct14'\nRMSast  =   4.79258E-01\nRMSmag  =   0.00000E+00\nEND_OF_HEADER\n! a comment\n"
)
# records of (410777) and (1862) as OrbFit 5 wrote them
FIRST = (
    " 410777    O C   2009 02 24.36493       1.000E-05 12 52 49.370  1.500E-01    0.433 F    0.204   -0.103 "
    "+00 09 47.30  1.000E-01    0.485 F    0.272   -0.298                       o 691      0.66 1 0"
)
SPACE = (
    " 410777    S S   2014 05 25.28214       1.000E-05 10 37 03.990  1.500E-01    1.000 F    0.000    0.232 "
    "+10 15 51.90  1.000E-01    1.000 F    0.000   -0.203 19   R  1.00   1.35   L C51      0.31 1 1"
)
PLACE = " 410777    S s   2014 05 25.28214 1  -6063.8910   2951.8836   1376.0726 C51"
RADAR = (
    " 410777    V c   2014 04 07 20:21:00    455098.63387   1.63248   1.63248 F     0.00000     1.19126 251 251"
    "      0.80 1"
)


def read(*lines: str, head: str = HEAD) -> Astrometry:
    return parse_astrometry(SourceFile("f.rwo", (head + "\n".join(lines) + "\n").encode()))


def test_what_stands_in_the_columns() -> None:
    one = read(FIRST, SPACE, PLACE, FIRST.replace("O C ", "O X "), RADAR)
    assert one.objects == ("410777",)
    assert one.line.tolist() == [7, 8]
    assert one.utc[0] == "2009-02-24T08:45:29.9520Z"
    np.testing.assert_allclose(np.degrees(one.psi[0]), [15 * (12 + 52 / 60 + 49.37 / 3600), 9 / 60 + 47.3 / 3600])
    np.testing.assert_allclose(one.sigma_rad[0] / ARCSEC, [0.433, 0.485])
    np.testing.assert_allclose(one.bias_rad[0] / ARCSEC, [0.204, 0.272])
    assert (one.catalogue[0], one.mode[0], one.station[0]) == ("USNOB1", "CCD", "691")
    np.testing.assert_allclose(one.position_km[1], [-6063.8910, 2951.8836, 1376.0726])
    assert (one.centre[1], one.magnitude[1], one.band[1]) == ("earth", 19.0, "R")
    assert dict(one.left_out) == {"radar": 1, "deleted": 1}
    assert "weights and star-catalogue biases are those of OrbFit" in one.notices[0]


def test_weights_and_biases_are_used_as_they_stand() -> None:
    """Ten records of one night: no rule thins them, no floor raises them; no table is asked for their biases."""
    night = [FIRST.replace(".36493", f".3649{k}").replace("0.433", "0.011") for k in range(10)]
    records = read(*night)
    found = kept(weigh(records), records)
    np.testing.assert_allclose(found.sigma_rad / ARCSEC, np.tile([0.011, 0.485], (10, 1)))
    assert set(found.rule.tolist()) == {"weight of the file"}
    correction, notices = debias(records)
    np.testing.assert_allclose(correction / ARCSEC, np.tile([0.204, 0.272], (10, 1)))
    assert notices == ()


@pytest.mark.parametrize(
    ("name", "object_"),
    [("2004MN4", "2004 MN4"), ("6743P-L", "6743 P-L"), ("K09B00D", "2009 BD"), ("1862", "1862"), ("mine", "mine")],
)
def test_designations_without_their_blank_are_known(name: str, object_: str) -> None:
    assert read(FIRST.replace("410777   ", f"{name:<9}")).objects == (object_,)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([FIRST[:100]], "f.rwo:7: the record has 100 columns, not 197"),
        ([FIRST.replace("o 691", "o 6g1")], "f.rwo:7: columns 181-183"),
        ([FIRST.replace("    0.433", "    *****")], r'f.rwo:7: RA RMS "\*\*\*\*\*": allowed a number from 0'),
        ([FIRST.replace("    0.433", "    0.000")], 'f.rwo:7: RA RMS "0.000"'),
        ([FIRST.replace("02 24.36", "02 30.36")], 'f.rwo:7: date "2009 02 30.36493": there is no such day'),
        ([FIRST.replace("12 52 49.370", "25 52 49.370")], "f.rwo:7: right ascension"),
        ([FIRST.replace("+00 09 47.30", " 00 09 47.30")], "f.rwo:7: declination"),
        ([SPACE], 'f.rwo:7: line "S" is not followed by its line "s"'),
        ([SPACE, PLACE.replace("25.28214", "25.28215")], 'f.rwo:7: line "S" is not followed by its line "s"'),
        ([SPACE, PLACE.replace("-6063.8910", "   63.8910").replace("2951", "   1")], "f.rwo:8: position: 1378 km"),
        ([PLACE], 'f.rwo:7: line "s" stands alone'),
        ([FIRST.replace("o 691", "o C51")], r"f.rwo:7: observatory C51 \(WISE\) has no fixed place"),
        ([FIRST.replace("410777   ", "J013S    ")], 'f.rwo:7: "J013S" is a natural satellite'),
        ([FIRST.replace(" O C", " Q C")], 'f.rwo:7: column 12 "Q": allowed O, S, R, V'),
        ([RADAR], r"f.rwo:1: no observations in this file \(1 radar left out\)"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named_with_its_line(lines: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        read(*lines)


def test_an_older_version_is_refused() -> None:
    with pytest.raises(InputError, match="only version 2"):
        read(FIRST, head=HEAD.replace("=   2", "=   1"))


@pytest.mark.parametrize("share", [0.2, 0.6, 0.9])
def test_a_cut_file_is_read_or_refused_and_never_breaks(data, share: float) -> None:
    raw = (data / "orbits" / "orbfit_1862_Apollo" / "1862.rwo").read_bytes()
    whole = raw[: int(share * len(raw))].rpartition(b"\n")[0]
    assert len(parse_astrometry(SourceFile("cut.rwo", whole))) > 100
    with pytest.raises(InputError, match=r"cut\.rwo:\d+: "):
        parse_astrometry(SourceFile("cut.rwo", whole + b"\n" + raw[:1000].splitlines()[-2][:90]))


def test_every_optical_record_of_a_real_file_is_read(data) -> None:
    """(1862) Apollo: 1391 directions, one of them withdrawn, 21 by WISE, 17 radar."""
    one = read_astrometry(data / "orbits" / "orbfit_1862_Apollo" / "1862.rwo")
    assert (len(one), dict(one.left_out)) == (1390, {"radar": 17, "deleted": 1})
    assert np.count_nonzero(one.centre == "earth") == 21
