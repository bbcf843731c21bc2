"""Objects of a catalogue: a table of elements as ECSV or CSV, JPL's SBDB query, or the MPC's MPCORB.

Each row becomes an orbit as a mission says it, with magnitude and name where the table has them.
"""

import csv
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from nebosvod.borders.stored import read_bytes
from nebosvod.errors import InputError
from nebosvod.mission.yaml.yamlfile import shown

MOST_BYTES = 1_000_000_000
KEPLERIAN = ("a", "e", "i", "node", "peri", "M")
COMETARY = ("e", "q", "tp", "node", "peri", "i")
# how others call a column -> how a mission does
NAMES: Mapping[str, str] = {
    "om": "node", "w": "peri", "ma": "M", "m": "M", "inc": "i", "incl": "i", "longnode": "node", "argperi": "peri",
    "mean_anomaly": "M", "h": "H", "absmag": "H", "g": "G", "full_name": "name", "object": "name", "pdes": "name",
    "designation": "name", "epoch_jd": "epoch",
}  # fmt: skip
UNITS = {"a": "au", "q": "au", "i": "deg", "node": "deg", "peri": "deg", "M": "deg"}
_PACKED = re.compile(r"([IJK])(\d\d)([1-9A-C])([1-9A-V])")


def read_catalogue(path: Path) -> list[dict[str, Any]]:
    """Objects of a file: for each row the keys `name`, `orbit` and, where known, `magnitude`.

    Raises
    ------
    InputError
        If the file is none of those, or a row has no orbit; names line and column.
    """
    try:
        text = read_bytes(path, MOST_BYTES).decode("utf-8", "replace")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    if not text.strip():
        raise InputError(f"{path}: is empty")
    if text.startswith("# %ECSV"):
        return list(_table(path, *_ecsv(path)))
    if _looks_like_mpcorb(text):
        return list(_mpcorb(path, text))
    return list(_table(path, *_csv(path, text)))


def _ecsv(path: Path) -> tuple[list[str], list[tuple[int, dict[str, str]]], dict[str, str]]:
    from astropy.table import Table

    try:
        table = Table.read(path, format="ascii.ecsv", fill_values=None)
    except (ValueError, TypeError, KeyError, OSError, IndexError) as error:
        raise InputError(f"{path}: is no ECSV table that can be read ({str(error)[:150]})") from None
    units = {name: str(table[name].unit) for name in table.colnames if table[name].unit is not None}
    rows = [(k + 1, {name: str(row[name]) for name in table.colnames}) for k, row in enumerate(table)]
    return list(table.colnames), rows, units


def _csv(path: Path, text: str) -> tuple[list[str], list[tuple[int, dict[str, str]]], dict[str, str]]:
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    reader = csv.DictReader(lines)
    names = list(reader.fieldnames or [])
    rows = [(k + 2, {key: (value or "") for key, value in row.items() if key}) for k, row in enumerate(reader)]
    return names, rows, {}


def _table(
    path: Path, names: Sequence[str], rows: Sequence[tuple[int, dict[str, str]]], units: Mapping[str, str]
) -> Iterator[dict[str, Any]]:
    """Objects of a table with named columns; angles in degrees and distances in au where it says no units."""
    known = {name: NAMES.get(name.strip().lower(), name.strip()) for name in names}
    have = {*known.values()}
    kind = next((k for k, keys in (("cometary", COMETARY), ("keplerian", KEPLERIAN)) if {*keys} <= have), None)
    if "orbit" in have:
        kind = "orbit"
    if kind is None or (kind != "orbit" and "epoch" not in have):
        missing = [one for one in (*KEPLERIAN, "epoch") if one not in have]
        near = get_close_matches(missing[0] if missing else "epoch", [str(name) for name in names], 1)
        hint = f'; is it "{shown(near[0], 40)}"?' if near else ""
        raise InputError(
            f"{path}: has no columns of orbits (needs a, e, i, node, peri, M or e, q, tp, node, peri, i, with epoch; "
            f"missing {', '.join(missing)}){hint}"
        )
    for line, raw in rows:
        row = {known[name]: value.strip() for name, value in raw.items() if name in known}
        yield _object(path, line, kind, row, {known[name]: unit for name, unit in units.items()})


