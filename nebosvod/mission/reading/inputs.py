"""Files that a mission refers to: found relative to the mission file, never outside its folder."""

from pathlib import Path
from typing import Any

from nebosvod.errors import InputError, NebosvodError
from nebosvod.mission.fields import KeyPath
from nebosvod.mission.found import SPHERE, STATE_LABELS, parameter_of
from nebosvod.mission.yaml.inherit import MAX_TELESCOPES
from nebosvod.mission.yaml.yamlfile import Tree, parse_yaml, read_text, shown

Complaint = tuple[KeyPath, str]
LABELS = ("A1", "A2", "A3", *SPHERE)
LAW = ("alpha", "r0_au", "m", "n", "k")


def inside(folder: Path | None, text: object, *, folders: bool = False) -> Path:
    """The file that `text` names below `folder`; with `folders` it may be a folder too.

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
        there = path.is_file() or (folders and path.is_dir())
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
    tree, complaints = _orbit_files(tree, folder)
    found += complaints
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


def _orbit_files(tree: dict[str, Any], folder: Path | None) -> tuple[dict[str, Any], list[Complaint]]:
    """The tree with what is in the orbit files of object, prior and reference; brightness of the object's too."""
    found: list[Complaint] = []
    for path in (("object", "orbit"), ("prior",), ("fit", "reference", "orbit")):
        block = _at(tree, path)
        if block is None or block.get("file") is None or block.get("kind", "file") != "file" or block.get("found"):
            continue
        try:
            read, magnitude = _orbit_of(inside(folder, block["file"], folders=True))
        except NebosvodError as error:
            found.append(((*path, "file"), str(error)))
            continue
        tree = _put(tree, path, {**block, "found": read})
        if path[0] == "object" and magnitude is not None and "magnitude" not in tree["object"]:
            tree = _put(tree, ("object",), {**tree["object"], "magnitude": magnitude})
    return tree, found


def _at(tree: Any, path: KeyPath) -> dict[str, Any] | None:
    """The block at a path, if there is one."""
    for step in path:
        tree = tree.get(step) if isinstance(tree, dict) else None
    return tree if isinstance(tree, dict) else None


def _put(tree: dict[str, Any], path: KeyPath, block: dict[str, Any]) -> dict[str, Any]:
    """A copy of the tree with another block at a path."""
    head, rest = str(path[0]), path[1:]
    return {**tree, head: _put(tree[head], rest, block) if rest else block}


def _orbit_of(path: Path) -> tuple[dict[str, Any], dict[str, float] | None]:
    """What a block of the mission says for the orbit of a file or folder, and its brightness."""
    from nebosvod.orbits.reading import KNOWN, read_orbit_file  # loads the stages

    orbit = read_orbit_file(path)
    if orbit is None:
        raise InputError(f"holds no orbit that is read; it may be {KNOWN}")
    label_of = {parameter_of(label): label for label in LABELS}
    values = {label_of[name]: value for name, value in orbit.parameters.items()}
    read = {
        "epoch": [orbit.epoch.day, orbit.epoch.fraction],
        "state": orbit.state.tolist(),
        "labels": [*STATE_LABELS, *(label_of[name] for name in orbit.parameter_names)],
        "factor": orbit.factor.tolist(),
        "values": values,
        "notices": list(orbit.notices),
        **({} if orbit.nongrav is None else {"law": {key: getattr(orbit.nongrav, key) for key in LAW}}),
    }
    magnitude = None if orbit.magnitude is None else dict(zip(("H", "G"), orbit.magnitude, strict=True))
    return read, magnitude


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
