"""The target plane: one scale, a circle is a circle of its size, fates are told apart by shape and colour."""

import re
from typing import Any

import numpy as np
import pytest
from markupsafe import Markup

from nebosvod.report.kit.target import FATES, TargetView, target_plates

RADIUS, CAPTURE = 6378.14, 8900.0
NONE = np.empty((0, 2))


def turned(angle_deg: float, long_km: float, short_km: float) -> Any:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    R = np.array([[c, -s], [s, c]])
    return R @ np.diag([long_km**2, short_km**2]) @ R.T


def view(centre: tuple[float, float], K: Any, points: Any = NONE, fates: Any = (), **more: Any) -> TargetView:
    return TargetView(
        body="earth", radius_km=RADIUS, capture_km=CAPTURE, centre=np.array(centre), covariance=K,
        points=np.asarray(points, dtype=float), fates=np.asarray(fates, dtype=np.str_), **more,
    )  # fmt: skip


def figures(one: TargetView) -> list[str]:
    """The figure, and the same for a phone where that is another."""
    (plate,) = target_plates("target", one, "label", Markup("caption"))
    return [str(svg) for svg in (plate.svg, plate.narrow) if svg]


def drawn(one: TargetView) -> list[str]:
    """The pictures of the figure, each from its axes on; the last holds the legend as well."""
    parts = figures(one)[0].split('<g class="axes">')
    return ['<g class="axes">' + part for part in parts[1:]]


def scales(svg: str) -> Any:
    """Pixels per km in x and y, and the pixel of the centre of the body; of a panel in km."""
    (x0, x1, a0, a1), (y0, y1, b0, b1) = (
        map(float, re.findall(rf'data-{axis}="linear ([^"]+)"', svg)[0].split(" ")) for axis in "xy"
    )
    per = np.array([(x1 - x0) / (a1 - a0), (y1 - y0) / (b1 - b0)])
    return per, np.array([x0 - a0 * per[0], y0 - b0 * per[1]])


