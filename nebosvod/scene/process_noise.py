"""Process noise of the asteroid on its reference orbit: when its intervals are, and how far it reaches."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Trajectory
from nebosvod.mission import Mission
from nebosvod.mission.uncertainty import ProcessNoise as Said
from nebosvod.observation import Nuisance, ProcessNoise, Reach
from nebosvod.scene.declared import Declared, as_assumed

Array = npt.NDArray[np.float64]
FINER = 4  # nodes of the reach in each interval
GAUSS = np.polynomial.legendre.leggauss(4)
PUSH = np.vstack([np.zeros((3, 3)), np.eye(3)])


def noise_over(name: str, said: Said, telescopes: tuple[str, ...], edges_s: Array) -> ProcessNoise:
    """The process noise that a file says, over some intervals."""
    return ProcessNoise(
        name=name, telescopes=telescopes, density_km2_s3=said.density_km2_s3, edges_s=edges_s, treatment=said.treatment
    )


def edges_of(mission: Mission, intervals: int) -> Array:
    """Edges of the intervals of a mission: over its schedule, and to its predictions."""
    times = np.concatenate([[0.0], *(mission.times_s(telescope.name) for telescope in mission.telescopes)])
    return edges(times, [one.when - mission.reference_epoch for one in mission.predictions], intervals)


def edges(measured_s: Array, asked_s: Sequence[float], intervals: int) -> Array:
    """Edges of the intervals, s after the reference epoch: over the measurements, a third as many beyond each end."""
    first, last = min(float(measured_s.min()), 0.0), max(float(measured_s.max()), 0.0)
    found: list[Array] = [np.linspace(first, last, intervals + 1), np.zeros(1)]
    for end in (min([first, *asked_s]), max([last, *asked_s])):
        near = first if end < first else last
        if end not in (first, last):
            found.append(np.linspace(near, end, intervals // 3 + 2))
    every = np.unique(np.concatenate(found))
    every = every[(np.abs(every) > 1.0) | (every == 0.0)]  # no interval runs over the epoch
    apart: Array = every[np.concatenate([[True], np.diff(every) > 1.0])]
    return apart


def reached(nuisance: Nuisance, trajectory: Trajectory) -> Nuisance:
    """A process noise with its reach on a trajectory; any other nuisance as it is."""
    if isinstance(nuisance, Declared) and isinstance(nuisance.assumed, ProcessNoise):
        assumed, true = (reached(one, trajectory) for one in (nuisance.assumed, nuisance.true))
        return replace(nuisance, assumed=assumed, true=true)
    if isinstance(nuisance, ProcessNoise):
        return replace(nuisance, reach=reach(trajectory, nuisance.edges_s))
    return nuisance


def reach(trajectory: Trajectory, edges_s: Array) -> Reach:
    """C(t) = integral of Phi(t0, s) [0; I] from t0 to t on a trajectory, by Gauss and Legendre's four points."""
    ends = np.clip(edges_s, *trajectory.span_s)
    fine = [np.linspace(a, b, FINER, endpoint=False) for a, b in itertools.pairwise(ends)]
    nodes = np.unique(np.concatenate([*fine, ends[-1:], [0.0]]))
    half = 0.5 * np.diff(nodes)[:, None]
    at = 0.5 * (nodes[:-1] + nodes[1:])[:, None] + half * GAUSS[0]
    parts = np.einsum("kg,kgij->kij", half * GAUSS[1], _slopes(trajectory, at.ravel()).reshape(*at.shape, 6, 3))
    whole = np.concatenate([np.zeros((1, 6, 3)), np.cumsum(parts, axis=0)])
    whole -= whole[np.searchsorted(nodes, 0.0)]
    return Reach(nodes_s=nodes, integral=whole, slope=_slopes(trajectory, nodes))


def process_noise_of(nuisances: Sequence[Nuisance]) -> ProcessNoise | None:
    """The process noise among some nuisances, as assumed."""
    return next((one for one in map(as_assumed, nuisances) if isinstance(one, ProcessNoise)), None)


def _slopes(trajectory: Trajectory, t_s: Array) -> Array:
    """Phi(t0, t) [0; I] (n, 6, 3): solved in units that make its columns alike."""
    Phi = trajectory.at(t_s).Phi
    unit = np.array([1.0, 1.0, 1.0, 1e-6, 1e-6, 1e-6])
    scaled = Phi / unit[:, None] * unit
    found: Array = np.linalg.solve(scaled, np.broadcast_to(PUSH / unit[:, None], (len(Phi), 6, 3))) * unit[:, None]
    return found
