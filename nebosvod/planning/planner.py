"""`nebosvod plan`: which next measurement makes a prediction better, by how much an hour, and the next K of them.

Every candidate is scored by an exact update of the present accuracy, K_true, with the estimator's own gain: A is the
root trace of the prediction's covariance, D the geometric mean of its semi-axes. Beside them stands a worst case where
one is asked for (`worst_case`). The schedule is greedy, each visit
the best after those before it, and stands beside as many visits spread evenly, the telescopes in turn.
"""

import difflib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.engine.evaluation import quantity
from nebosvod.engine.fitting import SOLVERS
from nebosvod.engine.quantity import Quantity
from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation.accuracy.addition import Additions, Belief, additions, predicted, take
from nebosvod.mission import Mission
from nebosvod.mission.reading.reader import require_mission
from nebosvod.planning.visits import SAME_S, Candidates, candidates, grids
from nebosvod.planning.wish import HOUR_S, Criterion, Wish
from nebosvod.planning.worst_case import Worst, WorstCase
from nebosvod.scene.prior import prior_table
from nebosvod.scene.scene import PlannedScene, build_scene

Array = npt.NDArray[np.float64]
WORST: tuple[Worst, ...] = ("minimax", "guaranteed")
SCHEMA_VERSION = 1
WINDOW = 0.9  # a window holds the epochs whose gain is at least this part of the best of the telescope
MOST_VISITS = 1000
MOST_EXPOSURES = 1000


class Planner:
    """The present accuracy of one prediction and what each candidate would make of it."""

    def __init__(self, offered: Candidates, solve: Callable[[Any], Any], asked: Quantity, lasts_s: float = 0.0) -> None:
        self.offered, self.solve, self.lasts_s = offered, solve, lasts_s
        estimate = solve(offered.base)
        if estimate.solution is None:
            raise GeometryError(
                f"plan: nothing to improve yet: {estimate.message}",
                rank=estimate.rank,
                weak_direction=estimate.weak_direction,
            )
        self.belief = Belief.of(estimate)
        self.W = asked.partials_by(self.belief.names)
        # a chain of correlated errors ties a visit to its neighbours: then each candidate is solved for anew
        self.chained = any(markov.treatment != "fixed" for markov in offered.problem.markov)
        self.added = None if self.chained else _only(additions(offered.problem), offered.rows)

    @property
    def count(self) -> int:
        """How many candidates there are."""
        return len(self.offered.rows)

    def now(self) -> tuple[float, float]:
        """(A, D) sigma with the mission's measurements alone."""
        a, d = _sigmas((self.W @ self.belief.G)[None])
        return float(a[0]), float(d[0])

    def each(self, belief: Belief, taken: Sequence[int]) -> tuple[Array, Array]:
        """(A, D) sigmas (c,) after each candidate, on top of those taken; inf for these and those they overlap."""
        closed = self.overlapping(taken)
        if self.added is not None:
            a, d = _sigmas(predicted(belief, self.added, self.W))
        else:
            a, d = np.empty(self.count), np.empty(self.count)
            for k in np.flatnonzero(~closed).tolist():
                found = self.solve(self.offered.with_one([*taken, k])).predict(self.W, self.belief.names)
                a[k : k + 1], d[k : k + 1] = _sigmas(found.factor[None])
        a[closed] = d[closed] = np.inf
        return a, d

    def overlapping(self, taken: Sequence[int]) -> npt.NDArray[np.bool_]:
        """Which candidates (c,) their telescope cannot make because of visits already taken."""
        closed = np.zeros(self.count, dtype=bool)
        for k in taken:
            near = np.abs(self.offered.t_s - self.offered.t_s[k]) <= self.lasts_s
            closed |= near & (self.offered.telescope == self.offered.telescope[k])
        return closed

    def after(self, belief: Belief, taken: Sequence[int]) -> Belief:
        """The belief with the last of the candidates taken as well."""
        if self.added is not None:
            return take(belief, self.added, taken[-1])
        return Belief.of(self.solve(self.offered.with_one(taken)))

    def greedy(self, visits: int, hours: Array, criterion: Criterion) -> list[int]:
        """Numbers of the candidates in the order in which they shrink the sigma most an hour."""
        belief, taken = self.belief, list[int]()
        present = self.now()[0 if criterion == "a" else 1]
        for _ in range(min(visits, self.count)):
            sigma = self.each(belief, taken)[0 if criterion == "a" else 1]
            if not np.isfinite(sigma).any():
                break
            best = int(np.argmax(_rate(present, sigma, hours)))
            present = float(sigma[best])
            taken.append(best)
            belief = self.after(belief, taken)
        return taken

    def even(self, visits: int) -> list[int]:
        """As many candidates at even times over the whole span, the telescopes in turn."""
        first, last = self.offered.t_s[0], self.offered.t_s[-1]
        numbers = np.unique(self.offered.telescope)
        taken: list[int] = []
        total = min(visits, self.count)
        for k in range(total):
            wanted = first + (last - first) * (k + 0.5) / total
            distance = np.abs(self.offered.t_s - wanted)
            distance = distance + np.where(self.offered.telescope == numbers[k % numbers.size], 0.0, last - first + 1.0)
            distance[self.overlapping(taken)] = np.inf
            if not np.isfinite(distance).any():
                break
            taken.append(int(np.argmin(distance)))
        return taken

    def along(self, taken: Sequence[int]) -> list[tuple[float, float]]:
        """(A, D) after each of some visits in turn."""
        belief, found = self.belief, []
        for k in range(1, len(taken) + 1):
            belief = self.after(belief, taken[:k])
            a, d = _sigmas((self.W @ belief.G)[None])
            found.append((float(a[0]), float(d[0])))
        return found


