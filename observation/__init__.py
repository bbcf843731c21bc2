"""Where telescopes are, what they see of an asteroid, and everything that is uncertain about them."""

from nebosvod.observation.astrometry import Observation, merge, observe
from nebosvod.observation.direction import ra_dec, residual
from nebosvod.observation.nuisance import (
    ConstantBias,
    ConstantPosition,
    GaussMarkovPosition,
    Nuisance,
    WhitePosition,
)
from nebosvod.observation.photometry import apparent_magnitude
from nebosvod.observation.sight import Sight, sight
from nebosvod.observation.simulate import draw_noise, draw_truth, measure
from nebosvod.observation.spacecraft import Geostationary, HeliocentricCompanion, Spacecraft
from nebosvod.observation.telescope import Telescope
from nebosvod.observation.term import Common, Markov, Term, White
from nebosvod.observation.visibility import Visibility, visibility

__all__ = [
    "Common",
    "ConstantBias",
    "ConstantPosition",
    "GaussMarkovPosition",
    "Geostationary",
    "HeliocentricCompanion",
    "Markov",
    "Nuisance",
    "Observation",
    "Sight",
    "Spacecraft",
    "Telescope",
    "Term",
    "Visibility",
    "White",
    "WhitePosition",
    "apparent_magnitude",
    "draw_noise",
    "draw_truth",
    "measure",
    "merge",
    "observe",
    "ra_dec",
    "residual",
    "sight",
    "visibility",
]
