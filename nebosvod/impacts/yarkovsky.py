"""An A2 that nobody has estimated, over decades: drawn from a prior by size, and a source of its own."""

from dataclasses import replace

import numpy as np

from nebosvod.dynamics import Nongrav
from nebosvod.estimation.accuracy.reweighed import Response
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

YEARS = 20.0  # ahead, from which it matters
SIGMA_AU_D2_AT_1_KM = 1e-14  # Apophis (0.34 km) has -2.9e-14, Bennu (0.49 km) -4.6e-14; most are slower
SOURCE = "Yarkovsky effect, A2 by size"


def with_yarkovsky(orbit: UncertainOrbit, until: Epoch, diameter_km: float | None) -> UncertainOrbit:
    """The orbit with A2 of mean 0 and a sigma by size as one parameter more, where it is far ahead and not known.

    Notes
    -----
    The drift of an axis goes with 1/D; its sign is that of the obliquity, which is not known.

    References
    ----------
    Vokrouhlicky, Bottke, Chesley, Scheeres, Statler 2015, in Asteroids IV, 509.
    """
    name = "a2_au_d2"
    known = name in orbit.parameter_names or (orbit.nongrav is not None and orbit.nongrav.a2_au_d2 != 0.0)
    if known or diameter_km is None or until - orbit.epoch < YEARS * 365.25 * SECONDS_PER_DAY:
        return orbit
    sigma, size = SIGMA_AU_D2_AT_1_KM / diameter_km, len(orbit.factor)
    factor = np.zeros((size + 1, size + 1))
    factor[:size, :size], factor[size, size] = orbit.factor, sigma
    sources = {}
    if orbit.sources:
        sources = {key: np.vstack([G, np.zeros((1, G.shape[1]))]) for key, G in orbit.sources.items()}
        sources[SOURCE] = np.concatenate([np.zeros(size), [sigma]])[:, None]
    wider = {
        key: Response(shift=np.append(one.shift, 0.0), growth=np.pad(one.growth, (0, 1)))
        for key, one in orbit.responses.items()
    }
    said = f"A2 is not estimated: drawn with a sigma of {sigma:.2g} au/d^2, by a diameter of {diameter_km:.3g} km"
    return replace(
        orbit, factor=factor, parameter_names=(*orbit.parameter_names, name), sources=sources, shared={},
        responses=wider,
        nongrav=Nongrav() if orbit.nongrav is None else orbit.nongrav, notices=(*orbit.notices, said),
    )  # fmt: skip
