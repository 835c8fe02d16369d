"""Format: a row of the table of file formats: what it holds, what reads and writes it, and what is lost on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from importlib import import_module
from typing import Any, Literal

Holds = Literal[
    "volume", "box", "surface", "scene", "cameras", "picture", "lamps", "lens", "spectrum", "table", "matter", "result"
]


@dataclass(frozen=True)
class Format:
    """suffixes: in small letters; the first is what is written. reader, writer: "module:function", "" where there is
    none. library: what reads it. judge: the independent reader of the tests. lost: what a file holds and we do not
    keep, or the other way round. folder: whether it is a folder.
    """

    name: str
    holds: Holds
    suffixes: tuple[str, ...]
    reader: str = ""
    writer: str = ""
    library: str = "our own"
    judge: str = ""
    lost: str = ""
    folder: bool = False

    @property
    def read(self) -> Callable[..., Any]:
        """The function that reads a file."""
        return _named(self.reader)

    @property
    def write(self) -> Callable[..., Any]:
        """The function that writes one."""
        return _named(self.writer)


def _named(place: str) -> Callable[..., Any]:
    module, _, name = place.partition(":")
    return reduce(getattr, name.split("."), import_module(module))
