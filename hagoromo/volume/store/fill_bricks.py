"""Fill bricks: a function of voxel indices, or dense arrays → Bricks. Memory follows the bricks that hold matter."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from hagoromo.backend import arrays
from hagoromo.files.memory import require
from hagoromo.volume.bricks import Bricks, Shape, brick_bytes, check_shape, table_shape
from hagoromo.volume.store.brick_writer import BrickWriter, check_density
from hagoromo.volume.voxels import BRICK, STORED, VOXELS

CHUNK = 1 << 12  # bricks evaluated at once
BRICKS_PER_CHECK = 1 << 18  # bricks between two looks at the free memory
CUBE_PARTS = 4  # along each edge, of a cube that `occupied` does not promise to be empty
Field = Callable[[Any, Any, Any], dict[str, Any]]
Occupied = Callable[[Any, float], Any]


def bricks_from_field(field: Field, shape: Shape, occupied: Occupied | None = None) -> Bricks:
    """Bricks of `field`, evaluated chunk by chunk.

    field(x, y, z): voxel indices (UInt) → {"density", "axis" (Array3f), optional "colour" (list of ≤ 4), "material",
    "chart" (Array4u) and, with it, "kept": above 0 where it is wanted}.
    occupied(middle, radius): optional, False promises that the ball [voxels] around `middle` (Array3f, lattice
    coordinates) is empty; asked of large cubes first, then of their parts.
    """
    import drjit as dr

    check_shape(shape)
    jit, kept, count, checked = arrays(), [np.zeros((0, 3), np.int32)], 0, 0
    for places in candidates(table_shape(shape), occupied):
        if count - checked > BRICKS_PER_CHECK:  # what will not fit is refused while it is counted
            require(count * brick_bytes(), f"more than {count} bricks of a lattice of {shape[::-1]} voxels")
            checked = count
        x, y, z = _indices(places, shape)
        voxel = field(x, y, z)
        density = jit.Float(voxel.get("kept", voxel["density"])) + 0.0 * jit.Float(x)  # as wide as the voxels
        check_density(density)
        kept.append(places[np.array(dr.block_reduce(dr.ReduceOp.Max, density, VOXELS)) > 0])
        count += len(kept[-1])
    first = field(*(jit.UInt(0) for _ in range(3)))
    optional = ("colour" in first, "material" in first, "chart" in first)
    writer = BrickWriter(shape, np.concatenate(kept), *optional)
    for start in range(0, len(writer.places), CHUNK):
        x, y, z = _indices(writer.places[start : start + CHUNK], shape)
        voxel = field(x, y, z)
        colour = voxel.get("colour")
        if colour is not None:
            colour = jit.Array4f(*colour, *[0.0] * (4 - len(colour)))
        density = jit.Float(voxel["density"]) + 0.0 * jit.Float(x)
        writer.write(start, density, jit.Array3f(voxel["axis"]), colour, voxel.get("material"), voxel.get("chart"))
    return writer.bricks()


def candidates(lattice: Shape, occupied: Occupied | None) -> Iterator[np.ndarray]:
    """Places (≤ CHUNK, 3) of the bricks that may hold matter: all of them, or those that `occupied` does not exclude.

    Large cubes are asked about first; those that may hold matter are cut into PARTS³, down to bricks.
    """
    size = 1
    while occupied and CUBE_PARTS * CUBE_PARTS * size <= max(lattice):
        size *= CUBE_PARTS
    across = tuple(-(-n // size) for n in lattice)
    count = int(np.prod(across, dtype=np.int64))
    for start in range(0, count, CHUNK):
        places = np.stack(np.unravel_index(np.arange(start, min(start + CHUNK, count)), across), axis=-1)
        yield from _within(places.astype(np.int32) * size, size, lattice, occupied)


def _within(places: np.ndarray, size: int, lattice: Shape, occupied: Occupied | None) -> Iterator[np.ndarray]:
    """Bricks in the cubes of `size` bricks at `places`, chunk by chunk."""
    places = places[(places < lattice).all(axis=1)]
    if occupied and len(places):
        middle = places[:, ::-1] * float(BRICK) + 0.5 * size * BRICK
        middle = arrays().Array3f(*(np.ascontiguousarray(middle[:, k], np.float32) for k in range(3)))
        places = places[np.array(occupied(middle, 0.5 * 3**0.5 * (size * BRICK + 1)))]
    if not len(places):
        return
    if size == 1:
        yield places
        return
    size //= CUBE_PARTS
    parts = (places[:, None] + np.array(list(np.ndindex(CUBE_PARTS, CUBE_PARTS, CUBE_PARTS)), np.int32) * size).reshape(
        -1, 3
    )
    for start in range(0, len(parts), CHUNK):
        yield from _within(parts[start : start + CHUNK], size, lattice, occupied)


def bricks_from_arrays(
    density: np.ndarray, axis: np.ndarray, colour: np.ndarray | None, material: np.ndarray | None
) -> Bricks:
    """Bricks of dense arrays (nz, ny, nx): density, axis (…, 3), colour (…, ≤ 4), material."""
    nz, ny, nx = density.shape
    check_shape(density.shape)
    check_density(np.asarray(density, np.float32))
    places = np.argwhere(occupied_bricks(density > 0))
    writer = BrickWriter((nz, ny, nx), places, colour is not None, material is not None)
    if colour is not None and colour.shape[-1] < 4:
        colour = np.concatenate([colour, np.zeros((*colour.shape[:-1], 4 - colour.shape[-1]), colour.dtype)], axis=-1)
    steps, shape = np.arange(STORED), np.array(density.shape)
    for start in range(0, len(writer.places), CHUNK):
        first = writer.places[start : start + CHUNK, None] * BRICK + steps[None, :, None]
        z, y, x = np.moveaxis(np.minimum(first, shape - 1), -1, 0)
        index = z[:, :, None, None], y[:, None, :, None], x[:, None, None, :]
        writer.write(
            start, density[index], axis[index],
            None if colour is None else colour[index], None if material is None else material[index],
        )  # fmt: skip
    return writer.bricks()


def occupied_bricks(matter: np.ndarray) -> np.ndarray:
    """Which bricks hold matter, their shared layer of neighbours included: bool (nz, ny, nx) → bool table."""
    for axis, count in enumerate(table_shape(matter.shape)):
        layers = np.moveaxis(matter, axis, 0)
        layers = np.stack([layers[i * BRICK : i * BRICK + STORED].any(axis=0) for i in range(count)])
        matter = np.moveaxis(layers, 0, axis)
    return matter


def _indices(places: np.ndarray, shape: Shape) -> tuple[Any, Any, Any]:
    """Voxel indices x, y, z of the 9³ voxels of each brick (beyond the lattice: its last layer)."""
    import drjit as dr

    UInt = arrays().UInt
    local = dr.arange(UInt, len(places) * VOXELS)
    brick, inner = local // VOXELS, local % VOXELS
    offsets = (inner // STORED**2, (inner // STORED) % STORED, inner % STORED)
    z, y, x = (
        dr.minimum(
            dr.gather(UInt, UInt(np.ascontiguousarray(places[:, k], np.uint32)), brick) * BRICK + offsets[k],
            shape[k] - 1,
        )
        for k in range(3)
    )
    return x, y, z
