"""The pictures of the architecture: the flow of the data, and the rooms with their imports, drawn from the source.

`<!-- data flow -->` and `<!-- rooms -->` in a page are replaced by drawings. The order of the rooms is that of the
layers in pyproject.toml, sizes and imports are counted in the files, so the pictures change when the code does.
"""

from __future__ import annotations

import ast
import tomllib
from collections import Counter
from html import escape
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

from mkdocs.exceptions import PluginError

ROOT = Path(__file__).parents[2]
FLOW = (  # what is drawn: noun, what it is, the verb that makes the next one, the room of that verb
    ("photographs", "RAW, TIFF, EXR, PNG", "develop", "photograph"),
    ("Photograph", "linear, with variance", "calibrate", "calibration"),
    ("Camera, Lamps", "pose, lens, response", "measure", "measurement"),
    ("Reflectance", "materials, normals", "build", "matter"),
    ("VolumeBox", "density, axis, material", "render", "image"),
    ("Image", "geometric weights", "", ""),
)
ROW, LEFT, WIDTH, LETTERS = 48, 205, 900, 75
INK, PAPER, LINE = "currentColor", "var(--md-default-bg-color)", "var(--md-primary-fg-color)"


class Room(NamedTuple):
    """A room as it is drawn."""

    name: str
    layer: int
    summary: str
    files: int
    lines: int


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Drawings in the place of their marks."""
    for mark, draw in (("<!-- data flow -->", data_flow), ("<!-- rooms -->", rooms_and_imports)):
        if mark in markdown:
            markdown = markdown.replace(mark, draw())
    return markdown


def data_flow() -> str:
    """SVG of the nouns in the order of the flow, with the verb and the room between each two."""
    known, step, width = {room.name for room in rooms()}, 192, 138
    parts = []
    for k, (noun, what, verb, room) in enumerate(FLOW):
        x = 8 + k * step
        parts.append(
            _box(x, 40, width, 54) + _text(x + width / 2, 63, noun, "bold") + _text(x + width / 2, 82, what, "what")
        )
        if verb:
            if room not in known:
                raise PluginError(f"docs/hooks/rooms.py: the room {room!r} of the flow is not in pyproject.toml")
            middle = x + width + (step - width) / 2
            parts.append(_arrow(x + width + 4, 67, x + step - 4))
            parts.append(_text(middle, 30, verb, "verb") + _text(middle, 112, f"{room}/", "room"))
    first, last = 8 + step + width / 2, 8 + 5 * step + width / 2
    parts.append(
        f'<path d="M{last} 96 V140 H{first} V100" fill="none" stroke="{LINE}" stroke-width="1.6" '
        'marker-end="url(#head)"/>'
        + _text((first + last) / 2, 134, "expose: a photograph of the rendered scene, compared with the real one")
    )
    return _svg(8 + 5 * step + width + 8, 150, parts, "From photographs to an image: nouns, verbs and rooms")


def rooms_and_imports() -> str:
    """SVG of the rooms, commands above and files below, with a line from each room to those that it imports."""
    order, parts = rooms(), []
    names = [room.name for room in order]
    used_by_all = names[names.index("light") + 1 :]  # nearly every room imports them: no lines are drawn to these
    place = {room.name: 20 + ROW * k for k, room in enumerate(order)}
    for layer in sorted({room.layer for room in order}):
        ys = [place[room.name] for room in order if room.layer == layer]
        if len(ys) > 1:
            parts.append(
                f'<rect x="{LEFT - 8}" y="{ys[0] - 5}" width="{WIDTH - LEFT}" height="{ROW * len(ys) - 5}" rx="8" '
                f'fill="{LINE}" opacity="0.12"/>'
            )
    for (importer, imported), count in sorted(imports().items()):
        if imported not in used_by_all:
            a, b = place[importer] + 19, place[imported] + 19
            reach = LEFT - 12 - 16 * abs(b - a) / ROW
            parts.append(
                f'<path d="M{LEFT} {a} C{reach} {a} {reach} {b} {LEFT - 3} {b}" fill="none" stroke="{LINE}" '
                f'stroke-width="{min(0.6 + 0.12 * count, 4):.1f}" opacity="0.6" marker-end="url(#head)">'
                f"<title>{importer} imports {imported}: {count} times</title></path>"
            )
    for room in order:
        y, size = place[room.name], f"{room.files} file{'s' * (room.files > 1)}, {room.lines:,} lines"
        parts.append(_box(LEFT, y, 170, 38) + _text(LEFT + 85, y + 17, f"{room.name}/", "bold"))
        parts.append(_text(LEFT + 85, y + 32, size, "size"))
        summary = wrap(room.summary, LETTERS)[:2]
        first = y + 24 - 8 * (len(summary) - 1)
        parts += [_text(LEFT + 182, first + 16 * k, line, "left") for k, line in enumerate(summary)]
    return _svg(WIDTH, 24 + ROW * len(order), parts, "Rooms of the package and what each imports")


def rooms() -> list[Room]:
    """The packages beside the core, then its rooms from the commands down, with their sizes."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        contracts = tomllib.load(file)["tool"]["importlinter"]["contracts"]
    layers = [layer for contract in reversed(contracts) for layer in contract["layers"]]
    whole = [layer for layer in layers if layer != "hagoromo" and "." not in layer]  # not parts of a room
    return [_room(name.strip(), k) for k, layer in enumerate(whole) for name in layer.split("|")]


