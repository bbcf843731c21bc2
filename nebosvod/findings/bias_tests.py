"""Is there a bias: of each telescope, one that is there all the time, and one that appears; with the tests' power.

Each question is asked on the settled fit, in a model of everything else that errs. The chance of a false alarm is held
over all telescopes and both questions together. Of recorded observations the stated sigmas are not believed: what their
errors are is seen in the sums of the residuals of each night.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.engine.fitting import Fit
from nebosvod.errors import GeometryError
from nebosvod.estimation import Block, LinearProblem
from nebosvod.estimation.accuracy.appearing import Ground, Scan
from nebosvod.findings.settled import settled, without_bias
from nebosvod.scene.prior import STATE_NAMES
from nebosvod.scene.scene import Scene
from nebosvod.timescale import SECONDS_PER_DAY
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
LEVEL = 0.01  # chance of any false alarm in a run or a fit
MOMENTS = 20  # at which a bias may appear, equally many measurements apart
MOMENTS_RECORDED = 8  # the same of recorded observations
LEAST = 8  # measurements of a telescope that is asked
NIGHT_S = 0.5 * SECONDS_PER_DAY  # a longer pause parts two nights
SIZES = np.array([0.0, *np.geomspace(0.3, 20.0, 24)])  # of a bias, in its own sigmas
NOTHING = "no bias"
FOUND = (0.5, 0.9)  # chances to be found, whose sizes are told


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """A bias, as the measurements say if it is there.

    Attributes
    ----------
    since_s : when it begins, TDB s after the reference epoch; None where it is there all the time.
    statistic, chance : drop of chi2 by it, and the chance of as much without any bias.
    bias_rad, sigma_rad : (2,) RA* and Dec.
    shift_km, shift_sigmas : by how much the position at the reference epoch moves if the bias is estimated from then
        on, and the state in the largest of its sigmas.
    """

    since_s: float | None
    statistic: float
    chance: float
    bias_rad: Array
    sigma_rad: Array
    shift_km: float
    shift_sigmas: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Power:
    """How large a bias is found: sizes (k,) rad in the direction hardest to see, with the chances to find each."""

    sizes_rad: Array
    chance: Array

    def size_found(self, chance: float) -> float | None:
        """The smallest size, rad, that is found with this chance; None beyond the curve."""
        above = np.flatnonzero(self.chance >= chance)
        if not above.size or above[0] == 0:
            return None
        i = int(above[0])
        return float(np.interp(chance, self.chance[i - 1 : i + 1], self.sizes_rad[i - 1 : i + 1]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BiasTest:
    """The answer for one telescope.

    Attributes
    ----------
    constant, appearing : None where it cannot be told from the motion.
    verdict : no bias, constant or appearing. reason : where nothing could be asked, why.
    modelled : whether the estimator estimates a bias of this telescope anyway.
    power_constant, power_appearing : of one there all the time, and of one from the middle of its measurements on; None
        where the sigmas are not believed.
    """

    telescope: str
    n: int
    constant: Hypothesis | None
    appearing: Hypothesis | None
    verdict: str
    modelled: bool
    reason: str = ""
    power_constant: Power | None = None
    power_appearing: Power | None = None

    @property
    def leading(self) -> Hypothesis:
        """The bias that was found."""
        found = self.appearing if self.verdict == "appearing" else self.constant
        if found is None or self.verdict == NOTHING:
            raise ValueError(f"{self.telescope} has no bias")
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BiasTests:
    """The answers for all telescopes; `level` is the chance of any false alarm among all of them."""

    level: float
    tests: tuple[BiasTest, ...]

    @property
    def arrays(self) -> Mapping[str, Array]:
        """Power curves (tests, 2, k), constant and appearing: `bias_power` by `bias_size_arcsec`; empty without any."""
        if all(one.power_constant is None for one in self.tests):
            return {}
        shape = (len(self.tests), 2, len(SIZES))
        sizes, power = np.full(shape, np.nan), np.full(shape, np.nan)
        for i, one in enumerate(self.tests):
            for form, curve in enumerate((one.power_constant, one.power_appearing)):
                if curve is not None:
                    sizes[i, form], power[i, form] = curve.sizes_rad / ARCSEC, curve.chance
        return {"bias_size_arcsec": sizes, "bias_power": power}


def bias_tests(scene: Scene, fit: Fit, *, recorded: bool = False) -> BiasTests:
    """Ask every telescope on a settled fit.

    Parameters
    ----------
    recorded : whether the errors are real ones, whose sigmas somebody stated.
    """
    index, names = scene.exposures.telescope_index, [one.name for one in scene.exposures.telescopes]
    asked = [i for i in range(len(names)) if np.count_nonzero(index == i) >= LEAST]
    if fit.estimate.solution is None or not asked:
        return BiasTests(level=LEVEL, tests=())
    try:
        problem = settled(fit)
        return BiasTests(level=LEVEL, tests=tuple(_one_after_the_other(scene, fit, problem, asked, recorded)))
    except GeometryError:  # without what a prior or a treatment held, nothing can be told
        return BiasTests(level=LEVEL, tests=())


def _one_after_the_other(
    scene: Scene, fit: Fit, problem: LinearProblem, asked: Sequence[int], recorded: bool
) -> Iterator[BiasTest]:
    """Ask all, take what is surest into the model and ask the others anew: one telescope's bias moves all residuals."""
    index, names = scene.exposures.telescope_index, [one.name for one in scene.exposures.telescopes]
    level = LEVEL / (2 * len(asked))
    beside: tuple[Block, ...] = ()
    found: dict[int, BiasTest] = {}
    left = list(asked)
    while left:
        ground = Ground.of(_with(problem, beside))
        for i in left:
            rows = np.flatnonzero(index == i)
            found[i] = _asked(scene, fit, ground, beside, names[i], rows, level, recorded)
        sure = [i for i in left if found[i].verdict != NOTHING]
        if not sure:
            break
        best = max(sure, key=lambda i: found[i].leading.statistic)
        left = [i for i in sure if i != best]
        if left:
            beside = (
                *beside,
                _as_block(scene, problem, names[best], np.flatnonzero(index == best), found[best].leading),
            )
        else:
            break
    yield from (found[i] for i in asked)


