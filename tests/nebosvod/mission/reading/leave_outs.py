"""What may be left out of a file, emptied or treated otherwise: variants of a tree, and what the commands say of them.

python tests/nebosvod/mission/reading/leave_outs.py MISSION [FOLDER [FIRST LAST]] tries every variant of a file (or a
built-in mission, or "template") and prints what does not agree.
"""

import contextlib
import copy
import io
import json
import re
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nebosvod.borders.treatment import TREATMENTS
from nebosvod.cli import main
from nebosvod.mission.reading.builtin import builtin_path, template_text
from nebosvod.mission.request import PARAMETER_GROUPS
from nebosvod.mission.uncertainty import GROUPS
from nebosvod.mission.yaml.yamlfile import KeyPath, dotted, parse_yaml
from nebosvod.timescale import Epoch

EXPOSURES = 8  # of each arc: enough for an orbit and a bias, and quick
FEW = 3  # where many telescopes make them
RUNS = 5
CRASH = re.compile(r"details: (\S+\.txt)")


def tree_of(name: str) -> dict[str, Any]:
    """The plain tree of a built-in mission, the template of `init`, or a file."""
    if name == "template":
        text = template_text("my-mission")
    else:
        path = Path(name)
        text = (path if path.is_file() else builtin_path(name)).read_text("utf-8")
    tree = parse_yaml(text, name).tree
    assert isinstance(tree, dict)
    return tree


def thinned(tree: dict[str, Any]) -> dict[str, Any]:
    """The mission with few exposures and few runs of Monte Carlo."""
    tree = copy.deepcopy(tree)
    count = EXPOSURES if len(tree.get("telescopes", ())) < FEW else FEW
    for arc in tree.get("schedule", ()):
        span = Epoch.parse(arc["end"]) - Epoch.parse(arc["start"])
        if span > 0.0:
            arc["cadence"] = f"{span / (count - 1):.3f} s"
    if isinstance(tree.get("monte_carlo"), dict):
        tree["monte_carlo"]["runs"] = RUNS
    return tree


def nodes(tree: Any, path: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
    """Every value below the root, outer ones first."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        yield (*path, key), value
        yield from nodes(value, (*path, key))


def edited(tree: dict[str, Any], path: KeyPath, *value: Any) -> dict[str, Any]:
    """The tree with another value at a path, or without it."""
    changed = copy.deepcopy(tree)
    place: Any = changed
    for key in path[:-1]:
        place = place[key]
    if value:
        place[path[-1]] = value[0]
    else:
        del place[path[-1]]
    return changed


def numeric(path: KeyPath, tree: dict[str, Any]) -> bool:
    """Whether a node is a row of a matrix or an element of one, of which one of each kind is enough."""
    return any(key in ("data", "covariance", "elements", "model_pars") for key in path[:-1]) and any(
        isinstance(key, int) and key > 0 for key in path
    )


def variants(tree: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each key dropped, each block and list emptied, each value nothing; each treatment of each group."""
    for path, value in nodes(tree):
        if numeric(path, tree):
            continue
        name = dotted(path)
        yield f"without {name}", edited(tree, path)
        yield f"null {name}", edited(tree, path, None)
        if isinstance(value, list | dict) and value:
            yield f"empty {name}", edited(tree, path, type(value)())
        if isinstance(value, dict) and "sigma" in value and path[-1] not in ("noise", "prior"):
            for treatment in TREATMENTS:
                yield f"{name} {treatment}", edited(tree, (*path, "treatment"), treatment)
                bare = {key: one for key, one in value.items() if key != "sigma"} | {"treatment": treatment}
                yield f"{name} {treatment}, no sigma", edited(tree, path, bare)
    for i, estimator in enumerate(tree.get("estimators", ())):
        for group in (*PARAMETER_GROUPS, *GROUPS):
            for treatment in TREATMENTS:
                own = {**estimator.get("treatment", {}), group: treatment}
                yield f"{estimator['name']}: {group} {treatment}", edited(tree, ("estimators", i, "treatment"), own)
    for treatment in TREATMENTS:
        yield f"everything {treatment}", everything(tree, treatment)


def everything(tree: dict[str, Any], treatment: str) -> dict[str, Any]:
    """All that is uncertain with one treatment."""
    changed = copy.deepcopy(tree)
    for _, value in list(nodes(changed)):
        if isinstance(value, dict) and isinstance(value.get("treatment"), str):
            value["treatment"] = treatment
    return changed


@dataclass(frozen=True, slots=True)
class Outcome:
    """Exit codes of `check` and of the work itself, all that was printed, and what is wrong with that."""

    check: int
    work: int
    said: str

    @property
    def fault(self) -> str:
        """A sentence, empty where all is well."""
        if 4 in (self.check, self.work) or "Traceback" in self.said:
            return "an internal error"
        if self.check not in (0, 2) or self.work not in (0, 1, 2):
            return f"exit codes {self.check}, {self.work}"
        if (self.check == 2) != (self.work == 2):
            return f"check ends with {self.check}, the work with {self.work}"
        return ""


def outcome(tree: dict[str, Any], folder: Path, command: str = "run") -> Outcome:
    """Write a tree to a file beside what it refers to, check it and do it."""
    file = folder / "m.yaml"
    file.write_text(json.dumps(tree), "utf-8")
    out = folder / "out"
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        codes = []
        for argv in (["check", str(file)], [command, str(file), "-o", str(out), "--overwrite"]):
            codes.append(main(argv))
    text = said.getvalue()
    for crash in map(Path, CRASH.findall(text)):
        text += crash.read_text("utf-8")
        crash.unlink()
    found = Outcome(codes[0], codes[1], text)
    if found.work in (0, 1) and "report:" in found.said and not (out / "report.html").is_file():
        return Outcome(codes[0], 4, found.said + "no report.html")
    return found


def script(name: str, folder: Path, first: int, last: int) -> None:
    """Try all variants of one file."""
    tree = thinned(tree_of(name))
    command = "fit" if "fit" in tree else "run"
    counts: dict[tuple[int, int], int] = {}
    began = time.monotonic()
    for number, (what, variant) in enumerate(variants(tree)):
        if not first <= number < last:
            continue
        got = outcome(variant, folder, command)
        counts[got.check, got.work] = counts.get((got.check, got.work), 0) + 1
        if got.fault or (got.check, got.work) == (0, 1):
            tail = "\n    ".join(got.said.strip().splitlines()[-12 if got.fault else -2 :])
            tell(f"{'FAULT' if got.fault else 'note'} {number} {what}: {got.fault}\n    {tail}")
    tell(f"{name} {counts} {time.monotonic() - began:.0f} s")


def tell(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    there = Path(sys.argv[2] if len(sys.argv) > 2 else "build/leave-outs")
    there.mkdir(parents=True, exist_ok=True)
    limits = [int(word) for word in sys.argv[3:5]] or [0, 1_000_000]
    script(sys.argv[1], there, limits[0], limits[1])
