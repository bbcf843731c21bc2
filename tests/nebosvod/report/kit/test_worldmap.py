"""Maps: the shipped land is that of the Earth, places are where geodesy says, nothing is torn at the date line."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import erfa
import numpy as np
import pytest
from markupsafe import Markup

from nebosvod.engine.entry import ground_displacement
from nebosvod.report.kit import coastlines
from nebosvod.report.kit.coastlines import land, on_land, rings
from nebosvod.report.kit.ground import reached
from nebosvod.report.kit.plate import Plate
from nebosvod.report.kit.worldmap import Corridor, maps

DATA = Path(coastlines.__file__).with_name("coastlines.json")
WORLD = (-180.0, -90.0, 180.0, 90.0)
ON_LAND = {
    "Prague": (14.42, 50.09), "Kansas City": (-94.58, 39.1), "Brasilia": (-47.9, -15.8), "Alice": (133.9, -23.7),
    "where 2018 LA fell": (23.3, -21.2), "South Pole": (0.0, -90.0), "Dome C": (123.35, -75.1),
    "Chukotka": (-175.0, 66.5), "Chukotka, counted eastwards": (185.0, 66.5), "Summit, Greenland": (-38.5, 72.6),
    "Viti Levu": (178.0, -17.8),
}  # fmt: skip
AT_SEA = {
    "Gulf of Guinea": (0.0, 0.0), "North Pole": (0.0, 90.0), "mid Pacific": (-150.0, 10.0), "Caspian": (51.0, 42.0),
    "date line": (180.0, 0.0), "Mediterranean": (18.0, 35.0), "Ross Sea": (-175.0, -72.0), "Tasman Sea": (160.0, -38.0),
}  # fmt: skip


def as_map(corridor: Corridor) -> list[Plate]:
    return maps("map", [corridor], "title", Markup("caption"))


def panel_of(svg: str) -> tuple[Any, Any]:
    """Functions from longitude and latitude to pixels, as the panel says."""
    made = []
    for axis in "xy":
        p0, p1, v0, v1 = map(float, re.findall(rf'data-{axis}="linear ([^"]+)"', svg)[0].split(" "))
        made.append(lambda v, p0=p0, p1=p1, v0=v0, v1=v1: p0 + (v - v0) / (v1 - v0) * (p1 - p0))
    return made[0], made[1]


def polygons(svg: str) -> list[np.ndarray[Any, Any]]:
    """Outlines in pixels of the land in a map."""
    paths = re.findall(r'<path fill-opacity="0.45"[^>]* d="([^"]+)"', svg)
    parts = [part for path in paths for part in path.split("M") if part]
    return [np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", part), dtype=float) for part in parts]


def crossings(outlines: list[np.ndarray[Any, Any]], x: float, y: float) -> int:
    """How many edges of closed outlines a ray from a pixel to the right meets."""
    found = 0
    for line in outlines:
        for (x0, y0), (x1, y1) in zip(line, np.roll(line, -1, axis=0)):
            if (y0 > y) != (y1 > y) and x0 + (y - y0) / (y1 - y0) * (x1 - x0) > x:
                found += 1
    return found


def test_the_file_says_its_source_and_licence_and_is_small() -> None:
    held = json.loads(DATA.read_text("utf-8"))
    assert "Natural Earth" in held["source"]
    assert "public domain" in held["licence"]
    assert len(held["source_sha256"]) == len(hashlib.sha256().hexdigest())
    assert DATA.stat().st_size < 55_000


@pytest.mark.parametrize(("places", "expected"), [(ON_LAND, True), (AT_SEA, False)])
def test_known_places_lie_on_land_or_at_sea(places: dict[str, tuple[float, float]], expected: bool) -> None:
    found = on_land(*np.array(list(places.values())).T)
    assert dict(zip(places, found.tolist())) == dict.fromkeys(places, expected)


def test_land_covers_29_per_cent_of_the_earth() -> None:
    """29.2 % by geodesists; a generalised shore loses some. By Green's theorem on the sphere, lakes the other way."""
    area = sum(
        np.sum(np.diff(np.radians(x)) * 0.5 * (np.sin(np.radians(y[1:])) + np.sin(np.radians(y[:-1]))))
        for x, y in (ring.T for ring in rings())
    )
    assert area / (4.0 * np.pi) == pytest.approx(0.292, abs=0.006)
    rng = np.random.default_rng(0)
    latitude = np.degrees(np.arcsin(rng.uniform(-1.0, 1.0, 4000)))
    # binomial sigma of 4000 points: 0.0072
    assert on_land(rng.uniform(-180.0, 180.0, 4000), latitude).mean() == pytest.approx(area / (4.0 * np.pi), abs=0.022)


def flat_area(outlines: list[np.ndarray[Any, Any]]) -> float:
    return float(sum(0.5 * np.sum(np.roll(x, -1) * y - x * np.roll(y, -1)) for x, y in (one.T for one in outlines)))


def test_windows_cut_the_land_without_loss() -> None:
    whole = flat_area(land(WORLD))
    tiles = [
        land((w, s, w + 90.0, s + 45.0)) for w in np.arange(-110.0, 250.0, 90.0) for s in np.arange(-90.0, 90.0, 45.0)
    ]
    assert sum(map(flat_area, tiles)) == pytest.approx(whole, rel=1e-9)


