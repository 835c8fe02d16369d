"""What is wrong with plain data that is to be a record: one line with path, what is wanted and given.

Enters: a message of msgspec, the data and the record. What is wanted is said in words, from the types of the fields.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from msgspec import inspect

CHOICE = "^(?:"  # start of the pattern of `one_of`
PATH_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]")  # of the paths in msgspec's messages, such as $.lamp[0].name
Steps = tuple[str | int, ...]


def explained(message: str, data: Any, record: type, where: str) -> str:
    """One line for a message of msgspec: its path and key, with the type and range from the record."""
    text, _, path = message.partition(" - at `$")
    steps: Steps = tuple(
        name or (int(index) if index.isdigit() else index) for name, index in PATH_STEP.findall(path.rstrip("`"))
    )
    key = re.fullmatch(r"Object (contains unknown|missing required) field `(.*)`", text)
    if key:
        place, table = place_of(where, steps), _type_at(record, data, steps)
        if key[1].startswith("missing"):
            return f"{place} lacks the key {key[2]!r}: add it"
        return f"{place} has the unknown key {key[2]!r}: known are {', '.join(_keys(table))}"
    if not re.match("Expected|Invalid|Number out|Integer value", text):
        return f"{place_of(where, steps)}: {text}"  # message of a record's own check
    while steps and not isinstance(steps[-1], str) and not _is_table(_type_at(record, data, steps)):
        steps = steps[:-1]  # the message is about the whole list
    return refused(steps, data, record, where)


def refused(steps: Steps, data: Any, record: type, where: str) -> str:
    """One line: what the value at a path must be, and what was given."""
    shown = repr(_value_at(data, steps))
    wanted = _wanted(_type_at(record, data, steps))
    return f"{place_of(where, steps)} must be {wanted}: given {shown if len(shown) <= 60 else shown[:57] + '...'}"


def place_of(where: str, steps: Steps) -> str:
    """What a message calls the value at a path of the data from `where`."""
    path = "".join(f"[{step}]" if isinstance(step, int) or step == "..." else f".{step}" for step in steps)
    return f"{where}: {path.lstrip('.')}" if path else where


def _value_at(data: Any, steps: Steps) -> Any:
    for step in steps:
        try:
            data = data[step]
        except (KeyError, IndexError, TypeError):
            return data
    return data


def _type_at(record: type, data: Any, steps: Steps) -> inspect.Type:
    """The type of the part of a record at the path `steps`."""
    kind = _bare(inspect.type_info(record), data)
    for i, step in enumerate(steps):
        value = _value_at(data, steps[: i + 1])
        if isinstance(kind, inspect.StructType):
            fields = {field.encode_name: field.type for field in kind.fields}
            if step not in fields:  # the key that says which record of a union it is
                return inspect.LiteralType((kind.tag,))
            kind = fields[str(step)]
        elif isinstance(kind, inspect.UnionType):  # of records, by a key that none of them has
            return inspect.LiteralType(tuple(one.tag for one in kind.types if isinstance(one, inspect.StructType)))
        elif isinstance(kind, inspect.TupleType):
            kind = kind.item_types[int(step)]
        elif isinstance(kind, inspect.DictType):
            kind = kind.value_type
        else:
            kind = getattr(kind, "item_type", kind)
        kind = _bare(kind, value)
    return kind


def _bare(kind: inspect.Type, data: Any) -> inspect.Type:
    """The type without its metadata; for a union, the member that fits the form of `data`."""
    while isinstance(kind, inspect.Metadata):
        kind = kind.type
    if not isinstance(kind, inspect.UnionType):
        return kind
    types = [_bare(one, data) for one in kind.types if not isinstance(one, inspect.NoneType)]
    tables = [one for one in types if isinstance(one, inspect.StructType)]
    if isinstance(data, Mapping) and tables:
        named = [one for one in tables if one.tag is not None and data.get(str(one.tag_field)) == one.tag]
        types = named or tables
    elif isinstance(data, (list, tuple)):
        types = [one for one in types if _is_list(one)] or types
    return types[0] if len(types) == 1 else inspect.UnionType(tuple(types))


def _is_list(kind: inspect.Type) -> bool:
    return isinstance(kind, (inspect.ListType, inspect.VarTupleType, inspect.TupleType))


def _is_table(kind: inspect.Type) -> bool:
    return isinstance(kind, (inspect.StructType, inspect.DictType, inspect.UnionType))


def _keys(kind: inspect.Type) -> list[str]:
    if not isinstance(kind, inspect.StructType):
        return []
    return [*([str(kind.tag_field)] if kind.tag_field else []), *(field.encode_name for field in kind.fields)]


def _wanted(kind: inspect.Type) -> str:
    """The values that a type allows, in words."""
    if isinstance(kind, (inspect.FloatType, inspect.IntType)):
        words, limits = "a whole number" if isinstance(kind, inspect.IntType) else "a number", _range(kind)
        return words + limits if limits or words == "a whole number" else "a finite number"
    if isinstance(kind, inspect.LiteralType):
        return "one of " + ", ".join(str(value) for value in kind.values)
    if isinstance(kind, inspect.UnionType):
        return " or ".join(dict.fromkeys(_wanted(one) for one in kind.types))
    if isinstance(kind, inspect.TupleType):
        return f"a list of {len(kind.item_types)} {_plural(kind.item_types[0])}"
    if isinstance(kind, (inspect.ListType, inspect.VarTupleType)):
        least, most = kind.min_length, kind.max_length
        count = "" if not least else f"{least} " if least == most else f"{least} or more "
        count = f"at most {most} " if most and not least else count
        return f"a list of {count}{_plural(kind.item_type)}"
    if isinstance(kind, inspect.StrType) and kind.pattern:
        if not kind.pattern.startswith(CHOICE):
            return f"a text of the form {kind.pattern}"
        return "one of " + ", ".join(name.replace("\\", "") for name in kind.pattern[len(CHOICE) : -2].split("|"))
    names: dict[type, str] = {inspect.StrType: "a text", inspect.BoolType: "true or false"}
    return names.get(type(kind), "a table of keys")


def _plural(kind: inspect.Type) -> str:
    bare = _bare(kind, None)
    if isinstance(bare, inspect.FloatType):
        return f"numbers{_range(bare)}" if _range(bare) else "finite numbers"
    if isinstance(bare, inspect.IntType):
        return f"whole numbers{_range(bare)}"
    return "texts" if isinstance(bare, inspect.StrType) else "lists" if _is_list(bare) else "tables"


def _range(kind: Any) -> str:
    low = f" above {kind.gt:g}" if kind.gt is not None else "" if kind.ge is None else f" from {kind.ge:g}"
    if kind.lt is not None:
        return f"{low} to below {kind.lt:g}"
    if kind.le is not None and kind.le != 2**32 - 1:
        return f"{low} to {kind.le:g}"
    return f", {kind.ge:g} or more" if kind.ge is not None else low
