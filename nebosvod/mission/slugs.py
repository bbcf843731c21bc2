"""Names people give, as names of files, arrays and tables."""

import re


def slug(text: str, fallback: str = "mission") -> str:
    """Text turned into a safe file name: letters, digits, dot, dash and underscore; at most 60 of them."""
    safe = "".join(letter if letter.isalnum() or letter in "._-" else "-" for letter in text)
    return safe.strip("-.")[:60].strip("-.") or fallback


def array_name(name: str) -> str:
    """A name as part of the name of an array: lower case, one underscore for anything but letters and digits."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
