"""The error budget of each quantity as a ledger: what every source contributes, and what would remain without it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.mission.slugs import array_name
from nebosvod.report.kit import wording
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import Download, csv
from nebosvod.report.kit.edge import at_edge
from nebosvod.report.kit.facts import PRIOR_ORBITS, grouped, leading, of_telescopes
from nebosvod.report.kit.plate import BLUE, INK, VERMILION, Plate
from nebosvod.report.kit.scale import linear, named
from nebosvod.report.kit.wording import finite, join, number, percent, quantity, scale_of
from nebosvod.report.run.sources import kind_of, look
from nebosvod.results.folder import Item, RunFolder
from nebosvod.results.outlook import unit_of

REMEDIES = ("if_vanished", "if_halved")
GAINS = ("same", "new")
ROOM = 0.35  # of the width of the figure of remedies, for values beyond it
WORSE = 1.3  # times the present sigma, above which a remedy is an arrowhead at the edge with its value
SMALL = 5e-4  # a share below this has no room in a bar


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One source of a ledger; `then` holds the total sigma by remedy and gain, None where it is not known.

    `prior` : whether it is a prior, whose error vanishes where what it is about is known exactly; `unknown` : the total
    sigma were nothing known of that beforehand.
    """

    source: str
    behind: tuple[str, ...]
    share: float
    sigma: float | None
    then: dict[tuple[str, str], float | None]
    prior: bool = False
    unknown: float | None = None

    @property
    def ideal(self) -> str:
        """Words for the best that could become of it."""
        return f"{self.source} known exactly" if self.prior else f"no error of {self.source}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Ledger:
    """The variance of one quantity by source, largest first; sigmas in `unit`, `total` the root of their squares."""

    key: str
    title: str
    unit: str
    total: float
    entries: tuple[Entry, ...]

    @property
    def short(self) -> str:
        """The title where room is short."""
        title = self.title.replace("at the reference epoch", "at ref. epoch")
        return title if len(title) < 28 else title[:26] + "…"

    @property
    def download(self) -> Download:
        """The ledger as a file."""
        columns: dict[str, Sequence[Any]] = {
            "source": [e.source for e in self.entries],
            "share_of_variance": [e.share for e in self.entries],
            f"sigma_{self.unit}": [e.sigma for e in self.entries],
        }
        for remedy in REMEDIES:
            for gain in GAINS:
                columns[f"total_sigma_{remedy}_{gain}_gain_{self.unit}"] = [e.then[remedy, gain] for e in self.entries]
        columns[f"total_sigma_if_unknown_new_gain_{self.unit}"] = [e.unknown for e in self.entries]
        return csv(f"budget-{self.key}", columns)


def ledgers(run: RunFolder, estimator: Item) -> list[Ledger]:
    """The predictions' ledgers, the leading one first, then those of position and velocity."""
    found = []
    for p in leading(run, estimator):
        unit, rows = unit_of(p), p.get("budget") or []
        if rows:
            total = sum(s * s for s in p[f"sigma_{unit}"]) ** 0.5
            entries = [_entry(row, row["share_total"], f"sigma_total_{unit}", total) for row in rows]
            found.append(_made(f"{p['name']} {p['plane']}", p["name"], unit, total, entries))
    rows = run.budget(estimator["name"])
    for what, unit in (("position", "km"), ("velocity", "m_s")) if rows else ():
        key = f"sigma_{what}_{unit}"
        entries = [_entry(row, row[f"share_{what}"], key, estimator[key]) for row in rows]
        found.append(_made(what, f"{what} at the reference epoch", unit, estimator[key], entries))
    return found


def _entry(row: Item, share: float, key: str, total: float) -> Entry:
    """One source; a summary without its own sigma has it from the share."""
    then = {(r, g): (row.get(r) or {}).get(f"{key}_{g}_gain") for r in REMEDIES for g in GAINS}
    without = row.get("if_unknown")
    return Entry(source=row["source"], behind=tuple(row.get("telescopes") or ()), share=share,
                 sigma=row.get(key, total * share**0.5), then=then, prior=without is not None,
                 unknown=(without or {}).get(f"{key}_new_gain"))  # fmt: skip


