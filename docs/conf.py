"""The documentation as a site: Sphinx, MyST and the furo theme. Build it with `make docs`."""

import os
import re
import runpy
from pathlib import Path
from typing import Any

from nebosvod.version import __version__

project = "nebosvod"
author = "the nebosvod developers"
copyright = "the nebosvod developers"
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
autodoc_default_options = {"members": True, "member-order": "bysource", "exclude-members": "model_config"}
autodoc_typehints = "none"  # an array has a shape and a unit, which stand in the docstring
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False
napoleon_use_param = True
default_role = "code"
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
myst_fence_as_directive = ["math"]
source_suffix = {".md": "markdown"}
root_doc = "index"
exclude_patterns = ["site", "made"]
HERE = Path(__file__).parent

html_theme = "furo"
html_title = f"nebosvod {version}"
html_theme_options = {"source_repository": "", "top_of_page_buttons": []}
html_copy_source = False
html_show_sphinx = False


def _adapt(app: Any, name: str, source: list[str]) -> None:
    """Fit a page, written to be read as a plain file as well, into the site.

    Links to files beside the documentation lead nowhere on the site and become text, but notebooks, which can be taken
    from it; the navigation is made from the lists that the index page shows its readers, so that there is one list, not
    two.
    """
    source[0] = re.sub(r"(?<!!)\[([^\]]*)\]\(\.\./[^)]*(?<!\.ipynb)\)", r"\1", source[0])
    if name == root_doc:
        source[0] += _navigation(source[0])


LIST = re.compile(r"^(To [\w ]+)[^\n]*:\n\n((?:(?:\d+\. |   ).*\n)+)", re.MULTILINE)


def _navigation(index: str) -> str:
    """The lists of the index page as trees of contents, each under what stands before its list."""
    lines, listed = ["", ""], set[str]()
    for caption, pages in LIST.findall(index):
        named = dict.fromkeys(re.findall(r"\]\((\w[\w-]*)\.md\)", pages))
        lines += [
            "```{toctree}",
            ":hidden:",
            f":caption: {caption}",
            *(page for page in named if page not in listed),
            "```",
        ]
        listed |= set(named)
    return "\n".join([*lines, ""])


ENTRY = re.compile(r"^([\w*, ]+) : (.*)$")
SECTIONS = ("Parameters", "Attributes", "Returns")
_SENTENCES: dict[str, list[str]] = {}


def _plain(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Make a docstring of this project, meant to be read in the editor, one that napoleon reads as it is meant.

    What follows the colon of a parameter says what it is, in words, and is no type; a bar is an absolute value; what is
    indented below a line that ends with a colon stands as it is.
    """
    made: list[str] = []
    section, block = "", False
    for line, below in zip(lines, [*lines[1:], ""]):
        if below and set(below) == {"-"}:
            section = line.strip()
        if block and line.strip() and not line.startswith("    "):
            made, block = [*made, ""], False
        if block:
            made.append(line)
            continue
        entry, text = ENTRY.match(line), line.replace("|", "\\|")
        if entry and section in SECTIONS:
            made += [entry[1], f"    {text.partition(' : ')[2]}"]
        elif line.endswith(":") and below.startswith("    ") and section not in (*SECTIONS, "Raises"):
            made, block = [*made, f"{text}:", ""], True
        else:
            made.append(text)
    lines[:] = made
    if what in ("property", "attribute", "data") and not section:
        _SENTENCES[name] = made


def _sentence(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Give a property its sentence back: napoleon takes what stands before a colon in it for a type."""
    if name in _SENTENCES:
        lines[:] = _SENTENCES.pop(name)


def _pictures(app: Any) -> None:
    """Run the pages that have pictures, so that each picture is what the code beside it draws.

    NEBOSVOD_PICTURES=none leaves that out and puts the picture of the report in their places, to see links alone.
    """
    if app.builder.format != "html":
        return
    tool = runpy.run_path(str(HERE.parent / "tools" / "pictures.py"))
    if os.environ.get("NEBOSVOD_PICTURES") != "none":
        tool["main"]()
        return
    for page in tool["PAGES"]:
        for name in tool["pictures_of"](HERE / f"{page}.md"):
            place = tool["MADE"] / name
            place.parent.mkdir(exist_ok=True)
            if not place.exists():
                place.write_bytes((HERE / "report.png").read_bytes())


def setup(app: Any) -> None:
    """Sphinx calls this once."""
    app.connect("builder-inited", _pictures)
    app.connect("source-read", _adapt)
    app.connect("autodoc-process-docstring", _plain, priority=400)  # before napoleon
    app.connect("autodoc-process-docstring", _sentence, priority=600)
