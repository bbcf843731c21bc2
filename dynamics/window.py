"""The ephemeris over one arc: the records that touch it, copied as the kernels read them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import DAY_S, J2000_JD, MOST_ORDERS
from nebosvod.dynamics.spkfile import Series
from nebosvod.errors import DataError
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
LARGE_BYTES = 20_000_000  # a window beyond that, of more than 170 years, is the only one that is kept
Records = tuple[tuple[int, int], ...]  # of each body, the first and the one behind the last


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Window:
    """Chebyshev coefficients of all bodies over one arc, as the compiled kernels read them.

    Parameters
    ----------
    coefficients : flat, km; record by record, within a record order by order, within an order x, y, z.
    layout : shape (bodies, 3) int64: offset of the first coefficient, orders of a record (padded with zeros to a
        multiple of eight, which is how the kernels add them), number of records.
    timing : shape (bodies, 2): start of the first record in TDB seconds after the epoch, length of a record in s.
    start_s, end_s : the arc these records cover, seconds after the epoch.
    """

    coefficients: Array
    layout: npt.NDArray[np.int64]
    timing: Array
    start_s: float
    end_s: float


def cut(
    series: tuple[Series, ...], epoch: Epoch, start_s: float, end_s: float, centuries: list[tuple[Records, Array]]
) -> Window:
    """Coefficients of the records that touch [start_s, end_s], padded by 32 days so that neighbours hit the cache.

    `centuries` holds the last large cut, whose numbers serve other epochs too: centuries are 80 MB.
    """
    records = _touched(series, epoch, start_s - 32.0 * DAY_S, end_s + 32.0 * DAY_S)
    large = sum(_numbers(body, *rows) for body, rows in zip(series, records)) * 8 > LARGE_BYTES
    fitting = [known for known in centuries if large and _within(records, known[0])]
    records, coefficients = fitting[0] if fitting else (records, _copied(series, records))
    if large:
        centuries[:] = [(records, coefficients)]
    layout, timing, offset = [], [], 0
    for body, (first, last) in zip(series, records):
        layout.append((offset, body.order + -body.order % 8, last - first))
        exact_day = body.first_day + (J2000_JD - epoch.day) + first * body.record_days
        timing.append((exact_day * DAY_S - epoch.fraction * DAY_S, body.record_days * DAY_S))
        offset += _numbers(body, first, last)
    span = np.array(timing)
    return Window(
        coefficients=coefficients,
        layout=np.array(layout, dtype=np.int64),
        timing=span,
        start_s=float(np.max(span[:, 0])),
        end_s=float(np.min(span[:, 0] + span[:, 1] * np.array([row[2] for row in layout]))),
    )


def _touched(series: tuple[Series, ...], epoch: Epoch, start_s: float, end_s: float) -> Records:
    """First record of each body that touches an arc, and the one behind the last."""
    records = []
    for body in series:
        if body.order > MOST_ORDERS:
            raise DataError(
                f"an ephemeris with {body.order} coefficients a record (allowed: {MOST_ORDERS}) is not DE440"
            )
        first_day = body.first_day + (J2000_JD - epoch.day) - epoch.fraction
        first = int((start_s / DAY_S - first_day) // body.record_days)
        last = int((end_s / DAY_S - first_day) // body.record_days) + 1
        records.append((max(first, 0), min(last, len(body.records))))
    return tuple(records)


def _within(records: Records, others: Records) -> bool:
    """Whether the same bodies' records are all among others."""
    return len(records) == len(others) and all(
        a >= first and b <= last for (a, b), (first, last) in zip(records, others)
    )


def _numbers(body: Series, first: int, last: int) -> int:
    """How many numbers some records take in a window."""
    return (last - first) * (body.order + -body.order % 8) * 3


def _copied(series: tuple[Series, ...], records: Records) -> Array:
    """The coefficients of some records, each into its place."""
    coefficients, at = np.zeros(sum(_numbers(body, *rows) for body, rows in zip(series, records))), 0
    for body, (first, last) in zip(series, records):
        size = _numbers(body, first, last)
        rows = coefficients[at : at + size].reshape(last - first, body.order + -body.order % 8, 3)
        rows[:, : body.order] = body.coefficients(first, last)
        at += size
    return coefficients