def _only(added: Additions, rows: npt.NDArray[np.int64]) -> Additions:
    """The exposures (c, e) of each visit as one addition of e p components."""
    count, exposures = rows.shape
    p, size = added.H.shape[1:]
    noise = np.zeros((count, exposures, p, exposures, p))
    for k in range(exposures):
        noise[:, k, :, k, :] = added.noise[rows[:, k]]
    H = added.H[rows].reshape(count, exposures * p, size)
    return Additions(H=H, noise=noise.reshape(count, exposures * p, exposures * p))


def _sigmas(factors: Array) -> tuple[Array, Array]:
    """Root trace and geometric mean of the semi-axes of covariances given by factors (c, d, r)."""
    axes = np.linalg.svd(factors, compute_uv=False)[:, : factors.shape[1]]
    with np.errstate(divide="ignore"):
        return np.sqrt(np.sum(axes**2, axis=1)), np.exp(np.mean(np.log(axes), axis=1))


def _rate(now: float, then: Array, hours: Array) -> Array:
    """How much of the sigma an hour takes away, for every candidate."""
    return (now - then) / hours


def plan(mission: Mission, wish: Wish, say: Callable[[str], None] = lambda message: None) -> dict[str, Any]:
    """Find the best next measurements for one prediction; returns what plan.json holds.

    Raises
    ------
    InputError
        If a name is unknown, a span or a number out of range.
    GeometryError
        If the mission's measurements do not determine the orbit, or nothing is visible at the candidate epochs.
    """
    require_mission(mission, "plan")
    if not 1 <= wish.visits <= MOST_VISITS:
        raise InputError(f"--visits: {wish.visits} is out of range (allowed 1 to {MOST_VISITS})")
    request = _named(mission, "predictions", "--prediction", wish.prediction)
    estimator = mission.estimators[0]
    if wish.estimator is not None:
        estimator = _named(mission, "estimators", "--estimator", wish.estimator)
    for name in wish.visit_s or {}:
        _named(mission, "telescopes", "--visit-time", name)
    lasts_s = _require_exposures(wish)
    scene = build_scene(mission)
    say("looking for visible epochs")
    priors = prior_table(mission, scene.forces, scene.state)
    asked = quantity(scene, scene.trajectory, request)
    until_s = asked.epoch - scene.epoch
    starts, apart_s = grids(scene, wish.start_s, wish.end_s, wish.step_s, lasts_s, until_s)
    chosen = partial(candidates, scene, estimator, priors, exposures=wish.exposures, spacing_s=wish.spacing_s)
    try:
        offered = chosen(starts, apart_s=apart_s)
    except GeometryError:
        if apart_s == SAME_S or max(map(len, starts)) < 2:
            raise
        offered = chosen([(grid[1:] + grid[:-1]) / 2.0 for grid in starts], apart_s=SAME_S)  # between what is measured
    planner = Planner(offered, SOLVERS[estimator.method], asked, lasts_s)
    visit_s = wish.visit_s or {}
    hours = np.array([visit_s.get(telescope.name, wish.visit_default_s) / HOUR_S for telescope in scene.telescopes])
    say(f"scoring {planner.count} candidate epochs")
    return _found(scene, wish, planner, asked, estimator.name, hours)


