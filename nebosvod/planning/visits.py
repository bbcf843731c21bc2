"""Visits that could still be made: when each telescope sees the object, and what its exposures there would measure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.engine.assembly import computed_psi, linear_problem, nominal_view
from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation import LinearProblem
from nebosvod.estimation.problem.subset import subset
from nebosvod.mission import Estimator
from nebosvod.observation import Visibility, visibility
from nebosvod.observation.measurement.exposures import row_order
from nebosvod.scene.imaging import imaged
from nebosvod.scene.prior import PriorTable
from nebosvod.scene.process_noise import reached
from nebosvod.scene.scene import PlannedScene, measured

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
MOST = 50_000
FEW = 4000  # candidate epochs where nobody asks for more
SAME_S = 1.0  # nearer, two exposures of a telescope are one


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidates:
    """The mission's measurements and, in one problem with them, the exposures of each visible candidate visit.

    Attributes
    ----------
    problem : all rows, the mission's and the candidates'.
    rows : (c, e) rows of the e exposures of each candidate in it; candidates by time, then telescope.
    telescope : (c,) numbers of the telescopes of the mission.
    t_s : (c,) first exposures, TDB seconds after the reference epoch.
    visible_s : for each telescope of the mission, first and last candidate epochs (w, 2) of each time without a gap
        in which it sees the object, s after the reference epoch.
    """

    problem: LinearProblem
    rows: npt.NDArray[np.int64]
    telescope: npt.NDArray[np.int64]
    t_s: Array
    visible_s: tuple[Array, ...]

    @property
    def base(self) -> LinearProblem:
        """The problem of the mission's own measurements."""
        return subset(self.problem, self._own())

    def with_one(self, taken: Sequence[int]) -> LinearProblem:
        """The problem of the mission's own measurements and some candidates, by their numbers."""
        keep = self._own()
        keep[self.rows[list(taken)]] = True
        return subset(self.problem, keep)

    def _own(self) -> Mask:
        keep = np.ones(self.problem.n, dtype=bool)
        keep[self.rows] = False
        return keep


def grids(
    scene: PlannedScene,
    start_s: float | None,
    end_s: float | None,
    step_s: float | None,
    lasts_s: float = 0.0,
    until_s: float = -np.inf,
) -> tuple[list[Array], float]:
    """Candidate epochs of each telescope, and how far they must be from what it has measured already, s.

    Parameters
    ----------
    start_s : first epoch, s after the reference epoch; the first of the schedule when absent.
    end_s : last epoch; the last of the schedule, or `until_s` if that is later, when absent.
    step_s : from one epoch to the next; the closest spacing of the schedule, but at least 10 minutes and no more than
        FEW epochs of all telescopes, when absent.
    lasts_s : from the first exposure of a visit to its last; all lie before `end_s`.
    until_s : when what is predicted happens; afterwards no measurement foretells it.

    Raises
    ------
    InputError
        If the span is empty, beyond the orbit that the mission needs, or has too many epochs.
    """
    scheduled = [scene.mission.times_s(telescope.name) for telescope in scene.telescopes]
    every = np.unique(np.concatenate(scheduled))
    gaps = np.diff(every)
    low, high = scene.trajectory.span_s
    low += 3600.0  # light left the object before it was seen
    first = float(every[0]) if start_s is None else start_s
    last = end_s if end_s is not None else min(max(float(every[-1]), until_s), high)
    step = max(600.0, float(gaps.min()) if gaps.size else 86400.0)
    if step_s is not None:
        step = step_s
    elif last > first:
        step *= np.ceil((last - first) * len(scheduled) / FEW / step)
    if not low <= first <= last - lasts_s <= high - lasts_s:
        allowed = f"{scene.epoch + low} to {scene.epoch + high}"
        raise InputError(
            f"--from, --to: {scene.epoch + first} to {scene.epoch + last} is empty or beyond the orbit this mission "
            f"computes (allowed {allowed}); a later prediction makes the orbit longer"
        )
    count = int((last - lasts_s - first) / step + 1e-9) + 1
    if count * len(scheduled) > MOST:
        raise InputError(f"--step: {count * len(scheduled):,} candidate epochs are too many (allowed {MOST:,})")
    grid: Array = first + step * np.arange(count, dtype=np.float64)
    asked = start_s is not None or end_s is not None or step_s is not None
    return [grid for _ in scheduled], SAME_S if asked else 0.49 * step


