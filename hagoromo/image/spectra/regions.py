"""Marked regions of a photograph: rectangles by name, values of a label picture, or materials of a measurement."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.png import read_png
from hagoromo.measurement.measured_surface import read_surface

RECTANGLE = re.compile(r"(.+)=(\d+),(\d+),(\d+),(\d+)")
FEWEST_PIXELS = 4
Masks = dict[str, NDArray[np.bool_]]


def marked_regions(
    shape: tuple[int, int], rectangles: Sequence[str] = (), labels: Path | None = None, measured: Path | None = None
) -> Masks:
    """Name → (h, w) mask. rectangles: "NAME=x,y,width,height" [px]. labels: PNG, 0 unmarked, each other value a region.

    measured: folder of `measure`, whose labels.png marks the materials. `InputError` for a region outside `shape`, or
    of too few pixels, and where nothing is marked.
    """
    masks: Masks = {}
    for text in rectangles:
        match = RECTANGLE.fullmatch(text)
        if match is None:
            raise InputError(f"--region is {text!r}: give NAME=x,y,width,height in pixels, such as cheek=120,80,40,40")
        name, (x, y, width, height) = match[1], map(int, match.groups()[1:])
        if x + width > shape[1] or y + height > shape[0]:
            raise InputError(f"region {name!r} leaves the photograph of {shape[1]}x{shape[0]} px: {text}")
        masks[name] = np.zeros(shape, np.bool_)
        masks[name][y : y + height, x : x + width] = True
    for names, picture in _pictures(labels, measured):
        if picture.shape[:2] != shape:
            raise InputError(f"labels of {picture.shape[:2]} do not fit the photograph of {shape}: give one size")
        masks |= {names.get(int(k), f"region {k}"): picture == k for k in np.unique(picture[picture > 0])}
    if not masks:
        raise InputError("no region is marked: give --region, --labels or --measured")
    for name, mask in masks.items():
        if mask.sum() < FEWEST_PIXELS:
            raise InputError(f"region {name!r} has {int(mask.sum())} pixels: give {FEWEST_PIXELS} or more")
    return masks


def _pictures(labels: Path | None, measured: Path | None) -> list[tuple[dict[int, str], NDArray]]:
    pictures: list[tuple[dict[int, str], NDArray]] = []
    if labels is not None:
        picture = read_png(labels)
        if picture.ndim != 2:
            raise InputError(f"{labels} has {picture.shape[2]} channels: give a picture of one channel, 0 unmarked")
        pictures.append(({}, picture))
    if measured is not None:
        surface = read_surface(measured)
        pictures.append(({k + 1: m.name for k, m in enumerate(surface.materials)}, surface.labels + 1))
    return pictures
