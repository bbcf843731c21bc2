"""Real optical astrometry as a table: one row for each observation, whatever format it was read from.

formats (`ades`, `mpc80`) -> Astrometry -> where the observers were, what each observation weighs -> the fit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType

import numpy as np

from nebosvod.borders.quantities import bordered
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Flags, Rows, Texts
from nebosvod.observation.formats import repeats
from nebosvod.observation.formats.designations import kind, stem_of
from nebosvod.observation.formats.object_names import merged, readings, united
from nebosvod.timescale import Epoch

LISTED = 20  # objects named in a message


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Astrometry:
    """Observed directions of one or several objects, in the order of the files they came from.

    Attributes
    ----------
    epoch : the epoch from which times count, 0h TDB of the day of the earliest observation.
    path, line : (n,) file and number of the line on which each record begins.
    designation : (n,) permanent number, else provisional designation, unpacked, else the observer's own name.
    station : (n,) observatory code.
    t_s : (n,) TDB seconds after `epoch`.
    utc : (n,) time as ISO 8601 text, UTC.
    psi : (n, 2) observed RA in [0, 2 pi) and Dec, ICRF, rad.
    sigma_rad : (n, 2) stated standard deviation of RA cos Dec and Dec; nan where the record states none.
    correlation : (n,) stated correlation of the two, 0 where none is stated.
    timing_sigma_s : (n,) stated standard deviation of the time; nan where none is stated.
    catalogue : (n,) star catalogue by its ADES name, "" where unknown.
    mode : (n,) kind of detector by its ADES name (CCD, PHO, OCC, ...), "" where unknown.
    centre : (n,) what `position_km` counts from: "earth", "sun", "ssb"; "" where the station alone tells the place.
    position_km : (n, 3) the observer's position from `centre` at the time of the record: ICRF axes, or for a roving
        observer on the ground (`roving`) ITRF; nan where the station tells it.
    position_covariance_km2 : (n, 3, 3) its stated covariance on the same axes; nan where none is stated.
    roving : (n,) whether the observer stood at `position_km` on the turning Earth.
    precision_rad : (n, 2) what one step of the last digit written is worth in RA cos Dec and Dec; nan where unknown.
    written_rad, written_s : (n, 2) and (n,) what the last digit in the file is worth, which may be finer than
        that of the measurement; nan where unknown.
    bias_rad : (n, 2) stated bias of the star catalogue in RA cos Dec and Dec, still in `psi`; nan where none is stated.
    weighed : (n,) whether `sigma_rad` is a final weight, not to be changed by any rule.
    magnitude, band : (n,) stated magnitude, nan where none, and its band.
    discovery : (n,) whether the record carries the discovery mark.
    left_out : how many records of the files were not read, by reason ("radar", "deleted", ...).
    notices : what a user should know about the files, one sentence each.
    other_names : what else the files call these objects, each with the designations it stands for.
    """

    epoch: Epoch
    path: Texts
    line: Rows
    designation: Texts
    station: Texts
    t_s: Array
    utc: Texts
    psi: Array
    sigma_rad: Array
    correlation: Array
    timing_sigma_s: Array
    catalogue: Texts
    mode: Texts
    centre: Texts
    position_km: Array
    position_covariance_km2: Array
    roving: Flags
    magnitude: Array
    band: Texts
    discovery: Flags
    precision_rad: Array = field(default_factory=lambda: np.empty((0, 2)))
    written_rad: Array = field(default_factory=lambda: np.empty((0, 2)))
    written_s: Array = field(default_factory=lambda: np.empty(0))
    bias_rad: Array = field(default_factory=lambda: np.empty((0, 2)))
    weighed: Flags = field(default_factory=lambda: np.empty(0, dtype=np.bool_))
    left_out: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    notices: tuple[str, ...] = ()
    other_names: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        for name, shape in (("precision_rad", (2,)), ("written_rad", (2,)), ("written_s", ()), ("bias_rad", (2,))):
            if len(getattr(self, name)) != len(self.t_s):
                object.__setattr__(self, name, np.full((len(self.t_s), *shape), np.nan))
        if len(self.weighed) != len(self.t_s):
            object.__setattr__(self, "weighed", np.zeros(len(self.t_s), dtype=np.bool_))

    def __len__(self) -> int:
        """Number of observations."""
        return int(self.t_s.size)

    @property
    def objects(self) -> tuple[str, ...]:
        """The designations, each once, in the order of their first record."""
        return tuple(dict.fromkeys(self.designation.tolist()))

    @property
    def stations(self) -> tuple[str, ...]:
        """The observatory codes, each once, in the order of their first record."""
        return tuple(dict.fromkeys(self.station.tolist()))

    def select(self, rows: Rows | Flags) -> "Astrometry":
        """The observations of these rows, in that order; counts and notices stay."""
        return replace(self, **{name: getattr(self, name)[rows] for name in ROW_FIELDS})

    def of(self, *designations: str) -> "Astrometry":
        """The observations of one object, by any of its designations in these files, packed or not.

        Several designations are those of one object, which the files do not know to be one: all of it bears the first.

        Raises
        ------
        InputError
            If there are none by one of the names, or a name has been given to several objects.
        """
        found = list(dict.fromkeys(self._called(text) for text in designations))
        mine = self.select(np.isin(self.designation, found))
        if len(found) == 1:
            return mine
        notice = f"observations of {' and '.join(found)} were joined as those of one object, {found[0]}"
        called = {other: tuple(found[:1]) for other in found[1:]} | {
            other: tuple(dict.fromkeys(found[0] if name in found else name for name in names))
            for other, names in self.other_names.items()
        }
        joint = replace(
            mine,
            designation=np.full(len(mine), found[0]),
            other_names=MappingProxyType(called),
            notices=(*mine.notices, notice),
        )
        return without_repeats(joint)

    def _called(self, designation: str) -> str:
        """The name by which these records call an object of this designation."""
        there = dict.fromkeys(self.objects)
        stems = {stem_of(name): name for name in there if kind(name) == "provisional"}
        for text in readings(designation):
            names = (text,) if text in there else tuple(n for n in self.other_names.get(text, ()) if n in there)
            if not names and kind(text) == "provisional" and stem_of(text) in stems:
                names = (stems[stem_of(text)],)
            if len(names) > 1:
                raise InputError(f"{designation} is the name of several objects here ({', '.join(names)}); name one")
            if names:
                return names[0]
        listed = ", ".join(self._named(name) for name in list(there)[:LISTED]) + (
            ", ..." if len(there) > LISTED else ""
        )
        raise InputError(f"no observation of {designation} here (there are: {listed})")

    def _named(self, name: str) -> str:
        """A designation with up to two other names of the object."""
        others = [other for other, names in self.other_names.items() if name in names][:2]
        return f"{name} = {' = '.join(others)}" if others else name

    @bordered(since="epoch", until="epoch")
    def between(self, since: Epoch | None, until: Epoch | None) -> "Astrometry":
        """The observations from one time on (included) to another (excluded), the others counted as left out by date.

        Raises
        ------
        InputError
            If none is left; says from when to when there are some.
        """
        early = self.t_s < (-np.inf if since is None else since - self.epoch)
        late = self.t_s >= (np.inf if until is None else until - self.epoch)
        keep = ~(early | late)
        if not keep.any():
            first, last = (str(self.utc[row]) for row in (np.argmin(self.t_s), np.argmax(self.t_s)))
            raise InputError(
                f"no observation of {', '.join(self.objects[:3])} lies between these dates; "
                f"there are {len(self)}, from {first} to {last}"
            )
        if keep.all():
            return self
        sides = ((early, "before", since), (late & ~early, "at or after", until))
        told_apart = [
            f"{int(side.sum())} {word} {when.iso('utc', 0)}" for side, word, when in sides if when and side.any()
        ]
        notice = told("date", int((~keep).sum()), ", ".join(told_apart))
        counts = {**self.left_out, "date": int((~keep).sum())}
        return replace(self.select(keep), left_out=MappingProxyType(counts), notices=(*self.notices, notice))

    def place(self, row: int) -> str:
        """File and line of a record."""
        return f"{self.path[row]}:{self.line[row]}"

    def by_time(self) -> "Astrometry":
        """The same observations by time, those of one time in their order."""
        return self.select(np.argsort(self.t_s, kind="stable"))


WHOLE_FIELDS = ("epoch", "left_out", "notices", "other_names")
ROW_FIELDS = tuple(f.name for f in fields(Astrometry) if f.name not in WHOLE_FIELDS)


def joined(parts: Sequence[Astrometry]) -> Astrometry:
    """The observations of several tables as one, one after the other, times counted from the earliest epoch.

    An observation that stands in several of them is kept once. A provisional designation whose number is known from
    any of them becomes the number.

    Raises
    ------
    InputError
        If there is no table.
    """
    if not parts:
        raise InputError("no observations to join")
    epoch = min((part.epoch for part in parts), key=lambda one: one - parts[0].epoch)
    rows = {name: np.concatenate([getattr(part, name) for part in parts]) for name in ROW_FIELDS}
    rows["t_s"] = np.concatenate([part.t_s + (part.epoch - epoch) for part in parts])
    counts: dict[str, int] = {}
    for part in parts:
        for reason, number in part.left_out.items():
            counts[reason] = counts.get(reason, 0) + number
    notices = tuple(dict.fromkeys(notice for part in parts for notice in part.notices))
    called = merged(part.other_names for part in parts)
    names, which = np.unique(rows["designation"], return_inverse=True)
    rows["designation"] = np.array(united(names.tolist(), called))[which]
    return without_repeats(
        Astrometry(
            epoch=epoch,
            left_out=MappingProxyType(counts),
            notices=notices,
            other_names=MappingProxyType(called),
            **rows,
        )
    )


# what is said of the records that were not used, by reason
LEFT_OUT = {
    "radar": "{} radar {} left out: only directions are fitted",
    "deleted": "{} {} left out: marked deleted, replaced or deprecated",
    "offset": "{} {} left out: offsets from a planet",
    "date": "{} {} left out by date: {}",
    "duplicate": "{} {} left out: the same as another one (second at {})",
    "again": "{} {} left out: the same observation in another file, equal within the coarser last digit ({})",
}


def told(reason: str, number: int, where: str = "") -> str:
    """The sentence about records that were left out."""
    return LEFT_OUT[reason].format(number, "record was" if number == 1 else "records were", where)


def without_repeats(table: Astrometry) -> Astrometry:
    """The observations with repeated ones kept once, their number in `left_out` and a notice with their lines.

    Repeated is what agrees in object, observatory, time, direction and observer's position, or what two files, or two
    formats, say of one observation: equal within the coarser last digit. Of those the record that states its sigma is
    kept, else the one with more digits.
    """
    # pairs of two files first, the nearest before others: an exact twin is never left aside for a copy that was changed
    written = _as_written(table)
    across, exact = repeats.alike(written), set(repeats.equal(written).tolist())
    again = [(out, kept) for out, kept in across if out not in exact and kept not in exact]
    twins = [out for out, kept in across if out in exact or kept in exact]
    gone = {out for out, _ in across}
    rest = np.array([row for row in range(len(table)) if row not in gone], dtype=np.int64)
    twins = sorted(twins + rest[repeats.equal(_as_written(table.select(rest)))].tolist()) if exact else []
    notices = []
    if twins:
        lines = ", ".join(table.place(row) for row in twins[:5])
        notices.append(told("duplicate", len(twins), lines + (" and elsewhere" if len(twins) > 5 else "")))
    if again:
        lines = ", ".join(f"{table.place(out)} as {table.place(kept)}" for out, kept in again[:5])
        notices.append(told("again", len(again), lines + (" and elsewhere" if len(again) > 5 else "")))
    return _without(table, sorted({*twins, *(out for out, _ in again)}), notices) if notices else table


def _as_written(table: Astrometry) -> repeats.Written:
    """What tells whether records are the same; those that state a sigma are worth more, then those with more digits."""
    whose = [np.unique(names, return_inverse=True)[1] for names in (table.designation, table.station)]
    coarse = np.nan_to_num(np.column_stack([table.written_s, table.written_rad]), nan=1.0)
    return repeats.Written(
        whose=whose[0] * (whose[1].max(initial=0) + 1) + whose[1],
        path=table.path,
        t_s=table.t_s,
        psi=table.psi,
        place_km=table.position_km,
        centre=table.centre,
        step_s=table.written_s,
        step_rad=table.written_rad,
        worth=1e3 * np.isfinite(table.sigma_rad[:, 0]) - np.log10(np.maximum(coarse, 1e-15)).sum(axis=1),
    )


def _without(table: Astrometry, rows: list[int], notices: list[str]) -> Astrometry:
    """The observations without some, counted as repeated, with notices."""
    keep = np.ones(len(table), dtype=np.bool_)
    keep[rows] = False
    counts = {**table.left_out, "duplicate": table.left_out.get("duplicate", 0) + len(rows)}
    return replace(table.select(keep), left_out=MappingProxyType(counts), notices=(*table.notices, *notices))
