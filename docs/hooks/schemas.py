"""The page of the fields of all files, made from the JSON Schemas in docs/schemas: name, type, default, unit, meaning.

`<!-- schemas -->` in a page becomes the list of the schemas. What a field may hold is said in words: "number above 0".
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from posixpath import relpath
from typing import Any

from mkdocs.structure.files import File

FOLDER = Path(__file__).parents[1] / "schemas"
PAGE, MARK = "reference/fields.md", "<!-- schemas -->"
HEAD = """# Fields of files

Each file in JSON or TOML, field by field, from the same records that the program reads and writes. First the files,
then the tables that they share. A field without a default is required.
"""
PLURALS = {"number": "numbers", "string": "strings", "integer": "integers", "boolean": "booleans"}
LARGEST = 2**32 - 1  # of a count: no bound that a reader must know
BOUNDS = {"minimum": "from", "maximum": "up to", "exclusiveMinimum": "above", "exclusiveMaximum": "below"}


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """Add the page of fields."""
    files.append(File.generated(config, PAGE, content=page()))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The page with the list of schemas in place of its mark."""
    here = page.file.src_uri.rpartition("/")[0] or "."
    rows = [
        f"| [{name}]({relpath(PAGE, here)}#{name}) | [`{name}.json`]({relpath(f'schemas/{name}.json', here)}) |"
        for name in schemas()
    ]
    return markdown.replace(MARK, "\n".join(["| fields | schema |", "|---|---|", *rows]))


def page() -> str:
    """A section per file, then one per table that a file refers to."""
    parts, tables = [HEAD], {}
    for name, schema in schemas().items():
        tables |= schema.get("$defs", {})
        top = schema.get("items", schema)
        root = str(top.get("$ref", "")).rpartition("/")[2]
        said = "A list; each entry is this table. " if "items" in schema else ""
        parts.append(f"## {name} {{ #{name} }}\n\n{said}{fields(schema['$defs'][root])}")
        tables[root] = {}
    shared = {name: table for name, table in sorted(tables.items()) if table}
    parts.append("## Shared tables { #tables }\n")
    parts += [f"### {name} {{ #{name} }}\n\n{fields(table)}" for name, table in shared.items()]
    return "\n\n".join(parts) + "\n"


def fields(table: dict[str, Any]) -> str:
    """What a table is, and a row per field."""
    rows, required = ["| field | holds | default | meaning |", "|---|---|---|---|"], table.get("required", [])
    for name, field in table.get("properties", {}).items():
        value = field.get("default")
        default = (
            "none" if value is None else "as it states" if isinstance(value, dict) and value else json.dumps(value)
        )
        default = "" if name in required else f"`{default}`" if default[0] in '"[{-0123456789' else default
        rows.append(f"| `{name}` | {holds(field)} | {default} | {_cell(field.get('description', ''))} |")
    return f"{table.get('description', '')}\n\n" + "\n".join(rows)


def holds(field: dict[str, Any]) -> str:
    """In words what values a field takes."""
    if "$ref" in field:
        name = field["$ref"].rpartition("/")[2]
        return f"[{name}](#{_anchor(name)})"
    if "anyOf" in field:
        return " or ".join(dict.fromkeys(holds(one) for one in field["anyOf"] if one.get("type") != "null"))
    if "enum" in field or "const" in field:
        return " or ".join(f"`{json.dumps(value)}`" for value in field.get("enum", [field.get("const")]))
    kind = field.get("type", "anything")
    if kind == "array":
        return _array(field)
    if kind == "object":
        values = field.get("additionalProperties")
        return f"table of {holds(values)}" if isinstance(values, dict) and values else "table"
    bounds = [f"{word} {field[key]:g}" for key, word in BOUNDS.items() if abs(field.get(key, LARGEST)) < LARGEST]
    return " ".join([str(kind), *bounds])


def _array(field: dict[str, Any]) -> str:
    entries = field.get("prefixItems")
    if entries:
        one = holds(entries[0])
        return f"{len(entries)} {PLURALS.get(one, f'of {one}')}"
    one = holds(field.get("items") or {})
    fixed = "minItems" in field and field["minItems"] == field.get("maxItems")
    return (f"{field['minItems']} " if fixed else "list of ") + PLURALS.get(one, one)


def _anchor(name: str) -> str:
    """Where a table stands: that of a file under the file's name."""
    roots = {str(s.get("items", s).get("$ref", "")).rpartition("/")[2]: file for file, s in schemas().items()}
    return roots.get(name, name)


def _cell(text: str) -> str:
    """Text in a cell of a table; a unit in brackets after a list in brackets is no link."""
    return text.replace("|", "\\|").replace("[", "\\[").replace("\n", " ")


@cache
def schemas() -> dict[str, dict[str, Any]]:
    """Name → schema of every file."""
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(FOLDER.glob("*.json"))}
