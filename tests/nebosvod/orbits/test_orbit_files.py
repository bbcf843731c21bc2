"""Orbits with a covariance: every format, its units and axes, and what is wrong with a file."""

import json
from collections.abc import Callable
from pathlib import Path

import mpmath
import numpy as np
import numpy.typing as npt
import pytest

from nebosvod import UncertainOrbit, read_orbit
from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris, propagate
from nebosvod.errors import InputError
from nebosvod.orbits.conversion import Given, balanced_factor, elements_of, uncertain
from nebosvod.orbits.oef import GAUSS_GM_KM3_S2, read_oef
from nebosvod.timescale import Epoch
from nebosvod.units import AU_KM, DAY_S, DEG

Array = npt.NDArray[np.float64]
SHARED = Path(__file__).resolve().parents[3].parent / "shared"
DATA = SHARED / "data" / "orbits"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the folder of reference data is not here")


def state_by_mpmath(elements: list[mpmath.mpf]) -> mpmath.matrix:
    """Heliocentric ICRF state, km and km/s, of [a au, e, i, node, peri, M in deg], from the textbook's formulas."""
    a, e = elements[0] * AU_KM, elements[1]
    i, node, peri, M = (mpmath.radians(x) for x in elements[2:])
    gm = (mpmath.mpf("0.01720209895")) ** 2 * mpmath.mpf(AU_KM) ** 3 / mpmath.mpf(86400) ** 2
    E = mpmath.findroot(lambda x: x - e * mpmath.sin(x) - M, M + e * mpmath.sin(M))
    n, b = mpmath.sqrt(gm / a**3), a * mpmath.sqrt(1 - e**2)
    rate = n / (1 - e * mpmath.cos(E))
    flat = [(a * (mpmath.cos(E) - e), b * mpmath.sin(E)), (-a * mpmath.sin(E) * rate, b * mpmath.cos(E) * rate)]
    P = [mpmath.cos(node) * mpmath.cos(peri) - mpmath.sin(node) * mpmath.sin(peri) * mpmath.cos(i),
         mpmath.sin(node) * mpmath.cos(peri) + mpmath.cos(node) * mpmath.sin(peri) * mpmath.cos(i),
         mpmath.sin(peri) * mpmath.sin(i)]  # fmt: skip
    Q = [-mpmath.cos(node) * mpmath.sin(peri) - mpmath.sin(node) * mpmath.cos(peri) * mpmath.cos(i),
         -mpmath.sin(node) * mpmath.sin(peri) + mpmath.cos(node) * mpmath.cos(peri) * mpmath.cos(i),
         mpmath.cos(peri) * mpmath.sin(i)]  # fmt: skip
    eps = mpmath.radians(mpmath.mpf("84381.448") / 3600)
    state = []
    for x, y in flat:
        v = [x * p + y * q for p, q in zip(P, Q, strict=True)]
        state += [
            v[0],
            mpmath.cos(eps) * v[1] - mpmath.sin(eps) * v[2],
            mpmath.sin(eps) * v[1] + mpmath.cos(eps) * v[2],
        ]
    return mpmath.matrix(state)


def equinoctial_by_mpmath(x: list[mpmath.mpf]) -> mpmath.matrix:
    """The same of [a au, h, k, p, q, longitude in deg]."""
    e, varpi = mpmath.hypot(x[1], x[2]), mpmath.atan2(x[1], x[2])
    i, node = 2 * mpmath.atan(mpmath.hypot(x[3], x[4])), mpmath.atan2(x[3], x[4])
    angles = (i, node, varpi - node, mpmath.radians(x[5]) - varpi)
    return state_by_mpmath([x[0], e, *(mpmath.degrees(angle) for angle in angles)])