def _object(path: Path, line: int, kind: str, row: Mapping[str, str], units: Mapping[str, str]) -> dict[str, Any]:
    found: dict[str, Any] = {"name": row.get("name") or f"object {line}"}
    if kind == "orbit":
        try:
            found["orbit"] = json.loads(row["orbit"])
        except ValueError:
            raise InputError(f"{path}:{line}: orbit: is no block of JSON") from None
    else:
        keys = COMETARY if kind == "cometary" else KEPLERIAN
        orbit: dict[str, Any] = {"kind": kind, "frame": "ecliptic_j2000", "epoch": _date(path, line, row["epoch"])}
        for key in keys:
            if key == "tp":
                orbit[key] = _date(path, line, row[key])
                continue
            number = _float(path, line, key, row[key])
            unit = units.get(key, UNITS.get(key, "")).replace("AU", "au")
            orbit[key] = f"{number!r} {unit}".strip() if unit else number
        found["orbit"] = orbit
    if row.get("H"):
        law = {"H": _float(path, line, "H", row["H"])}
        found["magnitude"] = law | ({"G": _float(path, line, "G", row["G"])} if row.get("G") else {})
    return found


def _float(path: Path, line: int, key: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f'{path}:{line}: {key}: is no number (got "{shown(text, 40)}")') from None


def _date(path: Path, line: int, text: str) -> str:
    """A Julian or modified Julian date TDB, or text with its scale."""
    if re.fullmatch(r"\d{7}(\.\d*)?", text):
        return f"{text} JD TDB"
    if re.fullmatch(r"\d{5}(\.\d*)?", text):
        return f"{text} MJD TDB"
    if re.search(r" (TDB|TT|UTC)$", text):
        return text
    raise InputError(
        f'{path}:{line}: epoch: is no date (got "{shown(text, 40)}"; a Julian date, or text with its scale)'
    )


def _looks_like_mpcorb(text: str) -> bool:
    lines = [line for line in text.splitlines()[:2000] if len(line) >= 103]
    return bool(lines) and any(_PACKED.fullmatch(line[20:25]) and _is_number(line[92:103]) for line in lines)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _mpcorb(path: Path, text: str) -> Iterator[dict[str, Any]]:
    """Objects of MPCORB.DAT.

    References
    ----------
    Minor Planet Center, "Export format for minor-planet orbits": columns counted from 1.
    """
    begun = not any(line.startswith("------") for line in text.splitlines()[:200])
    for number, line in enumerate(text.splitlines(), start=1):
        if not begun:
            begun = line.startswith("------")
            continue
        if len(line) < 103 or not line.strip():
            continue
        cells = {"M": line[26:35], "peri": line[37:46], "node": line[48:57], "i": line[59:68], "e": line[70:79],
                 "a": line[92:103]}  # fmt: skip
        row = {key: value.strip() for key, value in cells.items()}
        row |= {"name": line[166:194].strip() or line[:7].strip(), "epoch": _unpacked(path, number, line[20:25])}
        row |= {"H": line[8:13].strip(), "G": line[14:19].strip()}
        yield _object(path, number, "keplerian", row, {})


def _unpacked(path: Path, line: int, text: str) -> str:
    """A packed date of the MPC, 0h TT."""
    match = _PACKED.fullmatch(text)
    if match is None:
        raise InputError(f'{path}:{line}: epoch: is no packed date of the MPC (got "{shown(text, 20)}")')
    digits = "0123456789ABCDEFGHIJKLMNOPQRSTUV"
    year = 100 * (ord(match[1]) - ord("I") + 18) + int(match[2])
    return f"{year:04d}-{digits.index(match[3]):02d}-{digits.index(match[4]):02d}T00:00:00 TT"
