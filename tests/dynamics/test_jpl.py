"""Against JPL's own trajectories: the physics, not the integrator, is on trial here.

What the comparison showed (kept here because it decides the tolerances):

- JPL's solution 220 of Apophis (2024) is EIH, 16 asteroids, no J2 of the Sun (which would move it 13 m in ten months):
  1 mm before the encounter. After it, pole of date and J2 alone: 35 m in 2030; with J4 100 m, with J3 1.9 km.
- Its small-body code as frozen in the reference state is EIH, J2 of the Sun, J2 to J4 of the Earth, pole of J2000.
  With these the end state is met to 1.4 km as it stands, and to 4 m when the start is 11.8 us later. The start epoch is
  known no better: a Julian date in one float64 has a grain of 40 us, and each microsecond there is 116 m at the end.
  The other direction of the b-plane, which a shift of time does not reach, decides the pole: 4 m with that of J2000,
  0.9 km with that of date.
- All forces agree with an independent code, force by force, to 1e-15 far from the Earth and 1e-10 at the perigee (its
  time is in days: 0.2 us). Its end states scatter by kilometres with the settings of its integrator; ours by 0.1 m.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav, propagate
from nebosvod.dynamics.constants import DAY_S
from nebosvod.timescale import Epoch

Array = np.ndarray
JplTrajectory = Callable[[Epoch, Any], Array]


@pytest.fixture(scope="module")
def jpl_forces(ephemeris: Ephemeris, apophis_nongrav: Nongrav) -> ForceModel:
    """The forces of JPL's solution 220."""
    return ForceModel(ephemeris=ephemeris, relativity="eih", sun_oblateness=False, nongrav=apophis_nongrav)


def test_apophis_of_solution_220_is_reproduced_before_the_encounter(
    jpl_forces: ForceModel, apophis: Callable[[Epoch, Any], Array]
) -> None:
    """1 m from 2028-06 to 2029-04-10 (reached: 1 mm)."""
    epoch = Epoch.parse("2028-06-01T00:00:00 TDB")
    times = np.linspace(0.0, Epoch.parse("2029-04-10T00:00:00 TDB") - epoch, 40)
    wanted = apophis(epoch, times)
    ours = propagate(wanted[0], epoch, times, jpl_forces, False).state
    assert np.linalg.norm((ours - wanted)[:, :3], axis=1).max() < 1e-3


@pytest.mark.parametrize(("relativity", "sun_oblateness", "limit_km"), [("eih", False, 0.01), ("sun", True, 1.0)])
def test_apophis_from_2021_to_the_encounter(
    ephemeris: Ephemeris,
    apophis: Callable[[Epoch, Any], Array],
    apophis_nongrav: Nongrav,
    relativity: Any,
    sun_oblateness: bool,
    limit_km: float,
) -> None:
    """8.3 years from the state at 2021-01-01: 10 m with JPL's forces, 1 km with the default ones."""
    forces = ForceModel(
        ephemeris=ephemeris, relativity=relativity, sun_oblateness=sun_oblateness, nongrav=apophis_nongrav
    )
    epoch = Epoch.parse("2021-01-01T00:00:00 TDB")
    times = np.linspace(0.0, Epoch.parse("2029-04-12T00:00:00 TDB") - epoch, 60)
    wanted = apophis(epoch, times)
    ours = propagate(wanted[0], epoch, times, forces, False).state
    assert np.linalg.norm((ours - wanted)[:, :3], axis=1).max() < limit_km


def test_apophis_after_the_encounter(ephemeris: Ephemeris, apophis: JplTrajectory, apophis_nongrav: Nongrav) -> None:
    """10 m a week after the encounter, 200 m by 2030 (reached: 0.3 m, 35 m), from a state four months before it."""
    forces = ForceModel(
        ephemeris=ephemeris, relativity="eih", sun_oblateness=False, earth_harmonics=2, nongrav=apophis_nongrav
    )
    epoch = Epoch.parse("2028-12-31T00:00:00 TDB")
    times = np.array([Epoch.parse(f"{date}T00:00:00 TDB") - epoch for date in ("2029-04-20", "2030-01-01")])
    wanted = apophis(epoch, [0.0, *times])
    error = propagate(wanted[0], epoch, times, forces, False).state - wanted[1:]
    assert np.linalg.norm(error[0, :3]) < 0.01
    assert np.linalg.norm(error[1, :3]) < 0.2


