"""The border of Python: quantities and moments of other libraries, converted where a public function is entered.

Inside nebosvod a number has the unit its name ends with (`t_s`, `position_km`) and a moment is an `Epoch`. A caller may
hand over astropy's Quantity, Time and TimeDelta, or a datetime with a zone: `bordered` converts them, exactly, by the
names of the parameters, and refuses a wrong dimension by name. A bare number keeps its documented unit. astropy is
never imported for it: where it is not loaded, there is no Quantity.
"""

import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import wraps
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.timescale import SECONDS_PER_DAY, Epoch, to_tdb

F = TypeVar("F", bound=Callable[..., Any])
C = TypeVar("C", bound=type)
STATE = "km_km_s"  # position and velocity
# endings of names, longest first, and their units in astropy's words
UNITS: Mapping[str, str] = {
    "km_km_s": STATE, "km3_s2": "km3 / s2", "rad_s": "rad / s", "km_s": "km / s", "au_d2": "au / d2", "km2": "km2",
    "rad2": "rad2", "km": "km", "rad": "rad", "kg": "kg", "au": "au", "m": "m", "s": "s", "h": "h",
}  # fmt: skip
# endings of keys and columns of results, and their units
ENDINGS: Mapping[str, str] = {
    **{key: unit for key, unit in UNITS.items() if key not in ("h", "km_km_s")},
    "m_s": "m / s", "arcsec": "arcsec", "arcsec_h": "arcsec / h", "deg": "deg", "kg_m3": "kg / m3", "mag": "mag",
    "km2_s2": "km2 / s2", "deg_d": "deg / d", "1": "",
}  # fmt: skip
HARMLESS = {int, float, bool, str, np.ndarray, np.float64, type(None), Epoch}  # types met that need no look


def bordered(**units: str) -> Callable[[F], F]:
    """Let a function take quantities and moments of other libraries.

    Parameters
    ----------
    units : the unit of each parameter whose name does not end with one, "epoch" for a moment, "spans" for pairs of
        moments, `STATE` for position and velocity; parameters called `epoch` or ending with a unit need none. Others
        take bare numbers only: a quantity is refused.

    Notes
    -----
    A time `t_s` may also be an astropy Time (or a datetime): it is counted from the parameter `epoch` of the same call,
    or from the attribute `epoch` of the object or trajectory the function belongs to.
    """

    def decorate(function: F) -> F:
        names, wanted = _parameters(function, units)
        label = function.__qualname__.removesuffix(".__init__")
        epochs = tuple(k for k, name in enumerate(names) if wanted.get(name) == "epoch")
        plain = _plain if "spans" not in wanted.values() else _never

        @wraps(function)
        def entered(*args: Any, **kwargs: Any) -> Any:
            for value in (*args, *kwargs.values()):
                if type(value) not in HARMLESS and not plain(value) and not _harmless(type(value)):
                    break
            else:
                for k in epochs:
                    value = args[k] if k < len(args) else kwargs.get(names[k])
                    if type(value) is not Epoch and value is not None:  # an epoch is not a plain number
                        break
                else:
                    return function(*args, **kwargs)
            border = Border(label, wanted, dict(zip(names, args)) | kwargs)
            args = tuple(border.converted(names[k] if k < len(names) else "", value) for k, value in enumerate(args))
            return function(*args, **{name: border.converted(name, value) for name, value in kwargs.items()})

        entered.units = wanted  # type: ignore[attr-defined]
        return entered  # type: ignore[return-value]

    return decorate


def bordered_fields(**units: str) -> Callable[[C], C]:
    """The same for the fields of a dataclass, which are the parameters of its constructor."""

    def decorate(cls: C) -> C:
        cls.__init__ = bordered(**units)(cls.__init__)  # type: ignore[misc]
        return cls

    return decorate


def unit_of(name: str) -> str | None:
    """The unit a name ends with, None if with none."""
    return next((unit for ending, unit in UNITS.items() if name == ending or name.endswith("_" + ending)), None)


def moment(value: Any, what: str = "epoch") -> Epoch:
    """An epoch from an Epoch, an astropy Time of one moment, a datetime with a zone, or text such as "2029-04-13 UTC".

    Raises
    ------
    InputError
        If it is none of these; names `what`.
    """
    if isinstance(value, Epoch):
        return value
    if isinstance(value, str):
        return Epoch.parse(value)
    if isinstance(value, datetime):
        return _of_datetime(value, what)
    if _is_time(value):
        if value.shape != ():
            raise InputError(f"{what}: needs one moment, got a Time of shape {value.shape}")
        days, fractions = _tdb(value, what)
        return Epoch.from_jd(float(days), float(fractions))
    raise InputError(
        f"{what}: needs a moment, got {_described(value)} (allowed: Epoch, astropy Time, datetime with a time zone, "
        'text like "2029-04-13T21:46:00 UTC")'
    )


