"""Kept box: the volume box of a recipe or plan, from the cache where it has been built before."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from hagoromo.files.cache import cache
from hagoromo.files.content import content_with_named
from hagoromo.matter.build import build
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.box_store import load_box, save_box

BOX = "box.zarr"  # in an entry of the cache


def kept_box(depends_on: Any, make: Callable[[], VolumeBox]) -> VolumeBox:
    """The box that `make` gives, or the same one from the cache. depends_on: plain data, all that it depends on."""
    return cache().kept(
        ["box", depends_on],
        lambda folder: load_box(folder / BOX),
        make,
        lambda box, folder: save_box(box, folder / BOX),
    )


def built_box(recipe: Path) -> VolumeBox:
    """`build` of a recipe file, once for each content of it and of the files that it names."""
    return kept_box(content_with_named(recipe), lambda: build(recipe))
