"""Records: TOML and JSON text → plain data → typed records, with one-line messages for what is wrong in a file.

A record is a `msgspec.Struct` whose fields state type, range, unit and meaning; the JSON Schemas are made from the same
fields (`hagoromo.files.schema`).

    class Slab(Record, kw_only=True):
        voxel_size: Annotated[Positive, about("edge of a voxel [m]")]
        name: Annotated[str, about("what messages call it")] = "slab"

    decode(read_toml("slab.toml"), Slab, "slab.toml")
"""

from __future__ import annotations

import functools
import json
import math
import operator
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar, get_type_hints

import msgspec
from msgspec import UNSET, Meta, UnsetType, inspect

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes, sized_file
from hagoromo.files.finite import finite_json
from hagoromo.files.whole import whole_file, write_text
from hagoromo.version import __version__

LARGEST_NUMBER = 1e15  # of sizes, counts per length and the like: what is beyond is a slip, and overflows soon
Positive = Annotated[float, Meta(gt=0, le=LARGEST_NUMBER)]
NotNegative = Annotated[float, Meta(ge=0, le=LARGEST_NUMBER)]
Share = Annotated[float, Meta(ge=0, lt=1)]
Fraction = Annotated[float, Meta(ge=0, le=1)]
Count = Annotated[int, Meta(ge=0, le=2**32 - 1)]
Pair = tuple[float, float]
Vector = tuple[float, float, float]
Matrix = Annotated[tuple[float, ...], Meta(min_length=16, max_length=16)]  # 4 × 4, by rows
REFERENCE = "#/$defs/"
LARGEST_TOML, LARGEST_JSON = 1 << 24, 1 << 28  # bytes
TOML_GROWTH, JSON_GROWTH = 100.0, 30.0  # memory of the tables of a file, in its sizes: those of its shortest values
CHOICE = "^(?:"  # start of the pattern of `one_of`
DEEPEST = 100  # tables within tables of a file
MOST_BITS = 1023  # of a whole number, which then is a finite float
MOST_BITS_OF_ALL = math.inf  # where the type of every number is checked anyway
PATH_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]")  # of the paths in msgspec's messages, such as $.lamp[0].name


def about(text: str) -> Meta:
    """The meaning of a field, with its unit in brackets: the description in its JSON Schema."""
    return Meta(description=text)


def from_to(least: int, most: int) -> Meta:
    """Constraint: from `least` to `most`; of counts that decide how much memory or time a file takes."""
    return Meta(ge=least, le=most)


def up_to(most: int) -> Meta:
    """Constraint: a list of at most `most` entries."""
    return Meta(max_length=most)


def like(*records: type, **other: Any) -> Meta:
    """The JSON Schema of a field of plain data that a later step decodes as one of `records`.

    other: schemas that the data may have besides, by any name, such as `number={"type": "number"}`.
    """
    LATER.update({record.__name__: record for record in records})
    schemas = [*other.values(), *({"$ref": REFERENCE + record.__name__} for record in records)]
    return Meta(extra_json_schema=schemas[0] if len(schemas) == 1 else {"anyOf": schemas})


R = TypeVar("R", bound="ForeignRecord")
LATER: dict[str, type] = {}  # records named by `like`, for the schemas


class ForeignRecord(msgspec.Struct, frozen=True):
    """A table of a file that other programs write too: unknown keys are ignored.

    version_key: key of the format version in the file, "" for a table without its own version; files without it have
    version 1. newest_version: newest version that can be read. old_names: name of a key in old files → present name.
    takes_null: whether null means the same as a missing key.
    """

    version_key: ClassVar[str] = ""
    newest_version: ClassVar[int] = 1
    old_names: ClassVar[Mapping[str, str]] = {}
    takes_null: ClassVar[bool] = False


class Record(ForeignRecord, frozen=True, forbid_unknown_fields=True):
    """A table of a file of this package: an unknown key is an error."""


class WrittenBy(ForeignRecord, frozen=True, kw_only=True):
    """What wrote a file: the table `hagoromo` of the files that the package writes."""

    format_version: Annotated[Count, about("version of the file's format; 1 where it is absent")] = 1
    version: Annotated[str, about("version of the package that wrote the file")] = ""
    settings: Annotated[dict[str, Any], about("settings that the result was made with")] = {}
    seed: Annotated[Count | None, about("seed of the random numbers that the result was made with")] = None


