"""The mission: one YAML file, read strictly, with every error at its line.

The table of contents of this package; see docs/mission.md for the file and the attributes of `Mission`.
"""

from nebosvod.mission.builtin import list_missions, template_text
from nebosvod.mission.cost import Cost, estimate_cost
from nebosvod.mission.fields import Treatment
from nebosvod.mission.model import SCHEMA_VERSION, CovariancePrior, Mission
from nebosvod.mission.reading import load_mission, load_mission_text
from nebosvod.mission.request import (
    Arc,
    EncounterPrediction,
    Estimator,
    Prior,
    SigmaPrior,
    SkyPrediction,
    StatePrediction,
)
from nebosvod.mission.schema import mission_schema
from nebosvod.mission.target import Parameter, Target
from nebosvod.mission.telescope import Bias, Geostationary, Heliocentric, Noise, Position, Telescope

__all__ = [
    "SCHEMA_VERSION",
    "Arc",
    "Bias",
    "Cost",
    "CovariancePrior",
    "EncounterPrediction",
    "Estimator",
    "Geostationary",
    "Heliocentric",
    "Mission",
    "Noise",
    "Parameter",
    "Position",
    "Prior",
    "SigmaPrior",
    "SkyPrediction",
    "StatePrediction",
    "Target",
    "Telescope",
    "Treatment",
    "estimate_cost",
    "list_missions",
    "load_mission",
    "load_mission_text",
    "mission_schema",
    "template_text",
]
