"""The answer in sentences. Each is made from numbers of the run, and left out where the run has no such number."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup, escape

from nebosvod.report.kit import short, wording
from nebosvod.report.kit.facts import (
    LEADING,
    earlier_orbit,
    formal_ratio,
    grouped,
    impact_clause,
    leading,
    object_name,
    of_telescopes,
    position_shares,
    size,
    total_sigma,
    when,
)
from nebosvod.report.kit.residual_words import interval_words
from nebosvod.report.kit.wording import count, join, percent, product, quantity, series
from nebosvod.report.run import brief
from nebosvod.report.run.brief import AGREE, HELD_AT_3_SIGMA
from nebosvod.results.folder import Item, RunFolder
from nebosvod.results.outlook import unit_of

BASIS = {
    True: ", from these measurements and an earlier orbit, the mission's prior",
    False: ", from these measurements alone; no earlier orbit was used",
    None: "",
}
NOTHING = 1e-6  # of a total sigma
SQUARES = {2: "both", 3: "the three"}  # semi-axes by dimension, in the words that define a total sigma
NEAR = 0.8  # of the largest share, from which on a source is named beside it


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What stands at the top of the page: one headline, sentences by question, and whether the run may be trusted.

    `tone` is "good", "caution" (an answer, but formal and true accuracy differ or the fit is odd) or "bad" (no answer).
    """

    headline: Markup
    answers: tuple[tuple[str, tuple[Markup, ...]], ...]
    tone: str

    @property
    def sentences(self) -> tuple[Markup, ...]:
        """All sentences in order."""
        return tuple(sentence for _, told in self.answers for sentence in told)


def verdict(
    run: RunFolder, trust: Sequence[Markup | None] = (), advice: Sequence[Markup | None] = (), sound: bool = True,
    brief_advice: Markup | None = None,
) -> Verdict:  # fmt: skip
    """Say what the run found; the first sentence under each question is the answer, the others are its reasons.

    Parameters
    ----------
    trust, advice : further sentences on whether it may be believed and on what would help; None is left out.
    sound : False when one of `trust` is a warning.
    brief_advice : what would help, in a line or two.
    """
    main = run.main
    if main is None:
        return Verdict(headline=_no_answer(run), answers=(("Why", tuple(_failures(run))),), tone="bad")
    own, honest = _trust(main)
    off = _mean_error(main)
    fit, fits = _fit(run, main)
    others = [_trust(e)[0] for e in run.estimators if _misleads(e) and not _alike(e, main)]
    every = all(e["status"] == "converged" for e in run.estimators)
    good = honest and off is None and fits and every and sound and not run.unanswered
    why = [own, off, *trust, *others, fit, *_failures(run), _agreement(run, main)]
    asked: list[tuple[str, list[Markup | None]]] = [
        ("Impact", [escape(text) for text in run.impacts]),
        ("What has no answer", [escape(text) for text in run.unanswered]),
        ("How accurate", [brief.accuracy(run, main), *_predictions(run, main), _orbit(run, main)]),
        ("Because of what", [brief.contributions(run, main), *_blame(run, main)]),
        ("Can it be believed", [brief.belief(run, main, good), *why]),
        ("What would help", [brief_advice, *advice]),
    ]
    answers = [(title, tuple(s for s in told if s)) for title, told in asked]
    return Verdict(
        headline=_headline(run, main),
        answers=tuple((title, told) for title, told in answers if told),
        tone="good" if good else "caution",
    )


