"""Errors that the records of a station share: a bias, its drift, a late clock, a slow wander; each by a score test.

A weight says that errors are drawn anew at each record. Where a station's records share one, they weigh too much: a
thousand of them outvote better data, which then look like gross errors. Every station, each of its visits (records
without a pause of `PAUSE_S`) and each night is asked on the converged fit whether one would explain its residuals.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from nebosvod.estimation.accuracy.score import FEW_FREE, Score, alone, among, score_test
from nebosvod.fits.correction import Correction
from nebosvod.fits.screening import PROMISING, Groups, promising
from nebosvod.observation.measurement.exposures import Sky
from nebosvod.timescale import SECONDS_PER_DAY
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.int64]
BASIC = ("bias", "clock", "drift")  # kinds that are asked of every group
PAUSE_S = 30.0 * SECONDS_PER_DAY
SURE = 5.0  # sigmas of a shared error, from which a station's weights are not believed
LEAST = 3  # records that share an error
CYCLES = (3, 10, 30)  # of the wander over the span of the records, each tried
PARTS = 64  # of the span, whose means tell whether to look for a wander
BESIDE = {"drift": slice(2, 4), "wander": slice(4, None)}  # what a kind adds to those before it
MANY = 48  # records, from which a wander is looked for whatever the slopes say
CALM = 0.5  # of the way to `SURE` that residuals may move before a quiet group is asked again
DESERTED = 0.3  # of the records rejected: the full test is made whatever the selected say


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Records:
    """What a test needs to know of the records: station, night and clock; arrays (n,).

    Attributes
    ----------
    asked : which stations' errors the settings leave open; one they name is the user's affair.
    """

    station: npt.NDArray[np.str_]
    night: Rows
    asked: Flags

    @property
    def voice(self) -> Array:
        """What a record's whitened rows are multiplied by (n,): all of a station not asked speak as one."""
        _, which, count = np.unique(self.station, return_inverse=True, return_counts=True)
        return np.asarray(np.where(self.asked, 1.0, 1.0 / np.sqrt(count[which.ravel()])), dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SharedError:
    """The error that explains the residuals of a station, or of one of its visits, best.

    Attributes
    ----------
    rows : (m,) its records, rejected ones included.
    span_s : first and last of them, after the epoch of the sky.
    whole : whether these are all the records of the station.
    kind : bias, drift, clock or wander; scatter where the sigmas are too small by a factor, which is the estimate.
    significance : of each kind by itself, sigmas; of a drift beside a bias.
    estimate, sigma : of the best: arcsec, arcsec/d, s; RA cos Dec and Dec where there are two.
    tried : number of tests that were made on the way, of every kind and group.
    merit : chi squared explained, in units of the scatter, less ln(2m) for each parameter.
    size_rad : (2,) root mean square of the error over the records, RA cos Dec and Dec.
    worth : mean standard deviation of its records, rad.
    """

    station: str
    rows: Rows
    span_s: tuple[float, float]
    whole: bool
    kind: str
    significance: dict[str, float]
    estimate: tuple[float, ...]
    sigma: tuple[float, ...]
    tried: int
    merit: float
    size_rad: Array
    worth: float

    @property
    def sure(self) -> float:
        """Significance of the kind that explains it best."""
        return self.significance[self.kind]

    @property
    def corrected(self) -> float:
        """The same as the largest of all tests that were made: sigmas that are as rare among so many."""
        return among(self.sure, self.tried)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Footing:
    """A converged fit as its tests need it: whitened partials B (n, 2, s), residuals q (n, 2), information and slope.

    Attributes
    ----------
    W : (n, 2, 2) whitener. rate : (n, 2) apparent motion, rad/s. R : (n, 2, 2) of the weights.
    """

    B: Array
    q: Array
    W: Array
    R: Array
    rate: Array
    t_s: Array
    information: Array
    slope: Array
    selected: Flags

    @classmethod
    def of(
        cls, sky: Sky, found: Correction, selected: Flags, records: Records, beside: Array | None = None
    ) -> "Footing":
        """The footing of a correction with a covariance.

        Parameters
        ----------
        records : a station whose error the settings name is no witness against others, though it counts.
        beside : shape (n, 2, m), partials by further parameters that are let free, such as a force.
        """
        if found.S is None:
            raise ValueError("a fit without covariance has no footing")
        W = sky.whitener * records.voice[:, None, None]
        B = W @ (found.seen.H @ found.S)
        if beside is not None:
            extra = W @ beside
            B = np.concatenate([B, extra / np.sqrt(np.sum(extra[selected] ** 2, axis=(0, 1)))], axis=2)
        q = np.einsum("nij,nj->ni", W, found.residual)
        chosen = B[selected]
        information = np.tensordot(chosen, chosen, axes=([0, 1], [0, 1]))
        slope = np.tensordot(chosen, q[selected], axes=([0, 1], [0, 1]))
        stated = sky.whitener[selected] @ (found.seen.H[selected] @ found.S)
        known = np.eye(found.S.shape[1]) - np.tensordot(stated, stated, axes=([0, 1], [0, 1]))
        if np.trace(known) > 1e-6:  # what a prior adds; its pull balances that of the records
            whole = np.einsum("nij,nj->ni", sky.whitener[selected], found.residual[selected])
            information[: len(known), : len(known)] += known
            slope[: len(known)] -= np.tensordot(stated, whole, axes=([0, 1], [0, 1]))
        return cls(
            B=B, q=q, W=W, R=sky.R, rate=found.seen.rate, t_s=sky.t_s, information=information,
            slope=slope, selected=selected,
        )  # fmt: skip

    def score(self, rows: Rows, G: Array, cluster: Rows, everyone: bool = False) -> Score | None:
        """The test of parameters with partials G (m, 2, k), rad per unit, on some records; see `score_test`."""
        whitened = self.W[rows] @ G
        inside = self.selected[rows]
        return score_test(
            self.q[rows], self.B[rows], whitened, self.information, self.slope, inside, cluster, everyone=everyone
        )


@dataclass(slots=True, kw_only=True, eq=False)
class _Quiet:
    """A group that had nothing to say: residuals and selection then, and how far the former may move till it may."""

    q: Array
    selected: Flags
    margin: float


class Asked:
    """The groups of a fit, and of those that were quiet in an earlier round what they said."""

    def __init__(self, found: Iterable[tuple[str, Rows, bool]]) -> None:
        self.groups = list(found)
        self.tried = sum(len(BASIC) if len(rows) > LEAST else len(BASIC) - 1 for _, rows, _ in self.groups)
        self.quiet: dict[int, _Quiet] = {}

    def unchanged(self, number: int, footing: Footing) -> bool:
        """Whether a group is as quiet as before: a statistic's root moves by no more than its whitened residuals."""
        before, rows = self.quiet.get(number), self.groups[number][1]
        return (
            before is not None
            and np.array_equal(before.selected, footing.selected[rows])
            and float(np.linalg.norm(before.q - footing.q[rows])) < before.margin
        )


def shared_errors(
    footing: Footing, records: Records, asked: Asked, aside: Flags | None = None, doubted: float | None = None
) -> list[SharedError]:
    """Every station, visit and night whose records share an error with more than `SURE` sigmas, the foremost first.

    Parameters
    ----------
    asked : the groups of the same records; remembers which were quiet.
    aside : (n,) records whose groups need not be asked.
    doubted : ask whole stations only, and list those that have so many sigmas among them.

    References
    ----------
    Rao 1948, Proc. Camb. Phil. Soc. 44, 50: the score test.
    """
    numbers = [k for k, (_, rows, _) in enumerate(asked.groups) if aside is None or not aside[rows].any()]
    least, screen = SURE, PROMISING
    if doubted is not None:
        numbers = [k for k in numbers if asked.groups[k][2]]
        least, screen = min(SURE, alone(doubted, len(BASIC) * len(numbers))), 0.5 * PROMISING
    found = []
    for k, worth in zip(numbers, _promising(footing, records, [asked.groups[k][1] for k in numbers], screen)):
        if not worth or (doubted is None and asked.unchanged(k, footing)):
            continue
        rows = asked.groups[k][1]
        tested = tests(footing, rows, records.night[rows])
        one = judged(footing, asked.groups[k], tested, tried=asked.tried, least=least)
        if one is None:
            margin = CALM * (SURE - tested.surest) * np.sqrt(min(tested.scatter, 1.0))
            asked.quiet[k] = _Quiet(q=footing.q[rows], selected=footing.selected[rows], margin=margin)
        else:
            found.append(one)
    return sorted(found, key=lambda one: -blame(one))


def blame(one: SharedError) -> float:
    """What decides between two stations that contradict each other: what it would explain, and the better data lead.

    Two stations are told apart by nothing but their difference, which an error of either explains; the root of the
    sigma lets the sharper one stand.
    """
    return one.merit * float(np.sqrt(one.worth))


def groups(t_s: Array, records: Records) -> Iterator[tuple[str, Rows, bool]]:
    """Stations with their records, their visits and nights where there are several, of at least `LEAST` records."""
    order = np.lexsort((t_s, records.station))
    station = records.station[order]
    edges = np.flatnonzero(np.concatenate([[True], station[1:] != station[:-1], [True]]))
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist()):
        rows = order[first:last]
        if last - first < LEAST or not records.asked[rows[0]]:
            continue
        code = str(station[first])
        yield code, rows, True
        for part in parts(t_s[rows], records.night[rows]):
            yield code, rows[part], False


