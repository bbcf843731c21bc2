"""The documentation as a site: Sphinx, MyST and the furo theme. Build it with `make docs`."""

import re
from importlib.metadata import version as installed
from typing import Any

project = "nebosvod"
author = "the nebosvod developers"
copyright = "the nebosvod developers"
version = release = installed("nebosvod")

extensions = ["myst_parser"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
myst_fence_as_directive = ["math"]
source_suffix = {".md": "markdown"}
root_doc = "index"
exclude_patterns = ["site"]

html_theme = "furo"
html_title = f"nebosvod {version}"
html_theme_options = {"source_repository": "", "top_of_page_buttons": []}
html_copy_source = False
html_show_sphinx = False


def _adapt(app: Any, name: str, source: list[str]) -> None:
    """Fit a page, written to be read as a plain file as well, into the site.

    Links to files beside the documentation lead nowhere on the site and become text; the navigation is made from the
    list that the index page shows its readers, so that there is one list, not two.
    """
    source[0] = re.sub(r"(?<!!)\[([^\]]*)\]\(\.\./[^)]*\)", r"\1", source[0])
    if name == root_doc:
        pages = re.findall(r"\]\((\w[\w-]*)\.md\)", source[0])
        source[0] += "\n".join(["\n\n```{toctree}", ":hidden:", *pages, "```", ""])


def setup(app: Any) -> None:
    """Sphinx calls this once."""
    app.connect("source-read", _adapt)
