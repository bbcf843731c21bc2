"""Sources of uncertainty by their kind, whichever telescope they are of."""


def kind_of(source: str, telescopes: list[str]) -> str:
    """A source's name without the telescope it belongs to: `bias NEB-1` -> `bias`."""
    for name in sorted(telescopes, key=len, reverse=True):
        if source.endswith(" " + name):
            return source.removesuffix(" " + name)
    return source
