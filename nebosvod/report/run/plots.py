"""The pictures of a run as figures of matplotlib, without a page: for scripts and notebooks.

Each takes what `nebosvod.run` returns, or a folder read back; the figure belongs to the caller.
"""

from matplotlib.figure import Figure

from nebosvod.errors import InputError
from nebosvod.report.kit.facts import leading
from nebosvod.report.kit.target import target_chart
from nebosvod.report.run import encounters, geometry, ledger, timeline
from nebosvod.report.run.visibility import Columns
from nebosvod.results.folder import Item, RunFolder
from nebosvod.results.result import Result

NOTHING = "there is nothing to draw:"


def as_folder(result: Result) -> RunFolder:
    """A result as the report reads it."""
    return RunFolder(manifest=result.manifest, summary=result.summary, arrays=result.arrays)


def geometry_figure(result: Result) -> Figure:
    """Sun, orbits, telescopes and encounter from above and from the side.

    Raises
    ------
    InputError
        If the run has no measurement.
    """
    chart = geometry.geometry_chart(as_folder(result))
    if chart is None:
        raise InputError(f"{NOTHING} the run has no measurement")
    return chart.drawing()


def timeline_figure(result: Result) -> Figure:
    """What each telescope saw, magnitude, distance, and sigma of the predictions as measurements come in.

    Raises
    ------
    InputError
        If the run has no measurements at different times.
    """
    chart = timeline.timeline_chart(as_folder(result), _columns(result))
    if chart is None:
        raise InputError(f"{NOTHING} the run has no measurements at different times")
    return chart.drawing()


def target_plane_figure(result: Result, prediction: str | None = None) -> Figure:
    """The target plane of an encounter with the body to scale; of the first one that is predicted, or of one by name.

    Raises
    ------
    InputError
        If there is no such prediction.
    """
    run = as_folder(result)
    for p in _mine(run):
        view = encounters.target_view(run, p) if prediction in (None, p["name"]) else None
        if view is not None:
            return target_chart("target", view).drawing()
    raise InputError(f"{NOTHING} {_asked(run, prediction)} has a target plane (plane: b_plane or mtp)")


def budget_figure(result: Result, prediction: str | None = None) -> Figure:
    """The share of each source in the variance of every prediction and of the orbit, or of one prediction by name.

    Raises
    ------
    InputError
        If no estimator converged, or there is no such prediction.
    """
    run = as_folder(result)
    books = ledger.ledgers(run, run.main) if run.main else []
    books = [book for book in books if prediction in (None, book.title)]
    chart = ledger.shares_chart(run, books)
    if chart is None:
        raise InputError(f"{NOTHING} {_asked(run, prediction)} has an error budget")
    return chart.drawing()


def _mine(run: RunFolder) -> list[Item]:
    return leading(run, run.main) if run.main else []


def _asked(run: RunFolder, prediction: str | None) -> str:
    names = ", ".join(p["name"] for p in _mine(run)) or "none"
    return "no prediction" if prediction is None else f'no prediction named "{prediction}" (there are: {names})'


def _columns(result: Result) -> Columns | None:
    """The table of scheduled exposures as text; None where the run has none."""
    table = result.tables.get("visibility")
    return None if table is None else {name: [str(v) for v in values] for name, values in table.columns.items()}
