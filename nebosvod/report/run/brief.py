"""The answers in a line or two, for who reads nothing else; `verdict` has the sentences behind them."""

from markupsafe import Markup

from nebosvod.report.kit import wording
from nebosvod.report.kit.facts import formal_ratio, grouped, leading, position_shares, size
from nebosvod.report.kit.wording import NBSP, count, join, number, percent, product, quantity
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
    if len(every) > 2:
        others.append(Markup(count(len(every) - 2, "further prediction")))
    return Markup("{}; 1σ: {}.").format(text, Markup("; ").join([*others, orbit]))


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
    named = join(Markup("{} {}").format(_of(kind, n), percent(share)) for kind, share, n in kinds[:SHOWN])
    rest = sum(share for _, share, _ in kinds[SHOWN:])
    more = Markup("; all others {}").format(percent(rest)) if len(kinds) > SHOWN and rest > 0.0005 else ""
    return Markup("Error contributions to the variance of {}: {}{}.").format(what, named, more)


def _of(kind: str, n: int) -> str:
    return f"{kind} of {n}{NBSP}telescopes" if n > 1 else kind


def belief(run: RunFolder, main: Item, good: bool) -> Markup:
    """Yes, or with what caution: sigma, residuals, linearity, estimators."""
    parts: list[Markup | str] = []
    ratio = formal_ratio(main)
    if ratio is not None:
        close = abs(ratio - 1.0) < AGREE
        parts.append(
            Markup("realistic and reported sigma agree") if close
            else Markup("the realistic sigma is {}{}× the one the estimator reports{}").format(
                number(ratio), NBSP, _why(main)
            )
        )  # fmt: skip
    if any(main.get("mean_error_km_km_s") or []):
        parts.append("the estimate is off on average")
    parts += [one for one in (_residuals(main), _linear(run, main)) if one]
    lost = sum(e["status"] != "converged" for e in run.estimators)
    if lost:
        parts.append(f"{lost} of {count(len(run.estimators), 'estimator')} gave no answer")
    if run.unanswered:
        parts.append(f"{count(len(run.unanswered), 'prediction')} has no answer" if len(run.unanswered) == 1
                     else f"{count(len(run.unanswered), 'prediction')} have no answer")  # fmt: skip
    head = "Yes, as far as the error model holds" if good else "With caution"
    return Markup("<b>{}</b>: {}.").format(head, join(parts)) if parts else Markup("<b>{}</b>.").format(head)


def _why(main: Item) -> str:
    """What an estimator leaves out of its weights, in brackets; empty where it leaves out nothing."""
    left_out = [group for group, how in (main.get("treatment") or {}).items() if how in ("ignored", "considered")]
    named = ", ".join(left_out[:2]) + (", ..." if len(left_out) > 2 else "")
    return f" (not in its weights: {named})" if left_out else ""


def _residuals(main: Item) -> str:
    """Whether the residuals are as large as the noise model says."""
    chi2, dof = main.get("chi2"), main.get("dof")
    if chi2 is None or not dof or dof < 1:
        return ""
    low, high = chi2_interval(int(dof))
    if low <= chi2 / dof <= high:
        return "residuals are as large as expected"
    return f"residuals are {'smaller' if chi2 / dof < low else 'larger'} than the noise model says"


def _linear(run: RunFolder, main: Item) -> Markup | str:
    """How far the leading prediction departs from linear."""
    every = leading(run, main)
    found = (every[0].get("nonlinearity") or {}) if every else {}
    if found.get("misleads"):
        return "the linear ellipse misleads"
    measure = found.get("measure")
    return f"the departure from linear is {number(measure, 2)}σ" if measure is not None else ""


def chi2_interval(dof: int) -> tuple[float, float]:
    """Two-sided 99 % interval of chi2/dof."""
    from scipy.special import chdtri  # 0.2 s, and free after a run

    return float(chdtri(dof, 0.995)) / dof, float(chdtri(dof, 0.005)) / dof
