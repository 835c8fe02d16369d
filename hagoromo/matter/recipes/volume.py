"""Kind "volume": density = "NAME.zarr" and, where there is one, axis: Zarr arrays, see `box_from_zarr`; scale."""

from __future__ import annotations

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.record import positive, text
from hagoromo.matter.fill import MM
from hagoromo.matter.recipes.recipe import Kind, Recipe, fineness_keys
from hagoromo.volume.store.header import BoxHeader
from hagoromo.volume.store.plan import BoxPlan
from hagoromo.volume.store.zarr_plan import ZarrVolume


def _plan(recipe: Recipe) -> BoxPlan:
    if recipe["resolution"] != 1.0:
        raise InputError(f"{recipe.where}: resolution is for other kinds: a volume has the voxels that it has")
    paths = {name: recipe.file(recipe[name]) for name in ("density", "axis") if recipe[name]}
    blocks = ZarrVolume(**paths, scale=recipe["scale"])
    voxel, pose = recipe["voxel_mm"] * MM, np.eye(4)
    pose[:2, 3] = -0.5 * voxel * np.array(blocks.shape[:0:-1])
    tau = 1.0 / (recipe["mean_free_path_mm"] * MM)
    return BoxPlan(BoxHeader(voxel, tau, (recipe.material,), pose, name="volume"), blocks)


KEYS = {"density": text, "axis": (text, ""), "scale": (positive, 1.0), **fineness_keys(0.5, 0.5)}
KIND = Kind("plane", KEYS, _plan)