def _parameters(function: Callable[..., Any], units: Mapping[str, str]) -> tuple[tuple[str, ...], dict[str, str]]:
    """Names of the parameters in order, and the unit of those that have one."""
    signature = inspect.signature(function)
    unknown = set(units) - set(signature.parameters)
    if unknown:
        raise TypeError(f"{function.__qualname__} has no parameter {sorted(unknown)}")
    wanted = {name: "epoch" for name in signature.parameters if name == "epoch" or name.endswith("_epoch")}
    wanted |= {name: unit for name in signature.parameters if name not in wanted and (unit := unit_of(name))}
    return tuple(signature.parameters), wanted | dict(units)


def _units() -> ModuleType | None:
    return sys.modules.get("astropy.units")


def is_quantity(value: Any) -> bool:
    """Whether it is an astropy Quantity."""
    units = _units()
    return units is not None and isinstance(value, units.Quantity)


def is_moment(value: Any) -> bool:
    """Whether it is a moment of another library: astropy's Time, or a datetime."""
    return _is_time(value) or isinstance(value, datetime)


def duration_s(value: Any) -> float | None:
    """Seconds of a timedelta or of an astropy TimeDelta; None for what is neither."""
    if isinstance(value, timedelta):
        return value.total_seconds()
    return float(value.jd1 * SECONDS_PER_DAY + value.jd2 * SECONDS_PER_DAY) if _is_duration(value) else None


def _is_time(value: Any) -> bool:
    module = sys.modules.get("astropy.time")
    return module is not None and isinstance(value, module.Time)


def _is_duration(value: Any) -> bool:
    module = sys.modules.get("astropy.time")
    return isinstance(value, timedelta) or (module is not None and isinstance(value, module.TimeDelta))


def _harmless(kind: type) -> bool:
    """Whether values of a type are none of another library's, and hold none; remembered by type."""
    if kind in HARMLESS:
        return True
    if issubclass(kind, list | tuple | datetime | timedelta | np.datetime64) or any(
        base.__module__.partition(".")[0] == "astropy" for base in kind.__mro__
    ):
        return False
    HARMLESS.add(kind)
    return True


def _plain(value: Any) -> bool:
    """Whether it is a list or tuple of values that need no look, as times of a span are."""
    return type(value) in (list, tuple) and HARMLESS.issuperset(map(type, value))


def _never(value: Any) -> bool:
    return False


def _foreign(value: Any) -> bool:
    """Whether a value, or an element of a sequence, is of another library's kind."""
    if is_quantity(value) or _is_time(value) or _is_duration(value) or isinstance(value, datetime | np.datetime64):
        return True
    return isinstance(value, list | tuple) and any(not _harmless(type(one)) and _foreign(one) for one in value)


@dataclass(frozen=True, slots=True)
class Border:
    """One call: the function's name, the units of its parameters by name, the arguments by name."""

    label: str
    wanted: Mapping[str, str]
    given: Mapping[str, Any]

    def converted(self, name: str, value: Any) -> Any:
        """One argument as the function takes it."""
        what, unit = f"{self.label}: {name}", self.wanted.get(name)
        if unit == "epoch" and value is not None:
            return moment(value, what)
        if _harmless(type(value)):
            return value
        if unit == "spans":
            return tuple((moment(start, what), moment(end, what)) for start, end in value)
        if not _foreign(value):
            return value
        if unit is None:
            raise InputError(
                f"{what}: takes no units, got {_described(value)}; see its documentation for the unit and hand over "
                "bare numbers, of a Quantity by .to_value(unit)"
            )
        if unit == STATE:
            return _state(value, what)
        if unit == "s" and (found := self.seconds(value, what)) is not None:
            return found
        return _numbers(value, unit, what)

    def seconds(self, value: Any, what: str) -> Any:
        """Durations and moments as TDB seconds; None for what is neither."""
        if isinstance(value, timedelta):
            return value.total_seconds()
        if _is_duration(value):
            return value.jd1 * SECONDS_PER_DAY + value.jd2 * SECONDS_PER_DAY
        if _is_time(value):
            days, fractions = _tdb(value, what)
            start = self.origin(what)
            return ((days - start.day) + (fractions - start.fraction)) * SECONDS_PER_DAY
        if isinstance(value, datetime):
            return _of_datetime(value, what) - self.origin(what)
        if not isinstance(value, list | tuple) or all(is_quantity(one) for one in value):
            return None
        if not all(_foreign(one) for one in value):
            raise InputError(f"{what}: needs bare numbers (in s) or times, not a mixture of both")
        found = [self.seconds(one, what) for one in value]
        return np.array([_numbers(one, "s", what) if got is None else got for one, got in zip(value, found)])

    def origin(self, what: str) -> Epoch:
        """The epoch from which the times of the call count: its own, else that of the object or of the trajectory."""
        named = next(
            (self.given[name] for name, unit in self.wanted.items() if unit == "epoch" and name in self.given), None
        )
        if named is not None:
            return moment(named)
        for name in ("self", "trajectory", "seen", "observation"):
            held = getattr(self.given.get(name), "epoch", None)
            if isinstance(held, Epoch):
                return held
        raise InputError(f"{what}: a moment needs an epoch to count from; hand over seconds, or a duration")


