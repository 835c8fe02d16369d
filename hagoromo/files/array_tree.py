"""Array tree: records of arrays, numbers and texts in one file (.npz); no program can come from it, as from a pickle.

The structure is JSON, the arrays lie beside it. Read are records of the type that the reader names, and of those that
its fields name in turn; they are made by their constructors. What is read has the bits of what was written.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.memory import require
from hagoromo.files.reading import reading

TREE = "tree"  # name of the array that holds the text of the structure
Arrays = dict[str, NDArray[Any]]
T = TypeVar("T")


def write_tree(path: Path, value: Any) -> None:
    """Write records (dataclasses, named tuples) of arrays, numbers, texts, paths, enumerations, tables and tuples."""
    arrays = _Arrays()
    text = json.dumps(_plain(value, arrays)).encode()
    with path.open("wb") as file:
        tree = {TREE: np.frombuffer(text, np.uint8)}
        np.savez(file, allow_pickle=False, **arrays.named, **tree)  # type: ignore[arg-type]


def read_tree(path: Path, root: type[T]) -> T:
    """The record of type `root` that `write_tree` wrote; `InputError` for a file that holds none, or other types."""
    require(2.0 * existing_file(path).stat().st_size, str(path))
    with reading(path, "records and arrays"):
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        value = _made(json.loads(arrays.pop(TREE).tobytes()), arrays, _types_of(root))
    if not isinstance(value, root):
        raise InputError(f"{path} holds no {root.__name__}")
    return value


def digest_of_tree(value: Any) -> str:
    """Digest of a value that `write_tree` takes, or of a list of such: equal where all its parts have the same bits."""
    state = hashlib.sha256()
    for part in _parts(value):
        state.update(part)
    return state.hexdigest()


def _parts(value: Any) -> Iterator[bytes | memoryview]:
    """Bytes of a value, from which it could be made again."""
    if isinstance(value, (np.ndarray, np.generic)):
        array = np.ascontiguousarray(value)
        if array.dtype.hasobject:
            raise TypeError("an array of objects is no part of a tree of arrays")
        yield f"array {array.dtype.str} {np.shape(value)} ".encode()
        yield array.reshape(-1).view(np.uint8).data
    elif isinstance(value, Enum):
        yield f"enum {_name(type(value))} {value.name} ".encode()
    elif _is_record(type(value)):
        yield f"record {_name(type(value))} ".encode()
        yield from _parts({name: getattr(value, name) for name in _fields(type(value))})
    elif isinstance(value, (tuple, list)):
        yield f"{len(value)} of ".encode()
        for one in value:
            yield from _parts(one)
    elif isinstance(value, dict) and all(isinstance(key, str) for key in value):
        yield f"table {len(value)} of ".encode()
        for key in sorted(value):
            yield from _parts(key)
            yield from _parts(value[key])
    elif value is None or isinstance(value, (bool, int, float, str, Path)):
        text = f"{type(value).__name__} {value!r}".encode()
        yield f"{len(text)} ".encode() + text
    else:
        raise TypeError(f"{type(value)} is no part of a tree of arrays")


class _Arrays:
    """The arrays of a tree by name, each once, however often it stands there."""

    def __init__(self) -> None:
        self.named: Arrays = {}
        self.names: dict[int, str] = {}

    def name_of(self, array: NDArray[Any]) -> str:
        """The name of an array, which is taken in."""
        name = self.names.setdefault(id(array), f"a{len(self.names)}")
        self.named[name] = array
        return name


def _plain(value: Any, arrays: _Arrays) -> Any:
    """The value as JSON; its arrays are put into `arrays`."""
    if isinstance(value, np.ndarray):
        return {"array": arrays.name_of(value)}
    if isinstance(value, np.generic):
        return {"number": arrays.name_of(np.asarray(value))}
    if isinstance(value, Enum):
        return {"enum": _name(type(value)), "is": value.name}
    if _is_record(type(value)):
        fields = {name: _plain(getattr(value, name), arrays) for name in _fields(type(value))}
        return {"record": _name(type(value)), "fields": fields}
    if isinstance(value, tuple):
        return {"tuple": [_plain(one, arrays) for one in value]}
    if isinstance(value, dict) and all(isinstance(key, str) for key in value):
        return {"table": {key: _plain(one, arrays) for key, one in value.items()}}
    if isinstance(value, Path):
        return {"path": str(value)}
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"{type(value)} is no part of a tree of arrays")


def _made(tree: Any, arrays: Arrays, types: Mapping[str, type]) -> Any:
    """What `_plain` was given, from its tree."""
    match tree:
        case {"array": name}:
            return arrays[name]
        case {"number": name}:
            return arrays[name][()]
        case {"enum": name, "is": member}:
            return types[name][member]  # type: ignore[index]
        case {"record": name, "fields": fields}:
            return types[name](**{key: _made(one, arrays, types) for key, one in fields.items()})
        case {"tuple": parts}:
            return tuple(_made(one, arrays, types) for one in parts)
        case {"table": table}:
            return {key: _made(one, arrays, types) for key, one in table.items()}
        case {"path": text}:
            return Path(text)
    return tree


def _types_of(root: type) -> dict[str, type]:
    """The records and enumerations that a value of type `root` is made of, by name."""
    found: dict[str, type] = {}
    pending: list[Any] = [root]
    while pending:
        one = pending.pop()
        pending += get_args(one)
        if isinstance(one, type) and (_is_record(one) or issubclass(one, Enum)) and _name(one) not in found:
            found[_name(one)] = one
            pending += get_type_hints(one).values() if _is_record(one) else ()
    return found


def _is_record(kind: type) -> bool:
    return dataclasses.is_dataclass(kind) or (issubclass(kind, tuple) and hasattr(kind, "_fields"))


def _fields(kind: Any) -> tuple[str, ...]:
    """Names of the arguments of a record's constructor."""
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind) if field.init)
    return kind._fields


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"
