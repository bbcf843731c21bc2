"""What several missions have in common, made once: products kept by all that they are made of.

A study asks for thousands of missions that differ in few keys. Each product here is a pure function, kept under the
bytes of everything it depends on, so that sharing changes no bit of an answer.
"""

import pickle
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, TypeVar

from nebosvod.mission import Mission, Question
from nebosvod.mission.telescope import Telescope as TelescopeBlock

Product = TypeVar("Product")
KEPT = 24  # of a kind: the values of one axis of a usual grid
UNCERTAIN = frozenset({"noise", "bias", "position", "timing", "plate_scale", "like"})  # of a telescope: no geometry


class Shared:
    """Products of earlier missions, the latest of each kind.

    Parameters
    ----------
    most : how many of a kind are kept; 0 for none.
    """

    def __init__(self, most: int = KEPT) -> None:
        self._most = most
        self._kept: dict[str, OrderedDict[tuple[Any, ...], tuple[Any, tuple[object, ...]]]] = {}

    def made(
        self, kind: str, made_of: Callable[[], Any], make: Callable[[], Product], of: tuple[object, ...] = ()
    ) -> Product:
        """The product: an earlier one that is made of the same, or a new one.

        Parameters
        ----------
        made_of : what it depends on, by value.
        of : what it depends on as well: products that are the same objects.
        """
        if not self._most:
            return make()
        key, kept = (pickle.dumps(made_of()), *map(id, of)), self._kept.setdefault(kind, OrderedDict())
        if key in kept:
            kept.move_to_end(key)
            found: Product = kept[key][0]
            return found
        kept[key] = (make(), of)  # what is kept here cannot leave its id to another object
        while len(kept) > self._most:
            kept.popitem(last=False)
        found = next(reversed(kept.values()))[0]
        return found


ALONE = Shared(0)


def flown(mission: Question, span_s: tuple[float, float]) -> tuple[Any, ...]:
    """What a reference orbit over a span is made of, if it hits nothing."""
    return (
        mission.orbit,
        [(parameter.name, parameter.quantity) for parameter in mission.parameters],
        [parameter.name for parameter in mission.free_parameters],
        mission.object.nongrav_law,
        mission.object.radiation_parameters,
        mission.force_model,
        str(mission.path.parent) if mission.path is not None else None,
        mission.reference_epoch,
        span_s,
    )


def aimed(mission: Mission, telescope: TelescopeBlock) -> tuple[Any, ...]:
    """What decides where a telescope is, when it looks, and what it can see."""
    fields = {name: getattr(telescope, name) for name in type(telescope).model_fields if name not in UNCERTAIN}
    return telescope.name, fields, mission.times_s(telescope.name).tobytes(), mission.object.magnitude