def _numbers(value: Any, unit: str, what: str) -> Any:
    """A quantity, or a sequence of quantities, as bare numbers in `unit`."""
    units = _units()
    if units is None or not (is_quantity(value) or isinstance(value, list | tuple)):
        raise InputError(f"{what}: needs a quantity in {unit} or in a unit like it, got {_described(value)}")
    if not is_quantity(value):
        if not all(is_quantity(one) for one in value):
            raise InputError(f"{what}: needs bare numbers (in {unit}) or quantities, not a mixture of both")
        return np.array([_numbers(one, unit, what) for one in value])
    try:
        return value.to_value(unit)
    except units.UnitConversionError:
        raise InputError(f"{what}: needs a quantity in {unit} or in a unit like it, got {_described(value)}") from None


def _state(value: Any, what: str) -> npt.NDArray[np.float64]:
    """States (..., 6) in km, km/s: position and velocity each with their unit."""
    form = "a pair (position, velocity) of quantities, each of shape (..., 3), or bare numbers in km and km/s"
    if not (is_quantity(value) or isinstance(value, list | tuple)):
        raise InputError(f"{what}: needs {form}, got {_described(value)}")
    if is_quantity(value) and value.dtype.names is None:
        raise InputError(f"{what}: needs {form}; got all components in one unit, {_described(value)}")
    parts: Sequence[Any] = [value[name] for name in value.dtype.names] if is_quantity(value) else value
    if len(parts) == 6 and all(is_quantity(one) for one in parts):
        parts = ([*parts[:3]], [*parts[3:]])
    if len(parts) != 2:
        raise InputError(f"{what}: needs {form}")
    pair = [_numbers(parts[0], "km", f"{what}, position"), _numbers(parts[1], "km / s", f"{what}, velocity")]
    if np.shape(pair[0]) != np.shape(pair[1]) or np.shape(pair[0])[-1:] != (3,):
        raise InputError(f"{what}: needs {form}; got shapes {np.shape(pair[0])} and {np.shape(pair[1])}")
    return np.concatenate(pair, axis=-1, dtype=np.float64)


def _of_datetime(value: datetime, what: str) -> Epoch:
    if value.utcoffset() is None:
        raise InputError(
            f"{what}: datetime {value.isoformat()} has no time zone; give it one, for example tzinfo=timezone.utc"
        )
    shift = value.utcoffset() or timedelta()
    plain = value.replace(tzinfo=None) - shift
    return Epoch.parse(f"{plain.isoformat()} UTC")


def _tdb(value: Any, what: str) -> tuple[Any, Any]:
    """Two-part TDB dates of an astropy Time, by our own TDB - TT at the geocentre where it knows the scale."""
    if value.scale in ("ut1", "local"):
        raise InputError(
            f"{what}: a Time in the scale {value.scale} needs tables that are not here; convert it to UTC, TT or TDB"
        )
    if np.ma.isMaskedArray(value.jd1) and np.ma.getmaskarray(value.jd1).any():
        raise InputError(f"{what}: the Time has masked elements")
    if value.scale == "tdb":
        return value.jd1, value.jd2
    if value.scale in ("utc", "tt"):
        return to_tdb(value.jd1, value.jd2, value.scale)
    return _tdb(value.tt, what)


def _described(value: Any) -> str:
    """What was given, in a few words."""
    if is_quantity(value):
        return f'a quantity in "{value.unit}"' if str(value.unit) else "a quantity without dimension"
    if _is_time(value):
        return "a Time"
    if isinstance(value, list | tuple) and value:
        return f"{type(value).__name__} of {_described(value[0])}"
    return f"a {type(value).__name__}"
