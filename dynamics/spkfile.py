"""SPK files (NAIF DAF/SPK, type 2): reading their Chebyshev series as memory-mapped arrays.

The coefficients are mapped, not copied, so that the 645 MB of the full asteroid file
cost nothing until an arc of it is used. (Writing a trajectory: spkwriter.py.)
"""

import math
import stat
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.errors import DataError
from nebosvod.units import DAY_S

Array = npt.NDArray[np.float64]
RECORD_BYTES = 1024
MOST_SUMMARIES = 25  # of 40 bytes in a record, after 24 bytes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """The Chebyshev series of one body relative to its centre.

    Parameters
    ----------
    center, target : NAIF numbers.
    first_day : start of the first record, days after J2000 TDB (a multiple of 0.5, so exact).
    record_days : length of a record in days.
    records : shape (n, 2 + 3 k), mapped from the file: midpoint, radius, k coefficients of x, y and z in km.
    start_day, end_day : the span the file claims, days after J2000 TDB.
    """

    center: int
    target: int
    first_day: float
    record_days: float
    records: Array
    start_day: float
    end_day: float

    @property
    def order(self) -> int:
        """Number of coefficients of one component."""
        return (int(self.records.shape[1]) - 2) // 3

    def coefficients(self, first: int, last: int) -> Array:
        """Coefficients of records first..last-1, copied to shape (last - first, order, 3)."""
        block = self.records[first:last, 2:].reshape(-1, 3, self.order)
        if not np.isfinite(block).all():
            raise DataError(f"the ephemeris of body {self.target} has a number that is not finite; copy the file again")
        return np.ascontiguousarray(block.transpose(0, 2, 1))


def read_series(path: Path) -> tuple[dict[tuple[int, int], Series], str]:
    """Read all type 2 series of an SPK file that cover J2000.

    Returns
    -------
    The series by (center, target), and the source name of the first segment (`DE-0440LE-0440`).

    Raises
    ------
    DataError
        If the file is missing, is not an SPK file, or is shorter than its own summary says.
    """
    try:
        with path.open("rb") as file:
            head = file.read(8)
        if head != b"DAF/SPK ":
            raise DataError(f"{path}: not an SPK file (it begins with {head!r}, not b'DAF/SPK ')")
        summaries = read_summaries(path)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})") from None
    words = np.memmap(path, dtype=f"{summaries.order}f8", mode="r", shape=(path.stat().st_size // 8,))
    series = {}
    for start_s, end_s, target, center, _, kind, first_word, last_word in summaries.values:
        if kind == 2 and start_s <= 0.0 <= end_s:
            series[center, target] = _map_series(path, words, center, target, (start_s, end_s), (first_word, last_word))
    return series, summaries.names[0] if summaries.names else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Summaries:
    """What an SPK file says of its segments: names, and start, end (s), target, centre, frame, type, first, last word.

    Parameters
    ----------
    order : "<" or ">", of the bytes.
    """

    order: str
    names: tuple[str, ...]
    values: tuple[tuple[float, float, int, int, int, int, int, int], ...]


def read_summaries(path: Path) -> Summaries:
    """Walk through the summaries of an SPK file, whose every number may be damaged.

    Raises
    ------
    OSError, DataError
        If the system refuses; if the file is damaged or cut short: records that lead in a circle or outside of it,
        times that are none, segments that are not in it.

    Notes
    -----
    jplephem trusts the file: a summary record that names itself as the next one holds it forever, and a damaged count
    of integers asks for gigabytes. It may open a file that has passed here.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise DataError(f"{path}: is no regular file")
    records = status.st_size // RECORD_BYTES
    with path.open("rb") as file:
        head = file.read(RECORD_BYTES)
        order = _byte_order(path, head)
        doubles, integers, place = *struct.unpack(f"{order}ii", head[8:16]), *struct.unpack(f"{order}i", head[76:80])
        if (doubles, integers) != (2, 6):
            raise DataError(f"{path}: damaged SPK file (ND, NI = {doubles}, {integers}, not 2, 6)")
        names: list[str] = []
        found: list[tuple[Any, ...]] = []
        seen: set[int] = set()
        while place:
            if not 1 < place < records + 1 or place in seen:
                raise DataError(f"{path}: damaged SPK file: summary record {place} of {records}; copy it again")
            seen.add(place)
            file.seek((place - 1) * RECORD_BYTES)
            record, labels = file.read(RECORD_BYTES), file.read(RECORD_BYTES)
            following, _, count = struct.unpack(f"{order}3d", record[:24])
            if not (0.0 <= count <= MOST_SUMMARIES and count.is_integer() and 0.0 <= following <= records):
                raise DataError(f"{path}: damaged SPK file: a summary record of {count:g} summaries; copy it again")
            found += [struct.unpack_from(f"{order}2d6i", record, 24 + 40 * i) for i in range(int(count))]
            names += [labels[40 * i : 40 * i + 40].decode("ascii", "replace").strip() for i in range(int(count))]
            place = int(following)
    for start, end, target, *_, first, last in found:
        if not (math.isfinite(start) and math.isfinite(end) and start <= end and 1 <= first <= last):
            raise DataError(f"{path}: damaged SPK file: the segment of body {target} ({start:g} to {end:g} s)")
        if last > (size := status.st_size // 8):
            raise DataError(f"{path}: the segment of body {target} ends at word {last}, the file has {size}: cut short")
    return Summaries(order=order, names=tuple(names), values=tuple(found))


def _byte_order(path: Path, head: bytes) -> str:
    """Of a file record: as it says, or as makes sense in files of before 1997."""
    if len(head) == RECORD_BYTES and head[:8].rstrip().upper() in (b"DAF/SPK", b"NAIF/DAF"):
        said = {b"LTL-IEEE": "<", b"BIG-IEEE": ">"}.get(head[88:96])
        if head[:8].rstrip().upper() == b"DAF/SPK" and said:
            return said
        for order in "<>":
            if head[:8].rstrip().upper() == b"NAIF/DAF" and struct.unpack(f"{order}i", head[8:12]) == (2,):
                return order
    raise DataError(f"{path}: not an SPK file, or a damaged one (it begins with {head[:8]!r})")


def _map_series(
    path: Path, words: Array, center: int, target: int, span_s: tuple[float, float], where: tuple[int, int]
) -> Series:
    """One series as a view of the mapped file, with its directory checked against the file's size."""
    first, last = where
    where_text = f"{path}: the series of body {target} relative to {center}"
    if last > len(words):
        raise DataError(f"{where_text} ends at word {last}, the file has {len(words)}: it is cut short")
    start, length, width, count = (float(word) for word in words[last - 4 : last])
    sound = math.isfinite(start) and 0.0 < length < math.inf and width >= 5 and (width - 2) % 3 == 0 and count >= 1
    if not sound or width * count + 4 != last - first + 1:
        raise DataError(f"{where_text} has a damaged directory ({start}, {length}, {width}, {count})")
    records = words[first - 1 : last - 4].reshape(int(count), int(width))
    return Series(
        center=int(center),
        target=int(target),
        first_day=start / DAY_S,
        record_days=length / DAY_S,
        records=records,
        start_day=span_s[0] / DAY_S,
        end_day=span_s[1] / DAY_S,
    )
