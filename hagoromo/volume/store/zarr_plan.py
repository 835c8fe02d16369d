"""Any Zarr array of densities, or two (densities and axes), as a volume box: in memory, or streamed to disk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.zarr_arrays import open_array
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.bricks import Bricks
from hagoromo.volume.store.blocks import BLOCK_SIDE, Block
from hagoromo.volume.store.header import BoxHeader
from hagoromo.volume.store.plan import BoxPlan
from hagoromo.volume.store.read_bricks import occupied_places, read_bricks
from hagoromo.volume.store.zarr_blocks import ZarrBlocks

BLOCKS_OF_DRAW = 8  # that a draw of a tile stands for


def box_from_zarr(
    density: str | Path,
    voxel_size: float,
    tau: float,
    materials: Sequence[Reflectance],
    axis: str | Path | None = None,
    scale: float = 1.0,
    **record: Any,
) -> VolumeBox:
    """The box of the Zarr array (v2 or v3) at `density`, (nz, ny, nx) of any type of numbers, whatever its chunks.

    axis: a Zarr array (nz, ny, nx, 3); without it axes point outwards, down the slope of the density. scale: density
    per unit of the array. record: pose, name, provenance. The array is read twice, tile by tile: memory follows the
    bricks that hold matter. Raises `InputError` for what cannot be read, is no density, or does not fit the memory.
    """
    header = BoxHeader(float(voxel_size), float(tau), tuple(materials), **record)
    return BoxPlan(header, ZarrVolume(density, axis, scale)).box()


class ZarrVolume:
    """The blocks of a Zarr array of densities, and of one of axes if there is one; see `box_from_zarr`."""

    def __init__(self, density: str | Path, axis: str | Path | None = None, scale: float = 1.0) -> None:
        if not (np.isfinite(scale) and scale > 0):
            raise InputError(f"scale is {scale}: give a finite number above 0")
        self.source = ZarrBlocks(open_array(density), {} if axis is None else {"axis": open_array(axis)}, scale)
        self.shape, self.colours, self.material = self.source.shape, 0, False

    def bricks(self, materials: int) -> Bricks:
        """All bricks that hold matter, on the device."""
        return read_bricks(self.source, occupied_places(self.source), materials)

    def parts(self) -> list[NDArray[np.integer]]:
        """The blocks (n, 3) of every tile."""
        inner = np.argwhere(np.ones([side // BLOCK_SIDE for side in self.source.tile], bool))
        ends = -(-np.array(self.shape) // BLOCK_SIDE)
        blocks = (inner + tile * self.source.tile // BLOCK_SIDE for tile in self.source.tiles())
        return [part[(part < ends).all(axis=1)] for part in blocks]

    def drawn(self, count: int) -> Iterator[tuple[float, Iterator[tuple[Block, dict[str, NDArray]]]]]:
        """Probability of a draw, and what `read` gives of the part: a tile, so that there are fewer draws."""
        parts = self.parts()
        share = np.array([len(part) for part in parts]) / max(sum(map(len, parts)), 1)
        draws = -(-count // BLOCKS_OF_DRAW) if parts else 0
        for number in np.random.default_rng(0).choice(len(parts), draws, p=share):
            yield float(share[number]), self.read(parts[number])

    def read(self, part: NDArray[np.integer]) -> Iterator[tuple[Block, dict[str, NDArray]]]:
        """The blocks of a tile that hold matter, with their voxels."""
        corner = part[0] * BLOCK_SIDE
        tile = tuple((corner // self.source.tile).tolist())
        values = self.source.voxels(tile)
        values["axis"] = np.where(values["density"][..., None] > 0, values["axis"], np.float16(0))
        for z, y, x in part.tolist():
            inner = tuple(
                slice(k - c, k - c + BLOCK_SIDE)
                for k, c in zip((z * BLOCK_SIDE, y * BLOCK_SIDE, x * BLOCK_SIDE), corner, strict=True)
            )
            block = {name: array[inner] for name, array in values.items()}
            if block["density"].any():
                yield (z, y, x), block