def written_by(
    settings: Mapping[str, Any] | None = None, seed: int | None = None, format_version: int = 1
) -> dict[str, Any]:
    """The table `hagoromo` of a file that this package writes; settings and seed: those the result was made with.

    Settings that are None were left to the package and are omitted.
    """
    stated = {key: value for key, value in (settings or {}).items() if value is not None}
    more = {"settings": stated or None, "seed": seed}
    known = {key: value for key, value in more.items() if value is not None}
    return {"format_version": format_version, "version": __version__, **known}


def decode(data: Any, record: type[R], where: str) -> R:
    """Plain data as a `record`. where: file and table, named in messages.

    `InputError` for a missing key, a value of another type or out of range, NaN or infinity, an unknown key of a
    `Record`, and a file of a newer version of its format.
    """
    if isinstance(data, Mapping):
        data = current(data, record, where)
    check_plain(data, where, MOST_BITS_OF_ALL)
    for path, value in _values(data):
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"{_place(where, path)} must be a finite number: given {value}")
    fields = () if getattr(record, "takes_null", True) else record.__struct_fields__
    for key in fields if isinstance(data, dict) else ():
        if data.get(key, UNSET) is None:
            raise InputError(_refused((key,), data, record, where))
    try:
        return msgspec.convert(data, record)
    except msgspec.ValidationError as error:
        raise InputError(_explained(str(error), data, record, where)) from error


def decode_one(data: Any, records: tuple[type[R], ...], where: str) -> R:
    """Plain data as one of several `records`, named by a key such as `form = "sphere"`; see `decode`."""
    return decode(data, functools.reduce(operator.or_, records), where)


def current(data: Mapping[str, Any], record: type, where: str) -> dict[str, Any]:
    """The table with old keys renamed, after a check of its version."""
    old = getattr(record, "old_names", {})
    renamed: dict[str, Any] = {}
    for key, value in data.items():
        name = old.get(key, key)
        if name in renamed:
            raise InputError(f"{where} has {name!r} twice, once by its old name: keep one")
        renamed[name] = value
    version: Any = renamed
    for key in filter(None, getattr(record, "version_key", "").split(".")):
        version = version.get(key, 1) if isinstance(version, Mapping) else version
    newest = getattr(record, "newest_version", 1)
    if type(version) is int and version > newest:
        raise InputError(f"{where} has format version {version}: this package reads up to {newest}, update Hagoromo")
    return renamed


def one_of(*names: str) -> Meta:
    """Constraint: one of these texts; an editor offers them in this order."""
    pattern = CHOICE + "|".join(map(re.escape, names)) + ")$"
    return Meta(pattern=pattern, extra_json_schema={"enum": list(names)})


def optional(name: str, source: type) -> Any:
    """A record with the fields of `source` (a record or a NamedTuple), all of them optional.

    `given` returns the fields that a table contains.
    """
    hints = get_type_hints(source, include_extras=True)
    names = getattr(source, "_fields", None) or getattr(source, "__struct_fields__", ())
    fields = [(key, hints[key] | UnsetType, UNSET) for key in names]
    made = msgspec.defstruct(name, fields, bases=(Record,), frozen=True, kw_only=True)
    made.__doc__ = source.__doc__
    return made


def extended(name: str, base: type, source: type) -> Any:
    """The record `base` extended by the fields of a NamedTuple, with their defaults."""
    hints, defaults = get_type_hints(source, include_extras=True), getattr(source, "_field_defaults", {})
    made = msgspec.defstruct(
        name, [(key, hints[key], value) for key, value in defaults.items()], bases=(base,), frozen=True, kw_only=True
    )
    made.__doc__ = base.__doc__
    return made


def given(record: Any) -> dict[str, Any]:
    """The fields of an `optional` record that its table contains."""
    values = {name: getattr(record, name) for name in record.__struct_fields__}
    return {name: value for name, value in values.items() if value is not UNSET}


