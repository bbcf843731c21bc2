"""The table of observations: choosing rows, joining files, what is repeated."""

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation.formats.reading import parse_astrometry
from nebosvod.observation.formats.records import Astrometry, joined
from nebosvod.observation.formats.source_file import SourceFile
from nebosvod.timescale import Epoch

ROWS = {
    "a": "3666|G96|2010-01-07T20:00:00Z|19.0|5.0",
    "b": "433|703|2010-01-05T20:00:00Z|20.0|6.0",
    "c": "3666|703|2010-01-06T20:00:00Z|21.0|7.0",
}


def table(names: str, file: str = "f") -> Astrometry:
    text = "\n".join(["# version=2022", "permID|stn|obsTime|ra|dec", *(ROWS[name] for name in names)])
    return parse_astrometry(SourceFile(file, text.encode()))


def test_objects_and_stations_stand_once_in_the_order_of_the_file() -> None:
    one = table("abc")
    assert (one.objects, one.stations) == (("3666", "433"), ("G96", "703"))


def test_rows_are_chosen_by_object_and_ordered_by_time() -> None:
    one = table("abc").of("3666").by_time()
    np.testing.assert_allclose(np.degrees(one.psi[:, 0]), [21.0, 19.0])
    assert one.line.tolist() == [5, 3]
    with pytest.raises(InputError, match=r"no observation of 99942 here \(there are: 3666, 433\)"):
        table("abc").of("99942")


def test_joined_files_count_their_times_from_the_earliest_epoch() -> None:
    late, early = table("a"), table("b", "g")
    both = joined([late, early])
    assert both.epoch == early.epoch
    assert both.path.tolist() == ["f", "g"]
    # exactly two days apart in UTC; TDB - TT changes by microseconds
    assert abs(both.t_s[0] - both.t_s[1] - 2 * 86400.0) < 1e-4
    np.testing.assert_array_equal(both.t_s, joined([table("ab")]).t_s)


def test_an_observation_in_two_files_is_kept_once() -> None:
    both = joined([table("ab"), table("bc", "g")])
    assert (both.line.tolist(), both.path.tolist()) == ([3, 4, 4], ["f", "f", "g"])
    assert dict(both.left_out) == {"duplicate": 1}
    assert both.notices == ("1 record was left out: the same as another one (second at g:3)",)


def test_nothing_cannot_be_joined() -> None:
    with pytest.raises(InputError, match="no observations to join"):
        joined([])


def test_observations_between_two_dates_stay_and_the_others_are_counted_with_their_side() -> None:
    def at(day: str) -> Epoch:
        return Epoch.parse(f"2010-01-{day} UTC")

    one = table("abc")
    # the first date belongs to the interval, the second does not
    left = one.between(at("05T20:00:00"), at("07T20:00:00"))
    assert left.line.tolist() == [4, 5]
    assert dict(left.left_out) == {"date": 1}
    assert left.notices == ("1 record was left out by date: 1 at or after 2010-01-07T20:00:00 UTC",)
    both = one.between(at("05T20:00:01"), at("07"))
    assert (both.line.tolist(), dict(both.left_out)) == ([5], {"date": 2})
    assert "1 before 2010-01-05T20:00:01 UTC, 1 at or after 2010-01-07T00:00:00 UTC" in both.notices[0]
    assert one.between(None, None) is one.between(at("01"), at("09"))
    with pytest.raises(InputError, match="there are 3, from 2010-01-05T20:00:00Z to 2010-01-07T20:00:00Z"):
        one.between(at("08"), None)


NAMED = """# version=2022
permID|provID|trkSub|stn|obsTime|ra|dec
3666|1979 HP|trk1|G96|2010-01-07T20:00:00Z|19.0|5.0
|2023 DW|trk2|703|2010-01-05T20:00:00Z|20.0|6.0
|2023 DW|both|703|2010-01-06T20:00:00Z|20.0|6.0
||lone|703|2010-01-06T20:00:00Z|21.0|7.0
3666||both|G96|2010-01-08T20:00:00Z|19.0|5.0
"""


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        *[(name, [3, 7]) for name in ("3666", "03666", "1979 HP", "J79H00P", "1979hp", "trk1")],
        *[(name, [4, 5]) for name in ("2023 DW", "K23D00W", "trk2")],
        ("lone", [6]),
    ],
)
def test_an_object_is_found_by_any_of_its_designations(name: str, lines: list[int]) -> None:
    one = parse_astrometry(SourceFile("f", NAMED.encode()))
    assert one.of(name).line.tolist() == lines


