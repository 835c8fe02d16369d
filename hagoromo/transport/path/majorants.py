"""Majorants: the largest extinction in every stored brick, by which flights through matter are drawn."""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, UInt, arrays, lookup
from hagoromo.reflectance.element import ELEMENTS, projected_area
from hagoromo.transport.crossing import Ray
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.bricks import BRICKS_AT_ONCE, Bricks
from hagoromo.volume.texel import Texel
from hagoromo.volume.voxels import PAIRS

MARGIN = 1.0 + 1e-4  # above the largest density: rounding of an interpolated one
LARGEST_AREA = {e: float(projected_area(e, 0.0 if e == "cylinder" else 1.0)) for e in ELEMENTS}


class Majorants:
    """Largest density of each brick of the common pool, and largest projected area of the elements of each box."""

    def __init__(self, boxes: Sequence[VolumeBox]) -> None:
        """`boxes`: whose grids are in one pool already (`Medium`)."""
        bricks = list({id(box.bricks): box.bricks for box in boxes}.values())
        densest = np.zeros(max(part.density.first + part.kept for part in bricks) + 1, np.float32)
        for part in bricks:
            densest[part.density.first : part.density.first + part.kept] = largest_densities(part)
        areas = [
            max(LARGEST_AREA[material.element] for material in box.materials) if box.extinction == "projected" else 1.0
            for box in boxes
        ]
        self.densest = lookup(arrays().Float, MARGIN * densest)
        texels = [float(texel_density(box.texel)) if box.texel else 0.0 for box in boxes]
        self.texels = lookup(arrays().Float, MARGIN * np.array(texels, np.float32)) if any(texels) else None
        self.areas = lookup(arrays().Float, np.array(areas, np.float32))
        dr.eval(self.densest, self.areas)

    def of(self, ray: Ray, brick: UInt) -> Float:
        """Bound of the extinction of a ray in a stored brick [1/m]; see `Ray.densest`."""
        jit = arrays()
        density, area = dr.gather(jit.Float, self.densest, brick), dr.gather(jit.Float, self.areas, ray.box)
        bound = dr.fmin(ray.tau * density, MARGIN * ray.densest)
        if self.texels is not None:
            in_texel = dr.gather(jit.Float, self.texels, ray.box)
            bound = dr.select(in_texel > 0.0, ray.tau * in_texel, bound)
        return bound * area


def texel_density(texel: Texel) -> np.float32:
    """Largest density of all populations together at the finest level."""
    return texel.levels[0].density.astype(np.float32).sum(axis=0).astype(np.float16).max().astype(np.float32)


def largest_densities(bricks: Bricks) -> NDArray[np.float32]:
    """Largest density of each stored brick, the layer of its neighbours included: (kept,)."""
    largest = np.zeros(bricks.kept, np.uint16)
    for begin in range(0, bricks.kept, BRICKS_AT_ONCE):
        end = min(begin + BRICKS_AT_ONCE, bricks.kept)
        pairs = np.array(bricks.density.read(begin, end)).reshape(-1, PAIRS)
        largest[begin:end] = pairs.view(np.uint16).max(axis=1)  # halves ≥ 0 order as their bits
    return largest.view(np.float16).astype(np.float32)
