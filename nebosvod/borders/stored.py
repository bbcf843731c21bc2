"""Files of a folder that somebody hands over: read within limits, or refused by file and key.

A run folder may be cut, changed or made to harm: links and devices in place of files, nesting that ends the parser,
numbers no float holds, archives that unpack to gigabytes, arrays that would run code.
"""

import io
import json
import math
import os
import stat
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError

LARGEST_TEXT = 64_000_000  # bytes of a JSON file or a table
DEEPEST = 32
LARGEST_INTEGER = 2**63
MOST_ARRAYS = 5000
UNPACKED_FREE, UNPACKED_TIMES = 64_000_000, 20  # arrays of measurements hardly shrink; a bomb shrinks a thousandfold
KINDS = "biufU"
LAST_CODE_POINT, SURROGATES = 0x10FFFF, (0xD800, 0xDFFF)
Arrays = dict[str, npt.NDArray[Any]]


@contextmanager
def held_together(where: str) -> Iterator[None]:
    """What is computed from files of others, each sound by itself: where they contradict each other, wrong input.

    Raises
    ------
    InputError
        Instead of the error that a missing key, a wrong length or an impossible number leads to.
    """
    from jinja2 import TemplateError

    wrong = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, RecursionError, TemplateError)
    try:
        with np.errstate(all="ignore"):
            yield
    except InputError:
        raise
    except wrong as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else f"{type(error).__name__}: {error}"
        raise InputError(f"{where}: its files contradict each other ({what[:200]}); make the run again") from None


def read_bytes(path: Path, largest: int = LARGEST_TEXT) -> bytes:
    """The bytes of a regular file that is no link.

    Raises
    ------
    FileNotFoundError, InputError
        If it is not there; if it is a link, a device or too large, or the system refuses.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        with open(descriptor, "rb") as file:
            status = os.fstat(descriptor)
            if not stat.S_ISREG(status.st_mode):
                raise InputError(f"{path}: is no regular file")
            if status.st_size > largest:
                raise InputError(f"{path}: {status.st_size} bytes are more than a file of a run has ({largest})")
            return file.read(status.st_size + 1)
    except (FileNotFoundError, InputError):
        raise
    except (OSError, ValueError) as error:
        link = ", a symbolic link" if path.is_symlink() else ""
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error}{link})") from None


def read_object(path: Path, largest: int = LARGEST_TEXT) -> dict[str, Any]:
    """A JSON object whose numbers are finite, whose text is text, and whose nesting ends.

    Raises
    ------
    FileNotFoundError, InputError
        If it is not there; if it is anything else. The message names the file.
    """
    try:
        content = json.loads(
            read_bytes(path, largest).decode("utf-8"), parse_constant=_refused, parse_float=_finite, parse_int=_bounded
        )
        _require_plain(content)
    except InputError:
        raise
    except RecursionError:
        raise InputError(f"{path}: cannot be read (nested deeper than {DEEPEST})") from None
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}:{error.lineno}:{error.colno}: is no JSON from here on; damaged or cut short"
        ) from None
    except UnicodeDecodeError as error:
        byte = f"byte 0x{error.object[error.start]:02X} at place {error.start}"
        raise InputError(f"{path}: {byte} is not text in UTF-8; damaged") from None
    except ValueError as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds {type(content).__name__}, needs a JSON object")
    return content


def _refused(text: str) -> NoReturn:
    raise ValueError(f"{text} is not a number of JSON")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:30]} is too large for a number")
    return value


def _bounded(text: str) -> int:
    if len(text) > 20 or abs(int(text)) >= LARGEST_INTEGER:
        raise ValueError(f"{text[:30]} is too large for a whole number")
    return int(text)


def _require_plain(content: object) -> None:
    """Level by level, so that no nesting ends this process."""
    level: list[object] = [content]
    for _ in range(DEEPEST):
        texts = [item for item in level if isinstance(item, str)]
        "".join(texts).encode("utf-8")  # half a surrogate pair is no text
        below: list[object] = []
        for item in level:
            if isinstance(item, dict):
                below += [*item.keys(), *item.values()]
            elif isinstance(item, list):
                below += item
        level = below
        if not level:
            return
    raise ValueError(f"nested deeper than {DEEPEST}")


def read_arrays(path: Path) -> Arrays:
    """The arrays of an .npz file: numbers, truth values and text, no objects, no more than the file can mean.

    Raises
    ------
    FileNotFoundError, InputError
        If it is not there; if it is not such a file, names the array.
    """
    data = read_bytes(path, 2**40)
    name = ""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()
            unpacked = sum(member.file_size for member in members)
            if unpacked > UNPACKED_FREE + UNPACKED_TIMES * len(data) or len(members) > MOST_ARRAYS:
                raise ValueError(f"{len(members)} arrays unpack to {unpacked} bytes")
            arrays: Arrays = {}
            for member in members:
                name = member.filename
                arrays[name.removesuffix(".npy")] = _array(archive.read(member))
    except InputError:
        raise
    except (ValueError, OSError, EOFError, LookupError, RuntimeError, NotImplementedError, TypeError, SyntaxError,
            zipfile.BadZipFile, zlib.error, MemoryError, OverflowError, tokenize.TokenError) as error:  # fmt: skip
        inside = f"{name}: " if name else ""
        raise InputError(f"{path}: cannot be read ({inside}{str(error)[:200]}); make the run again") from None
    return arrays


def _array(data: bytes) -> npt.NDArray[Any]:
    """One .npy file; its header says no more than its bytes hold."""
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    elif version == (2, 0):
        shape, fortran, dtype = np.lib.format.read_array_header_2_0(stream)
    else:
        raise ValueError(f"version {version} of an array file")
    rest = memoryview(data)[stream.tell() :]
    if dtype.kind not in KINDS or dtype.hasobject or dtype.itemsize == 0 or dtype.shape:
        raise ValueError(f"an array of {dtype}")
    if any(size < 0 for size in shape) or math.prod(shape) * dtype.itemsize != len(rest):
        raise ValueError(f"shape {shape} of {dtype} is not what {len(rest)} bytes hold")
    array = np.frombuffer(rest, dtype=dtype).reshape(shape, order="F" if fortran else "C")
    if dtype.kind == "U":
        points = array.reshape(-1).astype(dtype.newbyteorder("=")).view(np.uint32)
        if ((points > LAST_CODE_POINT) | ((points >= SURROGATES[0]) & (points <= SURROGATES[1]))).any():
            raise ValueError("text that is no Unicode")
    return array.copy()


def require_version(path: Path, summary: Mapping[str, Any], known: int) -> None:
    """Raise InputError unless a summary is of the schema this program reads."""
    version = summary.get("schema_version")
    if version != known or isinstance(version, bool):
        raise InputError(f"{path}: schema_version {str(version)[:40]}; this program reads {known}")