def _require_exposures(wish: Wish) -> float:
    """How long a visit lasts, s, from its first exposure to its last; InputError if its numbers do not go together."""
    if not 1 <= wish.exposures <= MOST_EXPOSURES:
        raise InputError(f"--exposures: {wish.exposures} is out of range (allowed 1 to {MOST_EXPOSURES})")
    if (wish.exposures > 1) != (wish.spacing_s > 0.0):
        raise InputError('--spacing: goes with --exposures: several of them, and the time to the next, as "1 min"')
    lasts = (wish.exposures - 1) * wish.spacing_s
    times = {"each visit": wish.visit_default_s, **(wish.visit_s or {})}
    for name, time in times.items():
        if lasts > time:
            raise InputError(
                f"--visit-time: {wish.exposures} exposures last {lasts / HOUR_S:.3g} h, longer than the "
                f"{time / HOUR_S:.3g} h of {name}; give more time or less spacing"
            )
    return lasts


def _named(mission: Mission, part: str, option: str, name: str) -> Any:
    """The prediction, estimator or telescope of a name."""
    rows = getattr(mission, part)
    for row in rows:
        if row.name == name:
            return row
    names = [row.name for row in rows]
    near = difflib.get_close_matches(name, names, 1)
    hint = f"did you mean {near[0]!r}?" if near else f"there are: {', '.join(names) or 'none'}"
    raise InputError(f"{option}: this mission has no {part.removesuffix('s')} {name!r}; {hint}")


def _found(
    scene: PlannedScene, wish: Wish, planner: Planner, asked: Quantity, estimator: str, hours: Array
) -> dict[str, Any]:
    """What plan.json holds."""
    offered, each_hours = planner.offered, hours[planner.offered.telescope]
    a, d = planner.each(planner.belief, [])
    scores: dict[Criterion, Array] = {"a": a, "d": d}
    now: dict[Criterion, float] = dict(zip(scores, planner.now()))
    greedy: dict[Criterion, list[int]] = {name: planner.greedy(wish.visits, each_hours, name) for name in scores}
    worst = None
    for name in WORST:
        if wish.criterion == name:
            worst = WorstCase(offered, planner.W, planner.belief.names, name, planner.overlapping)
            scores[name], now[name] = worst.each([]), worst.after([])
            greedy[name] = worst.best(wish.visits, each_hours, scores[name])
    best = {
        name: _visit(scene, planner, int(np.argmax(_rate(now[name], scores[name], each_hours))), scores, now)
        for name in scores
    }
    rates = _rate(now[wish.criterion], scores[wish.criterion], each_hours)
    windows = [_window(scene, planner, number, rates, scores, now) for number in np.unique(offered.telescope).tolist()]
    reached = worst.along if worst is not None else None
    unit = asked.unit
    per_arc = [s.name for s in scene.mission.sources if getattr(s.error, "correlation", "") == "per_arc"]
    return {
        "schema_version": SCHEMA_VERSION,
        "mission": scene.mission.name,
        "mission_sha256": scene.mission.sha256,
        "title": scene.mission.title or scene.mission.name,
        "object": scene.mission.object.name,
        "prediction": {"name": asked.request.name, "plane": asked.request.plane, "epoch_tdb": asked.epoch.iso()},
        "unit": unit,
        "estimator": estimator,
        "criterion": wish.criterion,
        "n_observations": int(offered.problem.n - offered.rows.size),
        "n_candidates": planner.count,
        "exposures": wish.exposures,
        "spacing_s": wish.spacing_s,
        "visit_hours": {telescope.name: float(h) for telescope, h in zip(scene.telescopes, hours)},
        "sigma_now": now,
        **({} if worst is None else {"sigma_of_all_candidates": worst.floor()}),
        "best_next": best,
        "windows": sorted(windows, key=lambda row: -row["reduction_per_hour"]),
        "never_visible": [t.name for t, seen in zip(scene.telescopes, offered.visible_s) if not len(seen)],
        "greedy": {name: _schedule(scene, planner, greedy[name], wish.criterion, reached) for name in greedy},
        "uniform": _schedule(scene, planner, planner.even(wish.visits), wish.criterion, reached),
        "curves": _curves(scene, planner, scores),
        "warnings": [
            f"{name}: arcs are told apart by gaps, and candidate epochs fill them; its arcs are those of all epochs"
            for name in per_arc
        ],
    }


