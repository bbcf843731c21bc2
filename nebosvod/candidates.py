"""Visits that could still be made: when each telescope sees the object, and what one exposure there would measure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.assembly import computed_psi, linear_problem, nominal_point, view
from nebosvod.errors import GeometryError, InputError
from nebosvod.estimation import LinearProblem
from nebosvod.estimation.subset import subset
from nebosvod.mission import Estimator
from nebosvod.observation import visibility
from nebosvod.prior import PriorTable
from nebosvod.scene import Scene, active_sources

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
MOST = 50_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidates:
    """The mission's measurements and, in one problem with them, one exposure at each visible candidate epoch.

    Attributes
    ----------
    problem : all rows, the mission's and the candidates'.
    rows : (c,) rows of the candidates in it, by time, then telescope.
    telescope : (c,) numbers of the telescopes of the mission.
    t_s : (c,) TDB seconds after the reference epoch.
    """

    problem: LinearProblem
    rows: npt.NDArray[np.int64]
    telescope: npt.NDArray[np.int64]
    t_s: Array

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


def grids(scene: Scene, start_s: float | None, end_s: float | None, step_s: float | None) -> list[Array]:
    """Candidate epochs of each telescope: the mission's own schedule, or a grid if anything is said.

    Parameters
    ----------
    start_s, end_s : first and last epoch, s after the reference epoch; those of the schedule when absent.
    step_s : from one epoch to the next; the closest spacing of the schedule, but at least 10 minutes, when absent.

    Raises
    ------
    InputError
        If the span is empty, beyond the orbit that the mission needs, or has too many epochs.
    """
    scheduled = [scene.mission.times_s(telescope.name) for telescope in scene.telescopes]
    if start_s is None and end_s is None and step_s is None:
        return scheduled
    every = np.unique(np.concatenate(scheduled))
    gaps = np.diff(every)
    step = step_s if step_s is not None else max(600.0, float(gaps.min()) if gaps.size else 86400.0)
    first = float(every[0]) if start_s is None else start_s
    last = float(every[-1]) if end_s is None else end_s
    low, high = scene.trajectory.span_s
    low += 3600.0  # light left the object before it was seen
    if not low <= first <= last <= high:
        allowed = f"{scene.epoch + low} to {scene.epoch + high}"
        raise InputError(
            f"--from, --to: {scene.epoch + first} to {scene.epoch + last} is empty or beyond the orbit this mission "
            f"computes (allowed {allowed}); a later prediction makes the orbit longer"
        )
    count = int((last - first) / step + 1e-9) + 1
    if count * len(scheduled) > MOST:
        raise InputError(f"--step: {count * len(scheduled):,} candidate epochs are too many (allowed {MOST:,})")
    grid: Array = first + step * np.arange(count, dtype=np.float64)
    return [grid for _ in scheduled]


def candidates(scene: Scene, estimator: Estimator, priors: PriorTable, epochs: Sequence[Array]) -> Candidates:
    """Observe the mission's epochs and the visible candidate epochs, and assemble both into one problem.

    Parameters
    ----------
    epochs : for each telescope, candidate times (c,), s after the reference epoch.

    Raises
    ------
    GeometryError
        If no telescope sees the object at any of them.
    """
    magnitude = scene.mission.object.magnitude
    law = (magnitude.H, magnitude.G) if magnitude is not None else None
    visibilities, telescope, t_s, added = [], [], [], []
    for number, (instrument, own) in enumerate(zip(scene.telescopes, epochs)):
        seen = visibility(instrument, scene.trajectory, own, scene.ephemeris, law)
        mine = scene.exposures_s(number)
        times = np.concatenate([mine, own[seen.visible]])
        order = np.argsort(times, kind="stable")
        visibilities.append(visibility(instrument, scene.trajectory, times[order], scene.ephemeris, law))
        t_s.append(times[order])
        added.append((np.arange(times.size) >= mine.size)[order])
        telescope.append(np.full(times.size, number))
    all_t, all_added, all_telescope = np.concatenate(t_s), np.concatenate(added), np.concatenate(telescope)
    if not all_added.any():
        raise GeometryError(f"{scene.mission.name}: no telescope sees the object at any candidate epoch; widen them")
    wide = _with_sources(replace(scene, visibilities=tuple(visibilities)))
    nominal = view(wide, nominal_point(wide), simulates=False)
    problem = linear_problem(wide, estimator, nominal, computed_psi(nominal), priors, about=nominal.point)
    order = np.lexsort((all_telescope, all_t))
    rows = np.flatnonzero(all_added[order])
    return Candidates(problem=problem, rows=rows, telescope=all_telescope[order][rows], t_s=all_t[order][rows])


def _with_sources(scene: Scene) -> Scene:
    """The scene with the sources of every telescope that now measures something."""
    sources, nuisances = active_sources(scene.mission, scene.telescopes, scene.visibilities)
    return replace(scene, sources=sources, nuisances=nuisances)
