"""Majorants: the largest extinction in every stored brick and in parts of it, by which flights are drawn.

Where a brick is deep, most of what a majorant of all of it draws are collisions that are none: a ray along a thin skin
had hundreds of them. There flights go through parts of PART³ voxels, each with a majorant of its own.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays, lookup
from hagoromo.reflectance.element import ELEMENTS, projected_area
from hagoromo.transport.crossing import Ray
from hagoromo.transport.frames import DENSEST
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.bricks import BRICKS_AT_ONCE, Bricks
from hagoromo.volume.texel import Texel
from hagoromo.volume.voxels import BRICK, SMALLEST_DENSITY, STORED

PART_BITS = 1
PART, PARTS = 1 << PART_BITS, (BRICK >> PART_BITS) ** 3  # voxels along a part of a brick; parts of a brick
SHARES = 255  # steps of the largest density of a brick in which those of its parts are kept
DEEP = 8.0  # optical depth along a brick by its majorant, from which flights go through its parts
MARGIN = 1.0 + 1e-4  # above the largest density: rounding of an interpolated one
LARGEST_AREA = {e: float(projected_area(e, 0.0 if e == "cylinder" else 1.0)) for e in ELEMENTS}


class Majorants:
    """Largest density of each brick of the common pool, and largest projected area of the elements of each box."""

    def __init__(self, boxes: Sequence[VolumeBox]) -> None:
        """`boxes`: whose grids are in one pool already (`Medium`)."""
        bricks = list({id(box.bricks): box.bricks for box in boxes}.values())
        count = max(part.density.first + part.kept for part in bricks) + 1
        densest, shares = np.zeros(count, np.float32), np.zeros((count, PARTS), np.uint8)
        for part in bricks:
            here = slice(part.density.first, part.density.first + part.kept)
            densest[here], shares[here] = largest_densities(part)
        areas = [
            max(LARGEST_AREA[material.element] for material in box.materials) if box.extinction == "projected" else 1.0
            for box in boxes
        ]
        self.densest, self.shares = lookup(arrays().Float, MARGIN * densest), lookup(arrays().UInt8, shares)
        texels = [float(texel_density(box.texel)) if box.texel else 0.0 for box in boxes]
        self.texels = lookup(arrays().Float, MARGIN * np.array(texels, np.float32)) if any(texels) else None
        self.areas = lookup(arrays().Float, np.array(areas, np.float32))
        dr.eval(self.densest, self.shares, self.areas)

    def of(self, ray: Ray, brick: UInt, place: Array3f) -> tuple[Float, Bool]:
        """Bound of the extinction of a ray in a stored brick [1/m], see `Ray.densest`, around lattice coordinates
        `place`; and whether it is that of a part of the brick.
        """
        jit = arrays()
        density, area = dr.gather(jit.Float, self.densest, brick), dr.gather(jit.Float, self.areas, ray.box)
        bound = dr.fmin(ray.tau * density, MARGIN * ray.densest)
        deep = bound * area * (BRICK * DENSEST) > DEEP * ray.densest  # Ray.densest: DENSEST a voxel
        if self.texels is not None:
            in_texel = dr.gather(jit.Float, self.texels, ray.box)
            deep &= in_texel == 0.0
            bound = dr.select(in_texel > 0.0, ray.tau * in_texel, bound)
        part = (jit.Array3i(place) & (BRICK - 1)) >> PART_BITS
        number = brick * PARTS + jit.UInt((part.z * (BRICK // PART) + part.y) * (BRICK // PART) + part.x)
        share = jit.Float(dr.gather(jit.UInt8, self.shares, number, deep)) * (1.0 / SHARES)
        return dr.select(deep, dr.fmin(bound, ray.tau * density * share), bound) * area, deep


def texel_density(texel: Texel) -> np.float32:
    """Largest density of all populations together at the finest level."""
    return texel.levels[0].density.astype(np.float32).sum(axis=0).astype(np.float16).max().astype(np.float32)


def largest_densities(bricks: Bricks) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Largest density of each stored brick, the layer of its neighbours included: (kept,); and in each of its parts,
    as shares of it in SHARES steps, rounded up: (kept, PARTS).
    """
    largest, shares = np.zeros(bricks.kept, np.float32), np.zeros((bricks.kept, PARTS), np.uint8)
    for begin in range(0, bricks.kept, BRICKS_AT_ONCE):
        end = min(begin + BRICKS_AT_ONCE, bricks.kept)
        halves = np.array(bricks.density.read(begin, end)).reshape(-1, STORED, STORED, BRICK).view(np.uint16)
        parts = halves.reshape(*halves.shape[:3], BRICK // PART, 2 * PART).max(axis=-1)  # halves ≥ 0 order as bits
        for axis in (2, 1):
            parts = over_parts(parts, axis)
        values = parts.view(np.float16).astype(np.float32).reshape(end - begin, PARTS)
        largest[begin:end] = values.max(axis=1)
        scale = SHARES / np.maximum(largest[begin:end, None], SMALLEST_DENSITY)
        shares[begin:end] = np.minimum(np.ceil(values * scale), SHARES)
    return largest, shares


def over_parts(values: NDArray[np.uint16], axis: int) -> NDArray[np.uint16]:
    """The largest of the PART + 1 voxels along an axis between which each part of a brick lies."""
    steps = [values.take(range(k, k + BRICK, PART), axis) for k in range(PART + 1)]
    return functools.reduce(np.maximum, steps)
