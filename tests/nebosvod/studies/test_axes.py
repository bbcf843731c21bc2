"""Values with units, grids and samples: what a study varies."""

import numpy as np
import pytest
from scipy.stats import qmc

from nebosvod.errors import InputError
from nebosvod.studies.axes import in_unit, read_axis
from nebosvod.studies.sampling import Points, Sample, read_sample


def test_a_range_keeps_its_unit_and_its_ends_exactly() -> None:
    axis = read_axis("noise", ["a"], "20 mas .. 1 arcsec", 7, None)
    assert (axis.unit, axis.low, axis.high, axis.count) == ("mas", 20.0, 1000.0, 7)
    ratios = axis.grid()[1:] / axis.grid()[:-1]
    assert ratios == pytest.approx(50.0 ** (1 / 6), rel=1e-12)
    assert axis.at_step(0) == ("20.0 mas", 20.0)
    assert axis.at_step(6) == ("1000.0 mas", 1000.0)


def test_lists_are_numbers_in_the_unit_of_the_first_and_keep_their_words() -> None:
    axis = read_axis("cadence", ["a"], ["1 h", "6 h", "1 d"], None, None)
    assert axis.unit == "h"
    assert [axis.at_step(k) for k in range(3)] == [("1 h", 1.0), ("6 h", 6.0), ("1 d", 24.0)]
    words = read_axis("how", ["a"], ["estimated", "ignored"], None, None)
    assert words.at_step(1) == ("ignored", "ignored")
    assert words.numbers is None


def test_whole_numbers_stay_whole() -> None:
    axis = read_axis("limit", ["a"], "18 .. 24", None, 4)
    assert [axis.at_step(k)[0] for k in range(4)] == [18, 20, 22, 24]
    assert all(isinstance(axis.at_step(k)[0], int) for k in range(4))
    assert read_axis("limit", ["a"], "18 .. 24.5", None, 4).at_step(1)[0] == pytest.approx(18 + 6.5 / 3)


REFUSED = [
    ("1 km", None, None, "neither a range nor a list"),
    ("1 km .. 1 km", 3, None, "no length"),
    ("3 km .. 1 km", 3, None, "downwards"),
    ("-1 km .. 1 km", 3, None, "has no logarithms"),
    ("1 km .. 2 arcsec", 3, None, "different kinds"),
    ("1 kn .. 2 kn", 3, None, "no number with a unit"),
    ("1 km .. 2 km", 3, 3, "not in both"),
    (["1 km", "2 km"], 3, None, "a list has its own values"),
    (["1 km", "1 km"], None, None, "twice"),
    (["1 km", "1 s"], None, None, "different kinds"),
    (["1 km", 2], None, None, "different kinds"),
    ([], None, None, "0 values"),
    (3, None, None, "neither a range"),
    (None, None, None, "neither a range"),
]


@pytest.mark.parametrize(("values", "log", "linear", "said"), REFUSED, ids=range(len(REFUSED)))
def test_what_is_no_axis_is_said(values: object, log: int | None, linear: int | None, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_axis("x", ["a"], values, log, linear)


@pytest.mark.parametrize(
    ("text", "unit", "value"), [("1000 m", "km", 1.0), ("0.5", "", 0.5), ("60 arcsec", "arcmin", 1.0)]
)
def test_a_limit_is_taken_in_the_unit_of_its_column(text: str, unit: str, value: float) -> None:
    assert in_unit(text, unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(("text", "unit"), [("1", "km"), ("1 s", "km"), ("1 km", ""), ("one km", "km")])
def test_a_limit_of_another_kind_is_refused(text: str, unit: str) -> None:
    with pytest.raises(InputError):
        in_unit(text, unit)


AXES = (read_axis("a", ["a"], "1 km .. 100 km", 3, None), read_axis("b", ["b"], [5, 7], None, None))


def test_a_grid_has_every_combination_with_the_last_axis_fastest() -> None:
    points = Points(AXES, Sample())
    assert points.count == 6
    found = [[shown for _, shown in points[k]] for k in range(6)]
    assert found == [[a, b] for a in (1.0, pytest.approx(10.0, rel=1e-12), 100.0) for b in (5.0, 7.0)]


def test_a_sobol_sample_is_that_of_scipy_with_columns_exchanged() -> None:
    """Saltelli's points: A, B, and A with one column of B, of one sequence of twice the dimensions."""
    points = Points(AXES, Sample(method="sobol", n=8, seed=3))
    both = qmc.Sobol(4, scramble=True, seed=np.random.default_rng(3)).random(8)
    assert points.count == 8 * 4
    for base in range(8):
        a, b = both[base, :2], both[base, 2:]
        for which, row in enumerate((a, b, [b[0], a[1]], [a[0], b[1]])):
            value, listed = (shown for _, shown in points[4 * base + which])
            assert value == pytest.approx(100.0 ** row[0], rel=1e-12)
            assert listed == (5.0 if row[1] < 0.5 else 7.0)


def test_points_of_a_sample_do_not_depend_on_the_order_in_which_they_are_made() -> None:
    sample = Sample(method="sobol", n=2**13, seed=1)  # more than one block of the sequence
    one, other = Points(AXES, sample), Points(AXES, sample)
    late = other[4 * 5000 + 1]
    for number in range(0, 4 * 6000, 4001):
        one[number]
    assert one[4 * 5000 + 1] == late


def test_a_latin_sample_has_one_point_in_each_part_of_each_axis() -> None:
    points = Points(AXES, Sample(method="latin", n=50, seed=2))
    exponents = [np.log10(points[k][0][1]) / 2.0 for k in range(50)]  # type: ignore[operator]
    assert sorted(int(50 * one) for one in exponents) == list(range(50))


@pytest.mark.parametrize(
    ("value", "sample"),
    [
        ("grid", Sample()),
        ({"kind": "grid"}, Sample()),
        ({"sobol": {"n": 64}}, Sample(method="sobol", n=64)),
        ({"kind": "latin", "n": 10, "seed": 4}, Sample(method="latin", n=10, seed=4)),
    ],
)
def test_ways_to_choose_points(value: object, sample: Sample) -> None:
    assert read_sample(value) == sample


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ({"sobol": {"n": 100}}, "power of two.*64 or 128"),
        ({"sobol": {}}, "needs n"),
        ({"latin": {"n": 0}}, "n is 2 to"),
        ({"latin": {"n": 10, "sed": 1}}, "needs n"),
        ({"latin": {"n": 2.5}}, "whole numbers"),
        ("random", "no way to choose points"),
        (None, "no way to choose points"),
    ],
)
def test_what_is_no_way_to_choose_points_is_said(value: object, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_sample(value)
