"""Cut, changed and hostile run folders and campaigns through the commands that read them, many in one process.

    python folder_mutants.py KIND RUN_FOLDER SCRATCH FIRST COUNT

KIND: summary, manifest, arrays, visibility (by `report` and `compare`, of any kind of folder), campaign (by the reader
of `validate`). The process has 1 GB; each mutant has 20 s. Prints one JSON object: exit codes by command, and what was
wrong by seed.
"""

import io
import json
import os
import random
import runpy
import shutil
import sys
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np

SHARED = runpy.run_path(str(Path(__file__).resolve().parents[2] / "mutants.py"))  # a script is in no package
ODD: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 3, 1e308, -1e308, 1e-320, 2**62, 0.5, "", "x", "nan", "0", "☄", "\x1b[31m", "a" * 3000,
    "2029-04-13T00:00:00 TDB", "9999-12-31T00:00:00 TDB", "km", "converged", "b_plane", "sky", [], {}, [[]], [None],
    [0.0], [1.0, 2.0], [1e308] * 6, [[0.0] * 6] * 6, [[1.0]], ["x"], {"name": "x"}, {"x": {}}, {"estimator": "batch"},
)  # fmt: skip
WORDS = (
    "NaN", "Infinity", "-Infinity", "1e999", "9" * 400, "null", "{", "}", "[", "]", ",", ":", '"', "\\ud800", "\\u0000",
    "[" * 100_000, '{"a":' * 5000, "\x00", "\ufeff", "\\", "//", "1e-999", "-", "0x10", "true",
)  # fmt: skip


def places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a JSON value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield (*at, key)
        yield from places(item, (*at, key))


def change_value(rng: random.Random, record: Any) -> None:
    """Swap, delete, double, shorten or empty something anywhere in a JSON value; high places more often."""
    every = list(places(record))
    if not every:
        return
    high = [place for place in every if len(place) <= rng.choice((1, 2, 3, 9))]
    *way, last = rng.choice(high or every)
    holder = record
    for key in way:
        holder = holder[key]
    what = rng.randrange(8)
    if what < 4:
        holder[last] = deepcopy(rng.choice(ODD))
    elif what == 4:
        del holder[last]
    elif what == 5 and isinstance(holder, list):
        holder.insert(last, holder[last])
    elif what == 6 and isinstance(holder[last], list):
        holder[last] = holder[last][: rng.randrange(len(holder[last]) + 1)]
    elif isinstance(holder[last], int | float):
        holder[last] = rng.choice((-holder[last], holder[last] * 1e30, holder[last] * 1e-30, 0, 1e308, -1.0))
    elif isinstance(holder, dict):
        holder[rng.choice(("", "x", f"{last}2"))] = holder.pop(last)


def change_bytes(rng: random.Random, data: bytes) -> bytes:
    """Cut, flip, delete, insert, double."""
    what, i = rng.randrange(6), rng.randrange(len(data) + 1)
    if what == 0:
        return data[:i]
    if what == 1:
        flipped = bytearray(data)
        for _ in range(rng.choice((1, 1, 4, 40))):
            if flipped:
                flipped[rng.randrange(len(flipped))] ^= 1 << rng.randrange(8)
        return bytes(flipped)
    if what == 2:
        return data[:i] + data[i + rng.choice((1, 2, 20, 2000)) :]
    if what == 3:
        return data[:i] + rng.choice(WORDS).encode("utf-8", "surrogatepass") + data[i:]
    if what == 4:
        return data[:i] + rng.randbytes(rng.choice((1, 8, 64))) + data[i:]
    return rng.choice((b"", b"{}", b"[]", b"null", b"\x00" * 64, b"\xff\xfe{}", data + data, b"[1]", b'"x"'))


