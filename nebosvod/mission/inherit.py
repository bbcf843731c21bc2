"""`like: NAME`: a telescope takes from an earlier one whatever it does not say itself, before validation."""

from dataclasses import replace
from difflib import get_close_matches
from typing import Any

from nebosvod.yamlfile import KeyPath, Problem, Tree, YamlFile, shown


def resolve_like(file: YamlFile) -> tuple[Tree, YamlFile, list[Problem]]:
    """Return the tree with every `like` filled in, the file with their places, and what is wrong with the names.

    A mapping is merged key by key, except that a block of another `kind` replaces the inherited one; an empty value
    (null) removes what would be inherited. An inherited value stands where its original stands.
    """
    file = replace(file, keys={**file.keys}, values={**file.values}, texts={**file.texts})
    problems: list[Problem] = []
    tree = file.tree
    if not isinstance(tree, dict) or not isinstance(tree.get("telescopes"), list):
        return tree, file, problems
    rows: list[Tree] = []
    known: dict[str, int] = {}
    for i, row in enumerate(tree["telescopes"]):  # type: ignore[arg-type]
        if isinstance(row, dict) and row.get("like") is not None:
            base = _find(row["like"], i, known, file, problems)
            if base is not None:
                row = _merge(rows[base], row, ("telescopes", base), ("telescopes", i), file)
        rows.append(row)
        if isinstance(row, dict) and isinstance(row.get("name"), str):
            known.setdefault(str(row["name"]), i)
    return {**tree, "telescopes": rows}, file, problems


def _find(wanted: Tree, index: int, known: dict[str, int], file: YamlFile, problems: list[Problem]) -> int | None:
    """Index of the telescope meant, or with a problem noted the likeliest; None if there is none before this one."""
    if isinstance(wanted, str) and wanted in known:
        return known[wanted]
    near = get_close_matches(str(wanted)[:80], known, 1) or list(known)[:1]
    hint = (
        f'did you mean "{shown(near[0], 60)}"?' if near else "a telescope can only be like an earlier one in the list"
    )
    mark = file.values[("telescopes", index, "like")]
    text = f'unknown telescope (got "{shown(str(wanted), 60)}"; allowed: {_listed(known)}); {hint}'
    problems.append(Problem(mark, f"telescopes[{index}].like: {text}"))
    return known[near[0]] if near else None  # so that the rest of the block is checked as if it were that one


def _listed(names: dict[str, int]) -> str:
    return ", ".join(shown(name, 40) for name in list(names)[:10]) or "none yet"


def _merge(base: Tree, own: Tree, base_path: KeyPath, own_path: KeyPath, file: YamlFile) -> Tree:
    """`own` over `base`; the depth is bounded by the reader."""
    if not isinstance(base, dict) or not isinstance(own, dict):
        return own
    if own.get("kind", base.get("kind")) != base.get("kind"):
        return own
    merged = {}
    for key in (*base, *(key for key in own if key not in base)):
        if key not in own:
            if key == "like":
                continue
            merged[key] = base[key]
            _copy_places((*base_path, key), (*own_path, key), file)
        elif own[key] is not None or key not in base:
            merged[key] = _merge(base.get(key), own[key], (*base_path, key), (*own_path, key), file)
    return merged


def _copy_places(source: KeyPath, target: KeyPath, file: YamlFile) -> None:
    """Let an inherited value and everything below it stand where the original stands."""
    tables: tuple[dict[KeyPath, Any], ...] = (file.keys, file.values, file.texts)
    for table in tables:
        found = {path: entry for path, entry in table.items() if path[: len(source)] == source}
        table.update({target + path[len(source) :]: entry for path, entry in found.items()})
