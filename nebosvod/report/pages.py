"""The page of a folder, by what kind it is."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from nebosvod.results.recognise import read_json

# kind of a summary -> where its page is made, and by what; a run says none
PAGES = {
    "fit": ("nebosvod.report.fit.page", "make_fit_report"),
    "ephemeris": ("nebosvod.report.orbit_pages", "make_ephemeris_page"),
    "approaches": ("nebosvod.report.orbit_pages", "make_approaches_page"),
    "alert": ("nebosvod.report.alert_page", "make_alert_page"),
    "risk": ("nebosvod.report.risk.page", "make_risk_page"),
    None: ("nebosvod.report.run.page", "make_report"),
}


def report_text(folder: Path) -> str:
    """The report of a run folder, by what kind of run it is."""
    kind = read_json(folder / "summary.json").get("kind")
    module, name = PAGES.get(kind if isinstance(kind, str) else None, PAGES[None])
    make: Callable[[Path], str] = getattr(import_module(module), name)
    return make(folder)
