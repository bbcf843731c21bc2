"""The exponential-cosine correlation of noise that is worst for a weighted sum of measurements (Akim).

K(tau) = exp(-k |tau|) cos(w |tau| + phi) / cos phi is positive definite iff |tan phi| <= k / w. The variance of
sum a_i v_i is linear in tan phi, so its extreme over phi is at the edge: Re Z + (k / w) |Im Z| with
Z = sum_{j<i} a_i a_j exp((-k + i w)(t_i - t_j)). Over w it has peaks as narrow as 2 pi / span, as many as there are
measurements: a rhythm of the weights (a day, an orbit) is found by looking at every frequency, not by a coarse grid.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.borders.compiled import plain_loop

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
LATTICE = 1e-3  # of a step: times so near to multiples of it are taken as such in the scan
FINEST = 2**15  # cells of the scan over the span; more rapid rhythms of longer series are not looked for
SLOWEST = 1e-4  # decay over the span; slower ones change no sigma by more than 2e-5
PER_DECADE = 2  # decays in the scan
POLISHED = 4  # peaks of the scan that are climbed exactly
ROUGH = 40  # periods of a rough search
FORGOTTEN = 12.0  # decay times after which a correlation is nothing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """Weights of scalar measurements in time order, series by series; different series are independent.

    Attributes
    ----------
    a : shape (m,), and `own`, its square sum. t : shape (m,). label : shape (m,), sorted.
    span, shortest : of the longest series, and the shortest step within one; 0 where all times of a series agree.
    """

    a: Array
    t: Array
    label: IntArray
    own: float
    span: float
    shortest: float

    @classmethod
    def of(cls, a: Array, t: Array, label: IntArray) -> "Series":
        """Sort them."""
        order = np.lexsort((t, label))
        a, t, label = a[order], t[order], label[order]
        steps = np.diff(t)[np.diff(label) == 0]
        first = np.searchsorted(label, label, side="left")
        longest = float((t - t[first]).max(initial=0.0))
        shortest = float(steps[steps > 0.0].min(initial=longest))
        return cls(a=a, t=t, label=label, own=float(np.sum(a**2)), span=longest, shortest=shortest)

    def variance(self, k: float, w: float) -> float:
        """Variance with the worst phase."""
        real, imaginary = _lagged(self.a, self.t, self.label, k, w)
        return float(self.own + 2.0 * (real + (k / w) * abs(imaginary)))

    def phase(self, k: float, w: float) -> float:
        """The worst phase, rad."""
        _, imaginary = _lagged(self.a, self.t, self.label, k, w)
        return float(-np.sign(imaginary) * np.arctan2(k, w))


def roughly_worst(series: Series, periods: Array) -> tuple[float, float]:
    """The worst of a few decays at periods (k,) that have a name, and at others, equal parts apart.

    Without the scan and the climb of `worst`: for many series of irregular times, where those take long. Correlations
    that fade within few periods have broad peaks, and a rhythm that everybody asks for is looked at by itself.
    """
    shortest, longest = 2.0 * series.shortest, max(series.span, 2.0 * series.shortest)
    every = np.concatenate([np.geomspace(shortest, longest, ROUGH), periods])
    candidates = [
        (w / fading, w)
        for w in 2.0 * np.pi / every[(every >= shortest) & (every <= longest)]
        for fading in (2.0, 10.0, 100.0)
    ]
    return max(candidates, key=lambda at: series.variance(*at))


def worst(series: Series) -> tuple[float, float]:
    """Find decay and frequency of the largest variance, in the inverse unit of the times.

    Notes
    -----
    Scan: for half-decades of decay from next to none to 10 / shortest step, frequencies in equal steps of at most
    1 / (2 span), or of a 24th of the decay where that is more, up to pi / shortest step. All frequencies of one decay
    are one Fourier transform of the weights' autocorrelation: O(n log n), 3 ms for 1000 measurements. The highest
    peaks are then climbed with the exact sum, O(n) each step.
    """
    from scipy.optimize import minimize  # 0.7 s of import, for this search alone

    low, high = SLOWEST / series.span, 10.0 / series.shortest
    slowest, fastest = 0.01 / series.span, np.pi / series.shortest

    def point(x: Array) -> tuple[float, float]:
        return float(np.exp(np.clip(x[0], *np.log([low, high])))), float(np.clip(x[1] / series.span, slowest, fastest))

    def negative(x: Array) -> float:
        return -series.variance(*point(x))

    best, found = -np.inf, (low, slowest)
    for k, w in _peaks(series, low, high, slowest, fastest):
        start = np.array([np.log(k), w * series.span])
        simplex = start + np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.3]])
        climbed = minimize(negative, start, method="Nelder-Mead", options={"initial_simplex": simplex})
        if -climbed.fun > best:
            best, found = -float(climbed.fun), point(climbed.x)
    return found


def _peaks(series: Series, low: float, high: float, slowest: float, fastest: float) -> Iterator[tuple[float, float]]:
    """Decay and frequency of the highest peaks of the scan, each frequency once."""
    from scipy.fft import next_fast_len, rfft  # 0.1 s of import, for this search alone

    correlation, cell = _autocorrelation(series, fastest)
    lags = cell * np.arange(len(correlation), dtype=np.float32)
    found = []
    # Below a third of 1 / span all decays are one.
    slow = 0.3 / series.span
    for k in (low, *np.geomspace(slow, high, 2 + int(PER_DECADE * np.log10(high / slow)))):
        reach = min(series.span, FORGOTTEN / k)
        count = min(len(lags), int(reach / cell) + 2)
        damped = 2.0 * correlation[:count] * np.exp(np.float32(-k) * lags[:count])
        damped[0] = correlation[0]
        size = next_fast_len(max(int(4.0 * np.pi * reach / cell), 2 * count), real=True)
        spectrum = rfft(damped, size)
        w = 2.0 * np.pi / (size * cell) * np.arange(len(spectrum))
        tangent = k / np.maximum(w, slowest) * np.abs(spectrum.imag)
        tangent[0] = k * abs(float(damped @ lags[:count]))  # the limit of sin(w tau) / w
        values = spectrum.real + tangent
        values = values[: max(int(np.searchsorted(w, fastest, side="right")), 1)]
        padded = np.concatenate([[-np.inf], values, [-np.inf]])
        tops = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:]))
        tops = tops[np.argsort(-values[tops])[: 2 * POLISHED]]
        found += [(float(values[i]), float(k), float(max(w[i], slowest))) for i in tops]
    taken: list[float] = []
    for _, k, w in sorted(found, reverse=True):
        if all(abs(w - other) > np.pi / series.span for other in taken):
            taken.append(w)
            yield k, w
        if len(taken) == POLISHED:
            return


def _autocorrelation(series: Series, fastest: float) -> tuple[npt.NDArray[np.float32], float]:
    """Sum over the series of a_i a_j by lag, on cells of equal length, and that length.

    Times that lie on a lattice are placed exactly. Others are spread over four half-step cells by a cubic spline, whose
    transform is divided out again: good to a percent at the highest frequency, which is enough to find a peak.
    """
    from scipy.fft import irfft, next_fast_len, rfft  # 0.1 s of import, for this search alone

    start = series.t[np.searchsorted(series.label, series.label, side="left")]
    cell = max(series.shortest, series.span / FINEST)
    place = (series.t - start) / cell
    exact = bool(np.abs(place - np.rint(place)).max() < LATTICE)
    if not exact:
        cell = max(0.5 * series.shortest, series.span / FINEST)
        place = (series.t - start) / cell
    count = int(series.span / cell) + 6
    size = next_fast_len(2 * count, real=True)
    power = np.zeros(size // 2 + 1)
    for label in np.unique(series.label):
        mine = series.label == label
        grid = _placed(series.a[mine], place[mine], count) if exact else _spread(series.a[mine], place[mine], count)
        power += np.abs(rfft(grid, size)) ** 2
    if not exact:
        cycles = np.arange(len(power)) / size  # in a cell
        band = 2.0 * np.pi * cycles <= 1.5 * fastest * cell
        power = np.where(band & (cycles < 0.375), power / np.sinc(cycles) ** 8, 0.0)
    return irfft(power, size)[:count].astype(np.float32), cell  # enough for a scan, at half the cost


def _placed(a: Array, place: Array, count: int) -> Array:
    """Weights on the nearest cells."""
    grid = np.zeros(count)
    np.add.at(grid, np.rint(place).astype(np.int64), a)
    return grid


def _spread(a: Array, place: Array, count: int) -> Array:
    """Weights spread over four cells each by the cubic B-spline."""
    grid = np.zeros(count)
    base = np.floor(place).astype(np.int64)
    u = place - base
    parts = ((1.0 - u) ** 3, 3.0 * u**3 - 6.0 * u**2 + 4.0, -3.0 * u**3 + 3.0 * u**2 + 3.0 * u + 1.0, u**3)
    for shift, part in enumerate(parts):
        np.add.at(grid, base + shift, a * part / 6.0)
    return grid


@plain_loop
def _lagged(a, t, series, k, w):  # type: ignore[no-untyped-def]
    """Real and imaginary part of sum_{j<i} a_i a_j exp((-k + i w)(t_i - t_j)) within each series."""
    real, imaginary = 0.0, 0.0
    c, s = 0.0, 0.0
    step, x, y = -1.0, 0.0, 0.0
    for i in range(len(a)):
        if i == 0 or series[i] != series[i - 1]:
            c, s = 0.0, 0.0
        else:
            if t[i] - t[i - 1] != step:  # a steady cadence needs one exponential
                step = t[i] - t[i - 1]
                damp = np.exp(-k * step)
                x, y = damp * np.cos(w * step), damp * np.sin(w * step)
            c, s = (c + a[i - 1]) * x - s * y, (c + a[i - 1]) * y + s * x
        real += a[i] * c
        imaginary += a[i] * s
    return real, imaginary
