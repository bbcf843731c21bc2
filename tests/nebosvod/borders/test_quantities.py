"""Public functions take quantities and moments of astropy and datetime: converted exactly, or refused by name."""

import inspect
import subprocess
import sys
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta, timezone
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from astropy import units as u
from astropy.time import Time, TimeDelta

import nebosvod.dynamics as dynamics
import nebosvod.observation as observation
from nebosvod.borders.quantities import UNITS, moment
from nebosvod.dynamics import Ephemeris, ForceModel, RadiationPressure, elements, find_encounters, propagate, twobody
from nebosvod.errors import InputError
from nebosvod.estimation import Prior
from nebosvod.observation import (
    ConstantBias,
    Geostationary,
    Telescope,
    apparent_magnitude,
    measure,
    observe,
    residual,
    table,
    visibility,
)
from nebosvod.timescale import Epoch

EPOCH = Epoch.parse("2028-11-15T00:00:00 TDB")
STATE = np.array([-8.36252097e7, 1.28055777e8, 4.54777527e7, -23.9287335, -10.4060556, -4.46715864])
# what a function returns: nobody but the library makes it
RESULTS = {
    "Astrometry", "Clones", "Common", "Encounter", "Fates", "Markov", "Observation", "Oem", "OemCovariance",
    "Residuals", "Sight", "TabulatedOrbit", "TargetPlane", "Trajectory", "Visibility", "White", "ChebyshevOrbit",
    "Ephemeris", "Nuisance", "Spacecraft",
}  # fmt: skip

PASSED_OVER = ("Nuisance", "Spacecraft", "Fates")  # protocols, and a table that the library fills
ENDINGS = ("_epoch", *("_" + unit for unit in UNITS))


@pytest.fixture(scope="module")
def forces() -> ForceModel:
    return ForceModel(ephemeris=Ephemeris.load())