def mapped(
    function: Callable[[list[mpmath.mpf]], mpmath.matrix], values: list[str], K: list[str]
) -> tuple[Array, Array]:
    """State and covariance with 40 digits: differences of a step that costs half of them."""
    with mpmath.workdps(60):
        x = [mpmath.mpf(v) for v in values]
        step = mpmath.mpf(10) ** -25
        J = mpmath.matrix(6, 6)
        for k in range(6):
            up, down = list(x), list(x)
            up[k] += step
            down[k] -= step
            J[:, k] = (function(up) - function(down)) / (2 * step)
        full, upper = mpmath.matrix(6, 6), iter(K)
        for i in range(6):
            for j in range(i, 6):
                full[i, j] = full[j, i] = mpmath.mpf(next(upper))
        covariance = J * full * J.T
        return (np.array([float(v) for v in function(x)]),
                np.array([[float(covariance[i, j]) for j in range(6)] for i in range(6)]))  # fmt: skip


def triangle(path: Path, key: str) -> list[str]:
    """All numbers of the lines of a key, as they are printed."""
    return [word for line in path.read_text().splitlines() if line.split()[:1] == [key] for word in line.split()[1:]]


@pytest.mark.parametrize(
    ("which", "key", "function"), [("yr4", "KEP", state_by_mpmath), ("apollo", "EQU", equinoctial_by_mpmath)]
)
def test_state_and_covariance_of_elements_are_those_of_sixty_digits(
    which: str, key: str, function: Callable[[list[mpmath.mpf]], mpmath.matrix], request: pytest.FixtureRequest
) -> None:
    path = request.getfixturevalue(which)
    orbit = read_orbit(path)
    state, K = mapped(function, triangle(path, key), triangle(path, "COV"))
    sigma = np.sqrt(np.diag(K))
    assert np.abs(orbit.state / state - 1.0).max() < 1e-12
    np.testing.assert_allclose(orbit.sigma, sigma, rtol=1e-12)
    # correlations of a matrix whose smallest eigenvalue is 1e-9 of the largest, by its factor
    np.testing.assert_allclose(orbit.covariance / sigma[:, None] / sigma, K / sigma[:, None] / sigma, atol=2e-14)


def test_normal_matrix_alone_gives_the_covariance_that_stands_beside_it(apollo: Path) -> None:
    both = read_orbit(apollo)
    text = "".join(line for line in apollo.read_text().splitlines(keepends=True) if " COV " not in line)
    alone = uncertain(read_oef(apollo, text), "NOR")
    whitened = np.linalg.solve(both.factor, alone.factor)
    np.testing.assert_allclose(whitened @ whitened.T, np.eye(6), atol=2e-7)  # 16 digits, condition 1e8 of correlations


def test_epoch_is_terrestrial_time_and_units_are_internal(yr4: Path) -> None:
    orbit = read_orbit(yr4)
    assert orbit.name == "2024YR4"
    assert abs(orbit.epoch - Epoch.parse("60704.950998578 MJD TT")) < 1e-9
    assert orbit.magnitude == (24.047, 0.15)
    assert orbit.names == ("x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s")
    assert not orbit.factor.flags.writeable


@pytest.mark.parametrize("kind", ["keplerian", "cometary", "equinoctial", "state"])
def test_round_trip_of_elements_with_their_covariance(kind: str, yr4: Path) -> None:
    orbit = read_orbit(yr4)
    values, factor = elements_of(orbit, kind, GAUSS_GM_KM3_S2)  # type: ignore[arg-type]
    given = Given(
        name=orbit.name, epoch=orbit.epoch, kind=kind, values=values, factor=factor, gm_km3_s2=GAUSS_GM_KM3_S2
    )  # type: ignore[arg-type]
    back = uncertain(given, "back")
    assert np.linalg.norm(back.state[:3] - orbit.state[:3]) < 1e-12 * np.linalg.norm(orbit.state[:3])
    assert np.linalg.norm(back.state[3:] - orbit.state[3:]) < 1e-12 * np.linalg.norm(orbit.state[3:])
    np.testing.assert_allclose(back.sigma, orbit.sigma, rtol=1e-12)
    sigma = orbit.sigma
    difference = (back.covariance - orbit.covariance) / sigma[:, None] / sigma
    assert np.abs(difference).max() < 1e-12


