"""What a function is given, as its command would have it: texts for quantities and moments, paths for answers."""

import re
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, wraps
from inspect import signature
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin

import numpy as np

from nebosvod import dynamics
from nebosvod.borders.compiled import kept
from nebosvod.borders.quantities import duration_s, is_moment, is_quantity
from nebosvod.errors import InputError, NebosvodError, NebosvodNotice
from nebosvod.mission import Mission, load_mission
from nebosvod.mission.editing import plain
from nebosvod.notebook.answer import Fit, FolderAnswer, Result
from nebosvod.orbits.uncertain import UncertainOrbit
from nebosvod.scene.orbit import mission_orbit

P = ParamSpec("P")
R = TypeVar("R")
A = TypeVar("A", bound=FolderAnswer)
Say = Callable[[str], None]
Orbit = str | Path | UncertainOrbit | Mission | Result | Fit
# options of the command line whose parameter has another name here
PARAMETERS = {"from": "since", "to": "until", "from-site": "site", "object": "designations"}


def spoken(function: Callable[P, R]) -> Callable[P, R]:
    """Hold numbers and words to what the function takes; errors name parameters, not options of a command line."""
    taken = signature(function)

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        _tell_of_compiling()
        for name, value in taken.bind(*args, **kwargs).arguments.items():
            _hold(name, value, taken.parameters[name].annotation)
        try:
            return function(*args, **kwargs)
        except NebosvodError as error:
            if error.args and isinstance(error.args[0], str):
                said = re.sub(r"(?<![\w-])--([a-z][a-z-]*)", _parameter, error.args[0])
                error.args = (said, *error.args[1:])
            raise

    return called


def _hold(name: str, value: Any, kind: Any) -> None:
    """Refuse what is no number where a number alone is taken, and a word that is none of a few."""
    kinds = set(get_args(kind) if isinstance(kind, UnionType) or get_origin(kind) is Union else (kind,))
    if value is None and NoneType in kinds:
        return
    for one in kinds:
        if get_origin(one) is Literal and value not in get_args(one):
            raise InputError(f"{name}: {value!r} (allowed: {', '.join(get_args(one))})")
    numbers = kinds - {NoneType}
    fits = not isinstance(value, bool | np.bool_)
    if numbers == {int} and not (fits and isinstance(value, int | np.integer)):
        raise InputError(f"{name}: needs a whole number (got {value!r})")
    if numbers == {float} and not (fits and isinstance(value, int | float | np.integer | np.floating)):
        raise InputError(f"{name}: needs a number (got {value!r})")


@cache
def _tell_of_compiling() -> None:
    """Say once why the first answer of a new installation takes long."""
    if not kept(Path(dynamics.__file__).parent):
        words = "the first run compiles the numerical kernels, once: half a minute to some minutes; later ones do not"
        warnings.warn(words, NebosvodNotice, stacklevel=4)


def _parameter(option: re.Match[str]) -> str:
    return PARAMETERS.get(option[1], option[1].replace("-", "_"))


def text_of(value: Any) -> Any:
    """A quantity, duration or moment as the command line would have it; anything else as it is."""
    return plain(value) if is_quantity(value) or is_moment(value) or duration_s(value) is not None else value


def seed_of(seed: Any) -> int:
    """A seed that the option would take."""
    if not isinstance(seed, int | np.integer) or not 0 <= seed < 2**63:
        raise InputError(f"seed: needs a whole number from 0 on (got {seed!r})")
    return int(seed)


def joined(words: str | Sequence[Any]) -> str:
    """With commas between them, as the command line has them."""
    return words if isinstance(words, str) else ",".join(map(str, words))


def paths_of(files: Any) -> list[str]:
    """Paths of one file or several."""
    if isinstance(files, str | Path):
        return [str(files)]
    if not isinstance(files, list | tuple) or not all(isinstance(one, str | Path) for one in files):
        raise InputError(f"files: a path, or a list of paths, text or pathlib.Path (got {type(files).__name__})")
    return [str(one) for one in files]


def several(named: str | Sequence[str]) -> tuple[str, ...]:
    """Names, of which one need not be a list."""
    return (named,) if isinstance(named, str) else tuple(named)


def quiet(line: str) -> None:
    """Nobody listens."""


def mission_of(mission: Mission | str | Path) -> Mission:
    """A mission that is read, or read now."""
    return mission if isinstance(mission, Mission) else load_mission(mission)


def kept_in(answer: A, output: str | Path | None, overwrite: bool) -> A:
    """The answer, written to a folder where one is named."""
    if output is not None:
        answer.save(output, overwrite=overwrite)
    return answer


@contextmanager
def opened(orbit: Any, as_folder: bool = False) -> Iterator[str | UncertainOrbit]:
    """An orbit as the commands take it: read already, or where it stands."""
    if isinstance(orbit, UncertainOrbit):
        yield orbit
    elif isinstance(orbit, Mission) and not as_folder:
        yield mission_orbit(orbit)
    else:
        with path_of(orbit) as path:
            yield path


@contextmanager
def path_of(orbit: Any) -> Iterator[str]:
    """The path of an orbit; of an answer that of a folder made for it."""
    if isinstance(orbit, str | Path):
        yield str(orbit)
    elif isinstance(orbit, FolderAnswer):
        with tempfile.TemporaryDirectory() as folder:
            yield str(orbit.lent(Path(folder)))
    else:
        raise InputError(f"an orbit is a path, a fit, a run or an UncertainOrbit here (got {type(orbit).__name__})")