def mutated_json(rng: random.Random, data: bytes) -> bytes:
    """A JSON file with changed values or changed bytes."""
    if rng.random() < 0.35:
        return change_bytes(rng, data)
    record = json.loads(data)
    for _ in range(rng.choice((1, 1, 1, 2, 5))):
        change_value(rng, record)
    return json.dumps(record).encode("utf-8", "surrogatepass")


def mutated_array(rng: random.Random, array: "np.ndarray[Any, Any]") -> Any:
    """An array of another shape, type or content."""
    flat = array.reshape(-1)
    size = rng.randrange(flat.size + 1)
    number = array.dtype.kind in "fiu"
    return rng.choice((
        lambda: flat, lambda: flat[:size], lambda: flat[:0], lambda: array[..., None], lambda: np.array(1.0),
        lambda: array[: len(array) // 2] if array.ndim else array, lambda: array.astype("U20"), lambda: array.T,
        lambda: np.full(array.shape, np.nan), lambda: np.full(array.shape, np.inf), lambda: np.zeros(array.shape),
        lambda: np.full(array.shape, 1e308), lambda: np.full(array.shape, -1, dtype=np.int64),
        lambda: array * -1 if number else array, lambda: array * 1e30 if number else array, lambda: array > array,
        lambda: np.array([{"a": print}], dtype=object), lambda: np.array([b"x"]), lambda: flat[::-1],
        lambda: np.zeros(3, dtype=[("a", "f8")]), lambda: np.array(["x"] * 3), lambda: np.array([1 + 2j]),
        lambda: np.concatenate([flat, flat]), lambda: np.full(array.shape, 2**62), lambda: np.array([], dtype="U1"),
    ))()  # fmt: skip


def mutated_arrays(rng: random.Random, data: bytes) -> bytes:
    """An .npz file with other arrays, another header, or tricks of the archive around it."""
    if rng.random() < 0.25:
        return change_bytes(rng, data)
    with np.load(io.BytesIO(data)) as stored:
        arrays: dict[str, Any] = dict(stored)
    made = io.BytesIO()
    if rng.random() < 0.75:
        for name in rng.sample(sorted(arrays), min(len(arrays), rng.choice((1, 1, 2, 6)))):
            if rng.random() < 0.15:
                arrays[rng.choice(("x", f"{name}2"))] = arrays.pop(name)
            elif rng.random() < 0.15:
                del arrays[name]
            else:
                arrays[name] = mutated_array(rng, arrays[name])
        np.savez(made, allow_pickle=True, **arrays)
        return made.getvalue()
    victim = rng.choice(sorted(arrays))
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an array twice is one of the tricks
        for name, array in arrays.items():
            file = io.BytesIO()
            np.save(file, array)
            content = file.getvalue()
            if name == victim:
                trick = rng.randrange(5)
                if trick == 0:
                    content = content.replace(b"'shape': (", b"'shape': (99999999999, ", 1)
                elif trick == 1:
                    content = change_bytes(rng, content)
                elif trick == 2:
                    content = content[:128] + bytes(150_000_000)
                elif trick == 3:
                    archive.writestr(f"{name}.npy", content)
                else:
                    content = content.replace(b"'descr': '<f8'", b"'descr': '|O'  ", 1)
            archive.writestr(f"{name}.npy", content)
    return made.getvalue()


def mutated_text(rng: random.Random, data: bytes) -> bytes:
    """A table with changed cells or bytes."""
    if rng.random() < 0.5:
        return change_bytes(rng, data)
    lines = data.decode("utf-8").split("\n")
    for _ in range(rng.choice((1, 3))):
        row = rng.randrange(len(lines))
        cells = lines[row].split(" ")
        cells[rng.randrange(len(cells))] = rng.choice(
            ("", "nan", "inf", "1e308", "x", '"', "-1", "a" * 500, "☄", "1e999")
        )
        lines[row] = " ".join(cells)
    return "\n".join(lines).encode("utf-8")


Mutation = Callable[[random.Random, bytes], bytes]
FILES: dict[str, tuple[str, Mutation]] = {
    "summary": ("summary.json", mutated_json),
    "manifest": ("manifest.json", mutated_json),
    "arrays": ("arrays.npz", mutated_arrays),
    "visibility": ("tables/visibility.ecsv", mutated_text),
}


def answered(arguments: list[str]) -> tuple[int, str]:
    """Exit code and errors of a command inside this process."""
    from nebosvod.cli import main

    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = main(arguments)
    return code, err.getvalue()


def read_run(kind: str, seed: int, whole: Path, copy: Path) -> Iterator[tuple[str, int, str]]:
    """Mutate one file of a run, then make its report and compare it with the whole one."""
    name, mutation = FILES[kind]
    for file in ("summary.json", "manifest.json", "arrays.npz", "tables/visibility.ecsv"):
        if (whole / file).exists():
            (copy / file).write_bytes((whole / file).read_bytes())
    rng = random.Random(f"{kind} {seed}")
    (copy / name).write_bytes(mutation(rng, (whole / name).read_bytes()))
    yield "report", *answered(["report", str(copy)])
    if kind in ("summary", "manifest"):
        page = copy.parent / "page.html"
        page.unlink(missing_ok=True)
        yield "compare", *answered(["compare", str(whole), str(copy), "--page", str(page)])


def read_campaign(seed: int, whole: Path, copy: Path) -> Iterator[tuple[str, int, str]]:
    """Mutate a chunk, the record or the result of a campaign, then open it as `nebosvod validate` does."""
    from nebosvod.errors import NebosvodError
    from nebosvod.studies.campaign import Campaign, CampaignFolder

    record = json.loads((whole / "campaign.json").read_text("utf-8"))
    campaign = Campaign(**{
        name: tuple(record[name]) if isinstance(record[name], list) else record[name] for name in Campaign.__slots__
    })  # fmt: skip
    rng = random.Random(f"campaign {seed}")
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(whole, copy)
    name, mutation = rng.choice((
        ("chunks/000000.npz", mutated_arrays), ("chunks/000000.npz", mutated_arrays), ("campaign.json", mutated_json),
        ("validation.json", mutated_json),
    ))  # fmt: skip
    (copy / name).write_bytes(mutation(rng, (whole / name).read_bytes()))
    for overwrite in (False, True):
        try:
            with CampaignFolder(copy, campaign, overwrite=overwrite) as held:
                held.refuse_smaller(60)
                missing = held.missing(60)
                held.changed(missing)
                if not missing:
                    held.collected(60)
            code, said = 0, ""
        except NebosvodError as error:
            code, said = error.exit_code, f"error: {error}"
        yield f"validate{' --overwrite' * overwrite}", code, said


def main(kind: str, folder: str, scratch: str, first: str, count: str) -> None:
    """Try `count` mutants from number `first` on."""
    whole, copy = Path(folder), Path(scratch) / "copy"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(whole, copy)
    assert kind == "campaign" or answered(["report", str(copy)])[0] == 0
    SHARED["limit"]()
    codes: Counter[str] = Counter()
    wrong: list[str] = []

    def answers(seed: int) -> str:
        tried = read_campaign(seed, whole, copy) if kind == "campaign" else read_run(kind, seed, whole, copy)
        for command, code, said in tried:
            codes[f"{command} {code}"] += 1
            lines = said.splitlines()
            named = code == 0 or (code in (2, 3) and lines[-1].startswith("error: "))
            if not named or "Traceback" in said or "Warning" in said:
                wrong.append(f"{kind} {seed}: {command}: {code}: {said[-600:]}")
        return ""

    for seed in range(int(first), int(first) + int(count)):
        failed = SHARED["in_time"](lambda seed=seed: answers(seed))
        if failed:
            wrong.append(f"{kind} {seed}: {failed}")
    sys.stdout.write(json.dumps({"codes": codes, "wrong": wrong}))


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main(*sys.argv[1:])
