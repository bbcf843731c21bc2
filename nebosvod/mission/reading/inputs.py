"""Files that a mission refers to: found relative to the mission file, never outside its folder."""

from pathlib import Path
from typing import Any

from nebosvod.errors import InputError
from nebosvod.mission.fields import KeyPath
from nebosvod.mission.yaml.inherit import MAX_TELESCOPES
from nebosvod.mission.yaml.yamlfile import Tree, parse_yaml, read_text, shown

Complaint = tuple[KeyPath, str]


def inside(folder: Path | None, text: object) -> Path:
    """The file that `text` names below `folder`.

    Raises
    ------
    InputError
        If it is absolute, leads out of the folder (by .. or a symbolic link), or is no file.
    """
    if not isinstance(text, str) or not text or "\0" in text:
        raise InputError("needs the name of a file beside the mission")
    if folder is None:
        raise InputError("a mission that is not a file cannot refer to other files; write the block here")
    if Path(text).is_absolute():
        raise InputError(f'must be relative to the mission file (got "{shown(text, 80)}")')
    try:
        home = folder.resolve()
        path = (home / text).resolve()
        there = path.is_file()
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f'is not a usable file name (got "{shown(text, 80)}": {shown(str(error))})') from None
    if not path.is_relative_to(home):
        raise InputError(f'leads out of the folder of the mission (got "{shown(text, 80)}"); copy the file there')
    if not there:
        raise InputError(f'no such file (got "{shown(text, 80)}", looked for in {shown(str(home))})')
    return path


def resolve_files(tree: dict[str, Tree], folder: Path | None) -> tuple[dict[str, Tree], list[Complaint]]:
    """Put the content of the files a mission names into its tree, and check the paths of the others."""
    found: list[Complaint] = []
    plan = tree.get("force_model")
    if isinstance(plan, dict) and plan.get("ephemeris") is not None:
        try:
            inside(folder, plan["ephemeris"])
        except InputError as error:
            found.append((("force_model", "ephemeris"), str(error)))
    rows = tree.get("telescopes")
    for i, row in enumerate(rows[:MAX_TELESCOPES] if isinstance(rows, list) else []):
        carrier = row.get("orbit") if isinstance(row, dict) else None
        if isinstance(carrier, dict) and carrier.get("file") is not None:
            try:
                inside(folder, carrier["file"])
            except InputError as error:
                found.append((("telescopes", i, "orbit", "file"), str(error)))
    target = tree.get("object")
    orbit = target.get("orbit") if isinstance(target, dict) else None
    if isinstance(target, dict) and isinstance(orbit, dict) and orbit.get("kind") == "sbdb":
        try:
            orbit = _with_file(orbit, folder) if orbit.get("file") is not None else orbit
        except InputError as error:
            found.append((("object", "orbit", "file"), str(error)))
        tree = {**tree, "object": {**target, "orbit": orbit}}
    if isinstance(tree.get("fit"), dict):
        plan, complaints = _fit_files(tree["fit"], folder)
        tree, found = {**tree, "fit": plan}, [*found, *complaints]
    return tree, found


def _fit_files(plan: Any, folder: Path | None) -> tuple[dict[str, Any], list[Complaint]]:
    """The `fit` block with the content of the reference orbit's file, and the paths of the others checked."""
    named: list[tuple[KeyPath, Any]] = [(("fit", key), plan.get(key)) for key in ("weights", "debias")]
    files = plan.get("observations")
    named += [(("fit", "observations", i), file) for i, file in enumerate(files if isinstance(files, list) else [])]
    carriers = plan.get("spacecraft")
    for station, orbit in carriers.items() if isinstance(carriers, dict) else ():
        if isinstance(orbit, dict):
            named.append((("fit", "spacecraft", station, "file"), orbit.get("file")))
    found: list[Complaint] = []
    for path, name in named:
        try:
            if name is not None:
                inside(folder, name)
        except InputError as error:
            found.append((path, str(error)))
    reference = plan.get("reference")
    orbit = reference.get("orbit") if isinstance(reference, dict) else None
    if isinstance(orbit, dict) and orbit.get("kind") == "sbdb" and orbit.get("file") is not None:
        try:
            plan = {**plan, "reference": {**reference, "orbit": _with_file(orbit, folder)}}
        except InputError as error:
            found.append((("fit", "reference", "orbit", "file"), str(error)))
    return plan, found


def _with_file(orbit: dict[str, Any], folder: Path | None) -> dict[str, Any]:
    """The orbit block with covariance and model parameters of the SBDB answer in `file`."""
    path = inside(folder, orbit["file"])
    answer = parse_yaml(read_text(path).replace("\t", " "), shown(str(orbit["file"]))).tree
    block = answer.get("orbit") if isinstance(answer, dict) else None
    if not isinstance(block, dict):
        raise InputError("is not an answer of JPL's SBDB service (no orbit in it)")
    covariance = block.get("covariance")
    if not isinstance(covariance, dict):
        raise InputError("has no covariance; ask the service with cov=mat")
    if "elements" not in covariance and str(block.get("epoch")) == str(covariance.get("epoch")):
        covariance = {**covariance, "elements": block.get("elements")}
    filled = {"covariance": covariance, "model_pars": block.get("model_pars") or []}
    return {**filled, **orbit}
