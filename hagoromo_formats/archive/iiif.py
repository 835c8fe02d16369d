"""IIIF: pictures as tiles (Image API 3.0, level 0) and their manifest (Presentation API 3.0): files for any server.

https://iiif.io/api/image/3.0/, https://iiif.io/api/presentation/3.0/
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote, urlsplit

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo_formats.archive.metadata import ArchivedObject, licence_address
from hagoromo_formats.archive.profile import ArchiveProfile
from hagoromo_page.publication.notes import Note, selector

FOLDER = "iiif/"  # of the payload
MANIFEST = "manifest.json"
TILE = 512  # [px] a side
QUALITY = 90  # of JPEG
OPEN = "by", "by-sa", "by-nc", "by-nd", "by-nc-sa", "by-nc-nd"  # licences of Creative Commons
RIGHTS = {f"CC-{kind.upper()}-4.0": f"http://creativecommons.org/licenses/{kind}/4.0/" for kind in OPEN}
RIGHTS["CC0-1.0"] = "http://creativecommons.org/publicdomain/zero/1.0/"


class TiledPicture(NamedTuple):
    """name: with / for folders. place: address of its service. width, height [px]."""

    name: str
    place: str
    width: int
    height: int


def check_address(address: str) -> str:
    """The address under which the folder will be served, without / at its end; `InputError` for none."""
    parts = urlsplit(address)
    if parts.scheme not in ("http", "https") or not parts.netloc or parts.query or parts.fragment:
        raise InputError(
            f"--iiif is {address!r:.80}: give the address at which the folder iiif will be served, such as "
            "https://museum.org/iiif/1889.12"
        )
    return address.rstrip("/")


def write_tiles(name: str, pixels: NDArray[np.uint8], home: Path, address: str) -> TiledPicture:
    """Write a picture's tiles and info.json under `home`/`name`."""
    from PIL import Image

    height, width = pixels.shape[:2]
    image, place = Image.fromarray(pixels[..., 0] if pixels.shape[2] == 1 else pixels), f"{address}/{quote(name)}"
    factors = [1]
    while TILE * factors[-1] < max(width, height):  # until the picture is one tile
        factors.append(2 * factors[-1])
    sizes = []
    for factor in factors:
        small = image if factor == 1 else image.resize(_reduced(width, height, factor), Image.Resampling.LANCZOS)
        sizes.append({"width": small.width, "height": small.height})
        _save(small, home / name / "full" / f"{small.width},{small.height}")
        for left, top in _corners(small.width, small.height):
            right, bottom = min(left + TILE, small.width), min(top + TILE, small.height)
            x, y = left * factor, top * factor
            region = f"{x},{y},{min(right * factor, width) - x},{min(bottom * factor, height) - y}"
            if (x, y, right, bottom) == (0, 0, small.width, small.height):
                continue  # the whole picture
            _save(small.crop((left, top, right, bottom)), home / name / region / f"{right - left},{bottom - top}")
    _save(image, home / name / "full" / "max")
    record = {
        "@context": "http://iiif.io/api/image/3/context.json", "id": place, "type": "ImageService3",
        "protocol": "http://iiif.io/api/image", "profile": "level0", "width": width, "height": height,
        "sizes": sizes[::-1], "tiles": [{"width": TILE, "scaleFactors": factors}],
    }  # fmt: skip
    (home / name / "info.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    return TiledPicture(name, place, width, height)


def manifest(
    pictures: list[TiledPicture],
    thing: ArchivedObject,
    profile: ArchiveProfile,
    address: str,
    notes: Mapping[str, tuple[Note, ...]] | None = None,
) -> str:
    """manifest.json: one canvas a picture. notes: those on a picture, by its name; they become annotations."""
    place = f"{address}/{MANIFEST}"
    facts = [
        ("Inventory number", thing.inventory), ("Creator", profile.creator), ("Institution", profile.institution),
        ("Licence", profile.licence), ("Photographed", thing.photographed),
    ]  # fmt: skip
    record: dict[str, Any] = {
        "@context": "http://iiif.io/api/presentation/3/context.json", "id": place, "type": "Manifest",
        "label": _text(thing.title), "summary": _text(thing.description),
        "metadata": [{"label": _text(key), "value": _text(value)} for key, value in facts if value],
        "requiredStatement": {
            "label": _text("Attribution"), "value": _text(f"{profile.institution}, {profile.licence}"),
        },
        "items": [_canvas(one, place, (notes or {}).get(one.name, ())) for one in pictures],
    }  # fmt: skip
    if profile.licence in RIGHTS:
        record["rights"] = RIGHTS[profile.licence]
    else:
        record["seeAlso"] = [{"id": licence_address(profile.licence), "type": "Text", "label": _text("Licence")}]
    return json.dumps(record, indent=1, ensure_ascii=False) + "\n"


def _canvas(one: TiledPicture, manifest_place: str, notes: tuple[Note, ...]) -> dict[str, Any]:
    canvas = f"{manifest_place}/canvas/{quote(one.name)}"
    size = {"width": one.width, "height": one.height}
    body = {
        "id": f"{one.place}/full/max/0/default.jpg", "type": "Image", "format": "image/jpeg", **size,
        "service": [{"id": one.place, "type": "ImageService3", "profile": "level0"}],
    }  # fmt: skip
    annotation = {
        "id": f"{canvas}/annotation", "type": "Annotation", "motivation": "painting", "body": body, "target": canvas,
    }  # fmt: skip
    page = {"id": f"{canvas}/page", "type": "AnnotationPage", "items": [annotation]}
    made: dict[str, Any] = {"id": canvas, "type": "Canvas", "label": _text(one.name), **size, "items": [page]}
    if notes:
        items = [
            {
                "id": f"{canvas}/note/{number}", "type": "Annotation", "motivation": "commenting",
                "body": {"type": "TextualBody", "value": note.text, "format": "text/plain"},
                "target": {"type": "SpecificResource", "source": canvas, "selector": selector(note)},
            }
            for number, note in enumerate(notes, 1)
        ]  # fmt: skip
        made["annotations"] = [{"id": f"{canvas}/notes", "type": "AnnotationPage", "items": items}]
    return made


def _text(text: str) -> dict[str, list[str]]:
    return {"none": [text]}


def _reduced(width: int, height: int, factor: int) -> tuple[int, int]:
    return -(-width // factor), -(-height // factor)


def _corners(width: int, height: int) -> Iterator[tuple[int, int]]:
    """Left and top of each tile."""
    return ((left, top) for top in range(0, height, TILE) for left in range(0, width, TILE))


def _save(image: Any, folder: Path) -> None:
    target = folder / "0"
    target.mkdir(parents=True, exist_ok=True)
    image.save(target / "default.jpg", "JPEG", quality=QUALITY, subsampling=0)  # colours in full resolution
