"""Stage: a command whose arguments are addresses in a store runs on copies on disk, and its result is put there.

Volume boxes (NAME.zarr) that are read are no copies: their chunks are fetched from the store. The result is whole on
disk before any of it is put.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.content import named_by
from hagoromo.files.sources import made_from

_addresses: dict[Path, str] = {}  # folder on disk → address of the store that its content goes to


def run_staged(function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Call a command; arguments that are addresses of a store are replaced by paths on disk."""
    arguments = inspect.signature(function).bind(*args, **kwargs).arguments
    if not any(_in_store(value) for value in arguments.values()):
        return _called(function, arguments)
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
            return _called(function, arguments)
        written = home / "out"
        written.mkdir()
        _addresses[written] = str(_address(out)).rpartition("/")[0]
        stack.callback(_addresses.pop, written)
        status = _called(function, arguments | {"out": written / out.name})
        for made in sorted(written.iterdir(), key=lambda path: path.name == out.name):
            if not made.name.startswith("."):
                put(made, out.parent / made.name)
        return status


def _called(function: Callable[..., Any], arguments: dict[str, Any]) -> Any:
    """Call a command, whose results state the files that it is given as their sources."""
    with made_from([path for name, value in arguments.items() if name != "out" for path in _paths(value)]):
        return function(**arguments)


def _paths(value: Any) -> Iterator[Path]:
    """The paths in an argument, and what TOML files among them name."""
    if isinstance(value, Path):
        yield value
        if value.suffix == ".toml" and not _in_store(value):
            with suppress(InputError):  # the command that reads the file says what is wrong with it
                yield from (path for label, path in named_by(value) if label)
    elif isinstance(value, (tuple, list)):
        for one in value:
            yield from _paths(one)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            yield from _paths(getattr(value, field.name))


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