def test_printed_elements_come_back(yr4: Path) -> None:
    values, _ = elements_of(read_orbit(yr4), "keplerian", GAUSS_GM_KM3_S2)
    printed = np.array([float(word) for word in triangle(yr4, "KEP")])
    units = np.array([AU_KM, 1.0, *[DEG] * 4])
    np.testing.assert_allclose(values / units, printed, rtol=1e-12)


def test_jpl_takes_the_elements_of_the_covariance_with_every_digit_of_their_time(sbdb: Path) -> None:
    orbit = read_orbit(sbdb)
    assert orbit.epoch.jd_tdb == 2452655.5
    assert orbit.parameter_names == ("a2_au_d2",)
    assert orbit.nongrav is not None
    assert (orbit.nongrav.a2_au_d2, orbit.nongrav.m, orbit.nongrav.alpha) == (-8.72e-14, 2.0, 1.0)
    values, factor = elements_of(orbit, "cometary", float(Ephemeris.load().gm_km3_s2["sun"]))
    wanted = [
        0.2301,
        0.7751 * AU_KM,
        (2452600 - 2452655.5 + 0.123456789012) * DAY_S,
        278.3 * DEG,
        278.8 * DEG,
        1.6 * DEG,
    ]
    np.testing.assert_allclose(values, wanted, rtol=3e-13)
    sigma = np.linalg.norm(factor, axis=1)
    printed = np.array([1e-7, 1e-7 * AU_KM, 3e-5 * DAY_S, 2e-5 * DEG, 3e-5 * DEG, 1e-6 * DEG, 1.4e-14])
    np.testing.assert_allclose(sigma, printed, rtol=1e-10)
    correlation = (factor @ factor.T) / sigma[:, None] / sigma
    np.testing.assert_allclose(correlation[np.triu_indices(7, 1)], 0.3, atol=1e-9)


def test_bulk_density_of_bennu_stands_for_a2_and_its_area_to_mass_ratio_for_the_pressure(sbdb: Path) -> None:
    answer = json.loads(sbdb.read_text())
    block = answer["orbit"]
    block["model_pars"] = [{"name": "AMRAT", "value": "2.635943157E-6"}, {"name": "RHO", "value": "1191.534909615045"}]
    size = len(block["covariance"]["labels"])
    block["covariance"]["labels"] = [*block["covariance"]["labels"][:6], "RHO", "AMRAT"]
    data = [[*map(float, row[:6]), 0.0, 0.0] for row in block["covariance"]["data"][: size - 1]]
    block["covariance"]["data"] = [*data, [0.0] * 6 + [0.892**2, 0.0], [0.0] * 7 + [1.908e-7**2]]
    sbdb.write_text(json.dumps(answer))
    orbit = read_orbit(sbdb)
    assert orbit.parameter_names == ("a2_au_d2", "thermal_emission")
    assert orbit.nongrav is not None
    assert orbit.radiation is not None
    assert orbit.nongrav.m == 2.25
    assert orbit.nongrav.a2_au_d2 == pytest.approx(-4.6178e-14, rel=1e-5)
    assert orbit.radiation.kappa_m2_kg == pytest.approx(2.635943157e-6, rel=1e-14)
    assert orbit.sigma[6] == pytest.approx(4.6178e-14 * 0.892 / 1191.53, rel=1e-5)
    assert orbit.sigma[7] * orbit.radiation.kappa_partials()["thermal_emission"] == pytest.approx(1.908e-7, rel=1e-12)