def candidates(
    scene: PlannedScene,
    estimator: Estimator,
    priors: PriorTable,
    epochs: Sequence[Array],
    exposures: int = 1,
    spacing_s: float = 0.0,
    apart_s: float = 0.0,
) -> Candidates:
    """Observe the mission's epochs and the visible candidate visits, and assemble both into one problem.

    Parameters
    ----------
    epochs : for each telescope, when a visit can begin (c,), s after the reference epoch.
    exposures, spacing_s : of a visit; all its exposures must see the object.
    apart_s : a visit that begins nearer than this to what its telescope has measured already is none.

    Raises
    ------
    GeometryError
        If no telescope sees the object at any of them.
    """
    within = spacing_s * np.arange(exposures)
    visibilities, telescope, t_s, visit, windows = [], [], [], [], []
    starts: list[list[tuple[float, int]]] = []
    for number, own in enumerate(epochs):
        each = _seen(scene, number, (own[:, None] + within).ravel()).visible
        seen: Mask = np.asarray(each.reshape(own.size, exposures).all(axis=1))
        already = scene.visibilities[number]
        mine = already.t_s[already.visible]
        windows.append(_runs(own, seen))
        seen = seen & ~_measured(own, mine, apart_s)
        times = np.concatenate([mine, (own[seen][:, None] + within).ravel()])
        first = sum(len(one) for one in starts)
        numbers = np.repeat(first + np.arange(np.count_nonzero(seen)), exposures)
        order = np.argsort(times, kind="stable")
        # with nothing to measure at all, what the mission said of its own schedule stands: nothing was seen
        visibilities.append(_seen(scene, number, times[order]) if times.size else already)
        t_s.append(times[order])
        visit.append(np.concatenate([np.full(mine.size, -1), numbers])[order])
        telescope.append(np.full(times.size, number))
        starts.append([(float(t), number) for t in own[seen]])
    begun = np.array([one for part in starts for one in part], dtype=np.float64).reshape(-1, 2)
    if not len(begun):
        if any(len(window) for window in windows):
            text = "every candidate epoch at which the object is seen has been measured already"
            raise GeometryError(f"{scene.mission.name}: {text}; name others with --from, --to and --step")
        raise GeometryError(f"{scene.mission.name}: no telescope sees the object at any candidate epoch; widen them")
    wide = _with_sources(replace(scene, visibilities=tuple(visibilities)))
    nominal = nominal_view(wide, simulates=False)
    problem = linear_problem(wide, estimator, nominal, computed_psi(nominal), priors, about=nominal.point)
    whose = np.concatenate(visit)[row_order(np.concatenate(t_s), np.concatenate(telescope))]
    added = np.flatnonzero(whose >= 0)
    rows = added[np.argsort(whose[added], kind="stable")].reshape(len(begun), exposures)
    order = np.lexsort((begun[:, 1], begun[:, 0]))
    return Candidates(
        problem=problem,
        rows=rows[order],
        telescope=begun[order, 1].astype(np.int64),
        t_s=begun[order, 0],
        visible_s=tuple(windows),
    )


def _seen(scene: PlannedScene, number: int, t_s: Array) -> Visibility:
    """What a telescope sees of the object at some times (n,), which need not be in order."""
    magnitude = scene.mission.object.magnitude
    law = (magnitude.H, magnitude.G) if magnitude is not None else None
    return visibility(scene.telescopes[number], scene.trajectory, t_s, scene.ephemeris, law)


def _measured(epochs: Array, mine: Array, apart_s: float) -> Mask:
    """Which epochs (n,) lie nearer than `apart_s` to one of the measurements made (m,), ascending."""
    if not mine.size:
        return np.zeros(epochs.shape, dtype=np.bool_)
    after = np.minimum(np.searchsorted(mine, epochs), mine.size - 1)
    before = np.maximum(after - 1, 0)
    gap = np.minimum(np.abs(epochs - mine[after]), np.abs(epochs - mine[before]))
    near: Mask = gap < apart_s
    return near


def _runs(epochs: Array, seen: Mask) -> Array:
    """First and last (w, 2) of the epochs of each unbroken run that is seen."""
    edges = np.diff(np.concatenate([[False], seen, [False]]).astype(np.int64))
    return np.stack([epochs[np.flatnonzero(edges == 1)], epochs[np.flatnonzero(edges == -1) - 1]], axis=1)


def _with_sources(scene: PlannedScene) -> PlannedScene:
    """The scene with the sources of every telescope that now measures something."""
    exposures, sources, nuisances = measured(scene.mission, scene.telescopes, scene.visibilities, scene.ephemeris)
    exposures = imaged(scene.mission, exposures, scene.trajectory)
    nuisances = tuple(reached(one, scene.trajectory) for one in nuisances)
    return replace(scene, exposures=exposures, sources=sources, nuisances=nuisances)
