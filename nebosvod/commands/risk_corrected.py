"""What `nebosvod risk` has of the observations of a fit: its line of variations, or why it has none."""

from collections.abc import Callable
from pathlib import Path

from nebosvod.dynamics import Ephemeris
from nebosvod.errors import CoverageError, EventError, GeometryError, InputError
from nebosvod.fits.engine import fit_object
from nebosvod.fits.variations import Variations
from nebosvod.impacts.line import NO_OBSERVATIONS
from nebosvod.impacts.string import Corrected
from nebosvod.mission import FitMission
from nebosvod.mission.reading.again import made_from
from nebosvod.orbits.folders import is_folder_of_ours
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.pipeline import objects

MOST_RECORDS = 1000  # a second of computing; of a long arc the line is straight


def corrected_line(
    path: str, orbit: UncertainOrbit, ephemeris: Ephemeris, say: Callable[[str], None]
) -> Corrected | str:
    """The line of variations by the observations an orbit was fitted to, or why there is none."""
    if not is_folder_of_ours(Path(path)):
        return NO_OBSERVATIONS
    try:
        mission = made_from(Path(path))
        if not isinstance(mission, FitMission):
            return NO_OBSERVATIONS
        (records,) = objects(mission, split=False)
        if len(records) > MOST_RECORDS:
            return f"of {len(records)} observations it is not bent (corrected up to {MOST_RECORDS})"
        say("fitting the observations again for the line of variations")
        return Variations(fit=fit_object(records, mission, ephemeris), orbit=orbit).along
    except (CoverageError, EventError, GeometryError, InputError) as error:
        return str(error)
