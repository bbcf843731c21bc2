"""Which records are the same observation twice: equal in one file, or equal within the last digit across files."""

from dataclasses import dataclass

import numpy as np

from nebosvod.observation.contracts import Array, Rows, Texts

SLACK = 1.001  # of the last digit, for round-off
SAME_PLACE_KM = 5.0  # of a spacecraft by two formats: 80 columns hold 1e-8 au, 1.5 km


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Written:
    """What of some records tells whether they are the same.

    Attributes
    ----------
    whose : (n,) number of the object and the observatory together; path : (n,) file of each record.
    t_s : (n,) time; psi : (n, 2) RA and Dec, rad; place_km : (n, 3) of the observer, nan where not stated; centre :
        (n,) what it counts from.
    step_s, step_rad : (n,) and (n, 2), RA cos Dec and Dec, what the last digit written is worth; nan where unknown.
    worth : (n,) the larger, the rather is a record kept.
    """

    whose: Rows
    path: Texts
    t_s: Array
    psi: Array
    place_km: Array
    centre: Texts
    step_s: Array
    step_rad: Array
    worth: Array


def equal(records: Written) -> Rows:
    """Rows that agree in everything with one before them."""
    key = np.column_stack([records.whose, records.t_s, records.psi, np.nan_to_num(records.place_km)])
    order = np.lexsort(key.T)  # stable: of equal ones the first in the file comes first
    return np.sort(order[1:][(key[order[1:]] == key[order[:-1]]).all(axis=1)])


def alike(records: Written) -> list[tuple[int, int]]:
    """Pairs (left out, kept) of rows of different files that are equal within the coarser last digit.

    Of each file a kept record stands for one record at most, the nearest: exposures that follow each other faster than
    a coarse time can tell stay as many as they are.
    """
    distance = {pair: far for pair in _near_in_time(records) if (far := _apart(records, *pair)) <= SLACK}
    group = {row: {row} for pair in distance for row in pair}
    for i, j in sorted(distance, key=lambda pair: distance[pair]):
        joint = group[i] | group[j]
        if len({records.path[row] for row in joint}) == len(joint):
            for row in joint:
                group[row] = joint
    pairs = []
    for rows in {min(rows): rows for rows in group.values() if len(rows) > 1}.values():
        kept = max(sorted(rows), key=lambda row: records.worth[row])
        pairs += [(row, kept) for row in rows if row != kept]
    return sorted(pairs)


def _near_in_time(records: Written) -> list[tuple[int, int]]:
    """Pairs of rows of one object and observatory and of two files whose times may be the same."""
    step = np.nan_to_num(records.step_s)
    order = np.lexsort((records.t_s, records.whose))
    whose, t_s, path, step = records.whose[order], records.t_s[order], records.path[order], step[order]
    pairs: list[tuple[int, int]] = []
    widest = SLACK * float(step.max(initial=0.0))
    for shift in range(1, order.size):
        gap = t_s[shift:] - t_s[:-shift]
        within = (whose[shift:] == whose[:-shift]) & (gap <= widest)
        if not within.any():
            break
        coarser = np.maximum(step[shift:], step[:-shift])
        found = np.flatnonzero(within & (gap <= SLACK * coarser) & (path[shift:] != path[:-shift]))
        pairs += [(int(order[k]), int(order[k + shift])) for k in found]
    return pairs


def _apart(records: Written, i: int, j: int) -> float:
    """How far two records are apart, in units of the coarser last digit of the worst of time and direction.

    Written with the same digits they must be equal, but for round-off.
    """
    step = np.fmax(np.append(records.step_rad[i], records.step_s[i]), np.append(records.step_rad[j], records.step_s[j]))
    turn = np.mod(records.psi[i, 0] - records.psi[j, 0] + np.pi, 2.0 * np.pi) - np.pi
    gap = np.abs(
        [turn * np.cos(records.psi[i, 1]), records.psi[i, 1] - records.psi[j, 1], records.t_s[i] - records.t_s[j]]
    )
    place = np.linalg.norm(records.place_km[i] - records.place_km[j])
    if not np.all(step > 0.0) or (records.centre[i] == records.centre[j] and place > SAME_PLACE_KM):
        return np.inf
    return float(np.max(gap / step))
