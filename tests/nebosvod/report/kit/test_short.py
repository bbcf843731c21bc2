"""Answers of two lines, and text as print sets it."""

import pytest
from markupsafe import Markup

from nebosvod.report.kit import short
from nebosvod.report.kit.typography import Verbatim, typeset

LONG = (
    "the first clause of an answer that goes on; the second (with a bracket, and more) which goes on too; and a third "
)


def test_a_text_breaks_at_blanks_but_not_where_it_must_not() -> None:
    twice = short.ROW_PX / short.width_px("M", 16.0)
    assert short.lines("M" * int(0.99 * twice)) == 1
    assert short.lines("M " * int(0.9 * twice)) == 2  # blanks are narrower than letters, and there are as many
    held = "1.08 × 0.749 km"
    told = "word " * 15
    assert short.lines(told + held, short.width_px(told + "1.08", 16.0)) == 2
    broken = Markup(f'{told}<span class="nowrap">{held}</span>')
    assert short.lines(broken, short.width_px(told + "1.08 × 0.749 ", 16.0)) == 2
    assert short.lines("x" * 1000) > 2  # an endless word breaks anywhere


def test_a_long_answer_is_cut_between_clauses_and_stands_whole_behind() -> None:
    text = LONG * 4
    shown, more = short.answer([text, "a reason"])
    assert short.lines(shown) <= 2
    assert shown.endswith("\N{HORIZONTAL ELLIPSIS}")
    assert shown.count("(") == shown.count(")")
    assert more == (Markup.escape(text), Markup("a reason"))
    assert short.answer(["short", "a reason"]) == (Markup("short"), (Markup("a reason"),))


def test_one_endless_word_is_cut_too() -> None:
    cut = short.headline("x" * 1000)
    assert cut is not None
    assert short.width_px(cut, *short.HEADLINE) <= 2.0 * short.HEADLINE_PX


def test_clauses_are_added_as_long_as_they_fit() -> None:
    said = short.as_many("first", ["a clause " * 30, "second"])
    assert said == "first; second."


@pytest.mark.parametrize(
    ("written", "printed"),
    [
        ("3.2 +- 0.4 s", "3.2 ± 0.4 s"),
        ("-3, (-0.5) and 10-3", "−3, (−0.5) and 10-3"),
        ("2.7e-05 au, 4.2e+03 km", "2.7\u00a0×\u00a010⁻⁵ au, 4.2\u00a0×\u00a010³ km"),
        ("on 2029-04-12T00:00:00.000 TDB", "on 2029-04-12 00:00 TDB"),
        ("2031-06-10T11:26:30 UTC", "2031-06-10 11:26:30 UTC"),
        ("sha256 834e794bcacc #009e73", "sha256 834e794bcacc #009e73"),
        ("data:text/csv,1e5", "data:text/csv,1e5"),
    ],
)
def test_plain_text_is_set_as_print_has_it(written: str, printed: str) -> None:
    assert typeset(written) == printed


def test_tags_code_and_what_an_author_wrote_stay() -> None:
    text = Markup('<data value="-2e-05">-2</data> <code>--at 2029-04-12T00:00</code>')
    assert typeset(text) == '<data value="-2e-05">−2</data> <code>--at 2029-04-12T00:00</code>'
    assert typeset(Markup("color: -2")) == "color: -2"  # a style or an attribute has no tags
    assert typeset(Verbatim("170 +- 20 m")) == "170 +- 20 m"
