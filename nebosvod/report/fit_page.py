"""The page of a fit: `make_fit_report` reads its run folder and returns one self-contained HTML document."""

from pathlib import Path

from nebosvod.report.base import render
from nebosvod.report.folder import read_folder


def make_fit_report(folder: Path) -> str:
    """Return the report of a fit as HTML; the same folder gives the same bytes.

    Raises
    ------
    InputError
        If the folder is not a run folder or one of its files is damaged; the message names the file.
    """
    run = read_folder(Path(folder))
    return render("fit.html", kind="Orbit fit", title=run.summary["title"], run=run, fit=run.summary["fit"])
