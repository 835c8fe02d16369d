"""Notes on a page: numbered places of the picture with a text each, in a file of W3C's Web Annotation (JSON-LD).

https://www.w3.org/TR/annotation-model/: an AnnotationPage whose items have a TextualBody and a fragment xywh=x,y,w,h in
pixels of the photographs; the middle of that rectangle is the place. The page itself writes and reads such files.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, NamedTuple

from msgspec import Meta

from hagoromo.errors import InputError
from hagoromo.files.record import ForeignRecord, about, decode, read_json, up_to

MOST_NOTES, LONGEST_NOTE = 500, 2000  # notes of a page, letters of a note
LARGEST_FILE = 1 << 23  # bytes
NUMBER = r"(\d{1,7}(?:\.\d{1,6})?)"
FRAGMENT = re.compile(rf"(?:.*#)?xywh=(?:pixel:)?{NUMBER},{NUMBER},{NUMBER},{NUMBER}", re.ASCII | re.DOTALL)


class Note(NamedTuple):
    """x, y: [px] of the photographs, from the upper left corner of their first pixel."""

    x: float
    y: float
    text: str


class TextBody(ForeignRecord, frozen=True):
    """What a note says."""

    value: Annotated[str, about("the text"), Meta(max_length=LONGEST_NOTE)]


class FragmentSelector(ForeignRecord, frozen=True):
    """Where a note is."""

    value: Annotated[str, about("xywh=x,y,w,h [px]"), Meta(max_length=200)]


class NoteTarget(ForeignRecord, frozen=True):
    """What a note is about."""

    selector: FragmentSelector


class Annotation(ForeignRecord, frozen=True):
    """A note of the file."""

    body: TextBody
    target: Annotated[NoteTarget | str, about("a fragment, or an address that ends in one")]


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
    found = []
    for number, one in enumerate(decode(read_json(path), AnnotationPage, str(path)).items, 1):
        fragment = one.target if isinstance(one.target, str) else one.target.selector.value
        places = FRAGMENT.fullmatch(fragment)
        if places is None:
            raise InputError(f"{path}: note {number} is at {fragment[:80]!r}: it must be xywh=x,y,w,h in pixels")
        left, top, across, down = map(float, places.groups())
        x, y = left + across / 2.0, top + down / 2.0
        if x > size[0] or y > size[1]:
            raise InputError(
                f"{path}: note {number} is at ({x:g}, {y:g}) px and the photographs are {size[0]} × {size[1]} px: give "
                "the notes of this object"
            )
        found.append(Note(x, y, one.body.value))
    return tuple(found)
