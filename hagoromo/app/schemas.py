"""JSON Schemas of the files that the package reads and writes, for editors and other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.record import write_json
from hagoromo.files.schema import record_schema
from hagoromo.matter.registry import kind_names, kind_of

RECIPE_PREFIX = "recipe-"


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
    from hagoromo.app.batch.batch_file import BatchRecord
    from hagoromo.camera.formats.camera_file import CameraRecord
    from hagoromo.image.relight.prediction import PredictionRecord
    from hagoromo.image.scene_file import SceneRecord
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
