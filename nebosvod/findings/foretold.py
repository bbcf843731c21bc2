"""What is foretold on an orbit and what cannot be: the one rule for a prediction that does not exist.

It becomes a row with a status and a reason; the other predictions stand, and the command ends with 1. The same holds
for one whose ellipse is larger than the body or the sky it lies on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from nebosvod.dynamics import Trajectory
from nebosvod.dynamics.surface import SURFACE_KM
from nebosvod.engine.evaluation import quantity
from nebosvod.engine.facts import Disc, EntryFacts, Facts, NoEventError
from nebosvod.engine.fitting import Fit
from nebosvod.engine.quantity import Quantity, known_partials
from nebosvod.errors import NoAnswerError
from nebosvod.estimation import Estimate
from nebosvod.mission.request import Prediction
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.scene.scene import Scene
from nebosvod.units import ARCSEC


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Missing:
    """A prediction that does not exist for this orbit.

    Attributes
    ----------
    request, status, reason : what was asked, one word, and the sentence that says why.
    facts : what is known all the same; None where nothing is.
    disc, names : of its encounter, as of `Quantity`.
    """

    request: Prediction
    status: str
    reason: str
    facts: Facts | None = None
    disc: Disc | None = None
    names: tuple[str, ...] = ()


class Foretold(NamedTuple):
    """The predictions that exist for an orbit and can be believed, and the others."""

    found: list[Quantity]
    missing: list[Missing]


def predicted(scene: Scene, trajectory: Trajectory, requests: Sequence[Prediction]) -> Foretold:
    """The predictions that exist for an orbit, and those that do not."""
    found, missing = [], []
    for request in requests:
        try:
            found.append(quantity(scene, trajectory, request))
        except NoAnswerError as error:
            missing.append(missing_prediction(request, error, trajectory))
    return Foretold(found, missing)


def foretell(scene: Scene, fit: Fit, trajectory: Trajectory | None = None) -> Foretold:
    """All predictions of a mission on the orbit one estimator found.

    Parameters
    ----------
    trajectory : that orbit over everything that is asked for; by default as it was estimated.
    """
    requests, orbit = scene.mission.predictions, fit.trajectory if trajectory is None else trajectory
    if fit.estimate.solution is None:
        reason = f"the measurements do not determine the orbit: {fit.message}"
        return Foretold(found=[], missing=[unknown_orbit(request, reason) for request in requests])
    found, missing = predicted(scene, orbit, requests)
    return believable(found, missing, fit.estimate)


def unknown_orbit(request: Prediction, reason: str) -> Missing:
    """What is said of a prediction when no orbit is known."""
    return Missing(request=request, status="orbit_unknown", reason=reason)


def missing_prediction(request: Prediction, error: NoAnswerError, trajectory: Trajectory) -> Missing:
    """What an error says of a prediction on an orbit."""
    known = error if isinstance(error, NoEventError) else None
    return Missing(
        request=request,
        status=error.status,
        reason=str(error),
        facts=None if known is None else known.facts,
        disc=None if known is None else known.disc,
        names=(*STATE_NAMES, *trajectory.parameter_names),
    )


def believable(found: Sequence[Quantity], missing: Sequence[Missing], estimate: Estimate) -> Foretold:
    """The same without those whose 1 sigma ellipse is larger than the body, or the sky, it lies on."""
    kept, without = [], list(missing)
    for one in found:
        said = _too_large(one, estimate)
        if said is None:
            kept.append(one)
        else:
            without.append(
                Missing(
                    request=one.request, status="too_uncertain", reason=said, facts=one.facts, disc=one.disc,
                    names=one.names,
                )
            )  # fmt: skip
    return Foretold(kept, without)


def _too_large(one: Quantity, estimate: Estimate) -> str | None:
    """Why an ellipse is no answer, or None."""
    sky, entry = one.unit == "arcsec", one.facts if isinstance(one.facts, EntryFacts) else None
    if not sky and entry is None:
        return None
    sigma = estimate.predict(*known_partials(one, estimate)).factor
    axes = np.linalg.svd(sigma, compute_uv=False)
    radius = 1.0 / ARCSEC if entry is None else SURFACE_KM[entry.encounter.body] + entry.altitude_km
    if axes[0] < radius:
        return None
    size = " x ".join(f"{axis * ARCSEC / np.radians(1.0) if sky else axis:.4g}" for axis in axes)
    what = "deg, larger than the sky"
    if entry is not None:
        what = f"km, larger than {entry.encounter.body} at that altitude"
    return f"the 1 sigma ellipse would be {size} {what}: this orbit does not tell where; ask for b_plane" + (
        " or rtn" if sky else ""
    )
