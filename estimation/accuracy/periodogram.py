"""Is there a rhythm in a series of unevenly spaced residuals: the highest peak of the periodogram, and its chance.

At each frequency a constant and a wave are fitted together; the power is the part of the sum of squares that the wave
takes away. How often noise alone has so high a peak anywhere below the highest frequency is bounded by the number of
times the power crosses that level upwards.

References
----------
Zechmeister, Kuerster 2009, A&A 496, 577: the wave and the constant together, after Lomb 1976 and Scargle 1982.
Baluev 2008, MNRAS 385, 1279: the chance of a peak.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln

from nebosvod.errors import InputError
from nebosvod.estimation.problem.square_root import products

Array = npt.NDArray[np.float64]
OVERSAMPLED = 4  # frequencies to the width of a peak
MOST = 2_000_000  # products of frequencies and values; of longer series only slower rhythms are looked for
BLOCK = 64  # frequencies
LEAST = 8  # values, of which three go to the constant and the wave


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rhythm:
    """The wave that takes most of a series.

    Attributes
    ----------
    period : in the unit of the times. amplitude : in that of the values.
    power : part of the sum of squares about the mean that it takes, 0 to 1.
    chance : that noise has so high a peak at any period looked at, an upper bound.
    shortest : the shortest period looked at.
    """

    period: float
    amplitude: float
    power: float
    chance: float
    shortest: float


def strongest_rhythm(t: npt.ArrayLike, values: npt.ArrayLike) -> Rhythm:
    """Find the highest peak of the periodogram of values (n,) at times (n,), from the span to two shortest steps."""
    return strongest_rhythms(t, np.asarray(values, dtype=np.float64)[:, None])[0]


def strongest_rhythms(t: npt.ArrayLike, values: Array, most: int = MOST) -> tuple[Rhythm, ...]:
    """The same for c series (n, c) at the same times; `most` products of frequencies and values are looked at."""
    times, y = _series(t, values)
    span = float(np.ptp(times))
    steps = np.diff(np.sort(times))
    step = 1.0 / (OVERSAMPLED * span)
    highest = 0.5 / float(steps[steps > 0.0].min())
    count = max(int(min(highest / step, most / len(y))), OVERSAMPLED)
    powers = power(times, y, step, count)[OVERSAMPLED - 1 :]  # a wave longer than the span is no rhythm
    fastest = step * count
    found = []
    for column in range(y.shape[1]):
        best = int(np.argmax(powers[:, column]))
        frequency, top = step * (best + OVERSAMPLED), float(powers[best, column])
        found.append(
            Rhythm(
                period=1.0 / frequency,
                amplitude=_amplitude(times, y[:, column], frequency),
                power=top,
                chance=_chance(top, fastest, times),
                shortest=1.0 / fastest,
            )
        )
    return tuple(found)


def rhythm_at(t: npt.ArrayLike, values: npt.ArrayLike, period: float) -> Rhythm:
    """The wave of one period that was chosen beforehand; its chance is that of this one alone."""
    times, y = _series(t, np.asarray(values, dtype=np.float64)[:, None])
    found = float(power(times, y, 1.0 / period, 1)[0, 0])
    return Rhythm(
        period=period,
        amplitude=_amplitude(times, y[:, 0], 1.0 / period),
        power=found,
        chance=float((1.0 - found) ** (0.5 * (len(y) - 3))),
        shortest=period,
    )


def power(times: Array, y: Array, step: float, count: int) -> Array:
    """Part of the sums of squares of y (n, c) about their means that waves take (count, c).

    Parameters
    ----------
    step, count : the frequencies are so many multiples of the step.

    Notes
    -----
    Waves of a block of frequencies are those of the first block times one wave, so that all sums over the values are
    products of matrices.
    """
    n, columns = len(times), y.shape[1]
    y = y - y.mean(axis=0)
    whole = np.mean(y**2, axis=0)
    first = np.exp(2j * np.pi * step * np.outer(times, np.arange(1, min(BLOCK, count) + 1)))
    shift = np.exp(2j * np.pi * step * BLOCK * np.outer(times, np.arange(-(-count // BLOCK))))
    loaded = np.concatenate([shift, *(shift * y[:, c : c + 1] for c in range(columns))], axis=1)
    one, *sums = np.split(products(first, loaded) / n, columns + 1, axis=1)
    two = (products(first * first, shift * shift) / n).T.ravel()[:count]
    wave = one.T.ravel()[:count]
    CC, SS, CS = 0.5 + 0.5 * two.real - wave.real**2, 0.5 - 0.5 * two.real - wave.imag**2, 0.5 * two.imag
    CS = CS - wave.real * wave.imag
    D = CC * SS - CS**2
    clear = D > 1e-12
    out = np.zeros((count, columns))
    for c in range(columns):
        Y = sums[c].T.ravel()[:count]
        taken = SS * Y.real**2 + CC * Y.imag**2 - 2.0 * CS * Y.real * Y.imag
        out[:, c] = np.where(clear, taken / np.where(clear, D, 1.0), 0.0) / (whole[c] or 1.0)
    return np.clip(out, 0.0, 1.0 - 1e-15)


def _series(t: npt.ArrayLike, values: Array) -> tuple[Array, Array]:
    """Times from the first on, and values (n, c); refused where they are too few."""
    times, y = np.asarray(t, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if times.shape != y.shape[:1] or y.ndim != 2 or len(y) < LEAST or not np.ptp(times) > 0.0:
        raise InputError(f"periodogram: needs {LEAST} values at different times, got {times.shape} and {y.shape}")
    return times - times.min(), y


def _amplitude(times: Array, y: Array, frequency: float) -> float:
    """Amplitude of the wave of a frequency, fitted with a constant."""
    angle = 2.0 * np.pi * frequency * times
    columns = np.column_stack([np.ones_like(y), np.cos(angle), np.sin(angle)])
    found = np.linalg.lstsq(columns, y, rcond=None)[0]
    return float(np.hypot(found[1], found[2]))


def _chance(highest: float, fastest: float, times: Array) -> float:
    """Baluev's bound of the chance of a peak as high."""
    n = len(times)
    single = (1.0 - highest) ** (0.5 * (n - 3))
    crossings = fastest * np.sqrt(4.0 * np.pi * np.var(times))
    gamma = np.sqrt(2.0 / (n - 1)) * np.exp(gammaln(0.5 * (n - 1)) - gammaln(0.5 * (n - 2)))
    tau = gamma * crossings * (1.0 - highest) ** (0.5 * (n - 4)) * np.sqrt(0.5 * (n - 1) * highest)
    return float(np.clip(-np.expm1(np.log1p(-min(single, 1.0 - 1e-16)) - tau), 0.0, 1.0))