def _with(problem: LinearProblem, beside: tuple[Block, ...]) -> LinearProblem:
    return replace(problem, blocks=(*problem.blocks, *beside))


def _as_block(scene: Scene, problem: LinearProblem, telescope: str, rows: Rows, found: Hypothesis) -> Block:
    """A bias that was found, as parameters of which nothing is known beforehand."""
    begun = rows if found.since_s is None else rows[scene.exposures.t_s[rows] >= found.since_s]
    H = np.zeros((problem.n, problem.p, problem.p))
    H[begun] = np.eye(problem.p)
    name = f"bias found {telescope}"
    return Block(name=name, names=tuple(f"{name} {axis}" for axis in range(problem.p)), H=H)


def _asked(
    scene: Scene,
    fit: Fit,
    ground: Ground,
    beside: tuple[Block, ...],
    telescope: str,
    rows: Rows,
    level: float,
    recorded: bool,
) -> BiasTest:
    """Both questions to one telescope."""
    t_s = scene.exposures.t_s
    without = without_bias(scene, fit, telescope)
    pauses = np.diff(t_s[rows], prepend=t_s[rows[0]]) > NIGHT_S
    clusters = np.cumsum(pauses, dtype=np.int64) if recorded else None
    bare = ground if without is None else Ground.of(_with(without, beside))
    always = bare.scan(rows, rows[:1], clusters)
    moments = MOMENTS_RECORDED if recorded else MOMENTS
    begins = rows[np.unique(np.linspace(0, len(rows) - 2, moments + 2).astype(np.int64)[1:])]
    sudden = ground.scan(rows, begins, clusters)
    constant = None if always is None else _hypothesis(bare, always, None, level)
    appearing = None if sudden is None else _hypothesis(ground, sudden, t_s, level)
    reason = ""
    if constant is None and appearing is None:
        reason = "too few nights to tell" if recorded else "a bias cannot be told from the motion"
    believed = None if recorded else level
    return BiasTest(
        telescope=telescope,
        n=len(rows),
        constant=constant,
        appearing=appearing,
        verdict=_verdict(constant, appearing, level, 1 if sudden is None else len(sudden.onsets)),
        modelled=_modelled(scene, fit, telescope),
        reason=reason,
        power_constant=_power(always, 0, believed),
        power_appearing=None if sudden is None else _power(sudden, len(sudden.onsets) // 2, believed),
    )


def _modelled(scene: Scene, fit: Fit, telescope: str) -> bool:
    """Whether a bias of one telescope alone is among what is estimated."""
    own = [s for s in scene.sources.values() if s.group == "bias" and s.telescopes == (telescope,)]
    return any(scene.mission.source_treatment(fit.estimator, source) == "estimated" for source in own)


def _verdict(constant: Hypothesis | None, appearing: Hypothesis | None, level: float, moments: int) -> str:
    """Which of them, if any; the freedom to choose the moment costs its logarithm."""
    sure = [one for one in (constant, appearing) if one is not None and one.chance < level]
    if not sure:
        return NOTHING
    if constant is None or constant not in sure:
        return "appearing"
    if appearing is None or appearing not in sure:
        return "constant"
    return "appearing" if appearing.statistic - 2.0 * np.log(moments) > constant.statistic else "constant"


def _hypothesis(ground: Ground, scan: Scan, t_s: Array | None, level: float) -> Hypothesis:
    """What the best moment of a scan says."""
    i = scan.best
    bias, covariance = scan.estimate(i)
    place = [ground.names.index(name) for name in STATE_NAMES]
    shift = scan.shift(i)[place]
    return Hypothesis(
        since_s=None if t_s is None else float(t_s[scan.onsets[i]]),
        statistic=float(scan.statistics[i]),
        chance=scan.chance(level if np.isinf(scan.scatter.freedom) else 0.0),  # rough scatters need no draws
        bias_rad=bias,
        sigma_rad=np.sqrt(np.diag(covariance)),
        shift_km=float(np.linalg.norm(shift[:3])),
        shift_sigmas=float(np.abs(shift / scan.sigma[place]).max()),
    )


def _power(scan: Scan | None, i: int, level: float | None) -> Power | None:
    """The power curve of a bias from moment i on."""
    if scan is None or level is None:
        return None
    unit = float(1.0 / np.sqrt(np.linalg.eigvalsh(scan.own(i))[0]))
    return Power(sizes_rad=unit * SIZES, chance=scan.power(i, unit * SIZES, level))