def _visit(
    scene: PlannedScene,
    planner: Planner,
    number: int,
    scores: Mapping[Criterion, Array],
    now: Mapping[Criterion, float],
) -> dict[str, Any]:
    """One candidate and what it gives."""
    return {
        "telescope": scene.telescopes[planner.offered.telescope[number]].name,
        "epoch_tdb": (scene.epoch + float(planner.offered.t_s[number])).iso(digits=0),
        "sigma_after": {name: float(sigma[number]) for name, sigma in scores.items()},
        "reduction_percent": {name: 100.0 * (1.0 - float(sigma[number]) / now[name]) for name, sigma in scores.items()},
    }


def _window(
    scene: PlannedScene,
    planner: Planner,
    telescope: int,
    rates: Array,
    scores: Mapping[Criterion, Array],
    now: Mapping[Criterion, float],
) -> dict[str, Any]:
    """The best epoch of a telescope and the epochs around it that are nearly as good, without a gap."""
    mine = np.flatnonzero(planner.offered.telescope == telescope)
    best = int(np.argmax(rates[mine]))
    good = rates[mine] >= WINDOW * rates[mine][best]
    first, last = best, best
    while first > 0 and good[first - 1]:
        first -= 1
    while last + 1 < mine.size and good[last + 1]:
        last += 1
    t_s, seen = planner.offered.t_s[mine], planner.offered.visible_s[telescope]
    return {
        **_visit(scene, planner, int(mine[best]), scores, now),
        "window_tdb": [(scene.epoch + float(t)).iso(digits=0) for t in t_s[[first, last]]],
        "visible_tdb": [[(scene.epoch + float(t)).iso(digits=0) for t in one] for one in seen],
        "reduction_per_hour": float(rates[mine][best]),
    }


def _schedule(
    scene: PlannedScene,
    planner: Planner,
    taken: Sequence[int],
    criterion: Criterion,
    reached: Callable[[Sequence[int]], list[float]] | None,
) -> list[dict[str, Any]]:
    """Visits in the order they are chosen, and the sigmas after each."""
    worst = reached(taken) if reached is not None else None
    return [
        {
            "telescope": scene.telescopes[planner.offered.telescope[number]].name,
            "epoch_tdb": (scene.epoch + float(planner.offered.t_s[number])).iso(digits=0),
            "sigma_after": {"a": a, "d": d} | ({} if worst is None else {criterion: worst[k]}),
        }
        for k, (number, (a, d)) in enumerate(zip(taken, planner.along(taken)))
    ]


def _curves(scene: PlannedScene, planner: Planner, scores: Mapping[Criterion, Array]) -> list[dict[str, Any]]:
    """For a figure: sigma after one visit against its epoch, by telescope."""
    rows = []
    for number in np.unique(planner.offered.telescope).tolist():
        mine = planner.offered.telescope == number
        rows.append(
            {
                "telescope": scene.telescopes[number].name,
                "epoch_s": planner.offered.t_s[mine].tolist(),
                "epoch_tdb": [(scene.epoch + float(t)).iso(digits=0) for t in planner.offered.t_s[mine]],
                "sigma_after": {name: values[mine].tolist() for name, values in scores.items()},
            }
        )
    return rows
