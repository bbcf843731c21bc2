"""The same observation in two formats or files counts once; different ones never do."""

import numpy as np
import pytest

from nebosvod.observation.formats.reading import parse_astrometry, read_astrometry
from nebosvod.observation.formats.records import Astrometry, joined
from nebosvod.observation.formats.source_file import SourceFile

# made-up: the same three observations of a station and one of a spacecraft, in both formats of the Minor Planet Center
OBS80 = """\
     K22R01Z  C2022 07 26.00000123 42 46.013+17 52 55.07               V     683
     K22R01Z  C2022 07 26.01000023 42 56.675+17 53 04.08               V     683
     K22R01Z  C2022 07 27.00000123 48 43.758+18 38 30.77               V     683
     K22R01Z  S2022 08 01.50000023 50 00.000+19 00 00.00               V     C51
     K22R01Z  s2022 08 01.5000001 + 6000.1230 - 2000.5000 + 2500.0000   ~    C51
"""
PSV = """\
# version=2022
provID|stn|obsTime|ra|dec|rmsRA|rmsDec|astCat|sys|ctr|pos1|pos2|pos3
2022 RZ1|683|2022-07-26T00:00:00.06Z|355.691721|17.881963|0.1|0.1|Gaia2||||||
2022 RZ1|683|2022-07-26T00:14:24.00Z|355.736146|17.884467|0.1|0.1|Gaia2||||||
2022 RZ1|683|2022-07-27T00:00:00.10Z|357.182325|18.641881|0.1|0.1|Gaia2||||||
2022 RZ1|C51|2022-08-01T12:00:00.000Z|357.500000|19.000000|0.1|0.1|Gaia2|ICRF_KM|399|6000.12|-2000.50|2500.00
"""


def table(text: str, file: str) -> Astrometry:
    return parse_astrometry(SourceFile(file, text.replace("||||||\n", "|||||\n").encode()))


@pytest.mark.parametrize("first", ["obs80", "psv"])
def test_the_same_observation_in_two_formats_counts_once_and_is_told(first: str) -> None:
    """The one that states its sigma stays, whichever file comes first."""
    parts = [table(OBS80, "a.obs80"), table(PSV, "b.psv")]
    both = joined(parts if first == "obs80" else parts[::-1])
    assert len(both) == 4
    assert set(both.path.tolist()) == {"b.psv"}
    assert both.left_out["duplicate"] == 4
    assert any("4 records were left out: the same observation in another file" in one for one in both.notices)
    assert any("a.obs80:1 as b.psv:3" in one for one in both.notices)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("00:00:00.06Z|355.691721", "00:00:00.26Z|355.691721"),  # 0.17 s of a step of 0.0864 s
        ("355.691721", "355.691781"),  # 0.21" of a step of 0.15"
        ("17.881963", "17.881967"),  # 0.014" of a step of 0.01"
        ("|683|2022-07-26T00:00", "|703|2022-07-26T00:00"),
        ("2022 RZ1|683|2022-07-26T00:00", "2022 RZ2|683|2022-07-26T00:00"),
        ("|6000.12|", "|6020.12|"),
    ],
)
def test_what_differs_by_more_than_the_coarser_last_digit_is_another_observation(old: str, new: str) -> None:
    assert old in PSV
    both = joined([table(OBS80, "a.obs80"), table(PSV.replace(old, new), "b.psv")])
    assert len(both) == 5


def test_exposures_faster_than_a_coarse_time_stay_as_many_as_they_are() -> None:
    """Times to 0.00001 d in one file, to 0.01 s in the other: three exposures 0.3 s apart are three."""
    coarse = "     K22R01Z  C2022 07 26.00000 23 42 46.0  +17 52 55.0               V      683\n"
    rows = [f"2022 RZ1|683|2022-07-26T00:00:00.{tenth}0Z|355.6917|17.8819|0.1|0.1|Gaia2|||||" for tenth in "036"]
    fine = "\n".join([*PSV.splitlines()[:2], *rows])
    alone = table(fine + "\n", "b.psv")
    both = joined([table(coarse, "a.obs80"), alone])
    assert len(alone) == 3
    assert len(both) == 3
    assert both.left_out["duplicate"] == 1


def test_records_of_one_file_are_the_same_only_if_they_are_equal() -> None:
    """A station may well take two pictures within the last digit of a coarse time."""
    twice = OBS80 + OBS80.splitlines()[0].replace("26.000001", "26.000002") + "\n"
    assert len(table(twice, "a.obs80")) == 5
    assert len(table(OBS80 + OBS80.splitlines()[0] + "\n", "a.obs80")) == 4


def test_every_record_of_a_real_file_is_found_in_its_twin(data) -> None:
    """4312 records of (3666) Holman and the same by ADES names, with one more."""
    folder = data / "observations"
    both = joined(
        [read_astrometry(folder / f"{name}") for name in ("03666_Holman.obs80", "holman_data_with_sats_occ.csv")]
    )
    assert len(both) == 4313
    assert both.objects == ("3666",)
    assert np.isfinite(both.t_s).all()
