"""What lies at a path where a run folder was wanted, and which command is for it."""

from pathlib import Path
from typing import Any

from nebosvod.borders.stored import read_object
from nebosvod.errors import InputError

RUN_FILES = ("manifest.json", "summary.json", "arrays.npz")
LISTED = 3
MOST_FILES = 200
HEAD = 4000  # characters of a page that hold its title
PAGES = {
    "plan of measurements": "plan",
    "comparison": "compare",
    "validation report": "validate",
    "accuracy report": "run",
    "orbit fit": "fit",
    "ephemeris": "ephemeris",
    "approaches": "approaches",
    "impact risk": "risk",
}
PLAN_KEYS = {"windows", "greedy", "uniform"}
VALIDATION_KEYS = {"n_runs", "mode", "estimators", "verdict"}
COMPARISON_KEYS = {"runs", "budget", "ellipses"}
ORBIT_COMPARISON_KEYS = {"kind", "runs", "warnings", "rows"}


def not_a_run(path: Path) -> str:
    """Why a path is no run folder and what to do with it; empty for a whole run.

    Notes
    -----
    Told by what is inside, never by the name.
    """
    missing = [name for name in RUN_FILES if not (path / name).is_file()]
    if not missing:
        return ""
    if not path.exists():
        return "there is no such folder, so it is not a run folder; make one with: nebosvod run MISSION"
    if not path.is_dir():
        return _file(path)
    if (path / "campaign.json").is_file():
        return _validation(path)
    if "manifest.json" not in missing and read_json(path / "manifest.json").get("outputs_sha256"):
        return f"{', '.join(missing)} missing, which its manifest.json lists; make the run again"
    inside = sorted(one.name for one in path.iterdir() if all((one / name).is_file() for name in RUN_FILES))
    if inside:
        more = ", ..." if len(inside) > LISTED else ""
        listed = ", ".join(inside[:LISTED]) + more
        return f"is not a run folder but holds some ({listed}); name one, as {path / inside[0]}"
    written = [file for file in sorted(path.iterdir())[:MOST_FILES] if file.suffix in (".json", ".html")]
    for file in sorted(written, key=lambda one: one.suffix, reverse=True):
        if said := _written(file):
            return f"not a run folder; {file.name} in it {said}"
    return f"not a run folder: {', '.join(missing)} missing; make one with: nebosvod run MISSION"


def _validation(path: Path) -> str:
    """A folder of `nebosvod validate`: its own command makes its page again and loses nothing."""
    campaign, found = read_json(path / "campaign.json"), read_json(path / "validation.json")
    mission, runs = campaign.get("mission", "MISSION"), found.get("n_runs")
    command = f"nebosvod validate {mission}" + (f" --runs {runs}" if runs else "")
    command += f" --seed {campaign['seed']}" if campaign.get("seed") else ""
    command += " --full" if campaign.get("mode") == "full" else ""
    page = "its page is validation.html" if (path / "validation.html").is_file() else "it is not finished"
    return f"is a validation, not a run folder; {page}; made from the runs that are there by: {command} -o {path}"


def _file(path: Path) -> str:
    """A file: what a command wrote, a file of a run, or anything else."""
    if all((path.parent / name).is_file() for name in RUN_FILES):
        return f"is a file of a run, not its folder; name {path.parent}"
    said = _written(path)
    if said:
        return f"{said}; it is not a run folder"
    return "is a file, not a run folder; name the folder of a run, as nebosvod run MISSION -o FOLDER makes it"


def _written(path: Path) -> str:
    """What a file of a plan, a comparison or any page is, and what it is for; empty for others."""
    if path.suffix == ".html":
        return f"is {_page(path)}: open it in a browser"
    keys = set(read_json(path))
    if keys >= PLAN_KEYS:
        return "is a plan: its page is made together with it, by nebosvod plan MISSION --page NAME.html"
    if keys >= COMPARISON_KEYS or keys >= ORBIT_COMPARISON_KEYS:
        return "is a comparison: its page is made by nebosvod compare DIR DIR --page NAME.html"
    return ""


def is_validation(path: Path) -> bool:
    """Whether a file is the result of `nebosvod validate`, or its page."""
    if path.suffix == ".html":
        return _page(path) == f"the page of nebosvod {PAGES['validation report']}"
    return read_json(path).keys() >= VALIDATION_KEYS


def _page(path: Path) -> str:
    """Which command made a page, by its title."""
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            head = file.read(HEAD)
    except OSError:
        head = ""
    title = head.partition("</title>")[0].rpartition("<title>")[2]
    kind = next((kind for kind in PAGES if title.endswith(f": {kind}")), "")
    return f"the page of nebosvod {PAGES[kind]}" if kind else "a page"


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object; empty where there is none."""
    try:
        return read_object(path)
    except (OSError, InputError):
        return {}