def read_toml(path: str | Path) -> dict[str, Any]:
    """The tables of a TOML file; `InputError` when it is missing or not valid TOML."""
    text = read_bytes(sized_file(path, LARGEST_TOML, "a TOML file"), TOML_GROWTH)
    try:
        data = tomllib.loads(text.decode("utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise InputError(f"{path} is not valid TOML: {_first_line(error)}") from error
    check_plain(data, str(path))
    return data


def read_json(path: str | Path) -> Any:
    """The object in a JSON file; `InputError` when it is missing, not valid JSON, or holds NaN or Infinity."""
    return json_value(read_bytes(sized_file(path, LARGEST_JSON, "a JSON file"), JSON_GROWTH), str(path))


def json_value(text: bytes | str, where: str) -> Any:
    """The value of a JSON text that came from `where`; `InputError` as `read_json`."""
    try:
        text = text.decode("utf-8-sig") if isinstance(text, bytes) else text
        data = json.loads(text, parse_constant=_refuse)
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise InputError(f"{where} is not valid JSON, it may be cut off: {_first_line(error)}") from error
    check_plain(data, where)
    return data


def check_plain(data: Any, where: str, most_bits: float = MOST_BITS) -> None:
    """`InputError` for plain data that no code could use.

    Tables nested deeper than `DEEPEST`, whole numbers beyond the range of floats, and texts that are not Unicode.
    """
    for path, value in _values(data):
        if isinstance(value, int) and value.bit_length() > most_bits:
            raise InputError(
                f"{_place(where, path)} must be a number below 1e308: given one of {value.bit_length()} bits"
            )
        if isinstance(value, str) and not value.isascii() and not _is_unicode(value):
            raise InputError(f"{_place(where, path)} must be a text: given one that is not Unicode")
        if len(path) > DEEPEST:
            raise InputError(f"{where} nests deeper than {DEEPEST} tables or lists: it is damaged")


def write_json(path: str | Path, record: Any) -> None:
    """Write `record` as indented JSON, whole or not at all; what is there is replaced.

    `InputError` for NaN, Infinity or a value that JSON cannot represent.
    """
    write_text(path, finite_json(record, Path(path).name, indent=1) + "\n")


def save_json(path: str | Path, record: Any, force: bool = False) -> Path:
    """Write `record` as indented JSON, whole or not at all; `InputError` where `path` exists without `force`."""
    with whole_file(path, force) as partial:
        write_json(partial, record)
    return Path(path)


Steps = tuple[str | int, ...]


def _explained(message: str, data: Any, record: type, where: str) -> str:
    """One line for a message of msgspec: its path and key, with the type and range from the record."""
    text, _, path = message.partition(" - at `$")
    steps: Steps = tuple(
        name or (int(index) if index.isdigit() else index) for name, index in PATH_STEP.findall(path.rstrip("`"))
    )
    key = re.fullmatch(r"Object (contains unknown|missing required) field `(.*)`", text)
    if key:
        place, table = _place(where, steps), _type_at(record, data, steps)
        if key[1].startswith("missing"):
            return f"{place} lacks the key {key[2]!r}: add it"
        return f"{place} has the unknown key {key[2]!r}: known are {', '.join(_keys(table))}"
    if not re.match("Expected|Invalid|Number out|Integer value", text):
        return f"{_place(where, steps)}: {text}"  # message of a record's own check
    while steps and not isinstance(steps[-1], str) and not _is_table(_type_at(record, data, steps)):
        steps = steps[:-1]  # the message is about the whole list
    return _refused(steps, data, record, where)


def _refused(steps: Steps, data: Any, record: type, where: str) -> str:
    shown = repr(_value_at(data, steps))
    wanted = _wanted(_type_at(record, data, steps))
    return f"{_place(where, steps)} must be {wanted}: given {shown if len(shown) <= 60 else shown[:57] + '...'}"


def _place(where: str, steps: Steps) -> str:
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
            if step not in fields:  # the key that tells which record of a union it is
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
    names = {inspect.StrType: "a text", inspect.BoolType: "true or false"}
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


def _values(data: Any) -> Iterator[tuple[Steps, Any]]:
    """All values in plain data, and keys, with their paths; without recursion, because files may nest deeply."""
    stack: list[tuple[Steps, Any]] = [((), data)]
    while stack:
        path, value = stack.pop()
        if isinstance(value, (Mapping, list, tuple)):
            if len(path) > DEEPEST:
                yield path, None
                continue
            entries = value.items() if isinstance(value, Mapping) else enumerate(value)
            for key, part in entries:
                if isinstance(key, str) and not key.isascii():
                    yield path, key
                stack.append(((*path, key if isinstance(key, int) else str(key)), part))
        else:
            yield path, value


def _is_unicode(text: str) -> bool:
    """Whether a text has no halves of surrogate pairs, which JSON can write and nothing can print."""
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def _first_line(error: BaseException) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not a JSON number")
