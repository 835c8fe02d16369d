"""The schemas in docs are those of the records, and what the package reads and ships has them."""

import tomllib
from pathlib import Path

import msgspec
import pytest

from hagoromo.app.schemas import json_schema, schema_names, write_schemas
from hagoromo.errors import InputError
from hagoromo.files.record import ForeignRecord, decode, read_json
from hagoromo.matter.registry import kind_of

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
    """No validator of schemas is a dependency: the records that the schemas are made of decode the file."""
    text = path.read_text()
    kind = tomllib.loads(text)["kind"]
    named = path.parent / text.splitlines()[0].removeprefix("#:schema ")
    assert named.resolve() == (SCHEMAS / f"recipe-{kind}.json").resolve()
    table = decode(tomllib.loads(text), kind_of(kind).record, path.name)
    known = read_json(named)["$defs"][type(table).__name__]["properties"]
    assert set(tomllib.loads(text)) <= set(known) and known["kind"]["const"] == kind


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