def lines(svg: str, colour: str) -> list[Any]:
    """Points (n, 2) of paths with a stroke of some colour, closed or open."""
    found = [
        tag for tag in re.findall(r"<path[^>]+>", svg) if f'stroke="{colour}"' in tag and "fill-opacity" not in tag
    ]
    paths = [re.findall(r' d="([^"]+)"', tag)[0] for tag in found]
    return [np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", path), dtype=float) for path in paths]


def disc_and_ring(svg: str) -> tuple[float, float]:
    """Radii in km of the two round lines; each must be round to 0.02 px."""
    per, origin = scales(svg)
    assert per[0] == pytest.approx(-per[1], rel=1e-4)  # one scale; up is up
    radii = []
    for line in lines(svg, "#4a5a6a"):
        if len(line) > 20:  # a circle, not a line of the legend
            distance = np.hypot(*(line - origin).T)
            assert np.ptp(distance) < 0.03
            radii.append(float(distance.mean()) / per[0])
    assert len(radii) == 2
    return radii[0], radii[1]


@pytest.mark.parametrize(
    ("centre", "K"),
    [((1665.0, 5427.0), turned(12.8, 2404.0, 89.0)), ((-9000.0, 30000.0), turned(100.0, 9000.0, 700.0))],
)
def test_disc_and_capture_circle_are_circles_of_their_size(centre: tuple[float, float], K: Any) -> None:
    (svg,) = drawn(view(centre, K))
    assert disc_and_ring(svg) == pytest.approx((RADIUS, CAPTURE), rel=2e-3)


def test_the_ellipse_stands_where_it_is_with_its_axes() -> None:
    centre, K = (1665.0, 5427.0), turned(30.0, 2404.0, 800.0)
    (svg,) = drawn(view(centre, K))
    per, origin = scales(svg)
    large = [line for line in lines(svg, "#1a1a1a") if len(line) > 100]
    assert len(large) == 2
    for level, line in zip((1.0, 3.0), sorted(large, key=np.ptp)):
        away = (line - origin) / per - np.array(centre)
        squares = np.sum(away * np.linalg.solve(K, away.T).T, axis=1)
        assert squares == pytest.approx(np.full(len(away), level**2), rel=0.02)


def test_a_long_ellipse_has_a_second_figure_of_the_earth_and_the_first_says_where_it_lies() -> None:
    K, rng = turned(98.0, 29003.0, 4.0), np.random.default_rng(1)
    points = np.array([-5000.0, 26000.0]) + rng.standard_normal((800, 2)) @ np.linalg.cholesky(K).T
    hit = np.hypot(*points.T) < CAPTURE
    whole, near = drawn(view((-5000.0, 26000.0), K, points, np.where(hit, "hit", "miss")))
    assert disc_and_ring(near) == pytest.approx((RADIUS, CAPTURE), rel=2e-3)
    assert disc_and_ring(whole) == pytest.approx((RADIUS, CAPTURE), rel=2e-2)
    per, origin = scales(whole)
    (frame,) = (line for line in lines(whole, "#1a1a1a") if len(line) == 5)
    low, high = ((np.sort(frame, axis=0)[[0, -1]] - origin) / per).T
    x0, x1 = map(float, re.findall(r'data-x="linear \S+ \S+ (\S+) (\S+)"', near)[0])
    assert (low[0], low[1]) == pytest.approx((x0, x1), rel=0.03)
    assert high[0] == pytest.approx(x1, rel=0.03)
    marks = dict(re.findall(r'<(?:path|g) class="s" data-n="(drawn, [^"]+)"(.+)', near))
    inside = len(re.findall("M", marks["drawn, hits"]))
    assert inside == np.count_nonzero(hit)  # each hit is seen near the Earth


def test_a_small_ellipse_far_off_has_a_second_figure_about_itself() -> None:
    K = turned(20.0, 3.0, 1.0)
    whole, near = drawn(view((-12643.7, 47115.2), K))
    assert disc_and_ring(whole) == pytest.approx((RADIUS, CAPTURE), rel=5e-3)
    assert "#4a5a6a" not in near.split("</svg>")[0]  # neither disc nor circle
    low, high = map(float, re.findall(r'data-x="linear \S+ \S+ (\S+) (\S+)"', near)[0])
    assert low < -12643.7 - 8.5 < -12643.7 + 8.5 < high < -12643.7 + 20.0


def test_every_fate_has_its_own_shape_and_colour() -> None:
    assert len({marker for marker, _, _ in FATES.values()}) == len(FATES)
    assert len({colour for _, colour, _ in FATES.values()}) == len(FATES)
    points = np.array([[0.0, 1000.0 * k] for k in range(len(FATES))])
    (svg,) = drawn(view((0.0, 0.0), turned(0.0, 3000.0, 3000.0), points, list(FATES)))
    for marker, colour, words in FATES.values():
        assert f'data-n="{words}"' in svg, marker
        assert svg.count(colour.lower()) >= 2  # the mark, and the legend


def test_points_without_an_ellipse_and_a_line_of_variations() -> None:
    line = np.stack([np.linspace(-4e4, 4e4, 31), np.full(31, 2000.0)], axis=1)
    one = TargetView(
        body="moon", radius_km=1737.4, capture_km=2000.0, centre=None, covariance=None, points=line[::3],
        fates=np.full(11, "unknown"), line=line,
    )  # fmt: skip
    whole, near = drawn(one)
    for svg in (whole, near):
        assert 'data-n="line of variations"' in svg
        assert disc_and_ring(svg) == pytest.approx((1737.4, 2000.0), rel=5e-2)
    assert figures(one)[0].count("disc of the Moon") == 1
    assert "nominal" not in whole


def test_texts_stay_inside_the_figure_and_are_10_px_on_a_phone() -> None:
    wide, small = figures(view((-12643.7, 47115.2), turned(20.0, 3.0, 1.0)))
    assert float(re.findall(r'viewBox="0 0 ([\d.]+)', small)[0]) <= 358.0 * 10.5 / 10.0
    for svg in (wide, small):
        width = float(re.findall(r'viewBox="0 0 ([\d.]+)', svg)[0])
        for x, text in re.findall(r'<text x="([\d.]+)" y="[\d.]+" text-anchor="middle">([^<]+)<', svg):
            assert float(x) + 3.05 * len(text) <= width + 1.0
