"""Residuals and partials -> estimate, covariance and what causes it. Matrices only, no astronomy."""

from nebosvod.borders.treatment import Treatment
from nebosvod.estimation.accuracy import budget, consistency, ellipse, extended, guaranteed, mean_error
from nebosvod.estimation.accuracy import refined as nuisance
from nebosvod.estimation.accuracy.budget import NoiseToNuisance, noise_to_nuisance
from nebosvod.estimation.accuracy.ellipse import Ellipse, Ellipsoid
from nebosvod.estimation.filters import combined, consider, current_state, kalman, normal_places, smoother, two_stage
from nebosvod.estimation.problem.estimate import Estimate, History, Prediction, Status
from nebosvod.estimation.problem.problem import Block, LinearProblem, Markov, Prior, White
from nebosvod.estimation.problem.square_root import lower_factor
from nebosvod.estimation.solvers import batch, iteration, recursive, rejection, separated, sequential
from nebosvod.estimation.solvers.iteration import IterationResult, gauss_newton

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
    "mean_error",
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
