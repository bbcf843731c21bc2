"""Which values the points of a study have: every combination, or a sample that fills the space evenly.

A point is a pure function of the study and its number, so that any worker makes any point.
"""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.mission.yaml.yamlfile import Tree
from nebosvod.studies.axes import Axis

Array = npt.NDArray[np.float64]
Method = Literal["grid", "sobol", "latin"]
MOST_SAMPLES = 2**22
BLOCK = 4096  # rows of a Sobol sequence made at a time


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """How points are chosen.

    Attributes
    ----------
    method : grid, sobol (base points for sensitivity indices, each with d + 2 missions), latin.
    n : base points; 0 for a grid.
    seed : of the scrambling, or of the squares.
    """

    method: Method = "grid"
    n: int = 0
    seed: int = 0


def read_sample(value: Any) -> Sample:
    """Read `sample` of a study: `grid`, `{sobol: {n: 4096, seed: 1}}` or `{kind: latin, n: 1000}`.

    Raises
    ------
    InputError
        If it is none; says what is allowed.
    """
    allowed = "allowed grid, {sobol: {n: 4096}}, {latin: {n: 1000}}; seed is optional"
    if value == "grid":
        return Sample()
    body: Any = value
    if isinstance(value, dict) and len(value) == 1 and next(iter(value)) in ("sobol", "latin"):
        ((method, body),) = value.items()
    elif isinstance(value, dict) and value.get("kind") in ("grid", "sobol", "latin"):
        method, body = value["kind"], {key: one for key, one in value.items() if key != "kind"}
        if method == "grid" and not body:
            return Sample()
    else:
        raise InputError(f"is no way to choose points ({allowed})")
    if not isinstance(body, dict) or not {*body} <= {"n", "seed"} or "n" not in body:
        raise InputError(f"{method} needs n, a whole number ({allowed})")
    n, seed = body["n"], body.get("seed", 0)
    if not _whole(n, 2, MOST_SAMPLES) or not _whole(seed, 0, 2**63 - 1):
        raise InputError(f"{method}: n is 2 to {MOST_SAMPLES:,} and seed 0 or more, whole numbers (got {n}, {seed})")
    if method == "sobol" and n & (n - 1):
        lower = 1 << (n.bit_length() - 1)
        raise InputError(f"sobol: n must be a power of two, for an even sample (got {n}; try {lower} or {2 * lower})")
    return Sample(method=method, n=n, seed=seed)


def _whole(value: Any, low: int, high: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high


class Points:
    """The points of a study by their numbers.

    Parameters
    ----------
    axes : what is varied, the last one fastest in a grid.
    """

    def __init__(self, axes: Sequence[Axis], sample: Sample) -> None:
        self.axes, self.sample = tuple(axes), sample
        self._rows: dict[int, Array] = {}
        self._squares: Array | None = None

    @property
    def count(self) -> int:
        """How many there are."""
        if self.sample.method == "grid":
            return math.prod(axis.count for axis in self.axes)
        each = len(self.axes) + 2 if self.sample.method == "sobol" else 1
        return self.sample.n * each

    def __getitem__(self, number: int) -> list[tuple[Tree, float | str]]:
        """For each axis the value for the mission, and the one for the table."""
        if self.sample.method == "grid":
            found: list[tuple[Tree, float | str]] = []
            for axis in reversed(self.axes):
                number, step = divmod(number, axis.count)
                found.append(axis.at_step(step))
            return found[::-1]
        row = self._latin(number) if self.sample.method == "latin" else self._sobol(number)
        return [axis.at_fraction(float(one)) for axis, one in zip(self.axes, row)]

    def shown(self, number: int) -> list[float | str]:
        """What the table has of a point: in a grid no value is made for it."""
        if self.sample.method != "grid":
            return [shown for _, shown in self[number]]
        found: list[float | str] = []
        for axis in reversed(self.axes):
            number, step = divmod(number, axis.count)
            found.append(axis.shown(step))
        return found[::-1]

    def _latin(self, number: int) -> Array:
        from scipy.stats import qmc

        if self._squares is None:
            rng = np.random.default_rng(self.sample.seed)
            self._squares = np.asarray(qmc.LatinHypercube(len(self.axes), seed=rng).random(self.sample.n))
        row: Array = self._squares[number]
        return row

    def _sobol(self, number: int) -> Array:
        """A row of A, of B, or of A with one column of B.

        References
        ----------
        Saltelli et al. 2010, Computer Physics Communications 181, 259, section 4: A and B of one sequence of 2 d.
        """
        d = len(self.axes)
        base, which = divmod(number, d + 2)
        block, inside = divmod(base, BLOCK)
        if block not in self._rows:
            self._rows = {block: _sequence(2 * d, self.sample.seed, block * BLOCK, min(BLOCK, self.sample.n))}
        both = self._rows[block][inside]
        row: Array = both[d:].copy() if which == 1 else both[:d].copy()
        if which >= 2:
            row[which - 2] = both[d + which - 2]
        return row


def _sequence(dimensions: int, seed: int, first: int, count: int) -> Array:
    from scipy.stats import qmc

    sequence = qmc.Sobol(dimensions, scramble=True, seed=np.random.default_rng(seed))
    if first:
        sequence.fast_forward(first)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that a part of the sequence is no power of two
        return np.asarray(sequence.random(count), dtype=np.float64)
