"""What a fit says at first sight: how accurate, because of what, whether to believe it, what would help."""

from markupsafe import Markup

from nebosvod.report.kit import short
from nebosvod.report.kit.facts import grouped
from nebosvod.report.kit.residual_words import brief_words, interval_words
from nebosvod.report.kit.wording import count, date, join, percent, quantity, with_sigma
from nebosvod.report.run.trust import nonlinearity_sentence
from nebosvod.results.agreement import Agreement, agreement
from nebosvod.results.folder import Item, RunFolder

Cell = str | Markup
SHOWN = 3
ELEMENTS = (("a_au", "a", "au"), ("e", "e", ""), ("i_deg", "i", "deg"))


def agreement_of(fit: Item) -> Agreement | None:
    """How the observations agree with their weights."""
    return agreement(fit["chi2"], fit["dof"], int(fit["n_rejected"]))


def accuracy(run: RunFolder) -> list[Cell]:
    """Position and velocity, and the elements a reader compares."""
    orbit = run.summary["orbit"]
    first = Markup("<b>Position</b> {}, velocity {} on {} (1σ, root trace)").format(
        quantity(orbit["sigma_position_km"], "km"), quantity(orbit["sigma_velocity_m_s"], "m_s"),
        date(orbit["epoch_tdb"]),
    )  # fmt: skip
    elements = orbit["elements"]
    every = [
        Markup("{}{}={}{}").format(name, "\N{NO-BREAK SPACE}", "\N{NO-BREAK SPACE}", _with_sigma(elements[key], unit))
        for key, name, unit in ELEMENTS
        if elements is not None and key in elements and elements[key]["sigma"]
    ]
    return [short.as_many(first, every, ", ")]


def _with_sigma(element: Item, unit: str) -> Markup:
    return with_sigma(element["value"], element["sigma"], unit)


def contributions(run: RunFolder) -> list[Cell]:
    """Kinds of error by their part in the variance of the position, and the stations that weigh most."""
    budget = run.summary["budget"]
    kinds = grouped([(row["source"], row["share_position"]) for row in budget], run.telescopes)
    named = join(
        Markup("{} {}").format(kind if n == 1 else f"{kind} ({count(n, 'station')})", percent(share))
        for kind, share, n in kinds[:SHOWN]
    )
    text = Markup("Error contributions to the variance of the position: {}").format(named)
    single = [row for row in sorted(budget, key=lambda row: -row["share_position"]) if row["share_position"] >= 0.01]
    few = [Markup("{} {}").format(row["source"], percent(row["share_position"])) for row in single[:SHOWN]]
    if kinds[0][2] == 1 or not few:
        return [text + "."]
    full = [Markup("{}; the largest: {}.").format(text, join(few[:n])) for n in range(len(few), 0, -1)]
    shown = short.first_that_fits(*full, text + ".")
    return [shown] if shown == full[0] else [shown, full[0]]


def belief(run: RunFolder, fit: Item, tone: str) -> list[Cell]:
    """Whether observations agree with their weights, whether ellipses are linear, how the fit ended."""
    found = agreement_of(fit)
    grounds: list[Cell] = [] if found is None else [brief_words(found)]
    bent = nonlinearity_sentence(run, run.estimators[0]) if run.predictions() else None
    rejected = int(fit["n_rejected"])
    if rejected:
        grounds.append(f"{rejected} of {count(run.summary['n_observations'], 'observation')} rejected")
    if any((p.get("nonlinearity") or {}).get("misleads") for p in run.predictions()):
        grounds.append("a linear ellipse misleads")
    if fit["cautions"]:
        grounds.append("read the warnings" if len(fit["cautions"]) > 1 else "read the warning")
    status = str(fit["status"]).replace("_", " ")
    head = {"good": "Yes, as far as the weights hold", "caution": "With caution", "bad": f"No: {status}"}[tone]
    first = Markup("<b>{}</b>").format(head)
    told: list[Cell] = [short.as_many(first + ": " + grounds[0], grounds[1:]) if grounds else first + "."]
    if found is not None:
        told.append(interval_words(found, int(fit["dof"])))
        if found.where == "below":
            told.append("Look at the means by station.")
    if rejected:
        told.append("Each rejected observation stands with its chi in the table below.")
    told += [bent] if bent is not None else []
    return [*told, fit["message"], f"The orbit started from {fit['start']}."]


def remedies(run: RunFolder) -> list[Cell]:
    """Which source, halved, would help most, the weights staying as they are."""
    orbit, key = run.summary["orbit"], "sigma_position_km_same_gain"
    known = [row for row in run.summary["budget"] if (row.get("if_halved") or {}).get(key) is not None]
    if orbit is None or not known:
        return []
    best = min(known, key=lambda row: row["if_halved"][key])
    left, now = best["if_halved"][key], orbit["sigma_position_km"]
    told: list[Cell] = []
    if left < 0.999 * now:
        told.append(Markup("Halving the error of {} brings the position from {} to {}, weights as they are.").format(
            best["source"], quantity(now, "km"), quantity(left, "km")))  # fmt: skip
    told.append(
        Markup("Where to look for it next, and how well that is known: <code>nebosvod ephemeris FOLDER</code>.")
    )
    return told