def imports() -> Counter[tuple[str, str]]:
    """How often files of one room import from another, by their import statements."""
    counts: Counter[tuple[str, str]] = Counter()
    for room in rooms():
        for path in _files(room.name):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hagoromo"):
                    package, _, rest = str(node.module).partition(".")
                    imported = rest.split(".")[0] if package == "hagoromo" else package
                    if imported != room.name:
                        counts[room.name, imported] += 1
    known = {room.name for room in rooms()}
    return Counter({pair: count for pair, count in counts.items() if pair[1] in known})


def _room(name: str, layer: int) -> Room:
    files = _files(name)
    if not files:
        raise PluginError(f"pyproject.toml lists the layer {name!r}, and there is no such room")
    texts = [path.read_text(encoding="utf-8") for path in files]
    summary = (ast.get_docstring(ast.parse(texts[0])) or "").split("\n\n")[0].replace("\n", " ")
    return Room(name, layer, summary, len(files), sum(text.count("\n") for text in texts))


def _files(room: str) -> list[Path]:
    """The files of a room, the one with its docstring first."""
    folder = ROOT / room if room.startswith("hagoromo_") else ROOT / "hagoromo" / room
    if folder.is_dir():
        return [folder / "__init__.py", *sorted(set(folder.rglob("*.py")) - {folder / "__init__.py"})]
    return [path for path in (folder.with_suffix(".py"),) if path.exists()]


def _svg(width: float, height: float, parts: list[str], title: str) -> str:
    head = (
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto" '
        f'markerUnits="userSpaceOnUse"><path d="M0 0 L8 4 L0 8 z" fill="{LINE}"/></marker></defs>'
    )
    return (
        f'<svg class="drawing" role="img" aria-label="{escape(title)}" viewBox="0 0 {width:.0f} {height:.0f}">'
        f"<title>{escape(title)}</title>{head}{''.join(parts)}</svg>"
    )


def _box(x: float, y: float, width: float, height: float) -> str:
    return (
        f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="6" fill="{PAPER}" stroke="{LINE}" '
        f'stroke-width="1.4"/>'
    )


def _arrow(x: float, y: float, to: float) -> str:
    return f'<path d="M{x} {y} H{to}" stroke="{LINE}" stroke-width="1.6" marker-end="url(#head)"/>'


def _text(x: float, y: float, text: str, style: str = "") -> str:
    plain = escape(text.replace("`", ""))  # Markdown would make HTML of code, which ends the drawing
    return f'<text x="{x:.0f}" y="{y}" class="{style or "note"}" fill="{INK}">{plain}</text>'
