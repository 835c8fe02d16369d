"""Solved light: the light of higher orders of a scene, solved by one process and read by others.

Enters: what it follows from, as a digest, and who solves it. Leaves: the field and the light at surfaces, with the bits
of the process that solved them. It lies in the cache of this user, whole or not at all: one process of a machine
solves, others wait for it, and where it is killed one of them solves in its place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hagoromo.files.array_tree import digest_of_tree, read_tree, write_tree
from hagoromo.files.cache import Cache
from hagoromo.image.prepared.prepared_scene import PreparedScene
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.transport.field.field import Field, StoredField
from hagoromo.transport.field.joint import StoredSurfaceLight, SurfaceLight
from hagoromo.transport.path.bands import Bands
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.bricks import BRICKS_AT_ONCE, Grid

FILE = "light.npz"  # in an entry of the cache
OF_SETTINGS = ("shadows", "shadow_resolution", "tolerance", "seed", "separate_lamps", "orders")  # light depends on them


class SolvedLight(NamedTuple):
    """Of volume boxes, and at surfaces; None without any."""

    field: Field | None
    at_surfaces: SurfaceLight | None


@dataclass(frozen=True, eq=False)
class StoredLight:
    """What `SolvedLight` is made of again."""

    field: StoredField | None
    at_surfaces: StoredSurfaceLight | None


def solved_once(
    cache: Cache, digest: str, solve: Callable[[], SolvedLight], again: Callable[[StoredLight], SolvedLight]
) -> SolvedLight:
    """The light of a `digest`, see `content_of_light`: of `solve`, in one process of those that share the cache.

    again: what others make of what is stored; `InputError` where it does not fit, and then it is solved anew.
    """

    def read(folder: Path) -> SolvedLight:
        return again(read_tree(folder / FILE, StoredLight))

    def write(light: SolvedLight, folder: Path) -> None:
        field, surfaces = light
        stored = StoredLight(field.stored() if field else None, surfaces.stored() if surfaces else None)
        write_tree(folder / FILE, stored)

    return cache.kept(["light", digest], read, solve, write, once=True)


def content_of_light(scene: Scene, prepared: PreparedScene, settings: Settings, bands: Bands) -> str:
    """Digest of all that the light of higher orders follows from: matter, surfaces, lamps, bands, settings.

    It is of the values themselves, not of files and their dates. Of the camera only the origin counts that follows it.
    """
    return digest_of_tree(
        {
            "boxes": tuple(_content_of_box(box) for box in scene.boxes),
            "surfaces": scene.surfaces,
            "lamps": scene.lamps,
            "groups": prepared.palette.lamp_groups,
            "bands": bands.wavelengths,
            "origin": prepared.origin,
            "settings": tuple(getattr(settings, key) for key in OF_SETTINGS),
        }
    )


def _content_of_box(box: VolumeBox) -> tuple[Any, ...]:
    """Of a box all but its name and where it comes from."""
    bricks = box.bricks
    grids = (bricks.density, bricks.axis, bricks.colour, bricks.material, bricks.chart)
    values = tuple(grid and _content_of_grid(grid) for grid in grids)
    return replace(box.header, name="", provenance={}), bricks.shape, bricks.places, bricks.whole, values


def _content_of_grid(grid: Grid) -> tuple[str, ...]:
    spans = ((begin, min(begin + BRICKS_AT_ONCE, grid.count)) for begin in range(0, grid.count, BRICKS_AT_ONCE))
    return tuple(digest_of_tree(np.array(grid.read(*span))) for span in spans)
