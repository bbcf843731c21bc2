"""The force model: what it accepts, and how parameters map to kernel columns."""

from typing import Any

import numpy as np
import pytest

from nebosvod.dynamics import Ephemeris, ForceModel, Nongrav, RadiationPressure
from nebosvod.errors import InputError
from nebosvod.timescale import Epoch

BALL = RadiationPressure(radius_m=170.0, mass_kg=6.1e10, albedo=0.159)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parameters": ("colour",)}, 'unknown dynamic parameter "colour"; known: radius_m'),
        ({"parameters": ("radius_m",)}, "radius_m needs radiation pressure, which is off"),
        ({"parameters": ("a2_au_d2",)}, "a2_au_d2 needs non-gravitational acceleration, which is off"),
        ({"parameters": ("mass_kg", "mass_kg"), "radiation": BALL}, "repeat"),
        ({"relativity": "general"}, "none, sun, eih"),
        ({"earth_pole": "b1950"}, "allowed: date, j2000"),
        ({"earth_harmonics": 5}, "allowed: 2, 3, 4"),
        ({"excluded": ("apophis",)}, 'excluded "apophis" is unknown; known: camilla'),
        ({"asteroids": "no"}, r'^asteroids "no" is not allowed \(True or False\)$'),
        ({"earth_oblateness": 0}, r"^earth_oblateness 0 is not allowed \(True or False\)$"),
        ({"sun_oblateness": None}, r"^sun_oblateness None is not allowed \(True or False\)$"),
        ({"earth_shadow": "off"}, r'^earth_shadow "off" is not allowed \(True or False\)$'),
    ],
)
def test_wrong_models_are_refused(ephemeris: Ephemeris, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ForceModel(ephemeris=ephemeris, **options)


@pytest.mark.parametrize("switch", ["asteroids", "earth_oblateness", "sun_oblateness", "earth_shadow"])
@pytest.mark.parametrize("value", [True, False])
def test_a_switch_of_numpy_is_a_switch(ephemeris: Ephemeris, switch: str, value: bool) -> None:
    options: dict[str, Any] = {switch: np.bool_(value)}
    assert getattr(ForceModel(ephemeris=ephemeris, **options), switch) is value


@pytest.mark.parametrize(
    "values",
    [
        {"radius_m": 0.0},
        {"mass_kg": -1.0},
        {"albedo": 1.1},
        {"albedo": -0.1},
        {"thermal_emission": 0.5},
        {"radius_m": np.inf},
        {"albedo": np.nan},
    ],
)
def test_impossible_spheres_are_refused(values: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(values))):
        RadiationPressure(**{"radius_m": 1.0, "mass_kg": 1.0, "albedo": 0.1, **values})


def test_nongrav_must_be_finite() -> None:
    with pytest.raises(InputError, match="a2_au_d2"):
        Nongrav(a2_au_d2=float("nan"))


@pytest.mark.parametrize(("name", "value"), [("alpha", 0.0), ("r0_au", -1.0), ("m", float("inf")), ("k", float("nan"))])
def test_law_of_marsden_must_make_sense(name: str, value: float) -> None:
    with pytest.raises(InputError, match=name):
        Nongrav(**{name: value})


def test_harmonics_end_at_the_degree_asked_for(ephemeris: Ephemeris) -> None:
    epoch = Epoch.parse("2029-04-13T00:00:00 TDB")
    kept = [ForceModel(ephemeris=ephemeris, earth_harmonics=d).physics(epoch).earth_zonal for d in (2, 3, 4)]
    assert [np.count_nonzero(zonal) for zonal in kept] == [2, 3, 4]
    assert kept[2][1:].tolist() == [ephemeris.scalars[f"earth_j{d}"] for d in (2, 3, 4)]


def test_excluded_asteroid_leaves_window_and_masses_in_step(ephemeris: Ephemeris) -> None:
    """Each row of the window is the body whose mass stands at its place."""
    epoch = Epoch.parse("2029-04-13T00:00:00 TDB")
    model, full = ForceModel(ephemeris=ephemeris, excluded=("ceres", "vesta")), ForceModel(ephemeris=ephemeris)
    window, whole = model.window(epoch, 0.0, 1e6), full.window(epoch, 0.0, 1e6)
    assert len(window.layout) == len(window.timing) == len(model.physics(epoch).gm) == len(model.bodies) == 25
    for row, body in enumerate(model.bodies):
        assert model.physics(epoch).gm[row] == ephemeris.gm_km3_s2[body]
        assert (window.layout[row] == whole.layout[full.bodies.index(body)]).all()


