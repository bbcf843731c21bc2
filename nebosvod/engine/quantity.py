"""Predicted quantities: what a mission asks to be foretold, with partials by the state and the dynamic parameters.

A quantity is evaluated on one trajectory; its error is the estimator's business (`Estimate.predict`), so every
source of the budget reaches it through the same factors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Trajectory
from nebosvod.engine.facts import Disc, EncounterFacts, Facts, encounter_of
from nebosvod.estimation import Estimate
from nebosvod.mission.request import Prediction
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.timescale import Epoch, Scale

Array = npt.NDArray[np.float64]
M_PER_KM = 1000.0
SIGMAS = 3.0  # in a largest deviation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Quantity:
    """A predicted quantity at its nominal value.

    Attributes
    ----------
    request : what was asked.
    epoch : when it happens (for an encounter: the closest approach).
    unit : of value and partials: "km", "arcsec", "m_s", or that of a prediction that is one number.
    value : (d,), or None where only the error means anything (sky offsets, RTN axes).
    partials : (d, k) by `names`.
    facts : what is known of it beside its value.
    axes : (3, 3) ICRF, rows the axes of a target plane (xi, normal, zeta) or of position and velocity; of an entry
        (2, 3), fixed to the ground; None otherwise.
    anchor : (3,) the point of entry, km, on the axes fixed to the ground; None otherwise.
    time_partials : (k,) of the time of an encounter, s, by `names`; None where the time is given.
    ground_partials : (2, k) of geodetic longitude and latitude of an entry, deg; None otherwise.
    disc : where the orbit crosses the b-plane of its encounter, and the disc whose orbits hit the body; None if there
        is no encounter, or no such plane.
    """

    request: Prediction
    epoch: Epoch
    unit: str
    value: Array | None
    partials: Array
    names: tuple[str, ...]
    facts: Facts
    axes: Array | None = None
    anchor: Array | None = None
    time_partials: Array | None = None
    ground_partials: Array | None = None
    disc: Disc | None = None

    @property
    def encounter(self) -> EncounterFacts | None:
        """The encounter it is about; None where it is about a given time."""
        return encounter_of(self.facts)

    def partials_by(self, names: Sequence[str]) -> Array:
        """Partials (d, len(names)) by these parameters; zero by those it does not depend on."""
        return spread(self.partials, self.names, names)


def time_scale(request: Prediction) -> Scale:
    """The scale its times are told in: that of the time asked about; UTC for what happens on the Earth's ground."""
    return "utc" if request.plane == "entry" and request.body == "earth" else request.when.scale


def make_quantity(
    request: Prediction,
    epoch: Epoch,
    unit: str,
    value: Array | None,
    by_state: Array,
    by_parameters: Array,
    trajectory: Trajectory,
    facts: Facts,
    axes: Array | None = None,
) -> Quantity:
    """A quantity whose partials are those by the state and by the parameters."""
    return Quantity(
        request=request,
        epoch=epoch,
        unit=unit,
        value=value,
        partials=np.hstack([np.atleast_2d(by_state), np.atleast_2d(by_parameters)]),
        names=(*STATE_NAMES, *trajectory.parameter_names),
        facts=facts,
        axes=axes,
    )


def spread(W: Array, names: Sequence[str], wanted: Sequence[str]) -> Array:
    """Columns (d, k) of some names as columns (d, len(wanted)) of others; zero where a name is not among the first."""
    out = np.zeros((len(W), len(wanted)))
    place = {name: column for column, name in enumerate(wanted)}
    for column, name in enumerate(names):
        if name in place:
            out[:, place[name]] = W[:, column]
    return out


def known_partials(asked: Quantity, estimate: Estimate) -> tuple[Array, tuple[str, ...]]:
    """Partials (d, k) of a quantity by the k of its parameters that have an error in this estimate."""
    return known_columns(asked.partials, asked.names, estimate)


def known_columns(partials: Array, names: Sequence[str], estimate: Estimate) -> tuple[Array, tuple[str, ...]]:
    """Partials (d, k) by the k of some parameters that have an error in this estimate."""
    known = set(estimate.names) | set(estimate.left_out)
    keep = [index for index, name in enumerate(names) if name in known]
    return partials[:, keep], tuple(names[index] for index in keep)
