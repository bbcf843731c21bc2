"""The page of a folder, by what kind of run it is."""

from pathlib import Path

from nebosvod.results.recognise import read_json


def report_text(folder: Path) -> str:
    """The report of a run folder, by what kind of run it is."""
    if read_json(folder / "summary.json").get("kind") == "fit":
        from nebosvod.report.fit.page import make_fit_report

        return make_fit_report(folder)
    from nebosvod.report.run.page import make_report

    return make_report(folder)
