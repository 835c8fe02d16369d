"""Notes on a page: numbered places, lines and areas of the picture with a text each, in W3C's Web Annotation (JSON-LD).

https://www.w3.org/TR/annotation-model/: an AnnotationPage, or a list, of annotations with a TextualBody. A place or a
rectangle is a fragment xywh=x,y,w,h, a line or an area an SVG polyline, polygon, or path of straight lines, all in
pixels of the photographs. The page itself writes and reads such files.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from msgspec import Meta

from hagoromo.errors import InputError
from hagoromo.files.record import ForeignRecord, about, decode, read_json, up_to

MOST_NOTES, LONGEST_NOTE, MOST_CORNERS = 500, 2000, 500  # notes of a page, letters of a note, corners of a line or area
LARGEST_FILE = 1 << 23  # bytes
LONGEST_SHAPE = 24000  # letters of a selector
NUMBER = r"(\d{1,7}(?:\.\d{1,20})?)"
FRAGMENT = re.compile(rf"(?:.*#)?xywh=(?:pixel:)?{NUMBER},{NUMBER},{NUMBER},{NUMBER}", re.ASCII | re.DOTALL)
SHAPE = re.compile(r"<(?:svg:)?(polygon|polyline|path|rect|circle|ellipse|line|text|image|use)\b([^<>]*)>")
TOKENS = re.compile(r"[A-Za-z]|[^A-Za-z\s,]+")  # letters of a path, and numbers
SVG = "http://www.w3.org/2000/svg"

Corner = tuple[float, float]


class Note(NamedTuple):
    """corners: one of a place, or those of a line or, closed, of an area; x, y [px] of the photographs, from the upper
    left corner of their first pixel.
    """

    corners: tuple[Corner, ...]
    text: str
    closed: bool = False


class TextBody(ForeignRecord, frozen=True):
    """What a note says."""

    value: Annotated[str, about("the text"), Meta(max_length=LONGEST_NOTE)]


class Selector(ForeignRecord, frozen=True):
    """Where a note is."""

    value: Annotated[str, about("xywh=x,y,w,h [px], or an SVG"), Meta(max_length=LONGEST_SHAPE)]


class NoteTarget(ForeignRecord, frozen=True):
    """What a note is about."""

    selector: Annotated[Selector | list[Selector], about("one, or several of the same place")]


class Annotation(ForeignRecord, frozen=True):
    """A note of the file."""

    body: Annotated[TextBody | list[TextBody], about("one text, or several")]
    target: Annotated[NoteTarget | str, about("a selector, or an address that ends in a fragment")]


class AnnotationPage(ForeignRecord, frozen=True):
    """A file of notes."""

    items: Annotated[list[Annotation], up_to(MOST_NOTES)]


def read_notes(path: str | Path, size: tuple[int, int]) -> tuple[Note, ...]:
    """The notes of a file, on photographs of `size` (width, height) [px].

    `InputError` for a file of another form, and for a note beside the photographs.
    """
    if Path(path).is_file() and Path(path).stat().st_size > LARGEST_FILE:
        raise InputError(
            f"{path} is larger than {LARGEST_FILE >> 20} MiB: notes are text, {MOST_NOTES} of them at most"
        )
    read = read_json(path)
    page = decode({"items": read} if isinstance(read, list) else read, AnnotationPage, str(path))
    found = []
    for number, one in enumerate(page.items, 1):
        corners, closed = _where(one.target, f"{path}: note {number}")
        beside = next((corner for corner in corners if corner[0] > size[0] or corner[1] > size[1]), None)
        if beside is not None:
            raise InputError(
                f"{path}: note {number} is at ({beside[0]:g}, {beside[1]:g}) px and the photographs are {size[0]} × "
                f"{size[1]} px: give the notes of this object"
            )
        text = one.body.value if isinstance(one.body, TextBody) else "\n".join(body.value for body in one.body)
        if len(text) > LONGEST_NOTE:
            raise InputError(f"{path}: note {number} has {len(text)} letters: {LONGEST_NOTE} at most")
        found.append(Note(corners, text, closed))
    return tuple(found)


def selector(note: Note) -> dict[str, Any]:
    """Where a note is, as a selector of Web Annotation."""
    if len(note.corners) == 1:
        ((x, y),) = note.corners
        return {
            "type": "FragmentSelector", "conformsTo": "http://www.w3.org/TR/media-frags/",
            "value": f"xywh=pixel:{x:g},{y:g},0,0",
        }  # fmt: skip
    shape, points = "polygon" if note.closed else "polyline", " ".join(f"{x:g},{y:g}" for x, y in note.corners)
    style = 'fill="none" stroke="#e8b04a" stroke-width="2" vector-effect="non-scaling-stroke"'
    return {"type": "SvgSelector", "value": f'<svg xmlns="{SVG}"><{shape} {style} points="{points}"/></svg>'}


def _where(target: NoteTarget | str, what: str) -> tuple[tuple[Corner, ...], bool]:
    """Corners of a note, and whether they enclose an area."""
    if isinstance(target, str):
        return _rectangle(target, what)
    given = target.selector if isinstance(target.selector, list) else [target.selector]
    drawn = next((one.value for one in given if "<" in one.value), None)  # says more than the rectangle around it
    if drawn is not None:
        return _drawing(drawn, what)
    return _rectangle(given[0].value if given else "", what)


def _rectangle(fragment: str, what: str) -> tuple[tuple[Corner, ...], bool]:
    places = FRAGMENT.fullmatch(fragment)
    if places is None:
        raise InputError(f"{what} is at {fragment[:80]!r}: it must be xywh=x,y,w,h in pixels")
    left, top, across, down = map(float, places.groups())
    if across == 0.0 and down == 0.0:
        return ((left, top),), False
    right, bottom = left + across, top + down
    return ((left, top), (right, top), (right, bottom), (left, bottom)), True


def _drawing(svg: str, what: str) -> tuple[tuple[Corner, ...], bool]:
    """The first shape of an SVG, which must be of straight lines."""
    shapes = SHAPE.findall(svg)
    name, attributes = shapes[0] if shapes else ("", "")
    drawn = re.search(rf"\b{'d' if name == 'path' else 'points'}\s*=\s*[\"']([^\"']*)[\"']", attributes)
    tokens = TOKENS.findall(drawn[1]) if drawn else []
    ends = name == "path" and tokens[-1:] in (["Z"], ["z"])
    if name == "path":
        straight = tokens[:1] == ["M"] and set(tokens[1 : len(tokens) - ends]).isdisjoint("MZz")
        tokens = [one for one in tokens if one not in ("M", "L", "Z", "z")] if straight else []
    numbers = [float(one) for one in tokens if re.fullmatch(NUMBER, one, re.ASCII)]
    if name not in ("polygon", "polyline", "path") or not numbers or len(numbers) != len(tokens) or len(numbers) % 2:
        raise InputError(
            f"{what} is drawn as {svg[:80]!r}: it must be a polygon, a polyline or a path of straight lines (M, L, Z) "
            "in pixels"
        )
    if "transform" in svg:
        raise InputError(f"{what} is drawn with a transform: its corners must be in pixels of the photographs")
    corners = tuple(zip(numbers[::2], numbers[1::2], strict=True))
    if len(corners) > MOST_CORNERS:
        raise InputError(f"{what} has {len(corners)} corners: {MOST_CORNERS} at most")
    return corners, len(corners) > 2 and (name == "polygon" or ends)
