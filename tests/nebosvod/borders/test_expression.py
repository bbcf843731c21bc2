"""Formulas of users: values as mathematics has them, derivatives by the complex step, and nothing else gets through."""

import math

import mpmath
import numpy as np
import pytest

from nebosvod.borders.expression import MAX_DEPTH, MAX_LETTERS, read_expression
from nebosvod.errors import InputError

VALUES = {"x": 0.3, "y": -1.7, "target plane": 2.5, "sky.width": 4.0}
FORMULAS = [
    ("1 + 2*3 - 4/8", 6.5),
    ("-x^2", -0.09),
    ("2^3^2", 512.0),
    ("2**-1", 0.5),
    ("3*x^-0.5 + 1e3", 3 / math.sqrt(0.3) + 1000),
    ("target_plane / sky.width", 0.625),
    ("target plane", 2.5),
    ("abs(y) + min(x, y, 2) - max(x, y)", 1.7 - 1.7 - 0.3),
    ("hypot(3, 4, 12)", 13.0),
    ("atan2(y, x)", math.atan2(-1.7, 0.3)),
    ("atan2(-x, y)", math.atan2(-0.3, -1.7)),
    ("log10(1000) + log(exp(2))", 5.0),
    ("cos(pi) + asin(x) + acos(x) + atan(y) + tan(x)", -1 + math.pi / 2 + math.atan(-1.7) + math.tan(0.3)),
]


@pytest.mark.parametrize(("text", "value"), FORMULAS)
def test_a_formula_has_the_value_of_mathematics(text: str, value: float) -> None:
    assert read_expression(text, list(VALUES))(VALUES) == pytest.approx(value, rel=1e-14)


def test_a_name_alone_is_a_formula() -> None:
    assert read_expression("x", list(VALUES))(VALUES) == VALUES["x"]


def test_arrays_are_taken_whole() -> None:
    x = np.linspace(0.1, 0.9, 5)
    found = read_expression("sqrt(x) + y", list(VALUES))({"x": x, "y": 1.0})
    assert np.array_equal(found, np.sqrt(x) + 1.0)


ANALYTIC = ["sqrt", "exp", "log", "log10", "sin", "cos", "tan", "asin", "acos", "atan", "abs"]


@pytest.mark.parametrize("name", ANALYTIC)
@pytest.mark.parametrize("x", [0.01, 0.37, 0.999])
def test_derivatives_of_every_function_are_those_of_forty_digits(name: str, x: float) -> None:
    by_mpmath = {"abs": lambda z: z}.get(name) or getattr(mpmath, name)
    with mpmath.workdps(40):
        right = float(mpmath.diff(by_mpmath, mpmath.mpf(x)))
    assert read_expression(f"{name}(x)", ["x"]).partials({"x": x})["x"] == pytest.approx(right, rel=1e-11)


@pytest.mark.parametrize(("y", "x"), [(1.0, 2.0), (2.0, -1.0), (-3.0, -0.5), (-1e-9, 4.0), (0.5, 0.0)])
def test_derivatives_of_two_arguments(y: float, x: float) -> None:
    angle = read_expression("atan2(y, x)", ["x", "y"]).partials({"x": x, "y": y})
    square = x * x + y * y
    assert angle == pytest.approx({"x": -y / square, "y": x / square}, rel=1e-13)
    size = read_expression("hypot(x, y)", ["x", "y"]).partials({"x": x, "y": y})
    assert size == pytest.approx({"x": x / math.sqrt(square), "y": y / math.sqrt(square)}, rel=1e-13)
    power = read_expression("max(x, y)^3 - min(x, y)", ["x", "y"]).partials({"x": x, "y": y})
    large, small = ("x", "y") if x > y else ("y", "x")
    assert power == pytest.approx({large: 3 * max(x, y) ** 2, small: -1.0}, rel=1e-13)


@pytest.mark.parametrize("text", ["sqrt(x)", "log(x)", "x^0.5", "asin(x - 1)", "acos(x - 1)"])
def test_outside_its_domain_a_formula_is_nan_for_complex_numbers_too(text: str) -> None:
    formula = read_expression(text, ["x"])
    assert np.isnan(formula({"x": -1.0}))
    assert np.isnan(formula({"x": -1.0 + 1e-30j}))
    assert np.isnan(formula.partials({"x": -1.0})["x"])


def test_division_by_zero_and_overflow_are_no_numbers_and_no_errors() -> None:
    formula = read_expression("1/x", ["x"])
    assert not np.isfinite(formula({"x": 0.0}))
    assert not np.isfinite(read_expression("10^10^10^10", [])({}))


REFUSED = [
    ("__import__('os').system('true')", "not allowed"),
    ("().__class__", "not allowed"),
    ("x.__class__", "is no name here"),
    ("[x for x in y]", "not allowed"),
    ("lambda: 1", "not allowed"),
    ("x if y else 1", "not allowed"),
    ("x and y", "not allowed"),
    ("x < y", "not allowed"),
    ("(x := 3)", "not allowed"),
    ("'a' * 10", "no number"),
    ("True", "no number"),
    ("1j", "no number"),
    ("f'{x}'", "not allowed"),
    ("x % y", "not allowed"),
    ("x // y", "not allowed"),
    ("~x", "not allowed"),
    ("x @ y", "not allowed"),
    ("sqrt(x=3)", "not allowed"),
    ("sqrt(*x)", "not allowed"),
    ("sqrt()", "takes 1 values"),
    ("hypot(x)", "takes 2 to 9 values"),
    ("eval(x)", "is no function here"),
    ("sqrtt(x)", 'did you mean "sqrt"?'),
    ("nois", 'letter 1: "nois" is no name here; .*did you mean "noise"?'),
    ("2*x^2 + nois", 'letter 9: "nois" is no name'),
    ("x +", "is no formula: at letter"),
    ("x y", "is no formula: at letter"),
    ("", "is no formula"),
    ("x\n+ y", "one line"),
    ("1" + "0" * 400, "no number"),
    ("x" + " + x" * 300, "too large|too long"),
    ("(" * 300 + "x" + ")" * 300, "is no formula|too large"),
    ("-" * 300 + "x", "too large"),
    ("x" * (MAX_LETTERS + 1), "too long"),
    ("-" * (MAX_DEPTH + 1) + "x", "deep"),
    ("x\0", "is no formula"),
]


@pytest.mark.parametrize(("text", "said"), REFUSED, ids=range(len(REFUSED)))
def test_what_is_no_formula_is_refused_with_its_place(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_expression(text, ["x", "y", "noise"])


@pytest.mark.parametrize("thing", [None, True, ["x"], {"x": 1}])
def test_what_is_no_text_is_refused(thing: object) -> None:
    with pytest.raises(InputError, match="needs a formula"):
        read_expression(thing, ["x"])


def test_names_come_in_the_order_of_the_text_and_numbers_are_formulas() -> None:
    assert read_expression("sky.width + x*target_plane + x", list(VALUES)).names == ("sky.width", "x", "target plane")
    assert read_expression(3, [])({}) == 3.0