def parts(t_s: Array, night: Rows) -> Iterator[Rows]:
    """Visits of a station, and nights of visits, as places in its records (in the order of time); no part twice.

    Those of fewer than `LEAST` records are left out.
    """
    place, pause = np.arange(len(t_s)), np.diff(t_s) > PAUSE_S
    visits = _edges(pause)
    if len(visits) > 2:
        yield from (place[a:b] for a, b in pairwise(visits) if b - a >= LEAST)
    whole = set(pairwise(visits))
    nights = _edges(pause | (np.diff(night) != 0))
    yield from (place[a:b] for a, b in pairwise(nights) if b - a >= LEAST and (a, b) not in whole)


def _edges(change: Flags) -> list[int]:
    """Where parts begin and end, by whether each record but the first begins one."""
    return [0, *(np.flatnonzero(change) + 1).tolist(), len(change) + 1]


def _promising(footing: Footing, records: Records, asked: Sequence[Rows], screen: float) -> Flags:
    """Whether a full test of each group is worth its time."""
    if not asked:
        return np.zeros(0, dtype=np.bool_)
    every = Groups(asked)
    rows, information = every.rows, footing.information
    kept, t_s, q = footing.selected[rows], footing.t_s[rows], footing.q[rows]
    worth = promising(
        every,
        t_s,
        records.night[rows],
        kept,
        q,
        footing.B[rows],
        footing.W[rows],
        footing.rate[rows],
        information,
        screen,
    )
    worth |= every.sums(kept) < (1.0 - DESERTED) * every.length
    for k in np.flatnonzero(~worth & (every.length >= MANY)):
        mine = slice(every.start[k], every.start[k] + every.length[k])
        span = max(float(np.ptp(t_s[mine])), 1e-9)
        worth[k] = _uneven(q[mine], 2.0 * np.pi * (t_s[mine] - t_s[mine].min()) / span)
    return worth


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tests:
    """The scores of every kind that a group of records can tell, with their partials, and significance by kind."""

    scores: dict[str, tuple[Score, Array]]
    sure: dict[str, float]

    @property
    def surest(self) -> float:
        """The largest significance of all."""
        return max(self.sure.values(), default=0.0)

    @property
    def scatter(self) -> float:
        """Variance of whitened residuals by the best model."""
        return min((score.scatter for score, _ in self.scores.values()), default=1.0)


