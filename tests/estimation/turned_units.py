"""Problems of estimation written in other units, and the list of cases that say what must not change by it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st

from nebosvod.estimation import Block, Estimate, LinearProblem, Markov, Prior, White
from nebosvod.estimation.accuracy import (
    budget,
)

Array = npt.NDArray[np.float64]
Numbers = dict[str, object]
STATE = ("x", "y", "vx", "vy")


@dataclass(frozen=True)
class Units:
    """Values in the reference's units times these are values in the new ones."""

    x: Array  # (16,), of parameters, in their order
    z: Array  # (3,), of a fresh nuisance
    m: Array  # (2,), of a measurement's components
    length: float  # where several components share one unit
    time: float

    def of(self, names: tuple[str, ...]) -> Array:
        """Units of parameters by name, whatever the names."""
        return np.array([self.x[sum(map(ord, name)) % len(self.x)] for name in names])


def one(size: float) -> Units:
    return Units(np.full(16, size), np.full(3, size), np.full(2, size), size, size)


NONE = one(1.0)


def drawn(exponents: list[int]) -> Units:
    size = 10.0 ** np.array(exponents, dtype=float)
    return Units(size[:16], size[16:19], size[19:21], float(size[21]), float(size[22]))


EXPONENTS = st.lists(st.integers(-12, 12), min_size=23, max_size=23)
FIXED = [drawn(list(np.random.default_rng(seed).integers(-12, 13, 23))) for seed in range(4)] + [one(1e12), one(1e-12)]


def turned(problem: LinearProblem, units: Units) -> LinearProblem:
    """The same problem in other units."""
    m, z = units.m, units.z
    square = np.outer(m, m)

    def white(w: White) -> White:
        true = None if w.true_Q is None else w.true_Q * np.outer(z, z)
        return replace(w, H=w.H * m[:, None] / z, Q=w.Q * np.outer(z, z), true_Q=true)

    def markov(c: Markov) -> Markov:
        ratio, both = z[:, None] / z, np.outer(z, z)
        return replace(c, H=c.H * m[:, None] / z, F=c.F * ratio, Q=c.Q * both, P0=c.P0 * both)

    def prior(p: Prior) -> Prior:
        u = units.of(p.names)
        true = None if p.true_covariance is None else p.true_covariance * np.outer(u, u)
        assert p.mean is not None
        return replace(p, covariance=p.covariance * np.outer(u, u), mean=p.mean * u, true_covariance=true)

    def block(b: Block) -> Block:
        return replace(b, H=b.H * m[:, None] / units.of(b.names))

    return replace(
        problem,
        residual=problem.residual * m,
        R=problem.R * square,
        true_R=None if problem.true_R is None else problem.true_R * square,
        blocks=tuple(map(block, problem.blocks)),
        priors=tuple(map(prior, problem.priors)),
        white=tuple(map(white, problem.white)),
        markov=tuple(map(markov, problem.markov)),
    )


def numbers(found: Estimate, units: Units) -> Numbers:
    """Everything an estimate says."""
    names = found.names + found.left_out
    u, own = units.of(names), units.of(found.names)
    factors = found.predict(np.diag(1.0 / u), names).factors
    solution = found.solution
    assert solution is not None
    out: Numbers = {
        "mean": found.mean / own,
        "sigma": [found.sigma(name) / unit for name, unit in zip(names, u)],
        "formal": found.K_formal / np.outer(own, own),
        "true": found.K_true / np.outer(own, own),
        "factor": found.S_true / own[:, None],
        "joint": found.factor(names) / u[:, None],
        "shares": [share / np.outer(own, own) for share in found.shares.values()],
        "predicted": [G @ G.T for G in factors.values()],
        "gains": [
            M / u[:, None] * units.of(solution.gain_names[source]) for source, M in solution.gains.items()
        ],
        "shift": [
            found.shift(source, units.of(solution.gain_names[source])) / own for source in solution.gains
        ],
        "mean shift": found.mean_shift(
            {n: 0.3 * float(units.of((n,))[0]) for group in solution.gain_names.values() for n in group}, names
        ) / u,
        "chi2": found.chi2,
        "residual": found.residual_after / units.m,
        "condition": np.log(found.condition_number),
        "rank": found.rank,
        "weak": np.abs(list(found.weak_direction.values())),
        "shares of the state": [share.share for share in budget.shares(found, STATE[:1])],
    }  # fmt: skip
    return out


Case = Callable[[Units], Numbers]
CASES: dict[str, Case] = {}
COVERED: set[str] = set()


def case(*covers: str) -> Callable[[Case], Case]:
    """Register a case and the public names (module.name) it covers."""

    def register(function: Case) -> Case:
        CASES[function.__name__] = function
        COVERED.update(covers)
        return function

    return register


MAKE: dict[str, Callable[..., LinearProblem]] = {}


def problem(units: Units, **options: object) -> LinearProblem:
    return turned(MAKE["problem"](**({"seed": 4, "n": 20} | options)), units)


MIXED = {"c": "considered", "bias": "ignored"}
