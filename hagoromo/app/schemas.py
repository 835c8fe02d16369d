"""JSON Schemas of the files that the package reads and writes, for editors and other programs."""

from __future__ import annotations

from collections.abc import Iterator
from inspect import cleandoc
from pathlib import Path
from typing import Any, get_args

import msgspec

from hagoromo.errors import InputError
from hagoromo.files.record import LATER, REFERENCE, ForeignRecord, write_json
from hagoromo.matter.recipe import kind_names, kind_of

RECIPE_PREFIX = "recipe-"
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schema_names() -> tuple[str, ...]:
    """The file types that have a schema, including the recipes of all installed kinds of matter."""
    return (*_files(), *(RECIPE_PREFIX + name for name in kind_names()))


def json_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema (2020-12) of a kind of file, such as "materials", "scene" or "recipe-cloth".

    `InputError` for a kind that is not among `schema_names`.

    >>> json_schema("recipe-cloth")["title"]
    'A woven cloth'
    """
    if kind not in schema_names():
        raise InputError(f"no kind of file is called {kind!r}: choose one of {', '.join(schema_names())}")
    if not kind.startswith(RECIPE_PREFIX):
        return record_schema(_files()[kind])
    name = kind.removeprefix(RECIPE_PREFIX)
    record = kind_of(name).record
    schema = record_schema(record)
    schema["$defs"][record.__name__]["properties"]["kind"]["const"] = name
    return schema


def write_schemas(folder: str | Path) -> tuple[Path, ...]:
    """Write the schema of every kind of file into an existing or new folder, as KIND.json; gives the paths."""
    home = Path(folder)
    paths = tuple(home / f"{kind}.json" for kind in schema_names())
    for path in paths:
        write_json(path, json_schema(path.stem))
    return paths


def _files() -> dict[str, Any]:
    from hagoromo.app.batch.batch_record import BatchRecord
    from hagoromo.camera.formats.camera_file import CameraRecord
    from hagoromo.image.relight.prediction import PredictionRecord
    from hagoromo.image.scene.scene_file import SceneRecord
    from hagoromo.measurement.material.body_spectra import BodySpectrumRecord
    from hagoromo.photograph.lamp_files import LampsRecord
    from hagoromo.photograph.rig import RigRecord
    from hagoromo.photograph.transforms import CaptureRecord
    from hagoromo.reflectance.material.materials_file import MaterialRecord
    from hagoromo.volume.store.header import BoxRecord

    return {
        "transforms": CaptureRecord,
        "camera": CameraRecord,
        "lamps": LampsRecord,
        "rig": RigRecord,
        "materials": list[MaterialRecord],
        "body_spectra": list[BodySpectrumRecord],
        "relit": list[PredictionRecord],
        "box": BoxRecord,
        "scene": SceneRecord,
        "batch": BatchRecord,
    }


def record_schema(record: Any) -> dict[str, Any]:
    """The schema of a file that holds `record`, a record or a list of records.

    `$defs` also contains tables that a later step decodes: see `hagoromo.files.record.like`.
    """
    (schema,), tables = msgspec.json.schema_components([record], ref_template=REFERENCE + "{name}")
    waiting = list(_named([schema, tables]))
    while waiting:
        name = waiting.pop()
        if name not in tables:
            _, more = msgspec.json.schema_components([LATER[name]], ref_template=REFERENCE + "{name}")
            waiting.extend(_named(more))
            tables |= {key: value for key, value in more.items() if key not in tables}
    (entry,) = get_args(record) or (record,)
    title = (entry.__doc__ or "").splitlines()[0].rstrip(".")
    takes_null = {one.__name__ for one in _records(ForeignRecord) if one.takes_null}
    for name, table in tables.items():
        if "description" in table:
            table["description"] = cleandoc(table["description"])  # Python 3.13 does so by itself
        for key, field in table["properties"].items():
            table["properties"][key] = _as_decoded(field, name in takes_null)
    return {"$schema": DIALECT, "title": title, **schema, "$defs": {key: tables[key] for key in sorted(tables)}}


def _as_decoded(field: dict[str, Any], takes_null: bool) -> dict[str, Any]:
    """The schema of a field as `decode` reads it: null only where it is allowed; a choice without its pattern."""
    if "enum" in field:
        field.pop("pattern", None)
    if takes_null or field.get("default", ...) is not None:
        return field
    known = {key: value for key, value in field.items() if key not in ("anyOf", "default")}
    choices = [_as_decoded(choice, False) for choice in field.get("anyOf", []) if choice.get("type") != "null"]
    return known | (choices[0] if len(choices) == 1 else {"anyOf": choices} if choices else {})


def _records(base: type) -> Iterator[Any]:
    for record in base.__subclasses__():
        yield record
        yield from _records(record)


def _named(part: Any) -> Iterator[str]:
    """The names of the tables that a part of a schema refers to."""
    if isinstance(part, dict):
        if isinstance(part.get("$ref"), str):
            yield part["$ref"].removeprefix(REFERENCE)
        for value in part.values():
            yield from _named(value)
    elif isinstance(part, list):
        for value in part:
            yield from _named(value)
