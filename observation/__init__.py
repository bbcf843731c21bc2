"""Where telescopes are, what they see of an asteroid, and everything that is uncertain about them."""

from nebosvod.observation.earth.sites import GroundSite
from nebosvod.observation.formats.ades import Residuals, write_psv, write_xml
from nebosvod.observation.formats.reading import read_astrometry
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.measurement.apparent import apparent_place
from nebosvod.observation.measurement.astrometry import Observation, merge, observe
from nebosvod.observation.measurement.direction import ra_dec, residual
from nebosvod.observation.measurement.photometry import apparent_magnitude
from nebosvod.observation.measurement.sight import Sight, sight
from nebosvod.observation.measurement.telescope import Telescope
from nebosvod.observation.measurement.visibility import Visibility, visibility
from nebosvod.observation.spacecraft.geocentric import GeocentricOrbit, sun_synchronous
from nebosvod.observation.spacecraft.heliocentric import HeliocentricOrbit
from nebosvod.observation.spacecraft.kinds import Geostationary, HeliocentricCompanion, Spacecraft
from nebosvod.observation.spacecraft.lagrange import LibrationOrbit
from nebosvod.observation.spacecraft.oem import Oem, OemCovariance, read_oem
from nebosvod.observation.spacecraft.retrograde import DistantRetrograde
from nebosvod.observation.spacecraft.spk import ChebyshevOrbit, read_spk
from nebosvod.observation.spacecraft.tabulated import TabulatedOrbit, table
from nebosvod.observation.uncertainty.bias import ArcBias, BiasDrift, ConstantBias, GaussMarkovBias, ZoneBias
from nebosvod.observation.uncertainty.clock import TimingOffset
from nebosvod.observation.uncertainty.nuisance import Nuisance
from nebosvod.observation.uncertainty.orbit_error import OrbitError
from nebosvod.observation.uncertainty.photocentre import Photocentre
from nebosvod.observation.uncertainty.plate_scale import PlateScale
from nebosvod.observation.uncertainty.position_error import ConstantPosition, GaussMarkovPosition, WhitePosition
from nebosvod.observation.uncertainty.process_noise import ProcessNoise, Reach
from nebosvod.observation.uncertainty.simulate import draw_noise, draw_truth, measure
from nebosvod.observation.uncertainty.term import Common, Markov, Term, White

__all__ = [
    "ArcBias",
    "Astrometry",
    "BiasDrift",
    "ChebyshevOrbit",
    "Common",
    "ConstantBias",
    "ConstantPosition",
    "DistantRetrograde",
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
    "PlateScale",
    "ProcessNoise",
    "Reach",
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
