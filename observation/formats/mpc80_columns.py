"""Numbers in the fixed columns of many records at once: bytes (n, width) -> values, digits, and which are wrong."""

import numpy as np
import numpy.typing as npt

from nebosvod.observation.contracts import Array, Flags, Rows

Columns = npt.NDArray[np.uint8]
WIDTH = 80
BLANK, DOT, PLUS, MINUS = b" "[0], b"."[0], b"+"[0], b"-"[0]
ZERO = b"0"[0]


def lines_of(data: bytes) -> tuple[Columns, Rows, Columns]:
    """Lines as rows of 80 bytes (blank where shorter), their lengths without blanks at the end, and the bytes."""
    raw = np.frombuffer(data if data.endswith(b"\n") else data + b"\n", dtype=np.uint8)
    ends = np.flatnonzero(raw == 10)
    starts = np.concatenate([[0], ends[:-1] + 1])
    where = starts[:, None] + np.arange(WIDTH)
    inside = where < ends[:, None]
    rows = np.where(inside, raw[np.minimum(where, raw.size - 1)], BLANK).astype(np.uint8)
    filled = np.maximum.accumulate(np.where(raw > BLANK, np.arange(raw.size), -1))
    last = filled[np.maximum(ends - 1, 0)]  # the last byte before each line end that is no blank
    lengths = np.where((ends > 0) & (last >= starts), last - starts + 1, 0)
    return rows, lengths, raw


def integer(block: Columns) -> tuple[Rows, Flags]:
    """Digits in every column -> whole numbers (n,), and where it is so."""
    right: Flags = (block >= ZERO) & (block <= ZERO + 9)
    weights = 10 ** np.arange(block.shape[1] - 1, -1, -1, dtype=np.int64)
    value: Rows = np.where(right, block - ZERO, 0).astype(np.int64) @ weights
    return value, np.all(right, axis=1)


def decimals(block: Columns) -> tuple[Array, Rows, Flags]:
    """A dot and digits up to blanks -> the fraction (n,), how many digits, and where it is so.

    All blank is 0 with no digits, and so is a dot alone.
    """
    digit = (block[:, 1:] >= ZERO) & (block[:, 1:] <= ZERO + 9)
    dotted = block[:, 0] == DOT
    blank = block[:, 1:] == BLANK
    unbroken = (digit[:, 1:] <= digit[:, :-1]).all(axis=1)
    right = (digit | blank).all(axis=1) & unbroken & (dotted | ((block[:, 0] == BLANK) & blank.all(axis=1)))
    value, _ = integer(np.where(digit, block[:, 1:], ZERO).astype(np.uint8))
    return value / 10.0 ** (block.shape[1] - 1), np.where(right, digit.sum(axis=1), 0), right


def sexagesimal(block: Columns, limit: int) -> tuple[Array, Array, Flags]:
    """`HH MM SS.ddd`, `HH MM.mmmm` or `HH MM` -> units (n,), the last digit's worth in units, and where it is right.

    Parameters
    ----------
    block : (n, width) the columns without a sign.
    limit : the whole units that are allowed at most.
    """
    unit, whole = integer(block[:, 0:2])
    minute, minutes = integer(block[:, 3:5])
    second, seconds = integer(block[:, 6:8])
    part_of_minute, minute_digits, minute_dot = decimals(block[:, 5:])
    part_of_second, second_digits, second_dot = decimals(block[:, 8:])
    by_second = seconds & second_dot & (block[:, 5] == BLANK) & (second < 60)
    right = whole & minutes & (block[:, 2] == BLANK) & (unit <= limit) & (minute < 60) & (by_second | minute_dot)
    value = unit + minute / 60.0 + np.where(by_second, (second + part_of_second) / 3600.0, part_of_minute / 60.0)
    worth = np.where(by_second, 10.0**-second_digits / 3600.0, 10.0**-minute_digits / 60.0)
    return value, worth, right


def distinct(block: Columns) -> tuple[list[str], Rows]:
    """The different texts in these columns, blanks kept, and which of them each record has."""
    width = block.shape[1]
    flat = np.ascontiguousarray(block).view(f"S{width}").ravel()
    values, which = np.unique(flat, return_inverse=True)
    return [value.decode("ascii", "replace").ljust(width) for value in values.tolist()], which.astype(np.int64)