@pytest.fixture(scope="module")
def frozen(
    ephemeris: Ephemeris, jpl_states: dict[str, Any], km: Callable[[Any], Array], at_jd: Callable[[float], Epoch]
) -> Callable[..., Array]:
    """Error in km of the end state of the small-body code, for a start that many seconds late and any switches."""
    case = jpl_states["apophis_1yr_through_2029_flyby_jpl_small_body_code"]
    a1, a2, _ = case["A1_A2_A3"]

    def error(late_s: float, tolerance: float = 1e-12, **switches: Any) -> Array:
        forces = ForceModel(
            ephemeris=ephemeris, relativity="eih", nongrav=Nongrav(a1_au_d2=a1, a2_au_d2=a2), **switches
        )
        epoch = at_jd(case["jd0"]) + late_s
        times = [at_jd(case["jd1"]) - epoch]
        end = propagate(km(case["helio0"]), epoch, times, forces, False, tolerance=tolerance).state[0]
        found: Array = (end - km(case["helio1"]))[:3]
        return found

    return error


def best_start(error: Callable[[float], Array], grain_s: float) -> tuple[float, float]:
    """The start inside half a grain of the epoch that brings the end closest, and how close, s and km."""
    here, step = error(0.0), 1e-5
    slope = (error(step) - here) / step
    late = float(np.clip(-(slope @ here) / (slope @ slope), -0.5 * grain_s, 0.5 * grain_s))
    return late, float(np.linalg.norm(error(late)))


def test_apophis_of_the_small_body_code_through_the_encounter(
    frozen: Callable[..., Array], jpl_states: dict[str, Any]
) -> None:
    """200 m eight months after the encounter (reached: 4 m) for a start epoch inside the grain of the given one."""
    case = jpl_states["apophis_1yr_through_2029_flyby_jpl_small_body_code"]
    grain_s = float(np.spacing(case["jd0"])) * DAY_S
    assert grain_s == pytest.approx(40e-6, rel=0.01)
    late, miss = best_start(lambda late_s: frozen(late_s, earth_pole="j2000"), grain_s)
    assert miss < 0.02
    assert late == pytest.approx(11.8e-6, abs=0.3e-6)


def test_no_start_epoch_makes_up_for_another_pole(frozen: Callable[..., Array]) -> None:
    """0.9 km remain with the pole of date: the frozen code had that of J2000."""
    _, miss = best_start(frozen, 400e-6)
    assert 0.8 < miss < 1.0


def test_apophis_of_the_small_body_code_as_it_stands(frozen: Callable[..., Array]) -> None:
    """1.4 km without a shift of the start, of which the integration is 1 m."""
    coarse, fine = (frozen(0.0, tolerance, earth_pole="j2000") for tolerance in (1e-10, 1e-13))
    assert np.linalg.norm(fine) < 1.4
    assert np.linalg.norm(coarse - fine) < 1e-3


def test_holman_over_thirty_days(
    ephemeris: Ephemeris, jpl_states: dict[str, Any], km: Callable[[Any], Array], at_jd: Callable[[float], Epoch]
) -> None:
    """0.1 m per axis and 5 mm/d."""
    case = jpl_states["holman_3666_30d_horizons"]
    epoch = at_jd(case["jd0"])
    times = [0.0, at_jd(case["jd1"]) - epoch]
    sun = ephemeris.state_km_km_s("sun", epoch, times)
    forces = ForceModel(ephemeris=ephemeris, relativity="eih")
    end = propagate(km(case["bary0"]) - sun[0], epoch, times[1:], forces, False).state[0]
    error = end + sun[1] - km(case["bary1"])
    assert np.abs(error[:3]).max() < 1e-4
    assert np.abs(error[3:]).max() < 5e-6 / DAY_S


def test_parijskij_over_ten_years_and_an_encounter_with_ceres(
    ephemeris: Ephemeris, jpl_states: dict[str, Any], km: Callable[[Any], Array], at_jd: Callable[[float], Epoch]
) -> None:
    """2 m of the small-body code, 500 m of the state of Horizons (reached: 0.8 m with J2 of the Sun, 491 m without).

    The two references are 501 m apart: no model comes closer than 250 m to both.
    """
    case = jpl_states["5303_Parijskij_10yr_ceres_encounter"]
    epoch = at_jd(case["jd0"])
    times = [0.0, at_jd(case["jd1"]) - epoch]
    sun = ephemeris.state_km_km_s("sun", epoch, times)
    start = km(case["bary0"]) - sun[0]
    code, horizons = np.array(case["helio1_jpl_small_body_code_km"]), (km(case["bary1_horizons"]) - sun[1])[:3]
    assert np.linalg.norm(code - horizons) == pytest.approx(0.501, abs=1e-3)
    for oblate, wanted, limit_km in ((True, code, 2e-3), (False, horizons, 0.5)):
        forces = ForceModel(ephemeris=ephemeris, relativity="eih", sun_oblateness=oblate)
        end = propagate(start, epoch, times[1:], forces, False).state[0, :3]
        assert np.linalg.norm(end - wanted) < limit_km