@pytest.mark.parametrize("name", sorted({*ON_LAND, *AT_SEA} - {"South Pole", "North Pole", "Viti Levu"}))
def test_a_place_drawn_on_the_map_lies_on_the_land_that_is_drawn(name: str) -> None:
    place = {**ON_LAND, **AT_SEA}[name]
    (world,) = as_map(Corridor(name="drawn", points=np.array([place, (-place[0], 0.0)])))[:1]
    x, y = panel_of(str(world.svg))
    (d,) = re.findall(r'<path class="s"[^>]* d="([^"]+)"', str(world.svg))
    px, py = map(float, re.findall(r"M([\d.]+) ([\d.]+)", d)[0])
    low = float(re.findall(r'data-x="linear \S+ \S+ (\S+)', str(world.svg))[0])
    assert (px, py) == pytest.approx((x((place[0] - low) % 360.0 + low), y(place[1])), abs=0.01)
    assert crossings(polygons(str(world.svg)), px, py) % 2 == (name in ON_LAND)


def test_nothing_is_torn_at_the_date_line() -> None:
    longitude = np.array([176.0, 178.0, -179.0, -177.0])
    outline = np.stack([np.array([175.0, 179.0, -176.0, 179.0, 175.0]), np.array([0.0, 3.0, 0.0, -3.0, 0.0])], axis=1)
    corridor = Corridor(name="d", points=np.stack([longitude, np.zeros(4)], axis=1), outlines=[outline])
    for plate in as_map(corridor):
        svg = str(plate.svg)
        (dots,) = re.findall(r'<path class="s"[^>]* d="([^"]+)"', svg)
        px = np.array([float(x) for x, _ in re.findall(r"M([\d.]+) ([\d.]+)", dots)])
        x, _ = panel_of(svg)
        assert np.diff(px) == pytest.approx(np.array([2.0, 3.0, 2.0]) * (x(1.0) - x(0.0)), abs=0.02)
        assert max(blue_lines(svg), key=len).count("M") == 1  # in one piece


def blue_lines(svg: str) -> list[str]:
    """What is drawn in the blue of ellipses."""
    return [re.findall(r' d="([^"]+)"', tag)[0] for tag in re.findall(r"<path[^>]+>", svg) if "#0072b2" in tag]


def test_a_corridor_around_the_world_is_drawn_in_pieces() -> None:
    line = np.stack([np.linspace(-180.0, 540.0, 400), np.zeros(400)], axis=1)
    (world,) = as_map(Corridor(name="d", points=np.empty((0, 2)), outlines=[line]))
    assert max(blue_lines(str(world.svg)), key=len).count("M") >= 2


def test_texts_are_10_px_on_a_phone_and_ticks_name_their_side() -> None:
    (world, near) = as_map(Corridor(name="drawn", points=np.array([[-60.0, 10.0], [-59.0, 11.0]])))
    for plate in (world, near):
        width = float(re.findall(r'viewBox="0 0 ([\d.]+)', str(plate.svg))[0])
        assert 10.5 * 358.0 / width >= 10.0  # the style sheet says 10.5 px; a phone of 390 px has 358 for a figure
    texts = re.findall(r"<text[^>]*>([^<]+)</text>", str(world.svg))
    assert {"60°\xa0W", "0°", "120°\xa0E", "180°", "30°\xa0N", "60°\xa0S", "longitude, deg", "latitude, deg"} <= set(
        texts
    )


def test_nothing_to_show_is_no_map() -> None:
    assert as_map(Corridor(name="none", points=np.empty((0, 2)))) == []


def test_names_are_escaped() -> None:
    (world, *_) = as_map(Corridor(name='<script>"&', points=np.array([[0.0, 0.0]])))
    assert "<script>" not in str(world.svg)


@pytest.mark.parametrize("place", [(23.83, -21.29), (179.5, 60.0), (-70.0, 0.0), (10.0, 85.0)])
def test_displacements_lead_to_the_places_they_came_from(place: tuple[float, float]) -> None:
    """Places on the ellipsoid by ERFA; to 0.4 % of the distance (the flattening), up to 3000 km."""
    azimuth, altitude = 77.0, 100.0
    longitude, latitude = np.radians(place)
    base = erfa.gd2gc(1, longitude, latitude, 1e3 * altitude) / 1e3
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    along = np.sin(np.radians(azimuth)) * east + np.cos(np.radians(azimuth)) * np.cross(up, east)
    axes = np.stack([along, np.cross(up, along)])
    rng = np.random.default_rng(3)
    others = []
    for distance in (1.0, 30.0, 500.0, 3000.0):  # to a random direction by a great circle, then onto the ellipsoid
        turn = rng.uniform(0.0, 2.0 * np.pi)
        towards = np.cos(turn) * axes[0] + np.sin(turn) * axes[1]
        point = np.cos(distance / 6478.0) * base + np.sin(distance / 6478.0) * np.linalg.norm(base) * towards
        lon, lat, _ = erfa.gc2gd(1, 1e3 * point)
        others.append((lon, lat, erfa.gd2gc(1, lon, lat, 1e3 * altitude) / 1e3))
    for lon, lat, other in others:
        moved = ground_displacement(base, axes, other)
        found = np.radians(np.array(reached(*place, azimuth, moved[None], altitude)))[:, 0]
        there = erfa.gd2gc(1, found[0], found[1], 1e3 * altitude) / 1e3
        assert np.linalg.norm(there - other) < 0.004 * np.hypot(*moved) + 1e-6, (np.degrees(lon), np.degrees(lat))


def test_a_degree_along_the_equator_is_111_km() -> None:
    longitude, latitude = reached(179.5, 0.0, 90.0, np.array([[111.3195, 0.0]]))
    assert (float(longitude[0]), float(latitude[0])) == pytest.approx((-179.5, 0.0), abs=1e-6)
    _, left = reached(10.0, 0.0, 90.0, np.array([[0.0, 50.0]]))  # crossrange is to the left of the path: north
    assert float(left[0]) == pytest.approx(50.0 / 110.574, rel=8e-3)
