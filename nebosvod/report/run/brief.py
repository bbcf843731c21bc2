"""The answers in a line or two, for who reads nothing else; `verdict` has the sentences behind them."""

from markupsafe import Markup

from nebosvod.report.kit import short, wording
from nebosvod.report.kit.facts import formal_ratio, grouped, leading, position_shares, size
from nebosvod.report.kit.residual_words import brief_words
from nebosvod.report.kit.wording import NBSP, count, join, number, percent, product, quantity
from nebosvod.results.agreement import Agreement, agreement
from nebosvod.results.folder import Item, RunFolder
from nebosvod.results.outlook import unit_of

AGREE = 0.01  # sigmas that differ by less than this are called equal
HELD_AT_3_SIGMA = {1: "99.7", 2: "98.9", 3: "97.1"}  # per cent of the probability in 1, 2 and 3 dimensions
SHOWN = 3


def accuracy(run: RunFolder, main: Item) -> Markup:
    """The leading prediction at 1 and 3 sigma, the second, and the orbit."""
    orbit = Markup("orbit {}, {} on {}").format(
        quantity(main["sigma_position_km"], "km"), quantity(main["sigma_velocity_m_s"], "m_s"),
        wording.date(run.summary["reference_epoch_tdb"]),
    )  # fmt: skip
    every = leading(run, main)
    if not every:
        none = "No prediction has an answer" if run.unanswered else "No prediction was asked for"
        return Markup("{}; {} (1σ).").format(none, orbit)
    first, unit = every[0], unit_of(every[0])
    axes = first[f"semi_axes_{unit}"]
    text = Markup("<b>{}</b> {} at 1σ, {} at 3σ ({}{}% inside)").format(
        first["name"], size(first), product([3.0 * a for a in axes], unit, like=max(axes)),
        HELD_AT_3_SIGMA.get(len(axes), ""), NBSP,
    )  # fmt: skip
    drawn = (first.get("monte_carlo") or {}).get(f"semi_axes_{unit}")
    if drawn and ((first.get("nonlinearity") or {}).get("misleads") or first["monte_carlo"].get("misleads")):
        text += Markup(", which misleads: drawn orbits spread over {}").format(product(drawn, unit))
    others = [Markup("{} {}").format(p["name"], size(p)) for p in every[1:2]]
    further = [Markup(count(len(every) - 2, "further prediction"))] if len(every) > 2 else []
    said = [[*others, *further, orbit], [*others, orbit], [orbit]]
    return short.first_that_fits(
        *(Markup("{}; 1σ: {}.").format(text, Markup("; ").join(one)) for one in said), text + "."
    )


def contributions(run: RunFolder, main: Item) -> Markup | None:
    """The largest contributions to the variance of the leading prediction, or of the orbit; None without a budget."""
    every = leading(run, main)
    if every and every[0].get("budget"):
        what = Markup("<b>{}</b>").format(every[0]["name"])
        shares = [(row["source"], row["share_total"]) for row in every[0]["budget"]]
    else:
        what, shares = Markup("the position"), position_shares(run, main)
    if not shares:
        return None
    kinds = grouped(shares, run.telescopes)
    ways = (_listed(kinds, n, several) for n in range(min(SHOWN, len(kinds)), 0, -1) for several in (True, False))
    return short.first_that_fits(
        *(Markup("Error contributions to the variance of {}: {}.").format(what, one) for one in ways)
    )


def _listed(kinds: list[tuple[str, float, int]], n: int, several: bool) -> Markup:
    """The first n kinds of sources with their shares, and what all others add up to."""
    named = join(Markup("{} {}").format(_of(kind, k if several else 1), percent(share)) for kind, share, k in kinds[:n])
    rest = sum(share for _, share, _ in kinds[n:])
    return named + (Markup("; all others {}").format(percent(rest)) if rest > 0.0005 else "")


def _of(kind: str, n: int) -> str:
    return f"{kind} of {n}{NBSP}telescopes" if n > 1 else kind


def belief(run: RunFolder, main: Item, good: bool) -> Markup:
    """Yes, or with what caution: sigma, residuals, linearity, estimators."""
    head = "Yes, as far as the error model holds" if good else "With caution"
    for why in (True, False):
        parts = [*_worries(run, main, why), *_grounds(run, main)]
        text = Markup("<b>{}</b>: {}.").format(head, join(parts)) if parts else Markup("<b>{}</b>.").format(head)
        if short.lines(text) <= short.MOST_LINES:
            return text
    worries = [*_worries(run, main, False), *(one for one in _grounds(run, main) if not good)]
    return short.as_many(Markup("<b>{}</b>: {}").format(head, worries[0]), worries[1:], ", ")


def _worries(run: RunFolder, main: Item, why: bool) -> list[Markup | str]:
    """How reported and realistic sigma compare, and what has no answer."""
    parts: list[Markup | str] = []
    ratio = formal_ratio(main)
    if ratio is not None:
        close = abs(ratio - 1.0) < AGREE
        parts.append(
            Markup("realistic and reported sigma agree") if close
            else Markup("the realistic sigma is {}{}× the one the estimator reports{}").format(
                number(ratio), NBSP, _why(main) if why else ""
            )
        )  # fmt: skip
    if any(main.get("mean_error_km_km_s") or []):
        parts.append("the estimate is off on average")
    lost = sum(e["status"] != "converged" for e in run.estimators)
    if lost:
        parts.append(f"{lost} of {count(len(run.estimators), 'estimator')} gave no answer")
    if run.unanswered:
        one = len(run.unanswered) == 1
        parts.append(f"{count(len(run.unanswered), 'prediction')} {'has' if one else 'have'} no answer")
    return parts


def _grounds(run: RunFolder, main: Item) -> list[Markup | str]:
    """What residuals and second-order terms say."""
    return [one for one in (_residuals(run, main), _linear(run, main)) if one]


def _why(main: Item) -> str:
    """What an estimator leaves out of its weights, in brackets; empty where it leaves out nothing."""
    left_out = [group for group, how in (main.get("treatment") or {}).items() if how in ("ignored", "considered")]
    named = ", ".join(left_out[:2]) + (", ..." if len(left_out) > 2 else "")
    return f" (not in its weights: {named})" if left_out else ""


def residuals_of(run: RunFolder, main: Item) -> Agreement | None:
    """How the residuals agree with the noise; None where none was drawn, and they tell nothing."""
    return agreement(main.get("chi2"), main.get("dof")) if run.manifest.get("drawn", True) else None


def _residuals(run: RunFolder, main: Item) -> str:
    """Whether the residuals are as large as the noise model says."""
    found = residuals_of(run, main)
    return "" if found is None else brief_words(found)


def _linear(run: RunFolder, main: Item) -> Markup | str:
    """How far the leading prediction departs from linear."""
    every = leading(run, main)
    found = (every[0].get("nonlinearity") or {}) if every else {}
    if found.get("misleads"):
        return "the linear ellipse misleads"
    measure = found.get("measure")
    return f"the departure from linear is {number(measure, 2)}σ" if measure is not None else ""