def tests(footing: Footing, rows: Rows, night: Rows) -> Tests:
    """Test every kind on one group of records."""
    night = np.unique(night, return_inverse=True)[1].ravel()
    scores: dict[str, tuple[Score, Array]] = {}
    for kind, G in _designs(footing, rows, night):
        score = footing.score(rows, G, night)
        if score is not None and (kind not in scores or score.explained > 1.5 * scores[kind][0].explained):
            scores[kind] = score, G
    sure = {kind: score.part(BESIDE.get(kind, slice(None))) for kind, (score, _) in scores.items()}
    return Tests(scores=scores, sure=sure)


def judged(
    footing: Footing, group: tuple[str, Rows, bool], tested: Tests, *, tried: int, least: float = SURE
) -> SharedError | None:
    """The kind that explains one group of records best; None where none has `least` sigmas."""
    code, rows, whole = group
    scores, sure = tested.scores, tested.sure
    able = [kind for kind in scores if sure[kind] >= SURE] or [kind for kind in scores if sure[kind] >= least]
    if not able:
        return None
    few = 2 * len(rows) < FEW_FREE  # whose scatter may be small by chance, and would make them the foremost
    scatter = max(tested.scatter, 1.0) if few else tested.scatter
    merit = {kind: _merit(scores[kind][0], scatter, len(rows)) for kind in able}
    kind = max(able, key=lambda name: merit[name])
    score, G = scores[kind]
    weight = 1.0 / np.diagonal(footing.R[rows], axis1=1, axis2=2)
    error = np.einsum("nik,k->ni", G, score.estimate)
    shown = {"drift": slice(2, 4), "wander": slice(0, 2)}.get(kind, slice(None))
    unit = {"clock": 1.0}.get(kind, ARCSEC)
    return SharedError(
        station=code,
        rows=rows,
        span_s=(float(footing.t_s[rows].min()), float(footing.t_s[rows].max())),
        whole=whole,
        kind=kind,
        significance=dict(sure),
        estimate=tuple((score.estimate[shown] / unit).tolist()),
        sigma=tuple((np.sqrt(np.diag(score.covariance)[shown]) / unit).tolist()),
        tried=tried,
        merit=merit[kind],
        size_rad=np.sqrt(np.sum(weight * error**2, axis=0) / weight.sum(axis=0)),
        worth=float(np.sqrt(np.mean(1.0 / weight))),
    )


