"""Drawing: pixels map back to the values drawn, axes have round ticks, files say what was drawn, sources keep looks."""

import re
from urllib.parse import unquote

import numpy as np
import pytest
from markupsafe import Markup

from nebosvod.report.kit import scale
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.hatch import COLOUR, HATCH, patterns
from nebosvod.report.run.sources import kind_of, look


def back(text: str, pixel: float) -> float:
    """A value from a pixel by the mapping that a panel states, as the script reads it."""
    kind, *rest = text.split(" ")
    p0, p1, v0, v1 = map(float, rest)
    part = (pixel - p0) / (p1 - p0)
    return v0 * (v1 / v0) ** part if kind == "log" else v0 + (v1 - v0) * part


@pytest.mark.parametrize("flip", [False, True])
def test_what_the_script_reads_back_is_what_was_drawn(flip: bool) -> None:
    x, y = np.array([1.0, 10.0, 3e4]), np.array([-2.0, 0.0, 7.5])
    chart = Chart("key")
    vertical = scale.linear(y, "dB")
    panel = chart.panel(scale.logarithmic(x, "count"), vertical.reversed() if flip else vertical, top=10, bottom=200)
    panel.open()
    panel.dots(x, y, "s", "name")
    panel.line(x, np.where(x == 10.0, np.nan, y), "gap", stroke="red")
    panel.close()
    svg = chart.plate("label", Markup("caption")).svg
    mapping = dict(re.findall(r'data-([xy])="([^"]+)"', svg))
    dots, line = re.findall(r'<path class="s"[^>]* d="([^"]+)"', svg)
    drawn = re.findall(r"M([\d.]+) ([\d.]+)", dots)
    # coordinates have two decimals: 0.005 of 380 px on 4.5 decades is 1.4e-4, of 190 px on 10 dB 3e-4 dB
    assert [back(mapping["x"], float(a)) for a, _ in drawn] == pytest.approx(x, rel=2e-4)
    assert [back(mapping["y"], float(b)) for _, b in drawn] == pytest.approx(y, abs=5e-4)
    assert line.count("M") == 2  # broken where undefined


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ([1e-3, 2e4], ["0.01", "1", "100", "10⁴"]),
        ([1.0, 9.0], ["1", "2", "5"]),
        ([54.0, 93.0], ["60", "80"]),
        ([2e-6, 8e-6], ["2·10⁻⁶", "3·10⁻⁶", "5·10⁻⁶", "7·10⁻⁶"]),
    ],
)
def test_logarithmic_ticks_are_round_and_inside(values: list[float], texts: list[str]) -> None:
    axis = scale.logarithmic(values, "σ")
    assert all(axis.low <= v <= axis.high for v, _ in axis.ticks)
    assert set(texts) <= {text for _, text in axis.ticks}
    assert len(axis.ticks) <= 9


def test_linear_ticks_keep_the_decimals_of_their_step_and_a_true_minus() -> None:
    assert [t for _, t in scale.linear([-1.0, 1.0], "v", pad=0.0, most=4).ticks] == ["−1.0", "−0.5", "0", "0.5", "1.0"]
    thousands = scale.linear([0.0, 2e4], "v", most=4).ticks[-1][1]
    assert thousands == "20\N{NARROW NO-BREAK SPACE}000"


@pytest.mark.parametrize("values", [[], [np.nan], [5.0], [0.0, 0.0]])
def test_an_axis_without_extent_still_is_one(values: list[float]) -> None:
    for axis in (scale.linear(values, "v"), scale.logarithmic(values, "v")):
        assert axis.low < axis.high


def test_file_has_quoted_names_seven_digits_and_nothing_for_nothing() -> None:
    made = csv("a", {"who, what": ['say "x"', "b"], "value": [1 / 3, np.nan], "more": [None, True]})
    assert made.text == '"who, what",value,more\n"say ""x""",0.3333333,\nb,,true\n'
    assert made.rows == 2
    assert unquote(made.href.partition(",")[2]) == made.text
    assert "#" not in csv("a", {"#": ["é & <b>"]}).href.partition(",")[2]


def test_sources_of_a_kind_share_a_colour_and_telescopes_differ() -> None:
    both = ["A-1", "A-2"]
    first, second = (look(f"bias {name}", both, (name,)) for name in both)
    assert first["fill"] == second["fill"] == "url(#hatch-bias)"
    assert "fill-opacity" not in first
    assert second["fill-opacity"] != 1.0
    assert kind_of("star catalogue", ("A-1", "A-2")) == "shared"
    kinds = ["noise", "bias", "place", "orbit", "timing", "photocentre", "body", "push", "prior"]
    names = ["measurement noise A", "bias A", "telescope position A", "orbit error A", "timing A", "photocentre",
             "radius and density", "A2", "prior"]  # fmt: skip
    assert [kind_of(name) for name in names] == kinds
    assert len({COLOUR[kind] for kind in kinds}) == len(kinds)
    assert patterns().count("<pattern ") == len(HATCH)


def test_tick_texts_that_would_stick_out_of_a_narrow_panel_are_left_out() -> None:
    dates = scale.Scale(
        kind="time", low=0.0, high=100.0, label="date", ticks=((2.0, "2029-03-02"), (50.0, "2029-04-01"), (96.0, "x"))
    )
    assert [text for _, text in dates.within(182.0, 10.0, 4.0).ticks] == ["2029-04-01", "x"]
    alone = scale.Scale(kind="time", low=0.0, high=100.0, label="date", ticks=((2.0, "2029-03-02"),))
    assert alone.within(182.0, 10.0, 4.0).ticks == alone.ticks
