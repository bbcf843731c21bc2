"""What a mission would give, as parts of a page: what is seen, how well things are known and why, the target plane."""

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from nebosvod.dynamics.surface import SURFACE_KM
from nebosvod.findings.prediction import Answered
from nebosvod.impacts.chance import chance_words
from nebosvod.mission import FitMission, Mission
from nebosvod.observation import Visibility
from nebosvod.report.kit import facts, wording
from nebosvod.report.kit.chart import NARROW
from nebosvod.report.kit.target import TargetView, target_chart
from nebosvod.report.run.visibility import COLOURS
from nebosvod.results import prediction_rows
from nebosvod.results.outlook import event_words
from nebosvod.scene.material import looked_at
from nebosvod.scene.scene import PlannedScene, load_ephemeris
from nebosvod.scene.sharing import Shared
from nebosvod.studies.point import Point, evaluate

PLANES_SHOWN = 2
MOST_STRETCHES = 300  # of a strip of visibility: more cannot be told apart
Part = tuple[str, Markup]


def fragments(mission: Mission, shared: Shared) -> Iterator[Part]:
    """Name and HTML of each part, as it is found.

    Raises
    ------
    NebosvodError
        As the stages raise it: nothing visible, nothing determined, an orbit that ends early.
    """
    point = evaluate(mission, frozenset(one.name for one in mission.predictions), None, shared)
    yield "visibility", _filled("visibility.html", rows=_visibility(point.scene))
    yield "answer", _filled("answer.html", **_answer(mission, point))
    yield "target", _filled("target.html", plates=_target_plates(mission, point))


def records(mission: FitMission) -> Iterator[Part]:
    """What a fit would read."""
    found = looked_at(mission, load_ephemeris(mission))
    first, last = str(min(found.utc))[:10], str(max(found.utc))[:10]
    words = Markup("<p>{} of {} from {} to {}, {}. A fit takes seconds: press Run.</p>").format(
        wording.count(len(found), "record"), wording.join(found.objects[:6]), first, last,
        wording.count(len(found.stations), "station"),
    )  # fmt: skip
    notices = Markup("").join(Markup("<p>notice: {}</p>").format(one) for one in found.notices)
    yield "answer", words + notices


def too_many(rows: int, most: int) -> Markup:
    """Why nothing is computed as one types."""
    return Markup(
        "<p>{} are too many to follow every change (at most {}); press Run, or lengthen the cadence while you "
        "write.</p>"
    ).format(wording.count(rows, "measurement"), f"{most:,}")


def _answer(mission: Mission, point: Point) -> dict[str, Any]:
    """What the first estimator knows."""
    telescopes = [one.name for one in mission.telescopes]
    return {
        "estimator": mission.estimators[0].name,
        "epoch": mission.reference_epoch.iso(mission.reference_epoch.scale, 0),
        "position": wording.quantity(point.state_sigma(0, formal=False), "km"),
        "formal": wording.quantity(point.state_sigma(0, formal=True), "km"),
        "velocity": wording.quantity(point.state_sigma(1, formal=False), "m_s"),
        "blame_of_state": _blame(point.state_shares(), telescopes),
        "measurements": wording.count(len(point.times_s), "measurement"),
        "predictions": [_prediction(point, one, telescopes) for one in mission.predictions],
    }


def _prediction(point: Point, asked: Any, telescopes: list[str]) -> dict[str, Any]:
    """One row of the predictions."""
    found = point.prediction(asked.name)
    row: dict[str, Any] = {"name": asked.name, "plane": wording.plane_name(asked.plane)}
    if found is None:
        return row | {"why_not": point.why_not(asked.name)}
    said = prediction_rows.prediction(found)
    chance = found.impact_probability
    return row | {
        "size": facts.size(said),
        "when": event_words(said),
        "blame": _blame(point.shares(asked.name) or {}, telescopes),
        "chance": None if chance is None else chance_words(chance),
    }


