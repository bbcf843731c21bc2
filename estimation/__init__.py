"""Residuals and partials -> estimate, covariance and what causes it. Matrices only, no astronomy."""

from nebosvod.estimation import (
    batch,
    budget,
    combined,
    consider,
    consistency,
    current_state,
    ellipse,
    extended,
    guaranteed,
    iteration,
    kalman,
    normal_places,
    nuisance,
    recursive,
    rejection,
    separated,
    sequential,
    smoother,
    two_stage,
)
from nebosvod.estimation.budget import NoiseToNuisance, noise_to_nuisance
from nebosvod.estimation.ellipse import Ellipse, Ellipsoid
from nebosvod.estimation.estimate import Estimate, History, Prediction, Status
from nebosvod.estimation.iteration import IterationResult, gauss_newton
from nebosvod.estimation.problem import Block, LinearProblem, Markov, Prior, Treatment, White
from nebosvod.estimation.square_root import lower_factor

__all__ = [
    "Block",
    "Ellipse",
    "Ellipsoid",
    "Estimate",
    "History",
    "IterationResult",
    "LinearProblem",
    "Markov",
    "NoiseToNuisance",
    "Prediction",
    "Prior",
    "Status",
    "Treatment",
    "White",
    "batch",
    "budget",
    "combined",
    "consider",
    "consistency",
    "current_state",
    "ellipse",
    "extended",
    "gauss_newton",
    "guaranteed",
    "iteration",
    "kalman",
    "lower_factor",
    "noise_to_nuisance",
    "normal_places",
    "nuisance",
    "recursive",
    "rejection",
    "separated",
    "sequential",
    "smoother",
    "two_stage",
]