def _headline(run: RunFolder, main: Item) -> Markup:
    """The main prediction (or the position) and the largest source, in one line."""
    predictions = leading(run, main)
    if predictions:
        first = predictions[0]
        where = wording.plane_name(first["plane"], first.get("body"))
        what = Markup("{} on {}: {} at 1σ").format(_capital(where), wording.date(when(first)), size(first))
        plain = Markup("{}.").format(what)
        if (first.get("nonlinearity") or {}).get("misleads"):
            plain = Markup("The linear ellipse misleads here: {}.").format(what)
            what = Markup("{} by the linear ellipse, which misleads here").format(what)
        shares = [(row["source"], row["share_total"]) for row in first.get("budget") or []]
    else:
        what = Markup("Position known to {} at 1σ").format(quantity(main["sigma_position_km"], "km"))
        plain = Markup("{}.").format(what)
        shares = position_shares(run, main)
    if not shares:
        return Markup("{}.").format(what)
    whole = Markup("{}; {}.").format(what, blame_of(shares, run.telescopes, "that variance"))
    kinds = grouped(shares, run.telescopes)
    named = join(
        Markup("{} {}").format(kind, percent(share)) for kind, share, _ in kinds if share >= NEAR * kinds[0][1]
    )
    shorter = Markup("{}; {} of that variance.").format(what, named)
    return short.first_that_fits(
        whole, shorter, Markup("{}.").format(what), plain, wide_px=short.HEADLINE_PX, look=short.HEADLINE
    )


def blame_of(shares: list[tuple[str, float]], telescopes: list[str], what: str) -> Markup:
    """`bias makes up 62 % of the variance`; sources that nearly tie with the largest are named with it."""
    kinds = grouped(shares, telescopes)
    top = [one for one in kinds if one[1] >= NEAR * kinds[0][1]]
    if len(top) == 1:
        kind, share, n = top[0]
        return Markup("{} makes up {} of {}").format(of_telescopes(kind, n), percent(share), what)
    named = join(Markup("{} ({})").format(kind, percent(share)) for kind, share, _ in top)
    return Markup("{} are about equally to blame for {}").format(named, what)


def _orbit(run: RunFolder, main: Item) -> Markup:
    """Position and velocity of the state at the reference epoch, and what they rest on."""
    n = int(run.summary["n_observations"])
    t = run.array("epoch_s")
    span = (
        Markup(" over {} days").format(wording.number(float(t.max() - t.min()) / 86400.0))
        if t is not None and len(t) > 1
        else ""
    )
    seed = run.manifest.get("seed")
    made = "" if seed is None else f" simulated (seed {seed}: one truth drawn about the mission's nominal values)"
    if not run.manifest.get("drawn", True):
        made = " simulated (no error drawn, about the reference orbit itself)"
    return Markup(
        "At {}, {}{} of {}{} give the heliocentric position of {} to {} and its velocity to {} (1σ, root trace){}."
    ).format(
        wording.moment(run.summary["reference_epoch_tdb"]),
        count(n, "measurement"),
        made,
        join(run.telescopes),
        span,
        object_name(run),
        quantity(main["sigma_position_km"], "km"),
        quantity(main["sigma_velocity_m_s"], "m_s"),
        BASIS[earlier_orbit(run.summary, main["name"])],
    )


def _predictions(run: RunFolder, main: Item) -> list[Markup]:
    """One sentence for each prediction at an encounter (the first if there is none): 1 sigma, 3 sigma, impact."""
    every = leading(run, main)
    told = [p for p in every if p["plane"] in LEADING] or every[:1]
    sentences = []
    for p in told:
        unit = unit_of(p)
        axes = p[f"semi_axes_{unit}"]
        what = ["", "", "semi-axes of the ellipse ", "semi-axes of the ellipsoid "][min(len(axes), 3)]
        text = Markup("<b>{}</b> ({}, {}): {}{} at 1σ, {} at 3σ ({}{}%).").format(
            _capital(p["name"]), wording.plane_name(p["plane"], p.get("body")), wording.moment(when(p)), what,
            size(p), product([3.0 * a for a in axes], unit, like=max(axes)),
            HELD_AT_3_SIGMA.get(len(axes), ""), wording.NBSP,
        )  # fmt: skip
        sentences.append(text + impact_clause(p))
    return sentences


