"""Kind "volume": density = "NAME.zarr" and, where there is one, axis: Zarr arrays, see `box_from_zarr`; scale."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.record import Positive, about
from hagoromo.matter.fill import MM
from hagoromo.matter.recipes.recipe import Kind, MeanFreePath, Recipe, RecipeTable, Voxel
from hagoromo.volume.store.header import BoxHeader
from hagoromo.volume.store.plan import BoxPlan
from hagoromo.volume.store.zarr_plan import ZarrVolume


class VolumeTable(RecipeTable, frozen=True, kw_only=True):
    """A volume that another program made, as Zarr arrays."""

    density: Annotated[str, about("Zarr array of the density, axes (z, y, x)")]
    axis: Annotated[str, about("Zarr array of the axes of the micro-elements; empty: none")] = ""
    scale: Annotated[Positive, about("factor on the density")] = 1.0
    voxel_mm: Voxel = 0.5
    mean_free_path_mm: MeanFreePath = 0.5


def _plan(recipe: Recipe[VolumeTable]) -> BoxPlan:
    table = recipe.table
    if table.resolution != 1.0:
        raise InputError(f"{recipe.where}: resolution is for other kinds: a volume has the voxels that it has")
    paths = {name: recipe.file(path) for name in ("density", "axis") if (path := getattr(table, name))}
    blocks = ZarrVolume(**paths, scale=table.scale)
    voxel, pose = table.voxel_mm * MM, np.eye(4)
    pose[:2, 3] = -0.5 * voxel * np.array(blocks.shape[:0:-1])
    tau = 1.0 / (table.mean_free_path_mm * MM)
    return BoxPlan(BoxHeader(voxel, tau, (recipe.material,), pose, name="volume"), blocks)


KIND = Kind("plane", VolumeTable, _plan)