def _made(key: str, title: str, unit: str, total: float, entries: list[Entry]) -> Ledger:
    """A ledger in order."""
    entries = sorted(entries, key=lambda e: (-e.share, e.source))
    return Ledger(key=array_name(key).replace("_", "-"), title=title, unit=unit, total=total, entries=tuple(entries))


def shares_plate(run: RunFolder, found: Sequence[Ledger]) -> Plate | None:
    """A bar for each quantity, divided by source."""
    chart = shares_chart(run, found)
    if chart is None:
        return None
    columns: dict[str, Sequence[Any]] = {
        "quantity": [g.title for g in found for _ in g.entries],
        "source": [e.source for g in found for e in g.entries],
        "share_of_variance": [e.share for g in found for e in g.entries],
    }
    return chart.plate("Share of each source in the variance of each quantity", _shares_caption(run, found),
                       [csv("budget-shares", columns)])  # fmt: skip


def shares_chart(run: RunFolder, found: Sequence[Ledger]) -> Chart | None:
    """Draw a bar for each quantity, divided by source."""
    if not found:
        return None
    names = [e.source for ledger in found for e in ledger.entries if e.share >= SMALL]
    behind = {e.source: e.behind for ledger in found for e in ledger.entries}
    sources = _ordered(dict.fromkeys(names), behind, found)
    high = 30.0 * len(found)
    chart = Chart("budget-shares", height=0.0)
    rows = [ledger.short for ledger in found]
    panel = chart.panel(
        linear([0.0, 100.0], "share of the variance, %", pad=0.0), named(rows), top=6.0, bottom=6.0 + high
    )
    panel.open()
    for i, ledger in enumerate(found):
        at, place = 0.0, {e.source: e for e in ledger.entries}
        for source in (s for s in sources if s in place):
            share = 100.0 * place[source].share
            tip = f"{ledger.title}: {source} {share:.1f} %"
            panel.bar(
                at,
                at + share,
                -float(i),
                19.0,
                tip,
                stroke="#fff",
                stroke_width=0.7,
                **look(source, run.telescopes, behind[source]),
            )
            at += share
    panel.close()
    entries = [("box", source, look(source, run.telescopes, behind[source])) for source in sources]
    chart.height = chart.legend(entries, high + 52.0)
    return chart


def _ordered(names: Iterable[str], behind: Mapping[str, tuple[str, ...]], found: Sequence[Ledger]) -> list[str]:
    """Sources, kinds together, the kind with the largest share anywhere first, telescopes by name."""
    most: dict[str, float] = {}
    for entry in (e for ledger in found for e in ledger.entries):
        kind = kind_of(entry.source, entry.behind)
        most[kind] = max(most.get(kind, 0.0), entry.share)
    return sorted(names, key=lambda s: (-most[kind_of(s, behind[s])], kind_of(s, behind[s]), s))


def _shares_caption(run: RunFolder, found: Sequence[Ledger]) -> Markup:
    """The largest kind of source for each quantity."""
    largest: dict[str, list[Markup]] = {}
    for ledger in found:
        kind, share, n = grouped([(e.source, e.share) for e in ledger.entries], run.telescopes)[0]
        largest.setdefault(of_telescopes(kind, n), []).append(Markup("{} ({})").format(ledger.title, percent(share)))
    parts = [
        Markup("<b>{}</b> leads in {}").format(kind[:1].upper() + kind[1:], join(where))
        for kind, where in largest.items()
    ]
    return Markup("{}. Shares of one quantity add up to 100{}%; telescopes of one kind share its colour.").format(
        Markup("; ").join(parts), wording.NBSP
    )


