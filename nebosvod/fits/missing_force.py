"""A force the fit leaves out: score tests of A1 and A2 on all records and on those that rejection left.

A body that sunlight pushes, fitted by gravity alone, bends away from its own records; rejection then takes the ends of
the arc, which are the evidence. So the test is made on every record first, and on the selected ones beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel, Nongrav
from nebosvod.dynamics.impact import fly
from nebosvod.estimation.accuracy.score import Score
from nebosvod.fits.correction import Correction
from nebosvod.fits.shared_errors import SURE, Footing, Records
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.observation.measurement.exposures import Sky

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
ASKED = ("a1_au_d2", "a2_au_d2")
LABEL = {"a1_au_d2": "A1", "a2_au_d2": "A2"}
AREA_TO_MASS = 2.26e-7  # au/d^2 for 1 m^2/kg of C_R A/m, of A1
LEAST = 6  # records, below which a force is not asked about


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MissingForce:
    """What the records say of one force that the fit holds at zero.

    Attributes
    ----------
    name : a1_au_d2 or a2_au_d2.
    before, after : sigmas by all records, gross errors aside, and by the selected ones.
    estimate, sigma : au/d^2, by whichever is surer.
    merit : chi squared it would explain over all records, in units of their scatter.
    column : (n, 2) partials of the directions, rad per au/d^2.
    pull : (s,) what the fit's parameters take up of 1 au/d^2 that is left out.
    """

    name: str
    before: float
    after: float
    estimate: float
    sigma: float
    merit: float
    column: Array
    pull: Array

    @property
    def label(self) -> str:
        """A1 or A2."""
        return LABEL[self.name]

    @property
    def sure(self) -> float:
        """The larger of the two significances."""
        return max(self.before, self.after)


def missing_forces(
    sky: Sky,
    found: Correction,
    selected: Flags,
    forces: ForceModel,
    records: Records,
    aside: Flags | None = None,
) -> tuple[MissingForce, ...]:
    """Test every force of `ASKED` that the fit neither knows nor solves for.

    Parameters
    ----------
    sky : with the weights of the fit.
    forces : of the fit.
    records : stations and nights, within which errors may be alike.
    aside : (n,) records of stations with a shared error. They weigh as one and do not scatter as many, so they are not
        asked where others can be.

    References
    ----------
    Rao 1948, Proc. Camb. Phil. Soc. 44, 50: the score test.
    """
    names = unknown(forces)
    if found.S is None or not names or len(sky) < LEAST:
        return ()
    columns = partials(sky, found, forces, names)
    footing = Footing.of(sky, found, selected, records)
    night = records.night
    asked = np.ones(len(sky), dtype=np.bool_) if aside is None else ~aside
    if np.sum(asked & selected) < LEAST:
        asked[:] = True
    every, kept = np.flatnonzero(asked), np.flatnonzero(asked & selected)
    tested = []
    for k, name in enumerate(names):
        G = columns[:, :, k, None]
        before = footing.score(every, G[every], night[every], everyone=True)
        after = before if len(kept) == len(every) else footing.score(kept, G[kept], night[kept])
        if after is None:
            continue
        tested.append(_told(name, before, after, footing, columns[:, :, k], found.S))
    return tuple(tested)


def unknown(forces: ForceModel) -> tuple[str, ...]:
    """Forces of `ASKED` that are zero and no parameter of the fit; A1 is that of radiation pressure where this acts."""
    given = forces.nongrav or Nongrav()
    taken = set(forces.parameters) | {name for name in ASKED if getattr(given, name) != 0.0}
    if forces.radiation is not None:
        taken.add("a1_au_d2")
    return tuple(name for name in ASKED if name not in taken)


def partials(sky: Sky, found: Correction, forces: ForceModel, names: Sequence[str]) -> Array:
    """Directions (n, 2, m) by forces at zero, rad per au/d^2, on the orbit of a correction."""
    model = forces.with_values(dict(zip(forces.parameters, found.x[6:].tolist()))) if forces.parameters else forces
    model = replace(model, nongrav=model.nongrav or Nongrav(), parameters=tuple(names))
    trajectory = fly(found.state, sky.epoch, sky.span_s, model, found.trajectory)
    return compute(trajectory, sky.exposures, found.seen.light_time_s).H_c


def _told(name: str, before: Score | None, after: Score, footing: Footing, column: Array, S: Array) -> MissingForce:
    """Both tests of one force."""
    surer = before if before is not None and before.significance > after.significance else after
    chosen = footing.selected
    H = np.einsum("nij,nj->ni", footing.W[chosen], column[chosen])
    pull = np.linalg.solve(footing.information, np.einsum("nis,ni->s", footing.B[chosen], H))
    return MissingForce(
        name=name,
        before=0.0 if before is None else before.significance,
        after=after.significance,
        estimate=float(surer.estimate[0]),
        sigma=float(np.sqrt(surer.covariance[0, 0])),
        merit=surer.explained / max(surer.scatter, 1e-12) - float(np.log(2.0 * len(column))),
        column=column,
        pull=S @ pull,
    )


def foremost(tested: Sequence[MissingForce]) -> MissingForce | None:
    """The surest of them; None where none has `SURE` sigmas."""
    sure = [one for one in tested if one.sure >= SURE]
    return max(sure, key=lambda one: one.sure, default=None)


def words(tested: Sequence[MissingForce]) -> str:
    """A caution about the surest force that is missing; empty where none is."""
    one = foremost(tested)
    if one is None:
        return ""
    others = ", ".join(f"{other.label} by {other.sure:.1f}" for other in tested if other is not one)
    body = f", radiation pressure on {1e3 * one.estimate / AREA_TO_MASS:.2g} m^2/t" if one.name == "a1_au_d2" else ""
    return (
        f"a force is missing: {one.label} = {one.estimate:.3g} +- {one.sigma:.2g} au/d^2{body} would explain the "
        f"residuals, {one.before:.1f} sigma by all records and {one.after:.1f} by those that were selected"
        + (f" ({others})" if others else "")
        + f"; without it the sigmas of this orbit do not hold: estimate {one.label} in object.nongrav"
    )
