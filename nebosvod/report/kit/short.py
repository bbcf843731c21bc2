"""Answers of two lines: how long a text is on a wide screen, and what of it stands there; the rest is one click away.

Widths are those of DejaVu Sans, which matplotlib brings: no usual face of a screen is wider, so what fits in it fits.
"""

import html
import re
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

from markupsafe import Markup
from matplotlib import get_data_path
from matplotlib.ft2font import FT2Font

from nebosvod.report.kit.typography import sentence, words

ROW_PX, HEADLINE_PX, NOTE_PX = (
    715.0,
    880.0,
    880.0,
)  # of a line at 1280 px: beside a question, in the headline, a warning
ROW, HEADLINE, NOTE = (16.0, False), (20.0, True), (15.0, False)  # px of a letter, whether bold
MOST_LINES = 2
MORE = "\N{NO-BREAK SPACE}\N{HORIZONTAL ELLIPSIS}"
UNBROKEN = re.compile(r'<span class="nowrap">(.*?)</span>', re.DOTALL)
BREAKS = ("; ", ": ", ", ", " ")  # where a long text is cut, the best first
LEAST = 0.45  # of what would fit, that a cut at a better break may leave


@cache
def _font(bold: bool) -> FT2Font:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    font = FT2Font(str(Path(get_data_path(), "fonts", "ttf", name)))
    font.set_size(100.0, 72.0)
    return font


@cache
def _letter(letter: str, bold: bool) -> float:
    """Width of a letter of 1 px."""
    return float(_font(bold).load_char(ord(letter)).linearHoriAdvance) / 65536.0 / 100.0


def width_px(text: str, size_px: float, bold: bool = False) -> float:
    """How wide a text is on one line."""
    return size_px * sum(_letter(letter, bold) for letter in text)


def lines(text: str | Markup, wide_px: float = ROW_PX, look: tuple[float, bool] = ROW) -> int:
    """How many lines a text takes; it breaks at spaces, but not inside of `nowrap`."""
    return len(_broken(words(_plain(text)), wide_px, look))


def first_that_fits(*texts: str | Markup, wide_px: float = ROW_PX, look: tuple[float, bool] = ROW) -> Markup:
    """The first of several ways to say a thing, the fullest first, that takes two lines beside its question."""
    for text in texts:
        if lines(text, wide_px, look) <= MOST_LINES:
            return Markup.escape(text)
    return Markup.escape(texts[-1])


def as_many(first: str | Markup, more: Iterable[str | Markup], between: str = "; ", end: str = ".") -> Markup:
    """A first clause and, of the others, the most important first, those that fit with it in two lines."""
    told = Markup.escape(first)
    for one in more:
        longer = told + between + one
        if lines(longer + end) <= MOST_LINES:
            told = longer
    return told + end


def answer(told: Sequence[str | Markup]) -> tuple[Markup, tuple[Markup, ...]]:
    """What stands beside a question, two lines at the most, and what stands behind it."""
    every = tuple(sentence(Markup.escape(one)) for one in told if one)
    if not every:
        return Markup(""), ()
    shown = shortened(every[0])
    return (every[0], every[1:]) if shown is None else (shown, every)


def shortened(
    text: str | Markup, wide_px: float = ROW_PX, look: tuple[float, bool] = ROW, most: int = MOST_LINES
) -> Markup | None:
    """The beginning of a text that takes more than two lines, cut between clauses; None for a short one."""
    plain = words(_plain(text))
    if len(_broken(plain, wide_px, look)) <= most:
        return None
    fits = _longest(plain, wide_px, look, most)
    for mark in BREAKS:
        at = plain.rfind(mark, 0, fits + 1)
        while at > 0 and _open(plain[:at]):
            at = plain.rfind(mark, 0, at)
        if at >= LEAST * fits or (mark == BREAKS[-1] and at > 0):
            return Markup.escape(plain[:at].rstrip(" ,;:") + MORE)
    return Markup.escape(plain[:fits] + MORE)


def headline(text: str | Markup) -> Markup | None:
    """The beginning of a headline of more than two lines; None for a short one."""
    return shortened(text, HEADLINE_PX, HEADLINE)


def note(text: str | Markup) -> Markup | None:
    """The beginning of a warning of more than two lines; None for a short one."""
    return shortened(text, NOTE_PX, NOTE)


def _open(text: str) -> bool:
    return text.count("(") > text.count(")")


def _plain(text: str | Markup) -> str:
    """The words of a text, with blanks that do not break where it says so."""
    if not isinstance(text, Markup):
        return " ".join(text.split(" "))
    kept = UNBROKEN.sub(lambda found: found[1].replace(" ", "\N{NO-BREAK SPACE}"), str(text))
    return html.unescape(re.sub(r"<[^>]*>", "", kept))


def _broken(plain: str, wide_px: float, look: tuple[float, bool]) -> list[str]:
    """The lines of a text as a browser breaks it: at blanks, greedily."""
    done: list[str] = []
    now = ""
    for word in (piece for whole in plain.split(" ") for piece in _pieces(whole, wide_px, look)):
        longer = f"{now} {word}" if now else word
        if now and width_px(longer, *look) > wide_px:
            done.append(now)
            now = word
        else:
            now = longer
    return [*done, now]


def _pieces(word: str, wide_px: float, look: tuple[float, bool]) -> list[str]:
    """A word, broken anywhere where it is longer than a line."""
    if width_px(word, *look) <= wide_px:
        return [word]
    n = max(1, int(len(word) * wide_px / width_px(word, *look)))
    return [word[k : k + n] for k in range(0, len(word), n)]


def _longest(plain: str, wide_px: float, look: tuple[float, bool], most: int) -> int:
    """How many letters of a text stand in so many lines, with the mark that more follows."""
    low, high = 1, len(plain)
    while low < high:
        middle = (low + high + 1) // 2
        text = plain[:middle].rstrip() + MORE
        ok = len(_broken(text, wide_px, look)) <= most and width_px(text, *look) <= most * wide_px
        low, high = (middle, high) if ok else (low, middle - 1)
    return low
