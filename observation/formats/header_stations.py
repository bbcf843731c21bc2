"""The observatory that the header of a file names, beside those that its records name."""

from collections.abc import Sequence


def unlike(file: str, line: Sequence[int], header: Sequence[str], station: Sequence[str]) -> tuple[str, ...]:
    """A notice for each observatory of a header that is not that of the records below it.

    Parameters
    ----------
    line, header, station : (n,) of each record its line, what the header above it says ("" if nothing), what it says.
    """
    found: dict[str, list[int]] = {}
    for row, (said, own) in enumerate(zip(header, station)):
        if said and own and said != own:
            found.setdefault(said, []).append(row)
    return tuple(
        _sentence(file, said, [line[row] for row in rows], {station[row] for row in rows})
        for said, rows in found.items()
    )


def _sentence(file: str, said: str, lines: list[int], own: set[str]) -> str:
    records = "1 record" if len(lines) == 1 else f"{len(lines)} records"
    names = ", ".join(sorted(own)[:5]) + (", ..." if len(own) > 5 else "")
    return (
        f"{file}: the header names observatory {said}, and {records} from line {lines[0]} on {names}; "
        "what the records say was used"
    )