def test_a_name_of_nothing_and_one_of_two_objects_are_told() -> None:
    one = parse_astrometry(SourceFile("f", NAMED.encode()))
    with pytest.raises(InputError, match=r"both is the name of several objects here \(2023 DW, 3666\)"):
        one.of("both")
    with pytest.raises(InputError, match=r"there are: 3666 = 1979 HP = trk1, 2023 DW = trk2 = both, lone\)"):
        one.of("433")


def test_a_number_known_from_one_file_holds_for_the_others() -> None:
    provisional = "     J79H00P  C2010 01 05.20072 21 31 27.04 -00 10 33.9          19.2 Vrp0839703\n"
    both = joined(
        [parse_astrometry(SourceFile(name, text.encode())) for name, text in (("g", provisional), ("f", NAMED))]
    )
    assert both.objects == ("3666", "2023 DW", "lone")
    assert both.of("1979 HP").path.tolist() == ["g", "f", "f"]


OLD_NAMES = """\
# version=2022
permID|provID|trkSub|stn|obsTime|ra|dec
|2004 MN4||G96|2010-01-07T20:00:00Z|19.0|5.0
99942|||G96|2010-01-08T20:00:00Z|19.5|5.0
||trk1|703|2010-01-09T20:00:00Z|20.0|5.0
|A/2017 U1||703|2010-01-10T20:00:00Z|20.5|5.0
|C/2017 U1||703|2010-01-11T20:00:00Z|20.6|5.0
"""


def test_several_names_of_one_object_are_joined_under_the_first_and_told() -> None:
    one = parse_astrometry(SourceFile("f", OLD_NAMES.encode())).of("99942", "2004MN4", "trk1")
    assert one.objects == ("99942",)
    assert one.line.tolist() == [3, 4, 5]
    assert one.notices[-1].startswith("observations of 99942 and 2004 MN4 and trk1 were joined as those of one object")
    with pytest.raises(InputError, match="no observation of 433"):
        parse_astrometry(SourceFile("f", OLD_NAMES.encode())).of("99942", "433")


def test_a_changed_orbit_letter_makes_no_other_object() -> None:
    whole = parse_astrometry(SourceFile("f", OLD_NAMES.encode()))
    assert whole.objects == ("2004 MN4", "99942", "trk1", "C/2017 U1")
    for name in ("A/2017 U1", "2017 U1", "I/2017 U1", "CK17U010"):
        assert whole.of(name).line.tolist() == [6, 7]
    # also where the two names stand in two files, and a third one knows the number
    head = "\n".join(OLD_NAMES.splitlines()[:2]) + "\n"
    lines = [*OLD_NAMES.splitlines()[5:7], "1I|I/2017 U1||703|2010-01-12T20:00:00Z|20.7|5.0"]
    parts = [parse_astrometry(SourceFile(f"f{k}", f"{head}{line}\n".encode())) for k, line in enumerate(lines)]
    assert joined(parts[:2]).objects == ("C/2017 U1",)
    assert joined(parts).objects == ("1I",)


@pytest.mark.parametrize(
    ("head", "row", "field"),
    [
        ("permID", "J013S", "permID"),
        ("permID", "Jupiter 13", "permID"),
        ("provID", "S/2003 J 2", "provID"),
        ("provID", "SK20J420", "provID"),
    ],
)
def test_natural_satellites_are_refused_in_words(head: str, row: str, field: str) -> None:
    text = f"# version=2022\n{head}|stn|obsTime|ra|dec\n{row}|703|2010-01-09T20:00:00Z|20.0|5.0\n"
    with pytest.raises(InputError, match=f'f:3: {field} "{row}": is a natural satellite; orbits about planets are not'):
        parse_astrometry(SourceFile("f", text.encode()))


def test_natural_satellites_in_80_columns_are_refused_in_words() -> None:
    line = "J013S         C2022 07 26.00000123 42 46.013+17 52 55.07               V     683\n"
    with pytest.raises(InputError, match='f:1: columns 1-12: "J013S       " is a natural satellite'):
        parse_astrometry(SourceFile("f", line.encode()))


def test_a_tail_of_a_year_to_come_and_the_name_of_an_exercise_are_told() -> None:
    line = "0067PK69R010  C2022 07 26.00000123 42 46.013+17 52 55.07               V     683\n"
    one = parse_astrometry(SourceFile("f", line.encode()))
    assert one.objects == ("67P",)
    assert '"0067PK69R010" was read as 67P' in one.notices[0]
    text = "# version=2022\nprovID|stn|obsTime|ra|dec\n2026 PDC27|703|2026-01-09T20:00:00Z|20.0|5.0\n"
    two = parse_astrometry(SourceFile("f", text.encode()))
    assert two.objects == ("2026 PDC27",)
    assert "exercise" in two.notices[0]
