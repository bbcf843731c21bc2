"""Real tracklets of the folder of reference data, cut after some of their records."""

from pathlib import Path

import numpy as np

from nebosvod.dynamics import Ephemeris
from nebosvod.first_hour.alert import Alert, Question, alert
from nebosvod.first_hour.observed import prepared, tracklet_of, with_shared, without_gross_errors
from nebosvod.observation.formats.records import Astrometry
from nebosvod.pipeline import mission_of, objects

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data"
FILES = {
    "2014 AA": DATA / "observations" / "2014AA.obs80",
    "2018 LA": DATA / "impact" / "2018LA.txt",
    "2024 BX1": DATA / "observations" / "2024BX1.obs80",
    "2023 DW": DATA / "observations" / "2023DW.obs80",
    "Holman": DATA / "observations" / "03666_Holman.obs80",
}


def answered(path: Path, rows: slice, bodies: Ephemeris, within_d: float = 100.0) -> Alert:
    """The answer for some of the records of a file, in the order of time."""
    mission = mission_of([str(path)])
    (records,) = objects(mission, split=False)
    return of(records.by_time().select(np.arange(len(records))[rows]), path, bodies, within_d)


def of(records: Astrometry, path: Path, bodies: Ephemeris, within_d: float = 100.0) -> Alert:
    mission = with_shared(records, mission_of([str(path)]))
    question = Question(within_d=within_d)
    whole = tracklet_of(prepared(records, mission, bodies), records, mission)
    return alert(without_gross_errors(whole, question.region, mission)[0], question)
