"""The page of a fit: `make_fit_report` reads its run folder and returns one self-contained HTML document."""

from pathlib import Path

from markupsafe import Markup

from nebosvod.report.fit import figures as fit_figures
from nebosvod.report.fit import tables as fit_tables
from nebosvod.report.fit import words as fit_words
from nebosvod.report.kit.base import render
from nebosvod.report.kit.stamp import stamp
from nebosvod.report.kit.wording import moment, number, quantity
from nebosvod.report.run.diagnosis import bias_table, residual_table, sentences
from nebosvod.report.run.ellipses import ellipse_plate
from nebosvod.report.run.encounters import encounter_plates
from nebosvod.report.run.geometry import geometry_plate
from nebosvod.report.run.tables import Cell, prediction_table
from nebosvod.report.run.trust import doubtful, nonlinearity_table
from nebosvod.results.ahead_words import ahead_sentences
from nebosvod.results.alert_words import headline as first_hour_words
from nebosvod.results.folder import Item, RunFolder, read_folder
from nebosvod.results.outlook import bent_words


def make_fit_report(folder: Path) -> str:
    """Return the report of a fit as HTML; the same folder gives the same bytes.

    Raises
    ------
    InputError
        If the folder is not a run folder or one of its files is damaged; the message names the file.
    """
    run = read_folder(Path(folder))
    summary, fit, orbit = run.summary, run.summary["fit"], run.summary["orbit"]
    found = [] if orbit is None or orbit["elements"] is None else [fit_figures.correlation_plate(orbit["elements"])]
    station = fit_figures.station_plate(list(fit["stations"]))
    reference = summary["reference_orbit"]
    tone = _tone(run, fit)
    planes, maps = ([], []) if orbit is None else encounter_plates(run, run.estimators[0])
    return render(
        "fit.html",
        kind="Orbit fit",
        stamp=stamp(run.manifest),
        title=summary["title"],
        run=run,
        fit=fit,
        orbit=orbit,
        headline=_headline(fit, orbit),
        tone=tone,
        tiles=_tiles(run, fit, orbit),
        answers=_answers(run, fit, tone),
        warnings=[text for text in summary["warnings"] if "linear ellipse of" not in text],  # said among the answers
        plates={
            "geometry": [] if orbit is None or (drawn := geometry_plate(run)) is None else [drawn],
            "residuals": fit_figures.residual_plates(run),
            "stations": [] if station is None else [station],
            "correlation": found,
            "planes": planes,
            "maps": maps,
            "predictions": [(p, doubt(row)) for row in run.predictions() if (p := ellipse_plate(row)) is not None],
        },
        tables={
            "elements": None if orbit is None else fit_tables.elements(orbit),
            "state": None if orbit is None else fit_tables.state(orbit),
            "parameters": fit_tables.parameters(run.estimators[0], run.telescopes),
            "stations": fit_tables.stations(fit),
            "rejected": fit_tables.rejected(fit),
            "weights": fit_tables.weights(fit),
            "budget": fit_tables.budget(list(summary["budget"]), run.telescopes),
            "predictions": prediction_table(run, run.estimators[0]),
            "nonlinearity": nonlinearity_table(run, run.estimators[0]),
            "reference": None if reference is None else fit_tables.reference(reference),
            "biases": bias_table(run),
            "patterns": residual_table(run),
        },
        diagnosis=sentences(run),
        reference=reference,
    )


def _tone(run: RunFolder, fit: Item) -> str:
    """Green where the orbit and every ellipse can be used as they stand, amber with a caution, red without an orbit."""
    if fit["status"] != "converged":
        return "bad"
    found = fit_words.agreement_of(fit)
    sound = found is None or found.usable
    careful = fit["cautions"] or run.unanswered or doubtful(run, run.estimators[0])
    return "caution" if careful or not sound else "good"


def doubt(prediction: Item) -> Markup | None:
    """Why a linear ellipse is not to be believed; None where it is."""
    bent = prediction.get("nonlinearity") or {}
    if bent.get("misleads"):
        return Markup(
            "<strong>Do not believe this ellipse.</strong> {}: where the object may be is bent or larger than it."
        ).format(_sentence(bent_words(bent["measure"], bent.get("shortest_chord_sigma"))))
    if bent.get("reason"):
        return Markup("<strong>This ellipse may not hold.</strong> {}.").format(_sentence(bent["reason"]))
    return None


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _headline(fit: Item, orbit: Item | None) -> Cell:
    """The answer in one line."""
    if orbit is None or fit["status"] != "converged":
        return f"No orbit to rely on: {str(fit['status']).replace('_', ' ')}"
    return Markup("The position is known to {} (1σ) on {}").format(
        quantity(orbit["sigma_position_km"], "km"), moment(orbit["epoch_tdb"])
    )


def _tiles(run: RunFolder, fit: Item, orbit: Item | None) -> list[tuple[str, Cell]]:
    """The numbers a reader looks for first."""
    tiles: list[tuple[str, Cell]] = [
        ("status", str(fit["status"]).replace("_", " ")),
        ("observations", f"{fit['n_selected']} of {run.summary['n_observations']}"),
        ("arc", fit["arc"]),
        ("rms", quantity(fit["rms_arcsec"], "arcsec")),
    ]
    if orbit is not None:
        tiles.append(("position, 1σ", quantity(orbit["sigma_position_km"], "km")))
        tiles.append(("velocity, 1σ", quantity(orbit["sigma_velocity_m_s"], "m_s")))
    return tiles


def _answers(run: RunFolder, fit: Item, tone: str) -> list[tuple[str, list[Cell]]]:
    """Sentences made from numbers: how accurate, because of what, whether to believe it, what would help."""
    said: list[tuple[str, list[Cell]]] = [("Impact", [*run.impacts])] if run.impacts else []
    if run.unanswered:
        said.append(("What has no answer", [*run.unanswered]))
    if run.summary.get("first_hour") is not None:
        told = run.summary["first_hour"]
        said.append(("What is known all the same", [f"{first_hour_words(told)}.", f"Of the range: {told['message']}."]))
    if run.summary["orbit"] is not None:
        said.append(("How accurate", fit_words.accuracy(run)))
    if run.summary["budget"]:
        said.append(("Because of what", fit_words.contributions(run)))
    said.append(("Can it be believed", fit_words.belief(run, fit, tone)))
    if helps := fit_words.remedies(run):
        said.append(("What would help", helps))
    if run.summary.get("ahead") is not None:
        said.append(("What comes", [f"{text[0].upper()}{text[1:]}." for text in ahead_sentences(run.summary["ahead"])]))
    reference = run.summary["reference_orbit"]
    if reference is not None:
        said.append((f"Against {reference['name']}", [
            Markup("{} apart at {}, chi² {} for 6 degrees of freedom.").format(
                quantity(reference["difference_position_km"], "km"), reference["epoch_tdb"], number(reference["chi2"])
            )
        ]))  # fmt: skip
    return said
