"""The scene: telescopes on every kind of orbit, every kind of uncertainty, and orbits that hit the Earth."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import EarthLocation

from nebosvod.dynamics.constants import RADIUS_KM
from nebosvod.engine.evaluation import quantity
from nebosvod.errors import CoverageError, DataError, EventError, InputError, NoAnswerError
from nebosvod.mission import Mission, load_mission, load_mission_text
from nebosvod.scene.instruments import NUISANCES, SPACECRAFT, kind_of
from nebosvod.scene.point import View
from nebosvod.scene.prior import PriorTable
from nebosvod.scene.scene import Scene, build_scene
from nebosvod.timescale import Epoch

Setting = tuple[Scene, PriorTable, View]
AHEAD = "orbit: {kind: heliocentric, lead: 10 deg}"
AU_KM = 149597870.7


def first_on(orbit: str, minimal: Mission) -> str:
    """The smallest mission with another orbit of the first telescope; the second stays behind the Earth."""
    text = minimal.text.replace("orbit: {lead: -10 deg}", "orbit: {kind: heliocentric, lead: -10 deg}")
    return text.replace(AHEAD, f"orbit: {orbit}", 1)


ORBITS = {
    "geostationary": ("longitude: 20 deg", "earth", 42164.2, 1.0),
    "geocentric": ("a: 10000 km, i: 60 deg, M: 30 deg, j2: false", "earth", 10000.0, 1e-6),
    "sun_synchronous": ("altitude: 700 km, local_time: 6 h", "earth", 7078.1366, 1e-6),
    "heliocentric": ("lead: -20 deg", "sun", 0.996 * AU_KM, 1e6),
    "heliocentric_kepler": ("a: 0.7 au, M: 50 deg", "sun", 0.7 * AU_KM, 1.0),
    "libration": ("point: L1, amplitude: 0 km", "earth", 1.494e6, 2e4),
    "distant_retrograde": ("size: 5e6 km", "earth", 5e6, 2e5),
    "ground": ("longitude: 289.25058 deg, rho_cos_phi: 0.864981, rho_sin_phi: -0.500958, extrapolate: true", "earth",
               6375.43, 0.01),
}  # fmt: skip


@pytest.mark.parametrize("kind", ORBITS)
def test_a_telescope_is_as_far_from_its_central_body_as_its_orbit_says(kind: str, minimal: Mission) -> None:
    keys, centre, distance_km, allowed_km = ORBITS[kind]
    scene = build_scene(load_mission_text(first_on(f"{{kind: {kind}, {keys}}}", minimal)))
    t_s = np.zeros(1)
    state = scene.telescopes[0].spacecraft.state_km_km_s(scene.ephemeris, scene.epoch, t_s)
    relative = state[0, :3] - scene.ephemeris.position_km(centre, scene.epoch, t_s)[0]
    assert np.linalg.norm(relative) == pytest.approx(distance_km, abs=allowed_km)


def test_the_tables_of_kinds_know_all_that_a_mission_can_say() -> None:
    from typing import get_args

    from nebosvod.mission.bias import Bias
    from nebosvod.mission.position import Position
    from nebosvod.mission.spacecraft import TelescopeOrbit

    assert set(SPACECRAFT) == set(get_args(get_args(TelescopeOrbit)[0]))
    said = {("bias", word) for word in get_args(Bias.model_fields["correlation"].annotation)}
    said |= {("position", word) for word in get_args(Position.model_fields["correlation"].annotation)}
    others = ("timing", "plate_scale", "photocentre", "process_noise")
    assert set(NUISANCES) == said | {(word, "constant") for word in others}


TABLE = """# a companion of the Earth
epoch,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s
"""


def with_file(folder: Path, minimal: Mission, orbit: str, name: str, text: str) -> Mission:
    """The smallest mission with the first telescope's orbit in a file beside it."""
    (folder / name).write_text(text, "utf-8")
    path = folder / "m.yaml"
    path.write_text(first_on(orbit, minimal), "utf-8")
    return load_mission(path)


def states_of(scene: Scene, days: np.ndarray) -> list[str]:
    """Lines of an orbit table: the first telescope about the Sun."""
    t_s = days * 86400.0
    state = scene.telescopes[0].spacecraft.state_km_km_s(scene.ephemeris, scene.epoch, t_s)
    state -= scene.ephemeris.state_km_km_s("sun", scene.epoch, t_s)
    return [f"{(scene.epoch + t).iso()}," + ",".join(f"{x:.9f}" for x in row) for t, row in zip(t_s, state)]


