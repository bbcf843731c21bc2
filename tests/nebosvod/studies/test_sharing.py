"""Points share what they have in common, and no bit of an answer changes."""

from functools import partial

import numpy as np
import pytest

from nebosvod.scene.sharing import Shared
from nebosvod.studies.point import evaluate
from nebosvod.studies.question import Study
from nebosvod.studies.reading import load_study_text
from nebosvod.studies.study import evaluate_row, row

TEXT = """\
schema_version: 1
study: everything
mission: apophis-2029
vary:
  inclination: {set: object.orbit.i, values: [3.3367 deg, 3.3368 deg]}
  cadence: {set: schedule.*.cadence, values: [8 d, 10 d]}
  radius: {set: object.radius.value, values: [160 m, 170 m]}
  limit: {set: telescopes.*.limiting_magnitude, values: [22, 19.5]}
  noise: {set: telescopes.NEB-1.noise.sigma, values: [0.1 arcsec, 0.5 arcsec]}
  spread: {set: object.mass.sigma, values: [1e10 kg, 2e10 kg]}
  place: {set: telescopes.NEB-2.orbit.longitude, values: [180 deg, 90 deg]}
answer:
  - {name: plane, of: predictions.encounter.semi_axes_km.0}
  - {name: chance, of: predictions.encounter.impact_probability_linear}
  - {name: sky, of: predictions.sky a week before.semi_axes_arcsec.0}
  - {name: later, of: predictions.position a week before.sigma_km.0}
  - {name: velocity, of: state.sigma_velocity_m_s}
  - {name: blame, of: predictions.encounter.budget}
  - {name: number, of: n_observations}
"""


@pytest.fixture(scope="module")
def study() -> Study:
    return load_study_text(TEXT)


def test_shared_and_alone_are_equal_in_every_bit(study: Study) -> None:
    """Rows in an order that goes to and fro between values of every axis."""
    assert study.rows == 2**7
    rng = np.random.default_rng(3)
    chosen = rng.choice(study.rows, 24, replace=False).tolist()
    for number in chosen:
        status, message, found = evaluate_row(study, number)
        changes = {path: value for axis, (value, _) in zip(study.axes, study.points[number]) for path in axis.paths}
        point = evaluate(study.editable.edited(changes), study.wanted)
        assert (status, message) == ("ok", "")
        assert found == [one.take(point) for one in study.answers], number


def test_what_is_not_varied_is_the_same_object(study: Study) -> None:
    one, other = row(study, 0).scene, row(study, 4).scene  # another noise
    assert one.trajectory is other.trajectory
    assert one.exposures.observer is other.exposures.observer
    assert one.exposures.sigma_rad[0, 0] != other.exposures.sigma_rad[0, 0]
    assert row(study, 16).scene.trajectory is not one.trajectory  # another radius
    assert row(study, 32).scene.trajectory is one.trajectory  # another cadence; predictions are later


def test_every_key_of_a_telescope_is_geometry_or_known_to_be_none() -> None:
    """A key that is new is taken for geometry: points differ in it, and nothing is shared wrongly."""
    from nebosvod.mission.telescope import Telescope
    from nebosvod.scene.sharing import UNCERTAIN

    geometry = {"name", "orbit", "exclusion", "limiting_magnitude", "trailing", "duty"}
    assert set(Telescope.model_fields) >= UNCERTAIN | geometry


def test_few_products_are_kept() -> None:
    shared, made = Shared(3), list[int]()

    def square(number: int) -> int:
        made.append(number)
        return number * number

    for number in (1, 2, 1, 3, 4, 1, 2):
        assert shared.made("squares", partial(int, number), partial(square, number)) == number * number
    assert made == [1, 2, 3, 4, 2]  # the least lately used goes first