def _blame(shares: Mapping[str, float], telescopes: list[str]) -> list[tuple[str, Markup, float]]:
    """Kinds of source with their shares, the largest first."""
    kinds = facts.grouped(list(shares.items()), telescopes)
    return [(kind, wording.percent(share), share) for kind, share, _ in kinds if share >= 5e-4][:4]


def _visibility(scene: PlannedScene) -> list[dict[str, Any]]:
    """One row for each telescope: counts, what was lost to which limit, how faint, and a strip over time."""
    times = np.concatenate([seen.t_s for seen in scene.visibilities])
    first, last = float(times.min()), float(times.max())
    rows = []
    for telescope, seen in zip(scene.telescopes, scene.visibilities):
        lost = {str(r): int(np.count_nonzero(seen.reason == r)) for r in np.unique(seen.reason[~seen.visible])}
        faint = seen.apparent_magnitude[np.isfinite(seen.apparent_magnitude)]
        rows.append(
            {
                "name": telescope.name,
                "seen": int(np.count_nonzero(seen.visible)),
                "scheduled": int(seen.t_s.size),
                "lost": wording.join(f"{n} {wording.REMOVED.get(r, r)}" for r, n in lost.items()),
                "magnitude": f"{faint.min():.1f} to {faint.max():.1f}" if faint.size else "",
                "strip": _strip(seen, first, last),
            }
        )
    return rows


def _strip(seen: Visibility, first: float, last: float) -> list[tuple[float, float, str, str]]:
    """Stretches of time with one fate: from and how long in thousandths of the whole, colour, word."""
    if not seen.t_s.size or last <= first:
        return []
    reason = np.where(seen.visible, "-", seen.reason)
    starts = np.flatnonzero(np.r_[True, reason[1:] != reason[:-1]])
    starts = starts[:: max(1, int(np.ceil(len(starts) / MOST_STRETCHES)))]
    step = float(np.median(np.diff(seen.t_s))) if seen.t_s.size > 1 else last - first
    begins = seen.t_s[starts]
    ends = np.r_[
        np.minimum(begins[1:], seen.t_s[np.r_[starts[1:], seen.t_s.size] - 1][:-1] + step), seen.t_s[-1] + step
    ]
    scale = 1000.0 / (last - first + step)
    return [
        (float(a - first) * scale, max(1.0, float(b - a) * scale), COLOURS.get(str(w), COLOURS["sun"]), str(w))
        for a, b, w in zip(begins, ends, reason[starts])
    ]


def _target_plates(mission: Mission, point: Point) -> list[Any]:
    """The target planes, with the body to scale."""
    plates: list[Any] = []
    for asked in mission.predictions:
        found = point.prediction(asked.name)
        view = None if found is None else _view(found)
        if view is not None and len(plates) < PLANES_SHOWN:
            label = f"{asked.name}: {wording.plane_name(asked.plane, view.body)} with the body to scale"
            plates.append(target_chart(f"target-{len(plates)}", view, NARROW).plate(label, Markup(""), ()))
    return plates


def _view(found: Answered) -> TargetView | None:
    """A target plane as the kit draws it; None of another prediction."""
    encounter = found.quantity.encounter
    if found.request.plane not in ("b_plane", "mtp") or encounter is None or found.quantity.value is None:
        return None
    if encounter.capture_radius_km is None or encounter.body not in SURFACE_KM:
        return None
    first, second = wording.axis_names(found.request.plane, 2)
    return TargetView(
        body=encounter.body, radius_km=SURFACE_KM[encounter.body], capture_km=encounter.capture_radius_km,
        centre=found.quantity.value, covariance=found.factor @ found.factor.T,
        formal=found.factor_formal @ found.factor_formal.T, points=np.empty((0, 2)), fates=np.empty(0, dtype=np.str_),
        names=(first, second),
    )  # fmt: skip


def _filled(template: str, **words: Any) -> Markup:
    return Markup(_templates().get_template(template).render(**words))


@cache
def _templates() -> Environment:
    """Templates of this folder; everything is escaped, and a name that nobody gave is an error."""
    return Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
