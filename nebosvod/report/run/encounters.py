"""Target planes with the body to scale, and maps of where an orbit comes down, of the predictions of a run or a fit."""

from typing import Any

import numpy as np
from markupsafe import Markup

from nebosvod.dynamics.surface import SURFACE_KM
from nebosvod.estimation.accuracy.formed import matrix_of
from nebosvod.mission.slugs import array_name
from nebosvod.report.kit.coastlines import on_land
from nebosvod.report.kit.facts import impact_clause, leading
from nebosvod.report.kit.ground import reached
from nebosvod.report.kit.outline import outline
from nebosvod.report.kit.plate import Plate, thin
from nebosvod.report.kit.target import TargetView, target_plates
from nebosvod.report.kit.wording import NBSP, axis_names, count, percent, plane_name, product, quantity
from nebosvod.report.kit.worldmap import Corridor, maps
from nebosvod.report.run.ellipses import drawn_orbits
from nebosvod.results.folder import Array, Item, RunFolder

LONGEST_KM = 6000.0  # a linear ellipse on the ground longer than this (3 sigma) is no ellipse any more
FATE = {1.0: "hit", 0.0: "miss"}


def encounter_plates(run: RunFolder, estimator: Item) -> tuple[list[Plate], list[Plate]]:
    """A target plane for each encounter of an estimator that has one, and the maps of where it comes down."""
    rows = leading(run, estimator)
    planes = [plate for p in rows for plate in plane_plates(run, p)]
    return planes, [plate for p in rows if p["plane"] == "entry" for plate in entry_plates(run, p)]


def plane_plates(run: RunFolder, p: Item) -> list[Plate]:
    """The target plane of one prediction."""
    view = target_view(run, p)
    if view is None:
        return []
    sizes = quantity(view.radius_km, "km", 4), quantity(view.capture_km, "km", 4)
    words = "One scale for both axes: the disc (radius {}) and the capture circle ({}), inside which orbits hit."
    caption = Markup(words).format(*sizes) + _held(p) + impact_clause(p)
    key = "target-" + array_name(p["name"]).replace("_", "-")
    label = f"{p['name']}: {plane_name(p['plane'], p['body'])} with the body to scale"
    return target_plates(key, view, label, caption)


def _held(p: Item) -> Markup:
    """The semi-axes, and what the ellipse holds."""
    return Markup(" Semi-axes {} (1σ, 39.3{}% inside); the outer ellipse is 3σ (98.9{}%).").format(
        product(p["semi_axes_km"], "km"), NBSP, NBSP
    )


def target_view(run: RunFolder, p: Item) -> TargetView | None:
    """What is shown of the target plane of a prediction; None where it has none."""
    K = _matrix(p, "covariance", "factor")
    if p["plane"] not in ("b_plane", "mtp") or K is None or not p.get("capture_radius_km"):
        return None
    if p.get("body") not in SURFACE_KM:
        return None
    centre, drawn = np.asarray(p["mean_km"], dtype=np.float64), drawn_orbits(run, p)
    points = np.empty((0, 2)) if drawn is None else centre + drawn
    first, second = axis_names(p["plane"], 2)
    return TargetView(
        body=p["body"], radius_km=SURFACE_KM[p["body"]], capture_km=p["capture_radius_km"], centre=centre, covariance=K,
        formal=_matrix(p, "covariance_formal", "factor_formal"), points=points, fates=_fates(run, p, len(points)),
        names=(first, second),
    )  # fmt: skip


def entry_plates(run: RunFolder, p: Item) -> list[Plate]:
    """Maps of one entry into the Earth's atmosphere."""
    if p.get("longitude_deg") is None:
        return []
    place, azimuth = (p["longitude_deg"], p["latitude_deg"]), p.get("path_azimuth_deg")
    K, drawn = _matrix(p, "covariance", "factor"), drawn_orbits(run, p)
    points, outlines = np.empty((0, 2)), []
    longest = 3.0 * max(p["semi_axes_km"])
    if azimuth is not None and drawn is not None:
        points = np.stack(reached(*place, azimuth, drawn, p["altitude_km"]), axis=1)
    if azimuth is not None and K is not None and longest < LONGEST_KM:
        outlines = [np.stack(reached(*place, azimuth, outline(K, k), p["altitude_km"]), axis=1) for k in (1.0, 3.0)]
    corridor = Corridor(
        name="drawn orbits", points=points, nominal=place, outlines=outlines, outlines_name="1 and 3σ, linear"
    )
    caption = Markup("Where the orbit comes down to {} above the ellipsoid.").format(
        quantity(p["altitude_km"], "km")
    ) + _entry_caption(p, points, outlines, azimuth is not None)  # fmt: skip
    return maps("map-" + array_name(p["name"]).replace("_", "-"), [corridor], f"{p['name']}: place of entry", caption)


def _entry_caption(p: Item, points: Array, outlines: list[Array], placed: bool) -> Markup:
    """What the drawn orbits do, and what became of the ellipse."""
    told = Markup("")
    if len(points):
        few = points[thin(len(points), 2000)]
        runs = (p.get("monte_carlo") or {}).get("runs") or len(points)
        told += Markup(" Of {} {} come down there, {} of them over land.").format(
            count(runs, "drawn orbit"), len(points), percent(float(on_land(*few.T).mean()))
        )
    drawn: Any = p.get("monte_carlo") or {}
    if placed and not outlines and len(p["semi_axes_km"]) == 2:
        told += Markup(
            " The linear ellipse ({}, 1σ) is too long for an ellipse on the Earth and not drawn."
        ).format(product(p["semi_axes_km"], "km"))  # fmt: skip
    elif (p.get("nonlinearity") or {}).get("misleads") or drawn.get("misleads"):
        told += Markup(" The linear ellipse misleads; go by the drawn orbits.") if len(points) else Markup(
            " The linear ellipse misleads."
        )  # fmt: skip
    return told


def _matrix(p: Item, covariance: str, factor: str) -> Array | None:
    """A finite 2x2 covariance, km^2; None."""
    found = matrix_of(p, f"{covariance}_km2", f"{factor}_km")
    K = np.empty(0) if found is None else np.asarray(found, dtype=np.float64)
    return K if K.shape == (2, 2) and bool(np.isfinite(K).all()) else None


def _fates(run: RunFolder, p: Item, n: int) -> Any:
    """The fate (n,) of each drawn orbit; unknown where the folder does not say."""
    hits, points = run.array("hits", p["name"]), run.array(f"clones_{array_name(p['name'])}_km")
    if n == 0 or hits is None or points is None or len(hits) != len(points):
        return np.full(n, "unknown")
    kept = np.asarray(hits)[np.isfinite(points).all(axis=1)]
    return np.array([FATE.get(value, "unknown") for value in kept.tolist()])
