"""Where in its file a mission asks for something, for errors that only a run can find."""

from collections.abc import Iterator
from contextlib import contextmanager

from nebosvod.errors import NebosvodError
from nebosvod.mission.question import Question
from nebosvod.mission.reading.explain import Explainer
from nebosvod.mission.yaml.inherit import resolve_like
from nebosvod.mission.yaml.yamlfile import KeyPath, dotted, parse_yaml, shown


def place(mission: Question, path: KeyPath) -> str:
    """`apophis.yaml:14:9: telescopes[0].orbit`: file, line and column of a key; of a mission made in Python the key."""
    if not mission.was_read:
        return dotted(path)
    file = parse_yaml(mission.text, shown(str(mission.path or mission.name)))
    tree, aliases, _ = resolve_like(file)
    mark = Explainer(file, tree, aliases).mark(path)
    return f"{file.name}:{mark.line}:{mark.column}: {dotted(path)}"


@contextmanager
def asking(mission: Question, *path: str | int) -> Iterator[None]:
    """Errors of what is done inside begin with the place of the key that asked for it."""
    try:
        yield
    except NebosvodError as error:
        error.say_place(place(mission, path))
        raise
