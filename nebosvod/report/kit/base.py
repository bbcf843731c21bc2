"""What all pages have in common: one template environment, inline style and script, a policy that forbids requests."""

import base64
import hashlib
import re
from collections.abc import Sequence
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from nebosvod.report.kit import short, wording
from nebosvod.report.kit.gathered import gather_words
from nebosvod.report.kit.typography import Verbatim, typeset
from nebosvod.version import __version__

HERE = Path(__file__).parent.parent


def render(template: str, *, stamp: Sequence[str] = (), scripts: Sequence[str] = (), **words: Any) -> str:
    """Fill a template of this folder that extends base.html; the same words give the same bytes.

    Parameters
    ----------
    template : file name beside this module.
    scripts : further scripts of this folder that the page needs.
    words : what the template speaks of. base.html itself needs `title` (the heading) and `kind` (what the page is,
        as "Accuracy report"); both are escaped unless they are Markup.

    stamp : when, by which version and from what the answer was made (`kit.stamp`).

    Notes
    -----
    Figures and tables are numbered in the order of the page.

    Every page is one file without any request: style and script stand in it, and its Content-Security-Policy allows
    nothing but them (the script by its hash) and `data:` images. A page must read completely without the script.
    """
    gather_words(words)
    script = "\n".join((HERE / name).read_text(encoding="utf-8") for name in ("script.js", *scripts))
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    made = [*stamp] or [f"nebosvod {__version__}"]
    page = _environment().get_template(template).render(
        program=__version__,
        stamp=made,
        running=_css_text(f"{words['title']} · {words['kind']}"),
        running_stamp=_css_text(" · ".join(made)),
        css=Verbatim((HERE / "style.css").read_text(encoding="utf-8")),
        script=Verbatim(script),
        policy=Verbatim(f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'"),
        **words,
    )  # fmt: skip
    return _numbered(page)


def _numbered(page: str) -> str:
    """The page with `Figure 3` and `Table 2` before captions; macros.html leaves the places."""
    numbers = {"Figure": count(1), "Table": count(1)}

    def said(place: re.Match[str]) -> str:
        return f'<b class="number">{place[1]} {next(numbers[place[1]])}.</b>'

    return re.sub(r'<b class="number">(Figure|Table)</b>', said, page)


def _css_text(text: str) -> Markup:
    """Text as a string of CSS inside a <style>: nothing in it can end the string or the element."""
    plain = str(Markup(text).striptags()) if isinstance(text, Markup) else text
    kept = "".join(c if c.isalnum() or c in " .,:;·-()" else f"\\{ord(c):x} " for c in plain)
    return Markup(f'"{kept}"')


@cache
def _environment() -> Environment:
    """Templates of this folder; everything is escaped, and a name that nobody gave is an error."""
    made = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True, finalize=typeset,
    )  # fmt: skip
    made.globals |= {"wording": wording, "short": short}  # macros see them too
    return made
