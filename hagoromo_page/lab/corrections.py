"""Corrections: what a hand corrects, as files that commands take: lamps in another order, a painted mask, a profile."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.png import read_png, write_png
from hagoromo.files.record import read_json, write_json
from hagoromo.files.toml_text import toml_text
from hagoromo.files.whole import write_text
from hagoromo.photograph.lamp_files import LP, lamp_of_each, load_lamps, write_lp
from hagoromo_page.lab.folder import LAB, MASK, ORDERED, PROFILE, Folder
from hagoromo_page.lab.messages import Stroke

GREY = {
    "object": 255,
    "background": 0,
    "as found": 128,
}  # levels of a correction, as `capture --mask auto PNG` reads it


def reorder(folder: Folder, order: Sequence[str]) -> None:
    """Keep the order of the photographs, and write their lamps so: the k-th lamp of the file becomes order[k]'s.

    `InputError` where the lamps come from balls: each photograph then shows its own.
    """
    if not folder.has_lamp_file:
        raise InputError("the lamps are read off a ball, so each photograph has its own: their order is of no matter")
    if sorted(order) != sorted(folder.photographs):
        raise InputError("the order must name each photograph once: reload the page")
    source = folder.file(folder.lamps_from)
    listed = load_lamps(source)
    assigned, _ = lamp_of_each(listed, [Path(name) for name in folder.photographs])
    (folder.home / LAB).mkdir(exist_ok=True)
    if source.suffix.lower() == LP:
        named = [replace(lamp, name=name) for lamp, name in zip(assigned, order, strict=True)]
        write_lp(folder.home / ORDERED[0], named, force=True)
    else:
        place = {id(lamp): k for k, lamp in enumerate(listed)}
        record = read_json(source)
        rows = record if isinstance(record, list) else record["lamps"]
        lamps = [{**rows[place[id(one)]], "name": name} for one, name in zip(assigned, order, strict=True)]
        write_json(folder.home / ORDERED[1], {**(record if isinstance(record, dict) else {}), "lamps": lamps})
    folder.keep(order=[] if tuple(order) == folder.photographs else list(order))


def swapped(folder: Folder, names: tuple[str, str]) -> list[str]:
    """The order with two photographs exchanged; `InputError` for a name that is none of them."""
    order = list(folder.ordered)
    for name in names:
        if name not in order:
            raise InputError(f"{name!r} is no photograph of this folder: reload the page")
    first, second = (order.index(name) for name in names)
    order[first], order[second] = order[second], order[first]
    return order


def paint(folder: Folder, stroke: Stroke, shape: tuple[int, int]) -> None:
    """Paint a stroke into lab/mask.png, which has the `shape` (height, width) of the photographs."""
    import cv2

    mask = painted(folder, shape)
    points = np.clip(np.rint(np.asarray(stroke.points)), -(1 << 15), 1 << 15).astype(np.int32)
    wide = min(max(round(2 * stroke.radius), 1), max(shape))
    level = GREY[stroke.paints]
    cv2.polylines(mask, [points[:, None]], False, level, wide)
    for x, y in (points[0], points[-1]):
        cv2.circle(mask, (int(x), int(y)), max(wide // 2, 0), level, -1)
    (folder.home / LAB).mkdir(exist_ok=True)
    if (mask == GREY["as found"]).all():
        clear_mask(folder)
    else:
        write_png(folder.home / MASK, mask)


def painted(folder: Folder, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """What is painted, (height, width), grey where nothing is."""
    path = folder.home / MASK
    if not path.exists():
        return np.full(shape, GREY["as found"], np.uint8)
    mask = read_png(path)
    if mask.shape != shape or mask.dtype != np.uint8:
        raise InputError(f"{path} has shape {mask.shape} and the photographs {shape}: clear what was painted")
    return np.array(mask, np.uint8)


def clear_mask(folder: Folder) -> None:
    """Remove what was painted."""
    if (folder.home / MASK).exists():
        os.remove(folder.home / MASK)


def write_profile(folder: Folder, values: Mapping[str, str]) -> None:
    """Write lab/archive.toml of those values that are stated; without any it is removed."""
    stated = {key: value.strip() for key, value in values.items() if value.strip()}
    (folder.home / LAB).mkdir(exist_ok=True)
    if stated:
        write_text(folder.home / PROFILE, toml_text(stated))
    elif (folder.home / PROFILE).exists():
        os.remove(folder.home / PROFILE)
