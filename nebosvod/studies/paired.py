"""Two settings that look for the same objects: who sees what the other does not, and whether that is chance.

Shares of the same objects are not independent, so that their two intervals do not tell whether they differ; what tells
is the objects that only one of them sees.

References
----------
McNemar 1947, Psychometrika 12, 153: the test, here by the binomial distribution itself.
Newcombe 1998, Statistics in Medicine 17, 2635: the interval of the difference, his method 10.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.studies.population import IMPACTOR, KIND, SEEN
from nebosvod.studies.question import Study

Flags = npt.NDArray[np.bool_]


def paired(study: Study, columns: Mapping[str, npt.NDArray[Any]]) -> list[dict[str, Any]]:
    """What study.json holds of settings that see the same objects: each beside the first one."""
    others = [axis.name for axis in study.axes if axis.name != "object"]
    if study.objects is None or not others:
        return []
    once = columns["draw"] == 0 if study.drawn > 1 else np.ones(len(columns["status"]), dtype=np.bool_)
    if KIND in columns:
        once &= columns[KIND] == IMPACTOR
    seen, settings = np.isin(columns["status"], SEEN), list(zip(*(columns[name].tolist() for name in others)))
    found: dict[tuple[Any, ...], dict[str, bool]] = {}
    for k in np.flatnonzero(once):
        found.setdefault(settings[k], {})[str(columns["object"][k])] = bool(seen[k])
    rows = []
    (first, there), *rest = found.items() or [((), {})]
    for key, here in rest:
        both = [name for name in there if name in here]
        if len(both) < 2:  # a sample has other settings at each object: nothing is paired
            continue
        flags = (np.array([one[name] for name in both], dtype=np.bool_) for one in (there, here))
        rows.append({"where": dict(zip(others, key)), "than": dict(zip(others, first)), **difference(*flags)})
    return rows


def difference(first: Flags, other: Flags) -> dict[str, Any]:
    """How two settings differ in what they see of the same objects.

    Parameters
    ----------
    first, other : (objects,), whether each sees it.

    Returns the number of objects, those that only one sees, the share that the other sees less that of the first with
    its 95 % interval, and the probability `p` of a division as uneven as this if neither saw more.
    """
    from scipy import stats

    n, only_first, only_here = len(first), int((first & ~other).sum()), int((other & ~first).sum())
    apart, less = only_first + only_here, min(only_first, only_here)
    p = min(1.0, 2.0 * float(stats.binom.cdf(less, apart, 0.5))) if apart else 1.0
    return {
        "n": n,
        "only_first": only_first,
        "only_here": only_here,
        "difference": (only_here - only_first) / n,
        "interval_95": _interval(int((first & other).sum()), only_here, only_first, n),
        "p": p,
    }


def _interval(both: int, only_here: int, only_first: int, n: int) -> list[float]:
    """95 % interval of the difference of two shares of the same n objects."""
    neither = n - both - only_here - only_first
    here, first = (both + only_here) / n, (both + only_first) / n
    (low, high), (low_first, high_first) = (_wilson(share, n) for share in (here, first))
    margins = (both + only_here) * (only_first + neither) * (both + only_first) * (only_here + neither)
    product = float(both * neither - only_here * only_first)
    if product > 0.0:  # with a correction for continuity, as for a product above n/2
        product = max(product - 0.5 * n, 0.0)
    phi = product / margins**0.5 if margins else 0.0
    d = here - first
    below = (here - low) ** 2 - 2.0 * phi * (here - low) * (high_first - first) + (high_first - first) ** 2
    above = (first - low_first) ** 2 - 2.0 * phi * (first - low_first) * (high - here) + (high - here) ** 2
    return [d - max(below, 0.0) ** 0.5, d + max(above, 0.0) ** 0.5]


def _wilson(share: float, n: int, z: float = 1.959963984540054) -> tuple[float, float]:
    """Wilson's interval of a share."""
    middle, half = share + z * z / (2.0 * n), z * (share * (1.0 - share) / n + z * z / (4.0 * n * n)) ** 0.5
    return (middle - half) / (1.0 + z * z / n), (middle + half) / (1.0 + z * z / n)
