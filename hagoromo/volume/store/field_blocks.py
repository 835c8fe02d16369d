"""Field blocks: the voxels of a lattice that a function of position fills, block by block, each evaluated once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.volume.bricks import Bricks, check_shape
from hagoromo.volume.store.blocks import BLOCK_SIDE, OFFSETS, Block, as_bricks, runs
from hagoromo.volume.store.brick_writer import check_density
from hagoromo.volume.store.fill_bricks import bricks_from_field, candidates
from hagoromo.volume.table import BLOCK, in_table_order
from hagoromo.volume.voxels import BRICK

BRICKS_AT_ONCE = 1 << 12  # bricks evaluated together, but no less than a block
COMPONENTS = {"density": (), "axis": (3,), "body_colour": (4,), "material": ()}  # of a voxel
INNER_VOXELS = BRICK**3  # voxels of a brick that it does not share with those before it


class FieldBlocks:
    """Blocks of a function of position on a lattice of `shape` (nz, ny, nx) voxels.

    field and occupied: see `VolumeBox.from_field`, in box axes [m]; voxel_size [m]. A field of a chart gives a
    dictionary as that of `bricks_from_field`; it has no blocks, only bricks.
    """

    def __init__(
        self,
        field: Callable[[Any], tuple[Any, ...]],
        shape: tuple[int, int, int],
        voxel_size: float,
        occupied: Callable[[Any, float], Any] | None = None,
    ) -> None:
        check_shape(shape)
        if not (np.isfinite(voxel_size) and voxel_size > 0):
            raise InputError(f"voxel_size is {voxel_size}: give a finite number above 0 [m]")
        self.field, self.shape, self.voxel_size, self.occupied = field, shape, float(voxel_size), occupied
        probe = self._voxels(*(arrays().UInt(0) for _ in range(3)))
        self.colours, self.material = len(probe.get("colour") or ()), "material" in probe

    def bricks(self, materials: int) -> Bricks:
        """All bricks that hold matter, on the device. materials: how many there are."""
        return bricks_from_field(self._voxels, self.shape, self._may_hold if self.occupied else None)

    def parts(self) -> list[NDArray[np.integer]]:
        """Blocks that may hold matter, (n, 3) [z, y, x in blocks], in parts that are evaluated together."""
        if not self._ranges:
            return []
        blocks = np.array(list(self._ranges), np.int32)
        starts = np.array([begin for begin, _ in self._ranges.values()])
        groups = np.flatnonzero(np.diff(starts // BRICKS_AT_ONCE, prepend=-1))
        return np.split(blocks, groups[1:])

    def drawn(self, count: int) -> Iterator[tuple[float, Iterator[tuple[Block, dict[str, NDArray]]]]]:
        """Probability of a draw, in proportion to the bricks of a block, and what `read` gives of it."""
        blocks = list(self._ranges)
        share = np.array([end - begin for begin, end in self._ranges.values()]) / max(len(self._candidates), 1)
        for number in np.random.default_rng(0).choice(len(blocks), count if blocks else 0, p=share):
            yield float(share[number]), self.read(np.array([blocks[number]]))

    def read(self, part: NDArray[np.integer]) -> Iterator[tuple[Block, dict[str, NDArray]]]:
        """The blocks of a part that hold anything, with their voxels (64, 64, 64, …)."""
        ranges = [self._ranges[z, y, x] for z, y, x in part.tolist()]
        first, last = ranges[0][0], ranges[-1][1]
        values = self._evaluated(self._candidates[first:last])
        for (z, y, x), (begin, end) in zip(part.tolist(), ranges, strict=True):
            inner = self._candidates[begin:end] % BLOCK
            bricks = {name: array[begin - first : end - first] for name, array in values.items()}
            if any(array.any() for array in bricks.values()):
                yield (z, y, x), {name: _block(array, inner) for name, array in bricks.items()}

    @cached_property
    def _candidates(self) -> NDArray[np.int32]:
        """Bricks that may hold voxels of the box, (n, 3) in the order of its table.

        They reach to the last voxel of the lattice, which may be one brick farther than bricks are stored. Where voxels
        have colours or materials these are wanted in the layer that stored bricks share with the next ones.
        """
        z, y, x = (-(-n // BRICK) for n in self.shape)
        parts = candidates((z, y, x), self._may_hold if self.occupied else None)
        places = np.concatenate([np.zeros((0, 3), np.int32), *parts])
        if self.colours or self.material:
            places = np.unique(np.concatenate([places + offset for offset in OFFSETS]), axis=0)
            places = places[(places < (z, y, x)).all(axis=1)]
        return in_table_order(places, (z, y, x))

    @cached_property
    def _ranges(self) -> dict[Block, tuple[int, int]]:
        """Blocks that hold candidates, in their order, and which ones."""
        blocks, starts = runs(self._candidates // BLOCK)
        ranges = zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)
        return {(z, y, x): span for (z, y, x), span in zip(blocks.tolist(), ranges, strict=True)}

    def _evaluated(self, places: NDArray[np.integer]) -> dict[str, NDArray]:
        """The 8³ voxels of the bricks at `places`, (n, 8, 8, 8, …): halves, and materials uint8."""
        import drjit as dr

        jit = arrays()
        index = dr.arange(jit.UInt, len(places) * INNER_VOXELS)
        inner = index % INNER_VOXELS
        z, y, x = (
            dr.minimum(
                dr.gather(jit.UInt, jit.UInt(np.ascontiguousarray(places[:, k], np.uint32)), index // INNER_VOXELS)
                * BRICK
                + inner // BRICK ** (2 - k) % BRICK,
                self.shape[k] - 1,
            )
            for k in range(3)
        )
        voxel = self._voxels(x, y, z)
        density = jit.Float(voxel["density"]) + 0.0 * jit.Float(x)  # as wide as the voxels
        axis = dr.select(density > 0, jit.Array3f(voxel["axis"]), 0)
        finite = dr.all(dr.isfinite(dr.squared_norm(axis)))
        packed = {"density": jit.Float16(density), "axis": dr.ravel(jit.Array3f16(axis))}
        if self.colours:
            colour = jit.Array4f(*voxel["colour"], *[0.0] * (4 - self.colours))
            packed["body_colour"] = dr.ravel(jit.Array4f16(colour + 0.0 * density))
        if self.material:
            packed["material"] = jit.UInt(voxel["material"]) + 0 * x
        dr.eval(packed, density, finite)
        check_density(density)
        if not np.array(finite).all():
            raise InputError("the axis of a voxel with matter is not finite: give unit vectors or zeros")
        values = {name: np.array(array).reshape(-1, *(BRICK,) * 3, *COMPONENTS[name]) for name, array in packed.items()}
        if self.colours:
            values["body_colour"] = values["body_colour"][..., : self.colours]
        if self.material:
            values["material"] = values["material"].astype(np.uint8)
        return values

    def _voxels(self, x: Any, y: Any, z: Any) -> dict[str, Any]:
        """The field at voxel indices."""
        position = (arrays().Array3f(x, y, z) + 0.5) * self.voxel_size
        values = self.field(position)
        if isinstance(values, dict):
            return values
        return dict(zip(("density", "axis", "material", "colour"), values, strict=False))

    def _may_hold(self, middle: Any, radius: float) -> Any:
        """`occupied` of a ball in lattice coordinates [voxels]."""
        assert self.occupied is not None
        return self.occupied((middle + 0.5) * self.voxel_size, radius * self.voxel_size)


def _block(bricks: NDArray, places: NDArray[np.integer]) -> NDArray:
    """The block of bricks (n, 8, 8, 8, …) at `places` (n, 3); 0 elsewhere."""
    block = np.zeros((BLOCK_SIDE,) * 3 + bricks.shape[4:], bricks.dtype)
    as_bricks(block)[tuple(places.T)] = bricks
    return block