def test_covariance_of_a_message_in_radial_axes_is_turned_to_icrf(tmp_path: Path) -> None:
    lines = ["CCSDS_OEM_VERS = 2.0", "CREATION_DATE = 2024-01-01T00:00:00", "ORIGINATOR = TEST", "META_START",
             "OBJECT_NAME = X", "OBJECT_ID = X", "CENTER_NAME = SUN", "REF_FRAME = ICRF", "TIME_SYSTEM = TDB",
             "START_TIME = 2024-01-01T00:00:00", "STOP_TIME = 2024-01-02T00:00:00", "META_STOP",
             "2024-01-01T00:00:00 0 150000000 0 -30 0 0", "2024-01-02T00:00:00 -2592000 150000000 0 -30 -0.5 0",
             "COVARIANCE_START", "EPOCH = 2024-01-01T00:00:00", "COV_REF_FRAME = RTN",
             "4", "0 9", "0 0 16", "0 0 0 1e-6", "0 0 0 0 4e-6", "0 0 0 0 0 9e-6", "COVARIANCE_STOP"]  # fmt: skip
    path = tmp_path / "x.oem"
    path.write_text("\n".join(lines) + "\n")
    orbit = read_orbit(path)
    np.testing.assert_array_equal(orbit.state, [0.0, 1.5e8, 0.0, -30.0, 0.0, 0.0])
    # radial is +y, transverse -x, normal +z
    np.testing.assert_allclose(orbit.covariance, np.diag([9.0, 4.0, 16.0, 4e-6, 1e-6, 9e-6]), atol=1e-15)


def test_fit_and_run_folders_give_their_estimate_with_its_sources(minimal_folder: Path) -> None:
    orbit = read_orbit(minimal_folder)
    summary = json.loads((minimal_folder / "summary.json").read_text())
    row = summary["estimators"][0]
    np.testing.assert_array_equal(orbit.state, row["state_km_km_s"])
    np.testing.assert_allclose(orbit.factor[:6, :6] @ orbit.factor[:6, :6].T, row["covariance_km_km_s"], rtol=1e-9)
    assert orbit.radiation is not None
    assert orbit.radiation.radius_m == row["parameters"]["radius_m"]["estimate"]
    assert orbit.sigma[6] == pytest.approx(row["parameters"]["radius_m"]["sigma"], rel=1e-12)
    assert orbit.epoch.iso() == summary["reference_epoch_tdb"]
    total = sum(G @ G.T for G in orbit.sources.values())
    np.testing.assert_allclose(
        total, orbit.covariance, rtol=1e-10, atol=1e-10 * np.outer(orbit.sigma, orbit.sigma).min()
    )
    assert set(orbit.sources) == {entry["source"] for entry in summary["budget"] if entry["estimator"] == row["name"]}


def test_a_mission_is_what_it_knows_beforehand(tmp_path: Path) -> None:
    from nebosvod.mission.reading.builtin import builtin_path

    text = builtin_path("minimal").read_text() + "\nprior: {sigma: {position: 20 km, velocity: 3 m/s}}\n"
    path = tmp_path / "known.yaml"
    path.write_text(text)
    orbit = read_orbit(path)
    np.testing.assert_allclose(orbit.sigma[:6], [20.0] * 3 + [0.003] * 3, rtol=1e-14)
    assert orbit.parameter_names == ("radius_m", "mass_kg", "albedo")
    with pytest.raises(InputError, match=r"no prior orbit.*nebosvod run"):
        read_orbit("minimal")