def public(package: ModuleType) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Functions, constructors and methods behind the public names of a package."""
    for name in package.__all__:
        thing = getattr(package, name)
        if not inspect.isclass(thing):
            yield from [(name, thing)] if inspect.isfunction(thing) else []
            continue
        if name not in RESULTS:
            yield name, thing.__init__
        for attribute, member in vars(thing).items():
            plain = member.__func__ if isinstance(member, classmethod | staticmethod) else member
            if inspect.isfunction(plain) and not attribute.startswith("_") and name not in PASSED_OVER:
                yield f"{name}.{attribute}", plain


@pytest.mark.parametrize("package", [dynamics, observation], ids=["dynamics", "observation"])
def test_every_public_function_with_a_unit_in_a_name_converts_it(package: ModuleType) -> None:
    missing = []
    for label, function in public(package):
        names = [
            p
            for p in inspect.signature(function).parameters
            if p == "epoch" or p.endswith(("_epoch", *("_" + x for x in UNITS)))
        ]
        converted = getattr(function, "units", {})
        missing += [f"{label}({name})" for name in names if name not in converted]
    assert not missing


def test_quantities_give_what_bare_numbers_give(forces: ForceModel) -> None:
    days = np.array([0.0, 1.0, 40.0])
    plain = propagate(STATE, EPOCH, days * 86400.0, forces)
    position, velocity = STATE[:3] * u.km, STATE[3:] * u.km / u.s
    moments = Time("2028-11-15T00:00:00", scale="tdb") + days * u.day
    for state in ((position, velocity), (position.to(u.m), velocity.to(u.m / u.s)), [*position, *velocity]):
        for times in (
            days * u.day,
            TimeDelta(days * u.day),
            moments,
            [timedelta(days=day) for day in days],
            list(moments),
        ):
            found = propagate(state, EPOCH, times, forces)
            assert np.abs(found.t_s - plain.t_s).max() < 1e-6  # s: moments far from J2000 have a grain of ps
            assert np.abs(found.state - plain.state)[:, :3].max() < 1e-4
    both = u.StructuredUnit((u.km, u.km / u.s))
    structured = u.Quantity(np.array((STATE[:3], STATE[3:]), dtype=[("p", "3f8"), ("v", "3f8")]), both)
    assert propagate(structured, EPOCH, 1 * u.day, forces).state == pytest.approx(plain.at([86400.0]).state, rel=1e-14)
    assert plain.at(1 * u.day).state == pytest.approx(plain.at([86400.0]).state, rel=1e-15)
    assert plain.state_at(moments[1]) == pytest.approx(plain.state_at([86400.0]), rel=1e-15)
    near = find_encounters(plain, "earth", 1.0 * u.au)
    assert [one.t_s for one in near] == [one.t_s for one in find_encounters(plain, "earth", 149597870.7)]


@pytest.mark.parametrize(
    "given",
    [
        "2028-11-15T00:00:00 TDB",
        Time("2028-11-15T00:00:00", scale="tdb"),
        Time(2462090.0, 0.5, format="jd", scale="tdb"),
        Time("2028-11-15T00:00:00", scale="tdb").tt,
        Time("2028-11-15T00:00:00", scale="tdb").tai,
        Time("2028-11-15T00:00:00", scale="tdb").utc,
        Time("2028-11-15T00:00:00", scale="tdb").tcb,
    ],
    ids=lambda given: getattr(given, "scale", "text"),
)
def test_moments_of_every_scale_are_one_epoch(given: Any, forces: ForceModel) -> None:
    """2e-9 s: two-part dates, and astropy's TDB is erfa's at the geocentre as ours."""
    found = propagate(STATE, given, [0.0], forces, False)
    assert abs(found.epoch - EPOCH) < 2e-9


def test_datetimes_need_a_zone() -> None:
    utc = datetime(2029, 4, 13, 21, 46, 0, 123456, tzinfo=UTC)
    moscow = utc.astimezone(timezone(timedelta(hours=3)))
    for given in (utc, moscow):
        assert abs(moment(given) - Epoch.parse("2029-04-13T21:46:00.123456 UTC")) < 1e-9
    with pytest.raises(InputError, match=r"propagate: epoch: datetime 2029-04-13T21:46:00.123456 has no time zone"):
        propagate(STATE, utc.replace(tzinfo=None), [0.0], None)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((STATE * u.m, EPOCH, [0.0]), r"propagate: state_km_km_s: needs a pair .* all components in one unit"),
        ((STATE * u.dimensionless_unscaled, EPOCH, [0.0]), r"propagate: state_km_km_s: needs a pair"),
        (
            ((STATE[:3] * u.s, STATE[3:] * u.km / u.s), EPOCH, [0.0]),
            r"state_km_km_s, position: needs .* km .* got .*\"s\"",
        ),
        (((STATE[:3] * u.km, STATE[3:]), EPOCH, [0.0]), r"state_km_km_s, velocity: needs"),
        ((STATE, EPOCH, [0.0, 1.0] * u.km), r"propagate: t_s: needs a quantity in s .*\"km\""),
        ((STATE, EPOCH, [0.0, 1.0] * u.one), r"propagate: t_s: needs a quantity in s .*without dimension"),
        ((STATE, EPOCH, [0.0, 1.0 * u.s]), r"propagate: t_s: needs bare numbers \(in s\) or times, not a mixture"),
        ((STATE, 2462090.5, [0.0]), r"propagate: epoch: needs a moment, got a float"),
        ((STATE, 2462090.5 * u.day, [0.0]), r"propagate: epoch: needs a moment, got a quantity in \"d\""),
        ((STATE, Time(["2028-11-15", "2028-11-16"]), [0.0]), r"propagate: epoch: needs one moment, .*\(2,\)"),
        ((STATE, Time("2028-11-15", scale="ut1"), [0.0]), r"propagate: epoch: a Time in the scale ut1"),
        ((STATE, "2028-11-15", [0.0]), r"no time scale"),
        ((STATE, EPOCH, np.datetime64("2028-11-16")), r"propagate: t_s: needs"),
    ],
)
def test_a_wrong_dimension_is_refused_by_name(arguments: tuple[Any, ...], message: str, forces: ForceModel) -> None:
    with pytest.raises(InputError, match=message):
        propagate(*arguments, forces)  # type: ignore[call-arg]


def test_what_has_no_unit_takes_none(forces: ForceModel) -> None:
    with pytest.raises(InputError, match=r"propagate: tolerance: takes no units, got a quantity"):
        propagate(STATE, EPOCH, [0.0], forces, tolerance=1e-10 * u.km)
    with pytest.raises(InputError, match=r"Prior: covariance: takes no units"):
        Prior(names=("x",), covariance=np.eye(1) * u.km**2)  # type: ignore[call-arg]


def test_telescopes_and_measurements(forces: ForceModel) -> None:
    plain = Telescope(name="T", spacecraft=Geostationary(longitude_rad=0.5), sigma_rad=np.deg2rad(0.1 / 3600))
    same = Telescope(
        name="T",
        spacecraft=Geostationary(longitude_rad=np.rad2deg(0.5) * u.deg),
        sigma_rad=0.1 * u.arcsec,
        duty=((Time("2028-11-15", scale="tdb"), "2028-11-16 TDB"),),
    )
    assert same.sigma_rad == pytest.approx(plain.sigma_rad, rel=1e-14)
    assert same.duty == ((EPOCH, Epoch.parse("2028-11-16 TDB")),)
    flight = propagate(STATE, EPOCH, [0.0, 5.0] * u.day, forces)
    when = Time("2028-11-15T12:00:00", scale="tdb")
    seen = observe(flight, plain, [43200.0], forces.ephemeris)
    again = (
        observe(flight, same, when, forces.ephemeris)
        if when.shape
        else observe(flight, same, [0.5] * u.day, forces.ephemeris)
    )
    assert again.psi == pytest.approx(seen.psi, abs=1e-14)
    assert visibility(same, flight, [0.5] * u.day, forces.ephemeris).visible.shape == (1,)
    pair = np.deg2rad([[10.0, 20.0]])
    assert residual(pair * u.rad, pair) == pytest.approx(np.zeros((1, 2)))
    assert residual([[10.0, 20.0]] * u.deg, pair) == pytest.approx(np.zeros((1, 2)), abs=1e-15)
    assert measure(seen, noise=[[1.0, 0.0]] * u.arcsec) - seen.psi == pytest.approx(
        measure(seen, noise=np.array([[np.deg2rad(1 / 3600), 0.0]])) - seen.psi
    )
    assert ConstantBias(name="b", telescopes=("T",), sigma_rad=[0.1, 0.2] * u.arcsec).sigma_rad == pytest.approx(
        np.deg2rad([0.1, 0.2]) / 3600
    )
    with pytest.raises(InputError, match=r"ConstantBias: sigma_rad: needs a quantity in rad"):
        ConstantBias(name="b", telescopes=("T",), sigma_rad=0.1 * u.km)


def test_bodies_magnitudes_tables_and_elements(forces: ForceModel) -> None:
    body = RadiationPressure(radius_m=0.17 * u.km, mass_kg=6.1e13 * u.g, albedo=0.1)
    assert (body.radius_m, body.mass_kg) == pytest.approx((170.0, 6.1e10))
    far = apparent_magnitude(19.0, 0.15, [1.0] * u.au, [0.1] * u.au, [30.0] * u.deg)
    assert far == pytest.approx(
        apparent_magnitude(19.0, 0.15, np.array([149597870.7]), np.array([14959787.07]), np.deg2rad([30.0]))
    )
    flight = propagate(STATE, EPOCH, np.arange(20.0) * u.day, forces, False)
    pair = (flight.state[:, :3] * u.km, flight.state[:, 3:] * u.km / u.s)
    tabulated = table(Time("2028-11-15", scale="tdb"), np.arange(20.0) * u.day, pair, "sun")
    moments = [3.25] * u.day
    there = tabulated.state_km_km_s(forces.ephemeris, EPOCH, moments)
    assert there == pytest.approx(tabulated.state_km_km_s(forces.ephemeris, EPOCH, np.array([3.25 * 86400.0])))
    gm = forces.ephemeris.gm_km3_s2["sun"]
    found, _ = elements.state_to_keplerian((STATE[:3] * u.km, STATE[3:] * u.km / u.s), gm * u.km**3 / u.s**2)
    assert found == pytest.approx(elements.state_to_keplerian(STATE, gm)[0], rel=1e-14)
    assert twobody.kepler(STATE, 2 * u.h, gm) == pytest.approx(twobody.kepler(STATE, [7200.0], gm))
    at = forces.ephemeris.position_km("earth", EPOCH, 1 * u.h)
    assert at == pytest.approx(forces.ephemeris.position_km("earth", EPOCH, 3600.0))


def test_an_epoch_moves_by_a_quantity() -> None:
    for hour in (3600.0, 1 * u.h, TimeDelta(1 * u.h), timedelta(hours=1)):
        assert abs((EPOCH + hour) - Epoch.parse("2028-11-15T01:00:00 TDB")) < 1e-9  # type: ignore[operator]
    with pytest.raises(InputError, match="only a time can be added"):
        EPOCH + 1 * u.km


def test_astropy_is_not_loaded_for_it() -> None:
    script = (
        "import sys; from nebosvod.dynamics import propagate, ForceModel, Ephemeris\n"
        "propagate([1.5e8, 0, 0, 0, 30, 0], '2028-11-15 TDB', [86400], ForceModel(ephemeris=Ephemeris.load()))\n"
        "print([name for name in sys.modules if name.split('.')[0] == 'astropy'])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
