"""Where telescopes are, what they see of an asteroid, and everything that is uncertain about them."""

from nebosvod.observation.astrometry import Observation, merge, observe
from nebosvod.observation.bias import ArcBias, BiasDrift, ConstantBias, GaussMarkovBias, ZoneBias
from nebosvod.observation.clock import TimingOffset
from nebosvod.observation.direction import ra_dec, residual
from nebosvod.observation.nuisance import Nuisance
from nebosvod.observation.orbit_error import OrbitError
from nebosvod.observation.photocentre import Photocentre
from nebosvod.observation.photometry import apparent_magnitude
from nebosvod.observation.position_error import ConstantPosition, GaussMarkovPosition, WhitePosition
from nebosvod.observation.sight import Sight, sight
from nebosvod.observation.simulate import draw_noise, draw_truth, measure
from nebosvod.observation.spacecraft import Geostationary, HeliocentricCompanion, Spacecraft
from nebosvod.observation.telescope import Telescope
from nebosvod.observation.term import Common, Markov, Term, White
from nebosvod.observation.visibility import Visibility, visibility

__all__ = [
    "ArcBias",
    "BiasDrift",
    "Common",
    "ConstantBias",
    "ConstantPosition",
    "GaussMarkovBias",
    "GaussMarkovPosition",
    "Geostationary",
    "HeliocentricCompanion",
    "Markov",
    "Nuisance",
    "Observation",
    "OrbitError",
    "Photocentre",
    "Sight",
    "Spacecraft",
    "Telescope",
    "Term",
    "TimingOffset",
    "Visibility",
    "White",
    "WhitePosition",
    "ZoneBias",
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
