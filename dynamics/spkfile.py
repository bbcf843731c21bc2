"""SPK files (NAIF DAF/SPK, type 2): reading their Chebyshev series as memory-mapped arrays.

jplephem reads the summaries; the coefficients are mapped, not copied, so that the 645 MB of the full asteroid file
cost nothing until an arc of it is used. (Writing a trajectory: spkwriter.py.)
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from jplephem.spk import SPK

from nebosvod.errors import DataError

Array = npt.NDArray[np.float64]
DAY_S = 86400.0


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
        with SPK.open(str(path)) as kernel:
            little = kernel.daf.locfmt in (b"LTL-IEEE", b"\0" * 8)
            segments = [
                (s.center, s.target, s.data_type, s.start_second, s.end_second, s.start_i, s.end_i, s.source)
                for s in kernel.segments
            ]
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (ValueError, IndexError, KeyError, UnicodeError, EOFError, struct.error) as error:
        raise DataError(f"{path}: damaged SPK file ({error})") from None
    words = np.memmap(path, dtype="<f8" if little else ">f8", mode="r", shape=(path.stat().st_size // 8,))
    series = {}
    for center, target, kind, start_s, end_s, first_word, last_word, _ in segments:
        if kind == 2 and start_s <= 0.0 <= end_s:
            series[center, target] = _map_series(path, words, center, target, (start_s, end_s), (first_word, last_word))
    source = segments[0][-1].decode("ascii", "replace").strip() if segments else ""
    return series, source


def _map_series(
    path: Path, words: Array, center: int, target: int, span_s: tuple[float, float], where: tuple[int, int]
) -> Series:
    """One series as a view of the mapped file, with its directory checked against the file's size."""
    first, last = where
    where_text = f"{path}: the series of body {target} relative to {center}"
    if last > len(words):
        raise DataError(f"{where_text} ends at word {last}, the file has {len(words)}: it is cut short")
    start, length, width, count = (float(word) for word in words[last - 4 : last])
    sound = length > 0.0 and width >= 5 and (width - 2) % 3 == 0 and count >= 1
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
