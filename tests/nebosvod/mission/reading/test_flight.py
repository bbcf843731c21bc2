"""Orbits inside the Sun, or round it thousands of times, are found by `check`: row 39 of the bad inputs."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris
from nebosvod.errors import EventError, InputError
from nebosvod.mission import estimate_cost, load_mission, load_mission_text
from nebosvod.mission.reading.flight import MOST_STEPS, size_km, steps
from nebosvod.scene.scene import build_scene
from nebosvod.timescale import Epoch

AU_KM, GM = 149597870.7, 1.32712440041e11
MINIMAL = load_mission("minimal").text
KEPLERIAN = "a: 1.3 au, e: 0.2, i: 8 deg, node: 0 deg, peri: 180 deg, M: 0 deg"
ANGLES = "i: 8 deg, node: 0 deg, peri: 180 deg, M: 0 deg"
KIND = "kind: keplerian, frame: ecliptic_j2000, epoch: 2028-03-20T00:00:00 TDB"


def of_orbit(elements: str, kind: str = "keplerian", text: str = MINIMAL) -> str:
    """The smallest mission about another orbit."""
    assert KEPLERIAN in text
    return text.replace(KEPLERIAN, elements).replace("kind: keplerian", f"kind: {kind}")


@pytest.mark.parametrize(
    ("kind", "elements", "distance"),
    [
        ("keplerian", f"a: 0.003 au, e: 0, {ANGLES}", 0.003 * AU_KM),
        ("keplerian", f"a: 1 au, e: 0.998, {ANGLES}", 0.002 * AU_KM),
        ("keplerian", f"a: 1e-5 au, e: 0, {ANGLES}", 1e-5 * AU_KM),
        ("equinoctial", "a: 1 au, h: 0.998, k: 0, p: 0, q: 0, longitude: 90 deg", 0.002 * AU_KM),
        (
            "cometary",
            "e: 1, q: 400000 km, tp: 2028-03-20T00:00:00 TDB, i: 8 deg, node: 0 deg, peri: 180 deg",
            400000.0,
        ),
        (
            "cometary",
            "e: 1.2, q: 400000 km, tp: 2028-03-20T00:00:00 TDB, i: 8 deg, node: 0 deg, peri: 180 deg",
            400000.0,
        ),
    ],
)
def test_an_orbit_that_starts_inside_the_sun_is_refused_with_its_place(
    kind: str, elements: str, distance: float
) -> None:
    with pytest.raises(InputError, match=r"^mission:11:3: object.orbit: starts inside the Sun \(got ") as caught:
        load_mission_text(of_orbit(elements, kind))
    assert float(str(caught.value).split("got ")[1].split(" km")[0]) == pytest.approx(distance, rel=1e-5)


def test_an_orbit_that_dives_into_the_sun_later_is_no_wrong_input() -> None:
    """Its perihelion is inside of the Sun, months from its epoch: whether it gets there, a run finds out."""
    assert load_mission_text(of_orbit("a: 1 au, e: 0.998, i: 8 deg, node: 0 deg, peri: 180 deg, M: 180 deg"))


def test_revolutions_are_counted_and_too_many_are_refused_without_flying_them(tmp_path: Path) -> None:
    """0.006 au is just above the Sun: 4.07 h a revolution by Kepler's third law; four years of it took 3 GB."""
    text = of_orbit(f"a: 0.006 au, e: 0, {ANGLES}")
    hours = 2.0 * math.pi * math.sqrt((0.006 * AU_KM) ** 3 / GM) / 3600.0
    assert steps(load_mission_text(text)) == pytest.approx(40.0 * 24.0 / hours * 17.2, rel=1e-9)
    path = tmp_path / "often.yaml"
    path.write_text(text.replace(KIND, KIND.replace("2028", "2024")), "utf-8")
    limit = "import resource; resource.setrlimit(resource.RLIMIT_AS, (500_000_000,) * 2); import nebosvod.cli as c; "
    for command in ("check", "run"):
        call = [sys.executable, "-c", f"{limit} raise SystemExit(c.main(['{command}', 'often.yaml']))"]
        done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert done.returncode == 2
        assert "often.yaml:11:3: object.orbit: goes round the Sun 8," in done.stderr
        assert f"(allowed {MOST_STEPS:,})" in done.stderr


def test_the_cost_of_many_revolutions_is_said() -> None:
    usual, often = (
        estimate_cost(load_mission_text(text)) for text in (MINIMAL, of_orbit(f"a: 0.006 au, e: 0, {ANGLES}"))
    )
    assert often.memory_mb > usual.memory_mb + 50.0
    assert often.time_s > usual.time_s + 2.0


def test_size_of_an_orbit_is_the_same_in_all_its_forms() -> None:
    """Vis-viva of a state at perihelion; a hyperbola does not return."""
    q, a = size_km(load_mission("minimal").object.orbit)
    assert (q, a) == pytest.approx((1.04 * AU_KM, 1.3 * AU_KM), rel=1e-12)
    speed = math.sqrt(GM * (2.0 / q - 1.0 / a))
    for frame_speed, wanted in ((speed, (q, a)), (1.5 * speed, (q, math.inf))):
        state = f"position: [{q} km, 0 km, 0 km], velocity: [0 km/s, {frame_speed} km/s, 0 km/s]"
        assert size_km(load_mission_text(of_orbit(state, "state")).object.orbit) == pytest.approx(wanted, rel=1e-9)


