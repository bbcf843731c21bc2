"""What all pages have in common: one template environment, inline style and script, a policy that forbids requests."""

import base64
import hashlib
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from nebosvod.report.kit import wording
from nebosvod.version import __version__

HERE = Path(__file__).parent.parent


def render(template: str, **words: Any) -> str:
    """Fill a template of this folder that extends base.html; the same words give the same bytes.

    Parameters
    ----------
    template : file name beside this module.
    words : what the template speaks of. base.html itself needs `title` (the heading) and `kind` (what the page is,
        as "Accuracy report"); both are escaped unless they are Markup.

    Notes
    -----
    Every page is one file without any request: style and script stand in it, and its Content-Security-Policy allows
    nothing but them (the script by its hash) and `data:` images. A page must read completely without the script.
    """
    script = (HERE / "script.js").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return _environment().get_template(template).render(
        program=__version__,
        css=Markup((HERE / "style.css").read_text(encoding="utf-8")),
        script=Markup(script),
        policy=f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'",
        **words,
    )  # fmt: skip


@cache
def _environment() -> Environment:
    """Templates of this folder; everything is escaped, and a name that nobody gave is an error."""
    made = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True,
    )  # fmt: skip
    made.globals["wording"] = wording  # macros see it too
    return made
