"""Many records of one station as a few that say the same: a night's five hundred cost what a dozen do.

What is seen of an orbit from one place is smooth: over a night a polynomial of a dozen coefficients. Records y_i with
weights w_i are then worth their projection upon such polynomials, read at the K nodes of the Gaussian quadrature of the
times weighed by w: the sum of w_i (y_i - f_i)^2 differs from that of W_c (y_c - f_c)^2 by what does not depend on f,
for the square of a polynomial of degree K - 1 is summed exactly. So the K are independent of each other, with variances
1 / W_c. What is not smooth, or weighed by matrices that are neither alike nor diagonal, stays as it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.first_hour.conditional import RATE, Conditional, Nodes
from nebosvod.first_hour.quadrature import Quadrature
from nebosvod.first_hour.region import Region
from nebosvod.first_hour.sight import Flights, lines
from nebosvod.first_hour.tangent import angles, directions
from nebosvod.first_hour.tracklet import Columns, Tracklet
from nebosvod.observation.measurement.exposures import Exposures

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
FEW = 12  # records that are not worth it
COUNTS = (6, 8, 11, 15, 20)  # of nodes, tried in turn
PLACE_KM = 1e-5  # to which a polynomial gives the places of the observer
EXACT_RAD = 1e-9  # to which it gives the directions of orbits that may be
SMOOTH = 1e-7  # to which it gives axes, and, of the largest, how a nuisance acts
UNMEASURED_RAD = 30.0  # sigma of the axis that a node says nothing of
RATE_SHARE = 1e-3  # of the noise, by which that of single times may differ from record to record
SEARCHED = 40  # ranges at which orbits are looked for
MAY_BE = 40.0  # of chi squared above the best


def searched(conditional: Conditional, region: Region) -> Nodes:
    """The best orbits at ranges over all of the region, at range rates that there are: up to those of hyperbolas.

    A curvature that is noise, or that of an orbit nearby, fits far away at a thousand km/s: such an orbit is none, and
    least squares about it lead anywhere.
    """
    low, high = region.ranges(conditional.tracklet)
    x = np.linspace(low, high, SEARCHED)
    begin, end = region.rates(conditional, conditional.first(x, np.zeros(SEARCHED)))
    middle = np.where(np.isfinite(begin), 0.5 * (begin + end), 0.0)
    half = np.where(np.isfinite(begin), np.maximum(end - begin, 1.0), 30.0)
    free = conditional.solve(conditional.first(x, middle), 1, (middle, half))
    start = free.coordinates.copy()
    begin, end = replace(region, bound=False).rates(conditional, start)
    start[:, RATE] = np.clip(start[:, RATE], np.nan_to_num(begin, nan=-np.inf), np.nan_to_num(end, nan=np.inf))
    start[:, 2:] += (start[:, RATE] - free.coordinates[:, RATE])[:, None] * free.drift[:, -4:]
    return conditional.solve(start, 2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Few:
    """What stands for a tracklet.

    Attributes
    ----------
    tracklet : of few records; the whole one where fewer gain nothing.
    orbits : the best at ranges over all of the region; None where none were looked for.
    states : (m, 6) those of orbits that may be, of which directions were compared.
    """

    tracklet: Tracklet
    orbits: Nodes | None = None
    states: Array | None = None


def condensed(tracklet: Tracklet, region: Region, before: Few | None = None) -> Few:
    """A tracklet of few records that says the same of every orbit of a region.

    Parameters
    ----------
    before : that of nearly the same records, whose orbits are compared again.

    Notes
    -----
    The reference time stays. The directions of orbits that fit are compared with their polynomials at all records, to
    1e-9 rad, and more nodes are taken until they agree.
    """
    states = None if before is None else before.states
    if len(tracklet) <= FEW:
        return Few(tracklet=tracklet)
    index = tracklet.exposures.telescope_index
    stations = [np.flatnonzero(index == k) for k in np.unique(index)]
    for k in range(len(COUNTS)):
        parts = [part for rows in stations for part in _parts(tracklet, rows, COUNTS[k:])]
        if sum(len(part.observed) for part in parts) > 0.8 * len(tracklet):
            break
        found = _joined(tracklet, parts)
        if states is not None and not all(_follows(tracklet, part, states) for part in parts):
            continue
        if before is not None:
            return Few(tracklet=found, states=states)
        orbits = searched(Conditional(found), region)
        near = np.isfinite(orbits.chi2) & (orbits.chi2 < orbits.chi2.min() + MAY_BE)
        if not near.any():
            continue
        states = Conditional(found).states(orbits.coordinates[near])
        if all(_follows(tracklet, part, states) for part in parts):
            return Few(tracklet=found, orbits=orbits, states=states)
    return Few(tracklet=tracklet)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Part:
    """What stands for some records: c nodes, or, where there is no quadrature, themselves.

    Attributes
    ----------
    rows : (r,) the records. exposures, observed, columns : of what stands for them. left : chi squared of the records
    about the polynomial.
    """

    rows: Rows
    exposures: Exposures
    observed: Array
    columns: Columns
    quadrature: Quadrature | None = None
    left: float = 0.0


def _parts(tracklet: Tracklet, rows: Rows, counts: Sequence[int]) -> list[_Part]:
    """What stands for the records of a station: as few nodes as give what is smooth of it, or the records."""
    exposures = tracklet.exposures.select(rows)
    times = len(np.unique(exposures.t_s))
    for count in counts:
        if times <= count + 2:
            break
        found = _by_axes(tracklet, rows, count)
        if found:
            return found
    return [
        _Part(rows=rows, exposures=exposures, observed=tracklet.observed[rows], columns=tracklet.columns.select(rows))
    ]


def _by_axes(tracklet: Tracklet, rows: Rows, count: int) -> list[_Part]:
    """Nodes for both axes together where all records are weighed alike, or for each; none if something forbids it."""
    exposures = tracklet.exposures.select(rows)
    R = exposures.noise()
    weight = 2.0 / np.trace(R, axis1=1, axis2=2)
    shape, late = R * weight[:, None, None], exposures.timing_sigma_s**2 * weight
    if np.ptp(shape, axis=0).max() < 1e-9 and np.ptp(late) <= 1e-9 * late.max():
        found = [_nodes(tracklet, rows, count, weight, shape[0], float(late[0]))]
    elif not (R[:, 0, 1].any() or late.any()):
        found = [_nodes(tracklet, rows, count, 1.0 / R[:, k, k], np.eye(2), 0.0, k) for k in (0, 1)]
    else:
        return []
    parts = [part for part in found if part is not None]
    return parts if len(parts) == len(found) else []


def _nodes(
    tracklet: Tracklet, rows: Rows, count: int, weight: Array, shape: Array, late: float, axis: int | None = None
) -> _Part | None:
    """Nodes for records whose covariance is `shape` (2, 2) / `weight` (r,); None where something is not smooth.

    Parameters
    ----------
    late : variance of the time of a record times its weight, s^2. axis : the one that is measured; both where None.
    """
    exposures, columns = tracklet.exposures, tracklet.columns.select(rows)
    held = axis in (None, 0) and tracklet.reference in rows
    found = Quadrature.of(exposures.t_s[rows], weight, count, 0.0 if held else None)
    if found is None:  # with an even number a node held in the middle drives another one out
        count += 1
        found = Quadrature.of(exposures.t_s[rows], weight, count, 0.0 if held else None)
    if found is None:
        return None
    u = directions(tracklet.observed[rows])
    centre = angles(_unit(found.onto @ u))
    along = angles(_unit(found.back @ (found.onto @ u)))  # of the records, on a smooth way
    axes, at_nodes = _axes(along), _axes(centre)
    offset = _offset(axes, u)
    shift = found.onto @ offset
    measured = [0, 1] if axis is None else [axis]
    scatter = (offset - found.back @ shift)[:, measured]
    metric = np.linalg.solve(shape[np.ix_(measured, measured)], scatter.T).T
    place = exposures.observer[rows] - exposures.observer[rows[0]]
    smooth = (
        _fits(found, place[:, :3], PLACE_KM)
        and np.abs(found.back @ at_nodes.reshape(count, -1) - axes.reshape(len(rows), -1)).max() < SMOOTH
        and all(_fits(found, part, SMOOTH * np.abs(part).max(initial=0.0)) for part in _acts(columns))
        and _steady(exposures.t_s[rows], along, late, shape)
    )
    if not smooth:
        return None
    sigma = np.sqrt(np.diag(shape) / found.weight[:, None])
    for k in {0, 1} - set(measured):
        sigma[:, k] = UNMEASURED_RAD
    seen = Exposures.at(
        exposures.epoch, found.t_s, exposures.observer[rows[0]] + found.onto @ place,
        tracklet.forces.ephemeris, telescopes=exposures.telescopes,
        telescope_index=np.full(count, exposures.telescope_index[rows[0]]), sigma_rad=sigma,
        correlation=0.0 if axis is not None else shape[0, 1] / np.sqrt(shape[0, 0] * shape[1, 1]),
        timing_sigma_s=np.sqrt(late / found.weight),
    )  # fmt: skip
    observed = angles(_moved(at_nodes, shift))
    acts = [np.einsum("cr,r...->c...", found.onto, part) for part in _acts(columns)]
    if axis is not None:
        acts[0][:, 1 - axis] = 0.0
    return _Part(
        rows=rows, exposures=seen, observed=observed, quadrature=found,
        columns=replace(columns, bias=acts[0], clock=acts[1], place=acts[2]),
        left=float(weight @ np.sum(scatter * metric, axis=1)),
    )  # fmt: skip


def _acts(columns: Columns) -> tuple[Array, Array, Array]:
    return columns.bias, columns.clock, columns.place


def _fits(found: Quadrature, values: Array, tolerance: float) -> bool:
    """Whether values (r, ...) at the times are a polynomial."""
    flat = values.reshape(len(values), -1)
    return bool(np.abs(found.back @ (found.onto @ flat) - flat).max(initial=0.0) <= tolerance)


def _steady(t_s: Array, along: Array, late: float, shape: Array) -> bool:
    """Whether what errors of single times add to the noise is the same all the way, to a thousandth of it."""
    if not late > 0.0:
        return True
    order = np.argsort(t_s, kind="stable")
    east = np.unwrap(along[order, 0]) * np.cos(along[order, 1])
    rate = np.stack([np.gradient(east), np.gradient(along[order, 1])], axis=1) / np.gradient(t_s[order])[:, None]
    return bool(late * np.ptp(np.sum(rate**2, axis=1)) < RATE_SHARE * shape.trace())


def _joined(tracklet: Tracklet, parts: list[_Part]) -> Tracklet:
    """All parts in the order of time, about the reference time of the tracklet."""
    names = ("t_s", "observer", "sun", "sun_pull", "sigma_rad", "correlation", "timing_sigma_s", "telescope_index")
    rows: dict[str, Any] = {n: np.concatenate([getattr(part.exposures, n) for part in parts]) for n in names}
    image = None
    if tracklet.exposures.image is not None:
        own = [part.exposures.image for part in parts]
        image = np.concatenate([np.zeros((len(p.observed), 2, 2)) if i is None else i for p, i in zip(parts, own)])
    order = np.argsort(rows["t_s"], kind="stable")
    acts = [np.concatenate(part)[order] for part in zip(*(_acts(part.columns) for part in parts), strict=True)]
    exposures = replace(tracklet.exposures, image=image, **rows).select(order)
    nearest = np.abs(exposures.t_s) + (exposures.sigma_rad[:, 0] >= UNMEASURED_RAD)
    return replace(
        tracklet, exposures=exposures, observed=np.concatenate([part.observed for part in parts])[order],
        columns=replace(tracklet.columns, bias=acts[0], clock=acts[1], place=acts[2]),
        reference=int(np.argmin(nearest)), left=tracklet.left + sum(part.left for part in parts),
    )  # fmt: skip


def _follows(tracklet: Tracklet, part: _Part, states: Array) -> bool:
    """Whether polynomials give the directions of orbits (m, 6) at all records."""
    if part.quadrature is None:
        return True
    exposures = tracklet.exposures.select(part.rows)
    at_records = _unit(lines(exposures, Flights(tracklet, exposures.t_s).fly(states))[0])
    at_nodes = _unit(lines(part.exposures, Flights(tracklet, part.exposures.t_s).fly(states))[0])
    away = np.einsum("rc,mci->mri", part.quadrature.back, at_nodes) - at_records
    return bool(np.abs(away).max() < EXACT_RAD)


def _unit(line: Array) -> Array:
    return np.asarray(line / np.linalg.norm(line, axis=-1, keepdims=True))


def _axes(psi: Array) -> Array:
    """East, north and the direction itself (n, 3, 3) of longitudes and latitudes (n, 2)."""
    u = directions(psi)
    north = directions(psi + np.array([0.0, 0.5 * np.pi]))
    return np.stack([np.cross(north, u), north, u], axis=1)


def _offset(axes: Array, u: Array) -> Array:
    """Angles (n, 2) east and north from a direction with its axes to others (n, 3)."""
    local = np.einsum("nij,nj->ni", axes, u)
    chord = np.hypot(local[:, 0], local[:, 1])
    stretch = np.where(chord > 1e-12, np.arctan2(chord, local[:, 2]) / np.maximum(chord, 1e-12), 1.0)
    return np.asarray(local[:, :2] * stretch[:, None])


def _moved(axes: Array, offset: Array) -> Array:
    """The inverse of `_offset`."""
    angle = np.hypot(offset[:, 0], offset[:, 1])
    local = np.column_stack([offset * np.sinc(angle / np.pi)[:, None], np.cos(angle)])
    return np.asarray(np.einsum("nij,ni->nj", axes, local))
