"""Observatory codes: which exist, which have no place, and what was meant by one that does not exist."""

import pytest

from nebosvod.observation.earth import obscodes


def test_codes_of_the_ground_of_space_and_of_nothing_are_told_apart() -> None:
    assert [obscodes.known(code) for code in ("500", "G96", "C51", "247", "g96", "ZZZ", "", "5000")] == [
        True, True, True, True, False, False, False, False,
    ]  # fmt: skip
    assert [obscodes.needs_position(code) for code in ("500", "G96", "248", "C51", "247", "275", "ZZZ")] == [
        False, False, False, True, True, True, False,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("typed", "meant"), [("7O3", "703"), ("G9G", "G96"), ("g96", "G96"), ("5OO", "500"), ("F5I", "F51")]
)
def test_the_nearest_code_comes_first(typed: str, meant: str) -> None:
    assert obscodes.nearest(typed)[0] == meant


def test_a_code_unlike_any_other_gets_an_example() -> None:
    assert obscodes.nearest("☄☄☄") == ()
    assert 'for example "500"' in obscodes.unknown("☄☄☄")
