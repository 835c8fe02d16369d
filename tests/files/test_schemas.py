"""The schemas in docs are those of the records, and what the package reads and ships has them."""

import tomllib
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from jsonschema import Draft202012Validator

from hagoromo.app.schemas import json_schema, schema_names, write_schemas
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import CameraRecord, read_views
from hagoromo.camera.formats.nerfstudio import read_transforms
from hagoromo.errors import InputError
from hagoromo.files.record import ForeignRecord, decode, read_json, write_json
from hagoromo.light.lamp import Lamp
from hagoromo.matter.recipe import kind_of
from hagoromo.photograph.capture import Capture, load_capture, save_capture
from hagoromo.photograph.lamp_files import load_lamps
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.transforms import CaptureRecord, FrameRecord, LampRecord
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.material.materials_file import MaterialRecord, read_materials, write_materials
from hagoromo.version import __version__

ROOT = Path(__file__).parents[2]
SCHEMAS = ROOT / "docs" / "schemas"
RECIPES = sorted((ROOT / "examples" / "recipes").glob("*.toml"))


def test_the_schemas_in_docs_are_those_of_the_records(tmp_path):
    """`make schemas` writes them."""
    written = {path.name: path.read_text() for path in write_schemas(tmp_path)}
    assert {path.name: path.read_text() for path in SCHEMAS.glob("*.json")} == written


@pytest.mark.parametrize("kind", schema_names())
def test_every_field_says_what_it_is_and_every_reference_leads_somewhere(kind):
    schema = json_schema(kind)
    assert schema["$schema"].endswith("2020-12/schema")
    names = set(schema["$defs"])
    for name, table in schema["$defs"].items():
        assert table.get("description"), name
        for key, field in table["properties"].items():
            tag = list(field) == ["enum"] and len(field["enum"]) == 1  # which of several records it is
            assert tag or field.get("description") or name == "Identifiable", f"{name}: {key}"
    text = msgspec.json.encode(schema).decode()
    assert {part.split('"')[0] for part in text.split("#/$defs/")[1:]} <= names


@pytest.mark.parametrize("path", RECIPES, ids=lambda path: path.stem)
def test_a_recipe_names_its_schema_and_its_tables_are_records(path):
    """The file is valid by its schema, and the record that the schema is made of decodes it."""
    text = path.read_text()
    kind = tomllib.loads(text)["kind"]
    named = path.parent / text.splitlines()[0].removeprefix("#:schema ")
    assert named.resolve() == (SCHEMAS / f"recipe-{kind}.json").resolve()
    table = decode(tomllib.loads(text), kind_of(kind).record, path.name)
    known = read_json(named)["$defs"][type(table).__name__]["properties"]
    assert set(tomllib.loads(text)) <= set(known) and known["kind"]["const"] == kind
    assert faults(f"recipe-{kind}", tomllib.loads(text)) == []


@pytest.mark.parametrize(("key", "value"), [("threads_per_cm", "many"), ("crimp", [1]), ("wheft", {})])
def test_a_schema_refuses_what_the_reader_refuses(key, value):
    """The validator judges: a wrong type and an unknown key are faults."""
    recipe = tomllib.loads((ROOT / "examples" / "recipes" / "linen.toml").read_text())
    assert faults("recipe-cloth", recipe | {key: value})


def faults(kind: str, record: Any) -> list[str]:
    """What the JSON Schema of a kind of file finds wrong in a record."""
    validator = Draft202012Validator(json_schema(kind))
    validator.check_schema(json_schema(kind))
    return [f"{error.json_path}: {error.message}" for error in validator.iter_errors(record)]


def test_a_kind_of_another_package_has_a_schema():
    assert json_schema("recipe-figure")["$defs"]["FigureTable"]["properties"]["figure"]["enum"] == ["angel", "nun"]


def test_an_unknown_kind_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="no kind of file is called 'cloth': choose one of transforms, camera, lamps"):
        json_schema("cloth")


def test_null_is_in_a_schema_only_where_it_is_read():
    def nulls(kind: str, table: str) -> set[str]:
        fields = json_schema(kind)["$defs"][table]["properties"]
        return {key for key, field in fields.items() if {"type": "null"} in field.get("anyOf", [])}

    assert nulls("scene", "SceneCamera") == set()
    assert "gloss" in nulls("materials", "MaterialRecord")
    assert ForeignRecord.takes_null is False


