"""What a file or a folder is, told by what is inside, and the orbit in it."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from nebosvod.borders.stored import read_object
from nebosvod.errors import InputError, NebosvodError, printable
from nebosvod.mission.yaml.yamlfile import read_text, shown
from nebosvod.orbits.conversion import Given, uncertain
from nebosvod.orbits.folders import is_folder_of_ours, read_folder_orbit
from nebosvod.orbits.mpc_orb import is_mpc_orb, read_mpc_orb
from nebosvod.orbits.oef import read_oef
from nebosvod.orbits.oem import read_oem_orbit
from nebosvod.orbits.sbdb import is_sbdb, read_sbdb
from nebosvod.orbits.uncertain import UncertainOrbit

HEAD = 4096
KNOWN = "a folder of a fit or a run, SBDB JSON, OEF (.ke0 .ke1 .eq0 .fel), mpc_orb.json, or an OEM with covariance"


def read_orbit_file(path: Path) -> UncertainOrbit | None:
    """The orbit in a file or folder; None for what may be a mission.

    Raises
    ------
    InputError
        With file and line, if it is of a known kind and cannot be used; if it is a folder of another kind.
    """
    _require_there(path)
    if path.is_dir() and not is_folder_of_ours(path):
        raise InputError(f"{shown(str(path))}: is a folder without a run or a fit; an orbit is {KNOWN}")
    with _of_others(path.name):
        return read_folder_orbit(path) if path.is_dir() else _foreign(path)


def _foreign(path: Path) -> UncertainOrbit | None:
    """The orbit of a file that is none of ours."""
    head = _head(path)
    start = head.lstrip("\ufeff \t\r\n")
    if start.startswith("CCSDS_OEM_VERS"):
        return uncertain(read_oem_orbit(path), path.name)
    if re.search(r"^\s*format\s*=\s*'OEF", head, re.MULTILINE):
        return uncertain(read_oef(path, read_text(path)), path.name)
    if start.startswith(("{", "[")):
        return uncertain(_json(path), path.name)
    return None


@contextmanager
def _of_others(name: str) -> Iterator[None]:
    """What a file leads to whose numbers no orbit has, or whose parts are of other kinds than they should be.

    What is said begins with the file or names it, on lines that cannot disturb a terminal.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except NebosvodError as error:
        said = "\n".join(printable(line) for line in str(error).split("\n"))
        error.args = (said if name in said else f"{shown(name)}: {said}",)
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, RecursionError) as error:
        said = shown(f"{type(error).__name__}: {error}", 120)
        raise InputError(f"{name}: cannot be read ({said}); damaged, or numbers that no orbit has") from None


def _require_there(path: Path) -> None:
    """Raise InputError unless there is something at a path."""
    try:
        there = path.exists()
    except (OSError, ValueError) as error:
        raise InputError(f"{shown(str(path), 80)}: is not a usable file name ({shown(str(error), 80)})") from None
    if not there:
        raise InputError(f"{shown(str(path))}: no such file; an orbit is {KNOWN}, or a mission")


def _head(path: Path) -> str:
    """The beginning of a regular file."""
    if not path.is_file():
        raise InputError(f"{shown(str(path))}: is no regular file; an orbit is {KNOWN}, or a mission")
    with path.open("rb") as file:
        return file.read(HEAD).decode("utf-8", "replace")


def _json(path: Path) -> Given:
    """A JSON object of JPL or of the MPC."""
    content = read_object(path.resolve())
    if is_mpc_orb(content):
        return read_mpc_orb(path, content)
    if is_sbdb(content):
        return read_sbdb(path, content)
    raise InputError(f"{path.name}: is JSON, but neither an answer of JPL's SBDB nor an mpc_orb.json of the MPC")