def _merit(score: Score, scatter: float, m: int) -> float:
    """Chi squared explained, in the scatter that the best model leaves, less ln(2m) for each parameter."""
    return score.explained / max(scatter, 1e-12) - len(score.estimate) * float(np.log(2.0 * m))


def _designs(footing: Footing, rows: Rows, night: Rows) -> Iterator[tuple[str, Array]]:
    """Partials (m, 2, k) of the kinds that the records can tell: rad per rad, rad/s, rad per rad and rad/day.

    Parameters
    ----------
    night : (m,) number of each record's night, counted from 0.
    """
    t_s = footing.t_s[rows]
    eye = np.broadcast_to(np.eye(2), (len(rows), 2, 2))
    yield "bias", np.array(eye)
    yield "clock", footing.rate[rows][:, :, None]
    span = float(np.ptp(t_s))
    if span <= 0.0 or len(rows) <= LEAST:
        return
    day = ((t_s - t_s.mean()) / SECONDS_PER_DAY)[:, None, None]
    drift = np.concatenate([eye, day * eye], axis=2)
    yield "drift", drift
    turn = 2.0 * np.pi * (t_s - t_s.min()) / span
    for cycles in CYCLES:
        if min(len(rows) // 16, int(night.max() + 1) // 6) < cycles:
            return
        if cycles == CYCLES[0] and not _uneven(footing.q[rows], turn):
            return
        waves = [wave(k * turn)[:, None, None] * eye for k in range(1, cycles + 1) for wave in (np.cos, np.sin)]
        yield "wander", np.concatenate([drift, *waves], axis=2)


def _uneven(q: Array, turn: Array) -> bool:
    """Whether the means of whitened residuals (m, 2) over parts of the span scatter more than the residuals do."""
    part = np.minimum((turn / (2.0 * np.pi) * PARTS).astype(np.int64), PARTS - 1)
    size = np.linalg.norm(q, axis=1)
    kept = size <= 4.0 * max(float(np.median(size)), 1e-300)
    count = np.bincount(part[kept], minlength=PARTS)
    full = count > 0
    spread = sum(np.sum(np.bincount(part[kept], q[kept, k], PARTS)[full] ** 2 / count[full]) for k in range(2))
    own = float(np.sum(q[kept] ** 2))
    parts, rest = 2.0 * float(full.sum()), 2.0 * float(count.sum()) - 2.0 * float(full.sum())
    if rest <= 0.0:
        return False
    ratio = (float(spread) / parts) / max((own - float(spread)) / rest, 1e-300)
    return bool(ratio > 1.0 + 4.0 * np.sqrt(2.0 / parts + 2.0 / rest))


def inflation(one: SharedError, R: Array) -> Array:
    """Factor (2,) on the sigmas of a group, after which it weighs as one record with the size of its shared error.

    A mean of m records with a common error b has variance 1 / sum(1 / sigma^2) + b^2; so every sigma^2 is multiplied
    by 1 + b^2 sum(1 / sigma^2). Sigmas that are too small are enlarged by what they lack; where few degrees of freedom
    f tell it, by the root of f / (f - 2) more: errors in units of a scatter that is estimated are those of Student.
    """
    if one.kind == "scatter":
        freedom = 0.5 * (one.estimate[0] / one.sigma[0]) ** 2
        return np.full(2, max(one.estimate[0], 1.0) * np.sqrt(freedom / max(freedom - 2.0, 0.5 * freedom)))
    weight = np.sum(1.0 / np.diagonal(R[one.rows], axis1=1, axis2=2), axis=0)
    return np.asarray(np.sqrt(1.0 + one.size_rad**2 * weight), dtype=np.float64)
