"""Document: the viewer's script, style and data as HTML that loads nothing, under a strict content security policy."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any

from markupsafe import Markup, escape

from hagoromo.files.finite import finite_json
from hagoromo.files.sources import sources
from hagoromo.version import __version__
from hagoromo_page.publication.notes import LARGEST_FILE, LONGEST_NOTE, MOST_CORNERS, MOST_NOTES

FOLDER = "page"
PARTS = ("stack.js", "profile.js", "notes.js")  # of viewer.js, which stand where it names them
WIDE = 2.0  # width of a picture over its height, from which its controls stand below it
ABOUT = "Measured from photographs; lit as it was measured."


@dataclass(frozen=True, eq=False)
class Viewer:
    """data: what the script reads. tiles: base64 of packed planes by key. photographs: base64 of JPEGs by id.
    more: other packed data by id.
    """

    data: Mapping[str, Any]
    tiles: Mapping[str, str] = field(default_factory=dict)
    photographs: Mapping[str, str] = field(default_factory=dict)
    more: Mapping[str, str] = field(default_factory=dict)


@cache
def part(name: str) -> str:
    """A file of the viewer: viewer.js or one of its `PARTS`, viewer.css, viewer.html, page.css, or a shader (.frag)."""
    return files("hagoromo_page.publication").joinpath(FOLDER, name).read_text(encoding="utf-8")


def viewer_style() -> Markup:
    """The <style> of the viewer."""
    return Markup("<style>{}</style>").format(Markup(part("viewer.css")))


def viewer_html(viewer: Viewer, alone: bool = False) -> Markup:
    """The viewer, its data and its script. alone: whether it is the only thing on its page."""
    names = ("stack",) if "stack" in viewer.data else ("shade", "shadow")
    shaders = {name: part(f"{name}.frag") for name in names}
    limits = {"notes": MOST_NOTES, "letters": LONGEST_NOTE, "corners": MOST_CORNERS, "bytes": LARGEST_FILE}
    data = {**viewer.data, "alone": alone, "shaders": shaders, "noteLimits": limits}
    blocks = [
        ("hv-data", "application/json", finite_json(data, "the page", separators=(",", ":")).replace("<", "\\u003c"))
    ]
    blocks += [(f"hv-tile-{key}", "text/plain", text) for key, text in viewer.tiles.items()]
    blocks += [(key, "text/plain", text) for key, text in {**viewer.photographs, **viewer.more}.items()]
    held = "\n".join(f'<script type="{kind}" id="{key}">{text}</script>' for key, kind, text in blocks)
    html = part("viewer.html")
    if viewer.data["width"] > WIDE * viewer.data["height"]:
        html = html.replace('class="hv"', 'class="hv hv-wide"', 1)
    return Markup(f"{html}{held}\n<script>{script()}</script>")


@cache
def script() -> str:
    """The viewer's script: its parts as one function, which starts when it has been read."""
    body = part("viewer.js")
    for name in PARTS:
        body = body.replace(f"// <{name}>\n", part(name))
    return f'"use strict";\n(() => {{\n{body}}})();\n'


def script_hash() -> str:
    """The hash of the viewer's script, as a content security policy names it."""
    return _hash(script())


def policy(viewer: Viewer, style: str) -> str:
    """The content security policy: nothing is loaded, and no script runs but the viewer's own.

    style: the source of styles, such as a hash. A page with tiles also runs the scripts of its own folder.
    """
    own = " 'self' file:" if viewer.data.get("folder") else ""
    rules = {
        "default-src": "'none'",
        "script-src": script_hash() + own,
        "style-src": style,
        "img-src": "data:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    return "; ".join(f"{kind} {sources}" for kind, sources in rules.items())


def document(viewer: Viewer) -> str:
    """The whole page: the object, and who made it."""
    title, style = escape(str(viewer.data["title"])), part("viewer.css") + part("page.css")
    by = f"Published by Hagoromo {escape(__version__)}. This page loads nothing and sends nothing."
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy(viewer, _hash(style))}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="referrer" content="no-referrer">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<header><h1>{title}</h1><p>{escape(str(viewer.data.get("about", ABOUT)))}</p></header>
<main>
{viewer_html(viewer, alone=True)}
</main>
{_facts(viewer)}<footer>{by}{_made_from()}</footer>
</body>
</html>
"""


def _facts(viewer: Viewer) -> str:
    """What is stated of the object, such as its inventory number and who measured it."""
    rows = [f"<dt>{escape(name)}</dt><dd>{escape(said)}</dd>" for name, said in viewer.data.get("facts", ())]
    return f'<dl id="facts">{"".join(rows)}</dl>\n' if rows else ""


def _made_from() -> str:
    """The files that the page is made from, by name and SHA-256."""
    rows = [f"<li>{escape(one['name'])} <code>{one['sha256']}</code></li>" for one in sources()]
    return f"<details><summary>Made from</summary><ul>{''.join(rows)}</ul></details>" if rows else ""


def overhead(viewer: Viewer) -> int:
    """Bytes of the page without its tiles."""
    return len(document(Viewer(viewer.data, {}, viewer.photographs, viewer.more)).encode()) + 100 * len(
        viewer.data.get("tiles", ())
    )


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
