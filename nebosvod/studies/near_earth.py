"""Orbits of near-Earth objects of which impactors are drawn: those of a catalogue, or of a published distribution.

The published one is the debiased model of Granvik et al. 2018 (17 < H < 25). Taken from it: a, e and i of 246 plain
random draws of its published realisation (`data/granvik2018.csv`). Approximated: between them the distribution is
smooth, each orbit being spread by a normal kernel (ln a, e, and i as a vector in the plane, so that near i = 0 the
density goes with i, as of any distribution of poles without a hole), cut to the model's own region (q < 1.3 au,
a < 4.2 au). That orbits depend on H is left out: one distribution for all sizes.

References
----------
Granvik, Morbidelli, Jedicke, Bolin, Bottke, Beshore, Vokrouhlicky, Nesvorny, Michel 2018, Icarus 312, 181.
"""

import csv
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.mission import load_mission
from nebosvod.mission.reading.reader import Editable
from nebosvod.units import AU_KM

Array = npt.NDArray[np.float64]
PUBLISHED = "granvik-2018"
COPIES = 64  # of each orbit, spread by the kernel
SPREAD_LN_A, SPREAD_E, SPREAD_I_DEG = 0.06, 0.04, 2.5
LARGEST_Q_AU, LARGEST_A_AU, LARGEST_E = 1.3, 4.2, 0.98


def published_orbits() -> tuple[Array, Array, Array]:
    """a in au, e, and i in rad (n,) of the published distribution; the same at every call."""
    lines = (files("nebosvod.studies") / "data" / "granvik2018.csv").read_text("utf-8").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    a, e, i = (np.repeat([float(row[key]) for row in rows], COPIES) for key in ("a", "e", "i"))
    rng = np.random.default_rng(2018)
    a = a * np.exp(SPREAD_LN_A * rng.standard_normal(a.size))
    e = np.abs(e + SPREAD_E * rng.standard_normal(a.size))
    i = np.hypot(i + SPREAD_I_DEG * rng.standard_normal(a.size), SPREAD_I_DEG * rng.standard_normal(a.size))
    kept = (a * (1.0 - e) < LARGEST_Q_AU) & (a < LARGEST_A_AU) & (e < LARGEST_E)
    return a[kept], e[kept], np.radians(i[kept])


def orbits_of(rows: Sequence[Mapping[str, Any]]) -> tuple[Array, Array, Array]:
    """a in au, e, and i in rad (n,) of the objects of a catalogue.

    Raises
    ------
    InputError
        If one is no ellipse by its elements.
    """
    a, e, i = zip(*_elements(rows))
    return np.array(a), np.array(e), np.array(i)


def _elements(rows: Sequence[Mapping[str, Any]]) -> Iterator[tuple[float, float, float]]:
    reader = Editable(load_mission("minimal"))
    for row in rows:
        orbit = reader.edited({"object.orbit": row["orbit"]}).object.orbit
        if orbit.representation == "keplerian":
            a, e, i, *_ = orbit.elements
        elif orbit.representation == "cometary" and orbit.elements[0] < 1.0:
            e, q, *_, i = orbit.elements
            a = q / (1.0 - e)
        else:
            raise InputError(f"{row['name']}: is no ellipse by its elements, of which impactors are drawn")
        yield a / AU_KM, e, i
