"""How the object stood in the sky: distance and Sun angle of each measurement."""

import numpy as np
from markupsafe import Markup

from nebosvod.dynamics.constants import AU_KM
from nebosvod.report.kit.chart import Chart
from nebosvod.report.kit.download import csv
from nebosvod.report.kit.plate import SERIES, Plate, thin
from nebosvod.report.kit.scale import calendar, linear
from nebosvod.report.kit.wording import quantity
from nebosvod.results.folder import RunFolder
from nebosvod.timescale import SECONDS_PER_DAY


def viewing(run: RunFolder) -> Plate | None:
    """Distance and Sun angle of the asteroid at each measurement, by telescope."""
    place, state, index, t = (run.array(n) for n in ("telescope_position_km", "state", "telescope_index", "epoch_s"))
    if place is None or state is None or index is None or t is None or np.ptp(t if len(t) else [0.0]) == 0.0:
        return None
    look = state[:, :3] - place
    distance = np.linalg.norm(look, axis=1)
    cosine = -np.sum(look * place, axis=1) / distance / np.linalg.norm(place, axis=1)
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    chart = Chart("viewing", width=334.0, height=0.0)
    dates = calendar(run.epoch, t, most=4.0)
    upper = chart.panel(
        dates.silenced(), linear([0.0, *(distance / AU_KM)], "distance, au"), top=8.0, bottom=138.0, left=58.0
    )
    lower = chart.panel(dates, linear(angle, "angle from the Sun, °"), top=152.0, bottom=278.0, left=58.0)
    for panel, series in ((upper, distance / AU_KM), (lower, angle)):
        panel.open()
        for i, name in enumerate(run.telescopes):
            mine = np.flatnonzero(index == i)
            few, (colour, marker) = thin(len(mine), 400), SERIES[(i + 1) % len(SERIES)]
            # a second telescope at the same place stays visible inside the first one's marker
            panel.dots(t[mine][few] / SECONDS_PER_DAY, series[mine][few], marker, name, color=colour,
                       size=4.4 if i == 0 else 2.2)  # fmt: skip
        panel.close()
    used = [i for i in range(len(run.telescopes)) if np.any(index == i)]
    chart.height = chart.legend(
        [(SERIES[(i + 1) % 6][1], run.telescopes[i], {"color": SERIES[(i + 1) % 6][0], "size": 5.0}) for i in used],
        322.0,
        54.0,
    )
    nearest, farthest = int(np.argmin(distance)), int(np.argmax(distance))
    caption = Markup(
        "Every measurement: the asteroid is between {} and {} from the telescope and between {} "
        "and {} from the Sun in the sky."
    ).format(
        quantity(float(distance[nearest]), "km"),
        quantity(float(distance[farthest]), "km"),
        quantity(float(angle.min()), "deg"),
        quantity(float(angle.max()), "deg"),
    )
    few = thin(len(t))
    columns = {"days_after_reference": (t / SECONDS_PER_DAY)[few], "telescope": [run.telescopes[i] for i in index[few]],
               "distance_km": distance[few], "sun_angle_deg": angle[few]}  # fmt: skip
    label = "Distance and Sun angle of the asteroid at each measurement"
    return chart.plate(label, caption, [csv("viewing", columns)])
