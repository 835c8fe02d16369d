"""SceneCache: what a scene needs on the device, one value per name, rebuilt when its key changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

Value = TypeVar("Value")


class SceneCache:
    """One value per name with the key that it was built from. The old value is released before the new one is built."""

    def __init__(self) -> None:
        self._entries: dict[str, tuple[tuple[Any, ...], Any]] = {}

    def key(self, name: str) -> tuple[Any, ...]:
        """The key that the value `name` was built from; () where there is none."""
        return self._entries[name][0] if name in self._entries else ()

    def get(self, name: str, key: tuple[Any, ...], build: Callable[[], Value]) -> Value:
        """The value `name`, built now unless it was built from the same `key`."""
        if self.key(name) != key:
            self._entries.pop(name, None)
            self._entries[name] = key, build()
        return self._entries[name][1]
