"""Sources: `docs/references.bib` → the page of references, and `[@key]` in any page → a link to its entry there."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from posixpath import relpath
from typing import Any

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

BIB = Path(__file__).parents[1] / "references.bib"
PAGE = "references.md"
ENTRY = re.compile(r"^@(\w+)\{([\w-]+),\n(.*?)^\}", re.MULTILINE | re.DOTALL)
FIELD = re.compile(r"^\s*(\w+)\s*=\s*\{(.*)\},?$", re.MULTILINE)
CITATION = re.compile(r"\[@([\w-]+)\]")
HEAD = """# References

Sources of the model, of the methods and of the figures, from [`references.bib`](references.bib). An entry without a
DOI is a book, a report, or a paper for which no source of its DOI was found.
"""


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """Add the page of references."""
    rows = [
        f'- <span id="{key}"></span>**{label(key)}.** {source(fields)}'
        for key, fields in sorted(entries().items(), key=lambda item: (item[1]["author"], item[1].get("year", "")))
    ]
    files.append(File.generated(config, PAGE, content=HEAD + "\n" + "\n".join(rows) + "\n"))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links in place of citations; a key that the bibliography does not have stops the build."""

    def link(found: re.Match[str]) -> str:
        if found[1] not in entries():
            raise PluginError(f"{page.file.src_uri}: docs/references.bib has no entry {found[1]}")
        here = page.file.src_uri.rpartition("/")[0] or "."
        return f"[{label(found[1])}]({relpath(PAGE, here)}#{found[1]})"

    return CITATION.sub(link, markdown)


@cache
def entries() -> dict[str, dict[str, str]]:
    """Key → fields (author, title, year, …) of every source."""
    text = BIB.read_text(encoding="utf-8")
    found = {key: dict(FIELD.findall(body)) for _, key, body in ENTRY.findall(text)}
    if len(found) != text.count("\n@") + text.startswith("@"):
        raise PluginError("docs/references.bib: an entry is not readable or stands twice: a field per line, } alone")
    return found


def label(key: str) -> str:
    """Author and year as a text cites them: "Klinker et al. 1988"."""
    fields = entries()[key]
    names = [author.split(",")[0] for author in fields["author"].split(" and ")]
    who = names[0] if len(names) == 1 else " and ".join(names) if len(names) == 2 else f"{names[0]} et al."
    return f"{who} {fields['year']}" if "year" in fields else who


def source(fields: dict[str, str]) -> str:
    """All that the entry says, on one line."""
    where = fields.get("journal") or fields.get("booktitle") or fields.get("publisher")
    printed = f" *{where}*" if where else ""
    volume = f" {fields['volume']}" if "volume" in fields else ""
    pages = f", {fields['pages'].replace('--', '–')}" if "pages" in fields else ""
    doi = f" [doi:{fields['doi']}](https://doi.org/{fields['doi']})" if "doi" in fields else ""
    note = f" {fields['note']}" if "note" in fields else ""
    return f"{fields['author']}: {fields['title']}.{printed}{volume}{pages}.{doi}{note}"
