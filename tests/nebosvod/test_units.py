"""Numbers with units, and sexagesimal angles."""

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nebosvod.errors import InputError
from nebosvod.units import (
    ACCELERATION,
    ANGLE,
    DENSITY,
    DIMENSIONS,
    DURATION,
    LENGTH,
    MASS,
    RADIUS,
    SPEED,
    Dimension,
    declination,
    quantity,
    right_ascension,
)


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("0.1 arcsec", ANGLE, 0.1 * math.pi / 648000.0),
        ("50 mas", ANGLE, 0.05 * math.pi / 648000.0),
        ("-180 deg", ANGLE, -math.pi),
        ("3 km", LENGTH, 3.0),
        ("1 au", LENGTH, 149597870.7),
        ("340 m", RADIUS, 340.0),
        ("0.34 km", RADIUS, 340.0),
        ("12 h", DURATION, 43200.0),
        ("10ms", DURATION, 0.01),
        ("6.1e10 kg", MASS, 6.1e10),
        ("3 g/cm3", DENSITY, 3000.0),
        ("-2.9e-14 au/d^2", ACCELERATION, -2.9e-14),
        ("1 mm/s", SPEED, 1e-6),
        ("1 au/d", SPEED, 149597870.7 / 86400.0),
    ],
)
def test_units_convert_to_the_internal_ones(text: str, dimension: Dimension, value: float) -> None:
    assert quantity(text, dimension) == pytest.approx(value, rel=1e-15)  # one rounding of a product


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.1, 'try "0.1 arcsec"'),
        ("0.1", 'try "0.1 arcsec"'),
        ("0.1 arcsecs", 'did you mean "0.1 arcsec"?'),
        ("0.1 km", "km is a unit of length"),
        ("0,1 arcsec", "decimal mark is a point"),
        ("1e400 deg", "finite"),
        ("nan deg", "needs an angle"),
        (".inf deg", "needs an angle"),
        ("1" * 200 + " deg", "needs an angle"),
        (True, "needs an angle"),
        (None, "needs an angle"),
        (["1 deg"], "needs an angle"),
        ("", "needs an angle"),
    ],
)
def test_what_has_no_right_unit_is_refused_with_advice(value: object, words: str) -> None:
    with pytest.raises(InputError) as caught:
        quantity(value, ANGLE)
    assert words in str(caught.value)
    if "finite" not in words:
        assert "arcsec, mas, arcmin, deg, rad" in str(caught.value)


@pytest.mark.parametrize("dimension", DIMENSIONS, ids=lambda d: d.name)
def test_the_example_of_a_dimension_is_accepted(dimension: Dimension) -> None:
    assert math.isfinite(quantity(dimension.example, dimension))


@given(st.text(max_size=30))
def test_any_text_is_either_a_finite_number_or_refused(text: str) -> None:
    with contextlib.suppress(InputError):
        assert math.isfinite(quantity(text, ANGLE))


@pytest.mark.parametrize(
    ("text", "degrees"), [("12:30:00", 187.5), ("00:00:00.1", 0.1 / 240.0), ("187.5 deg", 187.5), ("-1 deg", 359.0)]
)
def test_right_ascension_reads_hours_or_an_angle(text: str, degrees: float) -> None:
    assert math.degrees(right_ascension(text)) == pytest.approx(degrees, abs=1e-12)  # deg: 4e-9 arcsec


@pytest.mark.parametrize(
    ("text", "degrees"), [("-00:30:00", -0.5), ("+05:30:36", 5.51), ("-5.5 deg", -5.5), ("90:00", 90.0)]
)
def test_declination_reads_degrees_and_keeps_the_sign_of_zero(text: str, degrees: float) -> None:
    assert math.degrees(declination(text)) == pytest.approx(degrees, abs=1e-12)  # deg: 4e-9 arcsec


@pytest.mark.parametrize("text", ["24:00:00", "12:60:00", "12:30:60", "-1:00:00", "12:3:0", "abc:de"])
def test_impossible_right_ascensions_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        right_ascension(text)


@pytest.mark.parametrize("text", ["91:00:00", "90:00:01", "12:60:00", "91 deg", "1e300 deg"])
def test_impossible_declinations_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        declination(text)
