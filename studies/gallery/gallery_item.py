"""Gallery item: one recipe built, photographed in its views and lit from eight sides; its figures as JSON.

    python -m studies.gallery.gallery_item examples/recipes linen docs/figures/gallery ../shared/data

Writes NAME_whole.jpg, NAME_10_mm.jpg, NAME_1_mm.jpg, NAME_lamps.jpg, of a woven cloth NAME_draft.jpg, and NAME.json.
"""

from __future__ import annotations

import os
import platform
import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import hagoromo as hg
from hagoromo import backend
from studies.gallery.gallery_draft import drawn
from studies.gallery.gallery_items import ITEMS, SCAN_POSE, Item
from studies.gallery.gallery_view import SIZE, around, near, whole

GALLERY_JPEG_QUALITY = 86  # of JPEG
DRAFT_FIELD_MM = 10.0  # as the picture of 1 cm
RSS_UNIT = 1 if sys.platform == "darwin" else 1024  # bytes in which the system tells memory
MIB = 2**20


def make(recipes: Path, name: str, out: Path, data: Path) -> None:
    """All pictures and figures of one item."""
    item = ITEMS[name]
    box, cost = _built(recipes, item, of_whole(item, data))
    hg.write_json(out / f"{name}.json", cost)
    _write(out / f"{name}_whole.jpg", whole(box, item.stops))
    _write(out / f"{name}_lamps.jpg", around(box, item.stops))
    for view, field_mm, change in (("10_mm", 10.0, item.centimetre), ("1_mm", 1.0, item.millimetre)):
        if change is not None:
            box, _ = _built(recipes, item, change)
            _write(out / f"{name}_{view}.jpg", near(box, field_mm))
    draft = drawn(hg.read_toml(recipes / f"{item.recipe}.toml"), DRAFT_FIELD_MM, SIZE) if item.centimetre else None
    if draft is not None:
        _write(out / f"{name}_draft.jpg", draft)


def of_whole(item: Item, data: Path) -> dict[str, Any]:
    """The keys by which the recipe of an item differs where all of it is shown; data: folder that has the scan."""
    mesh = {"shape": SCAN_POSE | {"form": "mesh", "file": str((data / item.scan).resolve())}}
    return (item.whole or {}) | (mesh if item.scan else {})


def changed(recipes: Path, item: Item, change: dict[str, Any]) -> dict[str, Any]:
    """The recipe of an item with other keys."""
    record = hg.read_toml(recipes / f"{item.recipe}.toml")
    for key, value in change.items():
        merged = isinstance(value, dict) and key in record and key != "shape"
        record[key] = record[key] | value if merged else value
    return record


def _built(recipes: Path, item: Item, change: dict[str, Any]) -> tuple[hg.VolumeBox, dict[str, Any]]:
    """A box, and what it cost: seconds (core_seconds: of all cores), peak of the process's memory [MiB], bricks."""
    record = changed(recipes, item, change)
    before, start, busy = _peak(), time.perf_counter(), time.process_time()
    box = hg.build(record)
    cost = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, {backend.name()}",
        "seconds": round(time.perf_counter() - start, 1), "core_seconds": round(time.process_time() - busy, 1),
        "before_mib": round(before), "peak_mib": round(_peak()), "bricks": len(box.bricks.places),
        "voxel_mm": round(1e3 * box.voxel_size, 4), "voxels": list(box.bricks.shape[::-1]),
    }  # fmt: skip
    texel = getattr(box, "texel", None)
    if texel is not None:
        cost["texel_mib"] = round(texel.bytes / MIB, 1)
    return box, cost


def _peak() -> float:
    """Most memory that this process has held so far [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * RSS_UNIT / MIB


def _write(path: Path, picture: np.ndarray) -> None:
    import cv2

    cv2.imwrite(str(path), picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, GALLERY_JPEG_QUALITY])


if __name__ == "__main__":
    make(Path(sys.argv[1]), sys.argv[2], *map(Path, sys.argv[3:5]))
