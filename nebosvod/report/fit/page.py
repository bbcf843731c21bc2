"""The page of a fit: `make_fit_report` reads its run folder and returns one self-contained HTML document."""

from pathlib import Path

from markupsafe import Markup

from nebosvod.report.fit import figures as fit_figures
from nebosvod.report.fit import tables as fit_tables
from nebosvod.report.kit.base import render
from nebosvod.report.kit.facts import grouped
from nebosvod.report.kit.stamp import stamp
from nebosvod.report.kit.wording import count, join, moment, number, quantity
from nebosvod.report.run.diagnosis import bias_table, residual_table, sentences
from nebosvod.report.run.ellipses import ellipse_plate
from nebosvod.report.run.encounters import encounter_plates
from nebosvod.report.run.tables import Cell, prediction_table
from nebosvod.report.run.trust import doubtful, nonlinearity_sentence, nonlinearity_table
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
        tone=_tone(run, fit),
        tiles=_tiles(run, fit, orbit),
        answers=_answers(run, fit),
        warnings=[text for text in summary["warnings"] if "linear ellipse of" not in text],  # said among the answers
        plates={
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
    return "caution" if fit["cautions"] or run.unanswered or doubtful(run, run.estimators[0]) else "good"


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


def _rejected(n: int) -> str:
    """How many observations were rejected."""
    return f"{count(n, 'observation')} {'was rejected,' if n == 1 else 'were rejected, each'} with its chi below."


def _largest(budget: list[Item], n: int) -> str:
    """Which single sources weigh most, where the kind named first has several."""
    if n == 1:
        return ""
    few = [row for row in sorted(budget, key=lambda row: -row["share_position"]) if row["share_position"] >= 0.01][:3]
    named = join(f"{row['source']} {100.0 * row['share_position']:.0f} %" for row in few)
    return f"; the largest: {named}" if few else ""


def _of_stations(kind: str, n: int) -> str:
    """`bias (60 stations)`."""
    return f"{kind} ({count(n, 'station')})"


def _answers(run: RunFolder, fit: Item) -> list[tuple[str, list[Cell]]]:
    """Sentences made from numbers: how it ended, how well it agrees, what is to blame."""
    said: list[tuple[str, list[Cell]]] = [("Impact", [*run.impacts])] if run.impacts else []
    said.append(("How it ended", [fit["message"], f"The orbit started from {fit['start']}."]))
    if run.summary.get("first_hour") is not None:
        told = run.summary["first_hour"]
        said.append(("What is known all the same", [f"{first_hour_words(told)}.", f"Of the range: {told['message']}."]))
    if run.summary.get("ahead") is not None:
        said.append(("What comes", [f"{text[0].upper()}{text[1:]}." for text in ahead_sentences(run.summary["ahead"])]))
    if run.unanswered:
        said.append(("What has no answer", [*run.unanswered]))
    reduced = fit["reduced_chi2"]
    agree: list[Cell] = [
        Markup("chi² {} for {}").format(number(fit["chi2"], 4), count(fit["dof"], "degree") + " of freedom")
        + ("." if reduced is None else f", {reduced:.2f} for each.")
    ]
    if reduced is not None and reduced < 0.6:
        agree.append(
            "The observations scatter less than their weights allow for. That alone does not make the sigmas careful: "
            "what a station has in common in all its observations does not show in it. Look at the means by station."
        )
    if reduced is not None and reduced > 1.5:
        agree.append("The observations scatter more than their weights say: the sigmas below are too small.")
    if fit["n_rejected"]:
        agree.append(_rejected(int(fit["n_rejected"])))
    said.append(("How well the observations agree", agree))
    budget = run.summary["budget"]
    if budget:
        kinds = grouped([(row["source"], row["share_position"]) for row in budget], run.telescopes)
        text = join(
            f"{kind if n == 1 else _of_stations(kind, n)} {100.0 * share:.0f} %" for kind, share, n in kinds[:3]
        )
        said.append(
            (
                "What is to blame for the position sigma",
                [Markup("{} of its variance{}.").format(text, _largest(budget, kinds[0][2]))],
            )
        )
    bent = nonlinearity_sentence(run, run.estimators[0]) if run.predictions() else None
    if bent is not None:
        said.append(("Can the ellipses be believed", [bent]))
    reference = run.summary["reference_orbit"]
    if reference is not None:
        said.append((f"Against {reference['name']}", [
            Markup("{} apart at {}, chi² {} for 6 degrees of freedom.").format(
                quantity(reference["difference_position_km"], "km"), reference["epoch_tdb"], number(reference["chi2"])
            )
        ]))  # fmt: skip
    return said
