"""The mission: one YAML file, read strictly, with every error at its line.

The table of contents of this package; see docs/mission.md for the file and the attributes of `Mission`.
"""

from nebosvod.borders.treatment import Treatment
from nebosvod.mission.bias import Bias
from nebosvod.mission.fit import FitMission
from nebosvod.mission.model import Mission
from nebosvod.mission.parameter import Parameter
from nebosvod.mission.position import Position
from nebosvod.mission.question import SCHEMA_VERSION, CovariancePrior, Question
from nebosvod.mission.reading.builtin import list_missions, template_text
from nebosvod.mission.reading.cost import Cost, estimate_cost
from nebosvod.mission.reading.reader import load_any, load_fit, load_mission, load_mission_text
from nebosvod.mission.reading.schema import mission_schema
from nebosvod.mission.request import (
    Arc,
    EncounterPrediction,
    Estimator,
    Prior,
    SigmaPrior,
    SkyPrediction,
    StatePrediction,
)
from nebosvod.mission.sources import Shared, Source
from nebosvod.mission.spacecraft import Geostationary, Heliocentric
from nebosvod.mission.target import Target
from nebosvod.mission.telescope import Noise, Telescope
from nebosvod.mission.uncertainty import Photocentre, Timing

__all__ = [
    "SCHEMA_VERSION",
    "Arc",
    "Bias",
    "Cost",
    "CovariancePrior",
    "EncounterPrediction",
    "Estimator",
    "FitMission",
    "Geostationary",
    "Heliocentric",
    "Mission",
    "Noise",
    "Parameter",
    "Photocentre",
    "Position",
    "Prior",
    "Question",
    "Shared",
    "SigmaPrior",
    "SkyPrediction",
    "Source",
    "StatePrediction",
    "Target",
    "Telescope",
    "Timing",
    "Treatment",
    "estimate_cost",
    "list_missions",
    "load_any",
    "load_fit",
    "load_mission",
    "load_mission_text",
    "mission_schema",
    "template_text",
]
