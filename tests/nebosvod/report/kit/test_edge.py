"""What lies off the axes stands at the edge of its panel, pointing outwards, with its value."""

import re
from typing import Any

import numpy as np

from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.edge import at_edge
from nebosvod.report.kit.scale import linear

TOP, BOTTOM, LEFT, RIGHT = 10.0, 210.0, 50.0, 250.0


def drawn(points: Any, most: int = 8) -> tuple[list[tuple[str, Any]], list[str]]:
    """Arrowheads as (what they tell, corners (3, 2)) and the words written, of a panel from -1 to 1 both ways."""
    chart = Chart("edge", width=263.0)
    axis = linear([-1.0, 1.0], "x", pad=0.0)
    panel = chart.panel(axis, axis, top=TOP, bottom=BOTTOM, left=LEFT, right=RIGHT)
    before = len(chart.parts)
    x, y = np.array(points, dtype=np.float64).reshape(-1, 2).T
    number = at_edge(panel, x, y, [f"{a:g}, {b:g}" for a, b in zip(x, y)], most=most)
    del chart.parts[:before]
    svg = str(chart.svg("edge"))
    heads = [
        (told, np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", path), dtype=np.float64)[:3])
        for told, path in re.findall(r'<g><title>([^<]+)</title><path[^>]* d="([^"]+)"', svg)
    ]
    assert len(heads) == number
    return heads, re.findall(r"<text[^>]*>([^<]+)</text>", svg)


def test_points_inside_are_left_alone_and_those_outside_point_outwards() -> None:
    heads, words = drawn([(0.0, 0.0), (1.0, -1.0), (0.5, 4.0), (-30.0, 0.0)])
    assert [told for told, _ in heads] == ["-30, 0", "0.5, 4"]  # the furthest first
    assert words == ["\N{MINUS SIGN}30, 0", "0.5, 4"]
    (_, west), (_, north) = heads
    tip = west[np.argmin(west[:, 0])]
    assert np.allclose(tip, [LEFT, 0.5 * (TOP + BOTTOM)], atol=0.01)
    assert west[:, 0].min() >= LEFT - 0.01
    assert west[:, 0].max() - LEFT > 5.0
    assert np.allclose(north[np.argmin(north[:, 1])], [LEFT + 0.75 * (RIGHT - LEFT), TOP], atol=0.01)


def test_words_do_not_lie_on_each_other_and_no_more_are_written_than_asked() -> None:
    close = [(0.0, 5.0), (0.01, 6.0), (0.02, 7.0)]
    heads, words = drawn(close)
    assert len(heads) == 3
    assert words == ["0.02, 7"]  # what is not written is told to the pointer
    spread = [(-9.0, y) for y in np.linspace(-0.9, 0.9, 12)]
    heads, words = drawn(spread, most=5)
    assert len(heads) == 12
    assert len(words) == 5
