"""Stage: a command whose arguments are addresses in a store runs on copies on disk, and its result is put there.

Volume boxes (NAME.zarr) that are read are no copies: their chunks are fetched from the store. The result is whole on
disk before any of it is put.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError

_addresses: dict[Path, str] = {}  # folder on disk → address of the store that its content goes to


def run_staged(function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Call a command; arguments that are addresses of a store are replaced by paths on disk."""
    arguments = inspect.signature(function).bind(*args, **kwargs).arguments
    if not any(_in_store(value) for value in arguments.values()):
        return function(*args, **kwargs)
    from hagoromo.files.stores import check_free, put
    from hagoromo.files.whole import scratch_folder

    with ExitStack() as stack:
        out: Any = arguments.get("out")
        if _in_store(out):
            if function.__name__ == "batch":
                raise InputError(f"the results of a batch need a folder on a disk: given {_address(out)}")
            check_free(out, bool(arguments.get("force")))
        home = stack.enter_context(scratch_folder())
        for name, value in arguments.items():
            if name != "out" and _in_store(value):
                arguments[name] = tuple(_copy(one, home) for one in value) if _many(value) else _copy(value, home)
        if not _in_store(out):
            return function(**arguments)
        written = home / "out"
        written.mkdir()
        _addresses[written] = str(_address(out)).rpartition("/")[0]
        stack.callback(_addresses.pop, written)
        status = function(**(arguments | {"out": written / out.name}))
        for made in sorted(written.iterdir(), key=lambda path: path.name == out.name):
            if not made.name.startswith("."):
                put(made, out.parent / made.name)
        return status


def named(path: Path) -> str:
    """What people call a file that was written: its address where it goes to a store."""
    for folder, place in _addresses.items():
        if path.is_relative_to(folder):
            return f"{place}/{path.relative_to(folder).as_posix()}"
    return str(path)


def _copy(path: Any, home: Path) -> Any:
    """A file or folder of a store on disk; a volume box stays there."""
    from hagoromo.files.stores import fetch

    if not _in_store(path) or path.suffix == ".zarr":
        return path
    place = home / f"in{len(list(home.iterdir()))}"
    place.mkdir()
    return fetch(path, place)


def _many(value: Any) -> bool:
    return isinstance(value, tuple)


def _in_store(value: Any) -> bool:
    if _many(value):
        return any(_in_store(one) for one in value)
    return isinstance(value, Path) and _address(value) is not None


def _address(path: Path) -> str | None:
    text = str(path)
    if ":/" not in text:  # as of nearly every path, for which nothing is imported
        return None
    from hagoromo.files.stores import address

    return address(path)
