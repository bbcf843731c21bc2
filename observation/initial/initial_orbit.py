"""A first orbit from directions alone: Gauss's method on many triplets, systematic ranging beside it.

Spans of several lengths are cut out of the observations, each where most nights lie. On each one orbits come from
Gauss's method on triplets of its beginning, middle and end, from a coarse grid of distances and range rates, and from
the spans before; all are improved by least squares over the span, robust against gross errors, with the pull of Earth,
Moon and Jupiter. When two spans have led to one orbit, the search ends. Candidates are ranked by how well they fit and
by the length of the span: a long one fixes the orbit better. For arcs of one night, or where nothing fits, a fine grid
is searched. An orbit given back here fits a span to some arcseconds; it is where a fit starts, not a result.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nebosvod.dynamics.constants import AU_KM, DAY_S
from nebosvod.dynamics.twobody_many import fly
from nebosvod.observation.contracts import Array, Ephemeris, Rows, Texts
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.initial.gauss import gauss
from nebosvod.observation.initial.short_arc import Attributable, attributable, ranging
from nebosvod.observation.initial.two_body_fit import KEPT, Arc, costs, improve, residuals, shifts, trimmed_rms
from nebosvod.observation.reduction.weights import weigh
from nebosvod.timescale import Epoch
from nebosvod.units import ARCSEC

__all__ = ["Attributable", "StartingOrbit", "attributable", "candidates", "searches"]

SPANS_D = (8.5, 17.0, 3.5, 32.0, 1.3, 60.0, 0.15, 150.0)  # in the order in which they are tried
COMMON_D, LONGEST_D = 60.0, 400.0  # the whole arc is a span of its own: the first one, or the last
MOST_ROWS = 30  # directions of a span that are used
TRIPLETS = 6
IMPROVED, GRIDDED, CARRIED = 5, 4, 2  # orbits of Gauss, of the coarse grid, of another span that least squares takes on
MOST = 8  # candidates given back
FITS = 1.5  # trimmed rms, in sigmas, of a candidate that needs no rival
GOOD = 2.0  # of one that fits
RIVAL = 25.0  # an orbit whose chi squared is larger than that of the best of its span by this comes after other spans
HOPELESS = 20.0  # above which a candidate is left out, unless all are like that
SHORT_D = 0.5  # an arc of one night: its distance is hardly known, so the fine grid is searched
SAME = 0.02  # of the distance: orbits nearer to each other are one
PRECISE_ARCSEC = 1.6
# What is added to chi squared of an orbit that is rarer than one in the main belt: near the Earth's orbit, beyond
# Jupiter, one that nearly follows the Earth (where Gauss's equation has its false root), one not bound to the Sun
NEAR, FAR, EARTHLIKE, UNBOUND = 3.0, 3.0, 8.0, 12.0
SECOND_D = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StartingOrbit:
    """Where a fit may start.

    Attributes
    ----------
    state : (6,) heliocentric ICRF, km and km/s, at `epoch` + `t_s`.
    epoch, t_s : the epoch of the records, and TDB seconds after it.
    rms_arcsec : root mean square of the residuals over the span, without the worst fifth.
    merit : the same in sigmas.
    triplet : row numbers of the three observations the orbit came from; of a grid: first, middle, last.
    span_s : length of the span that was fitted.
    method : "Gauss" or "ranging".
    """

    state: Array
    epoch: Epoch
    t_s: float
    rms_arcsec: float
    merit: float
    triplet: tuple[int, int, int]
    span_s: float
    method: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Found:
    """Orbits of one span, best first: states (k, 6) in au and au/d at the arc's middle, their fit in sigmas, its chi
    squared with what their rarity adds, their triplets."""

    arc: Arc
    rows: Rows
    states: Array
    merit: Array
    score: Array
    triplets: Rows
    method: Texts


def candidates(astrometry: Astrometry, observer_states: Array, ephemeris: Ephemeris) -> tuple[StartingOrbit, ...]:
    """Starting orbits of one object, best first; empty if there are fewer than three times or nothing fits.

    Parameters
    ----------
    astrometry : records of one object, in any order.
    observer_states : shape (n, 6), barycentric ICRF, km and km/s (`observers.telescopes`).

    Notes
    -----
    What is known when this gives nothing: `attributable`.
    """
    *_, last = ((), *searches(astrometry, observer_states, ephemeris))
    return last


def searches(
    astrometry: Astrometry, observer_states: Array, ephemeris: Ephemeris
) -> Iterator[tuple[StartingOrbit, ...]]:
    """The same after each span that is searched, of all spans so far: the first may be as good as all, and takes less.

    It ends when two spans have led to one orbit, or with the last span.
    """
    order = np.argsort(astrometry.t_s, kind="stable")
    if np.unique(astrometry.t_s).size < 3:
        return
    sigma = np.empty((len(astrometry), 2))
    sigma[...] = weigh(astrometry, night_limit=None).sigma_rad
    found: list[_Found] = []
    for rows in spans(astrometry.t_s[order] / DAY_S, np.max(sigma[order], axis=1)):
        mine = order[rows]
        arc = Arc.of(
            astrometry.epoch, astrometry.t_s[mine], astrometry.psi[mine], sigma[mine], observer_states[mine], ephemeris
        )
        found.append(_search(arc, mine, _observer_velocity(arc, mine, observer_states, astrometry, ephemeris), found))
        settled = _settled(found)
        yield _ranked(found, astrometry)
        if settled:
            return


def _settled(found: list[_Found]) -> bool:
    """Whether the last span has led to an orbit that fits, and one before it to the same."""
    last = found[-1]
    if not (last.merit < FITS).any():
        return False
    best = last.states[0]
    for other in found[:-1]:
        if (other.merit < FITS).any():
            there = fly(other.states[:1], np.array([last.arc.t0 - other.arc.t0]), last.arc.gm)[0]
            if np.linalg.norm(there[:3] - best[:3]) < SAME * _distance(last.arc, best[None])[0]:
                return True
    return False


def spans(t: Array, sigma: Array) -> tuple[Rows, ...]:
    """Rows of each span to try, in the order of SPANS_D, at most MOST_ROWS of each.

    Parameters
    ----------
    t : shape (n,), ascending, d; sigma : shape (n,), rad: the precise observations come first.
    """
    precise = np.flatnonzero(sigma <= max(PRECISE_ARCSEC * ARCSEC, float(np.median(sigma))))
    if np.unique(t[precise]).size < 3:
        precise = np.arange(t.size)
    time = t[precise]
    total = float(np.ptp(time))
    lengths = [length for length in SPANS_D if length < total]
    if total < COMMON_D:
        lengths.insert(0, total)
    elif total < LONGEST_D:
        lengths.append(total)
    chosen: list[Rows] = []
    for length in dict.fromkeys(lengths):
        first, last = _fullest(time, length)
        rows = precise[first:last]
        if np.unique(t[rows]).size < 3 or any(np.array_equal(_thinned(t, rows), other) for other in chosen):
            continue
        chosen.append(_thinned(t, rows))
    if not chosen:
        chosen.append(_thinned(t, precise))
    return tuple(chosen)


def _fullest(t: Array, length: float) -> tuple[int, int]:
    """Ends of the window of a length that is covered best: in most tenths, then by the longest reach."""
    last = np.searchsorted(t, t + 1.0001 * length, side="right")
    tenth = np.floor(10.0 * t / length)
    new = np.concatenate([[0], np.cumsum(np.diff(tenth) > 0)])
    covered = new[last - 1] - new + 1
    covered = np.minimum(covered, 10) * (last - np.arange(t.size) >= 3)
    reach = (t[last - 1] - t) / length
    first = int(np.argmax(covered + reach + 1e-9 * np.arange(t.size)))
    return first, int(last[first])


def _thinned(t: Array, rows: Rows) -> Rows:
    """At most MOST_ROWS of the rows, both ends among them, spread over time first and over rows second."""
    if rows.size <= MOST_ROWS:
        return rows
    time = t[rows]
    by_time = np.searchsorted(time, np.linspace(time[0], time[-1], MOST_ROWS // 2))
    by_row = np.linspace(0, rows.size - 1, MOST_ROWS - MOST_ROWS // 2).astype(np.int64)
    kept: Rows = rows[np.unique(np.concatenate([np.minimum(by_time, rows.size - 1), by_row]))]
    return kept


def triplets(t: Array) -> Rows:
    """Triplets (m, 3) of numbers of ascending times: from the beginning, the middle and the end."""
    n = t.size
    end = max(1, n // 5)
    picks = []
    for k in range(TRIPLETS):
        first, last = k % end, n - 1 - (2 * k + k // end) % end
        target = t[first] + (t[last] - t[first]) * (0.5, 0.4, 0.6, 0.5, 0.3, 0.7)[k % 6]
        between = np.arange(first + 1, last)
        between = between[(t[between] - t[first] > SECOND_D) & (t[last] - t[between] > SECOND_D)]
        if between.size:
            near = between[np.argsort(np.abs(t[between] - target), kind="stable")]
            picks.append((first, int(near[(k // 3) % near.size]), last))
    return np.array(list(dict.fromkeys(picks)), dtype=np.int64).reshape(-1, 3)


def _search(arc: Arc, rows: Rows, observer_velocity: Array, before: list[_Found]) -> _Found:
    """The orbits of a span, from all places there are to start from, improved."""
    middle = int(np.argmin(np.abs(arc.t - arc.t0)))
    picks = triplets(arc.t)
    first, when, parent = gauss(arc.u[picks], arc.q[picks], arc.t[picks], arc.gm)
    known = [fly(one.states[:CARRIED], np.array([arc.t0 - one.arc.t0]), arc.gm) for one in before]
    short = np.ptp(arc.t) < SHORT_D
    grid = ranging(arc, observer_velocity, keep=2 * IMPROVED if short else GRIDDED, fine=bool(short))
    states = np.concatenate([fly(first, arc.t0 - when, arc.gm), *known, grid])
    spread = np.repeat(rows[None, [0, middle, -1]], len(grid), axis=0)
    taken = np.concatenate([rows[picks[parent]], *(one.triplets[:CARRIED] for one in before), spread])
    whence = [
        np.repeat("Gauss", len(first)),
        *(one.method[:CARRIED] for one in before),
        np.repeat("ranging", len(grid)),
    ]
    method = np.concatenate(whence)
    with np.errstate(all="ignore"):
        cost = costs(residuals(arc, states, shifts(arc, states)))
    gridded = np.arange(len(states)) >= len(states) - len(grid)
    chosen = np.concatenate(
        [
            _distinct(arc, states, np.where(gridded, np.inf, cost), IMPROVED),
            _distinct(arc, states, np.where(gridded, cost, np.inf), 2 * IMPROVED if short else GRIDDED),
        ]
    )
    return _improved(arc, rows, states[chosen], taken[chosen], method[chosen])


def _observer_velocity(
    arc: Arc, rows: Rows, observer_states: Array, astrometry: Astrometry, ephemeris: Ephemeris
) -> Array:
    """Velocity (3,) of the observer about the Sun at the middle of the arc, au/d."""
    middle = rows[int(np.argmin(np.abs(arc.t - arc.t0)))]
    sun = ephemeris.state_km_km_s("sun", astrometry.epoch, astrometry.t_s[middle : middle + 1])
    return np.asarray((observer_states[middle, 3:] - sun[0, 3:]) * (DAY_S / AU_KM))


def _improved(arc: Arc, rows: Rows, states: Array, picks: Rows, method: Texts) -> _Found:
    """Orbits after least squares over the span, with their fit; what diverged is left out. `picks` are record rows."""
    if len(states):
        states, _ = improve(arc, states)
    with np.errstate(all="ignore"):
        merit = trimmed_rms(residuals(arc, states, shifts(arc, states))) if len(states) else np.empty(0)
    score = merit**2 * (KEPT * 2 * arc.t.size) + rarity(states, arc.gm)
    kept = _distinct(arc, states, score, MOST)
    return _Found(
        arc=arc,
        rows=rows,
        states=states[kept],
        merit=merit[kept],
        score=score[kept],
        triplets=picks[kept],
        method=method[kept],
    )


def rarity(states: Array, gm: float) -> Array:
    """What to add to chi squared (k,) of orbits for how rare their kind is among the objects that are observed.

    It decides between orbits that fit alike, and nothing where the observations tell them apart.
    """
    r, v = states[:, :3], states[:, 3:]
    with np.errstate(all="ignore"):
        radius = np.linalg.norm(r, axis=1)
        a = 1.0 / (2.0 / radius - np.sum(v * v, axis=1) / gm)
        h2 = np.sum(np.cross(r, v) ** 2, axis=1)
        e = np.sqrt(np.maximum(1.0 - h2 / (gm * a), 0.0))
        near, far = a * (1.0 - e) < 1.3, a > 5.5
        earthlike = (np.abs(a - 1.0) < 0.1) & (e < 0.1)
    added = np.where(near, NEAR, 0.0) + np.where(far, FAR, 0.0) + np.where(earthlike, EARTHLIKE, 0.0)
    return np.where(a > 0.0, added, UNBOUND)


def _distance(arc: Arc, states: Array) -> Array:
    """Distance (k,) of the object from the observer at the middle of the arc, au."""
    middle = int(np.argmin(np.abs(arc.t - arc.t0)))
    return np.asarray(np.linalg.norm(states[:, :3] - arc.q[middle], axis=1))


def _distinct(arc: Arc, states: Array, cost: Array, most: int) -> Rows:
    """Numbers of the cheapest states with finite cost that are not the same orbit twice."""
    distance = _distance(arc, states)
    chosen: list[int] = []
    for number in np.argsort(cost, kind="stable").tolist():
        if len(chosen) == most or not np.isfinite(cost[number]):
            break
        gaps = np.linalg.norm(states[chosen, :3] - states[number, :3], axis=1)
        if np.isfinite(states[number]).all() and np.all(gaps > SAME * distance[number]):
            chosen.append(number)
    rows: Rows = np.array(chosen, dtype=np.int64)
    return rows


def _ranked(found: list[_Found], astrometry: Astrometry) -> tuple[StartingOrbit, ...]:
    """All candidates, those that fit first, among them those of the longest spans; at most MOST."""
    flat = [(one, k) for one in found for k in range(len(one.states))]
    if not flat:
        return ()
    least = min(float(one.merit[k]) for one, k in flat)
    flat = [(one, k) for one, k in flat if one.merit[k] <= max(HOPELESS, 20.0 * least)]

    def key(item: tuple[_Found, int]) -> tuple[bool, float, float]:
        one, k = item
        fits = bool(one.merit.min() <= max(GOOD, 3.0 * least) and one.score[k] <= one.score[0] + RIVAL)
        return not fits, -float(np.ptp(one.arc.t)) if fits else 0.0, float(one.score[k])

    orbits = []
    for one, k in sorted(flat, key=key)[:MOST]:
        with np.errstate(all="ignore"):
            state = one.states[k : k + 1]
            v = residuals(one.arc, state, shifts(one.arc, state)) * one.arc.sigma.ravel()
        scale = np.repeat([AU_KM, AU_KM / DAY_S], 3)
        orbits.append(
            StartingOrbit(
                state=one.states[k] * scale,
                epoch=astrometry.epoch,
                t_s=one.arc.t0 * DAY_S,
                rms_arcsec=float(trimmed_rms(v)[0]) * 648000.0 / np.pi,
                merit=float(one.merit[k]),
                triplet=(int(one.triplets[k, 0]), int(one.triplets[k, 1]), int(one.triplets[k, 2])),
                span_s=float(np.ptp(one.arc.t)) * DAY_S,
                method=str(one.method[k]),
            )
        )
    return tuple(orbits)
