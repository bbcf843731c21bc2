"""The answer in sentences. Each is made from numbers of the run, and left out where the run has no such number."""

import math
from dataclasses import dataclass

from markupsafe import Markup

from nebosvod.report import wording
from nebosvod.report.folder import Item, RunFolder
from nebosvod.report.wording import count, join, percent, product, quantity

HELD_AT_3_SIGMA = {1: "99.7", 2: "98.9", 3: "97.1"}  # per cent of the probability in 1, 2 and 3 dimensions
AGREE = 0.01  # sigmas that differ by less than this are called equal
WEIGHT = (
    "b_plane",
    "mtp",
    "perigee_distance",
)  # planes a reader asks for first; the others follow in the mission's order


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What stands at the top of the page: one headline, sentences, and whether the run may be trusted.

    `tone` is "good", "caution" (an answer, but formal and true accuracy differ or the fit is odd) or "bad" (no answer).
    """

    headline: Markup
    sentences: tuple[Markup, ...]
    tone: str


def verdict(run: RunFolder) -> Verdict:
    """Say what the run found."""
    main = run.main
    if main is None:
        return Verdict(headline=_no_answer(run), sentences=tuple(_failures(run)), tone="bad")
    trust, honest = _trust(main)
    fit, fits = _fit(main)
    others = [_trust(e)[0] for e in run.estimators if _misleads(e) and e is not main]
    sentences = [_orbit(run, main), *_predictions(run, main), *_blame(run, main), trust, *others, fit, *_failures(run)]
    agreement = _agreement(run, main)
    every = all(e["status"] == "converged" for e in run.estimators)
    return Verdict(
        headline=_headline(run, main),
        sentences=tuple(s for s in [*sentences, agreement] if s),
        tone="good" if honest and fits and every else "caution",
    )


def unit_of(prediction: Item) -> str:
    """The unit a prediction is given in: "km", "arcsec", "m_s"."""
    return next((key.removeprefix("semi_axes_") for key in prediction if key.startswith("semi_axes_")), "km")


def formal_ratio(main: Item) -> float | None:
    """True over formal position sigma, None where either is missing."""
    true, formal = main.get("sigma_position_km"), main.get("sigma_formal_position_km")
    return true / formal if true and formal else None


def _headline(run: RunFolder, main: Item) -> Markup:
    """The main prediction (or the position) and the largest source, in one line."""
    predictions = leading(run, main)
    if predictions:
        first = predictions[0]
        where = wording.plane_name(first["plane"], first.get("body"))
        what = Markup("{} on {}: {} at 1σ").format(_capital(where), wording.date(first["epoch_tdb"]), size(first))
        shares = [(row["source"], row["share_total"]) for row in first.get("budget") or []]
    else:
        what = Markup("Position known to {} at 1σ").format(quantity(main["sigma_position_km"], "km"))
        shares = position_shares(run, main)
    if not shares:
        return Markup("{}.").format(what)
    kind, share, n = grouped(shares, run.telescopes)[0]
    return Markup("{}; {} makes up {} of that variance.").format(what, of_telescopes(kind, n), percent(share))


def leading(run: RunFolder, main: Item) -> list[Item]:
    """The predictions of the main estimator, target planes and closest approaches first."""
    every = run.predictions(main["name"])
    return sorted(every, key=lambda p: WEIGHT.index(p["plane"]) if p["plane"] in WEIGHT else len(WEIGHT))


def position_shares(run: RunFolder, main: Item) -> list[tuple[str, float]]:
    """Source and share of the position variance, largest first."""
    return [(row["source"], row["share_position"]) for row in run.budget(main["name"])]


def of_telescopes(kind: str, n: int) -> str:
    """`bias` of one telescope, `bias (2 telescopes)` added up over several."""
    return f"{kind} ({n}{wording.NBSP}telescopes)" if n > 1 else kind


def size(prediction: Item) -> Markup:
    """`50.4 × 8.32 km` of an ellipse, `± 34.3 km` of a scalar."""
    unit = unit_of(prediction)
    axes = prediction[f"semi_axes_{unit}"]
    mean = prediction.get(f"mean_{unit}")
    if len(axes) > 1:
        return product(axes, unit)
    if mean and prediction["plane"] == "perigee_distance":
        return wording.with_sigma(mean[0], axes[0], unit)
    return Markup("± {}").format(quantity(axes[0], unit))


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
    return Markup(
        "At {}, {}{} of {}{} give the heliocentric position of {} to {} and its velocity to {} (1σ, root trace)."
    ).format(
        wording.moment(run.summary["reference_epoch_tdb"]),
        count(n, "measurement"),
        made,
        join(run.telescopes),
        span,
        object_name(run),
        quantity(main["sigma_position_km"], "km"),
        quantity(main["sigma_velocity_m_s"], "m_s"),
    )


def object_name(run: RunFolder) -> str:
    """The name of the object."""
    thing = run.summary["object"]
    return str(thing["name"]) if isinstance(thing, dict) else str(thing)


def _predictions(run: RunFolder, main: Item) -> list[Markup]:
    """One sentence for each prediction: 1 sigma, and 3 sigma with what it holds."""
    sentences = []
    for p in leading(run, main):
        unit = unit_of(p)
        axes = p[f"semi_axes_{unit}"]
        what = ["", "", "semi-axes of the ellipse ", "semi-axes of the ellipsoid "][min(len(axes), 3)]
        text = Markup("<b>{}</b> ({}, {}): {}{} at 1σ, {} at 3σ ({}{}%).").format(
            _capital(p["name"]), wording.plane_name(p["plane"], p.get("body")), wording.moment(p["epoch_tdb"]), what,
            size(p), product([3.0 * a for a in axes], unit, like=max(axes)),
            HELD_AT_3_SIGMA.get(len(axes), ""), wording.NBSP,
        )  # fmt: skip
        sentences.append(text)
    return sentences


def grouped(shares: list[tuple[str, float]], telescopes: list[str]) -> list[tuple[str, float, int]]:
    """Sources added up over telescopes: (kind, share, number of sources), largest first."""
    sums: dict[str, tuple[float, int]] = {}
    for source, own in shares:
        kind = kind_of(source, telescopes)
        share, n = sums.get(kind, (0.0, 0))
        sums[kind] = (share + own, n + 1)
    return sorted(((k, s, n) for k, (s, n) in sums.items()), key=lambda item: (-item[1], item[0]))


def kind_of(source: str, telescopes: list[str]) -> str:
    """A source's name without the telescope it belongs to: `bias NEB-1` -> `bias`."""
    for name in sorted(telescopes, key=len, reverse=True):
        if source.endswith(" " + name):
            return source.removesuffix(" " + name)
    return source