def test_a_table_gives_back_the_orbit_it_was_made_from(tmp_path: Path, minimal: Mission) -> None:
    original = build_scene(minimal)
    lines = states_of(original, np.arange(-2.0, 42.0))
    orbit = "{kind: table, file: orbit.csv, origin: sun}"
    scene = build_scene(with_file(tmp_path, minimal, orbit, "orbit.csv", TABLE + "\n".join(lines)))
    t_s = np.linspace(0.0, 30.0, 7) * 86400.0
    states = [s.telescopes[0].spacecraft.state_km_km_s(s.ephemeris, s.epoch, t_s) for s in (original, scene)]
    # the Earth's wobble with the Moon, 4670 km in 27 d, through eight daily states
    assert np.abs(states[0][:, :3] - states[1][:, :3]).max() < 0.1  # km
    assert scene.mission.input_files == ((tmp_path / "orbit.csv").resolve(),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("epoch,x,y\n", 'orbit.csv:1: the first line must be "epoch,x_km'),
        (TABLE + "2028-03-20 TDB,1,2,3,4,5\n", "orbit.csv:3: needs 7 columns"),
        (TABLE + "2028-03-20,1,2,3,4,5,6\n", "orbit.csv:3: "),
        (TABLE + "2028-03-20 TDB,1,2,3,4,5,inf\n", "orbit.csv:3: needs finite numbers"),
        (TABLE + "2028-03-20 TDB,1,2,3,4,5,x\n", "orbit.csv:3: could not convert"),
        (TABLE + "2028-03-21 TDB,1,2,3,4,5,6\n2028-03-20 TDB,1,2,3,4,5,6\n", "orbit.csv:4: epochs must ascend"),
        (TABLE + "2028-03-21 TDB,1,2,3,4,5,6\n", "needs at least two states"),
        ("", "orbit.csv:1: the first line must be"),
    ],
)
def test_a_wrong_table_is_refused_at_its_line(tmp_path: Path, minimal: Mission, text: str, message: str) -> None:
    mission = with_file(tmp_path, minimal, "{kind: table, file: orbit.csv, origin: sun}", "orbit.csv", text)
    with pytest.raises(InputError) as caught:
        build_scene(mission)
    assert message in str(caught.value)


def test_a_table_that_ends_too_soon_says_what_it_covers(tmp_path: Path, minimal: Mission) -> None:
    lines = states_of(build_scene(minimal), np.arange(-2.0, 10.0))
    orbit = "{kind: table, file: orbit.csv, origin: sun}"
    mission = with_file(tmp_path, minimal, orbit, "orbit.csv", TABLE + "\n".join(lines))
    with pytest.raises(CoverageError, match=r"orbit\.csv: no state at 2028-03-30"):
        build_scene(mission)


def test_files_that_are_no_orbits_are_refused(tmp_path: Path, minimal: Mission) -> None:
    with pytest.raises(DataError, match="not an SPK file, or a damaged one"):
        build_scene(with_file(tmp_path, minimal, "{kind: spk, file: a.bsp}", "a.bsp", "no kernel"))
    with pytest.raises(DataError, match="not an OEM in keyword notation"):
        build_scene(with_file(tmp_path, minimal, "{kind: oem, file: a.oem}", "a.oem", "no message"))
    orbit = "{kind: ground, code: X05, file: codes.json, extrapolate: true}"
    with pytest.raises(InputError, match=r"codes\.json: has no usable entry X05"):
        build_scene(with_file(tmp_path, minimal, orbit, "codes.json", "{}"))


def test_an_observatory_code_is_the_site_of_its_parallax_constants(tmp_path: Path, minimal: Mission) -> None:
    text = '{"X05": {"Longitude": 289.25058, "cos": 0.864981, "sin": -0.500958, "Name": "Rubin"}}'
    orbit = "{kind: ground, code: X05, file: codes.json, extrapolate: true}"
    by_code = build_scene(with_file(tmp_path, minimal, orbit, "codes.json", text))
    by_hand = build_scene(load_mission_text(first_on("{kind: ground, " + ORBITS["ground"][0] + "}", minimal)))
    states = [s.telescopes[0].spacecraft.state_km_km_s(s.ephemeris, s.epoch, np.zeros(1)) for s in (by_code, by_hand)]
    assert np.allclose(*states, rtol=0.0, atol=1e-6)  # type: ignore[misc]


def test_a_ground_epoch_after_the_earth_rotation_table_is_refused_unless_extrapolation_is_allowed(
    minimal: Mission,
) -> None:
    orbit = "{kind: ground, longitude: 0 deg, rho_cos_phi: 0.8, rho_sin_phi: 0.6}"
    with pytest.raises(
        InputError, match=r"mission:23:13: schedule\[0\].start: ahead stands .*Earth-rotation table covers"
    ):
        load_mission_text(first_on(orbit, minimal))
    allowed = orbit.replace("}", ", extrapolate: true}")
    assert build_scene(load_mission_text(first_on(allowed, minimal))).visibilities[0].visible.any()


def test_telescopes_with_orbits_said_alike_ride_on_one_spacecraft_and_may_share_its_error(minimal: Mission) -> None:
    error = "sigma: 1 km, velocity_sigma: 1 mm/s, correlation: orbit_error, treatment: considered"
    shared = f"shared: [{{name: orbit, position: {{{error}}}}}]\n"
    text = minimal.text.replace("orbit: {lead: -10 deg}", "noise: {sigma: 1 arcsec}") + shared
    scene = build_scene(load_mission_text(text))
    assert scene.telescopes[0].spacecraft is scene.telescopes[1].spacecraft
    assert kind_of(scene.sources["orbit"]) == ("position", "orbit_error")