def test_kappa_of_apophis() -> None:
    """pi 170^2/6.1e10 (1 + 4 0.159/9), by hand: 1.5936e-6 m^2/kg; as A1 at 1 au 3.6e-13 au/d^2 (from the design)."""
    from nebosvod.dynamics.constants import AU_D2_KM_S2, AU_KM, RADIATION_KM3_S2_PER_M2_KG

    assert BALL.kappa_m2_kg == pytest.approx(1.5936e-6, rel=1e-4)
    a1 = RADIATION_KM3_S2_PER_M2_KG * BALL.kappa_m2_kg / AU_KM**2 / AU_D2_KM_S2
    assert a1 == pytest.approx(3.6e-13, rel=0.02)


def test_albedo_drops_out_of_a_fully_re_emitting_sphere() -> None:
    hot = RadiationPressure(radius_m=170.0, mass_kg=6.1e10, albedo=0.159, thermal_emission=4.0 / 9.0)
    assert hot.kappa_partials()["albedo"] == pytest.approx(0.0, abs=1e-25)


def test_kappa_partials_are_derivatives() -> None:
    """1e-8 relative: central differences of 0.01 %."""
    ball = RadiationPressure(radius_m=170.0, mass_kg=6.1e10, albedo=0.159, thermal_emission=0.2)
    values = {name: getattr(ball, name) for name in ball.kappa_partials()}
    for name, partial in ball.kappa_partials().items():
        step = 1e-4 * values[name]
        ahead, behind = (RadiationPressure(**{**values, name: values[name] + s * step}) for s in (1, -1))
        assert (ahead.kappa_m2_kg - behind.kappa_m2_kg) / (2 * step) == pytest.approx(partial, rel=3e-8)


def test_columns_serve_parameters_in_any_order(ephemeris: Ephemeris) -> None:
    names = ("a2_au_d2", "albedo", "radius_m", "a1_au_d2")
    model = ForceModel(ephemeris=ephemeris, radiation=BALL, nongrav=Nongrav(), parameters=names)
    columns, chain = model.columns()
    partials = BALL.kappa_partials()
    assert columns.tolist() == [0, 1, 2]
    assert chain[0].tolist() == [0.0, partials["albedo"], partials["radius_m"], 0.0]
    assert chain[1].tolist() == [0.0, 0.0, 0.0, 1.0]
    assert chain[2].tolist() == [1.0, 0.0, 0.0, 0.0]


def test_values_move_and_the_original_stays(ephemeris: Ephemeris) -> None:
    model = ForceModel(
        ephemeris=ephemeris,
        radiation=BALL,
        nongrav=Nongrav(a2_au_d2=-3e-14),
        relativity="eih",
        sun_oblateness=False,
        earth_pole="j2000",
        earth_shadow=False,
        parameters=("radius_m", "a2_au_d2"),
    )
    moved = model.with_values({"radius_m": 171.0, "a2_au_d2": -2e-14})
    assert moved.values.tolist() == [171.0, -2e-14]
    assert model.values.tolist() == [170.0, -3e-14]
    assert (moved.relativity, moved.sun_oblateness, moved.parameters) == ("eih", False, model.parameters)
    assert (moved.earth_pole, moved.earth_shadow) == ("j2000", False)
    with pytest.raises(InputError, match="unknown dynamic parameter"):
        model.with_values({"radius": 1.0})


def test_a_gaussian_draw_outside_the_physical_range_is_a_point_of_the_model() -> None:
    """kappa stays smooth through albedo 0; a body described so by a user is still refused."""
    body = RadiationPressure(radius_m=10.0, mass_kg=8e6, albedo=0.05)
    below = body.moved({"albedo": -0.05})
    assert below.kappa_m2_kg == pytest.approx(np.pi * 100.0 / 8e6 * (1.0 - 4.0 * 0.05 / 9.0), rel=1e-14)
    slope = (body.kappa_m2_kg - below.kappa_m2_kg) / 0.1
    assert slope == pytest.approx(body.kappa_partials()["albedo"], rel=1e-12)
    with pytest.raises(InputError):
        RadiationPressure(radius_m=10.0, mass_kg=8e6, albedo=-0.05)
    with pytest.raises(InputError, match="no kappa"):
        body.moved({"mass_kg": 0.0})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"radius_m": 0.0}, r"^radius_m = 0\.0 is not allowed \(any number but 0"),
        ({"mass_kg": 0.0}, r"^mass_kg = 0\.0 is not allowed \(any number but 0"),
        ({"albedo": np.nan}, r"^albedo = nan is not allowed \(a finite number\)"),
        ({"albedo": -2.25}, r"^albedo = -2\.25 with thermal_emission = 0\.0 is not allowed \(.*C_R"),
        ({"radius_m": 1e200}, r"^radius_m = 1e\+200, mass_kg = .*too large"),
        ({"mass_kg": 1e-310}, r"mass_kg = 1e-310, .*too large"),
    ],
)
def test_a_step_to_where_kappa_does_not_exist_is_refused_in_plain_words(
    ephemeris: Ephemeris, values: dict[str, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        ForceModel(ephemeris=ephemeris, radiation=BALL).with_values(values)
