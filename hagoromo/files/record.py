"""Records: TOML and JSON text → plain data → typed records, with one-line messages for what is wrong in a file.

A record is a `msgspec.Struct` whose fields state type, range, unit and meaning; the JSON Schemas are made from the same
fields (`hagoromo.app.schemas`).

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
from msgspec import UNSET, Meta, UnsetType

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes, sized_file
from hagoromo.files.finite import finite_json
from hagoromo.files.record_fault import CHOICE, Steps, explained, place_of, refused
from hagoromo.files.sources import sources
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
DEEPEST = 100  # tables within tables of a file
PART_OF_KEY = rb"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""  # of TOML, with the dot behind it
DOTTED = re.compile(rb"(?m)(?:^|[\[{,])[ \t]*+(?>%s){%d}" % (PART_OF_KEY, DEEPEST))
MOST_BITS = 1023  # of a whole number, which then is a finite float
MOST_BITS_OF_ALL = math.inf  # where the type of every number is checked anyway


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


class SourceFile(ForeignRecord, frozen=True, kw_only=True):
    """A file that a result was made from."""

    name: Annotated[str, about("name of the file, after that of the folder that was given")]
    sha256: Annotated[str, about("SHA-256 of its bytes, hexadecimal")]


class WrittenBy(ForeignRecord, frozen=True, kw_only=True):
    """What wrote a file: the table `hagoromo` of the files that the package writes."""

    format_version: Annotated[Count, about("version of the file's format; 1 where it is absent")] = 1
    version: Annotated[str, about("version of the package that wrote the file")] = ""
    settings: Annotated[dict[str, Any], about("settings that the result was made with")] = {}
    seed: Annotated[Count | None, about("seed of the random numbers that the result was made with")] = None
    sources: Annotated[tuple[SourceFile, ...], about("files that the result was made from")] = ()


def written_by(
    settings: Mapping[str, Any] | None = None, seed: int | None = None, format_version: int = 1
) -> dict[str, Any]:
    """The table `hagoromo` of a file that this package writes; settings and seed: those the result was made with.

    Settings that are None were left to the package and are omitted.
    """
    stated = {key: value for key, value in (settings or {}).items() if value is not None}
    more = {"settings": stated or None, "seed": seed, "sources": sources() or None}
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
            raise InputError(f"{place_of(where, path)} must be a finite number: given {value}")
    fields = () if getattr(record, "takes_null", True) else record.__struct_fields__
    for key in fields if isinstance(data, dict) else ():
        if data.get(key, UNSET) is None:
            raise InputError(refused((key,), data, record, where))
    try:
        return msgspec.convert(data, record)
    except msgspec.ValidationError as error:
        raise InputError(explained(str(error), data, record, where)) from error


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


def with_optional(name: str, base: type[Record], keys: Mapping[str, type[Record]]) -> Any:
    """A record with the fields of `base` and some of other records, which may be absent: None then.

    keys: name of each field → a record that has it.
    """
    hints = {key: get_type_hints(source, include_extras=True)[key] | None for key, source in keys.items()}
    made = msgspec.defstruct(
        name, [(key, hint, None) for key, hint in hints.items()], bases=(base,), frozen=True, kw_only=True
    )
    made.__doc__ = base.__doc__
    return made


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
    if DOTTED.search(text):  # tomllib takes the square of its length, in time and memory
        raise InputError(f"{path} has a key of more than {DEEPEST} parts: it is damaged")
    try:
        data = tomllib.loads(text.decode("utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise InputError(f"{path} is not valid TOML: {_first_line(error)}") from error
    check_plain(data, str(path))
    return data


def read_json(path: str | Path) -> Any:
    """The object in a JSON file; `InputError` when it is missing, not valid JSON, or holds NaN or Infinity."""
    return json_value(read_bytes(sized_file(path, LARGEST_JSON, "a JSON file"), JSON_GROWTH), str(path))


def read_json_table(path: str | Path) -> dict[str, Any]:
    """The table of keys in a JSON file, as `read_json`; `InputError` also where the file holds something else."""
    record = read_json(path)
    if not isinstance(record, dict):
        raise InputError(f"{path} must hold a table of keys: given {type(record).__name__}")
    return record


def is_number(value: Any) -> bool:
    """Whether a value of plain data is a finite number; true and false, which Python takes for 1 and 0, are none."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def json_value(text: bytes | str, where: str) -> Any:
    """The value of a JSON text that came from `where`; `InputError` as `read_json`."""
    try:
        text = text.decode("utf-8-sig") if isinstance(text, bytes) else text
        data = json.loads(text, parse_constant=_refuse, object_pairs_hook=_table)
    except _TwiceStated as error:
        raise InputError(f"{where} states the key {str(error)!r} twice in one table: keep one of them") from None
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise InputError(f"{where} is not valid JSON, it may be cut off: {_first_line(error)}") from error
    check_plain(data, where)
    return data


class _TwiceStated(Exception):
    """A key that a JSON table has twice: it is not clear which value is meant."""


def _table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) != len(pairs):
        seen: set[str] = set()
        raise _TwiceStated(next(key for key, _ in pairs if key in seen or seen.add(key)))
    return table


def check_plain(data: Any, where: str, most_bits: float = MOST_BITS) -> None:
    """`InputError` for plain data that no code could use.

    Tables nested deeper than `DEEPEST`, whole numbers beyond the range of floats, and texts that are not Unicode.
    """
    for path, value in _values(data):
        if isinstance(value, int) and value.bit_length() > most_bits:
            raise InputError(
                f"{place_of(where, path)} must be a number below 1e308: given one of {value.bit_length()} bits"
            )
        if isinstance(value, str) and not value.isascii() and not _is_unicode(value):
            raise InputError(f"{place_of(where, path)} must be a text: given one that is not Unicode")
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
