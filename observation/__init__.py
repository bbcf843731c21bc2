"""Where telescopes are, what they see of an asteroid, and everything that is uncertain about them."""

from nebosvod.observation.ades import Residuals, write_psv, write_xml
from nebosvod.observation.apparent import apparent_place
from nebosvod.observation.astrometry import Observation, merge, observe
from nebosvod.observation.astrometry_files import read_astrometry
from nebosvod.observation.bias import ArcBias, BiasDrift, ConstantBias, GaussMarkovBias, ZoneBias
from nebosvod.observation.clock import TimingOffset
from nebosvod.observation.direction import ra_dec, residual
from nebosvod.observation.geocentric import GeocentricOrbit, sun_synchronous
from nebosvod.observation.heliocentric import HeliocentricOrbit
from nebosvod.observation.lagrange import LibrationOrbit
from nebosvod.observation.nuisance import Nuisance
from nebosvod.observation.oem import Oem, OemCovariance, read_oem
from nebosvod.observation.orbit_error import OrbitError
from nebosvod.observation.photocentre import Photocentre
from nebosvod.observation.photometry import apparent_magnitude
from nebosvod.observation.position_error import ConstantPosition, GaussMarkovPosition, WhitePosition
from nebosvod.observation.records import Astrometry
from nebosvod.observation.sight import Sight, sight
from nebosvod.observation.simulate import draw_noise, draw_truth, measure
from nebosvod.observation.sites import GroundSite
from nebosvod.observation.spacecraft import Geostationary, HeliocentricCompanion, Spacecraft
from nebosvod.observation.spk import ChebyshevOrbit, read_spk
from nebosvod.observation.tabulated import TabulatedOrbit, table
from nebosvod.observation.telescope import Telescope
from nebosvod.observation.term import Common, Markov, Term, White
from nebosvod.observation.visibility import Visibility, visibility

__all__ = [
    "ArcBias",
    "Astrometry",
    "BiasDrift",
    "ChebyshevOrbit",
    "Common",
    "ConstantBias",
    "ConstantPosition",
    "GaussMarkovBias",
    "GaussMarkovPosition",
    "GeocentricOrbit",
    "Geostationary",
    "GroundSite",
    "HeliocentricCompanion",
    "HeliocentricOrbit",
    "LibrationOrbit",
    "Markov",
    "Nuisance",
    "Observation",
    "Oem",
    "OemCovariance",
    "OrbitError",
    "Photocentre",
    "Residuals",
    "Sight",
    "Spacecraft",
    "TabulatedOrbit",
    "Telescope",
    "Term",
    "TimingOffset",
    "Visibility",
    "White",
    "WhitePosition",
    "ZoneBias",
    "apparent_magnitude",
    "apparent_place",
    "draw_noise",
    "draw_truth",
    "measure",
    "merge",
    "observe",
    "ra_dec",
    "read_astrometry",
    "read_oem",
    "read_spk",
    "residual",
    "sight",
    "sun_synchronous",
    "table",
    "visibility",
    "write_psv",
    "write_xml",
]