def known(kind: str, record: type) -> set[str]:
    """The keys that the schema of a kind of file has for a table."""
    return set(json_schema(kind)["$defs"][record.__name__]["properties"])


def material() -> MaterialEstimate:
    """An estimate, as `measure` gives it, with a bound that is open."""
    names: list[str] = ["alpha", "beta", "gamma", "n", "specular_albedo"]
    intervals = dict.fromkeys(names, (0.1, float("inf"))) | {"body_colour": ((0.1, 0.2),) * 3}
    known_errors = dict.fromkeys(names, 0.1) | {"body_colour": (0.1,) * 3}
    identifiable = dict.fromkeys(names[:4], True)
    row = (1.0, None, None, None)
    values = (0.2, 0.1, 0.3, 1.5, 0.05)
    return MaterialEstimate(
        "silk", 7, (1.0,) * 3, (1.0,) * 3, *values, known_errors, intervals, (row,) * 4, identifiable, chi_square=1.0
    )


def write_capture(folder: Path) -> Path:
    """A capture of one photograph under one lamp."""
    values = np.full((5, 7, 3), 0.5, np.float32)
    camera = Camera(7, 5, (20.0, 20.0), (3.5, 2.5)).look_at((0, -1, 0), (0, 0, 0))
    shot = Photograph(values, values, np.ones((5, 7), bool), camera, (Lamp(position=(1, 2, 3), name="left"),), "one")
    return save_capture(Capture((shot,), "test"), folder)


def test_what_the_package_writes_has_its_schema_and_names_its_version(tmp_path):
    record = read_json(write_capture(tmp_path / "capture") / "transforms.json")
    assert set(record) <= known("transforms", CaptureRecord)
    assert set(record["frames"][0]) <= known("transforms", FrameRecord)
    assert set(record["lamps"][0]) <= known("transforms", LampRecord)
    (entry,) = read_json(write_materials([material()], tmp_path / "materials.json"))
    assert set(entry) == known("materials", MaterialRecord)
    assert faults("transforms", record) == [] and faults("materials", [entry]) == []
    for written in (record, entry):
        assert written["hagoromo"] == {"format_version": 1, "version": __version__}


LENS = {"w": 7, "h": 5, "fl_x": 20.0, "fl_y": 20.0, "cx": 3.5, "cy": 2.5, "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0}


@pytest.mark.parametrize("name", ["transforms.json", "views.json", "materials.json", "camera.json", "lamps.json"])
def test_a_file_without_a_version_is_read_and_one_of_a_newer_version_refused(tmp_path, name):
    """Even where the newer file has keys that this version does not know, or lacks those that it needs."""
    readers = {"views.json": read_transforms, "materials.json": read_materials, "lamps.json": load_lamps}
    path, read = tmp_path / name, readers.get(name, read_views)
    if name == "transforms.json":
        path, read = write_capture(tmp_path / "capture") / name, lambda path: load_capture(path.parent)
    elif name == "views.json":
        pose = np.eye(4).tolist()
        write_json(path, {**LENS, "frames": [{"file_path": "a.png", "transform_matrix": pose}]})
    elif name == "materials.json":
        write_materials([material()], path)
    elif name == "camera.json":
        write_json(path, LENS)
    else:
        write_json(path, {"lamps": [{"to_lamp": [0, 0, 1]}]})
    record = read_json(path)
    table = record[0] if isinstance(record, list) else record
    table.pop("hagoromo", None)
    write_json(path, record)
    assert read(path)
    table |= {"hagoromo": {"format_version": 2}, "unheard_of": 1}
    write_json(path, record)
    with pytest.raises(InputError, match="has format version 2: this package reads up to 1, update Hagoromo"):
        read(path)


def test_the_record_of_a_camera_is_that_of_its_schema():
    assert set(LENS) <= known("camera", CameraRecord)


@pytest.mark.parametrize("kind", schema_names())
def test_descriptions_have_no_indentation(kind):
    """That of the source stays in a docstring up to Python 3.12, and is gone in later ones."""
    tables = json_schema(kind)["$defs"].values()
    assert not any("\n  " in table.get("description", "") for table in tables)
