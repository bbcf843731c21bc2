"""The attributable of a short arc, and orbits for any distance."""

import numpy as np
import pytest

from nebosvod.dynamics.constants import AU_KM, DAY_S
from nebosvod.errors import InputError
from nebosvod.observation.formats import mpc80
from nebosvod.observation.initial.short_arc import attributable, ranging
from nebosvod.observation.initial.two_body_fit import Arc
from nebosvod.observation.reduction.observers import telescopes
from nebosvod.observation.reduction.weights import weigh

ARCSEC = np.pi / 648000.0


class Records:
    """Only what the attributable asks for."""

    def __init__(self, t_s, psi) -> None:
        self.t_s, self.psi = np.asarray(t_s, dtype=float), psi

    def __len__(self) -> int:
        return self.t_s.size


def arc_of(times, acceleration=0.0, dec=0.4):
    """Records with constant motion (3e-8, -2e-8) rad/s in a tangent plane, curved in RA cos Dec."""
    t = np.asarray(times, dtype=float)
    mid = 0.5 * (t[0] + t[-1])
    x = 3e-8 * (t - mid) + 0.5 * acceleration * (t - mid) ** 2
    y = -2e-8 * (t - mid)
    ra0 = 1.0
    u = (
        np.array([np.cos(dec) * np.cos(ra0), np.cos(dec) * np.sin(ra0), np.sin(dec)])
        + x[:, None] * np.array([-np.sin(ra0), np.cos(ra0), 0.0])
        + y[:, None] * np.array([-np.sin(dec) * np.cos(ra0), -np.sin(dec) * np.sin(ra0), np.cos(dec)])
    )
    psi = np.stack([np.arctan2(u[:, 1], u[:, 0]), np.arctan2(u[:, 2], np.hypot(u[:, 0], u[:, 1]))], axis=1)
    return Records(t, psi)


class Sigma:
    def __init__(self, n: int) -> None:
        self.sigma_rad = np.full((n, 2), 0.5 * ARCSEC)


def test_direction_motion_and_curvature_of_a_made_arc() -> None:
    records = arc_of([0.0, 1800.0, 3700.0, 5000.0, 7200.0], acceleration=4e-12)
    found = attributable(records, Sigma(5))
    np.testing.assert_allclose(found.psi, [1.0, 0.4], rtol=0.0, atol=1e-9)
    # the axes are those of the record nearest to the middle, 1e-4 rad away
    np.testing.assert_allclose(found.rate_rad_s, [3e-8, -2e-8], rtol=1e-4)
    np.testing.assert_allclose(found.curvature_rad_s2, [4e-12, 0.0], rtol=1e-4, atol=1e-17)
    assert (found.t_s, found.arc_s, found.number) == (3600.0, 7200.0, 5)


def test_its_sigmas_are_those_of_the_scatter_of_noisy_arcs() -> None:
    rng = np.random.default_rng(6)
    clean = arc_of(np.linspace(0.0, 7200.0, 6))
    rates, sigma = [], None
    for _ in range(800):
        noisy = Records(clean.t_s, clean.psi + 0.5 * ARCSEC * rng.normal(size=(6, 2)) / np.array([np.cos(0.4), 1.0]))
        found = attributable(noisy, Sigma(6))
        rates.append(found.rate_rad_s)
        sigma = found.sigma_rate_rad_s
    # 800 draws: 2.5 % one sigma
    np.testing.assert_allclose(np.std(rates, axis=0), sigma, rtol=0.1)


def test_a_straight_arc_is_told_to_say_nothing_of_the_distance() -> None:
    straight = attributable(arc_of([0.0, 1800.0, 3600.0]), Sigma(3))
    assert straight.significance < 0.1
    assert "no curvature" in straight.text
    assert "3 observations over 1.0 h: RA 57.29578 deg, Dec +22.91831 deg, moving 26.77 +-" in straight.text
    bent = attributable(arc_of([0.0, 1800.0, 3600.0], acceleration=1e-10), Sigma(3))
    assert bent.significance > 10.0
    assert "curved by" in bent.text


def test_two_times_have_a_motion_and_no_curvature_and_one_has_neither() -> None:
    found = attributable(arc_of([0.0, 3600.0]), Sigma(2))
    np.testing.assert_allclose(found.rate_rad_s, [3e-8, -2e-8], rtol=1e-4)
    assert found.significance == 0.0
    assert np.all(np.isinf(found.sigma_curvature_rad_s2))
    with pytest.raises(InputError, match="one time of observation"):
        attributable(Records(np.zeros(2), np.zeros((2, 2))), Sigma(2))


@pytest.mark.parametrize(("name", "significant"), [("2008EK68", False), ("2014AA", True)])
def test_real_arcs_of_an_hour(data, name: str, significant: bool) -> None:
    """JPL lists 2008 EK68 with the largest uncertainty there is; 2014 AA was close enough to bend within 70 minutes."""
    found = attributable(mpc80.read(data / "observations" / f"{name}.obs80"))
    assert (found.significance > 3.0) == significant


def test_ranging_finds_the_distance_of_an_impactor(data, ephemeris) -> None:
    """2014 AA, 0.0027 au from the Earth, seen for 70 minutes (JPL's state in jpl_truth_states.csv)."""
    records = mpc80.read(data / "observations" / "2014AA.obs80").by_time()
    places = telescopes(records, ephemeris).state_km_km_s
    arc = Arc.of(records.epoch, records.t_s, records.psi, weigh(records).sigma_rad, places, ephemeris)
    middle = int(np.argmin(np.abs(arc.t - arc.t0)))
    sun = ephemeris.state_km_km_s("sun", records.epoch, records.t_s[middle : middle + 1])[0]
    velocity = (places[middle, 3:] - sun[3:]) * DAY_S / AU_KM
    states = ranging(arc, velocity, keep=12, fine=True)
    distance = np.linalg.norm(states[:, :3] - arc.q[middle], axis=1)
    assert np.min(np.abs(np.log(distance / 0.0027))) < 0.3
    # bound orbits, all of them
    energy = 0.5 * np.sum(states[:, 3:] ** 2, axis=1) - arc.gm / np.linalg.norm(states[:, :3], axis=1)
    assert np.all(energy < 0.0)
    assert len(ranging(arc, velocity, keep=3, fine=False)) == 3


def test_ranging_gives_nothing_where_no_bound_orbit_moves_so_fast(ephemeris, data) -> None:
    records = mpc80.read(data / "observations" / "2014AA.obs80").by_time()
    places = telescopes(records, ephemeris).state_km_km_s
    arc = Arc.of(records.epoch, records.t_s, records.psi, weigh(records).sigma_rad, places, ephemeris)
    assert len(ranging(arc, np.array([0.2, 0.2, 0.2]), keep=5, fine=True)) == 0
