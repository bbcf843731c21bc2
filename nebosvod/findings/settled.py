"""A fit as tests of its residuals take it: linearised where it ended, with everything that errs in the model."""

from dataclasses import replace

import numpy as np

from nebosvod.engine.fitting import Fit
from nebosvod.estimation import LinearProblem
from nebosvod.estimation.accuracy.recursive_residuals import in_truth
from nebosvod.estimation.solvers.iteration import recentred
from nebosvod.scene.scene import Scene


def settled(fit: Fit) -> LinearProblem:
    """The problem at the end of a fit, counted from there, of an estimator that leaves nothing out."""
    problem = in_truth(recentred(fit.problem, deviation_of(fit)))
    known = tuple(
        replace(prior, mean=prior.mean + np.array([fit.mean_errors.get(name, 0.0) for name in prior.names]))
        for prior in problem.priors
        if prior.mean is not None
    )
    return replace(problem, priors=known)


def deviation_of(fit: Fit) -> dict[str, float]:
    """What was estimated, from where the iteration began."""
    return dict(zip(fit.estimate.names, fit.estimate.mean.tolist()))


def without_bias(scene: Scene, fit: Fit, telescope: str) -> LinearProblem | None:
    """The same in a world where a telescope has no bias of its own; None where the model has none anyway."""
    own = {s.name for s in scene.sources.values() if s.group == "bias" and s.telescopes == (telescope,)}
    if not own:
        return None
    problem, estimated = settled(fit), deviation_of(fit)
    assumed = {
        name: float(value)
        for prior in problem.priors
        if prior.name in own and prior.mean is not None
        for name, value in zip(prior.names, prior.mean)
    }
    residual = problem.residual.copy()
    for block in problem.blocks:
        if block.name in own:  # the directions were computed with the bias that was estimated
            for k, name in enumerate(block.names):
                residual -= block.H[:, :, k] * assumed.get(name, -estimated.get(name, 0.0))
    return replace(
        problem,
        residual=residual,
        blocks=tuple(replace(b, treatment="fixed") if b.name in own else b for b in problem.blocks),
        markov=tuple(replace(m, treatment="fixed") if m.name in own else m for m in problem.markov),
    )
