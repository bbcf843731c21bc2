"""Orbits that come down over a place: by astropy's Earth, there and back, and what is refused."""

import re

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import GCRS, ITRS, CartesianRepresentation, EarthLocation
from astropy.time import Time

from nebosvod.dynamics import Ephemeris
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.facts import EntryFacts
from nebosvod.errors import InputError
from nebosvod.mission import Mission, load_mission_text
from nebosvod.mission.orbit import ImpactOrbit
from nebosvod.scene.scene import build_scene

AT = "2028-05-19T07:00:00 UTC"


def text_of(minimal_text: str, **changed: str) -> str:
    """`minimal` with an object that falls a month after the last measurement."""
    keys = {"at": AT, "longitude": "30 deg", "latitude": "-20 deg", "elevation": "45 deg", "azimuth": "75 deg",
            "speed": "20 km/s"} | changed  # fmt: skip
    orbit = "kind: impact, " + ", ".join(f"{key}: {value}" for key, value in keys.items())
    text = re.sub(r"  orbit: \{kind: keplerian.*\}\n", f"  orbit: {{{orbit}}}\n", minimal_text, count=1)
    fall = f"  - {{name: fall, plane: entry, body: earth, near: {AT}, altitude: {keys.get('altitude', '100 km')}}}\n"
    return text.split("predictions:")[0] + "predictions:\n" + fall


def mission_of(minimal_text: str, **changed: str) -> Mission:
    return load_mission_text(text_of(minimal_text, **changed))


def test_the_place_is_astropys_and_the_velocity_points_as_said() -> None:
    """astropy's ITRS of the time; the Earth's centre from the ephemeris. A metre and 0.001 deg."""
    when = "2018-06-02T16:44:05 UTC"
    orbit = ImpactOrbit.model_validate(
        {"kind": "impact", "at": when, "longitude": "30 deg", "latitude": "-20 deg", "elevation": "45 deg",
         "azimuth": "75 deg", "speed": "20 km/s"}
    )  # fmt: skip
    ephemeris, at = Ephemeris.load(), np.zeros(1)
    earth = ephemeris.state_km_km_s("earth", orbit.at, at)[0] - ephemeris.state_km_km_s("sun", orbit.at, at)[0]
    state = orbit.state(ephemeris) - earth
    time = Time(when.removesuffix(" UTC"), scale="utc")
    place = EarthLocation.from_geodetic(30 * u.deg, -20 * u.deg, 100 * u.km, ellipsoid="WGS84")
    right = place.get_itrs(time).transform_to(GCRS(obstime=time)).cartesian.xyz.to_value(u.km)
    assert np.linalg.norm(state[:3] - right) < 1e-3
    velocity = GCRS(CartesianRepresentation(*(state[3:] / np.linalg.norm(state[3:]))), obstime=time)
    along = velocity.transform_to(ITRS(obstime=time)).cartesian.xyz.value
    lon, lat = np.radians([30.0, -20.0])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    north = np.cross(up, east)
    assert np.degrees(np.arcsin(-along @ up)) == pytest.approx(45.0, abs=1e-3)
    assert np.degrees(np.arctan2(along @ east, along @ north)) == pytest.approx(75.0, abs=1e-3)
    assert np.linalg.norm(state[3:]) == pytest.approx(20.0, rel=1e-12)


ROUND_TRIPS = [(11.2, 5.0), (11.2, 90.0), (15.0, 20.0), (25.0, 60.0), (40.0, 5.0), (40.0, 89.0)]


@pytest.mark.parametrize(("speed", "elevation"), ROUND_TRIPS)
def test_flown_back_two_months_and_forth_it_comes_down_there(minimal_text: str, speed: float, elevation: float) -> None:
    """Within 1 m, 0.1 ms; the path is as steep and as fast as was said."""
    mission = mission_of(minimal_text, speed=f"{speed} km/s", elevation=f"{elevation} deg")
    scene = build_scene(mission)
    facts = quantity(scene, scene.trajectory, mission.predictions[0]).facts
    assert isinstance(facts, EntryFacts)
    assert facts.ground is not None
    off = np.array([facts.ground.latitude_deg + 20.0, (facts.ground.longitude_deg - 30.0) * np.cos(np.radians(20.0))])
    assert 6378e3 * np.radians(np.linalg.norm(off)) < 1.0
    assert abs(facts.epoch - mission.object.orbit.epoch) < 1e-4
    assert facts.speed_km_s == pytest.approx(speed, rel=1e-8)
    assert facts.path_below_horizon_deg == pytest.approx(elevation, abs=1e-5)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"speed": "11 km/s"}, r"orbit\.speed: .*more than 11\.09 km/s"),
        ({"speed": "80 km/s"}, r"orbit\.speed: .*to 73 km/s"),
        ({"elevation": "0 deg"}, r"orbit\.elevation: .*must lead down"),
        ({"elevation": "91 deg"}, r"orbit\.elevation: .*-90 deg to 90 deg"),
        ({"altitude": "5 km"}, r"orbit\.altitude: .*20 km to 1000 km"),
        ({"at": "2400-05-19T07:00:00 UTC"}, r"orbit"),
        ({"lattitude": "3 deg"}, r'did you mean "latitude"'),
    ],
)
def test_what_cannot_fall_is_said_at_its_key(minimal_text: str, changed: dict[str, str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        mission_of(minimal_text, **changed)


def test_a_fall_before_the_last_measurement_is_said(minimal_text: str) -> None:
    from nebosvod.errors import EventError

    with pytest.raises(EventError, match="2028-04-01"):
        build_scene(mission_of(minimal_text, at="2028-04-01T00:00:00 UTC"))
