"""Kept: what is made on the device for a scene, kept while what it was made from stays the same."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

Made = TypeVar("Made")


class Kept:
    """One thing a name; it is made again only for another key, and the old one is let go first."""

    def __init__(self) -> None:
        self._things: dict[str, tuple[tuple, Any]] = {}

    def key(self, name: str) -> tuple[Any, ...]:
        """What the thing called `name` was made from; () where there is none."""
        return self._things[name][0] if name in self._things else ()

    def get(self, name: str, key: tuple[Any, ...], make: Callable[[], Made]) -> Made:
        """The thing called `name` that was made from `key`, made now if need be."""
        if self.key(name) != key:
            self._things.pop(name, None)
            self._things[name] = key, make()
        return self._things[name][1]
