"""report.pdf: the page printed by a Chromium of the machine, headless.

The page is styled for paper already and its figures are SVG: the browser that shows it best also prints it best, and
text stays text. A library that renders HTML (weasyprint) would bring Pango and six packages, opens no closed <details>,
and would be a second rendering of every page to be looked at.
"""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from nebosvod.borders.wholefile import write_whole
from nebosvod.errors import OutputError

NAMES = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge", "msedge",
    "brave-browser",
)  # fmt: skip
VARIABLE = "NEBOSVOD_BROWSER"
PATIENCE_S = 120.0


def browser() -> str | None:
    """The program that prints: the one the environment names, else the first Chromium on the path."""
    named = os.environ.get(VARIABLE)
    found = [shutil.which(named)] if named else [shutil.which(name) for name in NAMES]
    return next((path for path in found if path), None)


def print_pdf(page: Path, target: Path) -> None:
    """Print an HTML page of ours to a PDF file; the file appears whole or not at all.

    Raises
    ------
    OutputError
        If there is no Chromium, or it fails, or the place cannot be written; says what to do instead.
    """
    program = browser()
    if program is None:
        named = os.environ.get(VARIABLE)
        said = f"{VARIABLE}={named} is no program" if named else f"no Chromium found ({', '.join(NAMES[:3])}, ...)"
        raise OutputError(
            f"{target}: {said}; install Chromium or Chrome, or name one in {VARIABLE}, or open {page} in any "
            "browser and print it to PDF"
        )
    root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []  # Chromium refuses root otherwise
    with tempfile.TemporaryDirectory(prefix="nebosvod-print-") as scratch:
        made = Path(scratch) / "page.pdf"
        arguments = [
            program, "--headless", *root, "--disable-gpu", "--no-first-run", "--disable-background-networking",
            "--disable-component-update", "--disable-extensions", "--disable-sync",
            f"--user-data-dir={scratch}/profile",
            "--no-pdf-header-footer", f"--print-to-pdf={made}", page.absolute().as_uri(),
        ]  # fmt: skip
        try:
            done = subprocess.run(arguments, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OutputError(
                f"{target}: {program} could not print: {error}; open {page} and print it to PDF"
            ) from None
        if done.returncode or not made.is_file() or made.read_bytes()[:5] != b"%PDF-":
            last = (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
            raise OutputError(f"{target}: {program} could not print: {last}; open {page} and print it to PDF")
        write_whole(target, made.read_bytes())
