"""Do what a page of the documentation says, and keep the pictures it saves: `docs/made/` for the site.

Run by Sphinx (docs/conf.py), so that a picture on the site is what the code beside it draws today.
"""

import contextlib
import io
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent.parent / "docs"
MADE = DOCS / "made"  # not kept in the repository
PAGES = ("python", "gallery", "tutorial-analyst", "tutorial-defence", "tutorial-student", "cookbook")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PICTURE = re.compile(r"!\[[^\]]*\]\(made/([^)\s]+)\)")
SAVE_AS = re.compile(r"[Ss]ave (?:it|this) as\s+`([\w.-]+)`")


def pictures_of(page: Path) -> list[str]:
    """Names of the pictures that a page shows and that are made."""
    return PICTURE.findall(page.read_text("utf-8"))


def follow(page: Path, folder: Path) -> None:
    """Save the files and run the Python of a page in a folder.

    Raises
    ------
    ValueError
        If Python prints otherwise than the page shows.
    """
    names: dict[str, Any] = {"__name__": "__main__"}
    text, end, printed = page.read_text("utf-8"), 0, ""
    with _inside(folder):
        for fence in FENCE.finditer(text):
            prose, end = text[end : fence.start()], fence.end()
            name = SAVE_AS.search(prose)
            if fence[1] == "yaml" and name:
                Path(name[1]).write_text(fence[2], "utf-8")
            elif fence[1] == "python":
                out = io.StringIO()
                with contextlib.redirect_stdout(out):
                    exec(compile(fence[2], str(page), "exec"), names)
                printed = out.getvalue()
            elif fence[1] == "text" and printed:
                if printed.split() != fence[2].split():
                    raise ValueError(f"{page.name}: Python prints otherwise:\n{printed}")
                printed = ""


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    """Work in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def main(pages: tuple[str, ...] = PAGES) -> None:
    """Every page that has pictures."""
    for name in pages:
        follow(DOCS / f"{name}.md", MADE)


if __name__ == "__main__":
    main(tuple(sys.argv[1:]) or PAGES)