def _edited(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (" COV   6.769968240272774E-11", " COV  -6.769968240272774E-11", r"2024YR4.ke0:10: COV: .*variance"),
        ("-7.110469433965839E-10", "-7.120469433965839E-10", r"2024YR4.ke0:10: COV: .*smallest eigenvalue"),
        (" COV   7.681517948700098E-11  3.539236068331752E-10  7.468582398398277E-09\n", "", r":10: COV of dim"),
        ("MJD     60704.950998578 TDT", "MJD     60704.950998578", r"2024YR4.ke0:7: MJD needs"),
        ("ECLM J2000 ", "ECLM B1950 ", r"2024YR4.ke0:3: refsys ECLM B1950"),
        ("'ML'", "'1L'", r"2024YR4.ke0:2: rectype 1L"),
        (" KEP ", " ATT ", r"2024YR4.ke0:6: elements ATT"),
        ("6.6159975981023389E-01", "1.6159975981023389E+00", r"2024YR4.ke0: keplerian elements"),
        ("271.3674684214714", "27l.3674684214714", r"2024YR4.ke0:6: expected numbers"),
        ("LSP   0  0    6", "LSP   3  1    7 1", r"2024YR4.ke0:9: LSP model 3"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_said_at_its_line(old: str, new: str, said: str, yr4: Path) -> None:
    yr4.write_text(_edited(yr4.read_text(), old, new))
    with pytest.raises(InputError, match=said):
        read_orbit(yr4)


def test_an_orbit_without_covariance_says_how_to_give_one(yr4: Path, sbdb: Path) -> None:
    yr4.write_text("\n".join(line for line in yr4.read_text().splitlines() if " COV " not in line))
    with pytest.raises(InputError, match=r"2024YR4 has no covariance.*nebosvod fit"):
        read_orbit(yr4)
    answer = json.loads(sbdb.read_text())
    answer["orbit"]["covariance"] = None
    sbdb.write_text(json.dumps(answer))
    with pytest.raises(InputError, match=r"orbit\.covariance: is missing; ask the service.*cov=mat"):
        read_orbit(sbdb)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("x.json", "{", "x.json:1:2"),
        ("x.json", "[]", "needs a JSON object"),
        ("x.json", '{"a": 1}', "neither an answer of JPL's SBDB nor an mpc_orb.json"),
        ("x.json", '{"CAR": {}, "epoch_data": {}}', "coefficient_names"),
        ("x.dat", "1 2 3\n", "holds no orbit that is read"),
        ("x.yaml", "a: 1\n", "x.yaml:1:1"),
    ],
)
def test_other_files_are_refused_in_a_sentence(name: str, content: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(InputError, match=said):
        read_orbit(path)
    with pytest.raises(InputError, match="no such file"):
        read_orbit(tmp_path / "nothing.ke0")
    with pytest.raises(InputError, match="folder without a run or a fit"):
        read_orbit(tmp_path)


def test_the_type_refuses_what_is_no_orbit() -> None:
    good = {"name": "x", "epoch": Epoch(2460000.5, 0.0), "state": np.ones(6), "factor": np.eye(6)}
    assert UncertainOrbit(**good).sigma_position_km == pytest.approx(np.sqrt(3.0))  # type: ignore[arg-type]
    wrongs = ({"state": np.ones(5)}, {"factor": np.ones((6, 6))}, {"factor": -np.eye(6)}, {"parameter_names": ("x",)})
    for wrong in (*wrongs, {"factor": np.full((6, 6), np.nan)}):
        with pytest.raises(InputError):
            UncertainOrbit(**(good | wrong))  # type: ignore[arg-type]


ORBIT_FILES = (
    [path for folder in ("neocc", "sbdb") for path in sorted((DATA / folder).glob("*"))]
    + sorted((DATA / "mpc_orb").glob("20*.json"))
    + [
        *sorted((DATA / "orbfit_1862_Apollo").glob("1862.*e[ql]*")),
        *(DATA / "orbfit_410777_grav").glob("*.[eo][qe][0l]"),
    ]
)


@needs_data
@pytest.mark.parametrize("path", ORBIT_FILES, ids=lambda path: path.name)
def test_every_orbit_of_the_reference_data_is_read(path: Path) -> None:
    orbit = read_orbit(path)
    assert 0.4 < np.linalg.norm(orbit.state[:3]) / AU_KM < 7.0
    assert (np.diag(orbit.factor) > 0.0).all()


@needs_data
def test_the_reference_data_are_all_among_them() -> None:
    assert len(ORBIT_FILES) >= 50


@needs_data
@pytest.mark.parametrize("name", ["101955", "162173", "2015AB", "2022AP7", "2024YR4", "433", "65803", "99942"])
def test_esas_orbit_amid_the_observations_flies_to_its_own_later_one(name: str) -> None:
    """ESA carried state and covariance itself: the sigmas come out to 2e-3, the state within the covariance."""
    before, after = (read_orbit(DATA / "neocc" / f"{name}.{kind}") for kind in ("ke0", "ke1"))
    state, factor = carried(before, after.epoch)
    sigma = np.linalg.norm(factor[:6], axis=1)
    np.testing.assert_allclose(sigma, after.sigma[:6], rtol=2e-3)
    both = balanced_factor(np.hstack([factor[:6], after.factor[:6]]))
    assert np.linalg.norm(np.linalg.solve(both, state - after.state)) < 3.0


@needs_data
@pytest.mark.parametrize("name", ["2001VB", "2015AB", "2022AP7", "2024YR4", "99942"])
def test_jpl_and_esa_agree_within_their_covariances(name: str) -> None:
    esa, jpl = read_orbit(DATA / "neocc" / f"{name}.ke0"), read_orbit(DATA / "sbdb" / f"{name}_phys.json")
    state, factor = carried(esa, jpl.epoch)
    both = balanced_factor(np.hstack([factor[:6], jpl.factor[:6]]))
    assert np.linalg.norm(np.linalg.solve(both, state - jpl.state)) < 3.0
    sizes = np.linalg.norm(factor[:6], axis=1) / jpl.sigma[:6]
    assert sizes.min() > 0.7
    assert sizes.max() < 2.5


@needs_data
@pytest.mark.parametrize("path", sorted((DATA / "mpc_orb").glob("20*.json")), ids=lambda path: path.name)
def test_cartesian_and_cometary_blocks_of_the_mpc_are_one_orbit(path: Path) -> None:
    """The MPC prints both: elements and their sigmas made from the state are those of its COM block."""
    orbit, said = read_orbit(path), json.loads(path.read_text())["COM"]
    values, factor = elements_of(orbit, "cometary", GAUSS_GM_KM3_S2)
    sigma = np.linalg.norm(factor, axis=1)
    printed = dict(zip(said["coefficient_names"], said["coefficient_values"], strict=True))
    spread = dict(zip(said["coefficient_names"], said["coefficient_uncertainties"], strict=True))
    order = {"e": (0, 1.0), "q": (1, AU_KM), "node": (3, DEG), "argperi": (4, DEG), "i": (5, DEG)}
    for name, (k, unit) in order.items():
        assert values[k] / unit == pytest.approx(printed[name], rel=1e-9)
        assert sigma[k] / unit == pytest.approx(spread[name], rel=1e-4)
    tp = orbit.epoch + values[2] - Epoch.parse("2000-01-01 TT")
    assert tp / DAY_S + 51544.0 == pytest.approx(printed["peri_time"], abs=1e-5)


def carried(orbit: UncertainOrbit, epoch: Epoch) -> tuple[Array, Array]:
    """State (6,) and factor at another epoch."""
    gap = np.array([epoch - orbit.epoch])
    along = propagate(orbit.state, orbit.epoch, gap, orbit.forces(Ephemeris.load()), sensitivities=True)
    return along.state[0], balanced_factor(np.hstack([along.Phi[0], along.zeta[0]]) @ orbit.factor)


@needs_data
def test_a_fit_and_the_message_it_exports_are_one_orbit(tmp_path: Path) -> None:
    """The message is read where it is best known, two weeks earlier, and comes back by our own flight."""
    data, folder = SHARED / "data" / "observations" / "2023DW.obs80", tmp_path / "dw"
    assert main(["fit", str(data), "-o", str(folder), "--export"]) == 0
    fit, message = read_orbit(folder), read_orbit(folder / "orbit.oem")
    assert message.epoch < fit.epoch
    assert message.sigma_position_km < fit.sigma_position_km
    state, factor = carried(message, fit.epoch)
    assert np.linalg.norm(np.linalg.solve(fit.factor, state - fit.state)) < 0.05
    np.testing.assert_allclose(np.linalg.norm(factor[:6], axis=1), fit.sigma, rtol=2e-3)
