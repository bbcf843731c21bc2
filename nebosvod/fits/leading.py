"""The best data lead: a station that contradicts itself or better data loses its weight, not they their place.

After the first correction every station is asked for shared errors (`shared_errors`). The foremost loses weight until
it weighs as one record of the size of its error, and the selection is made anew: sharp records that a crowd with a
common bias had outvoted come back by themselves.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel
from nebosvod.errors import CoverageError, EventError, InputError
from nebosvod.estimation import Status
from nebosvod.estimation.solvers.rejection import Thresholds
from nebosvod.fits.correction import Correction, Knowledge, correct
from nebosvod.fits.missing_force import MissingForce, foremost, missing_forces
from nebosvod.fits.selection import Selected, select
from nebosvod.fits.shared_errors import (
    PAUSE_S,
    SURE,
    Asked,
    Footing,
    Records,
    SharedError,
    blame,
    groups,
    inflation,
    judged,
    shared_errors,
    tests,
)
from nebosvod.fits.sharpest import SHARPER, Sharpest, sharpest, sigma_rad
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.scene.material import Material

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
ROUNDS = 12
TOGETHER = 0.3  # of the foremost station's blame: those above lose weight in the same round
DOUBTED = 2.0  # sigmas among stations, from which one loses weight where sharper records that agree were thrown out
SPARED = 18.4  # chi squared of a sharp record, which chance exceeds once in 10,000, below which none is left out
OUTVOTED = 0.5  # of a group's records rejected, above which it was thrown out
FREED = 3.0  # sigmas on the orbit of the others, below which a station gets its weight back
NOTE = ", shared error"  # in the rule of its weight
CLOSE = 1.2  # ratio of old and new size of a shared error, within which nothing is made anew


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Led:
    """A correction in which no station is believed against better data.

    Attributes
    ----------
    material, sky, wide : with the sigmas of `errors` enlarged, unless their weights were to stay.
    errors : the shared errors found, judged on the final orbit with the weights as they were.
    spared : (n,) sharp records that agree with each other and are kept where one of a crowd would be rejected.
    forces : the tests of forces that the fit leaves out.
    """

    material: Material
    sky: Sky
    wide: Sky
    lean: Selected
    errors: tuple[SharedError, ...] = ()
    spared: Flags | None = None
    forces: tuple[MissingForce, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """What stays the same from round to round.

    Parameters
    ----------
    forces : with the parameters that are solved for.
    treatment : of a station with a shared error: lighter, told, off.
    skies : gives the sky of a material, and the same with every source that will be estimated as noise.
    """

    material: Material
    records: Records
    treatment: str
    forces: ForceModel
    thresholds: Thresholds | None
    prior: Knowledge | None
    limit: int
    skies: Callable[[Material, Correction], tuple[Sky, Sky]]

    def heard(self, sky: Sky, lean: Selected) -> Sharpest:
        """What the sharpest records say by themselves."""
        records = self.records
        return sharpest(
            sky, lean.correction.x, self.forces, self.thresholds, self.prior, records.station, records.asked
        )  # fmt: skip

    def reselected(self, wide: Sky, start: Correction, chosen: Flags, keep: Flags) -> Selected:
        """Fit and select anew from an earlier correction."""
        return select(
            wide, start.x, self.forces, self.thresholds, selected=chosen, prior=self.prior, near=start, keep=keep,
            limit=self.limit,
        )  # fmt: skip


def convinced(course: Course, sky: Sky, wide: Sky, lean: Selected) -> Led:
    """Ask a converged selection for forces that are missing and errors that are shared, and fit anew by the answer.

    Parameters
    ----------
    sky, wide : that `lean` was made from, without and with what will be estimated as noise.

    Notes
    -----
    A force that is missing looks like errors of the stations at the ends of the arc, and these like a force. Whatever
    explains more is believed: the stations are asked with the force let free where it does.
    """
    now = Led(material=course.material, sky=sky, wide=wide, lean=lean)
    if lean.correction.S is None:
        return now
    forces = missing_forces(wide, lean.correction, lean.selected, course.forces, course.records)
    now = replace(now, forces=forces)
    if course.treatment == "off":
        return now
    force = foremost(forces)
    beside = None
    if force is not None:
        footing = Footing.of(wide, lean.correction, lean.selected, course.records)
        stations = shared_errors(footing, course.records, Asked(groups(sky.t_s, course.records)))
        beside = force.column[:, :, None] if not stations or force.merit > stations[0].merit else None
    found = led(course, now, beside)
    if found.lean is lean or found.lean.correction.S is None:
        return replace(found, forces=forces)
    aside = _marked(len(sky), found.errors)
    again = missing_forces(found.wide, found.lean.correction, found.lean.selected, course.forces, course.records, aside)
    return replace(found, forces=again)


def led(course: Course, now: Led, beside: Array | None = None) -> Led:
    """Find stations with shared errors and fit anew without believing them.

    Parameters
    ----------
    beside : shape (n, 2, m), partials by a force that is let free in the tests, so that no station bears its blame.
    """
    original = now.wide
    asked = Asked(groups(original.t_s, course.records))
    sharp = course.heard(original, now.lean)
    held = list(sharp.errors)
    if held and course.treatment != "told":
        now = _lighter(course, held, original, now.lean.correction, now.lean.selected, sharp.trusted)
    for _ in range(ROUNDS):
        start, chosen = _restored(course, now.wide, now.lean, sharp.trusted)
        if start.S is None:
            return now
        contested = bool((chosen & ~now.lean.selected & sharp.trusted).any())
        aside = _marked(len(original), held) | (sharp.trusted & contested)
        footing = Footing.of(now.wide, start, chosen, course.records, beside)
        fresh = _fresh(shared_errors(footing, course.records, asked, aside, DOUBTED if contested else None))
        held += fresh
        if not fresh or course.treatment == "told":
            break
        now = _lighter(course, held, original, start, chosen, sharp.trusted)
    if course.treatment == "told":
        return replace(now, errors=tuple(held))
    if held:
        now = _settled(course, now, original, held, beside, sharp.trusted)
    return _spared(course, now, sharp.trusted)


def _spared(course: Course, now: Led, trusted: Flags) -> Led:
    """Keep sharp records that agree with each other up to a threshold at which chance hardly rejects one.

    Among a thousand others one record in 55 is rejected by chance, which costs nothing; of seven that decide the orbit
    it would be one in eight times, and as often the answer were twice as wide.
    """
    lean = now.lean
    back = trusted & ~lean.selected & (lean.chi2 < SPARED)
    if not back.any():
        return now
    spared = trusted & (lean.selected | back)
    again = course.reselected(now.wide, lean.correction, lean.selected | back, spared)
    if again.correction.status is not Status.CONVERGED or not again.stands:
        return now
    return replace(now, lean=again, spared=spared)


def _fresh(found: list[SharedError]) -> list[SharedError]:
    """The foremost, and those nearly as sure, each record once."""
    taken: set[int] = set()
    chosen: list[SharedError] = []
    for one in found:
        if chosen and blame(one) < TOGETHER * blame(chosen[0]):
            break
        rows = {int(row) for row in one.rows}
        if not rows & taken:
            chosen.append(one)
            taken |= rows
    return chosen


def _marked(n: int, errors: Iterable[SharedError]) -> Flags:
    """Which of n records belong to any of these."""
    marked = np.zeros(n, dtype=np.bool_)
    for one in errors:
        marked[one.rows] = True
    return marked


def _lighter(
    course: Course, held: list[SharedError], original: Sky, start: Correction, chosen: Flags, trusted: Flags
) -> Led:
    """The fit with every held group weighing as one record.

    Parameters
    ----------
    trusted : (n,) sharp records; kept where it is they that contradict a group which is not sure of its error itself.
    """
    added = np.zeros((len(original), 2))
    for one in held:
        own = np.diagonal(original.R[one.rows], axis1=1, axis2=2)
        added[one.rows] = own * (inflation(one, original.R) ** 2 - 1.0)
    note = np.full(len(original), "", dtype=object)
    for one in held:
        note[one.rows] = NOTE
    material = course.material.lighter(added, note)
    sky, wide = course.skies(material, start)
    contradicted = any(one.kind != "scatter" and one.sure < SURE for one in held)
    lean = course.reselected(wide, start, chosen, trusted & contradicted)
    return Led(material=material, sky=sky, wide=wide, lean=lean, errors=tuple(held))


def _settled(
    course: Course, now: Led, original: Sky, held: list[SharedError], beside: Array | None, trusted: Flags
) -> Led:
    """Judge each held group anew by the orbit of the others; give its weight back, or the size found now."""
    final, changed = now.lean.correction, False
    if final.S is None:
        return now
    footing = Footing.of(now.wide, final, now.lean.selected, course.records, beside)
    apart = Footing.of(original, final, now.lean.selected, course.records, beside)
    kept: list[SharedError] = []
    for one in held:
        if one.kind == "scatter":
            kept.append(one)
            continue
        inside = np.zeros(len(original), dtype=np.bool_)
        inside[one.rows] = footing.selected[one.rows]
        mine = footing.B[inside]
        without = replace(
            apart,
            information=footing.information - np.tensordot(mine, mine, axes=([0, 1], [0, 1])),
            slope=footing.slope - np.tensordot(mine, footing.q[inside], axes=([0, 1], [0, 1])),
            selected=apart.selected & ~inside,
        )
        tested = tests(without, one.rows, course.records.night[one.rows])
        again = judged(
            without,
            (one.station, one.rows, one.whole),
            tested,
            tried=one.tried,
            least=FREED * min(one.sure / SURE, 1.0),
        )
        if again is None and one.sure < SURE:  # sharper records contradict it, and will again
            again = one
        if again is None:
            changed = True
            continue
        ratio = np.linalg.norm(again.size_rad) / max(float(np.linalg.norm(one.size_rad)), 1e-300)
        changed = changed or not 1.0 / CLOSE < ratio < CLOSE
        kept.append(again)
    if not changed:
        return replace(now, errors=tuple(kept))
    return _lighter(course, kept, original, final, now.lean.selected, trusted)


def _restored(course: Course, wide: Sky, lean: Selected, trusted: Flags) -> tuple[Correction, Flags]:
    """The correction with sharper groups put back that were thrown out; as it was where that leads nowhere.

    Parameters
    ----------
    trusted : (n,) sharp records that agree with each other, put back one by one.
    """
    chosen = lean.selected | trusted
    sigma = sigma_rad(wide)
    bound = SHARPER * float(np.median(sigma))
    for code in np.unique(course.records.station[~chosen & (sigma < bound)]):
        mine = np.flatnonzero((course.records.station == code) & (sigma < bound))
        for visit in np.split(mine, np.flatnonzero(np.diff(wide.t_s[mine]) > PAUSE_S) + 1):
            if (~lean.selected[visit]).mean() > OUTVOTED:
                chosen[visit] = True
        if (~lean.selected[mine]).mean() > OUTVOTED:
            chosen[mine] = True
    if np.array_equal(chosen, lean.selected):
        return lean.correction, chosen
    try:
        found = correct(
            wide, lean.correction.x, course.forces, selected=chosen, prior=course.prior, near=lean.correction,
            limit=course.limit,
        )  # fmt: skip
    except (EventError, CoverageError, InputError):
        return lean.correction, lean.selected
    if found.status is not Status.CONVERGED or found.S is None:
        return lean.correction, lean.selected
    return found, chosen