def remedies_plate(run: RunFolder, ledger: Ledger) -> Plate | None:
    """The sigma that would remain without each source, and with it halved."""
    shown = [e for e in ledger.entries if finite(e.then["if_vanished", "new"]) and e.share >= SMALL][:12]
    if not shown:
        return None
    factor, unit = scale_of(ledger.total, ledger.unit)
    high = 22.0 * len(shown)
    most = WORSE * ledger.total
    values = [factor * ledger.total, *(v * factor for e in shown for v in e.then.values() if finite(v) and v <= most)]
    if any(finite(v) and v > most for e in shown for v in e.then.values()):  # room at the right for what is said there
        values.append(max(values) + ROOM * (max(values) - min(values)))
    chart = Chart("budget-remedies", height=0.0)
    panel = chart.panel(
        linear(values, f"total sigma of {ledger.title}, {unit}"),
        named([e.source for e in shown]),
        top=6.0,
        bottom=6.0 + high,
    )
    panel.upright(ledger.total * factor, stroke=INK, stroke_width=1.2)
    for i, e in enumerate(shown):
        now, new = ledger.total * factor, min(ledger.total, e.then["if_vanished", "new"] or 0.0)
        panel.bar(
            new * factor,
            now,
            -float(i),
            9.0,
            f"{e.source}: share {100 * e.share:.1f} %",
            **look(e.source, run.telescopes, e.behind),
        )
    panel.open()
    for gain, colour, marker, name in (("new", BLUE, "o", "re-optimised"), ("same", VERMILION, "O", "gain as it is")):
        for remedy, word in (("if_vanished", "vanished"), ("if_halved", "halved")):
            left = [(i, e.then[remedy, gain]) for i, e in enumerate(shown)]
            points = [(factor * v, -float(i)) for i, v in left if finite(v) and v <= most]
            shape = marker if word == "vanished" else "D" if gain == "new" else "P"
            panel.marks(points, shape, f"{word}, {name}", color=colour, size=6.5 if shape == "o" else 3.0)
            far = [(factor * v, -float(i)) for i, v in left if finite(v) and v > most]
            x, y = np.array(far, dtype=np.float64).reshape(-1, 2).T
            at_edge(panel, x, y, [f"{number(v)} {unit}" for v in x], color=colour, most=len(far))
    panel.close()
    entries: list[tuple[str, str, dict[str, Any]]] = [
        ("line", f"now, {number(ledger.total * factor)} {unit}", {"stroke": INK, "stroke_width": 1.2}),
        ("o", "error vanished, re-optimised", {"color": BLUE, "size": 6.5}),
        ("O", "error vanished, gain as it is", {"color": VERMILION}),
        ("D", "halved, re-optimised", {"color": BLUE}),
        ("P", "halved, gain as it is", {"color": VERMILION}),
    ]
    chart.height = chart.legend(entries, high + 52.0)
    return chart.plate(
        f"Total sigma of {ledger.title} if the error of one source vanished or halved",
        _remedies_caption(ledger),
        [ledger.download],
    )


def best_remedy(ledger: Ledger, remedy: str = "if_vanished") -> Entry | None:
    """The source whose remedy leaves least, with the gain re-optimised."""
    known = [e for e in ledger.entries if finite(e.then[remedy, "new"])]
    return min(known, key=lambda e: e.then[remedy, "new"] or 0.0, default=None)


def _remedies_caption(ledger: Ledger) -> Markup:
    """What the best single remedy would bring."""
    best, half = best_remedy(ledger), best_remedy(ledger, "if_halved")
    if best is None or half is None:
        return Markup("")
    text = Markup(
        "With <b>{}</b> the sigma of {} would fall from {} to {}, were the estimator told of it; to {} with its "
        "gain as it is. Halving the error of one source brings most for {}: {}. Shares add up; gains of several "
        "remedies do not."
    ).format(
        best.ideal,
        ledger.title,
        quantity(ledger.total, ledger.unit),
        quantity(best.then["if_vanished", "new"], ledger.unit),
        quantity(best.then["if_vanished", "same"], ledger.unit),
        half.source,
        quantity(half.then["if_halved", "new"], ledger.unit),
    )
    orbits = [e for e in ledger.entries if e.source in PRIOR_ORBITS and finite(e.unknown)]
    if orbits:
        text += Markup(" With no {} at all it would be {}.").format(
            orbits[0].source, quantity(orbits[0].unknown, ledger.unit)
        )
    worse = [e.source for e in ledger.entries if finite(v := e.then["if_vanished", "new"]) and v > 1.01 * ledger.total]
    if worse:
        text += Markup(
            " Without the error of {} the re-optimised sigma would be larger: the estimator leaves sources out of its "
            "weights and would trust the cleaned measurements too much."
        ).format(join(worse))
    return text
