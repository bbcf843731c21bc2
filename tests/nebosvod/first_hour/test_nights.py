"""A record of the next night, the Earth passed between: an orbit of all is found, and it is that of a fit."""

from pathlib import Path

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris
from nebosvod.first_hour.conditional import Conditional
from nebosvod.first_hour.nights import about_the_reference, grid_of_all
from nebosvod.first_hour.observed import prepared, tracklet_of, with_shared, without_gross_errors
from nebosvod.first_hour.region import Region
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.fits.engine import fit_object
from nebosvod.pipeline import mission_of, objects
from nebosvod.units import AU_KM

# The first four of 2018 LA (Minor Planet Center), and a fifth made up a day later, of an orbit that fits the four, has
# passed the Earth and is seen on the other side of the sky
RECORDS = """\
     K18L00A tC2018 06 02.34329516 11 10.342-11 19 34.92               V~2i5UG96
     K18L00A tC2018 06 02.34850816 10 59.352-11 20 21.37         18.2 GV~2i5UG96
     K18L00A tC2018 06 02.35372316 10 48.154-11 21 08.95         18.3 GV~2i5UG96
     K18L00A tC2018 06 02.35894416 10 36.604-11 21 57.30         18.0 GV~2i5UG96
     K18L00A  C2018 06 03.35894404 23 36.204+09 53 00.27         18.0 GV~2i5UG96
"""


@pytest.fixture(scope="module")
def ephemeris() -> Ephemeris:
    return Ephemeris.load()


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("nights") / "later.obs80"
    made.write_text(RECORDS, "ascii")
    return made


@pytest.fixture(scope="module")
def whole(path: Path, ephemeris: Ephemeris) -> Tracklet:
    mission = mission_of([str(path)])
    (records,) = objects(mission, split=False)
    shared = with_shared(records, mission)
    made = tracklet_of(prepared(records, shared, ephemeris), records, shared)
    kept, rows, _ = without_gross_errors(made, Region(), shared)
    assert rows.tolist() == [0, 1, 2, 3, 4]  # a good record of another night is no gross error
    return kept


def test_range_is_that_of_least_squares(whole: Tracklet, path: Path, ephemeris: Ephemeris) -> None:
    """0.2 sigma: `fit` finds its orbit by Gauss's method, with independent clocks."""
    assert about_the_reference(whole).tolist() == [0, 1, 2, 3]
    grid = grid_of_all(Conditional(whole), Region())
    assert grid.effective() > 30.0
    mean, covariance = grid.moments()
    mission = mission_of([str(path)])
    (records,) = objects(mission, split=False)
    fit = fit_object(records, mission, ephemeris)
    seen = fit.general.fit.observation
    away = seen.distance_km[3]  # the light's, 0.02 sigmas from that of one moment
    sigma = float(np.sqrt(covariance[0, 0]))
    assert sigma == pytest.approx(0.0045, rel=0.1)
    assert abs(mean[0] - np.log(away / AU_KM)) < 0.2 * sigma
