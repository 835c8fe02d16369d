"""Contact sheet: every photograph of a measurement, with its prediction and residual, within a number of bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from hagoromo.measurement.measurement import Measurement
from hagoromo.photograph.photograph import Photograph
from hagoromo_page.report.display import data_uri
from hagoromo_page.report.report_pictures import around, residual

WIDTHS_PX = (720, 600, 500, 420, 350, 290, 240, 200, 160)  # of the longer side, tried in turn
SAMPLED = 4  # photographs from which the size of all is estimated
QUALITY = 80
Picture = NDArray[np.uint8]
Shown = Callable[[Photograph, NDArray], Picture]


@dataclass(frozen=True)
class SheetEntry:
    """One photograph of the sheet. pictures: <img> of the photograph, its prediction and its residual."""

    name: str
    lamps: str
    pictures: tuple[Markup, ...]


def contact_sheet(measurement: Measurement, shown: Shown, limit: float) -> list[SheetEntry]:
    """The photographs in the order of the capture, of `limit` bytes together, or as small as they may be.

    shown: the picture of values of a photograph.
    """
    assert measurement.capture is not None
    crop = around(measurement.labels >= 0)
    triples = [
        (shown(one, one.values)[crop], shown(one, predicted)[crop], residual(left)[crop])
        for one, predicted, left in zip(
            measurement.capture.photographs, measurement.predicted, measurement.residuals, strict=True
        )
    ]
    parts = list(zip(measurement.capture.photographs, triples, strict=True))
    some = parts[:: max(len(parts) // SAMPLED, 1)]
    sheet: list[SheetEntry] = []
    for width in WIDTHS_PX:
        if width > WIDTHS_PX[-1] and _size([_frame(*one, width) for one in some]) * len(parts) / len(some) > limit:
            continue
        sheet = [_frame(*one, width) for one in parts]
        if _size(sheet) <= limit:
            break
    return sheet


def _size(frames: Sequence[SheetEntry]) -> int:
    """Bytes of their pictures."""
    return sum(len(picture) for frame in frames for picture in frame.pictures)


def _frame(photograph: Photograph, triple: tuple[Picture, Picture, Picture], width: int) -> SheetEntry:
    """Residuals, which are noise, are shown as means over twice the pixels."""
    words = ("photograph", "prediction of", "residual of")
    sizes = (width, width, width // 2)
    pictures = tuple(
        _picture(_reduced(picture, size), f"{word} {photograph.name}")
        for picture, word, size in zip(triple, words, sizes, strict=True)
    )
    return SheetEntry(photograph.name, ", ".join(one.name or "a lamp" for one in photograph.lamps), pictures)


def _picture(picture: Picture, alt: str) -> Markup:
    return Markup('<img alt="{}" decoding="async" src="{}">').format(alt, data_uri(picture, quality=QUALITY))


def _reduced(picture: Picture, longest: int) -> Picture:
    """No longer than `longest` pixels."""
    import cv2

    height, width = picture.shape[:2]
    factor = max(height, width) / longest
    if factor <= 1.0:
        return picture
    size = max(round(width / factor), 1), max(round(height / factor), 1)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
