"""Kind "volume": density = "NAME.zarr" or a volume file of another program and, where there is one, axis; its scale.

The box lies where the file says; where it says nothing, on z = 0 around x = y = 0. See `ZarrVolume`.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.record import Pair, Positive, about
from hagoromo.matter.fill import MM
from hagoromo.matter.recipe import Kind, MeanFreePath, Recipe, RecipeTable
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.store.plan import BoxPlan
from hagoromo.volume.store.zarr_plan import ZarrVolume

VOXEL_MM = 0.5  # of a file that states none


class VolumeTable(RecipeTable, frozen=True, kw_only=True):
    """A volume that another program made: Zarr arrays, or files of the formats that `hagoromo convert` reads."""

    density: Annotated[str, about("density: Zarr array, axes (z, y, x), or a volume file (NRRD, NIfTI, VTI, …)")]
    axis: Annotated[str, about("axes of the micro-elements, of the same voxels; empty: down the slope of density")] = ""
    scale: Annotated[
        Positive | None, about("density that a stored 1 stands for; default: 1, but whole numbers need it or a window")
    ] = None
    window: Annotated[Pair | None, about("stored numbers of density 0 and of density 1")] = None
    voxel_mm: Annotated[
        Positive | None, about("edge of a voxel [mm]; default: the shortest that the file states, or 0.5")
    ] = None
    mean_free_path_mm: MeanFreePath = 0.5


def _plan(recipe: Recipe[VolumeTable]) -> BoxPlan:
    table = recipe.table
    if table.resolution != 1.0:
        raise InputError(f"{recipe.where}: resolution is for other kinds: a volume has the voxels that it has")
    paths = {name: recipe.file(path) for name in ("density", "axis") if (path := getattr(table, name))}
    stated = None if table.voxel_mm is None else table.voxel_mm * MM
    blocks = ZarrVolume(**paths, scale=table.scale, window=table.window, voxel=stated)
    voxel, pose = blocks.voxel_size or VOXEL_MM * MM, blocks.pose
    if pose is None:
        pose = np.eye(4)
        pose[:2, 3] = -0.5 * voxel * np.array(blocks.shape[:0:-1])
    tau = 1.0 / (table.mean_free_path_mm * MM)
    return BoxPlan(BoxHeader(voxel, tau, (recipe.material,), pose, name="volume"), blocks)


KIND = Kind("plane", VolumeTable, _plan)
