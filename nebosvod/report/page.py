"""The page: `make_report` reads a run folder and returns one self-contained HTML document."""

from collections.abc import Callable
from pathlib import Path

from markupsafe import Markup

from nebosvod.report import ellipses, figures, geometry, physical, tables, wording
from nebosvod.report.base import render
from nebosvod.report.folder import Item, RunFolder, read_folder
from nebosvod.report.plate import Plate, style
from nebosvod.report.verdict import (
    formal_ratio,
    grouped,
    leading,
    object_name,
    of_telescopes,
    position_shares,
    size,
    verdict,
    warnings,
)
from nebosvod.report.wording import percent, quantity


def make_report(folder: Path) -> str:
    """Return the accuracy report of a run folder as HTML.

    The page holds its style and its figures, fetches nothing, and depends on the folder alone: the same folder gives
    the same bytes.

    Parameters
    ----------
    folder : a run folder with manifest.json, summary.json and (unless the run ended early) arrays.npz.

    Raises
    ------
    InputError
        If the folder is not a run folder or one of its files is damaged; the message names the file.
    """
    run = read_folder(Path(folder))
    main = run.main
    words = verdict(run)
    return render(
        "report.html",
        kind="Accuracy report",
        run=run,
        object_name=object_name(run),
        title=run.summary.get("title") or run.summary["mission"],
        words=words,
        main=main,
        tiles=_tiles(run, main),
        warnings=warnings(run),
        plates=_plates(run, main),
        tables=_tables(run, main),
        kappa=physical.kappa_sentence(run, main) if main else None,
        bars=tables.budget_bars(run, main["name"]) if main else [],
        mission_text=tables.mission_text(run),
    )


def _tiles(run: RunFolder, main: Item | None) -> list[tuple[str, Markup]]:
    """The headline numbers: what it is, and the number."""
    if main is None:
        return []
    tiles = [
        ("position, 1σ", quantity(main["sigma_position_km"], "km")),
        ("velocity, 1σ", quantity(main["sigma_velocity_m_s"], "m_s")),
    ]
    for p in leading(run, main)[:2]:
        tiles.append((f"{p['name']}: {wording.plane_name(p['plane'], p.get('body'))}, 1σ", size(p)))
    shares = position_shares(run, main)
    if shares:
        kind, share, n = grouped(shares, run.telescopes)[0]
        tiles.append((f"of the position variance: {of_telescopes(kind, n)}", percent(share)))
    ratio = formal_ratio(main)
    if ratio is not None:
        tiles.append(("true / formal position sigma", quantity(ratio, "", 4)))
    return tiles


def _plates(run: RunFolder, main: Item | None) -> dict[str, list[Plate]]:
    """All figures of the run by section of the page."""
    makers: dict[str, list[Callable[[], Plate | None]]] = {
        "history": [lambda: figures.sigma_over_time(run)],
        "geometry": [lambda: geometry.plan_view(run), lambda: geometry.viewing(run)],
        "nuisance": [lambda: figures.noise_to_nuisance(run)],
        "residuals": [lambda: figures.residuals(run, main)] if main else [],
    }
    with style():
        drawn = {section: [p for p in (make() for make in of) if p is not None] for section, of in makers.items()}
        drawn["prediction"] = ellipses.prediction_plates(run, main) if main else []
    return drawn


def _tables(run: RunFolder, main: Item | None) -> dict[str, tables.Table | None]:
    """All tables of the run by name."""
    return {
        "predictions": tables.prediction_table(run, main) if main else None,
        "prediction_comparison": tables.prediction_comparison(run),
        "prediction_budget": tables.budget_of_predictions(run, main) if main else None,
        "estimators": tables.estimator_table(run),
        "parameters": physical.parameter_table(main) if main else None,
        "state": tables.state_table(run, main) if main else None,
        "visibility": tables.visibility_table(run),
        "limits": tables.limit_table(run),
        "physics": tables.physics_table(run),
        "provenance": tables.provenance_table(run),
    }
