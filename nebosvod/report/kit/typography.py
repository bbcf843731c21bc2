"""Text as print sets it: sentences that the terminal shares say `+-`, `-3`, `2.7e-05` and `2029-04-12T00:00:00.000`."""

import re
from typing import Any

from markupsafe import Markup

from nebosvod.report.kit.wording import MINUS, NBSP, SUPERSCRIPT, TIMES

KEPT = re.compile(r"(<code\b.*?</code>|<pre\b.*?</pre>|<svg\b.*?</svg>|<[^>]*>)", re.DOTALL)
PLUS_MINUS = re.compile(r"(?<=[\s>])\+-(?=[\s\d])|^\+-(?=\s)")
NEGATIVE = re.compile(r"(?<![\w.\-+−)])-(?=\.?\d)")
POWER = re.compile(r"(?<![\w.#-])([-−]?\d{1,4}(?:\.\d+)?)[eE]([+-]?)0*(\d{1,3})(?![\w.]|-\d)")
MOMENT = re.compile(r"(\d{4}-\d\d-\d\d)T(\d\d:\d\d)(:\d\d(?:\.\d+)?)?(?![\w:])")


class Verbatim(Markup):
    """Text that stands as its author wrote it, as a mission's file does."""

    __slots__ = ()


def typeset(value: Any) -> Any:
    """What a template is given, its words as print sets them; tags, code and pictures stay as they are.

    Parameters
    ----------
    value : a string is plain text and stays to be escaped; of a `Markup` with tags the text between them is set, one
        without tags may be a style, a script or an attribute, and passes as anything else does (`sentence` sets it).
    """
    if not isinstance(value, str) or isinstance(value, Verbatim):
        return value
    if isinstance(value, Markup):
        return sentence(value) if "<" in value else value
    return value if value.startswith("data:") else words(value)


def sentence(text: Markup) -> Markup:
    """The same of a text that is known to be one."""
    parts = KEPT.split(str(text))
    return Markup("".join(part if k % 2 else words(part) for k, part in enumerate(parts)))


def words(text: str) -> str:
    """One piece of text without tags: signs, powers of ten and moments as a reader of print expects them."""
    text = PLUS_MINUS.sub("±", text)
    text = POWER.sub(_power, text)
    text = MOMENT.sub(_moment, text)
    return NEGATIVE.sub(MINUS, text)


def _power(found: re.Match[str]) -> str:
    """`2.7e-05` as 2.7 × 10⁻⁵."""
    exponent = ("-" if found[2] == "-" else "") + found[3]
    return f"{found[1]}{NBSP}{TIMES}{NBSP}10{exponent.translate(SUPERSCRIPT)}"


def _moment(found: re.Match[str]) -> str:
    """An epoch without its T, and without seconds that are nought."""
    seconds = (found[3] or "").rstrip("0").rstrip(".") if "." in (found[3] or "") else found[3] or ""
    seconds = "" if seconds in (":", ":0", ":00") else seconds
    return f"{found[1]} {found[2]}{seconds}"