HIT_S = 86400.0 + 2000.0  # s: about the entry of the impactor of soda-like after its reference epoch


@pytest.fixture(scope="module")
def soda() -> Scene:
    return build_scene(load_mission("soda-like"))


def test_an_orbit_that_hits_is_followed_to_the_surface(soda: Scene) -> None:
    end = soda.trajectory.span_s[1]
    earth = soda.ephemeris.position_km("earth", soda.epoch, np.array([end]))
    sun = soda.ephemeris.position_km("sun", soda.epoch, np.array([end]))
    height = np.linalg.norm(soda.trajectory.state_at([end])[0, :3] + sun[0] - earth[0]) - RADIUS_KM["earth"]
    # the two seconds below the ground in which it is differenced: 12 km; the ellipsoid at 52 deg lies 13 km lower
    assert -40.0 < height < -10.0


def test_the_impactor_enters_where_and_as_it_was_made_to(soda: Scene) -> None:
    asked = {p.name: quantity(soda, soda.trajectory, p) for p in soda.mission.predictions}
    entry = asked["entry point"]
    # made to come at 03:20:00 and 18.3 deg through a sphere 100 km above the equator, which at 81.5 N lies 20.9 km
    # higher than the ellipsoid: 3.6 s at 5.8 km/s, in which the horizon turns by 0.57 deg
    late = 20.9 / (18.87 * np.sin(np.radians(18.0)))
    assert entry.epoch - Epoch.parse("2030-02-15T03:20:00 TDB") == pytest.approx(late, abs=0.1)
    assert entry.facts.path_below_horizon_deg == pytest.approx(18.3 - 0.57, abs=0.1)
    assert entry.facts.speed_km_s == pytest.approx(18.86, abs=0.02)
    assert entry.facts.evaluated_on == "estimated orbit"
    assert asked["target plane"].encounter.impact
    value = asked["target plane"].value
    assert value is not None
    assert np.hypot(*value) < asked["target plane"].encounter.capture_radius_km
    perigee = asked["perigee without an Earth"].value
    assert perigee is not None
    assert perigee[0] < RADIUS_KM["earth"]


@pytest.mark.parametrize("column", range(6))
def test_partials_of_an_impact_equal_differences_of_other_impacts(soda: Scene, column: int) -> None:
    """Entry point, target plane and perigee of orbits that start 0.1 km or 1e-5 km/s beside the nominal one."""
    step = 0.1 if column < 3 else 1e-5
    shifted = []
    for sign in (1.0, -1.0):
        state = soda.state.copy()
        state[column] += sign * step
        shifted.append(soda.propagate(state, soda.forces))
    for request in soda.mission.predictions[1:]:
        nominal = quantity(soda, soda.trajectory, request)
        ahead, behind = (quantity(soda, trajectory, request).value for trajectory in shifted)
        assert ahead is not None
        assert behind is not None
        slope = (ahead - behind) / (2.0 * step)
        assert nominal.partials[:, column] == pytest.approx(slope, rel=1e-3, abs=1e-3 * np.abs(slope).max())
    entry = soda.mission.predictions[0]
    nominal = quantity(soda, soda.trajectory, entry)
    places = [quantity(soda, trajectory, entry).facts.ground for trajectory in shifted]
    points = [
        EarthLocation.from_geodetic(at.longitude_deg, at.latitude_deg, 100.0 * u.km).get_itrs().cartesian.xyz
        for at in places
    ]
    moved = np.linalg.norm((points[0] - points[1]).to_value(u.km))
    assert np.linalg.norm(nominal.partials[:, column]) * 2.0 * step == pytest.approx(moved, rel=1e-3)


def test_a_state_asked_for_after_the_impact_is_refused_with_time_and_distance() -> None:
    text = load_mission("soda-like").text + "  - {name: late, plane: position, at: 2030-02-16T00:00:00 TDB}\n"
    scene = build_scene(load_mission_text(text))
    with pytest.raises(NoAnswerError, match=r"hits earth on 2030-02-15T03:2\d:\d\d TDB and ends there") as caught:
        quantity(scene, scene.trajectory, scene.mission.predictions[-1])
    assert caught.value.status == "after_impact"
    late = load_mission("soda-like").text.replace("end: 2030-02-14T23:20:00", "end: 2030-02-15T05:20:00")
    with pytest.raises(EventError, match=r"hits earth at about 2030-02-15T03:2\d:\d\d.* km from its centre"):
        build_scene(load_mission_text(late))


def test_an_entry_is_refused_where_the_orbit_stays_above(make_setting: Callable[[Mission], Setting]) -> None:
    asked = "{name: perigee, plane: entry, altitude: 100 km, near: 2029-04-13T21:46:00 TDB}"
    text = load_mission("apophis-2029").text
    old = next(line for line in text.splitlines() if "name: perigee" in line)
    scene = build_scene(load_mission_text(text.replace(old, "  - " + asked)))
    with pytest.raises(NoAnswerError, match="does not come down to 100 km; use b_plane"):
        quantity(scene, scene.trajectory, scene.mission.predictions[-1])
