"""Micro-structure: a periodic field in (u, v, height) → a texel. Lengths in mm."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.matter.fill import MM
from hagoromo.volume.texel import Texel
from hagoromo_matter.texel.texel_levels import Nodes, levels_of

Field = Callable[[Any, Any], tuple[Any, Any, Any]]
NODES_AT_ONCE = 1 << 18  # nodes that are evaluated together
LEVELS = 1.25  # memory of all levels, in that of the finest
LARGEST_CELLS = 4095  # largest number of cells in a period


def texel(
    field: Field,
    period_mm: tuple[float, float],
    heights_mm: tuple[float, float],
    voxel_mm: float,
    populations: int = 1,
    variants: int = 1,
) -> Texel:
    """The texel of a field that repeats along u and v, between a bottom and a top height over the surface.

    field(point, variant): point Array3f (u, v, height) with 0 ≤ u, v < period, variant UInt → density, unit tangent
    along (u, v, normal), number of the population (UInt). Next to the border of the period all variants are equal.
    """
    size = np.array([*period_mm, heights_mm[1] - heights_mm[0]])
    if not (np.isfinite(size).all() and size.min() > 0 and np.isfinite(voxel_mm) and voxel_mm > 0):
        raise InputError(f"a texel of {size.tolist()} mm with voxels of {voxel_mm} mm: give finite lengths above 0")
    cells = np.maximum(np.ceil(size / voxel_mm - 1e-6), (2, 2, 2))
    if cells[:2].max() > LARGEST_CELLS:
        raise InputError(
            f"voxel_mm {voxel_mm:g} is too fine for a period of {max(period_mm):g} mm: {LARGEST_CELLS} at most"
        )
    nu, nv, nh = cells.astype(int).tolist()
    shape = (nv + 1, variants * nu + 1, nh + 1)
    require(_bytes(shape, populations), f"a texel of {shape[1]} × {shape[0]} × {shape[2]} voxels")
    nodes = _evaluated(field, (nv, nu, nh), size, heights_mm[0], populations, variants)
    period = (period_mm[0] * MM, period_mm[1] * MM)
    return Texel(period, heights_mm[0] * MM, heights_mm[1] * MM, variants, levels_of(nodes))


def _bytes(shape: tuple[int, int, int], populations: int) -> float:
    """Memory that a texel of so many nodes takes while it is made [byte]: 17 a node, and its levels."""
    return math.prod(shape) * (17.0 + (8.0 * populations + 5.0) * LEVELS)


def _evaluated(
    field: Field, cells: tuple[int, int, int], size: NDArray, bottom: float, populations: int, variants: int
) -> Nodes:
    """Density, tangent and population at the nodes (v, variant and u, height), part by part."""
    import drjit as dr

    jit, (nv, nu, nh) = arrays(), cells
    count = nv * variants * nu * (nh + 1)
    held, tangent = np.empty(count, np.float32), np.empty((count, 3), np.float32)
    which = np.empty(count, np.uint8)
    for start in range(0, count, NODES_AT_ONCE):
        some = slice(start, min(start + NODES_AT_ONCE, count))
        index = dr.arange(jit.UInt, some.stop - start) + dr.opaque(jit.UInt, start)
        h, column = index % (nh + 1), index // (nh + 1)
        across, v = column % (variants * nu), column // (variants * nu)
        point = jit.Array3f(
            jit.Float(across % nu) * float(size[0] / nu),
            jit.Float(v) * float(size[1] / nv),
            dr.fma(jit.Float(h), float(size[2] / nh), float(bottom)),
        )
        density, along, number = field(point, across // nu)
        nothing = jit.Float(0.0) * point.x
        held[some] = np.array(jit.Float(density) + nothing)
        tangent[some] = np.array(jit.Array3f(along) + nothing).T
        numbers = np.array(jit.UInt(number) + jit.UInt(nothing))
        if numbers.max() >= populations:
            raise InputError(
                f"the field of a texel has population {numbers.max()} of {populations}: numbers start at 0"
            )
        which[some] = numbers
    lattice = nv, variants * nu, nh + 1
    return Nodes(held.reshape(lattice), tangent.reshape(*lattice, 3), which.reshape(lattice), populations, variants)
