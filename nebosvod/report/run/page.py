"""The page: `make_report` reads a run folder and returns one self-contained HTML document."""

from pathlib import Path

from nebosvod.report.kit import hatch
from nebosvod.report.kit.base import render
from nebosvod.report.kit.facts import object_name
from nebosvod.report.kit.plate import Plate
from nebosvod.report.kit.stamp import stamp
from nebosvod.report.run import (
    advice,
    curves,
    diagnosis,
    ellipses,
    encounters,
    figures,
    filters,
    geometry,
    ledger,
    physical,
    sources,
    tables,
    timeline,
    trust,
    viewing,
    visibility,
    what_if,
)
from nebosvod.report.run.verdict import Verdict, verdict, warnings
from nebosvod.results.folder import Item, RunFolder, read_folder


def make_report(folder: Path) -> str:
    """Return the accuracy report of a run folder as HTML.

    The page holds its style, script and figures, fetches nothing, and depends on the folder alone: the same folder
    gives the same bytes.

    Parameters
    ----------
    folder : a run folder with manifest.json, summary.json and (unless the run ended early) arrays.npz and tables.

    Raises
    ------
    InputError
        If the folder is not a run folder or one of its files is damaged; the message names the file.
    """
    run = read_folder(Path(folder))
    main = run.main
    books = ledger.ledgers(run, main) if main else []
    compared, accuracies = trust.five(run, main) if main else ("", [])
    pictures = _pictures(run, main, visibility.read_visibility(Path(folder)))
    asked = what_if.sliders(run, main)
    return render(
        "report.html",
        kind="Accuracy report",
        stamp=stamp(run.manifest),
        run=run,
        object_name=object_name(run),
        title=run.summary.get("title") or run.summary["mission"],
        words=_verdict(run, main),
        main=main,
        warnings=warnings(run),
        books=books,
        hatches=hatch.patterns() if books else "",
        looks={e.source: sources.look(e.source, run.telescopes, e.behind) for book in books for e in book.entries},
        compared=compared,
        accuracies=accuracies,
        pictures=pictures,
        plates=_plates(run, main, books, {plate.key for group in pictures for plate in group}),
        tables=_tables(run, main),
        kappa=physical.kappa_sentence(run, main) if main else None,
        helps=[s for s in (advice.plan_sentence(run),) if s],
        mission_text=tables.mission_text(run),
        diagnosis=diagnosis.sentences(run),
        what_if=asked,
        scripts=("what_if.js",) if asked else (),
    )


def _verdict(run: RunFolder, main: Item | None) -> Verdict:
    """The answer in words, with what the other modules know of trust and advice."""
    if main is None:
        return verdict(run)
    told = [f(run, main) for f in (trust.consistency_sentence, trust.nonlinearity_sentence, trust.worst_sentence)]
    helps = [advice.remedy_sentence(run, main), advice.required_sentence(run, 10.0), advice.plan_sentence(run)]
    return verdict(run, told, helps, sound=not trust.doubtful(run, main), brief_advice=advice.brief_sentence(run, main))


def _pictures(run: RunFolder, main: Item | None, columns: visibility.Columns | None) -> list[list[Plate]]:
    """What a reader sees before reading: where everything was, what is aimed at, how it came; each with its kind."""
    planes, maps = encounters.encounter_plates(run, main) if main else ([], [])
    if main and not planes and not maps:  # nothing to aim at: where the first prediction has it
        planes = ellipses.prediction_plates(run, main)[:1]
    groups: list[list[Plate | None]] = [
        [geometry.geometry_plate(run)], [*planes], [*maps], [timeline.timeline_plate(run, columns)],
    ]  # fmt: skip
    kept = [[plate for plate in group if plate is not None] for group in groups]
    return [group for group in kept if group]


def _plates(run: RunFolder, main: Item | None, books: list[ledger.Ledger], shown: set[str]) -> dict[str, list[Plate]]:
    """All figures of the run by section of the page, but those that are shown already."""
    of_main = main is not None
    made: dict[str, list[Plate | None]] = {
        "prediction": [*ellipses.prediction_plates(run, main)] if main else [],
        "budget": [ledger.shares_plate(run, books), ledger.remedies_plate(run, books[0])] if books else [],
        "trust": [trust.comparison_plate(run, main)] if main else [],
        "required": [advice.required_plate(run)] if of_main else [],
        "nuisance": [figures.noise_to_nuisance(run)],
        "curves": [*curves.curve_plates(run)] if of_main else [],
        "power": [diagnosis.power_plate(run)] if of_main else [],
        "history": [figures.sigma_over_time(run), *filters.filter_plates(run)],
        "viewing": [viewing.viewing(run)],
        "residuals": [figures.residuals(run, main)] if main else [],
    }
    return {section: [p for p in plates if p is not None and p.key not in shown] for section, plates in made.items()}


def _tables(run: RunFolder, main: Item | None) -> dict[str, tables.Table | None]:
    """All tables of the run by name."""
    every: dict[str, tables.Table | None] = {
        "prediction_comparison": tables.prediction_comparison(run),
        "consistency": trust.consistency_table(run),
        "estimators": tables.estimator_table(run),
        "required": advice.required_table(run),
        "limits": advice.limit_table(run),
        "slopes": curves.slope_table(run),
        "biases": diagnosis.bias_table(run),
        "patterns": diagnosis.residual_table(run),
        "visibility": tables.visibility_table(run),
        "inside": tables.inside_table(run),
        "physics": tables.physics_table(run),
        "provenance": tables.provenance_table(run),
    }
    alone = (
        "predictions",
        "shifts",
        "facts",
        "components",
        "accuracies",
        "nonlinearity",
        "parameters",
        "blame",
        "state",
    )
    if main is None:
        return every | dict.fromkeys(alone)
    return every | {
        "predictions": tables.prediction_table(run, main),
        "facts": tables.fact_table(run, main),
        "shifts": tables.shift_table(run, main),
        "components": tables.budget_of_predictions(run, main),
        "accuracies": trust.comparison_table(run, main),
        "nonlinearity": trust.nonlinearity_table(run, main),
        "parameters": physical.parameter_table(main),
        "blame": tables.budget_of_parameters(run, main),
        "state": tables.state_table(run, main),
    }
