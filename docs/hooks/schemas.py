"""`<!-- schemas -->` in a page becomes a section on the JSON Schemas in docs/schemas, with what each is of."""

from __future__ import annotations

import json
from pathlib import Path
from posixpath import relpath
from typing import Any

FOLDER = Path(__file__).parents[1] / "schemas"
MARK = "<!-- schemas -->"
HEAD = """## JSON Schemas { #schemas }

Each file has a schema, made from the records that the program reads and writes. An editor checks a file by it: in TOML
by a first line `#:schema PATH`.

| schema | of |
|---|---|"""


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The page with the section in place of its mark."""
    return (
        markdown.replace(MARK, section(page.file.src_uri.rpartition("/")[0] or ".")) if MARK in markdown else markdown
    )


def section(here: str) -> str:
    """A row per schema; nothing where none has been written."""
    rows = []
    for path in sorted(FOLDER.glob("*.json")):
        schema = json.loads(path.read_text(encoding="utf-8"))
        said = str(schema.get("title") or schema.get("description") or "").split("\n")[0]
        rows.append(f"| [`{path.name}`]({relpath('schemas/' + path.name, here)}) | {said} |")
    return "\n".join([HEAD, *rows]) if rows else ""