def _blame(run: RunFolder, main: Item) -> list[Markup]:
    """Which uncertainty costs how much."""
    rows = run.budget(main["name"])
    if not rows:
        return []
    top = rows[0]
    kinds = grouped(position_shares(run, main), run.telescopes)
    text = Markup("Of the position variance at the reference epoch, {} comes from {}").format(
        percent(top["share_position"]), top["source"]
    )
    text += Markup(" ({} on its own)").format(quantity(top["sigma_position_km"], "km"))
    if len(rows) > 1:
        text += Markup(" and {} from {}").format(percent(rows[1]["share_position"]), rows[1]["source"])
    merged = [k for k in kinds if k[2] > 1 and k[1] > 0.005][:3]
    if merged:
        sums = join(Markup("{} {}").format(kind, percent(share)) for kind, share, _ in merged)
        text += Markup("; added over the telescopes: {}").format(sums)
    small = [row for row in rows if row["share_position"] < 0.001]
    if small:
        names = join(row["source"] for row in small)
        text += (
            Markup(". {} {} less than 0.1{}% {}")
            .format(
                _capital(names),
                "contributes" if len(small) == 1 else "contribute",
                wording.NBSP,
                "" if len(small) == 1 else "each",
            )
            .rstrip()
        )
    return [Markup("{}.").format(text)]


def _misleads(estimator: Item) -> bool:
    """True for an estimator whose formal position sigma is not the true one."""
    ratio = formal_ratio(estimator)
    return ratio is not None and abs(ratio - 1.0) >= AGREE


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


def _fit(main: Item) -> tuple[Markup | None, bool]:
    """chi2 per degree of freedom against its 99 % interval."""
    chi2, dof = main.get("chi2"), main.get("dof")
    if chi2 is None or not dof or dof < 1:
        return None, True
    low, high = chi2_interval(int(dof))
    inside = low <= chi2 / dof <= high
    where = "inside" if inside else "below" if chi2 / dof < low else "above"
    odd = "" if inside else " The residuals are smaller than the noise model says." if where == "below" else (
        " The residuals are larger than the noise model says."
    )  # fmt: skip
    text = Markup(
        "χ² per degree of freedom is {}, {} its 99{}% interval of {} to {} ({} degrees of freedom).{}"
    ).format(quantity(chi2 / dof), where, wording.NBSP, wording.number(low), wording.number(high), dof, odd)
    return text, inside


def chi2_interval(dof: int) -> tuple[float, float]:
    """Two-sided 99 % interval of chi2/dof."""
    from scipy.special import chdtri  # 0.2 s, and free after a run

    return float(chdtri(dof, 0.995)) / dof, float(chdtri(dof, 0.005)) / dof


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