def beside(
    body: str, offset_km: tuple[float, float, float], elements: str = "position: [{place}], velocity: [{speed}]"
) -> str:
    """A state, ICRF, so far from the centre of a body on 2028-03-20, going with it at 1 km/s more."""
    ephemeris, epoch = Ephemeris.load(), Epoch.parse("2028-03-20T00:00:00 TDB")
    state = np.subtract(*(ephemeris.state_km_km_s(name, epoch, np.zeros(1))[0] for name in (body, "sun")))
    state += [*offset_km, 0.0, 1.0, 0.0]
    return elements.format(
        place=", ".join(f"{x:.9f} km" for x in state[:3]), speed=", ".join(f"{x:.9f} km/s" for x in state[3:])
    )


@pytest.mark.parametrize(
    ("body", "called", "offset", "distance"),
    [
        ("earth", "the Earth", (3000.0, 4000.0, 0.0), 5000.0),
        ("moon", "the Moon", (0.0, 0.0, 1700.0), 1700.0),
        ("mars", "Mars", (0.0, 3390.0, 0.0), 3390.0),
        ("jupiter", "Jupiter", (71000.0, 0.0, 0.0), 71000.0),
        ("pluto", "Pluto", (1.0, 0.0, 0.0), 1.0),
    ],
)
@pytest.mark.parametrize("command", ["check", "run", "validate", "plan"])
def test_an_orbit_that_starts_inside_a_planet_or_the_moon_is_refused_by_every_command_alike(
    command: str,
    body: str,
    called: str,
    offset: tuple[float, float, float],
    distance: float,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(of_orbit(beside(body, offset), "state").replace("ecliptic_j2000", "icrf"), "utf-8")
    assert main([command, str(path)]) == 2
    message = capsys.readouterr().err
    assert message.startswith(f"error: {path}:11:3: object.orbit: starts inside {called} (got ")
    assert float(message.split("got ")[1].split(" km")[0]) == pytest.approx(distance, rel=1e-4)
    assert list(tmp_path.iterdir()) == [path]


def test_an_orbit_may_start_over_a_pole_of_the_earth_below_its_equatorial_radius() -> None:
    """The ellipsoid of WGS 84 is 6356.75 km high at the poles, 6378.14 km at the equator."""
    for height, wanted in ((6360.0, True), (6354.0, False)):
        text = of_orbit(beside("earth", (0.0, 0.0, height)), "state").replace("ecliptic_j2000", "icrf")
        if wanted:
            assert load_mission_text(text)
        else:
            with pytest.raises(InputError, match="starts inside the Earth"):
                load_mission_text(text)


def test_an_orbit_about_the_earth_is_given_up_where_its_steps_would_fill_the_memory() -> None:
    """Round the Sun it goes once; round the Earth, 90 minutes each, a thousand times in the 70 days."""
    earth = load_mission("minimal")
    from nebosvod.scene.scene import load_ephemeris

    ephemeris = load_ephemeris(earth)
    epoch = earth.reference_epoch
    state = (ephemeris.state_km_km_s("earth", epoch, np.zeros(1)) - ephemeris.state_km_km_s("sun", epoch, np.zeros(1)))[
        0
    ]
    state += [6800.0, 0.0, 0.0, 0.0, math.sqrt(398600.4418 / 6800.0), 0.0]
    place, speed = (
        ", ".join(f"{x:.9f} {unit}" for x in part) for part, unit in ((state[:3], "km"), (state[3:], "km/s"))
    )
    text = of_orbit(f"position: [{place}], velocity: [{speed}]", "state").replace("ecliptic_j2000", "icrf")
    text = text.replace("end: 2028-04-19", "end: 2028-05-19")
    with pytest.raises(EventError, match=rf"gives up .* after the {MOST_STEPS} steps it may take .* centre of earth"):
        build_scene(load_mission_text(text))


def test_what_the_mission_says_of_steps_is_what_the_stages_do() -> None:
    """The stages are not loaded for two numbers; they stand twice, and must be the same."""
    from nebosvod.dynamics import impact, integrator
    from nebosvod.mission.reading import flight

    assert flight.MOST_STEPS == impact.MOST_STEPS
    assert flight.LARGEST_STEP_S == integrator.LARGEST_STEP_S


def test_an_orbit_far_out_takes_the_longest_steps_and_no_longer() -> None:
    """Its 17 steps to a revolution of 90 years would be five years each; the integrator makes them 20 days."""
    text = of_orbit("a: 20 au, e: 0.1, i: 2 deg, node: 0 deg, peri: 0 deg, M: 0 deg")
    text = text.replace("at: 2028-04-29", "at: 2048-04-29")
    mission = load_mission_text(text)
    taken = len(build_scene(mission).trajectory._table.edges) - 1
    assert steps(mission) == pytest.approx(taken, rel=0.15)
