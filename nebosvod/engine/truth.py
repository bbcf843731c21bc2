"""The simulated truth of a run: every uncertainty drawn by its own model, then measured through the full geometry."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.engine.assembly import computed_psi, drawn_noise, nominal_view, view
from nebosvod.observation import Common, Term, draw_truth, measure
from nebosvod.observation.uncertainty.term import root
from nebosvod.scene.point import Point, View
from nebosvod.scene.prior import PriorTable
from nebosvod.scene.scene import Scene

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """What was drawn, and what the telescopes then measured.

    Attributes
    ----------
    point : true state, parameters and common nuisances.
    nuisances : draws by source, (k,) for common ones, (r, q) for those of each exposure.
    psi : (n, 2) measured RA and Dec, rad.
    off : how far the means of priors that say next to nothing lie above what they were drawn to be, by parameter.
    priors : what is known beforehand in this truth.
    """

    point: Point
    nuisances: Mapping[str, Array]
    psi: Array
    off: Mapping[str, float]
    priors: PriorTable


def draw(
    scene: Scene,
    priors: PriorTable,
    rng: np.random.Generator,
    nominal: Point | None = None,
    outer: tuple[int, ...] | None = None,
) -> Truth:
    """Draw a truth about the prior means and measure it; of priors that say next to nothing, the means about the truth.

    Parameters and state without a prior, and those the mission holds fixed, keep their nominal values.

    Parameters
    ----------
    nominal : the nominal point, where somebody has it already.
    outer : seed and key of the constant errors of telescopes, where other truths have the same; of `rng` when None.
    """
    nominal = nominal or nominal_view(scene).point
    fixed = {parameter.name for parameter in scene.mission.free_parameters if parameter.treatment == "fixed"}
    near, far = priors.parted(priors.physical(priors.draw(rng)))
    drawn = {name: value for name, value in near.items() if name not in fixed}
    off = {name: value for name, value in far.items() if name not in fixed}
    values = nominal.values
    moved = nominal.moved({name: value - values[name] for name, value in drawn.items()})
    seen = view(scene, moved)
    nuisances = draw_truth(seen.terms, rng)
    if outer is not None:
        nuisances |= _in_common(seen.terms, outer)
    noise = drawn_noise(scene, seen.observation, rng)
    common = {
        name: float(value)
        for term in seen.terms
        if term.name in nuisances and nuisances[term.name].ndim == 1
        for name, value in zip(term.names, nuisances[term.name])
    }
    return Truth(
        point=Point(state=moved.state, parameters=moved.parameters, nuisances=common),
        nuisances=nuisances,
        psi=measure(seen.observation, seen.terms, nuisances, noise=noise),
        off=off,
        priors=priors.moved(off),
    )


def undrawn(nominal: View, priors: PriorTable) -> Truth:
    """The truth in which no error was drawn: what is measured is what is computed at the nominal point."""
    return Truth(point=nominal.point, nuisances={}, psi=computed_psi(nominal), off={}, priors=priors)


def _in_common(terms: Sequence[Term], outer: tuple[int, ...]) -> dict[str, Array]:
    """Constant errors of instruments that all truths of one key share: each parameter by its name, whoever has it.

    Errors of the orbit of a telescope are left out: objects that are seen in other years do not have them in common.
    """
    found = {}
    for term in terms:
        if not isinstance(term, Common) or term.displacement is not None or term.treatment == "fixed":
            continue
        covariance = term.covariance if term.true_covariance is None else term.true_covariance
        mean = term.mean if term.true_mean is None else term.true_mean
        seed, *key = outer
        normal = [
            np.random.default_rng(
                np.random.SeedSequence(seed, spawn_key=(*key, zlib.crc32(name.encode("utf-8"))))
            ).standard_normal()
            for name in term.names
        ]
        found[term.name] = mean + root(covariance) @ np.array(normal)
    return found