def _blame(run: RunFolder, main: Item) -> list[Markup]:
    """Which uncertainty costs how much: of the leading prediction, and of the orbit."""
    sentences = []
    predictions = leading(run, main)
    if predictions and predictions[0].get("budget"):
        first = predictions[0]
        rows = sorted(first["budget"], key=lambda row: -row["share_total"])
        listed = join(Markup("{} {}").format(row["source"], percent(row["share_total"])) for row in rows[:4])
        sentences.append(Markup("Variance of {}: {}.").format(first["name"], listed))
        # a prior of the whole orbit, known exactly, leaves nothing: that says nothing
        known = [row for row in rows if (_remaining(row) or 0.0) > NOTHING * total_sigma(first)]
        if known:
            best = min(known, key=lambda row: _remaining(row) or 0.0)
            unit = unit_of(first)
            axes = SQUARES.get(len(first[f"semi_axes_{unit}"]))
            meaning = f" (the root of the sum of {axes} semi-axes squared)" if axes else ""
            ideal = "{} known exactly" if best.get("if_unknown") else "the error of {} to vanish"
            sentences.append(
                Markup(
                    "Were " + ideal + " and the estimator told so, its total sigma would be {} instead of {}{}{}."
                ).format(
                    best["source"],
                    quantity(_remaining(best), unit),
                    quantity(total_sigma(first), unit),
                    meaning,
                    _unknown(best, unit),
                )
            )
    rows = run.budget(main["name"])
    if rows:
        kinds = grouped(position_shares(run, main), run.telescopes)
        sums = join(Markup("{} {}").format(of_telescopes(kind, n), percent(share)) for kind, share, n in kinds[:3])
        small = [kind for kind, share, _ in kinds if share < 0.001]
        rest = Markup("; {} less than 0.1{}% each").format(join(small), wording.NBSP) if len(small) > 1 else ""
        sentences.append(Markup("Position variance at the reference epoch: {}{}.").format(sums, rest))
    return sentences


def _unknown(row: Item, unit: str) -> Markup:
    """The opposite of a prior that is known exactly: nothing known beforehand; empty where the source is no prior."""
    then = row.get("if_unknown")
    if not then:
        return Markup("")
    total = next((v for k, v in then.items() if k.startswith("sigma_total_")), None)
    known = "would not be determined" if total is None else Markup("would be {}").format(quantity(total, unit))
    return Markup("; were nothing known of it beforehand, it {}").format(known)


def _remaining(row: Item) -> float | None:
    """Total sigma of a prediction without one source, the gain re-optimised."""
    then = row.get("if_vanished") or {}
    return next((v for k, v in then.items() if k.startswith("sigma_total_") and k.endswith("_new_gain")), None)


def _misleads(estimator: Item) -> bool:
    """True for an estimator whose formal position sigma is not the true one."""
    ratio = formal_ratio(estimator)
    return ratio is not None and abs(ratio - 1.0) >= AGREE


def _alike(estimator: Item, main: Item) -> bool:
    """True where the main estimator's sentence says it all: the same true and formal sigma."""
    keys = ("sigma_position_km", "sigma_formal_position_km")
    return all(math.isclose(estimator.get(k) or 0.0, main.get(k) or 0.0, rel_tol=AGREE) for k in keys)


def _trust(main: Item) -> tuple[Markup | None, bool]:
    """Whether the estimator's own sigma is the true one, and why not."""
    ratio = formal_ratio(main)
    if ratio is None:
        return None, True
    if not _misleads(main):
        text = Markup(
            "The sigma that the estimator “{}” reports can be believed under the mission's error "
            "model: true over formal is {}."
        ).format(main["name"], quantity(ratio, "", 4))
        return text, True
    left_out = [group for group, how in main.get("treatment", {}).items() if how in ("ignored", "considered")]
    reason = Markup(" {} {} left out of its weights.").format(
        _capital(join(left_out)), "is" if len(left_out) == 1 else "are"
    ) if left_out else ""  # fmt: skip
    believed = quantity(main["sigma_formal_position_km"], "km")
    small = Markup("{} times too small").format(wording.number(ratio))
    large = Markup("{} times too large").format(wording.number(1 / ratio))
    return Markup("The estimator “{}” reports {} where the true sigma is {}: its formal sigma is {}.{}").format(
        main["name"], believed, quantity(main["sigma_position_km"], "km"), small if ratio > 1 else large, reason
    ), False


