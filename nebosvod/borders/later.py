"""Attributes that a later room gives to the objects of an earlier one: imported when first asked for."""

from importlib import import_module
from typing import Any


class Later:
    """An attribute made by `NAME(owner)` of a module that stands further down, as figures of a mission.

    The earlier room neither imports nor needs it; without anybody who asks it is never loaded.
    """

    def __init__(self, module: str, name: str) -> None:
        self._module, self._name = module, name

    def __get__(self, owner: Any, kind: type | None = None) -> Any:
        return self if owner is None else getattr(import_module(self._module), self._name)(owner)
