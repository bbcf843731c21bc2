"""A fit as tests of its residuals take it: linearised where it ended, with everything that errs in the model."""

from dataclasses import replace

import numpy as np

from nebosvod.engine.fitting import Fit
from nebosvod.estimation import LinearProblem
from nebosvod.estimation.accuracy.recursive_residuals import nothing_left_out
from nebosvod.estimation.solvers.iteration import recentred
from nebosvod.scene.scene import Scene


def settled(fit: Fit) -> LinearProblem:
    """The problem at the end of a fit, counted from there, of an estimator that leaves nothing out."""
    problem = nothing_left_out(recentred(fit.problem, deviation_of(fit)))
    # what was left out stands at the mean that the mission gives it, whatever the estimator took it for
    at_their_mean = set(fit.estimate.left_out) & set(fit.seen.point.nuisances)
    priors = tuple(
        replace(prior, mean=np.zeros(len(prior.names))) if set(prior.names) <= at_their_mean else prior
        for prior in problem.priors
    )
    return replace(problem, priors=priors)


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
