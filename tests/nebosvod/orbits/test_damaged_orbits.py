"""Orbit files somebody cut, changed or made to harm: read, or refused in a sentence with exit code 2 or 3, never 4."""

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod import read_orbit
from nebosvod.cli import main
from nebosvod.errors import NebosvodError

SHARED = Path(__file__).resolve().parents[3].parent / "shared"
MPC = SHARED / "data" / "orbits" / "mpc_orb" / "2012HN13_mpcorb_yarkovsky.json"
ODD: tuple[Any, ...] = (None, True, "", "x", "1e999", -1.0, 0.0, 1e300, [], {}, [[1.0]], "nan", 10**30, "é" * 9)
FEW, MANY = 60, 600


def read(path: Path) -> None:
    """Read it, or be refused."""
    try:
        orbit = read_orbit(path)
    except NebosvodError as error:
        if error.exit_code not in (1, 2, 3):
            raise
        return
    assert np.isfinite(orbit.state).all()
    assert (np.diag(orbit.factor) > 0.0).all()


def leaves(tree: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths of everything below the root."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from leaves(value, (*path, key))


def changed(tree: Any, path: tuple[Any, ...], value: Any) -> Any:
    """A copy with another value at a path; `...` leaves it out."""
    made = copy.deepcopy(tree)
    node = made
    for step in path[:-1]:
        node = node[step]
    if value is ...:
        del node[path[-1]]
    else:
        node[path[-1]] = value
    return made


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.long)])
@pytest.mark.parametrize("which", ["sbdb", "mpc"])
def test_json_with_anything_changed(which: str, count: int, sbdb: Path, tmp_path: Path) -> None:
    if which == "mpc" and not MPC.is_file():
        pytest.skip("the folder of reference data is not here")
    tree = json.loads((sbdb if which == "sbdb" else MPC).read_text())
    rng, places, path = np.random.default_rng(count), list(leaves(tree)), tmp_path / "x.json"
    for _ in range(count):
        place = places[rng.integers(len(places))]
        value = (*ODD, ...)[rng.integers(len(ODD) + 1)]
        path.write_text(json.dumps(changed(tree, place, value)))
        read(path)


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.long)])
@pytest.mark.parametrize("which", ["yr4", "apollo"])
def test_text_with_bytes_changed_lines_lost_or_cut(which: str, count: int, request: pytest.FixtureRequest) -> None:
    path: Path = request.getfixturevalue(which)
    data, rng = path.read_bytes(), np.random.default_rng(count + 1)
    lines = data.splitlines(keepends=True)
    for number in range(count):
        if number % 3 == 0:
            made = bytearray(data)
            for at in rng.integers(len(data), size=3):
                made[at] = rng.choice(list(b"0123456789.+-EeD !'=\n\x00\xff"))
            path.write_bytes(bytes(made))
        elif number % 3 == 1:
            gone = rng.integers(len(lines))
            path.write_bytes(b"".join(lines[:gone] + lines[gone + 1 :]))
        else:
            path.write_bytes(data[: rng.integers(len(data))])
        read(path)


def test_what_is_no_file_at_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    deep = tmp_path / "deep.json"
    deep.write_text("[" * 100_000)
    for path in (deep, Path("/dev/zero"), tmp_path / ("n" * 300), tmp_path / "\udcff.ke0"):
        assert main(["ephemeris", str(path), "--from", "2024-01-01", "--to", "2024-01-02"]) == 2
        assert "Traceback" not in capsys.readouterr().err


def test_arrays_of_a_folder_that_do_not_fit(minimal_folder: Path, tmp_path: Path) -> None:
    for name in ("manifest.json", "summary.json"):
        (tmp_path / name).write_bytes((minimal_folder / name).read_bytes())
    arrays = dict(np.load(minimal_folder / "arrays.npz"))
    for key in [key for key in arrays if key.startswith("orbit_") or key == "reference_epoch_jd_tdb"]:
        for value in (arrays[key][:1], np.zeros((0, 3)), np.full(3, np.nan), np.array(["x"])):
            np.savez(tmp_path / "arrays.npz", **(arrays | {key: value}))
            read(tmp_path)
    summary = json.loads((minimal_folder / "summary.json").read_text())
    np.savez(tmp_path / "arrays.npz", **arrays)
    for key in ("estimators", "physics", "object"):
        for odd in ODD:
            (tmp_path / "summary.json").write_text(json.dumps(summary | {key: odd}))
            read(tmp_path)
