"""A file for `nebosvod fit`: real observations in place of telescopes and a schedule."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr

from nebosvod.mission.fields import (
    Block,
    KeyPath,
    Parsed,
    PositiveNumber,
    Several,
    Text,
    When,
)
from nebosvod.mission.covariance import Array, Matrix
from nebosvod.mission.model import Mission
from nebosvod.mission.orbit import Frame, SbdbOrbit, StateOrbit
from nebosvod.mission.request import Arc, Estimator, SkyPrediction, internal_covariance, scales
from nebosvod.mission.sources import KINDS, Group, Source
from nebosvod.mission.spacecraft import OemFile, Spk, Tabulated
from nebosvod.mission.target import Orbit, Target
from nebosvod.mission.telescope import Telescope
from nebosvod.mission.uncertainty import Bias, Position, Timing
from nebosvod.timescale import Epoch

Complaint = tuple[KeyPath, str]
NAME = "fit"  # of the one estimator
NOT_HERE = ("telescopes", "shared", "schedule", "estimators", "monte_carlo", "reference_epoch")
MAX_FILES = 1000