def _mean_error(main: Item) -> Markup | None:
    """How far the estimate is off on average, where what is left out has a mean error; None where it has none."""
    mean = main.get("mean_error_km_km_s") or []
    if not any(mean):
        return None
    return Markup(
        "What the estimator “{}” leaves out has a mean error ({}): its estimate is off on average by {} on the axes of "
        "the ICRF at the reference epoch. Sigmas and ellipses are about that mean; the largest deviations hold both."
    ).format(main["name"], join(main["mean_error_by_source_km_km_s"]), series(mean[:3], "km"))


def _fit(run: RunFolder, main: Item) -> tuple[Markup | None, bool]:
    """chi2 per degree of freedom against its 99 % interval."""
    found = brief.residuals_of(run, main)
    return (None, True) if found is None else (interval_words(found, int(main["dof"])), found.where == "inside")


def _agreement(run: RunFolder, main: Item) -> Markup | None:
    """How far the converged estimators differ in position sigma."""
    others = [e for e in run.estimators if e["status"] == "converged" and e.get("sigma_position_km")]
    if len(others) < 2:
        return None
    best = min(others, key=lambda e: e["sigma_position_km"])
    worst = max(others, key=lambda e: e["sigma_position_km"])
    spread = worst["sigma_position_km"] / best["sigma_position_km"] - 1.0
    names = join(f"“{e['name']}”" for e in others)
    if spread < AGREE:
        digits = max(2, round(-math.log10(spread)) if spread > 0 else 15)
        return Markup("{} give the same position sigma (to 1 part in 10{}).").format(
            names, str(min(digits, 15)).translate(wording.SUPERSCRIPT)
        )
    return Markup("Across estimators the position sigma runs from {} (“{}”) to {} (“{}”).").format(
        quantity(best["sigma_position_km"], "km"),
        best["name"],
        quantity(worst["sigma_position_km"], "km"),
        worst["name"],
    )


def _failures(run: RunFolder) -> list[Markup]:
    """One sentence for each estimator that gave no answer."""
    sentences = []
    for e in run.estimators:
        if e["status"] == "converged":
            continue
        text = Markup("The estimator “{}” gives no answer: {}").format(
            e["name"], wording.REASON.get(e["status"], e["status"])
        )
        weak = e.get("weak_direction") or {}
        if weak:
            largest = max(abs(weight) for weight in weak.values())
            heavy = [item for item in weak.items() if abs(item[1]) > 0.01 * largest]
            heavy = sorted(heavy, key=lambda item: (-abs(item[1]), item[0]))[:4]
            text += Markup("; the worst determined combination is {}").format(
                join(
                    Markup("{} ({})").format(wording.parameter_name(name)[0], wording.number(weight, 2))
                    for name, weight in heavy
                )
            )
        sentences.append(Markup("{}.").format(text))
    return sentences


def _no_answer(run: RunFolder) -> Markup:
    """The headline of a run without a converged estimator."""
    kinds = sorted({wording.REASON.get(e["status"], str(e["status"])) for e in run.estimators})
    if not kinds:
        return Markup("No accuracy can be stated: {}.").format(
            "the run has no estimate" if run.summary["n_observations"] else "no measurement was possible"
        )
    return Markup("No accuracy can be stated: {}.").format(join(kinds, last="or"))


def warnings(run: RunFolder) -> list[str]:
    """The warnings of a run, without those that only repeat why an estimator failed."""
    said = {f"{e['name']}: {e.get('message')}" for e in run.estimators if e["status"] != "converged"}
    return [text for text in run.summary.get("warnings") or [] if text not in said]


def _capital(text: str | Markup) -> Markup:
    """The text with its first letter large."""
    escaped = Markup.escape(text)
    return escaped[:1].upper() + escaped[1:]
