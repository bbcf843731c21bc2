"""`like: NAME`: a telescope takes from an earlier one whatever it does not say itself, before validation."""

from difflib import get_close_matches

from nebosvod.mission.yaml.yamlfile import KeyPath, Problem, Tree, YamlFile, shown

MAX_TELESCOPES = 100

Aliases = dict[KeyPath, KeyPath]  # of an inherited value -> of the value it came from


def resolve_like(file: YamlFile) -> tuple[Tree, Aliases, list[Problem]]:
    """Return the tree with every `like` filled in, where they were written, and what is wrong with the names.

    A mapping is merged key by key, except that a block of another `kind` replaces the inherited one; an empty value
    (null) removes what would be inherited. An inherited value stands where its original stands.
    """
    aliases: Aliases = {}
    problems: list[Problem] = []
    tree = file.tree
    if not isinstance(tree, dict) or not isinstance(tree.get("telescopes"), list):
        return tree, aliases, problems
    rows: list[Tree] = []
    known: dict[str, int] = {}
    for i, row in enumerate(tree["telescopes"]):  # type: ignore[arg-type]
        if i < MAX_TELESCOPES and isinstance(row, dict) and row.get("like") is not None:
            base = _find(row["like"], i, known, file, problems)
            if base is not None:
                row = _merge(rows[base], row, ("telescopes", base), ("telescopes", i), aliases)
        rows.append(row)
        if isinstance(row, dict) and isinstance(row.get("name"), str):
            known.setdefault(str(row["name"]), i)
    return {**tree, "telescopes": rows}, aliases, problems


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


def _merge(base: Tree, own: Tree, base_path: KeyPath, own_path: KeyPath, aliases: Aliases) -> Tree:
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
            aliases[(*own_path, key)] = (*base_path, key)
        elif own[key] is not None or key not in base:
            merged[key] = _merge(base.get(key), own[key], (*base_path, key), (*own_path, key), aliases)
    return merged


def original(path: KeyPath, aliases: Aliases) -> KeyPath:
    """Where an inherited value was written: the path with its inherited beginning replaced, as often as needed."""
    for length in range(len(path), 0, -1):
        source = aliases.get(path[:length])
        if source is not None:
            return original(source + path[length:], aliases)
    return path
